"""Sentences of a report say no more than the numbers do: who is best, and who is over-confident."""

import re

import numpy as np
import pandas as pd
import pytest
from made_runs import rows_of

from cooploc.analysis.claims.trial_table import collect
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.report import sentences

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
    few = sentences.best_honest(*standings(made(A | {"b": (0.1, 1.0)}, trials=3)))
    assert few.startswith("Nothing is separable with 3 trials")


@pytest.mark.slow
def test_the_answer_says_who_is_lowest_by_how_much_and_who_is_over_confident():
    ones = {"arl": (1.0, 1.0), "ekf-local": (0.5, 1.0), "mrsl-rssi": (0.7, 9.0)}
    found, table = standings(pd.concat([rows_of(f"packet-drop/drop={d}", ones) for d in (0, 0.5)], ignore_index=True))
    text = sentences.best_honest(found, table)
    assert text.startswith("Best honest estimator: ekf-local, in both scenarios (0.")
    assert " m, at least " in text
    assert text.endswith(" below arl).")
    over = sentences.over_confident_estimators(table)
    assert over.startswith("Over-confident: mrsl-rssi in 2 scenarios; the squared errors of mrsl-rssi are ")
    found, table = standings(noisy({f"e{i}": (1.0, 1.0) for i in range(9)}, seed=5, trials=8))
    text = sentences.best_honest(found, table)
    assert "; no significant difference: " in text
    assert text.endswith("others.")
    assert sentences.over_confident_estimators(table) == "No estimator was found over-confident."
    both = [noisy({"a": (1.0, 1.0), "b": (1.0, 1.0)}), made({"a": (0.5, 1.0), "b": (1.0, 1.0)}, trials=12)]
    labels = ("packet-drop/drop=0", "packet-drop/drop=0.5")
    rows = pd.concat([one.assign(scenario=s) for one, s in zip(both, labels, strict=True)], ignore_index=True)
    text = sentences.best_honest(*standings(rows))
    assert re.fullmatch(r"Best honest estimator: a, in one of two scenarios \(.*\); in one it ties with b\.", text)
    rows = pd.concat([both[0].assign(scenario=s) for s in labels], ignore_index=True)
    text = sentences.best_honest(*standings(rows))
    assert text == "No honest estimator stands out: in both b and a tie."
