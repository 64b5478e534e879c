"""Which estimators qualify as best, mean ranks and groups over trials, and the Pareto front of accuracy and cost."""

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.certificate_line import failed_check, refused
from cooploc.analysis.metrics.consistency import DOUBTFUL
from cooploc.analysis.metrics.stopping import FIXED, Stopping
from cooploc.estimators.interface import Array, Mask

ALPHA = 1 - statistics.LEVEL


def disqualified(row: Mapping[Any, Any]) -> list[str]:
    """Why an estimator does not qualify as best in a scenario, from its row of `compare`; empty where it does.

    To qualify it must have passed its checks, be distributed, have seen no reading before its time, have failed in no
    trial, and have a covariance that was assessed and found neither over-wide nor over-confident: not by its interval,
    nor by an ANEES above `DOUBTFUL`, however wide.
    """
    flag, offline = row["consistency"], bool(row.get("offline", False))
    reasons = {
        f"failed the check {failed_check(row['certificate'])}": refused(row["certificate"]),
        "a bound": bool(row["bound"]),
        "offline": offline,
        "centralised": bool(row["centralised"] and not row["bound"] and not offline),
        "over-confident": flag == "over-confident",
        "probably over-confident": flag == "not shown" and row["anees"] > DOUBTFUL,
        "over-wide": flag == "over-wide",
        "consistency not assessed": flag == "not assessed",
        f"{row['failed']} trial{'' if row['failed'] == 1 else 's'} failed": row["failed"] > 0,
    }
    return [reason for reason, holds in reasons.items() if holds]


def rank_groups(mse: pd.DataFrame, stopping: Stopping = FIXED) -> tuple[dict[str, float], dict[str, str]]:
    """Mean ranks of estimators and their `letters`, from squared errors: a row per trial, a column per estimator.

    No ranks in a run that may have stopped at any look: its estimators have different numbers of trials, and a mean of
    ranks over the few that all have would leave out the others. There are no letters below two estimators or
    `statistics.LEAST_TRIALS` trials.
    """
    ranks = mse.rank(axis=1).mean().to_dict() if stopping is FIXED else {}
    enough = len(mse) >= statistics.LEAST_TRIALS and mse.shape[1] > 1
    return {str(name): float(r) for name, r in ranks.items()}, letters(mse, stopping) if enough else {}


def letters(mse: pd.DataFrame, stopping: Stopping = FIXED) -> dict[str, str]:
    """Letters of estimators from squared errors; those that share one do not differ significantly at 5 %.

    All pairs by the test of the change of RMSE, each over the trials that both have (nan: has not), adjusted by Holm:
    the rule by which everything else is decided, so that letters never contradict an interval.
    """
    names = [str(name) for name in mse.columns]
    values = mse.to_numpy(float).T
    pairs = list(combinations(range(len(names)), 2))
    p = statistics.holm(np.array([stopping.p_of_difference(*_shared(values[[i, j]])) for i, j in pairs]))
    if not (p < ALPHA).any():
        return dict.fromkeys(names, "a")
    import scikit_posthocs

    square = np.ones((len(names), len(names)))
    for (i, j), one in zip(pairs, np.nan_to_num(p, nan=1.0), strict=True):
        square[i, j] = square[j, i] = one
    found = scikit_posthocs.compact_letter_display(pd.DataFrame(square, names, names), alpha=ALPHA)
    return {str(name): str(marks).replace(" ", "") for name, marks in found.items()}


def _shared(pair: Array) -> Array:
    """The trials (2, k) that both have."""
    both: Array = pair[:, ~np.isnan(pair).any(0)]
    return both


def front(rmse: Array, cost: Array) -> Mask:
    """The Pareto front (k,): True where no other is as good in both RMSE and cost and better in one; False at a nan."""
    known = np.isfinite(rmse) & np.isfinite(cost)
    no_worse = (rmse <= rmse[:, None]) & (cost <= cost[:, None]) & known  # (i, j): j is no worse than i
    better = no_worse & ((rmse < rmse[:, None]) | (cost < cost[:, None]))
    efficient: Mask = known & ~better.any(1)
    return efficient
