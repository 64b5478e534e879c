"""Which comparisons of a run are decided, at which look: what `cooploc run --until-decided` goes by.

A comparison is one estimator with its scenario's baseline, on the same streams. At a look after n trials it is decided
by the confidence sequence of the relative change of RMSE (`stopping.ANYTIME`): better or worse where it excludes 0,
else a tie where it lies within the margin. Looks count trials by their number, never by when they finished: decisions
depend on nothing but the study, the seed and the looks.

No estimator gains by failing: where the sequence would call it better, or a tie, and it failed in a trial, the
comparison is *failed*, for no further trial can change that.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.metrics import stopping
from cooploc.analysis.metrics.pooling import succeeded, weighted_means
from cooploc.analysis.metrics.statistics import Interval, holm
from cooploc.estimators.interface import Array

FIRST = 10  # trials at the first look; each later one doubles them
MARGIN = 0.05
OPEN, FAILED = "open", "failed"


def looks(most: int) -> list[int]:
    """Numbers of trials after which a run of at most so many is looked at: 10, 20, 40, ..., and the last one."""
    out = [min(FIRST, most)]
    while out[-1] < most:
        out.append(min(2 * out[-1], most))
    return out


class Decision(NamedTuple):
    """One comparison at its last look."""

    scenario: str
    estimator: str
    baseline: str
    verdict: str = OPEN  # or better, worse, tie, failed
    look: int = 0  # trials after which it was decided, or was last looked at
    change: float = np.nan  # of RMSE, against the baseline's
    low: float = np.nan  # its confidence sequence
    high: float = np.nan
    e: float = np.nan  # e-value against equal RMSE; of equals, 20 is reached in 5 % of runs at most


def decide(
    rows: pd.DataFrame, baselines: Mapping[str, str], most: Mapping[str, int], margin: float = MARGIN
) -> list[Decision]:
    """Every comparison at the look that decided it, or at the last look for which all its trials are there.

    Args:
        rows: of a run.
        baselines: by scenario.
        most: trials of the last look, by scenario.
        margin: the share of RMSE by which two may differ and still tie.

    """
    cells = _by_trial(rows)
    return [
        _first(Decision(scenario, name, baselines[scenario]), cells[scenario, baselines[scenario]], mse, at, margin)
        for (scenario, name), mse in cells.items()
        if name != baselines[scenario] and (at := looks(most[scenario]))
    ]


def with_decisions(table: pd.DataFrame, found: pd.DataFrame) -> pd.DataFrame:
    """The table of `compare(..., full=True)` with what was decided of each row, in place of tests of a fixed n.

    Columns:
        verdict, look: as of `Decision`; empty and 0 for a baseline
        p, p_holm: 1 / e, which is valid at any stopping, 1 where it rests on failures; p_holm by Holm over all rows
        p_equal, p_equal_holm: nan, for a tie is a verdict here
    """
    cell = ["scenario", "estimator"]
    joined = table[cell].merge(found[[*cell, "verdict", "look", "e"]], how="left", on=cell)
    p = np.minimum(1.0, 1 / joined["e"].to_numpy(float))
    p = np.where(joined["verdict"] == FAILED, 1.0, p)
    verdict, look = joined["verdict"].fillna("").to_numpy(), joined["look"].fillna(0).astype(int).to_numpy()
    return table.assign(verdict=verdict, look=look, p=p, p_holm=holm(p), p_equal=np.nan, p_equal_holm=np.nan)


def _by_trial(rows: pd.DataFrame) -> dict[tuple[str, str], Array]:
    """Mean squared errors [m^2] of trials 0, 1, ... up to the first that is not there; nan where a trial failed."""
    keys = ["scenario", "estimator", "trial"]
    ran = rows.drop_duplicates(keys).set_index(keys).index
    mse = weighted_means(succeeded(rows), keys, ["mse"]).reindex(ran).reset_index().sort_values("trial")
    parts = {(str(s), str(e)): part for (s, e), part in mse.groupby(keys[:2], sort=False)}
    order = rows[keys[:2]].drop_duplicates().itertuples(index=False, name=None)
    return {(str(s), str(e)): _without_gaps(parts[str(s), str(e)]) for s, e in order}


def _without_gaps(part: pd.DataFrame) -> Array:
    values: Array = part["mse"].to_numpy(float)[part["trial"].to_numpy() == np.arange(len(part))]
    return values


def _first(found: Decision, base: Array, mine: Array, at: list[int], margin: float) -> Decision:
    for n in at:
        if found.verdict == OPEN and n <= min(len(base), len(mine)):
            found = _at(found._replace(look=n), base[:n], mine[:n], margin)
    return found


def _at(found: Decision, base: Array, mine: Array, margin: float) -> Decision:
    """What a look at squared errors (n,) says; nan: failed."""
    both = ~np.isnan(base) & ~np.isnan(mine)
    a, b = base[both], mine[both]
    change = stopping.ANYTIME.change(a, b)
    verdict = _verdict(change, margin)
    favoured = {"better": (mine,), "worse": (base,), "tie": (base, mine)}.get(verdict, ())
    if any(np.isnan(one).any() for one in favoured):
        verdict = FAILED
    e = stopping.e_of_change(a, b) if len(a) else np.nan
    return found._replace(verdict=verdict, change=change.value, low=change.low, high=change.high, e=e)


def _verdict(change: Interval, margin: float) -> str:
    if change.high < 0:
        return "better"
    if change.low > 0:
        return "worse"
    return "tie" if stopping.within(change, margin) else OPEN
