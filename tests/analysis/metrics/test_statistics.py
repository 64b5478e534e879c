"""Intervals and tests: coverage and false-positive rates by simulation, closed forms, textbook examples."""

import numpy as np
import pytest
from scipy import stats
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.power import TTestPower

from cooploc.analysis.metrics.sequential import trials_to_exclude
from cooploc.analysis.metrics.statistics import (
    FIXED,
    decisive_trial,
    equivalence,
    expected_false,
    holm,
    share,
    trials_without_skew,
)

REPEATS = 1500


def covered(intervals, truth):
    return np.mean([low <= truth <= high for _, low, high in intervals])


def test_skewed_trials_are_worth_fewer():
    even, skewed = np.full(10, 2.0), np.r_[np.full(9, 1.0), 100.0]
    assert trials_without_skew(even) == 10
    assert trials_without_skew(skewed) == 5  # never below
    # gamma values of shape 1: 1 / (1 + 3) of the degrees of freedom
    assert trials_without_skew(np.random.default_rng(0).exponential(size=100_000)) == pytest.approx(25_000, rel=0.03)


def equals(rng, trials, level=1.0):
    """Squared errors of two estimators; trials that are hard are hard for both."""
    shared = rng.lognormal(0, 0.4, trials)
    return shared * rng.lognormal(0, 0.3, trials), level * shared * rng.lognormal(0, 0.3, trials)


@pytest.mark.parametrize("trials", [10, 30, 100])
def test_the_interval_covers_the_true_change(trials):
    rng = np.random.default_rng(3)
    intervals = [FIXED.change(*equals(rng, trials, 0.5)) for _ in range(REPEATS)]
    assert 0.92 < covered(intervals, np.sqrt(0.5) - 1) < 0.985


def test_an_erratic_estimator_is_not_called_better_than_a_steady_one_that_is_as_good():
    """Log-sd 0.4 against 1.2, equal means: the t test of b - a, which Fieller's interval inverts, errs in 14 %."""
    rng = np.random.default_rng(4)
    a = np.exp(rng.normal(0, 0.4, (REPEATS, 20)) - 0.4**2 / 2)
    b = np.exp(rng.normal(0, 1.2, (REPEATS, 20)) - 1.2**2 / 2)
    found = [FIXED.change(*pair) for pair in zip(a, b, strict=True)]
    assert covered(found, 0.0) > 0.91
    assert covered(found, 0.0) > np.mean(stats.ttest_rel(a, b, axis=1).pvalue > 0.05) + 0.04


def test_the_interval_of_a_change_is_the_jackknife_of_the_log_ratio():
    rng = np.random.default_rng(5)
    a, b = rng.lognormal(0, 0.3, 25), rng.lognormal(-0.5, 0.3, 25)
    left_out = [np.log(np.delete(b, i).mean() / np.delete(a, i).mean()) / 2 for i in range(25)]
    sd = np.sqrt(24 / 25 * np.sum((left_out - np.mean(left_out)) ** 2))
    degrees = min(trials_without_skew(a), trials_without_skew(b)) - 1
    centre = np.log(b.mean() / a.mean()) / 2
    ends = centre + np.array([-1, 1]) * stats.t.ppf(0.975, degrees) * sd
    assert FIXED.change(a, b)[1:] == pytest.approx(np.expm1(ends), rel=1e-9)
    assert FIXED.p_above(a, b, 0.8) == pytest.approx(stats.t.cdf((np.log(0.8) / 2 - centre) / sd, degrees))


def test_the_one_trial_that_decides_a_change_is_named():
    rng = np.random.default_rng(8)
    a, b = rng.lognormal(0, 0.3, 30), rng.lognormal(0, 0.3, 30)
    assert decisive_trial(a, b) is None
    b[17] *= 100
    assert decisive_trial(a, b) == decisive_trial(b, a) == 17
    assert decisive_trial(a[10:19], b[10:19]) is None  # too few trials to say so


