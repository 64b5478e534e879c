"""What the particle filters share: spreading, weighting, moments, and resampling that keeps mean and covariance."""

import filterpy.monte_carlo.resampling as filterpy_resampling
import numpy as np
import pytest
from filterpy.monte_carlo import systematic_resample
from hypothesis import given
from hypothesis import strategies as st
from oracles import covariances, is_covariance, repeatable

from cooploc.estimators.interface import Belief
from cooploc.estimators.particle_kernels import FRACTION, systematic
from cooploc.estimators.particles import moments, resample, sample_prior, weights

KEY = np.array([[1, 2], [3, 4], [5, 6], [7, 8]], np.uint32)
wide = pytest.mark.parametrize("d", [2, 3])
shares = st.lists(st.floats(0, 1), min_size=2, max_size=40).filter(lambda w: sum(w) > 1e-3)


def cloud(seed, d, n=400, heading=0.5):
    """Particles (4, n, d) and log-weights so uneven that every row is due for renewal."""
    x = np.random.default_rng(seed).normal(size=(4, n, d)) * ([2.0, 0.5, 0.3][:d])
    if d == 3:
        x[..., 2] = np.angle(np.exp(1j * (x[..., 2] + heading)))
    return x, -8 * (x[..., 0] - 1) ** 2 + x[..., 1]


@wide
def test_spread_draws_from_the_prior(d):
    P = covariances(np.random.default_rng(0), 4, d=d) * 0.05
    prior = Belief(np.random.default_rng(1).normal(size=(4, d)), P)
    n = 200_000
    x = sample_prior(prior, KEY, n)
    for r in range(4):
        standard_error = np.sqrt(np.diag(P[r]) / n)
        assert (np.abs(x[r].mean(0) - prior.x[r]) < 4.5 * standard_error).all()
        np.testing.assert_allclose(np.cov(x[r].T), P[r], atol=0.012 * P[r].max())
    assert abs(np.corrcoef(x[0, :, 0], x[1, :, 0])[0, 1]) < 5 / np.sqrt(n)


def test_a_row_without_any_weight_starts_again_from_equal_ones():
    w = weights(np.array([[-np.inf] * 4, [0.0, -np.inf, 0.0, -np.inf]]))
    np.testing.assert_array_equal(w, [[0.25] * 4, [0.5, 0, 0.5, 0]])


def test_nan_particles_propagate_and_leave_the_other_rows_alone():
    x, logw = cloud(3, 3)
    clean = *resample(x, logw, KEY, 1), *moments(x, weights(logw))
    x[1, 0], logw[2, 5] = np.nan, np.nan
    belief = moments(x, weights(logw))
    for dirty, whole in zip((*resample(x, logw, KEY, 1), *belief), clean, strict=True):
        np.testing.assert_array_equal(dirty[[0, 3]], whole[[0, 3]])
    assert np.isnan(belief.x[1:3]).any(-1).all()


@wide
@pytest.mark.parametrize("heading", [0.5, np.pi, -3.0])
def test_moments_are_weighted_and_circular(d, heading):
    """The heading's mean is an angle and its offsets are wrapped, one row at a time."""
    x, logw = cloud(4, d, heading=heading)
    w = weights(logw)
    belief = moments(x, w)
    for r in range(4):
        m = np.average(x[r], 0, w[r])
        e = x[r] - m
        if d == 3:
            m[2] = np.angle((w[r] * np.exp(1j * x[r, :, 2])).sum())
            e[:, 2] = np.angle(np.exp(1j * (x[r, :, 2] - m[2])))
        np.testing.assert_allclose(belief.x[r], m, atol=1e-12)
        np.testing.assert_allclose(belief.P[r], np.einsum("n,na,nb->ab", w[r], e, e), atol=1e-12)
    assert is_covariance(belief.P)


# ---------------------------------------------------------------- resampling


@pytest.mark.slow
@given(shares, st.integers(0, 2**53 - 1))
@repeatable
def test_ancestors_are_filterpys_for_the_same_uniform(w, bits):
    w, u = np.array(w) / np.sum(w), bits / 2**53
    at, ends = (u + np.arange(len(w))) / len(w), np.cumsum(w)
    if at[-1] >= ends[-1] or np.abs(at[:, None] - ends).min() < 4 / 2**FRACTION:
        return  # filterpy runs off the end of weights that sum to just less than one; ties are a matter of rounding
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(filterpy_resampling, "random", lambda: u)
        theirs = systematic_resample(w)
    np.testing.assert_array_equal(systematic(w[None], np.array([u]))[0], theirs)


@pytest.mark.parametrize("bad", [np.nan, -1.0, np.inf, -np.inf, 1e300])
def test_bad_weights_choose_particles_that_exist(bad):
    w = np.full((3, 40), 1 / 40)
    w[1, ::7] = bad
    chosen = systematic(w, np.full(3, 0.5))
    assert ((chosen >= 0) & (chosen < 40)).all()
    np.testing.assert_array_equal(chosen[[0, 2]], np.tile(np.arange(40), (2, 1)))


@pytest.mark.slow
@wide
@pytest.mark.parametrize("heading", [0.5, 3.1])
def test_renewal_keeps_mean_and_covariance(d, heading):
    n = 60_000
    x, logw = cloud(6, d, n, heading)
    before = moments(x, weights(logw))
    new, equal = resample(x, logw, KEY, 3)
    np.testing.assert_array_equal(equal, 0)
    after = moments(new, weights(equal))
    sd = np.sqrt(np.diagonal(before.P, axis1=-2, axis2=-1))
    off = after.x - before.x
    off[:, 2:] = np.angle(np.exp(1j * off[:, 2:]))
    assert (np.abs(off) < 4 * sd / np.sqrt(n)).all()
    np.testing.assert_allclose((after.P - before.P) / (sd[:, :, None] * sd[:, None]), 0, atol=0.03)


@wide
def test_rows_that_are_rich_enough_keep_every_bit(d):
    x, logw = cloud(9, d)
    logw[1], logw[3] = 0.1 * np.sin(np.arange(400)), 0.0
    new, renewed = resample(x, logw, KEY, 2)
    np.testing.assert_array_equal(new[1::2], x[1::2])
    np.testing.assert_array_equal(renewed[1::2], logw[1::2])
    assert (new[::2] != x[::2]).any((1, 2)).all()
    np.testing.assert_array_equal(renewed[::2], 0)


@pytest.mark.parametrize("flat", [[0, 1, 2], [1], [2], [1, 2]], ids=["point", "line", "heading", "line and heading"])
def test_renewal_takes_a_singular_cloud(flat):
    x, logw = cloud(14, 3)
    x[..., flat] = [1.0, 2.0, 3.0][flat[0]]
    new, _ = resample(x, logw + np.linspace(0, 50, 400), KEY, 1)
    assert np.isfinite(new).all()
    np.testing.assert_allclose(new[..., flat], x[..., flat], atol=1e-7)
