"""Who is best, and at what cost: ranks over trials, groups that cannot be told apart, fronts of accuracy and cost.

An over-confident estimator is never called best, nor is one whose ANEES is far too large by an interval that does not
exclude the limit, nor is a bound, nor one that failed in any trial. One whose certificate failed is not ranked at all.
"""

import numpy as np
import pandas as pd
from scipy import stats

from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.certificate_line import refused
from cooploc.analysis.metrics.compare import consistency, demand_same_streams, per_trial, succeeded, summarize
from cooploc.analysis.metrics.consistency import DOUBTFUL
from cooploc.estimators.interface import Array, Mask

COSTS = ("seconds", "bytes", "messages")


def ranking(errors: pd.DataFrame) -> pd.DataFrame:
    """One row per (scenario, estimator), best RMSE first within its scenario.

    Columns: `rmse`, `anees`, `consistency`, `bound`, `failed`, the three costs; `rank`, the mean over trials of the
    estimator's rank by RMSE; `group`, letters: estimators that share one are not told apart at 5 % (Friedman's test,
    then Nemenyi's of all pairs; trials are the blocks; Demsar, JMLR 2006); `best`, True for the smallest RMSE of those
    that may be called best; `near_best`, True for all that share a letter with it; and `front`, the costs for which
    nothing that can be had is no worse in cost and RMSE and better in one (a bound cannot be had).

    Raises:
        BadInput: rows to be ranked are of different streams.

    """
    demand_same_streams(errors)
    table = summarize(errors)
    table["consistency"] = consistency(table)
    table["bound"] = errors.groupby(["scenario", "estimator"], sort=False)["bound"].any().to_numpy()
    parts = [_ranked(part, errors) for _, part in table.groupby("scenario", sort=False)]
    wanted = ["scenario", "estimator", "trials", "rank", "group", "best", "near_best", "rmse", "rmse_low", "rmse_high"]
    wanted += ["anees", "consistency", "bound", "failed", *COSTS, "front", "certificate"]
    return pd.concat(parts, ignore_index=True)[wanted]


def front(rmse: Array, cost: Array) -> Mask:
    """Which of several (k,) no other is as good as in both RMSE and cost, and better in one; never one with a nan."""
    known = np.isfinite(rmse) & np.isfinite(cost)
    no_worse = (rmse <= rmse[:, None]) & (cost <= cost[:, None]) & known  # (i, j): j is no worse than i
    better = no_worse & ((rmse < rmse[:, None]) | (cost < cost[:, None]))
    efficient: Mask = known & ~better.any(1)
    return efficient


def _ranked(part: pd.DataFrame, errors: pd.DataFrame) -> pd.DataFrame:
    mine = succeeded(errors[errors["scenario"] == part["scenario"].iloc[0]])
    rank, group = _friedman(mine[~mine["certificate"].map(refused)] if "certificate" in mine else mine)
    part = part.assign(rank=part["estimator"].map(rank), group=[group.get(name, "") for name in part["estimator"]])
    part["refused"] = part["certificate"].map(refused).astype(bool)
    had = part["rmse"].where(~part["bound"] & ~part["refused"]).to_numpy(float)
    fronts = {cost: front(had, part[cost].to_numpy(float)) for cost in COSTS}
    part["front"] = [", ".join(cost for cost in COSTS if fronts[cost][i]) for i in range(len(part))]
    part = part.sort_values("rmse", kind="stable")
    suspect = part["consistency"].isin(("over-confident", "not assessed"))
    suspect |= (part["consistency"] == "undecided") & (part["anees"] > DOUBTFUL)
    barred = part["refused"] | part["bound"] | (part["failed"] > 0) | suspect
    able = part[~barred & (part["group"] != "")]
    part["best"] = part.index.isin(able.index[:1])
    letters = set(able["group"].iloc[0]) if len(able) else set()
    part["near_best"] = [bool(letters & set(group)) for group in part["group"]]
    return part


def _friedman(rows: pd.DataFrame) -> tuple[dict[str, float], dict[str, str]]:
    """Mean ranks, and letters, over the trials in which nobody failed; no letters where there is nothing to test."""
    trials = {str(name): per_trial(group)["mse"] for name, group in rows.groupby("estimator", sort=False)}
    return groups(pd.DataFrame(trials).dropna())


def groups(blocks: pd.DataFrame) -> tuple[dict[str, float], dict[str, str]]:
    """Mean ranks and letters, as of `ranking`, from squared errors with a row per trial and a column per estimator."""
    mean = {str(name): float(r) for name, r in blocks.rank(axis=1).mean().items()}
    if len(blocks) < statistics.LEAST_TRIALS or blocks.shape[1] < 2:
        return mean, {}
    return mean, letters(blocks)


def letters(blocks: pd.DataFrame) -> dict[str, str]:
    """The groups of `ranking`, from squared errors with a row per trial and a column per estimator."""
    names = [str(name) for name in blocks.columns]
    if len(names) == 2:  # Friedman's test wants three; Wilcoxon's is that of two
        p, _ = statistics.signed_rank(*np.sqrt(blocks.to_numpy()).T)
        return dict(zip(names, ("a", "b" if p < 0.05 else "a"), strict=True))
    if (blocks.nunique(axis=1) == 1).all() or stats.friedmanchisquare(*blocks.to_numpy().T).pvalue >= 0.05:
        return dict.fromkeys(names, "a")
    import scikit_posthocs

    letters = scikit_posthocs.compact_letter_display(scikit_posthocs.posthoc_nemenyi_friedman(blocks), alpha=0.05)
    return {str(name): str(marks).replace(" ", "") for name, marks in letters.items()}
