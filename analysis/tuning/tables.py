"""Tables of a tuning: every configuration that was tried, and every estimator as published and tuned, paired."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.errors import drop_failed, weighted_means
from cooploc.analysis.tuning.search import Competitor, Entrant, Finish, TrainingLane, trial_scores
from cooploc.estimators.interface import Array
from cooploc.estimators.plugins.labels import parse

VALUE = "value: "  # before a parameter's name: columns of `history`
SHOWN = ("rmse", "nll", "anees", "consistency", "coverage95", "failed")


class Tuned(NamedTuple):
    """One estimator's race and where it led."""

    competitor: Competitor
    finish: Finish

    @property
    def published(self) -> str:
        """Its label as the study has it."""
        return self.competitor.space.published.label

    @property
    def best(self) -> str:
        """The label of the configuration that won."""
        return self.finish.best.label


def history(tuned: Sequence[Tuned]) -> pd.DataFrame:
    """One row per configuration that was tried, in the order in which it entered.

    Columns: `estimator`, `number`, `label`; `state`, "finished", or "stopped" as hopeless; `rounds`; `trials` that it
    used; `spent`, those of its estimator until then; `score`, its mean over its rounds; `gain`, how much smaller that
    is than the published one's on the same rounds; `best`, whether it was the best until then; and "value: NAME" for
    every parameter.
    """
    return pd.DataFrame([_history_row(one, entrant) for one in tuned for entrant in one.finish.entrants])


def _history_row(one: Tuned, entrant: Entrant) -> dict[str, Any]:
    lanes, published = one.competitor.lanes, one.finish.entrants[0]
    score = entrant.mean(lanes, entrant.rounds)
    written = parse(entrant.label)[1]
    values = {f"{VALUE}{key}": written.get(key, each.default) for key, each in one.competitor.space.parameters.items()}
    return {
        "estimator": one.published,
        "number": entrant.number,
        "label": entrant.label,
        "state": entrant.state,
        "rounds": entrant.rounds,
        "trials": len(entrant.scores),
        "spent": entrant.spent,
        "score": score,
        "gain": published.mean(lanes, entrant.rounds) - score,
        "best": entrant.best,
        **values,
    }


def gains(rows: pd.DataFrame, tuned: Sequence[Tuned], objective: str) -> pd.DataFrame:
    """One row per scenario and estimator: as published and as tuned on the same fresh streams.

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
        tuned: the races.
        objective: what was made small.

    """
    of = {one.published: one for one in tuned}
    found = [
        _compare_pair(part[part["estimator"].isin({one.published, one.best})], str(scenario), one, objective)
        for scenario, part in rows.groupby("scenario", sort=False)
        for one in (of[name] for name in part["estimator"].unique() if name in of)
    ]
    table = pd.DataFrame(found)
    table["p_holm"] = statistics.holm(table["p"].to_numpy(float))
    for which in ("published", "tuned"):
        ranked = table[f"rmse_{which}"].where(table[f"failed_{which}"] == 0)
        table[f"rank_{which}"] = ranked.groupby(table["scenario"]).rank(method="min")
    return table.drop(columns="p")


def _compare_pair(rows: pd.DataFrame, scenario: str, one: Tuned, objective: str) -> dict[str, Any]:
    both = compare(rows, baseline=one.published, full=True)
    records = {row["estimator"]: row for row in both.to_dict("records")}
    before, after = records[one.published], records[one.best]
    known = {f"{name}_{which}": row[name] for name in SHOWN for which, row in (("published", before), ("tuned", after))}
    scores = {label: trial_scores(part, objective) for label, part in rows.groupby("estimator")}
    fresh = statistics.mean(np.asarray(scores[one.published] - scores[one.best], float))
    same = one.best == one.published
    return {
        "scenario": scenario,
        "estimator": one.published,
        "tuned": one.best,
        "trials": int(before["trials"]),
        **known,
        "score_published": scores[one.published].mean(),
        "score_tuned": scores[one.best].mean(),
        **{name: 0.0 if same else after[name] for name in ("change", "change_low", "change_high")},
        "p": np.nan if same else after["p"],
        "training_gain": _training_gain(one, scenario),
        "fresh_gain": fresh.value,
        "fresh_gain_low": fresh.low,
        "fresh_gain_high": fresh.high,
    }


def _training_gain(one: Tuned, scenario: str) -> float:
    own = {lane.judged: lane for lane in one.competitor.lanes if isinstance(lane, TrainingLane)}
    if scenario not in own:
        return float("nan")
    lane, finish = [own[scenario]], one.finish
    return finish.entrants[0].mean(lane, finish.rounds) - finish.best.mean(lane, finish.rounds)


# Does the order of estimators change when each is tuned? Every pair, on the same fresh streams, before and after.

SIGNIFICANCE = 0.05


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
            pairs = {which: _common_trials(values[one], values[other]) for which, (one, other) in sides.items()}
            found.append({"scenario": scenario, "a": a, "b": b, **_compare_sides(pairs, a, b, by)})
    table = pd.DataFrame(found, columns=["scenario", "a", "b", *_columns()])
    for which in ("published", "tuned"):
        adjusted = statistics.holm(table.pop(f"p_{which}").to_numpy(float))
        table[which] = table[f"smaller_{which}"].where(adjusted < SIGNIFICANCE, "")
    table["became"] = [_became(p, t) for p, t in zip(table["published"], table["tuned"], strict=True)]
    return table


def _columns() -> list[str]:
    return [f"{what}_{which}" for which in ("published", "tuned") for what in ("smaller", "p")]


def _values(rows: pd.DataFrame, by: str) -> "pd.Series[float] | None":
    """A value for each trial; None where one failed."""
    ended = drop_failed(rows)
    if len(ended) < len(rows):
        return None
    return weighted_means(rows, ["trial"], ["mse"])["mse"] if by == "rmse" else trial_scores(rows, by)


def _common_trials(one: "pd.Series[float]", other: "pd.Series[float]") -> tuple[Array, Array]:
    """The two's values in the trials of both."""
    joined = pd.concat([one, other], axis=1, join="inner").dropna().to_numpy(float)
    return joined[:, 0], joined[:, 1]


def _compare_sides(pairs: Mapping[str, tuple[Array, Array]], a: str, b: str, by: str) -> dict[str, object]:
    found: dict[str, object] = {}
    for which, (x, y) in pairs.items():
        enough = len(x) >= statistics.LEAST_TRIALS and not np.array_equal(x, y)
        found[f"smaller_{which}"] = "" if not len(x) or x.mean() == y.mean() else a if x.mean() < y.mean() else b
        found[f"p_{which}"] = _p_value(x, y, by) if enough else np.nan
    return found


def _p_value(x: Array, y: Array, by: str) -> float:
    """p against equal RMSE, by Fieller's interval; against equal mean scores, which may be negative, by the t test."""
    return statistics.p_of_difference(x, y) if by == "rmse" else statistics.p_of_mean(statistics.mean(y - x), len(x), 0)


def _became(published: str, tuned: str) -> str:
    if published and tuned:
        return "kept" if published == tuned else "reversed"
    return "vanished" if published else "appeared" if tuned else "open"
