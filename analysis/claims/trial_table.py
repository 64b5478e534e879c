"""A run's trials by scenario and estimator, one line each: what verdicts are computed from."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from collections.abc import Set as AbstractSet
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.metrics import ranking
from cooploc.analysis.metrics.curves import sweep
from cooploc.analysis.metrics.errors import drop_failed, weighted_means
from cooploc.analysis.metrics.sequential import FIXED, Stopping
from cooploc.estimators import nearest, parse
from cooploc.estimators.building import RENAMED
from cooploc.estimators.interface import Array

Key = tuple[str, str]  # labels of a scenario and an estimator


class Missing(Exception):
    """The run lacks what a claim is about; says what."""


class TrialTable(NamedTuple):
    """Trials that succeeded, by canonical labels of scenario and estimator. Methods take labels in any spelling.

    What failed, an error that is not finite among it, is counted in `failures`.
    """

    frames: dict[Key, pd.DataFrame]  # mse, anees, coverage95, seconds, robots; index: trial
    failures: Mapping[Key, int]  # trials that failed
    centralised: set[str]  # estimators whose readings all reach one computer
    refused: AbstractSet[str] = frozenset()  # estimators that failed a check
    stopping: Stopping = FIXED  # how the number of trials came about, which intervals and tests depend on

    def mse(self, *keys: Key) -> Array:
        """Mean squared errors (trial, key) [m^2] of the trials that succeeded in all keys."""
        return self._joined("mse", keys)

    def errors(self, scenario: str, names: list[str]) -> pd.DataFrame:
        """Mean squared errors [m^2], a row per trial, a column per estimator; nan where it has no such trial."""
        return pd.DataFrame({name: self._frame((scenario, name))["mse"] for name in names})

    def seconds(self, *keys: Key) -> Array:
        """Seconds per robot and tick (part, key): trials whose time was taken together share one value."""
        seconds = self._joined("seconds", keys)
        if not len(seconds):
            raise Missing(f"no times of {', '.join(name for _, name in keys)} in {keys[0][0]}")
        return np.unique(seconds, axis=0)

    def anees(self, key: Key) -> Array:
        """ANEES (trial,), of trials that have one."""
        return self._frame(key)["anees"].dropna().to_numpy(float)

    def coverage(self, key: Key) -> Array:
        """Share of truths in the 95 % ellipse (trial,), of trials that have one."""
        return self._frame(key)["coverage95"].dropna().to_numpy(float)

    def failed(self, key: Key) -> int:
        """How many trials failed."""
        return self.failures.get(_canonical(key), 0)

    def is_centralised(self, estimator: str) -> bool:
        """Whether all readings of an estimator reach one computer."""
        return canonical(estimator) in self.centralised

    def is_refused(self, estimator: str) -> bool:
        """Whether an estimator failed a check."""
        return canonical(estimator) in self.refused

    def trials(self, key: Key) -> int:
        """How many trials succeeded."""
        return len(self._frame(key))

    def robots(self, scenario: str) -> int:
        """Robots in the team."""
        return next(int(f["robots"].iloc[0]) for (s, _), f in self.frames.items() if s == canonical(scenario))

    def swept(self, scenario: str) -> float:
        """The value that the scenario's label sweeps."""
        value = sweep(scenario)[2]
        if not np.isfinite(value):
            raise Missing(f"{scenario} sweeps no number")
        return value

    def matching(self, label: str) -> list[str]:
        """The scenario of a label, or those of the run that `family/n={3..99}` stands for, by their value."""
        found = re.fullmatch(r"(.+)\{([^{}]+)\.\.([^{}]+)\}(.*)", label)
        known = list(dict.fromkeys(scenario for scenario, _ in self.frames))
        if found is None:
            if canonical(label) not in known:
                raise Missing(f"no rows of scenario {label}")
            return [label]
        before, low, high, after = found.groups()
        wanted = sweep(canonical(f"{before}{low}{after}"))[:2]
        read = [(sweep(s), s) for s in known]
        inside = sorted(
            (v, s) for ((*which, v), s) in read if tuple(which) == wanted and float(low) <= v <= float(high)
        )
        if not inside:
            raise Missing(f"no rows of any scenario {label}")
        return [s for _, s in inside]

    def _frame(self, key: Key) -> pd.DataFrame:
        frame = self.frames.get(_canonical(key))
        if frame is None:
            here = [name for scenario, name in self.frames if scenario == canonical(key[0])]
            raise Missing(f"no rows of {key[1]} in {key[0]}" + (f"; {nearest(key[1], here)}" if here else ""))
        return frame

    def _joined(self, column: str, keys: tuple[Key, ...]) -> Array:
        """(trial, key) of the trials that have the column in all keys."""
        columns = [self._frame(key)[column] for key in keys]
        first = columns[0].index
        if not all(c.index.equals(first) for c in columns):  # joining takes most of the time, and is seldom needed
            columns = [c for _, c in pd.concat(columns, axis=1, join="inner", keys=range(len(keys))).items()]
        values: Array = np.stack([c.to_numpy(float) for c in columns], 1)
        complete: Array = values[np.isfinite(values).all(1)]
        return complete


def collect(rows: pd.DataFrame, stopping: Stopping = FIXED) -> TrialTable:
    """The table of the rows of a run or of `errors`."""
    rows = rows.reset_index(drop=True)
    keys, ended = ["scenario", "estimator", "trial"], drop_failed(rows)
    trials = weighted_means(ended, keys, ["mse", "anees", "coverage95"])
    trials[["seconds", "robots"]] = ended.groupby(keys, sort=False)[["seconds", "robots"]].first()
    parts = trials.groupby(level=["scenario", "estimator"], sort=False)
    frames = {_canonical((str(s), str(e))): part.droplevel([0, 1]) for (s, e), part in parts}
    once = rows[~rows.index.isin(ended.index)].drop_duplicates(keys)
    failures = Counter(map(_canonical, zip(once["scenario"], once["estimator"], strict=True)))
    central = rows.loc[rows["centralised"].eq(True), "estimator"].unique()
    failing = rows.loc[_refused(rows), "estimator"].unique()
    return TrialTable(frames, failures, _labels(central), _labels(failing), stopping)


def _refused(rows: pd.DataFrame) -> "pd.Series[bool]":
    lines = rows["certificate"] if "certificate" in rows else pd.Series("", rows.index)
    return lines.isin([line for line in lines.dropna().unique() if ranking.is_refused(line)])


def _labels(names: Iterable[Any]) -> set[str]:
    return {canonical(str(name)) for name in names}


@cache
def canonical(label: str) -> str:
    """The label with its numbers in their shortest form, its options sorted and by their present names."""
    path, given = parse(label)
    written = {RENAMED.get(key, key): value for key, value in given.items()}
    head, equals, value = path.partition("=")
    options = ",".join(f"{key}={_short(written[key])}" for key in sorted(written))
    return head + equals + _short(value) + (f"[{options}]" if options else "")


def _canonical(key: Key) -> Key:
    return canonical(key[0]), canonical(key[1])


def _short(value: str) -> str:
    try:
        return f"{float(value):.12g}"
    except ValueError:
        return value.lower() if value.lower() in ("true", "false") else value
