"""Models for filters of one's own: as pure functions for tracing libraries such as JAX, and for wider states.

`xp` is the library, `jax.numpy` or another with numpy's names; nothing is written in place, and no branch looks at a
value. The numbers are those of the models in `models.py`, whose formulas these are; a nan stays a nan.

    H = jax.jacfwd(lambda x: expect(jnp, sensor, x, place))(x)
    y = innovation(jnp, sensor, x, place, reading)
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Any

import numpy as np

from cooploc.estimators.interface import TOO_NEAR_TO_RANGE, Array, Belief, Motion, Sensor, World
from cooploc.estimators.models import NEAR, Bearing, Displacement, LogDistance, Range, Sighting, Unicycle

Traced = Any  # an array of the library


def move(xp: Any, motion: Motion, x: Traced, u: Traced, dt: Traced) -> Traced:
    """Return x' (..., d) of states (..., d) by odometry (..., k) over dt (...); where it is absent, no move."""
    u = xp.where(xp.isnan(u), 0.0, u)
    if isinstance(motion, Displacement):
        return xp.concatenate([x[..., :2] + u, x[..., 2:]], -1)
    if isinstance(motion, Unicycle):
        arc, turn = u[..., 0] * dt, u[..., 1] * dt
        a = x[..., 2] + turn / 2
        north = x[..., 1] + arc * xp.sin(a)
        return xp.stack([x[..., 0] + arc * xp.cos(a), north, wrap(xp, x[..., 2] + turn)], -1)
    raise TypeError(f"{type(motion).__name__} has no traceable form; known are Displacement and Unicycle")


def expect(xp: Any, sensor: Sensor, x: Traced, q: Traced) -> Traced:
    """Return the mean reading (..., k) of places q (..., 2) at states (..., d)."""
    east, north = q[..., 0] - x[..., 0], q[..., 1] - x[..., 1]
    d2, away = east**2 + north**2, xp.arctan2(north, east)
    distance = xp.sqrt(d2)[..., None]
    direction = wrap(xp, away - x[..., 2] if x.shape[-1] > 2 else away)[..., None]
    if isinstance(sensor, LogDistance):
        return (sensor.A - 5 * sensor.eta * xp.log10(xp.clip(d2, min=NEAR**2)))[..., None]
    if isinstance(sensor, Range):
        return distance
    if isinstance(sensor, Bearing):
        return direction
    if isinstance(sensor, Sighting):
        return xp.concatenate([distance, direction], -1)
    name = type(sensor).__name__
    raise TypeError(f"{name} has no traceable form; known are LogDistance, Range, Bearing and Sighting")


def innovation(xp: Any, sensor: Sensor, x: Traced, q: Traced, z: Traced) -> Traced:
    """Return z - h(x, q) (..., k), with the angle wrapped; nan where a reading is absent or a range is refused."""
    y = z - expect(xp, sensor, x, q)
    if isinstance(sensor, Bearing):
        return wrap(xp, y)
    if isinstance(sensor, Range | Sighting):
        short = z[..., :1] < TOO_NEAR_TO_RANGE
        return xp.concatenate([xp.where(short, xp.nan, y[..., :1]), wrap(xp, y[..., 1:])], -1)
    return y


def wrap(xp: Any, angle: Traced) -> Traced:
    """Return the same angle in [-pi, pi)."""
    return xp.remainder(angle + pi, 2 * pi) - pi


# States wider than a pose: velocities, biases, a clock. A layout shows the world's models the position and heading of a
# wider state, and spreads their Jacobians over it:
#
#     layout = Layout(width=5, heading=2)              # x, y, heading, and two biases
#     world, belief = layout.world(world), layout.prior(prior, [0.1**2, 0.1**2])
#     y, H, _ = world.sensors["landmark"].innovation(belief.x, q, z)   # H (2, 5)
#     return layout.estimate(x, P)                     # what a run wants: the numbers that the prior has
#
# What is beside position and heading stays as it is in `move`; a filter adds its own motion and noise of it.


