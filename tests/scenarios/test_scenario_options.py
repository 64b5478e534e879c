"""What may be said of any scenario's stream: everyone's priors, and no short ranges. Every estimator gets the same."""

import numpy as np
import pytest

import cooploc as cl
from cooploc.scenarios import resolve
from cooploc.scenarios.runner.tick import drive
from cooploc.scenarios.runner.trace import trace

LABELS = ("robots-1-3/n=3", "camera/n=3")


class Informed:
    """Believes of itself what was told of it, and remembers what was told of all."""

    uses = ("odometry", "team_prior")

    def __init__(self, prior, world, robot, key):
        self.robot, (self.x, self.P) = robot, prior

    def predict(self, z):
        self.told = cl.priors_of(z)
        self.x, self.P = self.told.x[self.robot], self.told.P[self.robot]

    def correct(self, z):
        pass


@pytest.mark.parametrize("label", LABELS)
def test_everyone_is_told_everyones_prior_in_every_tick(label):
    truth, stream = cl.simulate(label, trials=2, seed=1, ticks=4, team_priors=True)
    seen = trace("informed", cl.PerRobot(Informed), stream)
    for k in range(4):
        np.testing.assert_array_equal(seen.x[:, k], stream.prior.x)
        np.testing.assert_array_equal(seen.P[:, k], stream.prior.P)
    running = drive("informed", cl.PerRobot(Informed), stream.select([1]))
    running.start()
    running.tick(0)
    for robot in running.state.objects:
        np.testing.assert_array_equal(robot.told.x, stream.prior.x[1])
    assert len(cl.errors(truth, cl.run({"dr": "dead-reckoning"}, stream))) == 6


class Central:
    """A team whose one computer is sent every reading, and does nothing with it."""

    def __init__(self, prior, world, keys):
        self.x, self.P = prior

    def predict(self, z): ...
    def correct(self, z): ...
    def exchange(self, z, radio): ...


def test_what_all_were_told_is_not_uploaded():
    _, stream = cl.simulate("robots-1-3/n=3", trials=1, seed=1, ticks=4, team_priors=True)
    reads = ("odometry", "anchor_rssi")
    one, other = (trace("it", cl.PerTeam(Central, uses=uses), stream) for uses in (reads, (*reads, "team_prior")))
    assert one.bytes.min() > 0
    np.testing.assert_array_equal(one.bytes, other.bytes)


def test_without_the_channel_it_is_said_how_to_have_it():
    _, stream = cl.simulate("robots-1-3/n=3", trials=1, ticks=2)
    with pytest.raises(cl.IncompatibleEstimator, match="needs channel 'team_prior'"):
        trace("informed", cl.PerRobot(Informed), stream)
    _, stream = cl.simulate("robots-1-3/n=3", trials=1, ticks=2, team_priors=True)
    with pytest.raises(KeyError, match="name it in `uses`, in a scenario such as"):
        trace("informed", cl.PerRobot(Informed, uses=("odometry",)), stream)


def near(label, **how):
    """A stream some of whose ranges are short, as robots pass each other."""
    return cl.simulate(label, trials=3, seed=2, ticks=60, side=1.5, **how)


@pytest.mark.parametrize("estimator", ["ekf-ci", "mrsl-distance", "ekf-luft", "ekf-joint"])
def test_short_ranges_are_refused_for_all_alike_and_shipped_models_refused_them_before(estimator):
    (_, kept), (truth, refused) = near("robots-1-3/n=3"), near("robots-1-3/n=3", short_ranges="refused")
    short = kept.air.range < 0.2
    assert short.any()
    assert np.isnan(refused.air.range[short]).all()
    np.testing.assert_array_equal(refused.air.range[~short], kept.air.range[~short])
    one, other = (trace("it", cl.make(estimator), stream) for stream in (kept, refused))
    np.testing.assert_array_equal(one.x, other.x)
    assert len(cl.errors(truth, cl.run("dead-reckoning", refused))) == 9


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ("trajectory[short_ranges=gone]", "short_ranges: it must be 'kept' or 'refused'"),
        ("trajectory[team_prior=true]", "no parameter 'team_prior'; did you mean 'team_priors'"),
        ("trajectory[assumed.team_priors=true]", "is of the stream, so it cannot be assumed: write team_priors=true"),
    ],
)
def test_what_cannot_be_said_is_refused_in_one_line(label, words):
    with pytest.raises(cl.BadInput, match=words):
        resolve(label)
