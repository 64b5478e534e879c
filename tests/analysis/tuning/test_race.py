"""The race: one budget, the same streams for all, the hopeless stopped early, and only what is shown better chosen."""

from typing import NamedTuple

import numpy as np
import pytest

from cooploc.analysis.tuning.search import Competitor, Item, Sampler, Space, full_rounds, race, search, space_of
from cooploc.estimators import configure
from cooploc.estimators.plugins.errors import BadInput
from cooploc.estimators.plugins.labels import parse
from cooploc.estimators.plugins.tunable import Tunable

GATE = {"gate": Tunable(10.0, 1.0, 100.0, log=True)}


class Numbered(NamedTuple):
    """A scenario whose trials are numbered."""

    name: str
    cycle: int = 10**9

    def item(self, number):
        return Item(self.name, number % self.cycle)


LANES = Numbered("a"), Numbered("b")


def space(parameters=GATE, label="ekf-local"):
    return Space(configure(label), parameters)


def gate_of(label):
    return float(parse(label)[1].get("gate", 10.0))


def noise(item, label=""):
    return np.random.default_rng([item.trial, *item.scenario.encode(), *label.encode()]).normal()


def finished(budget, score, lanes=LANES, parameters=GATE, seed=1):
    """The finish of a race whose trials have these scores."""

    def compute(pairs):
        return {(label, item): score(label, item) for label, item in pairs}

    return search([Competitor(space(parameters), lanes)], budget, seed, compute)[0]


def steep(label, item):
    """Noise of a stream that all share, and a gate that is best at 30."""
    return abs(np.log(gate_of(label) / 30)) + noise(item) + 0.01 * noise(item, label)


@pytest.mark.parametrize("budget", [2, 7, 40, 101, 333])
def test_no_trial_is_run_twice_and_all_of_them_count_in_the_budget(budget):
    asked = []

    def compute(pairs):
        asked.extend(pairs := list(pairs))
        return {pair: steep(*pair) for pair in pairs}

    finish = search([Competitor(space(), LANES)], budget, 1, compute)[0]
    assert len(asked) == len(set(asked)) == finish.spent <= budget
    assert budget - finish.spent < full_rounds(budget, 2) * 2


def test_every_configuration_runs_the_same_streams_in_the_same_order():
    finish = finished(200, steep)
    for one in finish.entrants:
        assert list(one.scores) == list(finish.entrants[0].scores)[: len(one.scores)]


def test_what_is_hopeless_stops_early_and_what_is_better_is_chosen():
    finish = finished(300, steep)
    stopped = [one for one in finish.entrants if one.state == "stopped"]
    assert len(stopped) > 5
    assert max(len(one.scores) for one in stopped) < finish.rounds * 2
    assert 15 < gate_of(finish.best.label) < 60
    assert finish.best.state == "finished"


def test_an_estimator_that_nothing_makes_better_mostly_stays_as_published():
    def flat(label, item):
        return noise(item) + noise(item, label)

    moved = sum(finished(100, flat, seed=k).best.number != 0 for k in range(20))
    assert moved <= 12  # one of several noisy configurations is sometimes shown better; always would be 20


def test_an_estimator_without_parameters_takes_part_with_its_only_configuration():
    finish = finished(100, steep, parameters={})
    assert len(finish.entrants) == 1
    assert finish.best.label == "ekf-local"


def test_a_small_space_is_tried_once_and_then_left():
    finish = finished(1000, lambda label, item: noise(item), parameters={"both": Tunable(True, choices=(True, False))})
    assert sorted(one.label for one in finish.entrants) == ["ekf-local", "ekf-local[both=false]"]


def test_a_recording_that_is_used_up_costs_nothing_more():
    finish = finished(60, steep, lanes=[Numbered("recording", cycle=2)])
    assert finish.rounds == 10
    assert len(finish.entrants[0].scores) == 2


def test_copies_of_one_estimator_try_the_same_configurations_whatever_they_are_called():
    names = "ekf-local", "ekf-naive", "ekf-ci"
    seen = {name: [] for name in names}

    def compute(pairs):
        for label, item in pairs:
            seen[parse(label)[0]].append((parse(label)[1], item))
        return {(label, item): steep(label.replace(parse(label)[0], "x"), item) for label, item in pairs}

    finishes = search([Competitor(space(label=name), LANES) for name in names], 80, 5, compute)
    assert seen["ekf-local"] == seen["ekf-naive"] == seen["ekf-ci"]
    assert len({finish.best.number for finish in finishes}) == 1


def test_a_budget_that_does_not_suffice_for_one_trial_of_every_scenario_is_refused():
    with pytest.raises(BadInput, match="give at least --budget 2"):
        finished(1, steep)


def test_what_a_label_states_is_not_tuned():
    assert "gate" in space_of("ekf-local").parameters
    assert "gate" not in space_of("ekf-local[gate=5]").parameters
    assert space_of("ekf-local[gate=5]").label({"inflation": 2.0}) == "ekf-local[gate=5,inflation=2]"
    assert space_of("dead-reckoning").parameters == {}


def test_the_direction_s_parameters_are_tuned_only_where_the_direction_is_used():
    assert "K" in space_of("arl").parameters
    assert list(space_of("rssi-pf").parameters) == ["inflation"]


def test_the_race_begins_with_the_configuration_as_published_and_learns_from_what_it_is_told():
    sampler = Sampler(space(), 3)
    steps = race(LANES, 24, sampler)
    first = next(steps)
    assert list(first) == ["ekf-local"]
    second = steps.send({("ekf-local", item): 0.0 for item in first["ekf-local"]})
    assert "ekf-local" not in second
    assert {tuple(items) for items in second.values()} == {(Item("a", 0), Item("b", 0))}
