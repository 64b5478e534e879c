"""A tick's motion and readings as functions of the state: what other people's filters ask for.

Libraries of sigma points, particles and factors take f(x) and h(x), linear ones take matrices; both take the noise:

    step = cl.motion_of(world, z)
    ukf.Q = step.Q(ukf.x)
    ukf.predict(fx=lambda x, dt: step.f(x))
    for one in cl.readings_of(world, z):
        ukf.update(one.z, one.R, hx=one.h)     # or, with a linear one: kf.update(*one.linear(kf.x))

Angles need no care of the library's: a heading goes on beyond pi, so that points have their mean between them, and h(x)
is within pi of the reading, so that z - h(x) is the innovation.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import TEAM_PRIOR, Array, Belief, Motion, Senses, Sensor, World


class Linear(NamedTuple):
    """A motion about a state: x' = F x + c."""

    F: Array  # (d, d)
    c: Array  # (d,)
    Q: Array  # (d, d)


class LinearReading(NamedTuple):
    """A reading about a state, as a linear filter takes it: z = H x + noise."""

    z: Array  # (k,)
    R: Array  # (k, k)
    H: Array  # (k, d)


@dataclass(frozen=True)
class Step:
    """How one tick's odometry moves states (..., d)."""

    motion: Motion
    odometry: Array  # (k,)
    dt: Array  # () [s]

    def f(self, x: Array) -> Array:
        """x' (..., d); a heading is not wrapped, but goes on from that of x."""
        return _on(x, self.motion.move(x, self.odometry, self.dt)[0])

    def sample(self, x: Array, noise: Array) -> Array:
        """As f, with the odometry's error drawn: `noise` (..., 2) is standard normal."""
        return _on(x, self.motion.sample(x, self.odometry, self.dt, noise))

    def Q(self, x: Array) -> Array:
        """The covariance of its error (..., d, d)."""
        return self.motion.move(x, self.odometry, self.dt)[2]

    def linear(self, x: Array) -> Linear:
        """F, c and Q about a state (d,)."""
        _, F, Q = self.motion.move(x, self.odometry, self.dt)
        return Linear(F, self.f(x) - F @ x, Q)


@dataclass(frozen=True)
class Reading:
    """One reading (k,) of a fixed thing."""

    sensor: Sensor
    place: Array  # (2,)
    z: Array  # (k,)

    @property
    def R(self) -> Array:
        """Its covariance (k, k)."""
        return self.sensor.R

    def h(self, x: Array) -> Array:
        """What it would be at states (..., d) without noise (..., k); an angle is within pi of that of z."""
        return self.z - self.sensor.innovation(x, self.place, self.z)[0]

    def H(self, x: Array) -> Array:
        """dh/dx (..., k, d)."""
        return self.sensor.innovation(x, self.place, self.z)[1]

    def linear(self, x: Array) -> LinearReading:
        """z - h(x) + H x, R and H about a state (d,)."""
        y, H, _ = self.sensor.innovation(x, self.place, self.z)
        return LinearReading(y + H @ x, self.R, H)


def motion_of(world: World, z: Senses) -> Step:
    """The motion of one robot in one tick."""
    return Step(world.motion, z.odometry, z.dt)


def priors_of(z: Senses) -> Belief:
    """Everyone's belief before tick 0, x (..., n, d) and P (..., n, d, d), where the scenario tells it.

    It is the channel "team_prior", the same in every tick; `uses` must name it.

    Raises:
        KeyError: the stream has no such channel, or `uses` does not name it.

    """
    if TEAM_PRIOR not in z.extra:
        raise KeyError(f'no {TEAM_PRIOR}: name it in `uses`, in a scenario such as "trajectory[team_priors=true]"')
    told = z.extra[TEAM_PRIOR]
    d = 2 if told.shape[-1] == 6 else 3
    return Belief(told[..., :d], told[..., d:].reshape(*told.shape[:-1], d, d))


def readings_of(world: World, z: Senses) -> Iterator[Reading]:
    """One robot's readings of anchors and landmarks in one tick; those that are absent, or in part, are left out."""
    return (Reading(*one) for one in world.fixed(z) if np.isfinite(one[2]).all())


def _on(x: Array, moved: Array) -> Array:
    """The states that were moved, their headings within pi of those of x."""
    turn = moved[..., 2:] - x[..., 2:]
    return np.concatenate([moved[..., :2], x[..., 2:] + np.arctan2(np.sin(turn), np.cos(turn))], -1)
