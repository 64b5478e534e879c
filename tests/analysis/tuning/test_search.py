"""The search: scores that are robust and proper, one budget, the same streams for all, what is shown better chosen."""

from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest

import cooploc as cl
from cooploc.analysis.tuning.search import (
    CAP,
    LARGEST,
    Item,
    Space,
    cap_score,
    full_rounds,
    race,
    space_of,
    trial_scores,
)
from cooploc.analysis.tuning.tune import history
from cooploc.estimators import configure
from cooploc.estimators.label_syntax import parse
from cooploc.estimators.tunable import Tunable


def rows(**columns):
    table = {"trial": [0, 0, 1, 1], "ticks": [10, 10, 10, 10], "nll": [1.0, 2.0, 3.0, 4.0], "mse": [1.0] * 4}
    return pd.DataFrame({**table, "failure": [None] * 4, **columns})


def test_the_cap_keeps_the_order_and_takes_the_weight():
    nll = np.array([-5.0, 0.0, CAP, CAP + 1, 1e3, 1e5, np.inf])
    found = cap_score(nll)
    np.testing.assert_array_equal(found[:3], nll[:3])
    assert (np.diff(found) > 0).all()
    assert found[3] == pytest.approx(CAP + np.log(2))
    assert found[-1] < CAP + 15
    assert cap_score(np.array([np.nan]))[0] == cap_score(np.array([LARGEST]))[0]


def test_a_trial_s_score_is_the_mean_over_its_robots_and_a_failed_one_is_the_worst():
    assert trial_scores(rows(), "nll").tolist() == [1.5, 3.5]
    assert trial_scores(rows(mse=[4.0, 4.0, 1.0, 1.0]), "rmse").tolist() == pytest.approx([np.log(2), 0.0])
    failed = rows(failure=["it raised"] * 2 + [None] * 2, nll=[np.nan] * 2 + [1e5] * 2, ticks=[np.nan] * 2 + [9] * 2)
    for objective in ("nll", "rmse"):
        scores = trial_scores(failed, objective)
        assert np.inf > scores[0] > scores[1]


def test_claiming_to_be_surer_does_not_pay_by_likelihood_and_is_not_seen_by_rmse():
    truth, stream = cl.simulate("robots-1-3/n=1[ticks=60]", trials=6, seed=2)
    names = ["ekf-local[anchor_reading=rssi]", "ekf-local[anchor_reading=rssi,inflation=0.2]"]
    table = cl.errors(truth, cl.run(names, stream)).assign(failure=None)
    nll = [trial_scores(table[table["estimator"] == name], "nll").mean() for name in names]
    assert nll[0] + 0.5 < nll[1]


GATE = {"gate": Tunable(10.0, 1.0, 100.0, log=True)}


class Numbered(NamedTuple):
    """A scenario whose trials are numbered."""

    name: str

    def item(self, number):
        return Item(self.name, number)


LANES = Numbered("a"), Numbered("b")


def gate_of(label):
    return float(parse(label)[1].get("gate", 10.0))


def noise(item, label=""):
    return np.random.default_rng([item.trial, *item.scenario.encode(), *label.encode()]).normal()


def finished(budget, score, parameters=GATE, seed=1):
    """The finish of a race whose trials have these scores, and what it asked for at a time."""
    asked = []

    def compute(pairs):
        asked.append(list(pairs))
        return {pair: score(*pair) for pair in asked[-1]}

    return race(Space(configure("ekf-local"), parameters), LANES, budget, seed, compute), asked


def steep(label, item):
    """Noise of a stream that all share, and a gate that is best at 30."""
    return abs(np.log(gate_of(label) / 30)) + noise(item) + 0.01 * noise(item, label)


@pytest.mark.parametrize("budget", [2, 7, 40, 101, 333])
def test_no_trial_is_run_twice_and_all_of_them_count_in_the_budget(budget):
    finish, asked = finished(budget, steep)
    pairs = [pair for one in asked for pair in one]
    assert len(pairs) == len(set(pairs)) == finish.spent <= budget
    assert budget - finish.spent < full_rounds(budget, 2) * 2
    assert {label for label, _ in asked[0]} == {"ekf-local"}  # as shipped
    assert all("ekf-local" not in dict(later) for later in asked[1:])


def test_what_is_hopeless_stops_early_and_what_is_better_is_chosen():
    finish, _ = finished(300, steep)
    stopped = [one for one in finish.entrants if one.state == "stopped"]
    assert len(stopped) > 5
    assert max(len(one.scores) for one in stopped) < finish.rounds * 2
    assert 15 < gate_of(finish.best.label) < 60
    tried = history([finish]).set_index("label")
    gains = [steep("ekf-local", one) - steep(finish.best.label, one) for one in finish.best.scores]
    assert tried.loc[finish.best.label, "gain"] == pytest.approx(np.mean(gains))
    assert finish.best.state == "finished"


@pytest.mark.slow
def test_an_estimator_that_nothing_makes_better_mostly_stays_as_shipped():
    def flat(label, item):
        return noise(item) + noise(item, label)

    moved = sum(finished(100, flat, seed=k)[0].best.number != 0 for k in range(20))
    assert moved <= 12  # one of several noisy configurations is sometimes shown better; always would be 20


def test_a_small_space_is_tried_once_and_then_left():
    finish, _ = finished(1000, lambda label, item: noise(item), {"both": Tunable(True, choices=(True, False))})
    assert sorted(one.label for one in finish.entrants) == ["ekf-local", "ekf-local[both=false]"]


def test_what_a_label_states_is_not_tuned():
    assert "gate" in space_of("ekf-local").parameters
    assert "gate" not in space_of("ekf-local[gate=5]").parameters
    assert space_of("ekf-local[gate=5]").label({"inflation": 2.0}) == "ekf-local[gate=5,inflation=2]"
    assert space_of("dead-reckoning").parameters == {}
