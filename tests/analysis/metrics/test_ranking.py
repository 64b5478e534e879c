"""Which estimators qualify as best, groups of those that do not differ, and the fronts of accuracy and cost."""

import numpy as np
import pandas as pd
import pytest

from cooploc.analysis.metrics.ranking import disqualifications, letters, pareto_front, rank_groups
from cooploc.analysis.metrics.sequential import ANYTIME, FIXED, looks

HARD = np.random.default_rng(1).lognormal(0, 0.4, 12)
GOOD = {"certificate": "", "centralised": False, "bound": False, "consistency": "consistent", "anees": 1.0, "failed": 0}


def errors(**factors):
    """Squared errors (trial, estimator) around the factors; what is hard in a trial is hard for all."""
    rng = np.random.default_rng(2)
    return pd.DataFrame({name: f * HARD * rng.lognormal(0, 0.1, HARD.shape) for name, f in factors.items()})


@pytest.mark.parametrize(
    ("change", "reasons"),
    [
        ({}, []),
        ({"certificate": "passed: 16 checks"}, []),
        ({"consistency": "conservative", "anees": 0.1}, []),
        ({"consistency": "not shown", "anees": 2.9}, []),
        ({"consistency": "not shown", "anees": 3.1}, ["probably over-confident"]),
        ({"consistency": "over-confident", "anees": 2.0}, ["over-confident"]),
        ({"consistency": "over-wide", "anees": 0.001}, ["over-wide"]),
        ({"consistency": "not assessed"}, ["consistency not assessed"]),
        ({"certificate": "failed: causality: it peeks"}, ["failed the check causality"]),
        ({"centralised": True, "bound": True, "failed": 1}, ["a bound", "1 trial failed"]),
        ({"centralised": True}, ["centralised"]),
    ],
)
def test_an_estimator_qualifies_as_best_unless_there_is_a_reason(change, reasons):
    assert disqualifications(GOOD | change) == reasons


def test_ranks_are_means_over_trials():
    ranks, letters = rank_groups(errors(a=1.0, b=0.3, c=4.0))
    assert ranks == {"a": 2, "b": 1, "c": 3}
    assert not set(letters["b"]) & set(letters["c"])


def test_estimators_that_do_not_differ_share_a_letter():
    letters = rank_groups(errors(a=1.0, b=1.0, c=30.0))[1]
    assert set(letters["a"]) & set(letters["b"])
    assert not set(letters["a"]) & set(letters["c"])
    assert rank_groups(errors(a=1.0, b=1.0))[1] == {"a": "a", "b": "a"}
    assert rank_groups(errors(a=1.0, b=9.0))[1] == {"a": "a", "b": "b"}


def test_estimators_without_a_difference_keep_one_letter_in_95_percent_of_families():
    rng = np.random.default_rng(3)
    split = []
    for _ in range(100):
        mse = rng.lognormal(0, 0.5, (12, 1)) * rng.lognormal(0, 0.3, (12, 4))
        split.append(len(set(rank_groups(pd.DataFrame(mse, columns=list("abcd")))[1].values())) > 1)
    assert np.mean(split) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 100)


def test_below_five_trials_there_are_ranks_and_no_letters():
    ranks, letters = rank_groups(errors(a=1.0, b=0.3, c=4.0).iloc[:4])
    assert ranks == {"a": 2, "b": 1, "c": 3}
    assert letters == {}


def test_equals_are_ever_given_two_letters_at_five_looks_in_at_most_5_percent_of_runs_until_decided():
    rng = np.random.default_rng(4)
    ever = {FIXED: 0, ANYTIME: 0}
    for _ in range(200):
        mse = pd.DataFrame(rng.lognormal(0, 0.3, (160, 2)), columns=["a", "b"])
        for stopping in ever:
            ever[stopping] += any(len(set(letters(mse[:n], stopping).values())) > 1 for n in looks(160))
    assert ever[ANYTIME] < 10 < ever[FIXED]


def test_letters_of_a_run_until_decided_take_the_trials_that_two_have_and_there_are_no_ranks():
    mse = errors(a=1.0, b=0.3, c=4.0)
    mse.loc[4:, "c"] = np.nan
    ranks, found = rank_groups(mse, ANYTIME)
    assert ranks == {}
    assert not set(found["a"]) & set(found["b"])
    assert set(found["c"]) == set(found["a"]) | set(found["b"])


def test_the_front_is_what_nothing_beats_in_both():
    error = np.array([3.0, 2.0, 2.5, 1.0, 1.0, 0.5])
    cost = np.array([1.0, 2.0, 3.0, 4.0, 4.0, np.nan])
    assert pareto_front(error, cost).tolist() == [True, True, False, True, True, False]
