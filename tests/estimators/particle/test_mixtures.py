"""Mixtures of Gaussians: readings of senders that are mixtures, and particles as clusters."""

import numpy as np
import pytest

from cooploc.estimators.mixtures import Mixture, clusters, sample, weigh, weigh_reference
from cooploc.estimators.models import Bearing, LogDistance, Range, Sighting
from cooploc.estimators.particle_likelihood import log_density


@pytest.mark.parametrize(("sensor", "low", "high"), [(Range(0.1), 0.1, 6.0), (LogDistance(), -70.0, -35.0)])
def test_the_loop_is_the_numpy_form(rng, sensor, low, high):
    w, L = rng.uniform(0.1, 1, (5, 4, 3)), 0.3 * rng.normal(size=(5, 4, 3, 2, 2))
    sent = Mixture(w / w.sum(-1, keepdims=True), rng.uniform(0, 6, (5, 4, 3, 2)), L @ L.mT)
    absent = rng.uniform(size=w.shape) < 0.2
    for part in sent:
        part[absent] = np.nan
    x, z, start = rng.uniform(0, 6, (5, 33, 2)), rng.uniform(low, high, (5, 4, 1)), rng.normal(size=(5, 33))
    z[rng.uniform(size=z.shape) < 0.2] = np.nan
    fast, slow = weigh(sensor, sent, z, x, start), weigh_reference(sensor, sent, z, x, start)
    shared = slow - fast  # a constant of each row: the loop computes in units of the sensor's noise
    np.testing.assert_allclose(shared, shared[:, :1] + np.zeros_like(shared), atol=1e-8)
    assert np.ptp(fast - start, axis=-1).min() > 1


@pytest.mark.parametrize(
    ("sensor", "z"), [(Range(0.2), [2.0]), (LogDistance(), [-52.0]), (Sighting(0.2, 0.1), [2.0, 0.4])]
)
def test_the_likelihood_is_the_integral_over_the_senders_place(rng, sensor, z):
    """By drawing the sender a hundred thousand times, with no linearisation; one that is known to 5 cm."""
    w, m = np.array([0.3, 0.7]), np.array([[2.0, 1.0], [3.0, 2.5]])
    P = np.array([[[0.0025, 0.001], [0.001, 0.0016]], [[0.0016, 0.0], [0.0, 0.0025]]])
    x = np.concatenate([rng.uniform(0.5, 1.5, (1, 6, 2)), rng.uniform(-0.5, 0.5, (1, 6, 1))], -1)
    sent = Mixture(w[None, None], m[None, None], P[None, None])
    got = weigh_reference(sensor, sent, np.array([[z]]), x, np.zeros((1, 6)))[0]
    k = rng.choice(2, 100_000, p=w)
    q = m[k] + (np.linalg.cholesky(P)[k] @ rng.normal(size=(100_000, 2, 1)))[..., 0]
    y, _, _ = sensor.innovation(x[0, :, None], q, np.array(z))
    drawn = np.exp(-0.5 * (y**2 / np.diag(sensor.R)).sum(-1)).mean(-1) / np.sqrt(np.linalg.det(sensor.R))
    np.testing.assert_allclose(np.exp(got), drawn, rtol=0.1, atol=1e-3 * drawn.max())


def test_a_reading_of_which_a_part_is_absent_says_nothing():
    y = np.array([[1.0, np.nan], [np.nan, np.nan], [1.0, 2.0]])
    np.testing.assert_array_equal(log_density(y, np.eye(2)), [0.0, 0.0, -2.5])
    assert log_density(np.array([3.0]), Bearing(0.5).R) == -18 - np.log(0.25) / 2


@pytest.mark.parametrize("K", [1, 2, 5, 8])
def test_clusters_halve_the_widest_at_its_mean(rng, K):
    """Against the same by lists of members, in plain numpy."""
    x, w = rng.normal(size=(3, 60, 2)) * [1.0, 0.5], rng.uniform(size=(3, 60))
    w /= w.sum(-1, keepdims=True)
    got = clusters(x, w, K)
    for r in range(3):

        def describe(members, x=x[r], w=w[r]):
            mean = np.average(x[members], 0, w[members])
            return w[members].sum(), mean, np.cov(x[members].T, aweights=w[members], ddof=0)

        groups = [np.arange(60)]
        while len(groups) < K:
            variances = np.array([np.diag(describe(members)[2]) for members in groups])
            widest, axis = np.unravel_index(variances.argmax(), variances.shape)
            members = groups[widest]
            above = x[r, members, axis] > describe(members)[1][axis]
            groups[widest] = members[~above]
            groups.append(members[above])
        for k, (share, mean, P) in enumerate(map(describe, groups)):
            np.testing.assert_allclose(got.w[r, k], share)
            np.testing.assert_allclose(got.x[r, k], mean)
            np.testing.assert_allclose(got.P[r, k], P, atol=1e-12)


@pytest.mark.parametrize("u", [0.001, 0.5, 0.999])
def test_a_sample_has_each_particle_as_often_as_its_weight_says(rng, u):
    x, logw = rng.normal(size=(1, 6, 2)), np.log([[1e-9, 0.25, 1e-9, 0.5, 0.25, 1e-9]])
    places = sample(x, logw, np.array([u]), 8)[0, 3:].reshape(8, 2)
    w = np.exp(logw[0])
    mean = w @ x[0] / w.sum()
    drawn = mean + (places - mean) / np.sqrt(1 - 8 ** (-1 / 3))
    np.testing.assert_allclose(drawn, x[0, [1, 1, 3, 3, 3, 3, 4, 4]], atol=1e-6)
