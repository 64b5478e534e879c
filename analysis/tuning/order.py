"""Does the order of estimators change when each is tuned? Every pair, on the same fresh streams, before and after."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np
import pandas as pd

from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.pooling import succeeded, weighted_means
from cooploc.analysis.tuning.objective import trial_scores
from cooploc.estimators.interface import Array

LEVEL = 0.05


def order(rows: pd.DataFrame, tuned: Mapping[str, str], by: str = "rmse") -> pd.DataFrame:
    """One row per scenario and pair of estimators of which no trial failed, as published and as tuned.

    Columns: `scenario`, `a`, `b`: labels as published; `published`, `tuned`: the one with the smaller mean error, or
    empty where the difference is not significant (Holm over all pairs of all scenarios, in each of the two alone);
    `smaller_published`, `smaller_tuned`: that one, significant or not; `became`: "kept" (the same is significantly
    better), "reversed" (the other one is), "appeared" and "vanished" (significant only tuned, or only as published),
    "open" (neither).

    Args:
        rows: of the run on fresh streams.
        tuned: the tuned label of every estimator, by its label as published.
        by: "rmse", or "nll", the capped score of `objective`.

    """
    found = []
    for scenario, part in rows.groupby("scenario", sort=False):
        every = {str(label): _values(own, by) for label, own in part.groupby("estimator", sort=False)}
        values = {label: own for label, own in every.items() if own is not None}
        there = [label for label in tuned if label in values and tuned[label] in values]
        for a, b in combinations(there, 2):
            sides = {"published": (a, b), "tuned": (tuned[a], tuned[b])}
            pairs = {which: _both(values[one], values[other]) for which, (one, other) in sides.items()}
            found.append({"scenario": scenario, "a": a, "b": b, **_compared(pairs, a, b, by)})
    table = pd.DataFrame(found, columns=["scenario", "a", "b", *_columns()])
    for which in ("published", "tuned"):
        adjusted = statistics.holm(table.pop(f"p_{which}").to_numpy(float))
        table[which] = table[f"smaller_{which}"].where(adjusted < LEVEL, "")
    table["became"] = [_became(p, t) for p, t in zip(table["published"], table["tuned"], strict=True)]
    return table


def _columns() -> list[str]:
    return [f"{what}_{which}" for which in ("published", "tuned") for what in ("smaller", "p")]


def _values(rows: pd.DataFrame, by: str) -> "pd.Series[float] | None":
    """A value for each trial; None where one failed."""
    ended = succeeded(rows)
    if len(ended) < len(rows):
        return None
    return weighted_means(rows, ["trial"], ["mse"])["mse"] if by == "rmse" else trial_scores(rows, by)


def _both(one: "pd.Series[float]", other: "pd.Series[float]") -> tuple[Array, Array]:
    """The two's values in the trials of both."""
    joined = pd.concat([one, other], axis=1, join="inner").dropna().to_numpy(float)
    return joined[:, 0], joined[:, 1]


def _compared(pairs: Mapping[str, tuple[Array, Array]], a: str, b: str, by: str) -> dict[str, object]:
    found: dict[str, object] = {}
    for which, (x, y) in pairs.items():
        enough = len(x) >= statistics.LEAST_TRIALS and not np.array_equal(x, y)
        found[f"smaller_{which}"] = "" if not len(x) or x.mean() == y.mean() else a if x.mean() < y.mean() else b
        found[f"p_{which}"] = _p(x, y, by) if enough else np.nan
    return found


def _p(x: Array, y: Array, by: str) -> float:
    """p against equal RMSE, by Fieller's interval; against equal mean scores, which may be negative, by the t test."""
    return statistics.p_of_difference(x, y) if by == "rmse" else statistics.p_of_mean(statistics.mean(y - x), len(x), 0)


def _became(published: str, tuned: str) -> str:
    if published and tuned:
        return "kept" if published == tuned else "reversed"
    return "vanished" if published else "appeared" if tuned else "open"
