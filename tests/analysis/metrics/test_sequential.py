"""Confidence sequences and e-values, comparisons at looks, and how many trials a comparison needs."""

import numpy as np
import pandas as pd
import pytest
from made_runs import rows_of
from scipy import integrate, stats

import cooploc as cl
from cooploc.analysis.metrics import sequential, statistics
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.sequential import ANYTIME, add_decisions, decide, minutes


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


@pytest.mark.parametrize("shift", [0.0, 0.1, 0.2, 0.4, -1.0])
def test_p_is_at_most_5_percent_where_the_sequence_excludes_and_nowhere_else(shift):
    a, b = np.exp(np.random.default_rng(4).normal(0, 0.5, (2, 60))) * [[1.0], [1 - shift]]
    ends = ANYTIME.change(a, b)[1:]
    assert [ANYTIME.p_of_change(a, b, end) for end in ends] == pytest.approx([0.05, 0.05])
    assert (ANYTIME.p_of_change(a, b, 0.0) <= 0.05) == (ends[0] > 0 or ends[1] < 0)
    if shift < 0:
        assert ANYTIME.p_above(a, b, 1.0) < 1e-3
        assert ANYTIME.p_above(b, a, 1.0) == 1.0


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


NOISE = np.exp(np.random.default_rng(11).normal(0, 0.3, (6, 80)))
FAILING = np.where(np.arange(80) == 3, np.nan, 1.0)


@pytest.mark.parametrize(
    ("mse", "verdict", "look"),
    [
        (NOISE[1] / 4, "better", 10),
        (NOISE[2] * 4, "worse", 10),
        (NOISE[3], "open", 80),
        (NOISE[0] * (1 + 0.01 * (NOISE[1] - NOISE[1].mean())), "tie", 10),
        (NOISE[1] / 4 * FAILING, "failed", 10),  # none gains by failing
        (NOISE[2] * 4 * FAILING, "worse", 10),
    ],
)
def test_a_comparison_is_decided_at_the_first_look_that_can(mse, verdict, look):
    one = decided(rows_from(NOISE[0], mine=mse))["mine"]
    assert (one.verdict, one.look) == (verdict, look)
    assert verdict != "tie" or -0.05 < one.low <= 0 <= one.high < 0.05


def test_a_look_sees_the_trials_below_its_number_whatever_the_order_of_the_rows():
    rows = rows_from(NOISE[0], other=NOISE[1] * 0.8)
    early, later = rows[rows["trial"] < 40], rows.sample(frac=1, random_state=1)
    first, last = decided(early)["other"], decided(later)["other"]
    assert first == last if first.verdict != "open" else last.look > first.look


def test_the_table_has_p_values_that_hold_at_any_stopping():
    rows = rows_from(NOISE[0], half=NOISE[1] / 4, same=NOISE[2])
    table = compare(rows, "base", full=True)
    decided = add_decisions(table, pd.DataFrame(decide(rows, {"s": "base"}, {"s": 80})))
    p = dict(zip(decided["estimator"], decided["p"], strict=True))
    assert p["half"] < 0.05 < p["same"]
    assert p["half"] > dict(zip(table["estimator"], table["p"], strict=True))["half"]
    assert list(decided["verdict"]) == ["", "better", "open"]


@pytest.mark.slow
def test_a_plan_counts_the_trials_of_every_comparison(tmp_path):
    (tmp_path / "small.toml").write_text(
        'trials = 40\nbaseline = "arl[particles=20]"\nscenarios = ["trajectory[ticks=12]"]\n'
        'estimators = ["arl[particles=20]", "dead-reckoning", "ekf-local"]\n'
    )
    found, smaller = (cl.plan(tmp_path / "small.toml", difference=d, out=tmp_path / "run") for d in (0.2, 0.1))
    assert list(found["estimator"]) == ["dead-reckoning", "ekf-local"]
    assert (found["until_decided"] > found["trials"]).all()
    assert (smaller["trials"] > found["trials"]).all()
    assert 0 < minutes(found, "trials", jobs=2) == minutes(found, "trials") / 2


def test_the_planned_number_until_decided_decides_four_of_five():
    """Normal differences of a known spread, looked at once at the planned number: any look only adds power."""
    exact = statistics.Interval(
        0.3, *(0.3 + np.array([-2, 1]) * statistics.quantile(30) / np.sqrt(30))
    )  # the wider side
    n = int(sequential.trials_until_decided(exact, 30, 1.0))
    d = stats.norm(1.0, 2.0).rvs((2000, n), random_state=1)
    decided = np.mean([ANYTIME.mean(one).low > 0 for one in d])
    assert 0.75 < decided < 0.9
