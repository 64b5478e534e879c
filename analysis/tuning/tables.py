"""Tables of a tuning: what was tried, what tuning changed on fresh streams, and whether it changed the order."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.errors import drop_failed, weighted_means
from cooploc.analysis.metrics.sequential import FIXED
from cooploc.analysis.tuning.search import Entrant, Finish, trial_scores
from cooploc.estimators.registry import parse

VALUE = "value: "  # before a parameter's name: columns of `history`
SHOWN = ("rmse", "nll", "anees", "consistency", "coverage95", "failed")
SIDES = ("published", "tuned")
SIGNIFICANCE = 0.05


def history(finishes: Sequence[Finish]) -> pd.DataFrame:
    """Return one row per configuration that was tried, in the order in which it entered.

    Columns: `estimator`, `number`, `label`; `state`, "finished", or "stopped" as hopeless; `rounds`; `trials` that it
    used; `spent`, those of its estimator until then; `score`, its mean over its rounds; `gain`, how much smaller that
    is than the published one's on the same rounds; `best`, whether it was the best until then; and "value: NAME" for
    every parameter.
    """
    return pd.DataFrame([_history_row(finish, entrant) for finish in finishes for entrant in finish.entrants])


def _history_row(finish: Finish, entrant: Entrant) -> dict[str, Any]:
    lanes, published = finish.lanes, finish.entrants[0]
    score = entrant.mean(lanes, entrant.rounds)
    written = parse(entrant.label)[1]
    return {
        "estimator": finish.published,
        "number": entrant.number,
        "label": entrant.label,
        "state": entrant.state,
        "rounds": entrant.rounds,
        "trials": len(entrant.scores),
        "spent": entrant.spent,
        "score": score,
        "gain": published.mean(lanes, entrant.rounds) - score,
        "best": entrant.best,
        **{f"{VALUE}{key}": written.get(key, one.default) for key, one in finish.space.parameters.items()},
    }


def gains(rows: pd.DataFrame, finishes: Sequence[Finish], objective: str) -> pd.DataFrame:
    """Return one row per scenario and estimator: as published and as tuned on the same fresh streams.

    Columns:
        scenario, estimator: as the study has it; tuned: the label of the tuned configuration
        rmse [m], nll [nats], anees, consistency, coverage95, failed: each `_published` and `_tuned`, as of `compare`
        score_published, score_tuned: the mean of what was made small, in its unit
        change, change_low, change_high: RMSE tuned / published - 1, with its paired 95 % interval
        p_holm: p of that difference, adjusted by Holm over all rows
        training_gain: how much the mean score fell on the training streams, of which the best was chosen; nan where
            the scenario was not trained on
        fresh_gain, fresh_gain_low, fresh_gain_high: the same on fresh streams, with its paired 95 % interval
        rank_published, rank_tuned: by RMSE among the scenario's estimators; nan where a trial failed

    Args:
        rows: of the run on fresh streams, with both configurations of every estimator.
        finishes: of the races.
        objective: what was made small.

    """
    of = {one.published: one for one in finishes}
    table = pd.DataFrame(
        [
            _compare_pair(part[part["estimator"].isin({name, of[name].best.label})], str(scenario), of[name], objective)
            for scenario, part in rows.groupby("scenario", sort=False)
            for name in part["estimator"].unique()
            if name in of
        ]
    )
    table["p_holm"] = statistics.holm(table["p"].to_numpy(float))
    for which in SIDES:
        ranked = table[f"rmse_{which}"].where(table[f"failed_{which}"] == 0)
        table[f"rank_{which}"] = ranked.groupby(table["scenario"]).rank(method="min")
    return table.drop(columns="p")


def _compare_pair(rows: pd.DataFrame, scenario: str, finish: Finish, objective: str) -> dict[str, Any]:
    published, best = finish.published, finish.best.label
    records = {row["estimator"]: row for row in compare(rows, baseline=published, full=True).to_dict("records")}
    before, after = records[published], records[best]
    scores = {label: trial_scores(part, objective) for label, part in rows.groupby("estimator")}
    fresh = statistics.mean(np.asarray(scores[published] - scores[best], float))
    lane, rounds = [one for one in finish.lanes if one.judged == scenario], finish.rounds
    same = best == published
    return {
        "scenario": scenario,
        "estimator": published,
        "tuned": best,
        "trials": int(before["trials"]),
        **{f"{name}_{which}": row[name] for name in SHOWN for which, row in zip(SIDES, (before, after), strict=True)},
        "score_published": scores[published].mean(),
        "score_tuned": scores[best].mean(),
        **{name: 0.0 if same else after[name] for name in ("change", "change_low", "change_high")},
        "p": np.nan if same else after["p"],
        "training_gain": finish.entrants[0].mean(lane, rounds) - finish.best.mean(lane, rounds) if lane else np.nan,
        "fresh_gain": fresh.value,
        "fresh_gain_low": fresh.low,
        "fresh_gain_high": fresh.high,
    }


def order(rows: pd.DataFrame, tuned: Mapping[str, str], by: str = "rmse") -> pd.DataFrame:
    """Compare every pair of estimators without failed trials, as published and as tuned; one row per scenario and pair.

    Columns: `scenario`, `a`, `b`: labels as published; `published`, `tuned`: the one with the smaller mean error, or
    empty where the difference is not significant (Holm over all pairs of all scenarios, in each of the two alone);
    `smaller_published`, `smaller_tuned`: that one, significant or not; `became`: "kept" (the same is significantly
    better), "reversed" (the other one is), "appeared" and "vanished" (significant only tuned, or only as published),
    "open" (neither).

    Args:
        rows: of the run on fresh streams.
        tuned: the tuned label of every estimator, by its label as published.
        by: "rmse", or "nll", the capped score of `search.trial_scores`.

    """
    found: list[dict[str, Any]] = []
    for scenario, part in rows.groupby("scenario", sort=False):
        values = {
            str(label): weighted_means(own, ["trial"], ["mse"])["mse"] if by == "rmse" else trial_scores(own, by)
            for label, own in part.groupby("estimator", sort=False)
            if len(drop_failed(own)) == len(own)
        }
        there = [label for label in tuned if label in values and tuned[label] in values]
        for a, b in combinations(there, 2):
            row: dict[str, Any] = {"scenario": scenario, "a": a, "b": b}
            for which, (one, other) in zip(SIDES, ((a, b), (tuned[a], tuned[b])), strict=True):
                both = pd.concat([values[one], values[other]], axis=1, join="inner").dropna().to_numpy(float)
                x, y = both[:, 0], both[:, 1]
                enough = len(x) >= statistics.LEAST_TRIALS and not np.array_equal(x, y)
                row[f"smaller_{which}"] = "" if not len(x) or x.mean() == y.mean() else a if x.mean() < y.mean() else b
                row[f"p_{which}"] = _p_value(x, y, by) if enough else np.nan
            found.append(row)
    columns = [f"{what}_{which}" for which in SIDES for what in ("smaller", "p")]
    table = pd.DataFrame(found, columns=["scenario", "a", "b", *columns])
    for which in SIDES:
        adjusted = statistics.holm(table.pop(f"p_{which}").to_numpy(float))
        table[which] = table[f"smaller_{which}"].where(adjusted < SIGNIFICANCE, "")
    table["became"] = [_outcome(p, t) for p, t in zip(table["published"], table["tuned"], strict=True)]
    return table


def _p_value(x: Any, y: Any, by: str) -> float:
    """Return p against equal RMSE, as of `change`; against equal mean scores, maybe negative, by the t test."""
    return FIXED.p_of_difference(x, y) if by == "rmse" else statistics.p_of_mean(statistics.mean(y - x), len(x), 0)


def _outcome(published: str, tuned: str) -> str:
    if published and tuned:
        return "kept" if published == tuned else "reversed"
    return "vanished" if published else "appeared" if tuned else "open"