@pytest.mark.slow
def test_holm_is_that_of_statsmodels(rng):
    for n in (1, 2, 7, 60):
        p = np.concatenate([rng.uniform(size=n) ** 4, np.full(n // 2, 0.01)])
        np.testing.assert_array_equal(holm(p), multipletests(p, method="holm")[1])


def test_the_p_of_an_interval_is_five_percent_at_its_ends(rng):
    a, b = rng.lognormal(0, 0.3, 25), rng.lognormal(-0.5, 0.3, 25)
    for end in FIXED.change(a, b)[1:]:
        assert FIXED.p_of_change(a, b, end) == pytest.approx(0.05, abs=1e-9)
    found, exact = FIXED.mean(b - a), stats.ttest_rel(b, a).confidence_interval(0.95)
    assert found[1:] == pytest.approx((exact.low, exact.high))
    for end in found[1:]:
        assert FIXED.p_of_mean(found, 25, end) == pytest.approx(0.05, abs=1e-9)
    assert FIXED.p_of_mean(found, 25, 0.3) == pytest.approx(stats.ttest_1samp(b - a, 0.3).pvalue)


def test_false_decisions_are_foreseen_from_the_tests_that_find_nothing():
    rng = np.random.default_rng(17)
    p = [np.concatenate([rng.uniform(size=60), 1e-6 * rng.uniform(size=40), [np.nan]]) for _ in range(400)]
    assert 0.05 * 60 < np.mean([expected_false(one) for one in p]) < 0.05 * 64
    assert expected_false(np.full(3, np.nan)) == 0.0
    assert expected_false(np.ones(3)) == pytest.approx(0.05 * 8)


def test_a_contrast_of_logs_covers_a_ratio_of_ratios():
    rng, intervals = np.random.default_rng(10), []
    for _ in range(REPEATS):
        values = rng.lognormal(0, 0.5, (30, 1)) * rng.lognormal(0, 0.3, (30, 4)) * [1.5, 1, 1, 1]
        intervals.append(FIXED.log_contrast(values, np.array([1.0, -1.0, -1.0, 1.0])))
    assert 0.92 < covered(intervals, np.log(1.5)) < 0.98


@pytest.mark.parametrize("p", [0.05, 0.3])
@pytest.mark.parametrize("together", [0.0, 1.0])
def test_wilsons_interval_covers_whether_robots_of_a_trial_fail_together_or_not(p, together):
    rng, intervals = np.random.default_rng(11), []
    for _ in range(REPEATS):
        team = (rng.uniform(size=(30, 1)) < p).repeat(5, 1)
        robots = np.where(rng.uniform(size=(30, 1)) < together, team, rng.uniform(size=(30, 5)) < p)
        intervals.append(share(robots.mean(1)))
    assert covered(intervals, p) > 0.92


def test_wilson_of_whole_trials_is_the_textbook_formula():
    low, high = share(np.repeat([0.0, 1.0], [17, 3]))[1:]
    p, n, z = 0.15, 20, stats.norm.ppf(0.975)
    centre, half = p + z**2 / (2 * n), z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    assert (low, high) == pytest.approx(((centre - half) / (1 + z**2 / n), (centre + half) / (1 + z**2 / n)))


@pytest.mark.slow
def test_equivalence_errs_in_five_percent_where_the_rmse_is_at_the_edge_of_the_margin():
    rng, tied = np.random.default_rng(12), []
    for _ in range(REPEATS):
        a = rng.lognormal(0, 0.5, 20)
        tied.append(equivalence(a, a * 1.1**2 * np.exp(rng.normal(-(0.1**2) / 2, 0.1, 20)), 0.1) < 0.05)
    assert 0.02 < np.mean(tied) < 0.08
    assert equivalence(a, a * rng.lognormal(0, 0.01, 20), 0.1) < 1e-3
    assert (equivalence(a, a, 0.1), equivalence(a, 4 * a, 0.1)) == (0.0, pytest.approx(1.0, abs=1e-3))


@pytest.mark.slow
@pytest.mark.parametrize("trials", [10, 30])
def test_the_test_of_a_difference_rejects_five_percent_of_equals_and_agrees_with_its_interval(trials):
    rng, rejected = np.random.default_rng(18), []
    for _ in range(REPEATS):
        a, b = equals(rng, trials)
        found = FIXED.change(a, b)
        rejected.append(FIXED.p_of_difference(a, b) < 0.05)
        assert rejected[-1] == (found.low > 0 or found.high < 0)
    assert 0.02 < np.mean(rejected) < 0.07
    assert FIXED.p_of_difference(a, a) == 1.0


def test_nothing_is_claimed_below_five_trials():
    few = np.array([1.0, 2.0, 1.5, 1.2])
    found = [FIXED.mean_of_positive(few), FIXED.mean(few), FIXED.change(few, few * 2), share(few / 2)]
    assert np.isnan([*(one.low for one in found), equivalence(few, few, 0.05)]).all()
    assert np.isnan(FIXED.log_contrast(np.stack([few, few], 1), np.array([1.0, -1.0])).low)


def test_trials_to_exclude_are_those_of_the_power_of_the_t_test():
    d = np.random.default_rng(14).normal(0.3, 1.0, 40)
    asked = TTestPower().solve_power(effect_size=0.25 / d.std(ddof=1), alpha=0.05, power=0.8)
    assert trials_to_exclude(FIXED.mean(d), 40, 0.25) == pytest.approx(asked, abs=1.5)
    assert np.isnan(trials_to_exclude(FIXED.mean(d), 40, 0.0))
