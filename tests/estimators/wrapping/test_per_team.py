"""A loop over the whole team, wrapped by `PerTeam`: the same results and the same bill as other ways to write it."""

from pathlib import Path

import numpy as np
import pytest

import cooploc as cl
from cooploc.estimators.adapters import Radio
from cooploc.estimators.interface import Mail, Senses
from cooploc.scenarios.runner.tick import EstimatorError
from cooploc.scenarios.runner.trace import trace

LOOP = f"{Path(__file__).resolve().parents[3]}/examples/filterpy_loop.py:loop"


def one_of(z, i):
    return Senses(*(a[i] for a in z[:-1]), extra={})


class TeamOfLoops:
    """The example's loop for one robot, one after the other in one object, which broadcasts for them."""

    uses = ("odometry", "anchor_rssi", "radio_range")
    centralised = False

    def __init__(self, prior, world, keys):
        make = cl.make(LOOP).make
        n = range(len(keys))
        self.loops = [make(cl.Belief(prior.x[i], prior.P[i]), world, i, keys[i]) for i in n]

    def predict(self, z):
        for i, loop in enumerate(self.loops):
            loop.predict(one_of(z, i))

    def correct(self, z):
        for i, loop in enumerate(self.loops):
            loop.correct(one_of(z, i))

    def exchange(self, z, radio):
        packets = np.array([loop.send() for loop in self.loops])
        for i, packet in enumerate(packets):
            radio.broadcast(i, packet)
        for i, loop in enumerate(self.loops):
            loop.fuse(Mail(radio.heard[i], packets, radio.rssi[i], radio.range[i]))

    def estimate(self):
        beliefs = [loop.estimate() for loop in self.loops]
        return cl.Belief(np.stack([b.x for b in beliefs]), np.stack([b.P for b in beliefs]))


class Walkers:
    """Dead reckoning of a whole team, which is centralised, as any team that does not say otherwise."""

    uses = ("odometry", "anchor_rssi", "radio_range")
    notes = ("ticks",)

    def __init__(self, prior, world, keys):
        self.x, self.P, self.world, self.ticks = prior.x, prior.P, world, np.zeros(len(keys))

    def predict(self, z):
        self.x, _, Q = self.world.motion.move(self.x, z.odometry, z.dt)
        self.P, self.ticks = self.P + Q, self.ticks + 1

    def correct(self, z): ...

    def exchange(self, z, radio): ...


@pytest.mark.slow
@pytest.mark.parametrize("label", ["packet-drop/drop=0.5", "asynchrony"])
def test_a_team_that_broadcasts_is_billed_as_its_robots_are(label):
    stream = cl.simulate(label, trials=2, ticks=30)[1]
    team, alone = trace("team", cl.PerTeam(TeamOfLoops), stream), trace("alone", cl.make(LOOP), stream)
    np.testing.assert_array_equal(team.x, alone.x)
    np.testing.assert_array_equal(team.messages, alone.messages)
    np.testing.assert_array_equal(team.bytes, alone.bytes)
    assert not team.centralised


@pytest.mark.slow
def test_an_adapted_team_passes_every_check_that_applies():
    report = cl.check_estimator(cl.PerTeam(TeamOfLoops), isolate=False)
    assert report.passed, report.table()


def test_a_centralised_team_pays_for_what_its_robots_upload_as_the_joint_filter_does():
    stream = cl.simulate("robots-1-3/n=3", trials=2, ticks=30)[1]
    traces = cl.run({"team": cl.PerTeam(Walkers), "joint": "ekf-joint", "dead": "dead-reckoning"}, stream).traces
    np.testing.assert_allclose(traces["team"].x, traces["dead"].x, atol=1e-12)
    np.testing.assert_array_equal(traces["team"].bytes, traces["joint"].bytes)
    assert traces["team"].centralised
    assert (traces["team"].notes["ticks"] == 30).all()


@pytest.mark.slow
def test_a_team_of_the_wrong_shape_or_without_an_exchange_is_told_what_it_lacks():
    class Flat(Walkers):
        def estimate(self):
            return self.x.ravel(), self.P

    stream = cl.simulate("robots-1-3/n=3", trials=2, ticks=2)[1]
    with pytest.raises(EstimatorError, match=r"x of shape \(6,\) a trial, not \(3, 2\)"):
        trace("flat", cl.PerTeam(Flat), stream)
    methods = {name: vars(Walkers)[name] for name in ("uses", "__init__", "predict", "correct")}
    with pytest.raises(cl.BadInput, match=r"holds the whole team has exchange\(z, radio\)"):
        cl.run({"it": type("NoExchange", (), methods)}, stream)


@pytest.fixture
def air():
    link = np.array([[False, True], [False, False]])  # robot 0 hears robot 1
    return Mail(link, np.empty((2, 2, 0)), np.full((2, 2), -50.0), np.full((2, 2), 3.0))


def test_a_reading_of_a_teammate_exists_once_a_packet_of_it_was_heard(air):
    radio = Radio(air, np.ones(2, bool))
    assert np.isnan(radio.range).all()
    assert radio.broadcast(1, [1.0, np.nan, 2.0]) == [0]
    np.testing.assert_array_equal(radio.range, [[np.nan, 3.0], [np.nan, np.nan]])
    np.testing.assert_array_equal(radio.bytes, [0, 2 * 8 + 8])


def test_a_packet_that_is_lost_is_paid_and_one_of_a_sleeper_or_of_nan_is_not_sent(air):
    radio = Radio(air, np.array([True, False]))
    assert radio.send(0, 1, [1.0]) is None
    assert radio.send(1, 0, [1.0]) is None
    assert radio.send(0, 1, [np.nan]) is None
    np.testing.assert_array_equal(radio.messages, [1, 0])
    assert not radio.heard.any()
