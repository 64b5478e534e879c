"""The direction of arrival against its equations by hand, Monte Carlo, and what science.md says of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles import arrival, arrival_error, gradient, log_distance, repeatable
from scipy.stats import multivariate_normal, norm

from cooploc.estimators import make
from cooploc.estimators.models import GradientDoa, LogDistance, Range, gradient_doa
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.run import run

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


@pytest.mark.parametrize(
    ("loud", "quadrant"), [(0, (-1, -1)), (1, (-1, 1)), (2, (1, 1)), (3, (1, -1))], ids=["N1", "N2", "N3", "N4"]
)
def test_direction_points_at_the_loudest_corner_in_every_quadrant(loud, quadrant):
    """arctan without its second argument would lose half of these."""
    S = np.full(4, -60.0)
    S[loud] = -40.0
    angle = SQUARE.measure(S)
    np.testing.assert_array_equal(np.sign([np.cos(angle), np.sin(angle)]), quadrant)
    assert np.tan(angle) == pytest.approx(quadrant[0] * quadrant[1])


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


def test_gradient_of_the_model_differs_from_the_true_direction_as_stated():
    """science.md: the gradient's own bias is RMS 3.2 deg and 7 deg at most."""
    cell = (np.arange(300) + 0.5) / 50
    x = np.stack(np.meshgrid(cell, cell), -1).reshape(-1, 2)
    true = np.arctan2(x[:, 1] - 3, x[:, 0] - 3)
    bias = np.degrees(np.angle(np.exp(1j * (SQUARE.bearing(x) - true))))
    assert np.sqrt((bias**2).mean()) == pytest.approx(3.2, abs=0.3)
    assert np.abs(bias).max() == pytest.approx(7, abs=0.6)


# ---------------------------------------------------------------- densities


@pytest.mark.parametrize("doa", [SQUARE, OBLONG], ids=["square", "oblong"])
@pytest.mark.parametrize("place", PLACES)
def test_exact_density_integrates_to_one(doa, place):
    angle = (np.arange(7200) + 0.5) / 7200 * 2 * np.pi - np.pi
    x = np.array(doa.corner) + np.array(place) / 6 * doa.sides
    assert np.exp(doa.log_exact(x, angle)).mean() * 2 * np.pi == pytest.approx(1, abs=1e-6)


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


@pytest.mark.parametrize("sigma", [0.05, 0.5, NOISE, 20.0])
def test_exact_density_holds_for_any_noise(sigma):
    """From almost no noise, where its terms overflow, to nothing but noise. Near the peak it is Gaussian if sharp."""
    doa = replace(SQUARE, rssi=LogDistance(sigma=sigma))
    x = np.array([5.2, 4.4])
    g = doa.expect(x)
    sd = sigma / 6 / np.hypot(*g)  # of the angle, if small
    angle = doa.bearing(x) + sd * np.linspace(-4, 4, 4001)
    log = doa.log_exact(x, angle)
    assert np.isfinite(doa.log_exact(x, np.linspace(-np.pi, np.pi, 360))).all()
    if sigma < 1:
        np.testing.assert_allclose(np.exp(log), norm.pdf(angle, doa.bearing(x), sd), atol=0.05 / sd)
        assert np.exp(log).mean() * 8 * sd == pytest.approx(1, abs=2e-3)


@pytest.mark.parametrize("form", ["log_exact", "log_constant"])
def test_absent_direction_gives_an_absent_density(form):
    density = getattr(SQUARE, form)(np.array([[1.0, 2.0], [2.0, 2.0]]), np.array([np.nan, 0.3]))
    assert np.isnan(density).tolist() == [True, False]


def test_constant_density_is_a_gaussian_of_the_wrapped_error():
    x = np.array([0.5, 3.0])  # due west: the direction jumps at pi
    error = np.array([0.0, 0.2, -0.2, 1.0, -1.0])
    log = SQUARE.log_constant(x, np.angle(np.exp(1j * (SQUARE.bearing(x) + error))))
    want = norm.logpdf(error, 0, SQUARE.sigma)
    np.testing.assert_allclose(log - log[0], want - want[0], atol=1e-9)


def test_densities_take_particles_and_rows():
    rng = np.random.default_rng(1)
    x, angle = rng.uniform(0, 6, (3, 8, 2)), rng.uniform(-3, 3, (3, 1))
    for form in (SQUARE.log_exact, SQUARE.log_constant):
        together = form(x, angle)
        assert together.shape == (3, 8)
        for r in range(3):
            np.testing.assert_allclose(together[r], [form(x[r, i], angle[r, 0]) for i in range(8)], rtol=1e-12)


