"""Sentences of a report say no more than the numbers do: who is best, who is over-confident, what readings buy."""

import numpy as np
import pandas as pd
import pytest
from made_runs import rows_of

from cooploc.analysis.claims.trial_table import collect
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.run_tables import INFORMATION_COLUMNS
from cooploc.analysis.report import sentences
from cooploc.analysis.report.sentences import cooperation_sentences, dependence_sentences, effect_of_reading

A = {"a": (1.0, 1.0)}


def standings(rows):
    table = compare(rows, rows["estimator"].iloc[0], full=True)
    return sentences.standings(table, collect(rows)), table


def standing(rows):
    ((found,), _) = standings(rows)
    return found, sentences.summary_sentence(found)


def made(names, **options):
    return rows_of("nlos", names, **options)


def noisy(names, seed=1, trials=12):
    rows = made(names, trials=trials)
    return rows.assign(mse=rows["mse"] * np.random.default_rng(seed).lognormal(0, 0.5, len(rows)))


@pytest.mark.parametrize(
    ("rows", "barred"),
    [
        (made(A | {"b": (0.1, 9.0)}), "b (over-confident, ANEES "),
        (made(A | {"b": (0.1, 0.001)}), "b (over-wide, ANEES 0.00)"),
        (made(A | {"b": (0.1, 1.0)}, bounds=("b",)), "b (a bound)"),
        (made(A | {"b": (0.1, 1.0)}, failed=("b",)), "b (1 trial failed)"),
    ],
)
def test_an_estimator_that_does_not_qualify_is_never_called_best(rows, barred):
    found, text = standing(rows)
    assert found.best == "a"
    assert found.barred[0].startswith(barred)
    assert "is best" not in text


def test_an_estimator_that_may_be_over_confident_is_not_called_best():
    rows = made(A | {"wild": (0.1, 1.0)})
    rows.loc[(rows["estimator"] == "wild") & (rows["trial"] == 0), "anees"] = 1e9  # a heavy tail: an interval from ~0
    found, _ = standing(rows)
    assert found.best == "a"
    assert found.barred[0].startswith("wild (probably over-confident, ANEES 1")
    slightly = rows.assign(anees=rows["anees"].clip(upper=8.0))  # 1.9 on average
    assert "leaves open whether it is over-confident" in standing(slightly)[1]


def test_a_tie_is_said_as_a_tie_and_a_difference_as_one():
    found, text = standing(noisy(A | {"b": (1.0, 1.0)}))
    assert {found.best, *found.tied} == {"a", "b"}
    assert text.startswith("A tie: ")
    found, text = standing(made(A | {"b": (0.5, 1.0)}, trials=12))
    assert found.lead.high < 0
    assert text.startswith("b is best: RMSE 0.")
    assert "below that of the next that qualifies, a." in text
    same = made(A | {"b": (1.0, 1.0)}, trials=12)
    assert standing(same.assign(mse=np.tile(same["mse"][:12], 2)))[0].equal == ("b",)


def test_below_five_trials_nothing_is_claimed():
    found, text = standing(made(A | {"b": (0.1, 1.0)}, trials=4))
    assert (found.best, text[:22]) == ("", "Not assessed: 4 trials")
    assert standing(made(A))[1] == "No estimator qualifies: there is nothing to compare."
    few = sentences.lowest_errors(*standings(made(A | {"b": (0.1, 1.0)}, trials=3)))
    assert few.startswith("Nothing is separable with 3 trials")


def test_the_answer_says_who_is_lowest_by_how_much_and_who_is_over_confident():
    ones = {"arl": (1.0, 1.0), "ekf-local": (0.5, 1.0), "mrsl-rssi": (0.7, 9.0)}
    found, table = standings(pd.concat([rows_of(f"packet-drop/drop={d}", ones) for d in (0, 0.5)], ignore_index=True))
    text = sentences.lowest_errors(found, table)
    assert text.startswith("ekf-local has the lowest RMSE of those that qualify in all 2 scenarios, at least ")
    assert "below that of the next (arl, packet-drop/drop=0" in text
    over = sentences.over_confident_estimators(table)
    assert over.startswith("Over-confident: mrsl-rssi in 2 of 2 scenarios; the largest ANEES of a median trial is ")
    found, table = standings(noisy({f"e{i}": (1.0, 1.0) for i in range(9)}, seed=5, trials=8))
    text = sentences.lowest_errors(found, table)
    assert "; no significant difference: " in text
    assert text.endswith("others.")
    assert sentences.over_confident_estimators(table) == "No estimator was found over-confident."


