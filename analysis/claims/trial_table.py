"""A run's trials by scenario and estimator, a row each: the numbers that verdicts are computed from."""

import re
from collections import Counter
from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from functools import cache
from typing import NamedTuple

import numpy as np
import pandas as pd

from cooploc import estimators, scenarios
from cooploc.analysis.metrics.errors import TRIAL, drop_failed, trial_means
from cooploc.analysis.metrics.ranking import is_refused
from cooploc.analysis.metrics.statistics import FIXED, Stopping
from cooploc.analysis.metrics.sweeps import sweep_points
from cooploc.estimators import nearest, parse
from cooploc.estimators.building import RENAMED
from cooploc.estimators.interface import Array
from cooploc.estimators.label_syntax import write_label
from cooploc.scenarios.scenario import split_family

Key = tuple[str, str]  # labels of a scenario and an estimator


class Missing(Exception):
    """The run lacks the scenario, estimator or number that a claim is about; the message names it."""


class TrialTable(NamedTuple):
    """Trials that succeeded, by canonical labels of scenario and estimator. Methods take labels in any spelling."""

    frames: dict[Key, pd.DataFrame]  # of `trial_means`; index: trial
    failures: Mapping[Key, int]  # trials that failed, an error that is not finite among them
    centralised: AbstractSet[str]  # estimators whose readings all reach one computer
    refused: AbstractSet[str] = frozenset()  # estimators that failed a check
    stopping: Stopping = FIXED  # how the number of trials came about, which intervals and tests depend on

    def frame(self, key: Key) -> pd.DataFrame:
        """Return the trials of an estimator in a scenario that succeeded, a row each."""
        frame = self.frames.get(_canonical(key))
        if frame is None:
            here = [name for scenario, name in self.frames if scenario == canonical(key[0])]
            near = f"; {nearest(key[1], here)}" if here and not estimators.REGISTRY.has(parse(key[1])[0]) else ""
            raise Missing(f"no rows of {key[1]} in {key[0]}{near}")
        return frame

    def values(self, column: str, *keys: Key) -> Array:
        """Return a number (trial, key) of the trials that have it in all keys, such as `mse` [m^2]."""
        columns = [self.frame(key)[column] for key in keys]
        if not all(c.index.equals(columns[0].index) for c in columns):  # joining takes time, and is seldom needed
            columns = [c for _, c in pd.concat(columns, axis=1, join="inner", keys=range(len(keys))).items()]
        values: Array = np.stack([c.to_numpy(float) for c in columns], 1)
        complete: Array = values[np.isfinite(values).all(1)]
        return complete

    def mse(self, *keys: Key) -> Array:
        """Return mean squared errors (trial, key) [m^2] of the trials that succeeded in all keys."""
        return self.values("mse", *keys)

    def seconds(self, *keys: Key) -> Array:
        """Return seconds per robot and tick (part, key): trials whose time was taken together share one value."""
        seconds = self.values("seconds", *keys)
        if not len(seconds):
            raise Missing(f"no times of {', '.join(name for _, name in keys)} in {keys[0][0]}")
        return np.unique(seconds, axis=0)

    def anees(self, key: Key) -> Array:
        """Return ANEES (trial,), of trials that have one."""
        return self.frame(key)["anees"].dropna().to_numpy(float)

    def errors(self, scenario: str, names: list[str]) -> pd.DataFrame:
        """Return mean squared errors [m^2], a row per trial, a column per estimator; nan where it has no such trial."""
        return pd.DataFrame({name: self.frame((scenario, name))["mse"] for name in names})

    def count_failures(self, key: Key) -> int:
        """Return the number of trials that failed."""
        return self.failures.get(_canonical(key), 0)

    def expand_label(self, label: str) -> list[str]:
        """Return the scenario of a label, or those of the run that `family/n={3..99}` stands for, by their value."""
        found = re.fullmatch(r"(.+[/,\[])([^=]+)=\{([^{}]+)\.\.([^{}]+)\}(.*)", label)
        known = list(dict.fromkeys(scenario for scenario, _ in self.frames))
        if found is None:
            inside = [label] if canonical(label) in known else []
        else:
            before, parameter, low, high, after = found.groups()
            first = sweep_points(canonical(f"{before}{parameter}={low}{after}"))
            wanted = [(family, name) for family, name, _ in first if name == parameter]
            values = {s: value for s in known for *one, value in sweep_points(s) if tuple(one) in wanted}
            inside = sorted((s for s, v in values.items() if float(low) <= v <= float(high)), key=lambda s: values[s])
        if not inside:
            is_known = scenarios.REGISTRY.has(split_family(parse(label)[0])[0])
            near = "" if found or is_known else f"; {nearest(label, known)}"
            raise Missing(f"no rows of {'any ' if found else ''}scenario {label}{near}")
        return inside


def collect(rows: pd.DataFrame, stopping: Stopping = FIXED) -> TrialTable:
    """Return the table of the rows of a run or of `errors`."""
    rows = rows.reset_index(drop=True)
    frames = {_canonical(cell): part for cell, part in trial_means(rows).items() if len(part)}
    lost = rows[~rows.index.isin(drop_failed(rows).index)].drop_duplicates(TRIAL)
    failures = Counter(map(_canonical, zip(lost["scenario"], lost["estimator"], strict=True)))
    lines = rows["certificate"] if "certificate" in rows else pd.Series("", rows.index)
    failing = lines.isin([line for line in lines.dropna().unique() if is_refused(line)])
    central, refused = (
        {canonical(str(name)) for name in rows.loc[chosen, "estimator"].unique()}
        for chosen in (rows["centralised"].eq(True), failing)
    )
    return TrialTable(frames, failures, central, refused, stopping)


@cache
def canonical(label: str) -> str:
    """Return the label with its numbers in their shortest form, its options sorted and by their present names."""
    path, given = parse(label)
    written = {RENAMED.get(key, key): value for key, value in given.items()}
    head, equals, value = path.partition("=")
    return write_label(head + equals + _short(value), {key: _short(written[key]) for key in sorted(written)})


def _canonical(key: Key) -> Key:
    return canonical(key[0]), canonical(key[1])


def _short(value: str) -> str:
    try:
        return f"{float(value):.12g}"
    except ValueError:
        return value.lower() if value.lower() in ("true", "false") else value
