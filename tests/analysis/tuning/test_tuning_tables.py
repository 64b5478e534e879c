"""Sentences and figures of a tuning say what its numbers say."""

import numpy as np
import pandas as pd
import pytest

from cooploc.analysis.plot import tuned_parameters, tuning
from cooploc.analysis.report.tuning_tables import extremes_sentence, gain_sentence, scenario_sentences, side_by_side
from cooploc.estimators.errors import BadInput

SAME = {"trials": 9, "change_low": -0.9, "change_high": 0.9, "p_holm": 0.01, "training_gain": 0.8}
SAME |= {"fresh_gain_low": 0.1, "fresh_gain_high": 0.9}
SAME |= {f"{name}_{when}": 1.0 for name in ("score", "anees", "rank") for when in ("published", "tuned")}
SAME |= {"failed_published": 0, "failed_tuned": 0}
GAINS = pd.DataFrame(  # tuning takes `c` from the last place to the first
    {**SAME, "scenario": scenario, "estimator": name, "tuned": name if name == "a" else f"{name}[k=1]",
     "rmse_published": before, "rmse_tuned": after, "change": after / before - 1, "fresh_gain": 0.5 * (name == "c")}
    for scenario in ("one", "two")
    for name, before, after in (("a", 1.0, 1.0), ("b", 2.0, 1.9), ("c", 4.0, 0.5))
)  # fmt: skip
HISTORY = pd.DataFrame(
    {
        "estimator": "a",
        "state": ["finished", "finished", "stopped", "stopped"],
        "spent": [10, 20, 24, 28],
        "gain": [0.0, 1.0, -1.0, -2.0],
        "best": [True, True, False, False],
        "value: gate": [9.0, 3.0, 30.0, 2000.0],
        "value: mode": ["x", "y", "x", "x"],
        "value: absent": np.nan,
    }
)


def test_side_by_side_both_halves_are_sorted_and_moves_are_counted():
    rows = side_by_side(GAINS).rows
    assert [row["estimator_published"] for row in rows] == ["a", "b", "c"]
    assert [(row["estimator_tuned"], row["moved"]) for row in rows] == [("c", "up 2"), ("a", "down 1"), ("b", "down 1")]


def test_sentences_name_what_was_gained_and_what_was_over_fitted():
    assert "moved 2 of 3 estimators" in gain_sentence(GAINS)
    assert "fell by 0.80 on the training streams and by 0.25 on fresh ones" in gain_sentence(GAINS)
    assert extremes_sentence(GAINS).startswith("The largest gains on fresh streams: `c` in `one` (+0.50")
    assert "tuned it is `c`" in scenario_sentences(GAINS)[0]
    assert "No estimator was moved" in gain_sentence(GAINS[GAINS["estimator"] == "a"])


def test_the_figure_of_the_budget_ends_where_the_budget_does():
    step = tuning(HISTORY).lines[0]
    assert (list(step.get_xdata()), list(step.get_ydata())) == ([10, 20, 28], [0.0, 1.0, 1.0])


def test_the_figure_of_parameters_has_a_panel_for_each_and_refuses_what_has_none():
    shown = [ax.get_xlabel() for ax in tuned_parameters(HISTORY, "a").figure.axes if ax.get_visible()]
    assert shown == ["gate", "mode"]
    with pytest.raises(BadInput, match="there is no estimator"):
        tuned_parameters(HISTORY, "z")
    with pytest.raises(BadInput, match="no parameter that may be tuned"):
        tuned_parameters(HISTORY.drop(columns=["value: gate", "value: mode"]), "a")
