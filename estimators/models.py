"""Motion and sensor models, each with its Jacobians and its noise.

They read the state's width d from x (2: a robot with a compass, 3: with a heading of its own), accept any leading axes,
and are immutable. A motion model's variance is proportional to dt; its sigmas are quoted at the stated `tick`.
"""

from dataclasses import dataclass

import numpy as np

from cooploc.estimators.angles import wrap
from cooploc.estimators.interface import Array

NEAR = 0.1  # [m] distances in a logarithm or a quotient are clamped here
TOO_NEAR_TO_RANGE = 0.2  # [m] a range reading below this says nothing about direction and is refused


@dataclass(frozen=True)
class Displacement:
    """Odometry in a compass frame: u = (dx, dy) [m] with independent Gaussian errors."""

    sigma: float = 0.02  # [m] per axis and `tick`
    tick: float = 1.0  # [s]

    def move(self, x: Array, u: Array, dt: Array) -> tuple[Array, Array, Array]:
        """x' = x + u,  F = I,  Q = sigma^2 dt/tick I on the position."""
        d = x.shape[-1]
        moved = _add_position(x, _known(u))
        on_position = np.diag(np.arange(d) < 2).astype(float)
        Q = self._variance(dt)[..., None, None] * on_position
        shape = (*moved.shape, d)
        return moved, np.broadcast_to(np.eye(d), shape), np.broadcast_to(Q, shape)

    def sample(self, x: Array, u: Array, dt: Array, noise: Array) -> Array:
        return _add_position(x, _known(u) + np.sqrt(self._variance(dt))[..., None] * noise)

    def retrace(self, trail: Array, u: Array, dt: Array) -> Array:
        return trail - _known(u)[..., None, :]

    def place(self, x: Array, trail: Array) -> Array:
        return x[..., :2] + trail

    def _variance(self, dt: Array) -> Array:
        return np.asarray(self.sigma**2 / self.tick * np.asarray(dt))


@dataclass(frozen=True)
class Unicycle:
    """Odometry of a wheeled robot: u = (v [m/s], omega [rad/s]) with independent Gaussian errors."""

    sigma_v: float = 0.04  # [m/s] at `tick`
    sigma_omega: float = 0.15  # [rad/s] at `tick`
    tick: float = 0.1  # [s]

    def move(self, x: Array, u: Array, dt: Array) -> tuple[Array, Array, Array]:
        """x' = x + v dt (cos a, sin a), heading' = heading + omega dt, with a = heading + omega dt / 2.

        Q = G diag(sigma_v^2, sigma_omega^2) G' tick dt, G = d(move)/d(v dt, omega dt): the random-walk form, so that
        the variance of many short moves equals that of one long move.
        """
        u, dt = _known(u), np.asarray(dt)
        arc, turn = u[..., 0] * dt, u[..., 1] * dt
        a = x[..., 2] + turn / 2
        c, s = np.cos(a), np.sin(a)
        zero, one = np.zeros_like(a), np.ones_like(a)
        F = _matrix([[one, zero, -arc * s], [zero, one, arc * c], [zero, zero, one]])
        G = _matrix([[c, -arc * s / 2], [s, arc * c / 2], [zero, one]])
        W = np.array([self.sigma_v**2, self.sigma_omega**2]) * self.tick
        Q = (G * (W * dt[..., None])[..., None, :]) @ G.mT
        return self._step(x, arc, turn), F, Q

    def sample(self, x: Array, u: Array, dt: Array, noise: Array) -> Array:
        u, dt = _known(u), np.asarray(dt)
        spread = np.array([self.sigma_v, self.sigma_omega]) * np.sqrt(self.tick * dt)[..., None]
        move = u * dt[..., None] + spread * noise
        return self._step(x, move[..., 0], move[..., 1])

    def retrace(self, trail: Array, u: Array, dt: Array) -> Array:
        u, dt = _known(u), np.asarray(dt)
        turn = u[..., 1] * dt
        along = np.stack([np.cos(turn / 2), np.sin(turn / 2)], -1) * (u[..., 0] * dt)[..., None]
        return _rotate(trail - along[..., None, :], -turn[..., None])

    def place(self, x: Array, trail: Array) -> Array:
        return x[..., :2] + _rotate(trail, x[..., 2])

    @staticmethod
    def _step(x: Array, arc: Array, turn: Array) -> Array:
        a = x[..., 2] + turn / 2
        return np.stack([x[..., 0] + arc * np.cos(a), x[..., 1] + arc * np.sin(a), wrap(x[..., 2] + turn)], -1)


