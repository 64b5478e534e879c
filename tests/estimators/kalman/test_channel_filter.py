"""The channel filter of a link against the centralised Kalman filter of both robots, and where it must do nothing."""

import numpy as np
import pytest
from oracles import covariances, is_covariance

from cooploc.estimators.channel_filter import Gaussian, Reading, information_gain, join, news, read

VAGUE = 1e6


def update(x, P, y, H, R):
    """The Kalman update, written out for one robot."""
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    return x + K @ y, P - K @ H @ P


def marginal(c, half):
    return Gaussian(c.x[:, half], c.P[:, half, half])


def exchanged(channel, mine, theirs, z, H, R):
    """One robot's side of an exchange: the channel and its own belief afterwards."""
    both = join(channel, news(mine, marginal(channel, slice(0, 2))), news(theirs, marginal(channel, slice(2, 4))))
    nothing = news(marginal(channel, slice(2, 4)), marginal(channel, slice(2, 4)))
    before = join(channel, news(mine, marginal(channel, slice(0, 2))), nothing)
    after = read(both, Reading(z - (H @ both.x[..., None])[..., 0], H[None], R[None]))
    gain = information_gain(after, before, mine.x)
    P = np.linalg.inv(np.linalg.inv(mine.P) + gain.Y)
    return after, Gaussian(mine.x + (P @ gain.eta[..., None])[..., 0], P)


def two_robots(rng, ticks, subtract=True, own_noise=1.0):
    """Beliefs of both robots by channel filters, and by one Kalman filter of both, at the end."""
    beliefs = [Gaussian(rng.normal(size=(1, 2)), covariances(rng, 1, d=2)) for _ in range(2)]
    x, P = np.concatenate([b.x[0] for b in beliefs]), np.zeros((4, 4))
    P[:2, :2], P[2:, 2:] = beliefs[0].P[0], beliefs[1].P[0]
    channels = [Gaussian(np.zeros((1, 4)), VAGUE * np.eye(4)[None])] * 2
    swap = np.roll(np.eye(4), 2, 0)
    H = np.array([[1.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]])  # of robot 0's place from robot 1's
    for _ in range(ticks):
        step, Q = rng.normal(size=(2, 2)), covariances(rng, 2, d=2) / 10
        x = x + step.ravel()
        P[:2, :2] += Q[0]
        P[2:, 2:] += Q[1]
        for i in range(2):
            j, own, R = 1 - i, rng.normal(size=2), own_noise * covariances(rng, d=2)
            beliefs[i] = Gaussian(beliefs[i].x + step[i], beliefs[i].P + Q[i])
            mean, cov = update(beliefs[i].x[0], beliefs[i].P[0], own - beliefs[i].x[0], np.eye(2), R)
            beliefs[i] = Gaussian(mean[None], cov[None])
            at = np.eye(4)[2 * i : 2 * i + 2]
            x, P = update(x, P, own - at @ x, at, R)
            c, noise = channels[i], np.zeros((4, 4))
            noise[:2, :2], noise[2:, 2:] = Q[i], Q[j]
            channels[i] = Gaussian(c.x + np.concatenate([step[i], step[j]]), c.P + noise)
        z, R = rng.normal(size=2), covariances(rng, d=2)
        x, P = update(x, P, z - H @ x, H, R)
        sides = [exchanged(channels[i], beliefs[i], beliefs[1 - i], z, H if i == 0 else H @ swap, R) for i in range(2)]
        beliefs = [side[1] for side in sides]
        channels = [side[0] for side in sides] if subtract else channels
    return beliefs, x, P


@pytest.mark.parametrize("ticks", [1, 2, 10])
def test_two_robots_that_lose_nothing_are_the_centralised_filter(rng, ticks):
    beliefs, x, P = two_robots(rng, ticks)
    for i, belief in enumerate(beliefs):
        half = slice(2 * i, 2 * i + 2)
        np.testing.assert_allclose(belief.x[0], x[half], atol=1e-5)
        np.testing.assert_allclose(belief.P[0], P[half, half], atol=1e-5)


def test_what_is_not_subtracted_is_counted_again_and_the_beliefs_are_over_confident(rng):
    beliefs, _, P = two_robots(rng, 10, subtract=False, own_noise=100.0)
    for i, belief in enumerate(beliefs):
        half = slice(2 * i, 2 * i + 2)
        assert np.trace(belief.P[0]) < 0.5 * np.trace(P[half, half])


def test_news_is_the_quotient_of_the_gaussians_where_the_belief_knows_more_in_every_direction(rng):
    common = Gaussian(rng.normal(size=(5, 2)), covariances(rng, 5, d=2))
    new = Gaussian(rng.normal(size=(5, 2)), covariances(rng, 5, d=2))
    Y = np.linalg.inv(new.P)
    P = np.linalg.inv(np.linalg.inv(common.P) + Y)
    shift = (P @ Y @ (new.x - common.x)[..., None])[..., 0]
    found = news(Gaussian(common.x + shift, P), common)
    np.testing.assert_allclose(found.Y, Y, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found.eta, (Y @ (new.x - common.x)[..., None])[..., 0], rtol=1e-6, atol=1e-8)
    assert all(is_covariance(one) for one in found.Y)
