"""The reference loops that speed is measured against, as a user of filterpy or of cvxpy writes them.

`lean_loop` does the work of `mrsl-rssi[anchor_reading=rssi,particles=500]`: predict, four anchors, every neighbour with
its variance, systematic resampling below half the effective sample size, Liu and West's jitter. It is what a good numpy
user writes around filterpy's resampling: x and y apart, squared distances, a logarithm for a link's distance and one
for its variance, and no product of matrices in the loops. `Loop` is one ExtendedKalmanFilter over the whole team,
updated by one scalar reading after the other; `Filterpy` gives the runner such a loop for each trial. `ask_cvxpy`
finds a weight of covariance intersection by `Problem.solve`.
"""

import math
from typing import Any

import cvxpy as cp
import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from filterpy.monte_carlo import systematic_resample
from scipy.linalg import block_diag

from cooploc.estimators.interface import Belief, Traffic
from cooploc.estimators.models import gradient_doa

N = 500  # particles
H = 0.3 * N ** (-1 / 6)
NEAR = 0.1


def lean_loop(stream: Any, trials: int, ticks: int) -> Any:
    """Positions (trials, ticks, n, 2) of the first trials and ticks of a stream."""
    rng, told, n = np.random.default_rng(0), stream.world, stream.robots
    odometry, anchor_rssi, rssi = stream.senses.odometry, stream.senses.anchor_rssi, stream.air.rssi
    anchor, radio, sigma = told.sensors["anchor_rssi"], told.sensors["radio_rssi"], told.motion.sigma
    out = np.empty((trials, ticks, n, 2))
    for t in range(trials):
        spread = np.linalg.cholesky(stream.prior.P[t])
        x = [stream.prior.x[t, i][:, None] + spread[i] @ rng.standard_normal((2, N)) for i in range(n)]
        w = [np.full(N, 1 / N) for _ in range(n)]
        for k in range(ticks):
            said = []
            for i in range(n):
                x[i] += odometry[t, k, i][:, None] + sigma * rng.standard_normal((2, N))
                log_likelihood = np.zeros(N)
                for a, q in enumerate(told.anchors):
                    y = missed(anchor, x[i], q, anchor_rssi[t, k, i, a])[0]
                    log_likelihood -= y * y
                w[i] = reweighed(w[i], log_likelihood / (2 * anchor.sigma**2))
                said.append(moments(x[i], w[i]))
            for i in range(n):
                w[i] = reweighed(w[i], heard(radio, x[i], said, rssi[t, k, i], stream.air.link[t, k, i]))
                mx, my, xx, xy, yy = moments(x[i], w[i])
                out[t, k, i] = mx, my
                if 1 / (w[i] @ w[i]) < N / 2:
                    mean, L = np.array([[mx], [my]]), np.linalg.cholesky([[xx, xy], [xy, yy]])
                    chosen = x[i][:, systematic_resample(w[i])]
                    x[i] = mean + np.sqrt(1 - H**2) * (chosen - mean) + H * (L @ rng.standard_normal((2, N)))
                    w[i] = np.full(N, 1 / N)
    return out


def missed(sensor: Any, x: Any, q: Any, z: float) -> tuple[Any, Any, Any, Any]:
    """A reading less what each particle expects, east and north of the place, and the squared distance."""
    dx, dy = x[0] - q[0], x[1] - q[1]
    D = np.maximum(dx * dx + dy * dy, NEAR**2)
    return (z - sensor.A) + (5 * sensor.eta / np.log(10)) * np.log(D), dx, dy, D


def heard(sensor: Any, x: Any, said: Any, z: Any, link: Any) -> Any:
    """The log-likelihood of all links, with the variance that the sender's position adds."""
    total, gain = np.zeros(N), (10 * sensor.eta / np.log(10)) ** 2
    for j in np.flatnonzero(link):
        mx, my, xx, xy, yy = said[j]
        y, dx, dy, D = missed(sensor, x, (mx, my), z[j])
        v = sensor.sigma**2 + gain * (dx * (xx * dx + 2 * xy * dy) + yy * dy * dy) / (D * D)
        total -= y * y / v + np.log(v)
    return total / 2


def reweighed(w: Any, log_likelihood: Any) -> Any:
    w = w * np.exp(log_likelihood - log_likelihood.max())
    return w / w.sum()


def moments(x: Any, w: Any) -> tuple[float, float, float, float, float]:
    mx, my = x @ w
    dx, dy = x[0] - mx, x[1] - my
    return mx, my, (w * dx) @ dx, (w * dx) @ dy, (w * dy) @ dy


