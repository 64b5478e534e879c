"""Sentences and figures of a tuning say what its numbers say."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from cooploc.analysis.plot import tuned_parameters, tuning
from cooploc.analysis.report.tuning_tables import extremes_sentence, gain_sentence, scenario_sentences, side_by_side
from cooploc.estimators.errors import BadInput

NAMES = "a", "b", "c"


@pytest.fixture
def gains():
    """Three estimators in two worlds; tuning takes `c` from the last place to the first."""
    rows = [
        {"scenario": scenario, "estimator": name, "tuned": name if name == "a" else f"{name}[k=1]", "trials": 9,
         "rmse_published": published, "rmse_tuned": tuned, "score_published": 1.0, "score_tuned": 0.5,
         "change": tuned / published - 1, "change_low": -0.9, "change_high": 0.9, "p_holm": 0.01,
         "anees_published": 1.0, "anees_tuned": 1.0, "training_gain": 0.8, "fresh_gain": 0.5 * (name == "c"),
         "fresh_gain_low": 0.1, "fresh_gain_high": 0.9, "rank_published": 1, "rank_tuned": 1,
         "failed_published": 0, "failed_tuned": 0}
        for scenario in ("one", "two")
        for name, published, tuned in (("a", 1.0, 1.0), ("b", 2.0, 1.9), ("c", 4.0, 0.5))
    ]  # fmt: skip
    return pd.DataFrame(rows)


@pytest.fixture
def history():
    gate, mode = [9.0, 3.0, 30.0, 2000.0], ["x", "y", "x", "x"]
    return pd.DataFrame(
        {
            "estimator": "a",
            "state": ["finished", "finished", "stopped", "stopped"],
            "spent": [10, 20, 24, 28],
            "gain": [0.0, 1.0, -1.0, -2.0],
            "best": [True, True, False, False],
            "value: gate": gate,
            "value: mode": mode,
            "value: absent": np.nan,
        }
    )


def test_side_by_side_both_halves_are_sorted_and_moves_are_counted(gains):
    table = side_by_side(gains)
    assert [row["estimator_published"] for row in table.rows] == ["a", "b", "c"]
    assert [row["estimator_tuned"] for row in table.rows] == ["c", "a", "b"]
    assert [row["moved"] for row in table.rows] == ["up 2", "down 1", "down 1"]


def test_sentences_name_what_was_gained_and_what_was_over_fitted(gains):
    assert "moved 2 of 3 estimators" in gain_sentence(gains)
    assert "fell by 0.80 on the training streams and by 0.25 on fresh ones" in gain_sentence(gains)
    assert extremes_sentence(gains).startswith("The largest gains on fresh streams: `c` in `one` (+0.50")
    assert "tuned it is `c`" in scenario_sentences(gains)[0]
    assert "No estimator was moved" in gain_sentence(gains[gains["estimator"] == "a"])


def test_the_figure_of_the_budget_ends_where_the_budget_does(history):
    ax = tuning(history)
    step = ax.lines[0]
    assert list(step.get_xdata()) == [10, 20, 28]
    assert list(step.get_ydata()) == [0.0, 1.0, 1.0]
    plt.close("all")


def test_the_figure_of_parameters_has_a_panel_for_each_and_refuses_what_has_none(history):
    shown = [ax.get_xlabel() for ax in tuned_parameters(history, "a").figure.axes if ax.get_visible()]
    assert shown == ["gate", "mode"]
    plt.close("all")
    with pytest.raises(BadInput, match="there is no estimator"):
        tuned_parameters(history, "z")
    with pytest.raises(BadInput, match="no parameter that may be tuned"):
        tuned_parameters(history.drop(columns=["value: gate", "value: mode"]), "a")