@dataclass(frozen=True)
class Layout:
    """The numbers of a state, its position first, that are position and heading."""

    width: int
    heading: int | None = None  # None: a compass frame, as where priors have 2 numbers

    def __post_init__(self) -> None:
        least = 2 if self.heading is None else 3
        if self.width < least or (self.heading is not None and not 2 <= self.heading < self.width):
            raise ValueError(
                f"Layout({self.width}, heading={self.heading}): a state has its position in 0 and 1, and its heading, "
                "where it has one, in one of the others"
            )

    @property
    def pose(self) -> list[int]:
        """The numbers that the world's models read."""
        return [0, 1] if self.heading is None else [0, 1, self.heading]

    def world(self, world: World) -> World:
        """Return the world with models that read such states."""
        sensors = {name: WideSensor(self, sensor) for name, sensor in world.sensors.items()}
        return replace(world, motion=WideMotion(self, world.motion), sensors=sensors)

    def prior(self, prior: Belief, variances: Sequence[float] | Array) -> Belief:
        """Return a prior (..., 2 or 3) widened by what is not pose: 0, with these variances, uncorrelated."""
        beside = [i for i in range(self.width) if i not in self.pose]
        x = np.zeros((*prior.x.shape[:-1], self.width))
        P = np.zeros((*x.shape, self.width))
        x[..., self.pose] = prior.x
        P[..., np.array(self.pose)[:, None], self.pose] = prior.P
        P[..., beside, beside] = variances
        return Belief(x, P)

    def estimate(self, x: Array, P: Array) -> Belief:
        """Return position, and heading where there is one, with their covariance."""
        return Belief(x[..., self.pose], P[..., np.array(self.pose)[:, None], self.pose])

    def widen(self, H: Array) -> Array:
        """Return slopes of the pose (..., k, 2 or 3) as slopes of the state (..., k, width)."""
        wide = np.zeros((*H.shape[:-1], self.width))
        wide[..., self.pose] = H
        return wide


@dataclass(frozen=True)
class WideSensor:
    """A sensor that reads the pose of a wider state."""

    layout: Layout
    sensor: Sensor

    @property
    def R(self) -> Array:
        return self.sensor.R

    def expect(self, x: Array, q: Array) -> Array:
        """Return the mean reading (..., k)."""
        mean: Array = self.sensor.expect(x[..., self.layout.pose], q)  # type: ignore[attr-defined]
        return mean

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        y, H, Hq = self.sensor.innovation(x[..., self.layout.pose], q, z)
        return y, self.layout.widen(H), Hq


@dataclass(frozen=True)
class WideMotion:
    """A motion of the pose of a wider state, the rest of which stays as it is."""

    layout: Layout
    motion: Motion

    def move(self, x: Array, u: Array, dt: Array) -> tuple[Array, Array, Array]:
        """Return x', F (..., width, width), the identity beside the pose, and Q, zero beside it."""
        pose, rows = self.layout.pose, np.array(self.layout.pose)[:, None]
        moved, F, Q = self.motion.move(x[..., pose], u, dt)
        x, wide = x.copy(), (*x.shape, x.shape[-1])
        F_wide, Q_wide = np.broadcast_to(np.eye(x.shape[-1]), wide).copy(), np.zeros(wide)
        x[..., pose], F_wide[..., rows, pose], Q_wide[..., rows, pose] = moved, F, Q
        return x, F_wide, Q_wide

    def input_noise(self, x: Array, u: Array, dt: Array) -> tuple[Array, Array]:
        G, W = self.motion.input_noise(x[..., self.layout.pose], u, dt)
        return self.layout.widen(G.mT).mT, W

    def sample(self, x: Array, u: Array, dt: Array, noise: Array) -> Array:
        x = x.copy()
        x[..., self.layout.pose] = self.motion.sample(x[..., self.layout.pose], u, dt, noise)
        return x

    def retrace(self, trail: Array, u: Array, dt: Array) -> Array:
        return self.motion.retrace(trail, u, dt)

    def place(self, x: Array, trail: Array) -> Array:
        return self.motion.place(x[..., self.layout.pose], trail)
