"""What the particle filters share: spreading, weighting, moments, and renewal that keeps mean and covariance."""

import numpy as np
import pytest
from oracles import covariances, is_covariance

from cooploc.estimators import random_numbers
from cooploc.estimators.interface import Belief
from cooploc.estimators.particles import mean, moments, resample, sample_prior, weights

KEY = np.array([[1, 2], [3, 4], [5, 6], [7, 8]], np.uint32)
wide = pytest.mark.parametrize("d", [2, 3])


def cloud(rng, d, n=400, heading=0.5):
    """Particles (4, n, d) and log-weights so uneven that every row is due for renewal."""
    x = rng.normal(size=(4, n, d)) * ([2.0, 0.5, 0.3][:d])
    if d == 3:
        x[..., 2] = np.angle(np.exp(1j * (x[..., 2] + heading)))
    return x, -8 * (x[..., 0] - 1) ** 2 + x[..., 1]


def circular(x, w):
    """Mean and covariance with the heading's mean as an angle and its offsets wrapped, one row at a time."""
    m = np.array([np.average(column, weights=w) for column in x.T])
    e = x - m
    if x.shape[1] == 3:
        m[2] = np.angle((w * np.exp(1j * x[:, 2])).sum())
        e[:, 2] = np.angle(np.exp(1j * (x[:, 2] - m[2])))
    return m, np.einsum("n,na,nb->ab", w, e, e)


# ---------------------------------------------------------------- spreading


@wide
def test_spread_draws_from_the_prior(d):
    P = covariances(np.random.default_rng(0), 4, d=d) * 0.05
    prior = Belief(np.random.default_rng(1).normal(size=(4, d)), P)
    n = 200_000
    x = sample_prior(prior, KEY, n)
    assert x.shape == (4, n, d)
    for r in range(4):
        standard_error = np.sqrt(np.diag(P[r]) / n)
        assert (np.abs(x[r].mean(0) - prior.x[r]) < 4.5 * standard_error).all()
        np.testing.assert_allclose(np.cov(x[r].T), P[r], atol=0.012 * P[r].max())
    assert abs(np.corrcoef(x[0, :, 0], x[1, :, 0])[0, 1]) < 5 / np.sqrt(n)


# ---------------------------------------------------------------- weights and moments


def test_a_row_without_any_weight_starts_again_from_equal_ones():
    w = weights(np.array([[-np.inf] * 4, [0.0, -np.inf, 0.0, -np.inf]]))
    np.testing.assert_array_equal(w, [[0.25] * 4, [0.5, 0, 0.5, 0]])


def test_nan_particles_propagate_and_leave_the_other_rows_alone():
    x, logw = cloud(np.random.default_rng(3), 3)
    clean = resample(x, logw, KEY, 1), moments(x, weights(logw))
    x[1, 0], logw[2, 5] = np.nan, np.nan
    for dirty, whole in zip(
        (*resample(x, logw, KEY, 1), *moments(x, weights(logw))), (*clean[0], *clean[1]), strict=True
    ):
        for r in (0, 3):
            np.testing.assert_array_equal(dirty[r], whole[r])
    belief = moments(x, weights(logw))
    assert np.isnan(belief.x[1]).any()
    assert np.isnan(belief.x[2]).any()


@wide
@pytest.mark.parametrize("heading", [0.5, np.pi, -3.0])
def test_moments_are_weighted_and_circular(d, heading):
    x, logw = cloud(np.random.default_rng(4), d, heading=heading)
    w = weights(logw)
    belief = moments(x, w)
    np.testing.assert_array_equal(mean(x, w), belief.x)
    for r in range(4):
        m, P = circular(x[r], w[r])
        np.testing.assert_allclose(belief.x[r], m, atol=1e-12)
        np.testing.assert_allclose(belief.P[r], P, atol=1e-12)
    assert is_covariance(belief.P)


# ---------------------------------------------------------------- renewal


@wide
@pytest.mark.parametrize("heading", [0.5, 3.1])
def test_renewal_keeps_mean_and_covariance(d, heading):
    n = 60_000
    x, logw = cloud(np.random.default_rng(6), d, n, heading)
    before = moments(x, weights(logw))
    new, equal = resample(x, logw, KEY, 3)
    np.testing.assert_array_equal(equal, 0)
    after = moments(new, weights(equal))
    sd = np.sqrt(np.diagonal(before.P, axis1=-2, axis2=-1))
    off = after.x - before.x
    off[:, 2:] = np.angle(np.exp(1j * off[:, 2:]))
    assert (np.abs(off) < 4 * sd / np.sqrt(n)).all()
    np.testing.assert_allclose(
        after.P / (sd[:, :, None] * sd[:, None]), before.P / (sd[:, :, None] * sd[:, None]), atol=0.03
    )


@wide
def test_rows_that_are_rich_enough_keep_every_bit(d):
    x, logw = cloud(np.random.default_rng(9), d)
    logw[1], logw[3] = 0.1 * np.sin(np.arange(400)), 0.0
    new, renewed = resample(x, logw, KEY, 2)
    for r in (1, 3):
        np.testing.assert_array_equal(new[r], x[r])
        np.testing.assert_array_equal(renewed[r], logw[r])
    for r in (0, 2):
        assert (new[r] != x[r]).any()
        np.testing.assert_array_equal(renewed[r], 0)


@pytest.mark.parametrize(
    "flat",
    [[0, 1, 2], [1], [2], [1, 2]],
    ids=["all in one point", "on a line", "one heading", "on a line with one heading"],
)
def test_renewal_takes_a_singular_cloud(flat):
    x, logw = cloud(np.random.default_rng(14), 3)
    x[..., flat] = [1.0, 2.0, 3.0][flat[0]]
    logw = logw + np.linspace(0, 50, 400)
    new, _ = resample(x, logw, KEY, 1)
    assert np.isfinite(new).all()
    np.testing.assert_allclose(new[..., flat], x[..., flat], atol=1e-7)


def test_renewal_across_pi_does_not_shrink_through_zero():
    """A mean of raw headings near pi would be near 0, and the shrinkage would drag every particle round the circle."""
    x, logw = cloud(np.random.default_rng(15), 3, n=5000, heading=np.pi)
    new, _ = resample(x, logw, KEY, 1)
    assert (np.abs(new[..., 2]) <= np.pi).all()
    assert (np.abs(new[..., 2]) > np.pi - 2).all()
    assert random_numbers.PURPOSES >= 7
