"""States wider than a pose (velocities, biases, a clock), for which the world's models read and move the pose alone."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cooploc.estimators.interface import Array, Belief, Motion, Sensor, World


@dataclass(frozen=True)
class Layout:
    """Which numbers of a state are position and heading; `world` spreads the models' Jacobians over the whole state.

    layout = Layout(width=5, heading=2)              # x, y, heading, and two biases
    world, belief = layout.world(world), layout.prior(prior, [0.1**2, 0.1**2])
    y, H, _ = world.sensors["landmark"].innovation(belief.x, q, z)   # H (2, 5)
    return layout.estimate(x, P)                     # what a run wants: the numbers that the prior has
    """

    width: int
    heading: int | None = None  # None: a compass frame, as where priors have 2 numbers

    def __post_init__(self) -> None:
        if self.width < 2 or (self.heading is not None and not 2 <= self.heading < self.width):
            raise ValueError(f"{self}: a state has its position in 0 and 1, and a heading in one of the others")

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


@dataclass(frozen=True)
class WideSensor:
    """A sensor for a wider state, of which it reads the pose."""

    layout: Layout
    sensor: Sensor

    @property
    def R(self) -> Array:
        return self.sensor.R

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        y, H, Hq = self.sensor.innovation(x[..., self.layout.pose], q, z)
        wide = np.zeros((*H.shape[:-1], self.layout.width))
        wide[..., self.layout.pose] = H
        return y, wide, Hq


@dataclass(frozen=True)
class WideMotion:
    """A motion for a wider state, of which it moves the pose and leaves the rest."""

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

    def sample(self, x: Array, u: Array, dt: Array, noise: Array) -> Array:
        x = x.copy()
        x[..., self.layout.pose] = self.motion.sample(x[..., self.layout.pose], u, dt, noise)
        return x

    def retrace(self, trail: Array, u: Array, dt: Array) -> Array:
        return self.motion.retrace(trail, u, dt)

    def place(self, x: Array, trail: Array) -> Array:
        return self.motion.place(x[..., self.layout.pose], trail)
