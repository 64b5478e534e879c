"""Comparisons at looks: decided by trials of the lowest numbers, never in favour of one that failed."""

import numpy as np
import pandas as pd
import pytest
from made_runs import rows_of

from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.sequential import decide, looks, with_decisions


def made(base, **others):
    """Rows of one scenario from mean squared errors by trial; nan: failed."""
    named = {"base": base, **others}
    rows = rows_of("s", dict.fromkeys(named, (1.0, 1.0)), trials=len(base))
    rows["mse"] = np.concatenate(list(named.values()))
    rows.loc[rows["mse"].isna(), "failure"] = "RuntimeError: lost"
    return rows


def found(rows, most=1000):
    return {one.estimator: one for one in decide(rows, {"s": "base"}, {"s": most})}


@pytest.fixture
def noise():
    return np.exp(np.random.default_rng(11).normal(0, 0.3, (6, 80)))


def test_looks_double_and_end_at_the_last():
    assert looks(1000) == [10, 20, 40, 80, 160, 320, 640, 1000]
    assert looks(10) == [10]
    assert looks(7) == [7]


def test_a_clear_difference_is_decided_at_the_first_look_and_equals_are_not(noise):
    one = found(made(noise[0], half=noise[1] / 4, twice=noise[2] * 4, same=noise[3]))
    assert (one["half"].verdict, one["half"].look) == ("better", 10)
    assert (one["twice"].verdict, one["twice"].look) == ("worse", 10)
    assert (one["same"].verdict, one["same"].look) == ("open", 80)


def test_what_lies_within_the_margin_is_a_tie(noise):
    one = found(made(noise[0], near=noise[0] * (1 + 0.01 * (noise[1] - noise[1].mean()))))["near"]
    assert one.verdict == "tie"
    assert -0.05 < one.low <= 0 <= one.high < 0.05


def test_a_look_sees_the_trials_below_its_number_whatever_the_order_of_the_rows(noise):
    rows = made(noise[0], other=noise[1] * 0.8)
    early, later = rows[rows["trial"] < 40], rows.sample(frac=1, random_state=1)
    first, last = found(early)["other"], found(later)["other"]
    assert first == last if first.verdict != "open" else last.look > first.look


def test_a_look_waits_for_its_trials(noise):
    rows = made(noise[0], other=noise[1] * 4)
    assert found(rows[rows["trial"] != 5])["other"].verdict == "open"
    assert found(rows[rows["trial"] < 9])["other"].look == 0


def test_none_gains_by_failing_and_one_that_fails_can_still_be_worse(noise):
    better, worse = noise[1] / 4, noise[2] * 4
    better[3] = worse[3] = np.nan
    one = found(made(noise[0], better=better, worse=worse))
    assert one["better"].verdict == "failed"
    assert one["worse"].verdict == "worse"


def test_the_table_has_p_values_that_hold_at_any_stopping(noise):
    rows = made(noise[0], half=noise[1] / 4, same=noise[2])
    table = compare(rows, "base", full=True)
    decided = with_decisions(table, pd.DataFrame(decide(rows, {"s": "base"}, {"s": 80})))
    p = dict(zip(decided["estimator"], decided["p"], strict=True))
    assert p["half"] < 0.05 < p["same"]
    assert p["half"] > dict(zip(table["estimator"], table["p"], strict=True))["half"]
    assert list(decided["verdict"]) == ["", "better", "open"]
