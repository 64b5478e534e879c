"""The rows of a run by scenario and estimator, one line per trial: what verdicts are computed from."""

import re
from collections import Counter
from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.metrics.compare import succeeded
from cooploc.analysis.metrics.over_time import sweep
from cooploc.estimators import nearest, parse
from cooploc.estimators.interface import Array

Cell = tuple[str, str]  # scenario, estimator


class Missing(Exception):
    """The run lacks what a claim is about; says what."""


class Results(NamedTuple):
    """Per (scenario, estimator), by canonical labels: a frame with one line per trial that ended."""

    frames: dict[Cell, pd.DataFrame]  # index: trial; columns: mse, anees, coverage95, seconds, robots
    failures: Mapping[Cell, int]  # trials that failed
    bounds: set[str]

    def mse(self, *cells: Cell) -> Array:
        """Mean squared errors (trial, cell) of the trials that ended in all cells."""
        return self._joined("mse", cells)

    def parts(self, *cells: Cell) -> Array:
        """Seconds per robot and tick (part, cell): trials whose time was taken together share one value."""
        seconds = self._joined("seconds", cells)
        if not len(seconds):
            raise Missing(f"no times of {', '.join(name for _, name in cells)} in {cells[0][0]}")
        return np.unique(seconds, axis=0)

    def anees(self, cell: Cell) -> Array:
        return self._frame(cell)["anees"].dropna().to_numpy(float)

    def coverage(self, cell: Cell) -> Array:
        return self._frame(cell)["coverage95"].dropna().to_numpy(float)

    def failed(self, cell: Cell) -> int:
        return self.failures.get(_canonical(cell), 0)

    def bound(self, estimator: str) -> bool:
        return canonical(estimator) in self.bounds

    def trials(self, cell: Cell) -> int:
        return len(self._frame(cell))

    def robots(self, scenario: str) -> int:
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

    def _frame(self, cell: Cell) -> pd.DataFrame:
        frame = self.frames.get(_canonical(cell))
        if frame is None:
            here = [name for scenario, name in self.frames if scenario == canonical(cell[0])]
            raise Missing(f"no rows of {cell[1]} in {cell[0]}" + (f"; {nearest(cell[1], here)}" if here else ""))
        return frame

    def _joined(self, column: str, cells: tuple[Cell, ...]) -> Array:
        """(trial, cell) of the trials that have the column in all cells."""
        columns = [self._frame(cell)[column] for cell in cells]
        first = columns[0].index
        if not all(c.index.equals(first) for c in columns):  # joining takes most of the time, and is seldom needed
            columns = [c for _, c in pd.concat(columns, axis=1, join="inner", keys=range(len(cells))).items()]
        values: Array = np.stack([c.to_numpy(float) for c in columns], 1)
        complete: Array = values[np.isfinite(values).all(1)]
        return complete


def collect(rows: pd.DataFrame) -> Results:
    """Pool the robots of every trial, weighted by the ticks that count."""
    keys = ["scenario", "estimator", "trial"]
    ended = succeeded(rows)
    weight = ended["ticks"] / ended.groupby(keys)["ticks"].transform("sum")
    weighted = ended[["mse", "anees", "coverage95"]].mul(weight, axis=0).assign(**{k: ended[k] for k in keys})
    trials = weighted.groupby(keys, sort=False).sum(min_count=1)
    trials[["seconds", "robots"]] = ended.groupby(keys, sort=False)[["seconds", "robots"]].first()
    frames = {
        (canonical(str(s)), canonical(str(e))): part.droplevel([0, 1])
        for (s, e), part in trials.groupby(level=["scenario", "estimator"], sort=False)
    }
    lost = rows[rows["failure"].notna()] if "failure" in rows else rows[:0]
    once = lost.drop_duplicates(keys)
    failures = Counter(zip(once["scenario"].map(canonical), once["estimator"].map(canonical), strict=True))
    return Results(
        frames,
        failures,
        {canonical(str(name)) for name in ended.loc[ended["bound"].astype(bool), "estimator"].unique()},
    )


@cache
def canonical(label: str) -> str:
    """The label with its numbers in their shortest form and its options in alphabetical order."""
    path, written = parse(label)
    head, equals, value = path.partition("=")
    options = ",".join(f"{key}={_short(written[key])}" for key in sorted(written))
    return head + equals + _short(value) + (f"[{options}]" if options else "")


def _canonical(cell: Cell) -> Cell:
    return canonical(cell[0]), canonical(cell[1])


def _short(value: str) -> str:
    try:
        return f"{float(value):.12g}"
    except ValueError:
        return value.lower() if value.lower() in ("true", "false") else value
