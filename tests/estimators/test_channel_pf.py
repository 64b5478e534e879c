"""Channel filters over particles: two robots are the centralised filter; silence is ARL; what a lost packet costs."""

import numpy as np
import pytest
from oracles import covariances, dense_posterior, is_covariance, linear_team

from cooploc.estimators import make
from cooploc.estimators.channel_pf import information_gain, join, news
from cooploc.estimators.interface import Belief, Mail, Rows
from cooploc.estimators.kalman import kalman
from cooploc.scenarios.runner.trace import trace

TICKS = 6


def two_robots(seed):
    """The stream of two robots that read the same of each other, and the one in which each reading stands once.

    They see landmarks at the first tick only; afterwards they know of their places by what they tell each other.
    """
    _, stream = linear_team(seed, trials=2, robots=2, ticks=TICKS)
    z, landmark = stream.senses.sighting.copy(), stream.senses.landmark.copy()
    landmark[:, 1:] = np.nan
    stream = stream.replace_arrays({"senses.landmark": landmark})
    once = z.copy()
    z[:, :, 1, 0] = -z[:, :, 0, 1]
    once[:, :, 1, 0] = np.nan
    return stream.replace_arrays({"senses.sighting": z}), stream.replace_arrays({"senses.sighting": once})


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


def test_a_packet_after_lost_ones_brings_the_way_that_the_sender_went_meanwhile():
    """Robot 1 is heard at the first tick and at the last; without its odometry it would be taken to stand still."""
    _, stream = linear_team(5, trials=1, robots=2, ticks=TICKS, share=1.0)
    link = stream.air.link.copy()
    link[:, 1:-1] = False
    lost = stream.replace_arrays({"air.link": link})
    est = make("channel-pf", particles=500)
    rows = Rows(np.zeros(2, int), np.arange(2), np.array([[1, 2], [3, 4]], np.uint32))
    s, nothing = est.init(Belief(stream.prior.x[0], stream.prior.P[0]), stream.world, rows), np.empty((2, 0))
    for k in range(TICKS):
        z = lost.senses
        z = z._replace(**{name: getattr(z, name)[0, k] for name in z._fields if name != "extra"})
        s = est.correct(est.predict(s, z), z)
        heard = link[0, k]
        s = est.fuse(s, z, Mail(heard, np.where(heard[..., None], est.send(s, z)[None], np.nan), nothing, nothing))
    np.testing.assert_allclose(s.heard[0, 1, :2], np.nan_to_num(lost.senses.odometry[0, :, 1]).sum(0))
    went = s.channel.x[0, 1, 2:] - s.own.belief.x[1]
    assert np.linalg.norm(went) < 3 * np.sqrt(np.trace(s.channel.P[0, 1, 2:, 2:]))


# The channel filter of a link against the centralised Kalman filter of both robots, and where it must do nothing.

VAGUE = 1e6


def update(x, P, y, H, R):
    """The Kalman update, written out for one robot."""
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    return x + K @ y, P - K @ H @ P


def marginal(c, half):
    return Belief(c.x[:, half], c.P[:, half, half])


def exchanged(channel, mine, theirs, z, H, R):
    """One robot's side of an exchange: the channel and its own belief afterwards."""
    both = join(channel, news(mine, marginal(channel, slice(0, 2))), news(theirs, marginal(channel, slice(2, 4))))
    nothing = news(marginal(channel, slice(2, 4)), marginal(channel, slice(2, 4)))
    before = join(channel, news(mine, marginal(channel, slice(0, 2))), nothing)
    after = Belief(*kalman(*both, z - (H @ both.x[..., None])[..., 0], H[None], R[None]))
    gain = information_gain(after, before, mine.x)
    P = np.linalg.inv(np.linalg.inv(mine.P) + gain.Y)
    return after, Belief(mine.x + (P @ gain.eta[..., None])[..., 0], P)


def filtered_pair(rng, ticks):
    """Beliefs of both robots by channel filters, and by one Kalman filter of both, at the end."""
    beliefs = [Belief(rng.normal(size=(1, 2)), covariances(rng, 1, d=2)) for _ in range(2)]
    x, P = np.concatenate([b.x[0] for b in beliefs]), np.zeros((4, 4))
    P[:2, :2], P[2:, 2:] = beliefs[0].P[0], beliefs[1].P[0]
    channels = [Belief(np.zeros((1, 4)), VAGUE * np.eye(4)[None])] * 2
    swap = np.roll(np.eye(4), 2, 0)
    H = np.array([[1.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]])  # of robot 0's place from robot 1's
    for _ in range(ticks):
        step, Q = rng.normal(size=(2, 2)), covariances(rng, 2, d=2) / 10
        x = x + step.ravel()
        P[:2, :2] += Q[0]
        P[2:, 2:] += Q[1]
        for i in range(2):
            j, own, R = 1 - i, rng.normal(size=2), covariances(rng, d=2)
            beliefs[i] = Belief(beliefs[i].x + step[i], beliefs[i].P + Q[i])
            mean, cov = update(beliefs[i].x[0], beliefs[i].P[0], own - beliefs[i].x[0], np.eye(2), R)
            beliefs[i] = Belief(mean[None], cov[None])
            at = np.eye(4)[2 * i : 2 * i + 2]
            x, P = update(x, P, own - at @ x, at, R)
            c, noise = channels[i], np.zeros((4, 4))
            noise[:2, :2], noise[2:, 2:] = Q[i], Q[j]
            channels[i] = Belief(c.x + np.concatenate([step[i], step[j]]), c.P + noise)
        z, R = rng.normal(size=2), covariances(rng, d=2)
        x, P = update(x, P, z - H @ x, H, R)
        sides = [exchanged(channels[i], beliefs[i], beliefs[1 - i], z, H if i == 0 else H @ swap, R) for i in range(2)]
        beliefs = [side[1] for side in sides]
        channels = [side[0] for side in sides]
    return beliefs, x, P


@pytest.mark.parametrize("ticks", [1, 2, 10])
def test_two_robots_that_lose_nothing_are_the_centralised_filter(rng, ticks):
    beliefs, x, P = filtered_pair(rng, ticks)
    for i, belief in enumerate(beliefs):
        half = slice(2 * i, 2 * i + 2)
        np.testing.assert_allclose(belief.x[0], x[half], atol=1e-5)
        np.testing.assert_allclose(belief.P[0], P[half, half], atol=1e-5)


def test_news_is_the_quotient_of_the_gaussians_where_the_belief_knows_more_in_every_direction(rng):
    common = Belief(rng.normal(size=(5, 2)), covariances(rng, 5, d=2))
    new = Belief(rng.normal(size=(5, 2)), covariances(rng, 5, d=2))
    Y = np.linalg.inv(new.P)
    P = np.linalg.inv(np.linalg.inv(common.P) + Y)
    shift = (P @ Y @ (new.x - common.x)[..., None])[..., 0]
    found = news(Belief(common.x + shift, P), common)
    np.testing.assert_allclose(found.Y, Y, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found.eta, (Y @ (new.x - common.x)[..., None])[..., 0], rtol=1e-6, atol=1e-8)
    assert all(is_covariance(one) for one in found.Y)
