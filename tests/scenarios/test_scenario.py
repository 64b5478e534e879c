"""A label becomes a scenario: its size, its trials, what the team assumes, and options of any stream."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from attempts import attempted
from pydantic import BaseModel

import cooploc as cl
from cooploc.scenarios import BUILTIN, Family, resolve
from cooploc.scenarios.runner.tick import restrict
from cooploc.scenarios.runner.trace import trace


def test_a_recording_has_its_own_number_of_trials_and_needs_its_data(tmp_path):
    with pytest.raises(cl.BadInput, match="is a recording; say where it is"):
        resolve("mrclam/all")
    found = resolve("mrclam/all", tmp_path)
    assert (found.trials(100), found.is_recording, found.data) == (1, True, tmp_path)
    assert found.of_length(1) is found


class Foreign(BaseModel):
    """A model with nothing but what `Scenario` asks for."""

    drift: float = 0.0

    def world(self):
        return resolve("trajectory").model.world()

    def simulate(self, label, trials, seed, world):
        return resolve("trajectory", ticks=3).simulate(trials, seed)


def test_a_model_that_does_not_state_its_size_is_a_scenario_too(monkeypatch):
    monkeypatch.setitem(BUILTIN, "foreign", Family("of another package", Foreign))
    found = resolve("foreign[drift=1]")
    assert (found.robots, found.ticks, found.trials(5), found.parameters) == (1, 1, 5, {"drift": "1"})
    truth, stream = found.of_length(1).simulate(2, seed=3)
    assert truth.scenario == stream.scenario == "foreign[drift=1]"  # those of another scenario have this label
    np.testing.assert_array_equal(truth.x, cl.simulate("trajectory", trials=2, seed=3, ticks=3)[0].x)


def test_what_a_label_assumes_changes_the_hash_and_no_reading():
    true, wrong = (cl.simulate(f"trajectory[{what}ticks=4]", trials=2, seed=1)[1] for what in ("", "assumed.eta=2,"))
    again = cl.simulate("trajectory", trials=2, seed=1, ticks=4, assumed={"eta": 2})[1]
    for name, array in true.arrays().items():
        np.testing.assert_array_equal(array, wrong.arrays()[name])
    assert wrong.hashes == again.hashes
    assert not set(wrong.hashes) & set(true.hashes)
    assert wrong.world.sensors == again.world.sensors != true.world.sensors
    assert wrong.scenario == again.scenario == "trajectory[assumed.eta=2,ticks=4]"
    both = cl.simulate("trajectory[assumed.eta=2]", ticks=4, assumed={"odometry_sigma": 0.5})[1].world
    assert (both.sensors["anchor_rssi"].eta, both.motion.sigma) == (2, 0.5)


def test_an_assumption_has_one_hash_however_it_is_written():
    given = cl.simulate("trajectory", ticks=2, assumed={"eta": 2.0})[1]
    for written in ("2", "2.0", "2e0"):
        assert cl.simulate(f"trajectory[ticks=2, assumed.eta={written}]")[1].hash == given.hash
    assert cl.simulate("trajectory", ticks=2, assumed={"eta": 2.1})[1].hash != given.hash


class Informed:
    """Believes of itself what all know of it in advance."""

    uses = ("odometry", "team_prior")

    def __init__(self, prior, world, robot, key):
        self.robot, (self.x, self.P) = robot, prior

    def predict(self, z):
        priors = cl.priors_of(z)
        self.x, self.P = priors.x[self.robot], priors.P[self.robot]

    def correct(self, z):
        pass


class Central:
    """A team whose one computer is sent every reading, and does nothing with it."""

    def __init__(self, prior, world, keys):
        self.x, self.P = prior

    def predict(self, z): ...
    def correct(self, z): ...
    def exchange(self, z, radio): ...


@pytest.mark.parametrize("label", ["robots-1-3/n=3", "camera/n=3"])
def test_team_priors_are_there_in_every_tick_and_are_not_uploaded(label):
    truth, stream = cl.simulate(label, trials=2, seed=1, ticks=4, team_priors=True)
    seen = trace("informed", cl.PerRobot(Informed), stream)
    for k in range(4):
        np.testing.assert_array_equal(seen.x[:, k], stream.prior.x)
        np.testing.assert_array_equal(seen.P[:, k], stream.prior.P)
    assert len(cl.errors(truth, cl.run({"dr": "dead-reckoning"}, stream))) == 6
    reads = ("odometry", "anchor_rssi|landmark")
    one, other = (trace("it", cl.PerTeam(Central, uses=uses), stream) for uses in (reads, (*reads, "team_prior")))
    assert one.bytes.min() > 0
    np.testing.assert_array_equal(one.bytes, other.bytes)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("ekf-ci", r"; \[anchor_reading=any,reading=any\] takes"),
        ("arl", r"; \[anchor_reading=any\] takes"),
        ("mrsl-rssi", "has odometry, radio_range$"),  # no parameter of that name helps
    ],
)
def test_a_filter_that_lacks_a_channel_says_how_it_takes_what_there_is(name, remedy):
    bare = SimpleNamespace(scenario="log/all", channels=lambda: {"odometry", "radio_range"})
    with pytest.raises(cl.IncompatibleEstimator, match=f"{name} needs channel 'anchor_rssi'.*{remedy}"):
        restrict(name, cl.make(name), bare)


def test_an_error_says_how_to_have_team_priors():
    _, stream = cl.simulate("robots-1-3/n=3", trials=1, ticks=2)
    with pytest.raises(cl.IncompatibleEstimator, match="needs channel 'team_prior'"):
        trace("informed", cl.PerRobot(Informed), stream)
    _, stream = cl.simulate("robots-1-3/n=3", trials=1, ticks=2, team_priors=True)
    with pytest.raises(KeyError, match="name it in `uses`, in a scenario such as"):
        trace("informed", cl.PerRobot(Informed, uses=("odometry",)), stream)


@pytest.mark.parametrize(
    ("label", "given", "words"),
    [
        ("trajectry", {}, "'trajectry'.*'trajectory'"),
        ("trajectory", {"robotz": 3}, "'robotz'.*'robots'"),
        ("trajectory", {"assumed": {"shadowin": 3}}, "'shadowin'.*'shadowing'"),
        ("packet-drop/loss=0.7", {}, "'loss=0.7'.*drop="),
        ("trajectory[", {}, "trajectory"),
        ("trajectory", {"trials": 0}, "trials is 0"),
        ("trajectory", {"trials": []}, "at least 1"),
        ("trajectory", {"trials": 2.5}, "whole number"),
        ("trajectory", {"trials": [0, -1]}, "trials"),
        ("trajectory", {"trials": [3, 3]}, "name each trial once"),
        ("trajectory", {"seed": -1}, "seed is -1"),
        ("packet-drop/drop=2", {}, "drop"),
        ("trajectory", {"robots": 0}, "robots"),
        ("trajectory", {"side": np.inf}, "side"),
        ("trajectory", {"shadowing": np.nan}, "shadowing"),
        ("trajectory", {"step": 30.0}, "make step at most side / 1.5"),
        ("trajectory", {"ticks": 2, "assumed": {"robots": 4}}, "make it an override"),
        ("trajectory", {"ticks": 2, "assumed": {"tick": 2.0}}, "make it an override"),
        ("trajectory", {"ticks": 2, "assumed": {"anchors": 5}}, "make it an override"),
        ("trajectory[team_prior=true]", {}, "no parameter 'team_prior'; did you mean 'team_priors'"),
        ("trajectory[assumed.team_priors=true]", {}, "is of the stream, so it cannot be assumed: leave it out"),
    ],
)
def test_bad_input_is_refused_in_one_line_that_helps(label, given, words):
    with pytest.raises(cl.BadInput, match=words) as refusal:
        cl.simulate(label, **given)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("label", ["hardware/n=3", "no-compass/n=3", "uwb/n=3", "camera/n=3"])
def test_a_world_with_an_extreme_number_is_simulated_or_refused(label):
    defaults = resolve(label).model.model_dump()
    numbers = [name for name, value in defaults.items() if isinstance(value, float | int)]
    assert len(numbers) > 10
    for name, value in product(numbers, (0, 1e-12, 1, 1e12)):
        made = attempted(cl.simulate, label, trials=1, **{"ticks": 3, name: value})
        assert isinstance(made, cl.BadInput) or np.isfinite(made[0].x).all(), (name, value)
