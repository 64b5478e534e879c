"""A resolved scenario knows its size, its trials and its parameters, also where its model is a plug-in."""

import numpy as np
import pytest
from pydantic import BaseModel

import cooploc as cl
from cooploc.scenarios import BUILTIN, Family, resolve


def test_a_recording_has_its_own_number_of_trials_and_needs_its_data(tmp_path):
    with pytest.raises(cl.BadInput, match="is a recording; say where it is"):
        resolve("mrclam/all")
    found = resolve("mrclam/all", tmp_path)
    assert (found.trials(100), found.is_recording, found.data) == (1, True, tmp_path)
    assert found.first_tick() is found


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
    truth, _ = found.first_tick().simulate(2, seed=3)
    np.testing.assert_array_equal(truth.x, cl.simulate("trajectory", trials=2, seed=3, ticks=3)[0].x)


def test_a_label_may_say_what_the_team_assumes():
    """The readings stay bit-identical, the hash does not, and `assumed=` adds to what the label says."""
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


@pytest.mark.parametrize("written", ["2", "2.0", "2e0"])
def test_an_assumption_has_one_hash_however_it_is_written(written):
    given = cl.simulate("trajectory", ticks=2, assumed={"eta": 2.0})[1]
    assert cl.simulate(f"trajectory[ticks=2, assumed.eta={written}]")[1].hash == given.hash
    assert cl.simulate("trajectory", ticks=2, assumed={"eta": 2.1})[1].hash != given.hash
