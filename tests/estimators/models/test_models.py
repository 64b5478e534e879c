"""Motion and sensor models against finite differences and against sampling."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles import is_covariance, repeatable, slope

from cooploc.estimators.models import Bearing, Displacement, GradientDoa, LogDistance, Range, Sighting, Unicycle

DOA = GradientDoa(LogDistance(), (1.0, -2.0), (6.0, 4.0))
SENSORS = [LogDistance(-35.0, 2.2, 1.5), Range(0.2), Bearing(0.1), Sighting(0.3, 0.05), DOA]
COMPASS, WHEELS = Displacement(0.1, 0.5), Unicycle(0.2, 0.3, 0.1)
MOTIONS = [(COMPASS, 2), (COMPASS, 3), (WHEELS, 3)]
SHAPES = {
    "unbatched": ((), ()),
    "rows": ((5,), (5,)),
    "rows, one place": ((5,), ()),
    "particles": ((5, 7), (5, 1)),
    "one robot's particles": ((7,), (1,)),
}
named = pytest.mark.parametrize("sensor", SENSORS, ids=lambda s: type(s).__name__)
shaped = pytest.mark.parametrize(("lead", "of_place"), SHAPES.values(), ids=SHAPES)
wide = pytest.mark.parametrize("d", [2, 3])
moving = pytest.mark.parametrize(
    ("motion", "d"), MOTIONS, ids=lambda p: type(p).__name__ if not isinstance(p, int) else f"d={p}"
)


def states(rng, lead, d):
    """Positions inside the DOA's arena and well away from its centre's singularity, headings anywhere."""
    x = np.concatenate([rng.uniform(1.3, 3.4, (*lead, 1)), rng.uniform(-1.8, -0.3, (*lead, 1))], -1)
    return np.concatenate([x, rng.uniform(-np.pi, np.pi, (*lead, d - 2))], -1)


@named
@shaped
@wide
def test_jacobians_are_those_of_the_innovation(sensor, lead, of_place, d):
    rng = np.random.default_rng(1)
    x, q = states(rng, lead, d), rng.uniform([4, 1], [6, 2], (*of_place, 2))
    k = len(sensor.R)
    z = rng.uniform(1, 2, (*of_place, k))
    y, H, Hq = sensor.innovation(x, q, z)
    assert (y.shape, H.shape, Hq.shape) == ((*lead, k), (*lead, k, d), (*lead, k, 2))
    # y = z - h, so its slope is -H
    np.testing.assert_allclose(H, slope(lambda at: -sensor.innovation(at, q, z)[0], x), atol=1e-5)
    q = np.broadcast_to(q, (*lead, 2))
    np.testing.assert_allclose(Hq, slope(lambda at: -sensor.innovation(x, at, z)[0], q), atol=1e-5)


@named
@wide
def test_innovation_of_the_expected_reading_is_zero(sensor, d):
    rng = np.random.default_rng(2)
    x, q = states(rng, (20,), d), rng.uniform([4, 1], [6, 2], (20, 2))
    away = q - x[:, :2]
    distance = np.hypot(*away.T)
    heading = x[:, 2] if d == 3 else 0.0
    bearing = np.arctan2(away[:, 1], away[:, 0]) - heading
    corner = np.array([1.0, -2.0]) + np.array([[0, 0], [0, 4], [6, 4], [6, 0]])
    S = [-30 * np.log10(np.hypot(*(x[:, :2] - c).T)) for c in corner]
    toward = np.arctan2((S[1] + S[2] - S[0] - S[3]) / 8, (S[2] + S[3] - S[0] - S[1]) / 12)
    reading = {
        LogDistance: (-35 - 22 * np.log10(distance))[:, None],
        Range: distance[:, None],
        Bearing: bearing[:, None],
        Sighting: np.stack([distance, bearing], -1),
        GradientDoa: toward[:, None],
    }[type(sensor)]
    y, _, _ = sensor.innovation(x, q, reading)
    np.testing.assert_allclose(y, 0, atol=1e-12)


@named
def test_absent_reading_stays_absent_and_keeps_the_jacobian(sensor):
    y, H, Hq = sensor.innovation(np.array([2.0, -1.0, 0.3]), np.array([4.0, 1.0]), np.full(len(sensor.R), np.nan))
    assert np.isnan(y).all()
    assert np.isfinite([*H.flat, *Hq.flat]).all()


@given(
    st.floats(-np.pi, np.pi),
    st.floats(-np.pi, np.pi),
    st.sampled_from([-4 * np.pi, -2 * np.pi, 0.0, 2 * np.pi, 6 * np.pi]),
)
@repeatable
def test_bearing_innovation_is_wrapped(heading, reading, turns):
    x, q = np.array([0.0, 0.0, heading]), np.array([-3.0, 0.0])  # straight behind: bearings jump at pi
    for sensor, z in ((Bearing(), np.array([reading])), (Sighting(), np.array([3.0, reading]))):
        y = sensor.innovation(x, q, z)[0][-1]
        z[-1] += turns
        again = sensor.innovation(x, q, z)[0][-1]
        assert -np.pi <= y <= np.pi
        assert abs(np.exp(1j * y) - np.exp(1j * (reading - np.pi + heading))) < 1e-9
        assert abs(np.exp(1j * y) - np.exp(1j * again)) < 1e-9


def test_rssi_is_clamped_below_ten_centimetres():
    sensor, q = LogDistance(-40.0, 3.0), np.zeros(2)
    near = np.array([[0.1, 0.0], [0.06, 0.0], [0.0, -0.01], [0.0, 0.0]])
    np.testing.assert_allclose(sensor.level(near, q), -10.0)
    np.testing.assert_array_equal(sensor.slope(near[1:], q), 0)
    assert sensor.level(np.array([1.0, 0.0]), q) == pytest.approx(-40)
    assert sensor.level(np.array([0.0, 10.0]), q) == pytest.approx(-70)


def test_range_readings_below_twenty_centimetres_are_absent():
    x, q = np.array([1.0, 0.0]), np.zeros(2)
    for reading, refused in ((0.19, True), (-0.4, True), (0.0, True), (0.2, False), (3.0, False)):
        assert np.isnan(Range().innovation(x, q, np.array([reading]))[0]).all() == refused
        assert np.isnan(Sighting().innovation(x, q, np.array([reading, 0.1]))[0]).any() == refused


def test_curvature_is_half_the_trace_of_the_hessian_and_never_negative():
    rng = np.random.default_rng(5)
    x, q, a = rng.normal(size=(9, 2)) * 4, rng.normal(size=(9, 2)), rng.normal(size=(9, 2, 2))
    D = a @ a.mT
    shift, extra = Range().curvature(x, q, D)
    for i in range(9):
        d = np.hypot(*(x[i] - q[i]))
        u = (x[i] - q[i]) / max(d, 0.2)
        M = (np.eye(2) - np.outer(u, u)) / max(d, 0.2)
        assert shift[i, 0] == pytest.approx(np.trace(M @ D[i]) / 2)
        assert extra[i, 0, 0] == pytest.approx(np.trace(M @ D[i] @ M @ D[i]) / 2)
    assert (shift >= 0).all()


def drive(rng, lead, of_u, d):
    """States, odometry and times."""
    return states(rng, lead, d), rng.normal(0, 2, (*of_u, 2)), rng.uniform(0.1, 0.5, of_u)


@moving
@shaped
def test_moving_has_the_jacobian_it_says(motion, lead, of_place, d):
    rng = np.random.default_rng(6)
    x, u, dt = drive(rng, lead, of_place, d)
    moved, F, Q = motion.move(x, u, dt)
    assert moved.shape == (*lead, d)
    assert np.broadcast_shapes(F.shape, Q.shape, (*lead, d, d)) == (*lead, d, d)
    x[..., 2:] /= 10  # away from where the heading wraps
    _, F, _ = motion.move(x, u / 10, dt)
    by_difference = slope(lambda at: motion.move(at, u / 10, dt)[0], x)
    np.testing.assert_allclose(np.broadcast_to(F, by_difference.shape), by_difference, atol=1e-6)


@moving
def test_process_noise_is_the_covariance_of_the_samples(motion, d):
    rng = np.random.default_rng(9)
    x, u, _ = drive(rng, (), (), d)
    x[2:] = 0.4
    n = 200_000
    sampled = motion.sample(np.broadcast_to(x, (n, d)), u / 4, np.full(n, 0.1), rng.normal(size=(n, 2)))
    moved, _, Q = motion.move(x, u / 4, np.array(0.1))
    np.testing.assert_allclose(sampled.mean(0), moved, atol=0.002)
    np.testing.assert_allclose(np.cov(sampled.T), Q, atol=0.015 * Q.max())
    assert is_covariance(Q)


@pytest.mark.parametrize("motion", [COMPASS, WHEELS], ids=["compass", "wheels"])
@given(speed=st.floats(-2, 2), turn=st.floats(-3, 3), heading=st.floats(-np.pi, np.pi))
@repeatable
def test_headings_stay_in_their_interval_and_angles_continue(motion, speed, turn, heading):
    x = np.array([1.0, 2.0, heading])
    moved, _, _ = motion.move(x, np.array([speed, turn]), np.array(1.0))
    turned = turn if isinstance(motion, Unicycle) else 0.0
    assert -np.pi <= moved[2] <= np.pi
    assert abs(np.exp(1j * moved[2]) - np.exp(1j * (heading + turned))) < 1e-9


@moving
def test_absent_odometry_says_did_not_move(motion, d):
    rng = np.random.default_rng(11)
    x, u, dt = drive(rng, (6,), (6,), d)
    u[2] = np.nan
    still, noise, trail = np.zeros_like(u), rng.normal(size=(6, 2)), rng.normal(size=(6, 4, 2))
    moved, zero = motion.move(x, u, dt), motion.move(x, still, dt)
    for a, b in zip(moved, zero, strict=True):
        assert np.isfinite(a).all()
        np.testing.assert_array_equal(a[2], b[2])
    np.testing.assert_array_equal(moved[0][2, :2], x[2, :2])
    np.testing.assert_array_equal(motion.sample(x, u, dt, noise)[2], motion.sample(x, still, dt, noise)[2])
    np.testing.assert_array_equal(motion.retrace(trail, u, dt)[2], trail[2])


@moving
def test_retraced_places_are_where_the_robot_was(motion, d):
    """A noise-free drive of 200 steps: the past, seen from the present pose, comes back."""
    rng = np.random.default_rng(12)
    x, _, _ = drive(rng, (3,), (3,), d)
    path, trail = [x[:, :2]], np.zeros((3, 1, 2))
    for _ in range(200):
        u, dt = rng.normal(0, 1, (3, 2)), rng.uniform(0.1, 0.5, 3)
        x, _, _ = motion.move(x, u, dt)
        trail = np.concatenate([motion.retrace(trail, u, dt), np.zeros((3, 1, 2))], 1)
        path.append(x[:, :2])
    back = np.stack([motion.place(x, trail[:, k]) for k in range(201)])
    np.testing.assert_allclose(back, np.stack(path), atol=1e-11)
