"""Channel filters over particles: two robots are the centralised filter; silence is ARL; what a lost packet costs."""

import numpy as np
import pytest
from oracles import covariances, dense_posterior, linear_team

from cooploc.estimators import channel_pf, make
from cooploc.estimators.interface import Belief
from cooploc.estimators.models import Range
from cooploc.scenarios.runner.trace import trace

TICKS = 6


@pytest.mark.parametrize("seed", [1, 2])
def test_two_linear_robots_that_lose_nothing_are_the_centralised_posterior(seed):
    """Both read the same of each other, which the posterior counts once; landmarks are seen at the first tick only."""
    _, stream = linear_team(seed, trials=2, robots=2, ticks=TICKS)
    z, landmark = stream.senses.sighting.copy(), stream.senses.landmark.copy()
    landmark[:, 1:], z[:, :, 1, 0] = np.nan, np.nan
    once = stream.replace_arrays({"senses.landmark": landmark, "senses.sighting": z.copy()})
    z[:, :, 1, 0] = -z[:, :, 0, 1]
    stream = once.replace_arrays({"senses.sighting": z})
    found = trace("channel", make("channel-pf", particles=20_000), stream)
    for trial in range(2):
        for k in range(TICKS):
            mean, cov = dense_posterior(once, trial, k, relative=True)
            for i in range(2):
                P = cov[i, :, i]
                np.testing.assert_allclose(found.x[trial, k, i], mean[i], atol=0.15 * np.sqrt(np.trace(P)))
                np.testing.assert_allclose(found.P[trial, k, i], P, atol=0.1 * np.trace(P))


def test_a_packet_after_lost_ones_brings_the_way_that_the_sender_went_meanwhile():
    """Robot 1 is heard at the first tick and at the last; without its odometry it would be taken to stand still."""
    _, stream = linear_team(5, trials=1, robots=2, ticks=TICKS, share=1.0)
    link = stream.air.link.copy()
    link[:, 1:-1] = False
    states = []

    def watch(method, tick, arguments, call):
        states.append(call(*arguments))
        return states[-1]

    lost = stream.replace_arrays({"air.link": link})
    trace("channel", make("channel-pf", particles=500), lost, watch)
    s = next(s for s in reversed(states) if hasattr(s, "channel"))
    np.testing.assert_allclose(s.heard[0, 1, :2], np.nan_to_num(lost.senses.odometry[0, :, 1]).sum(0))
    off = s.channel.x[0, 1, 2:] - s.own.belief.x[1]
    assert np.linalg.norm(off) < 3 * np.sqrt(np.trace(s.channel.P[0, 1, 2:, 2:]))


def test_the_news_of_a_belief_is_what_was_added_to_the_common_one(rng):
    common, Y, eta = (
        Belief(rng.normal(size=(9, 2)), covariances(rng, 9, d=2)),
        covariances(rng, 9, d=2),
        np.ones((9, 2)),
    )
    P = np.linalg.inv(np.linalg.inv(common.P) + Y)
    found = channel_pf.news(Belief(common.x + (P @ eta[..., None])[..., 0], P), common)
    np.testing.assert_allclose(found.Y, Y, atol=1e-9)
    np.testing.assert_allclose(found.eta, eta, atol=1e-9)


def test_a_range_is_compared_with_its_mean_over_both_places(rng):
    """Half a metre of doubt about each makes the mean distance longer than that of the means."""
    both = Belief(np.array([[0.0, 0.0, 2.0, 0.5]]), 0.25 * np.eye(4)[None])
    drawn = rng.multivariate_normal(both.x[0], both.P[0], 100_000)
    distance = np.hypot(*(drawn[:, :2] - drawn[:, 2:]).T)
    y, _, _ = channel_pf.linearise_both(Range(0.1), both, Belief(both.x[:, :2], both.P[:, :2, :2]), np.array([[2.0]]))
    assert y.item() == pytest.approx(2.0 - distance.mean(), abs=0.02)
