"""Channel filters over particles: two robots are the centralised filter; silence is ARL; what a lost packet costs."""

import numpy as np
import pytest
from oracles import dense_posterior, linear_team

from cooploc.estimators import make
from cooploc.estimators.interface import Belief
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.run import run
from cooploc.scenarios.runner.trace import trace

TICKS = 6


def two_robots(seed):
    """The stream of two robots that read the same of each other, and the one in which each reading stands once.

    They see landmarks at the first tick only; afterwards they know of their places by what they tell each other.
    """
    _, stream = linear_team(seed, trials=2, robots=2, ticks=TICKS)
    z, landmark = stream.senses.sighting.copy(), stream.senses.landmark.copy()
    landmark[:, 1:] = np.nan
    stream = stream.with_arrays({"senses.landmark": landmark})
    once = z.copy()
    z[:, :, 1, 0] = -z[:, :, 0, 1]
    once[:, :, 1, 0] = np.nan
    return stream.with_arrays({"senses.sighting": z}), stream.with_arrays({"senses.sighting": once})


@pytest.mark.parametrize("seed", [1, 2])
def test_two_linear_robots_that_lose_nothing_are_the_centralised_posterior(seed):
    stream, once = two_robots(seed)
    found = trace("channel", make("channel-pf", particles=20_000), stream)
    again = trace("again", make("channel-pf", particles=20_000, subtract=False), stream)
    shrunk = []
    for trial in range(2):
        for k in range(TICKS):
            mean, cov = dense_posterior(once, trial, k, relative=True)
            for i in range(2):
                P = cov[i, :, i]
                np.testing.assert_allclose(found.x[trial, k, i], mean[i], atol=0.15 * np.sqrt(np.trace(P)))
                np.testing.assert_allclose(found.P[trial, k, i], P, atol=0.1 * np.trace(P))
                shrunk.append(np.trace(again.P[trial, k, i]) / np.trace(P))
    assert min(shrunk) < 0.6  # counting all again would be seen


def test_a_robot_that_hears_nobody_is_arl_to_the_bit():
    _, stream = simulate("robots-1-3/n=3", trials=2, seed=3, ticks=20, drop=1.0)
    found = run({"alone": make("arl"), "channel": make("channel-pf")}, stream).traces
    np.testing.assert_array_equal(found["channel"].x, found["alone"].x)
    np.testing.assert_array_equal(found["channel"].P, found["alone"].P)


def test_a_packet_after_lost_ones_brings_the_way_that_the_sender_went_meanwhile():
    """Robot 1 is heard at the first tick and at the last; without its odometry it would be taken to stand still."""
    _, stream = linear_team(5, trials=1, robots=2, ticks=TICKS, share=1.0)
    link = stream.air.link.copy()
    link[:, 1:-1] = False
    lost = stream.with_arrays({"air.link": link})
    est = make("channel-pf", particles=500)
    s = est.init(*_of_trial(lost))
    for k in range(TICKS):
        z = _senses(lost, k)
        s = est.correct(est.predict(s, z), z)
        s = est.fuse(s, z, _mail(lost, k, est.send(s, z)))
    np.testing.assert_allclose(s.heard[0, 1, :2], np.nan_to_num(lost.senses.odometry[0, :, 1]).sum(0))
    went = s.channel.x[0, 1, 2:] - s.own.belief.x[1]
    assert np.linalg.norm(went) < 3 * np.sqrt(np.trace(s.channel.P[0, 1, 2:, 2:]))


def _of_trial(stream):
    from cooploc.estimators.interface import Rows

    key = np.array([[1, 2], [3, 4]], np.uint32)
    return Belief(stream.prior.x[0], stream.prior.P[0]), stream.world, Rows(np.zeros(2, int), np.arange(2), key)


def _senses(stream, k):
    z = stream.senses
    return z._replace(**{name: getattr(z, name)[0, k] for name in z._fields if name != "extra"})


def _mail(stream, k, packets):
    from cooploc.estimators.interface import Mail

    heard = stream.air.link[0, k]
    return Mail(heard, np.where(heard[..., None], packets[None], np.nan), np.empty((2, 0)), np.empty((2, 0)))
