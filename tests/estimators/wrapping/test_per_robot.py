"""A plain filterpy loop, wrapped, is the oracle of the batched filters; and their two engines agree."""

from types import SimpleNamespace

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from cooploc.estimators import make
from cooploc.estimators.adapters import PerRobot, mail_of, parse_belief, senses_of
from cooploc.estimators.interface import Belief, Mail, Senses
from cooploc.scenarios import simulate
from cooploc.scenarios.conformance import CHECKS, check_estimator
from cooploc.scenarios.runner.tick import EstimatorError
from cooploc.scenarios.runner.trace import trace
from cooploc.scenarios.variations import drop_readings


class RadioLoop:
    """Odometry and anchor RSSI, as one writes it from filterpy's documentation."""

    def __init__(self, prior, world, robot, key):
        self.ekf = ExtendedKalmanFilter(dim_x=2, dim_z=1)
        self.ekf.x, self.ekf.P, self.ekf.B = prior.x, prior.P, np.eye(2)
        self.anchors, self.radio, self.motion = world.anchors, world.sensors["anchor_rssi"], world.motion

    def predict(self, z):
        self.ekf.Q = np.eye(2) * self.motion.sigma**2 * z.dt / self.motion.tick
        self.ekf.predict(u=np.nan_to_num(z.odometry))  # absent: it is taken to stand still

    def correct(self, z):
        for anchor, rssi in zip(self.anchors, z.anchor_rssi, strict=True):
            if np.isfinite(rssi):
                self.ekf.update(rssi, self.slope, self.strength, self.radio.sigma**2, args=anchor, hx_args=anchor)

    def estimate(self):
        return Belief(self.ekf.x, self.ekf.P)

    def strength(self, x, anchor):
        return np.array([self.radio.A - 10 * self.radio.eta * np.log10(max(np.hypot(*(x - anchor)), 0.1))])

    def slope(self, x, anchor):
        d = x - anchor
        return -10 * self.radio.eta / np.log(10) * (d / (d @ d) if d @ d > 0.1**2 else 0 * d)[None]


class CameraLoop:
    """Wheel odometry, landmarks by range and bearing."""

    def __init__(self, prior, world, robot, key):
        self.ekf = ExtendedKalmanFilter(dim_x=3, dim_z=2)
        self.ekf.x, self.ekf.P = prior.x, prior.P
        self.landmarks, self.camera, self.motion = world.landmarks, world.sensors["landmark"], world.motion

    def predict(self, z):
        (v, omega), (x, y, a), dt = np.nan_to_num(z.odometry), self.ekf.x, z.dt
        c, s = np.cos(a + omega * dt / 2), np.sin(a + omega * dt / 2)
        self.ekf.F = np.array([[1, 0, -v * dt * s], [0, 1, v * dt * c], [0, 0, 1]])
        G = np.array([[c, -v * dt * s / 2], [s, v * dt * c / 2], [0, 1]])
        self.ekf.Q = G @ np.diag([self.motion.sigma_v**2, self.motion.sigma_omega**2]) @ G.T * dt * self.motion.tick
        self.ekf.predict()
        self.ekf.x = np.array([x + v * dt * c, y + v * dt * s, a + omega * dt])

    def correct(self, z):
        R = np.diag([self.camera.sigma_range**2, self.camera.sigma_bearing**2])
        for q, reading in zip(self.landmarks, z.landmark, strict=True):
            if np.isfinite(reading).all() and reading[0] >= 0.2:  # nearer than that, a range tells no direction
                self.ekf.update(reading, slopes, sight, R, args=(q,), hx_args=(q,), residual=turned)

    def estimate(self):
        x, y, a = self.ekf.x
        return Belief(np.array([x, y, np.arctan2(np.sin(a), np.cos(a))]), self.ekf.P)


def sight(x, q):
    return np.array([np.hypot(*(q - x[:2])), np.arctan2(q[1] - x[1], q[0] - x[0]) - x[2]])


def slopes(x, q):
    dx, dy = q - x[:2]
    r = np.hypot(dx, dy)
    return np.array([[-dx / r, -dy / r, 0], [dy / r**2, -dx / r**2, -1]])


def turned(z, h):
    y = z - h
    return np.array([y[0], np.arctan2(np.sin(y[1]), np.cos(y[1]))])


radio_loop = PerRobot(RadioLoop, uses=("odometry", "anchor_rssi"))
camera_loop = PerRobot(CameraLoop, uses=("odometry", "landmark"))