INFORMATION = (
    # own, between, robots, fusion, filter, rmse, floor, anees, consistency, change, change_low, change_high
    ("doa", "none", 1, "alone", "particles", 0.25, 0.2, 1.0, "consistent", None, None, None),
    ("doa", "none", 3, "alone", "particles", 0.25, 0.2, 1.0, "consistent", None, None, None),
    ("doa", "none", 3, "alone", "Kalman", 0.30, 0.2, 1.0, "consistent", None, None, None),
    ("doa", "rssi", 3, "product", "particles", 0.20, 0.15, 4.0, "over-confident", -0.2, -0.25, -0.15),
    ("doa", "range", 3, "product", "particles", 0.27, 0.1, 9.5, "over-confident", 0.08, 0.02, 0.15),
    ("doa", "rssi", 3, "intersection", "Kalman", 0.29, 0.15, 1.0, "consistent", -0.03, -0.1, 0.04),
    ("none", "range", 3, "intersection", "Kalman", 0.29, float("nan"), 1.0, "consistent", 0.0, 0.0, 0.0),
)


def test_every_row_of_a_team_is_said_with_its_numbers():
    names = [*("own", "between", "robots", "fusion", "filter", "rmse", "floor", "anees", "consistency")]
    frame = pd.DataFrame(INFORMATION, columns=[*names, "change", "change_low", "change_high"]).assign(trials=40)
    ((head, texts), (_, nothing)) = cooperation_sentences(frame.reindex(columns=list(INFORMATION_COLUMNS)))
    assert head == "3 robots with the direction of arrival"
    assert texts == [
        "Alone they err by 0.250 m with particles and 0.300 m with a Kalman filter. "
        "The floor, 0.200 m alone, changes by -25 % by RSSI and -50 % by ranges.",
        "The product of beliefs takes 20 % off the error by RSSI (-25 % to -15 %) and adds 8.0 % to the error by "
        "ranges (+2.0 % to +15 %), but is over-confident (RSSI: ANEES 4.00 and ranges: ANEES 9.50).",
        "Covariance intersection of Kalman filters makes no difference that 40 trials show by RSSI (-10 % to +4.0 %).",
    ]
    assert nothing == [
        "None of them was run alone.",
        "Covariance intersection of Kalman filters leaves the error as it is by ranges.",
    ]
    few = {"change": -0.5, "change_low": float("nan"), "change_high": float("nan"), "between": "rssi", "trials": 3}
    assert effect_of_reading(few) == "changes the error by -50 % by RSSI (no interval)"


ERRORS = {"arl": (0.2, 0.4), "better": (0.1, 0.15), "mixed": (0.1, 0.9), "worse": (0.5, 0.6), "same": (0.2, 0.41)}
CHANGES = {"arl": (0, 0), "better": (-0.5, -0.6), "mixed": (-0.5, 1.2), "worse": (1.5, 0.5), "same": (0, 0.02)}


def sensitivity(*names):
    """Return made rows of two values; intervals of changes are 0.1 wide to either side."""
    rows = [("ticks", name, v, ERRORS[name][k], CHANGES[name][k]) for name in names for k, v in enumerate((10.0, 20.0))]
    table = pd.DataFrame(rows, columns=["parameter", "estimator", "value", "rmse", "change"])
    rmse, shift = table["rmse"], table["change"]
    return table.assign(rmse_low=rmse - 0.01, rmse_high=rmse + 0.01, change_low=shift - 0.1, change_high=shift + 0.1)


def test_every_outcome_of_a_swept_parameter_is_said():
    assert dependence_sentences(sensitivity(*ERRORS)) == [
        (
            "ticks",
            "mixed depends on it most, with 0.100 m (0.090 to 0.110) at 10 and 0.900 m (0.890 to 0.910) at 20; "
            "worse least, with 0.500 m (0.490 to 0.510) at 10 and 0.600 m (0.590 to 0.610) at 20. "
            "By paired intervals, better beats arl at 2 and loses to it at 0 of 2 values; "
            "mixed beats arl at 1 and loses to it at 1 of 2 values; "
            "worse beats arl at 0 and loses to it at 2 of 2 values; "
            "same beats arl at 0 and loses to it at 0 of 2 values.",
        )
    ]
    assert dependence_sentences(sensitivity("arl"))[0][1] == "Fewer than two estimators were run. Only arl was run."
    table = sensitivity("arl", "better").assign(**dict.fromkeys(("change_low", "change_high", "rmse_low"), np.nan))
    ((_, text),) = dependence_sentences(table)
    assert "better beats arl at 0 and loses to it at 0" in text
    assert "0.100 m at 10" in text
