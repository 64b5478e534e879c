"""Tables of a tuning: every configuration that was tried, and every estimator as published and tuned, paired."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.tuning.objective import trial_scores
from cooploc.analysis.tuning.race import Entrant, Finish
from cooploc.analysis.tuning.search import Competitor
from cooploc.analysis.tuning.training import TrainingLane
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
    return pd.DataFrame([_tried(one, entrant) for one in tuned for entrant in one.finish.entrants])


def _tried(one: Tuned, entrant: Entrant) -> dict[str, Any]:
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
        _paired(part[part["estimator"].isin({one.published, one.best})], str(scenario), one, objective)
        for scenario, part in rows.groupby("scenario", sort=False)
        for one in (of[name] for name in part["estimator"].unique() if name in of)
    ]
    table = pd.DataFrame(found)
    table["p_holm"] = statistics.holm(table["p"].to_numpy(float))
    for which in ("published", "tuned"):
        ranked = table[f"rmse_{which}"].where(table[f"failed_{which}"] == 0)
        table[f"rank_{which}"] = ranked.groupby(table["scenario"]).rank(method="min")
    return table.drop(columns="p")


def _paired(rows: pd.DataFrame, scenario: str, one: Tuned, objective: str) -> dict[str, Any]:
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