@pytest.mark.parametrize("robots", [1, 3])
@pytest.mark.parametrize(("world", "loop"), [("robots-1-3", radio_loop), ("camera", camera_loop)])
def test_a_filterpy_loop_is_ekf_local(world, loop, robots):
    stream = simulate(f"{world}/n={robots}", seed=5, trials=3, ticks=60)[1]
    stream = drop_readings(stream, np.random.default_rng(0))
    a, b = trace("loop", loop, stream), trace("it", make("ekf-local", anchor_reading="rssi", gate=np.inf), stream)
    np.testing.assert_allclose(a.x[..., :2], b.x[..., :2], rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * a.x[..., 2:]), np.exp(1j * b.x[..., 2:]), rtol=0, atol=1e-9)
    np.testing.assert_allclose(a.P, b.P, rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("loop", [radio_loop, camera_loop])
def test_an_adapted_loop_passes_every_check(loop):
    report = check_estimator(loop)
    assert report.passed, report.table()
    assert report.ran == len(CHECKS)
    assert "exempt" in report["immutability"].detail


class Talker:
    """Dead reckoning in a plane that is drawn to whom it hears."""

    def __init__(self, prior, world, robot, key):
        self.x, self.P, self.robot, self.key = prior.x, prior.P, robot, key

    def predict(self, z):
        self.x += z.odometry

    def correct(self, z):
        pass

    def send(self):
        return self.x

    def fuse(self, mail):
        for packet in mail.packets[mail.heard]:
            self.x += 0.01 * (packet - self.x)

    def estimate(self):
        return Belief(self.x.copy(), self.P)


def test_ranges_that_tell_no_direction_are_absent_for_a_plain_class():
    nan, empty = np.nan, np.zeros((1, 0))
    seen = {"landmark": np.array([[[0.1, 1.0], [0.3, 2.0]]]), "sighting": np.array([[[nan, nan], [0.19, 3.0]]])}
    z = Senses(np.zeros((1, 2)), np.ones(1), empty, **seen, extra={})
    mail = Mail(np.ones((1, 3), bool), np.zeros((1, 3, 0)), np.zeros((1, 3)), np.array([[0.0, 0.2, nan]]))
    np.testing.assert_array_equal(senses_of(z, 0).landmark, [[nan, nan], [0.3, 2.0]])
    np.testing.assert_array_equal(senses_of(z, 0).sighting, np.full((2, 2), nan))
    np.testing.assert_array_equal(mail_of(mail, 0).range, [nan, 0.2, nan])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"send": lambda self: np.zeros(self.robot + 1)}, r"packets of \[1, 2, 3\] numbers; fill the shorter ones"),
        ({"send": lambda self: None}, r"send\(\) returned None; it must be .*, all nan where nothing is sent"),
        ({"send": lambda self: np.zeros((2, 2))}, r"shape \(2, 2\); it must be one axis"),
        (
            {"estimate": lambda self: Belief(self.x[:1], self.P)},
            r"x of shape \(1,\) a robot, not \(2,\): a pose there is x, y$",
        ),
        ({"estimate": lambda self: Belief(self.x, self.P[0])}, r"P of shape \(2,\) a robot, not \(2, 2\)"),
        ({"estimate": lambda self: Belief(self.x, np.nan * self.P)}, "P is not finite in 'robots-1-3/n=3"),
        ({"estimate": lambda self: self.x}, r"returned ndarray; it must be cl.Belief\(x, P\)"),
    ],
)
def test_what_an_object_does_wrong_is_named(wrong, words):
    with pytest.raises((ValueError, EstimatorError), match=words):
        trace("plain", PerRobot(type("Wrong", (Talker,), wrong)), simulate("robots-1-3/n=3", ticks=2)[1])


def test_a_belief_is_read_in_the_forms_in_which_libraries_keep_it():
    column = np.array([[1.0], [2.0], [3 * np.pi / 2]])
    found = parse_belief(SimpleNamespace(x=column, P=np.eye(3)))
    np.testing.assert_allclose(found.x, [1, 2, -np.pi / 2], atol=1e-15)
    for off, mended in ((1e-12, True), (1e-3, False)):  # of rounding, or left to be refused
        P = np.eye(2) + off * np.array([[0, 1], [0, 0]])
        found = parse_belief(SimpleNamespace(estimate=lambda P=P: (np.zeros(2), P))).P
        assert np.array_equal(found, found.T) == mended
    with pytest.raises(AttributeError, match=r"neither estimate\(\) nor x and P: return cl.Belief"):
        parse_belief(SimpleNamespace(x=np.zeros(2)))
