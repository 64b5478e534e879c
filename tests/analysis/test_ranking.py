"""Who may be called best, groups by Friedman and Nemenyi, and the fronts of accuracy and cost."""

import numpy as np
import pandas as pd
import pytest
from test_compare import BASE, rows

import cooploc as cl
from cooploc.analysis.metrics.ranking import front, ranking

RNG = np.random.default_rng(1)


def near(name, factor, **more):
    return rows(name, factor * BASE * RNG.lognormal(0, 0.1, BASE.shape), **more)


def ranked(*frames):
    return ranking(pd.concat(frames)).set_index("estimator")


def test_the_smallest_error_comes_first_and_is_best():
    table = ranked(near("a", 1.0), near("b", 0.3), near("c", 4.0))
    assert list(table.index) == ["b", "a", "c"]
    assert table["rank"].tolist() == [1, 2, 3]
    assert table["best"].tolist() == [True, False, False]
    assert not set(table.loc["b", "group"]) & set(table.loc["c", "group"])


def test_an_over_confident_estimator_a_bound_and_one_that_fails_are_not_best():
    failing = near("f", 0.1).assign(failure=None)
    failing.loc[failing["trial"] == 2, "failure"] = "boom"
    table = ranked(failing, near("o", 0.2, anees=9.0), near("u", 0.15).assign(bound=True), near("a", 1.0))
    assert table.index[table["best"]].tolist() == ["a"]
    assert table.loc["o", "consistency"] == "over-confident"
    assert table.loc["u", "front"] == ""


def test_what_cannot_be_told_apart_shares_a_letter():
    table = ranked(near("a", 1.0), near("b", 1.0), near("c", 30.0))
    assert set(table.loc["a", "group"]) & set(table.loc["b", "group"])
    assert table["near_best"].tolist() == [True, True, False]
    assert ranked(near("a", 1.0), near("b", 1.0))["group"].tolist() == ["a", "a"]
    assert ranked(near("a", 1.0), near("b", 9.0))["group"].tolist() == ["a", "b"]


def test_estimators_without_a_difference_keep_one_letter_in_95_percent_of_families():
    rng = np.random.default_rng(3)
    split = []
    for _ in range(100):
        hard = rng.lognormal(0, 0.5, (12, 1))
        table = ranking(pd.concat([rows(name, hard * rng.lognormal(0, 0.3, (12, 1))) for name in "abcd"]))
        split.append(table["group"].nunique() > 1)
    assert np.mean(split) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 100)


def test_nobody_is_best_below_five_trials():
    table = ranked(*(frame[frame["trial"] < 4] for frame in (near("a", 1.0), near("b", 0.3), near("c", 4.0))))
    assert not table["best"].any()
    assert set(table["group"]) == {""}


def test_ranks_of_different_streams_are_refused():
    with pytest.raises(cl.BadInput, match="different streams"):
        ranking(pd.concat([rows("a", BASE), rows("b", BASE, stream="other")]))


def test_the_front_is_what_nothing_beats_in_both():
    error = np.array([3.0, 2.0, 2.5, 1.0, 1.0, 0.5])
    cost = np.array([1.0, 2.0, 3.0, 4.0, 4.0, np.nan])
    assert front(error, cost).tolist() == [True, True, False, True, True, False]
