"""Intervals and tests: closed forms, and coverage and false-positive rates by simulation."""

import numpy as np
import pytest
from scipy import stats

from cooploc.analysis.statistics import holm, improvement, mean_difference, mean_of_positive, signed_rank

REPEATS = 1500
# Binomial standard error of a coverage near 0.95 over REPEATS: 0.0056.


def covered(intervals, truth):
    return np.mean([low <= truth <= high for _, low, high in intervals])


@pytest.mark.parametrize("trials", [10, 30])
@pytest.mark.parametrize("spread", [0.3, 0.8])
def test_interval_of_a_positive_mean_covers(trials, spread):
    rng = np.random.default_rng(1)
    intervals = [mean_of_positive(rng.lognormal(0, spread, trials)) for _ in range(REPEATS)]
    coverage = covered(intervals, np.exp(spread**2 / 2))
    assert 0.89 < coverage < 0.97


def test_interval_of_a_positive_mean_beats_the_t_interval_on_skewed_values():
    rng = np.random.default_rng(2)
    values = rng.lognormal(0, 1.0, (REPEATS, 10))
    half = stats.t.ppf(0.975, 9) * values.std(1, ddof=1) / np.sqrt(10)
    plain = np.mean(np.abs(values.mean(1) - np.exp(0.5)) <= half)
    assert covered([mean_of_positive(v) for v in values], np.exp(0.5)) > plain + 0.03


@pytest.mark.parametrize("trials", [10, 30, 100])
def test_fieller_covers_the_true_improvement(trials):
    rng = np.random.default_rng(3)
    intervals = []
    for _ in range(REPEATS):
        shared = rng.lognormal(0, 0.4, trials)  # hard trials are hard for both
        a, b = shared * rng.lognormal(0, 0.3, trials), 0.5 * shared * rng.lognormal(0, 0.3, trials)
        intervals.append(improvement(a, b))
    assert 0.92 < covered(intervals, 1 - np.sqrt(0.5)) < 0.985


def test_fieller_equals_the_t_test_at_its_ends():
    """At either end of the interval, the mean of b - r a is just significantly different from 0."""
    rng = np.random.default_rng(4)
    a, b = rng.lognormal(0, 0.3, 25), rng.lognormal(-0.5, 0.3, 25)
    _, low, high = improvement(a, b)
    for end in (low, high):
        assert stats.ttest_1samp(b - (1 - end) ** 2 * a, 0).pvalue == pytest.approx(0.05, abs=1e-9)


def test_fieller_says_nothing_where_the_baseline_may_be_zero():
    rng = np.random.default_rng(5)
    a = np.array([1e-6, 1e-6, 1e-6, 1e-6, 1e3])
    assert np.isnan(improvement(a, rng.lognormal(0, 1, 5)).low)


def test_mean_difference_is_scipys_paired_t_interval():
    rng = np.random.default_rng(6)
    a, b = rng.normal(1, 1, 12), rng.normal(1.5, 1, 12)
    interval = stats.ttest_rel(b, a).confidence_interval(0.95)
    assert mean_difference(a, b)[1:] == pytest.approx((interval.low, interval.high))


@pytest.mark.parametrize("trials", [10, 30])
def test_signed_rank_rejects_five_percent_of_equal_pairs(trials):
    rng = np.random.default_rng(7)
    rejected = []
    for _ in range(REPEATS):
        shared = rng.lognormal(0, 0.5, trials)
        p, _ = signed_rank(shared * rng.lognormal(0, 0.3, trials), shared * rng.lognormal(0, 0.3, trials))
        rejected.append(p < 0.05)
    assert 0.03 < np.mean(rejected) < 0.07


def test_signed_rank_effect_runs_from_minus_one_to_one():
    a = np.arange(1.0, 9.0)
    assert signed_rank(a, a / 2)[1] == -1
    assert signed_rank(a, a * 2)[1] == 1
    assert signed_rank(a, a) == (1.0, 0.0)


def test_holm_is_the_textbook_example_and_leaves_untested_rows_out():
    p = np.array([0.01, np.nan, 0.04, 0.03, 0.005])
    np.testing.assert_allclose(holm(p), [0.03, np.nan, 0.06, 0.06, 0.02])
    assert np.isnan(holm(np.full(2, np.nan))).all()


def test_nothing_is_claimed_below_five_trials():
    few = np.array([1.0, 2.0, 1.5, 1.2])
    assert np.isnan([mean_of_positive(few).low, mean_difference(few, few * 2).low, improvement(few, few * 2).low]).all()
