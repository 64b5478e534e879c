"""The direction of arrival against its equations by hand, Monte Carlo, and what science.md says of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles import arrival, arrival_error, gradient, log_distance, repeatable
from scipy.stats import multivariate_normal, norm

from cooploc.estimators.models import GradientDoa, LogDistance, gradient_doa
from cooploc.scenarios import simulate

NOISE = 5**0.5
SQUARE = GradientDoa(LogDistance(-40.0, 3.0, NOISE), (0.0, 0.0), (6.0, 6.0))
OBLONG = GradientDoa(LogDistance(-40.0, 2.0, 3.0), (10.0, -4.0), (8.0, 3.0))
PLACES = [(5.0, 5.5), (1.0, 4.0), (3.1, 2.9), (0.2, 0.1), (3.0, 3.0)]


def test_gradient_equations_by_hand():
    """N1 .. N4 are (0,0) (0,b) (a,b) (a,0): g_x = (S3 - S2 + S4 - S1)/2a, g_y = (S3 - S4 + S2 - S1)/2b."""
    S1, S2, S3, S4 = -60.0, -50.0, -30.0, -52.0
    doa = GradientDoa(LogDistance(), (0.0, 0.0), (4.0, 5.0))
    g = doa.gradient(np.array([S1, S2, S3, S4]))
    np.testing.assert_allclose(g, [(20 + 8) / 8, (22 + 10) / 10])
    assert doa.measure(np.array([S1, S2, S3, S4])) == pytest.approx(np.arctan2(3.2, 3.5))
    np.testing.assert_allclose(doa.anchors, [[0, 0], [0, 5], [4, 5], [4, 0]])


@given(st.floats(-3, 3), st.floats(-3, 3))
@repeatable
def test_expected_direction_is_that_of_the_path_loss(east, north):
    x = np.array([3 + east, 3 + north])
    want = arrival(x[0], x[1], 6.0)
    if np.hypot(east, north) > 1e-3:
        assert abs(np.exp(1j * SQUARE.bearing(x)) - np.exp(1j * want)) < 1e-7
    g = SQUARE.expect(x)
    S = [log_distance(np.hypot(x[0] - a, x[1] - b)) for a, b in SQUARE.anchors]
    np.testing.assert_allclose(g, gradient(*S, 6.0, 6.0), atol=1e-12)


@pytest.mark.parametrize("doa", [SQUARE, OBLONG], ids=["square", "oblong"])
@pytest.mark.parametrize("place", PLACES)
def test_exact_density_is_the_histogram_of_measured_directions(doa, place):
    draws, bins = 400_000, 72
    rng = np.random.default_rng(0)
    x = np.array(doa.corner) + np.array(place) / 6 * doa.sides
    d = np.hypot(*(x - doa.anchors).T)
    S = log_distance(d, doa.rssi.A, doa.rssi.eta) + doa.rssi.sigma * rng.normal(size=(draws, 4))
    gx, gy = gradient(*S.T, *doa.sides)
    seen, edges = np.histogram(np.arctan2(gy, gx), bins, (-np.pi, np.pi))
    fine = edges[:-1, None] + (np.arange(20) + 0.5) / 20 * (2 * np.pi / bins)
    expected = draws * np.exp(doa.log_exact(x, fine)).mean(1) * 2 * np.pi / bins
    common = expected > 50
    chi2 = ((seen - expected) ** 2 / np.maximum(expected, 1))[common].sum() / common.sum()
    assert common.sum() > 5
    assert chi2 < 1 + 5 * np.sqrt(2 / common.sum())


def test_constant_density_is_a_gaussian_of_the_wrapped_error():
    x = np.array([0.5, 3.0])  # due west: the direction jumps at pi
    error = np.array([0.0, 0.2, -0.2, 1.0, -1.0])
    log = SQUARE.log_constant(x, np.angle(np.exp(1j * (SQUARE.bearing(x) + error))))
    want = norm.logpdf(error, 0, SQUARE.sigma)
    np.testing.assert_allclose(log - log[0], want - want[0], atol=1e-9)


@pytest.mark.slow
def test_sigma_is_the_rms_error_over_the_arena_and_errors_are_large_near_its_centre():
    error, x, y = arrival_error(6.0, NOISE, draws=1_000_000)
    off, square = np.hypot(x - 3, y - 3), error**2
    rms = np.sqrt(square.mean())
    standard_error = square.std() / np.sqrt(len(square)) / (2 * rms)
    assert abs(SQUARE.sigma - rms) < 4 * standard_error + 5e-4  # the second is the quadrature's own
    assert SQUARE.sigma == pytest.approx(0.39, abs=0.005)
    assert np.degrees(np.sqrt(square[off < 0.5].mean())) == pytest.approx(79, abs=2)
    assert np.degrees(np.sqrt(square[off > 3].mean())) == pytest.approx(7.5, abs=0.6)


@pytest.mark.parametrize(
    "anchors",
    [
        [[0, 0], [6, 0], [6, 6], [0, 6]],  # corners, but the other way round
        [[0, 0], [0, 6], [6, 6], [6, 0], [3, 3]],
        [[0, 0], [0, 6], [6, 6], [5, 0]],
        [],
    ],
)
def test_anchors_that_are_no_corners_are_refused_with_a_remedy(anchors):
    _, stream = simulate("trajectory", ticks=1)
    world = replace(stream.world, anchors=np.array(anchors, float).reshape(-1, 2))
    with pytest.raises(ValueError, match=r"four corner anchors.*anchor_reading='rssi'"):
        gradient_doa(world)


@pytest.mark.parametrize("doa", [SQUARE, OBLONG], ids=["square", "oblong"])
def test_the_gradient_is_a_gaussian_vector(doa):
    """Covariance of the four readings' errors through equations (1) and (2), and scipy's density."""
    weights = np.stack([doa.gradient(one) for one in np.eye(4)], 1)  # (2, 4)
    R = doa.rssi.sigma**2 * weights @ weights.T
    rng = np.random.default_rng(6)
    x = np.array(doa.corner) + rng.uniform(0, 1, (50, 2)) * doa.sides
    g = doa.expect(x) + rng.normal(size=(50, 2))
    want = [multivariate_normal.logpdf(z, m, R) for z, m in zip(g, doa.expect(x), strict=True)]
    constant = multivariate_normal.logpdf([0, 0], [0, 0], R)
    np.testing.assert_allclose(doa.log_gradient(x, g) + constant, want, rtol=1e-10)


@pytest.mark.parametrize("angle", [0.4, -2.0, 3.1])
def test_the_sum_over_the_nodes_is_written_out(angle):
    """Signed, not wrapped: by the same angle for every node, and by the direction from each."""
    for x, y in PLACES:
        one = arrival(x, y, 6.0) - angle
        err = sum(np.arctan2(y - b, x - a) - angle for a, b in [(0, 0), (0, 6), (6, 6), (6, 0)])
        here, at = np.array([x, y]), np.array(angle)
        assert SQUARE.log_sum(here, at) == pytest.approx(-0.5 * (4 * one / SQUARE.sigma) ** 2, rel=1e-9)
        assert SQUARE.log_corners(here, at) == pytest.approx(-0.5 * (err / SQUARE.sigma) ** 2, rel=1e-9)
