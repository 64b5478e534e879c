"""Tables, sentences and figures of a tuning say what its numbers say."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

import cooploc as cl
from cooploc.analysis.plot import tuned_parameters, tuning
from cooploc.analysis.report.tuning_sentences import bought, by_scenario, most_moved
from cooploc.analysis.report.tuning_tables import gains_table, order_sentence, side_by_side
from cooploc.analysis.tuning.tables import order
from cooploc.analysis.tuning.tune import as_toml, tuned_study
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.studies.study import Study, load

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


def errors(values):
    """Rows of trials with these squared errors, by the estimator's label."""
    frames = [
        pd.DataFrame({"scenario": "s", "estimator": name, "trial": range(len(mse)), "robot": 0, "ticks": 5, "mse": mse,
                      "nll": 0.0, "failure": None})
        for name, mse in values.items()
    ]  # fmt: skip
    return pd.concat(frames, ignore_index=True)


def test_an_order_that_tuning_reverses_is_called_reversed_and_one_that_it_hides_vanishes(rng):
    hard = rng.uniform(0.9, 1.1, 30)

    def near(level):
        return level * hard * rng.uniform(0.97, 1.03, 30)

    rows = errors({"a": near(1), "b": near(2), "c": near(4), "a[t=1]": near(3), "b[t=1]": near(2), "c[t=1]": near(3)})
    table = order(rows, {name: f"{name}[t=1]" for name in NAMES}).set_index(["a", "b"])
    assert table.loc[("a", "b"), "became"] == "reversed"
    assert table.loc[("b", "c"), "became"] == "kept"
    assert table.loc[("a", "c"), "published"] == "a"
    assert "1 of 3 pairs" in order_sentence(table, "RMSE")


def test_equals_are_in_no_order():
    rows = errors({name: np.linspace(1, 2, 10) for name in ("a", "b")})
    table = order(rows, {"a": "a", "b": "b"})
    assert table["became"].tolist() == ["open"]
    assert table["smaller_tuned"].tolist() == [""]


def test_an_estimator_of_which_a_trial_failed_is_in_no_order():
    rows = errors({name: np.linspace(1, 2, 10) for name in ("a", "b")})
    rows.loc[0, "failure"] = "it raised"
    assert order(rows, {"a": "a", "b": "b"}).empty


def test_side_by_side_both_halves_are_sorted_and_moves_are_counted(gains):
    table = side_by_side(gains)
    assert [row["estimator_published"] for row in table.rows] == ["a", "b", "c"]
    assert [row["estimator_tuned"] for row in table.rows] == ["c", "a", "b"]
    assert [row["moved"] for row in table.rows] == ["up 2", "down 1", "down 1"]


def test_sentences_name_what_was_gained_and_what_was_over_fitted(gains):
    assert "moved 2 of 3 estimators" in bought(gains)
    assert "fell by 0.80 on the training streams and by 0.25 on fresh ones" in bought(gains)
    assert most_moved(gains).startswith("The largest gains on fresh streams: `c` in `one` (+0.50")
    assert "tuned it is `c`" in by_scenario(gains)[0]
    assert "No estimator was moved" in bought(gains[gains["estimator"] == "a"])


def test_training_gain_and_fresh_gain_stand_side_by_side(gains):
    heads = [column.head for column in gains_table("one", gains[gains["scenario"] == "one"]).columns]
    assert heads.index("fresh gain") == heads.index("training gain") + 1


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


def test_a_tuned_study_is_written_and_read_back_as_it_is(tmp_path):
    study = Study(
        name="mine", about='what "it" asks', scenarios=("nlos", "trajectory"), estimators=("arl", "ekf-local"),
        training={"nlos": ("trajectory",)},
    )  # fmt: skip
    tuned = tuned_study(study, study.cells(), {"arl": "arl[K=2]", "ekf-local": "ekf-local"}, 99, both=False)
    file = tmp_path / "tuned.toml"
    file.write_text(as_toml(tuned), encoding="utf-8")
    again = load(str(file))
    assert again.cells() == tuned.cells()
    assert again.about == study.about
    assert (again.tuned_with, again.training) == (99, study.training)
    both = tuned_study(study, study.cells(), {"arl": "arl[K=2]", "ekf-local": "ekf-local"}, 99, both=True)
    assert {cell.estimators for cell in both.cells()} == {("arl", "arl[K=2]", "ekf-local")}


def test_what_is_no_tuning_cannot_be_loaded(tmp_path):
    with pytest.raises(cl.BadInput, match="no finished tuning"):
        cl.load_tuned(tmp_path)
