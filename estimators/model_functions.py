"""Models for filters of one's own: as pure functions for tracing libraries such as JAX, and for wider states.

`xp` is the library, `jax.numpy` or another with numpy's names; nothing is written in place, and no branch looks at a
value. The numbers are those of the models in `models.py`, whose formulas these are; a nan stays a nan.

    H = jax.jacfwd(lambda x: expect(jnp, sensor, x, place))(x)
    y = innovation(jnp, sensor, x, place, reading)
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Any

import numpy as np

from cooploc.estimators.interface import TOO_NEAR_TO_RANGE, Array, Belief, Motion, Sensor, World
from cooploc.estimators.models import NEAR, Bearing, Displacement, LogDistance, Range, Sighting, Unicycle

Traced = Any  # an array of the library


def move(xp: Any, motion: Motion, x: Traced, u: Traced, dt: Traced) -> Traced:
    """x' (..., d) of states (..., d) by odometry (..., k) over dt (...); absent odometry says: did not move.

    Raises:
        TypeError: the motion has no traceable form.

    """
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
    """The mean reading (..., k) of places q (..., 2) at states (..., d).

    Raises:
        TypeError: the sensor has no traceable form.

    """
    try:
        return FORMS[type(sensor)](xp, sensor, x, q)
    except KeyError:
        known = ", ".join(one.__name__ for one in FORMS)
        raise TypeError(f"{type(sensor).__name__} has no traceable form; known are {known}") from None


def innovation(xp: Any, sensor: Sensor, x: Traced, q: Traced, z: Traced) -> Traced:
    """z - h(x, q) (..., k), with the angle wrapped; nan where a reading is absent or a range is refused."""
    y = z - expect(xp, sensor, x, q)
    if isinstance(sensor, Bearing):
        return wrap(xp, y)
    if isinstance(sensor, Range | Sighting):
        short = z[..., :1] < TOO_NEAR_TO_RANGE
        return xp.concatenate([xp.where(short, xp.nan, y[..., :1]), wrap(xp, y[..., 1:])], -1)
    return y


def wrap(xp: Any, angle: Traced) -> Traced:
    """The same angle in [-pi, pi)."""
    return xp.remainder(angle + pi, 2 * pi) - pi


def _square(x: Traced, q: Traced) -> Traced:
    return (x[..., 0] - q[..., 0]) ** 2 + (x[..., 1] - q[..., 1]) ** 2


def _level(xp: Any, sensor: Any, x: Traced, q: Traced) -> Traced:
    d2 = xp.clip(_square(x, q), min=NEAR**2)
    return (sensor.A - 5 * sensor.eta * xp.log10(d2))[..., None]


def _distance(xp: Any, _: Any, x: Traced, q: Traced) -> Traced:
    return xp.sqrt(_square(x, q))[..., None]


def _direction(xp: Any, _: Any, x: Traced, q: Traced) -> Traced:
    away = xp.arctan2(q[..., 1] - x[..., 1], q[..., 0] - x[..., 0])
    return wrap(xp, away - x[..., 2] if x.shape[-1] > 2 else away)[..., None]


def _range_and_bearing(xp: Any, sensor: Any, x: Traced, q: Traced) -> Traced:
    return xp.concatenate([_distance(xp, sensor, x, q), _direction(xp, sensor, x, q)], -1)


FORMS: dict[type, Callable[[Any, Any, Traced, Traced], Traced]] = {
    LogDistance: _level,
    Range: _distance,
    Bearing: _direction,
    Sighting: _range_and_bearing,
}


# States wider than a pose: velocities, biases, a clock. Position comes first, and it is said where the heading is.
#
# The world's models read a state of 2 numbers (position, in a compass frame) or 3 (position and heading). A layout
# shows them those of a wider state, and spreads their Jacobians over it:
#
#     layout = Layout(width=5, heading=2)              # x, y, heading, and two biases
#     world, belief = layout.world(world), layout.prior(prior, [0.1**2, 0.1**2])
#     y, H, _ = world.sensors["landmark"].innovation(belief.x, q, z)   # H (2, 5)
#     return layout.estimate(x, P)                     # what a run wants: the numbers that the prior has
#
# What is beside position and heading stays as it is in `move`; a filter adds its own motion and noise of it.


@dataclass(frozen=True)
class Layout:
    """Which numbers of a state are position and heading.

    Raises:
        ValueError: a width or an index that cannot be.

    """

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
        """The world with models that read such states."""
        sensors = {name: WideSensor(self, sensor) for name, sensor in world.sensors.items()}
        return replace(world, motion=WideMotion(self, world.motion), sensors=sensors)

    def prior(self, prior: Belief, variances: Sequence[float] | Array) -> Belief:
        """A prior (..., 2 or 3) widened by what is not pose: 0, with these variances, uncorrelated."""
        beside = [i for i in range(self.width) if i not in self.pose]
        x = np.zeros((*prior.x.shape[:-1], self.width))
        P = np.zeros((*x.shape, self.width))
        x[..., self.pose] = prior.x
        P[..., np.array(self.pose)[:, None], self.pose] = prior.P
        P[..., beside, beside] = variances
        return Belief(x, P)

    def estimate(self, x: Array, P: Array) -> Belief:
        """Position, and heading where there is one, with their covariance."""
        return Belief(x[..., self.pose], P[..., np.array(self.pose)[:, None], self.pose])

    def widen(self, H: Array) -> Array:
        """Slopes of the pose (..., k, 2 or 3) as slopes of the state (..., k, width)."""
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
        """The mean reading (..., k)."""
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
        """x', F (..., width, width), the identity beside the pose, and Q, zero beside it."""
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