class Loop:
    """One trial's filter. Compass frame, four corner nodes read as one direction, ranges between robots."""

    def __init__(self, x: Any, P: Any, world: Any) -> None:
        self.n, (a, b) = len(x), world.arena[1]
        self.nodes = [(0.0, 0.0), (0.0, b), (a, b), (a, 0.0)]
        self.sides = 2 * a, 2 * b
        self.slope = 5 * world.sensors["anchor_rssi"].eta / math.log(10)  # dB per unit of ln d^2
        self.doa_R = np.eye(1) * gradient_doa(world).sigma ** 2
        self.range_R = world.sensors["radio_range"].R
        self.ekf = ExtendedKalmanFilter(2 * self.n, 1, 2 * self.n)
        self.ekf.x, self.ekf.B = x.ravel().copy(), np.eye(2 * self.n)
        self.ekf.P = block_diag(*P)
        self.Q = np.eye(2 * self.n) * world.motion.sigma**2 / world.motion.tick

    def predict(self, moves: Any, dt: float) -> None:
        self.ekf.Q = self.Q * dt
        self.ekf.predict(moves.ravel())

    def direct(self, i: int, S: Any) -> None:
        """Update by the direction of the gradient of four readings S."""
        gx, gy = self.gradient(S)
        self.update(math.atan2(gy, gx), *self.direction(self.ekf.x, i), self.doa_R, turned)

    def measure(self, i: int, j: int, z: float) -> None:
        """Update by a range from i to j."""
        self.update(z, *self.distance(self.ekf.x, i, j), self.range_R, np.subtract)

    def update(self, z: float, h: Any, H: Any, R: Any, residual: Any) -> None:
        self.ekf.update(np.array([z]), lambda _: H, lambda _: h, R=R, residual=residual)

    def gradient(self, S: Any) -> tuple[float, float]:
        return (S[2] - S[1] + S[3] - S[0]) / self.sides[0], (S[2] - S[3] + S[1] - S[0]) / self.sides[1]

    def direction(self, x: Any, i: int) -> tuple[Any, Any]:
        px, py = float(x[2 * i]), float(x[2 * i + 1])
        offsets = [(px - qx, py - qy) for qx, qy in self.nodes]
        squares = [max(dx * dx + dy * dy, 0.01) for dx, dy in offsets]
        gx, gy = self.gradient([-self.slope * math.log(d2) for d2 in squares])
        far = [d2 > 0.01 for d2 in squares]
        by_x, by_y = (
            self.gradient([-2 * self.slope * o[k] / d2 * f for o, d2, f in zip(offsets, squares, far, strict=True)])
            for k in (0, 1)
        )
        strength = max(gx * gx + gy * gy, 0.01)
        H = np.zeros((1, 2 * self.n))
        H[0, 2 * i] = (gx * by_x[1] - gy * by_x[0]) / strength
        H[0, 2 * i + 1] = (gx * by_y[1] - gy * by_y[0]) / strength
        return np.array([math.atan2(gy, gx)]), H

    def distance(self, x: Any, i: int, j: int) -> tuple[Any, Any]:
        dx, dy = float(x[2 * i] - x[2 * j]), float(x[2 * i + 1] - x[2 * j + 1])
        d = math.hypot(dx, dy)
        H, near = np.zeros((1, 2 * self.n)), max(d, 0.1)
        H[0, 2 * i], H[0, 2 * i + 1], H[0, 2 * j], H[0, 2 * j + 1] = dx / near, dy / near, -dx / near, -dy / near
        return np.array([d]), H


def turned(a: Any, b: Any) -> Any:
    return (a - b + np.pi) % (2 * np.pi) - np.pi


class Filterpy:
    """The loops of all trials, as the runner wants them."""

    api, bound, mutable = 1, True, True
    uses = ("odometry", "anchor_rssi", "radio_range")

    def init(self, prior: Any, world: Any, rows: Any) -> list[Loop]:
        return [Loop(x, P, world) for x, P in zip(*prior, strict=True)]

    def predict(self, s: list[Loop], z: Any) -> list[Loop]:
        for t, loop in enumerate(s):
            loop.predict(z.odometry[t], z.dt[t, 0])
        return s

    def correct(self, s: list[Loop], z: Any) -> list[Loop]:
        for loop, readings in zip(s, z.anchor_rssi.tolist(), strict=True):
            for i, S in enumerate(readings):
                loop.direct(i, S)
        return s

    def exchange(self, s: list[Loop], z: Any, air: Any) -> tuple[list[Loop], Any]:
        for loop, ranges in zip(s, air.range.tolist(), strict=True):
            for j in range(loop.n):
                for i in range(loop.n):
                    if ranges[i][j] >= 0.2:  # absent is nan
                        loop.measure(i, j, ranges[i][j])
        nothing = np.zeros((len(s), s[0].n))
        return s, Traffic(nothing, nothing)

    def estimate(self, s: list[Loop]) -> Any:
        n = s[0].n
        x = np.stack([loop.ekf.x.reshape(n, 2) for loop in s])
        P = np.stack([np.einsum("iaib->iab", loop.ekf.P.reshape(n, 2, n, 2)) for loop in s])
        return Belief(x, P)


def ask_cvxpy(P_i: Any, P_j: Any, H: Any) -> float:
    """Return the weight of one reading of variance 1 that `Problem.solve` finds, by the trace."""
    q = float((H @ P_j @ H.T).item())
    w, n = cp.Variable(nonneg=True), cp.Variable()
    information = w * np.linalg.inv(P_i) + n * (H.T @ H)
    problem = cp.Problem(cp.Minimize(cp.tr_inv(information)), [w <= 1, n <= 1 - q * cp.inv_pos(q + 1 - w)])
    problem.solve(solver="CLARABEL")
    return float(w.value)