# ---------------------------------------------------------------- sigma


@pytest.fixture(scope="module")
def errors():
    return arrival_error(6.0, NOISE, draws=1_000_000)


def test_sigma_is_the_rms_error_over_the_arena(errors):
    square = errors[0] ** 2
    rms = np.sqrt(square.mean())
    standard_error = square.std() / np.sqrt(len(square)) / (2 * rms)
    assert abs(SQUARE.sigma - rms) < 4 * standard_error + 5e-4  # the second is the quadrature's own
    np.testing.assert_array_equal(SQUARE.R, [[SQUARE.sigma**2]])


def test_facts_of_the_paper_preset(errors):
    error, x, y = errors
    off = np.hypot(x - 3, y - 3)

    def rms(where):
        return np.sqrt((error[where] ** 2).mean())

    assert SQUARE.sigma == pytest.approx(0.39, abs=0.005)
    assert rms(off < 3) == pytest.approx(0.43, abs=0.01)  # without the corners
    assert np.degrees(rms(off < 0.5)) == pytest.approx(79, abs=2)
    assert np.degrees(rms(off > 3)) == pytest.approx(7.5, abs=0.6)


@pytest.mark.parametrize(("eta", "sigma"), [(2.0, 1.0), (3.0, 4.0), (1.4, 4.4)])
def test_sigma_follows_path_loss_and_noise(eta, sigma):
    doa = replace(SQUARE, rssi=LogDistance(eta=eta, sigma=sigma))
    # Only their quotient matters to an angle.
    error = arrival_error(6.0, sigma * 3.0 / eta, draws=400_000)[0]
    assert doa.sigma == pytest.approx(np.sqrt((error**2).mean()), rel=0.01)


def test_sigma_does_not_depend_on_the_power_or_on_where_the_arena_lies():
    assert replace(SQUARE, rssi=LogDistance(-10.0, 3.0, NOISE), corner=(7.0, 7.0)).sigma == SQUARE.sigma


# ---------------------------------------------------------------- which worlds have one


def told(**changes):
    _, stream = simulate("trajectory", ticks=1)
    return replace(stream.world, **changes)


def test_doa_of_a_world_reads_its_corners():
    world = told(anchors=np.array([[1, 2], [1, 5], [7, 5], [7, 2]], float))
    doa = gradient_doa(world)
    assert doa.corner == (1, 2)
    assert doa.sides == (6, 3)
    assert doa.rssi == world.sensors["anchor_rssi"]


@pytest.mark.parametrize(
    "anchors",
    [
        [[0, 0], [6, 0], [6, 6], [0, 6]],  # corners, but the other way round
        [[0, 0], [0, 6], [6, 6]],
        [[0, 0], [0, 6], [6, 6], [6, 0], [3, 3]],
        [[0, 0], [0, 6], [6, 6], [5, 0]],
        [[6, 6], [6, 0], [0, 0], [0, 6]],
        [],
    ],
)
def test_anchors_that_are_no_corners_are_refused_with_a_remedy(anchors):
    world = told(anchors=np.array(anchors, float).reshape(-1, 2))
    with pytest.raises(ValueError, match=r"four corner anchors.*anchor_reading='rssi'"):
        gradient_doa(world)


def test_anchors_without_a_path_loss_model_are_refused():
    with pytest.raises(ValueError, match="Range"):
        gradient_doa(told(sensors={"anchor_rssi": Range()}))


@pytest.mark.parametrize("name", ["arl", "mrsl-rssi", "ekf-local", "ekf-joint"])
def test_estimators_refuse_such_a_world_before_the_first_tick(name):
    _, stream = simulate("trajectory", ticks=2)
    stream = replace(stream, world=told(anchors=stream.world.anchors[[0, 3, 2, 1]]))
    with pytest.raises(ValueError, match="four corner anchors"):
        run({name: make(name)}, stream)
    run({name: make(name, anchor_reading="rssi")}, stream)


# ---------------------------------------------------------------- the other forms of the density


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


def test_directions_from_the_corners_are_best_met_far_outside_the_arena():
    """Which is why that reading drives every filter away."""
    angle = np.array(0.7)
    ray = np.array([3.0, 3.0]) + np.array([[1.0], [1000.0]]) * [np.cos(0.7), np.sin(0.7)]
    near, far = SQUARE.log_corners(ray, angle)
    assert far > near + 10
