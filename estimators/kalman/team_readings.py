"""What the Kalman filters of a team share: readings between robots, how they linearise, and how beliefs are sent."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Indices, Mail, Senses, Sensor, World
from cooploc.estimators.models.sensors import Range

HEADER = 8  # bytes a message costs beside its numbers, as the runner counts


class Heard(NamedTuple):
    """A reading between a robot and one whose packet it heard."""

    sensor: Sensor
    sender: int
    reading: Array  # (r, k)
    theirs: bool  # made by the sender, of the robot itself

    def linearise(self, x: Array, x_j: Array) -> tuple[Array, Array, Array]:
        """y (r, k), H (r, k, d) of the robot itself, H_j (r, k, d) of the sender."""
        if self.theirs:
            y, H_j, H = linearise(self.sensor, x_j, x, self.reading)
            return y, H, H_j
        return linearise(self.sensor, x, x_j, self.reading)


def pairs(world: World, z: Senses, air: Mail) -> Iterator[tuple[Sensor, int, int, Array]]:
    """Readings (t, k) of a team as (sensor, receiver, sender, reading), sender by sender; absent ones are left out."""
    for sensor, j, reading in world.relative(z, air):
        for i in range(world.robots):
            if i != j and not np.isnan(reading[:, i]).all():
                yield sensor, i, j, reading[:, i]


def table(world: World, z: Senses, air: Mail) -> Iterator[tuple[Sensor, Array]]:
    """The same readings at once, (t, receiver, sender, k) by sensor, nobody's reading of himself among them."""
    for channel, readings in (
        ("sighting", z.sighting),
        ("radio_rssi", air.rssi[..., None]),
        ("radio_range", air.range[..., None]),
    ):
        sensor = world.sensors.get(channel)
        if sensor is not None and not np.isnan(readings).all():
            yield sensor, np.where(np.eye(world.robots, dtype=bool)[..., None], np.nan, readings)


def linearise(sensor: Sensor, x_i: Array, x_j: Array, reading: Array) -> tuple[Array, Array, Array]:
    """y (..., k), H_i (..., k, d), H_j (..., k, d) of a reading of j by i."""
    y, H, Hq = sensor.innovation(x_i, x_j[..., :2], reading)
    H_j = np.zeros_like(H)
    H_j[..., :2] = Hq
    return y, H, H_j


def curvature(sensor: Sensor, x_i: Array, x_j: Array, D: Array) -> tuple[Array, Array]:
    """Mean shift (..., k), extra variance (..., k, k) of a range by its second order; x_i - x_j has D (..., 2, 2)."""
    if isinstance(sensor, Range):
        return sensor.curvature(x_i, x_j[..., :2], D)
    return np.zeros(1), np.zeros((1, 1))


def packed(x: Array, *Ps: Array) -> Array:
    """A message (r, m): x (r, d) and the upper triangle of each covariance (r, d, d)."""
    i, j = np.triu_indices(x.shape[-1])
    return np.concatenate([x, *(P[:, i, j] for P in Ps)], -1)


def unpacked(message: Array, d: int, count: int = 1) -> tuple[Array, ...]:
    """x (..., d) and `count` covariances (..., d, d) from the front of a message."""
    i, j = np.triu_indices(d)
    parts = [message[..., :d]]
    for k in range(count):
        P = np.empty((*message.shape[:-1], d, d))
        P[..., i, j] = P[..., j, i] = message[..., d + k * len(i) : d + (k + 1) * len(i)]
        parts.append(P)
    return tuple(parts)


def sightings(world: World, z: Senses) -> Array:
    """Range and bearing of each teammate (r, 2 n), to be told; width 0 without a camera."""
    return z.sighting.reshape(len(z.sighting), -1) if "sighting" in world.sensors else z.sighting[:, :0, 0]


def received(world: World, z: Senses, mail: Mail, robot: Indices, begin: int) -> Iterator[Heard]:
    """A robot's readings of those it heard, then the sightings of it that they sent from column `begin` on."""
    for sensor, j, reading in world.relative(z, mail):
        yield Heard(sensor, j, reading, False)
    seen, rows = world.sensors.get("sighting"), np.arange(len(robot))
    if seen is not None and mail.packets.shape[-1] > begin:
        told = mail.packets[..., begin:].reshape(len(robot), world.robots, world.robots, 2)[rows, :, robot]
        for j in range(world.robots):
            if not np.isnan(told[:, j]).all():
                yield Heard(seen, j, told[:, j], True)
