"""Which estimators qualify as best, mean ranks and groups over trials, and the Pareto front of accuracy and cost."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.certificate_line import mark, refused
from cooploc.analysis.metrics.consistency import DOUBTFUL
from cooploc.estimators.interface import Array, Mask


def disqualified(row: Mapping[Any, Any]) -> list[str]:
    """Why an estimator does not qualify as best in a scenario, from its row of `compare`; empty where it does.

    To qualify it must have passed its checks, be distributed, have failed in no trial, and have a covariance that was
    assessed and not found over-confident: neither by its interval, nor by an ANEES above `DOUBTFUL`, however wide.
    """
    flag = row["consistency"]
    reasons = {
        f"failed the check {mark(row['certificate'])[2:]}": refused(row["certificate"]),
        "a bound": bool(row["bound"]),
        "centralised": bool(row["centralised"] and not row["bound"]),
        "over-confident": flag == "over-confident",
        "probably over-confident": flag == "undecided" and row["anees"] > DOUBTFUL,
        "consistency not assessed": flag == "not assessed",
        f"{row['failed']} trial{'' if row['failed'] == 1 else 's'} failed": row["failed"] > 0,
    }
    return [reason for reason, holds in reasons.items() if holds]


def rank_groups(mse: pd.DataFrame) -> tuple[dict[str, float], dict[str, str]]:
    """Mean ranks of estimators and their `letters`, from squared errors: a row per trial, a column per estimator.

    There are no letters below two estimators or `statistics.LEAST_TRIALS` trials.
    """
    ranks = {str(name): float(r) for name, r in mse.rank(axis=1).mean().items()}
    enough = len(mse) >= statistics.LEAST_TRIALS and mse.shape[1] > 1
    return ranks, letters(mse) if enough else {}


def letters(mse: pd.DataFrame) -> dict[str, str]:
    """Letters of estimators from squared errors; those that share one do not differ significantly at 5 %.

    Friedman's test, then Nemenyi's of all pairs, with trials as blocks (Demsar, JMLR 2006); of two estimators,
    Wilcoxon's signed-rank test.
    """
    names = [str(name) for name in mse.columns]
    if len(names) == 2:  # Friedman's test needs three
        p, _ = statistics.signed_rank(*np.sqrt(mse.to_numpy()).T)
        return dict(zip(names, ("a", "b" if p < 0.05 else "a"), strict=True))
    if (mse.nunique(axis=1) == 1).all() or stats.friedmanchisquare(*mse.to_numpy().T).pvalue >= 0.05:
        return dict.fromkeys(names, "a")
    import scikit_posthocs

    found = scikit_posthocs.compact_letter_display(scikit_posthocs.posthoc_nemenyi_friedman(mse), alpha=0.05)
    return {str(name): str(marks).replace(" ", "") for name, marks in found.items()}


def front(rmse: Array, cost: Array) -> Mask:
    """The Pareto front (k,): True where no other is as good in both RMSE and cost and better in one; False at a nan."""
    known = np.isfinite(rmse) & np.isfinite(cost)
    no_worse = (rmse <= rmse[:, None]) & (cost <= cost[:, None]) & known  # (i, j): j is no worse than i
    better = no_worse & ((rmse < rmse[:, None]) | (cost < cost[:, None]))
    efficient: Mask = known & ~better.any(1)
    return efficient
