"""Reciprocal sampling: what it is without draws, what it draws, and how many."""

import numpy as np
import pytest

from cooploc.estimators import make
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Belief, Mail, Rows, Senses, World
from cooploc.estimators.mixtures import Mixture
from cooploc.estimators.models import Displacement, LogDistance, Range, Sighting
from cooploc.estimators.reciprocal_pf import sample_places
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.run import run

W, M = np.array([0.25, 0.75]), np.array([[1.0, 2.0], [4.0, 3.0]])
P = np.array([[[0.3, 0.1], [0.1, 0.2]], [[0.1, -0.05], [-0.05, 0.4]]])
SENT = Mixture(W[None, None], M[None, None], P[None, None])
KEY = np.array([[5, 6]], np.uint32)
DRAWS = 200_000


@pytest.mark.parametrize(("name", "reading"), [("mrsl-distance", "range"), ("mrsl-rssi", "rssi")])
def test_without_draws_and_with_one_cluster_it_is_mrsl(name, reading):
    _, stream = simulate("robots-1-3/n=3", trials=2, seed=3, ticks=15, drop=0.3)
    made = {"mrsl": make(name), "drawn": make("reciprocal-pf", reading=reading)}
    made["product"] = make("reciprocal-pf", alpha=0.0, clusters=1, reading=reading)
    found = run(made, stream).traces
    np.testing.assert_allclose(found["product"].x, found["mrsl"].x, atol=1e-6)
    np.testing.assert_allclose(found["product"].P, found["mrsl"].P, atol=1e-6)
    assert np.abs(found["drawn"].x - found["mrsl"].x).max() > 0.05


def polar_moments(away, angle, weight):
    """Mean and covariance of q - away (cos, sin) by sums over the nodes of a quadrature, q ~ sum_k w_k N(m_k, P_k)."""
    arm = np.stack([away * np.cos(angle), away * np.sin(angle)], -1)
    arm_mean = weight @ arm / weight.sum()
    mean = W @ M - arm_mean
    within = np.einsum("k,kij->ij", W, P) + np.einsum("k,ki,kj->ij", W, M - W @ M, M - W @ M)
    around = np.einsum("c,ci,cj->ij", weight, arm - arm_mean, arm - arm_mean) / weight.sum()
    return mean, within + around


CASES = {
    "range": (Range(0.4), [2.0], lambda t: 2.0 + 0.4 * t, None),
    "rssi": (LogDistance(), [-52.0], lambda t: 10 ** ((-40 + 52 - 5**0.5 * t) / 30), None),
    "sighting": (Sighting(0.3, 0.2), [2.0, 0.5], lambda t: 2.0 + 0.3 * t, lambda t: 0.7 + 0.5 + 0.2 * t),
}


@pytest.mark.parametrize("case", CASES)
def test_places_have_the_moments_of_the_detection_model_by_quadrature(case):
    sensor, z, distance, direction = CASES[case]
    got = sample_places(sensor, SENT, np.array([[z]]), np.ones((1, DRAWS), bool), np.full((1, DRAWS), 0.7), KEY, 3)
    t, w = np.polynomial.hermite_e.hermegauss(40)
    angles, v = (np.linspace(0, 2 * np.pi, 64, endpoint=False), np.ones(64)) if direction is None else (direction(t), w)
    away, angle = (grid.ravel() for grid in np.meshgrid(distance(t), angles))
    mean, cov = polar_moments(away, angle, np.outer(v, w).ravel())
    np.testing.assert_allclose(got.mean(0), mean, atol=5 * np.sqrt(np.trace(cov) / DRAWS))
    np.testing.assert_allclose(np.cov(got.T), cov, atol=0.02 * np.trace(cov))


WORLD = World(2, 1.0, np.array([[0.0, 0.0], [6.0, 6.0]]), Displacement(0.01), {"radio_range": Range(0.1)})
ROWS = Rows(np.zeros(2, int), np.arange(2), np.array([[1, 2], [3, 4]], np.uint32))


def after_one_detection(alpha):
    """The particles after one range of 2 m that robot 0, which believes to be 50 m off, reads of robot 1."""
    estimator = make("reciprocal-pf", anchor_reading="none", alpha=alpha, particles=5000)
    prior = Belief(np.array([[50.0, 0.0], [3.0, 3.0]]), np.tile(0.01 * np.eye(2), (2, 1, 1)))
    z = Senses(np.zeros((2, 2)), np.ones(2), np.empty((2, 0)), np.empty((2, 0, 2)), np.empty((2, 0, 2)), {})
    s = estimator.init(prior, WORLD, ROWS)
    s = estimator.correct(estimator.predict(s, z), z)
    heard = np.array([[False, True], [False, False]])
    packets = np.where(heard[..., None], estimator.send(s, z), np.nan)
    return estimator.fuse(s, z, Mail(heard, packets, np.empty((2, 0)), np.where(heard, 2.0, np.nan)))


@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.0])
def test_a_share_alpha_of_the_mass_lies_where_the_team_sees_the_robot(alpha):
    s = after_one_detection(alpha)
    w = np.exp(s.logw[0] - s.logw[0].max())
    seen = np.abs(np.linalg.norm(s.x[0] - [3.0, 3.0], axis=-1) - 2) < 1
    assert w[seen].sum() / w.sum() == pytest.approx(alpha, abs=0.03)
    assert not (np.abs(np.linalg.norm(s.x[1] - [3.0, 3.0], axis=-1) - 2) < 1).any()  # it heard nobody


def test_a_sensor_that_cannot_be_read_the_other_way_round_is_refused_unless_nothing_is_drawn():
    class Odd:
        R = np.eye(1)

    world = World(2, 1.0, WORLD.arena, WORLD.motion, {"radio_range": Odd()})
    prior = Belief(np.zeros((2, 2)), np.tile(np.eye(2), (2, 1, 1)))
    with pytest.raises(BadInput, match="has Odd: set alpha=0"):
        make("reciprocal-pf[anchor_reading=none]").init(prior, world, ROWS)
    make("reciprocal-pf[anchor_reading=none,alpha=0]").init(prior, world, ROWS)
