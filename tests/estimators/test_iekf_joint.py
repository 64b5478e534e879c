"""The invariant joint EKF: matrices of SE(2) and numerical slopes, turned worlds, and what a team cannot know."""

from dataclasses import replace

import numpy as np
import pytest
from oracles import slope
from scipy.linalg import block_diag, expm, logm

import cooploc as cl
from cooploc.estimators.kalman import kalman
from cooploc.estimators.models import Unicycle
from cooploc.scenarios.runner.tick import make_loop

PLAIN = "ekf-joint[iterations=1,second_order=false,lost=1]"


def _matrix(x):
    c, s = np.cos(x[2]), np.sin(x[2])
    return np.array([[c, -s, x[0]], [s, c, x[1]], [0, 0, 1]])


def _pose(X):
    return np.array([X[0, 2], X[1, 2], np.arctan2(X[1, 0], X[0, 0])])


def _exp(xi):
    return expm(np.array([[0, -xi[2], xi[0]], [xi[2], 0, xi[1]], [0, 0, 0]]))


def _log(X):
    a = np.real(logm(X))
    return np.array([a[0, 2], a[1, 2], a[1, 0]])


class OnMatrices:
    """The right-invariant EKF of a team: X = exp(xi) X^, and every slope taken numerically."""

    def __init__(self, prior):
        self.X = [_matrix(x) for x in prior.x]
        self.P = block_diag(
            *(np.linalg.inv(self._turn(x)) @ P @ np.linalg.inv(self._turn(x)).T for x, P in zip(*prior, strict=True))
        )

    @staticmethod
    def _turn(x):
        return slope(lambda xi: np.stack([_pose(_exp(e) @ _matrix(x)) for e in np.atleast_2d(xi)]), np.zeros((1, 3)))[0]

    def move(self, motion, u, dt):
        for i, X in enumerate(self.X):

            def moved(w, X=X, i=i):
                return _matrix(motion.move(_pose(X), u[i] + w / dt, dt)[0])

            def error(w):
                return np.stack([_log(moved(e) @ np.linalg.inv(moved(np.zeros(2)))) for e in np.atleast_2d(w)])

            G = slope(error, np.zeros((1, 2)))[0]
            at = slice(3 * i, 3 * i + 3)
            self.P[at, at] += G @ np.diag([motion.sigma_v**2, motion.sigma_omega**2]) * motion.tick * dt @ G.T
            self.X[i] = moved(np.zeros(2))

    def read(self, sensor, readings):
        """Readings (robot, place or robot, z), all linearised at one place."""
        if not readings:
            return

        def innovation(xi):
            x = [_pose(_exp(xi[3 * k : 3 * k + 3]) @ X) for k, X in enumerate(self.X)]
            places = [x[place][:2] if isinstance(place, int) else place for _, place, _ in readings]
            y = [sensor.innovation(x[i], q, z)[0] for (i, _, z), q in zip(readings, places, strict=True)]
            return np.concatenate(y)

        size = len(self.P)
        H = -slope(lambda xi: np.stack([innovation(e) for e in np.atleast_2d(xi)]), np.zeros((1, size)))[0]
        R = block_diag(*[sensor.R] * len(readings))
        xi, self.P = kalman(np.zeros(size), self.P, innovation(np.zeros(size)), H, R)
        self.X = [_exp(xi[3 * k : 3 * k + 3]) @ X for k, X in enumerate(self.X)]

    def belief(self):
        x = np.stack([_pose(X) for X in self.X])
        T = [self._turn(pose) for pose in x]
        return x, np.stack([T[i] @ self.P[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] @ T[i].T for i in range(len(x))])


@pytest.mark.slow
def test_it_is_the_filter_on_matrices_with_numerical_slopes():
    _, stream = cl.simulate("camera/n=2[ticks=8,prior_heading=0.3]", trials=1, seed=18)
    trace = cl.run({"iekf": cl.make("iekf-joint", gate=np.inf)}, stream).traces["iekf"]
    world, z, oracle = stream.world, stream.senses, OnMatrices(type(stream.prior)(*(a[0] for a in stream.prior)))
    used = 0
    for k in range(8):
        oracle.move(world.motion, z.odometry[0, k], 0.1)
        for place, q in enumerate(world.landmarks):
            read = [(i, q, z.landmark[0, k, i, place]) for i in range(2)]
            oracle.read(world.sensors["landmark"], [r for r in read if np.isfinite(r[2]).all()])
        read = [(i, 1 - i, z.sighting[0, k, i, 1 - i]) for i in range(2)]
        seen = [r for r in read if np.isfinite(r[2]).all()]
        oracle.read(world.sensors["sighting"], seen)
        used += len(seen)
        x, P = oracle.belief()
        np.testing.assert_allclose(trace.x[0, k], x, atol=1e-6)
        np.testing.assert_allclose(trace.P[0, k], P, atol=1e-6)
    assert used > 3


def test_with_a_compass_it_is_the_plain_joint_ekf():
    _, stream = cl.simulate("robots-1-3/n=3[ticks=40]", trials=3, seed=4)
    traces = cl.run([PLAIN, "iekf-joint"], stream).traces
    np.testing.assert_allclose(traces["iekf-joint"].x, traces[PLAIN].x, atol=1e-9)
    np.testing.assert_allclose(traces["iekf-joint"].P, traces[PLAIN].P, atol=1e-9)


def test_without_landmarks_a_team_learns_nothing_of_its_common_heading_but_the_ekf_believes_it_does():
    """Exact odometry: what is known of a motion of the whole team must stay what the prior said."""
    _, stream = cl.simulate("camera/n=3[ticks=100,prior_heading=0.3]", trials=3, seed=4)
    world = replace(stream.world, motion=Unicycle(1e-6, 1e-6, 0.1))
    stream = replace(stream, world=world)
    before = _of_heading(stream.prior.x, np.stack([block_diag(*P) for P in stream.prior.P]))
    gained = {}
    for name in ("iekf-joint", PLAIN):
        x, P = _last_state(cl.make(name, anchor_reading="none", gate=np.inf), stream)
        gained[name] = _of_heading(x, P) / before
    np.testing.assert_allclose(gained["iekf-joint"], 1, rtol=1e-5)
    assert gained[PLAIN].max() > 1.05


def _of_heading(x, P):
    """Information (t,) [1/rad^2] on a turn of the whole team about the origin."""
    N = np.stack([-x[..., 1], x[..., 0], np.ones(x.shape[:2])], -1).reshape(len(x), -1)
    return np.einsum("ti,ti->t", N, np.linalg.solve(P, N[..., None])[..., 0])


def _last_state(estimator, stream):
    running = make_loop("joint", estimator, stream)
    running.start()
    for k in range(len(stream.time)):
        running.tick(k)
    s = running.state
    return s.x, s.P.reshape(len(s.x), -1, s.x[0].size)
