"""Confidence sequences and e-values, comparisons at looks, and how many trials a comparison needs."""

import numpy as np
import pandas as pd
import pytest
from made_runs import rows_of
from scipy import integrate, stats

import cooploc as cl
from cooploc.analysis.metrics import sequential, statistics
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.sequential import add_decisions, decide, minutes


@pytest.mark.parametrize("n", [7, 10, 40, 1000])
def test_the_sequence_ends_where_the_e_value_reaches_twenty(n):
    b = sequential.boundary(n)
    assert sequential.e_value(b, n) == pytest.approx(20)
    assert sequential.e_value(-b, n) == pytest.approx(20)


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


def test_trials_count_for_less_where_a_few_decide_the_mean():
    alike = np.ones((50, 2))
    decided = alike.copy()
    decided[:3, 1] = 1e4
    assert sequential.effective(alike) == 50
    assert sequential.effective(decided) == pytest.approx(3 * sequential.WORTH, rel=0.01)


def rows_from(base, **others):
    """Rows of one scenario from mean squared errors by trial; nan: failed."""
    named = {"base": base, **others}
    rows = rows_of("s", dict.fromkeys(named, (1.0, 1.0)), trials=len(base))
    rows["mse"] = np.concatenate(list(named.values()))
    rows.loc[rows["mse"].isna(), "failure"] = "RuntimeError: lost"
    return rows


def decided(rows, most=1000):
    return {one.estimator: one for one in decide(rows, {"s": "base"}, {"s": most})}


@pytest.fixture
def noise():
    return np.exp(np.random.default_rng(11).normal(0, 0.3, (6, 80)))


def test_a_clear_difference_is_decided_at_the_first_look_and_equals_are_not(noise):
    one = decided(rows_from(noise[0], half=noise[1] / 4, twice=noise[2] * 4, same=noise[3]))
    assert (one["half"].verdict, one["half"].look) == ("better", 10)
    assert (one["twice"].verdict, one["twice"].look) == ("worse", 10)
    assert (one["same"].verdict, one["same"].look) == ("open", 80)


def test_what_lies_within_the_margin_is_a_tie(noise):
    one = decided(rows_from(noise[0], near=noise[0] * (1 + 0.01 * (noise[1] - noise[1].mean()))))["near"]
    assert one.verdict == "tie"
    assert -0.05 < one.low <= 0 <= one.high < 0.05


def test_a_look_sees_the_trials_below_its_number_whatever_the_order_of_the_rows(noise):
    rows = rows_from(noise[0], other=noise[1] * 0.8)
    early, later = rows[rows["trial"] < 40], rows.sample(frac=1, random_state=1)
    first, last = decided(early)["other"], decided(later)["other"]
    assert first == last if first.verdict != "open" else last.look > first.look


def test_none_gains_by_failing_and_one_that_fails_can_still_be_worse(noise):
    better, worse = noise[1] / 4, noise[2] * 4
    better[3] = worse[3] = np.nan
    one = decided(rows_from(noise[0], better=better, worse=worse))
    assert one["better"].verdict == "failed"
    assert one["worse"].verdict == "worse"


def test_the_table_has_p_values_that_hold_at_any_stopping(noise):
    rows = rows_from(noise[0], half=noise[1] / 4, same=noise[2])
    table = compare(rows, "base", full=True)
    decided = add_decisions(table, pd.DataFrame(decide(rows, {"s": "base"}, {"s": 80})))
    p = dict(zip(decided["estimator"], decided["p"], strict=True))
    assert p["half"] < 0.05 < p["same"]
    assert p["half"] > dict(zip(table["estimator"], table["p"], strict=True))["half"]
    assert list(decided["verdict"]) == ["", "better", "open"]


STUDY = """
trials = 40
baseline = "arl[particles=20]"
scenarios = ["trajectory[ticks=12]"]
estimators = ["arl[particles=20]", "dead-reckoning", "ekf-local"]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("plan")
    (made / "small.toml").write_text(STUDY)
    return made


def test_a_plan_counts_the_trials_of_every_comparison(folder):
    found = cl.plan(folder / "small.toml", difference=0.2, out=folder / "run")
    assert list(found["estimator"]) == ["dead-reckoning", "ekf-local"]
    assert (found["until_decided"] > found["trials"]).all()
    smaller = cl.plan(folder / "small.toml", difference=0.1, out=folder / "run")
    assert (smaller["trials"] > found["trials"]).all()
    assert 0 < minutes(found, "trials", jobs=2) == minutes(found, "trials") / 2


def test_the_planned_number_until_decided_decides_four_of_five(folder):
    """Normal differences of a known spread, looked at once at the planned number: any look only adds power."""
    exact = statistics.Interval(0.0, *(np.array([-1, 1]) * statistics.quantile(30) / np.sqrt(30)))
    n = int(sequential.trials_until_decided(exact, 30, 0.5))
    d = stats.norm(0.5).rvs((2000, n), random_state=1)
    decided = np.mean([sequential.ANYTIME.mean(one).low > 0 for one in d])
    assert 0.75 < decided < 0.9
