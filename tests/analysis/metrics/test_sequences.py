"""Confidence sequences: the boundary is what the e-value says, and truth is seldom left however often one looks."""

import numpy as np
import pytest
from scipy import integrate, stats

from cooploc.analysis.metrics import sequential, statistics


@pytest.mark.parametrize("n", [7, 10, 40, 1000])
def test_the_sequence_ends_where_the_e_value_reaches_twenty(n):
    b = sequential.boundary(n)
    assert sequential.e_value(b, n) == pytest.approx(20)
    assert sequential.e_value(-b, n) == pytest.approx(20)


def test_there_is_no_sequence_below_seven_trials():
    assert np.isnan([sequential.boundary(n) for n in range(2, 7)]).all()
    assert np.isnan(sequential.ANYTIME.change(np.arange(1.0, 7), np.arange(2.0, 8)).low)


@pytest.mark.parametrize(("t", "n"), [(0.3, 5), (2.5, 12), (-1.7, 30)])
def test_the_e_value_is_the_mixture_of_noncentral_t_densities(t, n):
    """The likelihood ratio of t itself, averaged over the effects of the prior, and over the positive ones."""

    def ratio(effect):
        return stats.nct.pdf(t, n - 1, effect * np.sqrt(n)) / stats.t.pdf(t, n - 1)

    prior = stats.norm(0, 1 / np.sqrt(sequential.C2))
    both = integrate.quad(lambda d: prior.pdf(d) * ratio(d), -3, 3)[0]
    positive = integrate.quad(lambda d: 2 * prior.pdf(d) * ratio(d), 0, 3)[0]
    assert sequential.e_value(t, n) == pytest.approx(both, rel=1e-4)
    assert sequential.one_sided_e_value(t, n) == pytest.approx(positive, rel=1e-4)


@pytest.mark.parametrize("n", [2, 8, 40])
@pytest.mark.parametrize("e_value", [sequential.e_value, sequential.one_sided_e_value])
def test_its_expectation_is_one_where_nothing_differs(e_value, n):
    of_t = stats.t(n - 1)
    expected = integrate.quad(lambda t: e_value(t, n) * of_t.pdf(t), -np.inf, np.inf, limit=500)[0]
    assert expected == pytest.approx(1, rel=1e-3)


def test_equals_looked_at_after_every_trial_are_seldom_called_different():
    rng, n = np.random.default_rng(3), np.arange(1, 301)
    d = rng.normal(size=(1000, 300))
    mean = d.cumsum(1) / n
    spread = np.sqrt(((d**2).cumsum(1) - n * mean**2)[:, 6:] / (n - 1)[6:] / n[6:])
    sequence = np.array([sequential.boundary(k) for k in n[6:]])
    once = np.array([statistics.quantile(k) for k in n[6:]])
    assert (np.abs(mean[:, 6:]) > sequence * spread).any(1).mean() < 0.06
    assert (np.abs(mean[:, 6:]) > once * spread).any(1).mean() > 0.25


def test_p_is_at_most_5_percent_where_the_sequence_excludes_and_nowhere_else():
    rng = np.random.default_rng(4)
    for shift in (0.0, 0.1, 0.2, 0.4):
        a, b = np.exp(rng.normal(0, 0.5, (2, 60))) * [[1.0], [1 - shift]]
        low, high = sequential.ANYTIME.change(a, b)[1:]
        assert sequential.ANYTIME.p_of_change(a, b, low) == pytest.approx(0.05)
        assert sequential.ANYTIME.p_of_change(a, b, high) == pytest.approx(0.05)
        assert (sequential.ANYTIME.p_of_change(a, b, 0.0) <= 0.05) == (low > 0 or high < 0)


def test_the_one_sided_p_is_small_on_its_side_alone():
    rng = np.random.default_rng(5)
    a = np.exp(rng.normal(0, 0.3, 80))
    b = 2 * np.exp(rng.normal(0, 0.3, 80))
    assert sequential.ANYTIME.p_above(a, b, 1.0) < 1e-3
    assert sequential.ANYTIME.p_above(b, a, 1.0) == 1.0


@pytest.mark.parametrize("n", [10, 640, 1000])
def test_a_p_value_is_1_where_everything_speaks_for_the_opposite(rng, n):
    a, b = rng.lognormal(0, 0.01, n), rng.lognormal(-5, 0.01, n)  # so much that the e-value is 0 of many trials
    assert sequential.ANYTIME.p_above(a, b, 1.0) == 1.0


def test_trials_count_for_less_where_a_few_decide_the_mean():
    alike = np.ones((50, 2))
    decided = alike.copy()
    decided[:3, 1] = 1e4
    assert sequential.effective(alike) == 50
    assert sequential.effective(decided) == pytest.approx(3 * sequential.WORTH, rel=0.01)


def test_two_that_never_differ_are_equal_at_once_and_no_evidence_against_it():
    a = np.random.default_rng(6).uniform(1, 2, 10)
    assert sequential.ANYTIME.change(a, a) == (0, 0, 0)
    assert sequential.e_of_change(a, a) < 1


def test_evidence_beyond_all_numbers_stays_a_number():
    assert np.isfinite(sequential.e_value(1e4, 1000))
    assert np.isfinite(sequential.one_sided_e_value(np.inf, 1000))
