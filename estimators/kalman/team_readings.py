"""Readings between robots as the Kalman filters use them: which there are, and how they linearise."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Indices, Mail, Senses, Sensor, World
from cooploc.estimators.kalman.linearised import innovation
from cooploc.estimators.models.sensors import Orientation, Range


class PairReading(NamedTuple):
    """A reading between a robot and one whose packet it received."""

    sensor: Sensor
    sender: int
    z: Array  # (r, k)
    by_sender: bool  # whether the sender made it, of the robot; else the robot made it, of the sender

    def linearise(self, x: Array, x_j: Array) -> tuple[Array, Array, Array]:
        """y (r, k), H (r, k, d) of the robot itself, H_j (r, k, d) of the sender."""
        if self.by_sender:
            y, H_j, H = linearise(self.sensor, x_j, x, self.z)
            return y, H, H_j
        return linearise(self.sensor, x, x_j, self.z)


def received(world: World, z: Senses, mail: Mail, sightings: Array, robot: Indices) -> Iterator[PairReading]:
    """A robot's readings of its senders, then the `sightings` (r, sender, n, 2) of it that they sent."""
    for sensor, j, reading in world.relative(z, mail):
        yield PairReading(sensor, j, reading, by_sender=False)
    camera = world.sensors.get("sighting")
    if camera is not None and sightings.shape[2]:
        of_it = sightings[np.arange(len(robot)), :, robot]  # (r, sender, 2)
        for j in (~np.logical_and.reduce(np.isnan(of_it), (0, 2))).nonzero()[0].tolist():
            yield PairReading(camera, j, of_it[:, j], by_sender=True)


def pairs(world: World, z: Senses, air: Mail) -> Iterator[tuple[Sensor, int, int, Array]]:
    """Readings (t, k) of a team as (sensor, receiver, sender, reading), sender by sender; absent ones are left out."""
    for sensor, j, reading in world.relative(z, air):
        there = np.asarray(~np.isnan(reading).all((0, 2)))
        there[j] = False
        yield from ((sensor, i, j, reading[:, i]) for i in np.flatnonzero(there).tolist())


def table(world: World, z: Senses, air: Mail) -> Iterator[tuple[Sensor, Array]]:
    """The same readings at once, (t, receiver, sender, k) by sensor; nan on the diagonal, where both are one robot."""
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
    if isinstance(sensor, Orientation):
        return sensor.between(x_i, x_j, reading)
    y, H, Hq = innovation(sensor, x_i, x_j[..., :2], reading)
    H_j = np.zeros(H.shape)
    H_j[..., :2] = Hq
    return y, H, H_j


def curvature(sensor: Sensor, x_i: Array, x_j: Array, D: Array) -> tuple[Array, Array]:
    """Mean shift (..., k), extra variance (..., k, k) of a range by its second order; x_i - x_j has D (..., 2, 2)."""
    if isinstance(sensor, Range):
        return sensor.curvature(x_i, x_j[..., :2], D)
    return np.zeros(1), np.zeros((1, 1))