@dataclass(frozen=True)
class LogDistance:
    """Received signal strength, log-distance path loss: z = A - 10 eta log10 d  [dBm], d >= 0.1 m.

    Source: Latif & Parasuraman, the equation of RSSI_m.
    """

    A: float = -40.0  # [dBm] at 1 m
    eta: float = 3.0  # path-loss exponent
    sigma: float = 5**0.5  # [dB] shadowing and fast noise together

    @property
    def R(self) -> Array:
        return np.array([[self.sigma**2]])

    def expect(self, x: Array, q: Array) -> Array:
        """The mean reading (...) [dBm]."""
        d2 = (x[..., 0] - q[..., 0]) ** 2 + (x[..., 1] - q[..., 1]) ** 2
        return self.A - 5 * self.eta * np.log10(np.maximum(d2, NEAR**2))

    def slope(self, x: Array, q: Array) -> Array:
        """d expect / d position (..., 2) [dB/m]; zero inside the clamp."""
        east, north = x[..., 0] - q[..., 0], x[..., 1] - q[..., 1]
        d2 = east**2 + north**2
        far, clamped, fall = d2 > NEAR**2, np.maximum(d2, NEAR**2), -10 * self.eta / np.log(10)
        return np.stack([np.where(far, fall * away / clamped, 0.0) for away in (east, north)], -1)

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        g = self.slope(x, q)
        return z - self.expect(x, q)[..., None], _widen(g[..., None, :], x), -g[..., None, :]


@dataclass(frozen=True)
class Range:
    """Distance to a place [m]. Readings below 0.2 m are refused (nan)."""

    sigma: float = 0.1  # [m]

    @property
    def R(self) -> Array:
        return np.array([[self.sigma**2]])

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        delta, d = _offset(x, q)
        u = delta / np.maximum(d, NEAR)
        y = np.where(z < TOO_NEAR_TO_RANGE, np.nan, z - d)
        return y, _widen(u[..., None, :], x), -u[..., None, :]

    def curvature(self, x: Array, q: Array, D: Array) -> tuple[Array, Array]:
        """Second-order mean shift (..., 1) and extra variance (..., 1, 1) when x - q has covariance D (..., 2, 2).

        With M = (I - u u')/d the Hessian of the distance: tr(M D)/2 and tr(M D M D)/2
        (Bar-Shalom, Li & Kirubarajan 2001, eq. 10.3.3).
        """
        delta, d = _offset(x, q)
        d = np.maximum(d, TOO_NEAR_TO_RANGE)
        t = np.stack([-delta[..., 1], delta[..., 0]], -1) / d
        across = (t * (D @ t[..., None])[..., 0]).sum(-1, keepdims=True) / d
        return across / 2, (across**2 / 2)[..., None]


@dataclass(frozen=True)
class Bearing:
    """Direction of a place [rad], relative to the heading where the state has one, else to the x axis."""

    sigma: float = 0.02  # [rad]

    @property
    def R(self) -> Array:
        return np.array([[self.sigma**2]])

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        delta, d = _offset(x, q)
        heading = x[..., 2:3] if x.shape[-1] > 2 else 0.0
        y = wrap(z - (np.arctan2(-delta[..., 1:], -delta[..., :1]) - heading))
        g = np.stack([-delta[..., 1], delta[..., 0]], -1) / np.maximum(d, NEAR) ** 2
        H = _widen(g[..., None, :], x)
        if x.shape[-1] > 2:
            H[..., 0, 2] = -1.0
        return y, H, -g[..., None, :]


@dataclass(frozen=True)
class Sighting:
    """A camera's range [m] and bearing [rad] of one thing: one vector, gated once."""

    sigma_range: float = 0.15
    sigma_bearing: float = 0.02

    @property
    def R(self) -> Array:
        return np.diag([self.sigma_range**2, self.sigma_bearing**2])

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        parts = (
            Range(self.sigma_range).innovation(x, q, z[..., :1]),
            Bearing(self.sigma_bearing).innovation(x, q, z[..., 1:]),
        )
        (y0, H0, Hq0), (y1, H1, Hq1) = parts
        return np.concatenate([y0, y1], -1), np.concatenate([H0, H1], -2), np.concatenate([Hq0, Hq1], -2)


def _known(u: Array) -> Array:
    """Absent odometry says: did not move."""
    return np.where(np.isnan(u), 0.0, u)


def _add_position(x: Array, step: Array) -> Array:
    position = x[..., :2] + step
    return np.concatenate([position, np.broadcast_to(x[..., 2:], (*position.shape[:-1], x.shape[-1] - 2))], -1)


def _matrix(rows: list[list[Array]]) -> Array:
    return np.stack([np.stack(row, -1) for row in rows], -2)


def _rotate(v: Array, angle: Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * v[..., 0] - s * v[..., 1], s * v[..., 0] + c * v[..., 1]], -1)


def _offset(x: Array, q: Array) -> tuple[Array, Array]:
    delta = x[..., :2] - q
    return delta, np.sqrt((delta**2).sum(-1, keepdims=True))


def _widen(H: Array, x: Array) -> Array:
    """Position Jacobian (..., k, 2) to (..., k, d)."""
    return np.concatenate([H, np.zeros((*H.shape[:-1], x.shape[-1] - 2))], -1)
