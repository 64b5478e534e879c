"""Motion models, each with its Jacobian and its noise.

They read the state's width d from x (2: a robot with a compass, 3: with a heading of its own), accept any leading axes,
and are immutable. The variance is proportional to dt; sigmas are quoted at the stated `tick`.
"""

from dataclasses import dataclass

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.estimators.models.angles import wrap


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

    def input_noise(self, x: Array, u: Array, dt: Array) -> tuple[Array, Array]:
        """G = (I, 0)' (..., d, 2),  W = sigma^2 dt/tick I (..., 2, 2)."""
        d, lead = x.shape[-1], np.broadcast_shapes(x.shape[:-1], u.shape[:-1])
        W = self._variance(dt)[..., None, None] * np.eye(2)
        return np.broadcast_to(np.eye(d, 2), (*lead, d, 2)), np.broadcast_to(W, (*lead, 2, 2))

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

    def input_noise(self, x: Array, u: Array, dt: Array) -> tuple[Array, Array]:
        """G as in `move`, times dt (..., 3, 2),  W = diag(sigma_v^2, sigma_omega^2) tick/dt (..., 2, 2).

        W is 0 where dt is 0.
        """
        u, dt = _known(u), np.asarray(dt)
        arc, a = u[..., 0] * dt, x[..., 2] + u[..., 1] * dt / 2
        c, s, zero = np.cos(a), np.sin(a), np.zeros_like(a)
        G = _matrix([[c, -arc * s / 2], [s, arc * c / 2], [zero, zero + 1]]) * dt[..., None, None]
        rate = np.divide(self.tick, dt, out=np.zeros(dt.shape), where=dt > 0)
        W = np.diag([self.sigma_v**2, self.sigma_omega**2]) * rate[..., None, None]
        return G, np.broadcast_to(W, (*G.shape[:-2], 2, 2))

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
