"""What a team knows in advance: anchors, landmarks, and the models of motion and sensors that it assumes."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from cooploc.estimators.interface.tick import Array, Belief, Mail, Senses


class Motion(Protocol):
    """How odometry moves a state. Shapes broadcast: x (..., d), u (..., k), dt (...)."""

    def move(self, x: Array, u: Array, dt: Array) -> tuple[Array, Array, Array]:
        """x', F = dx'/dx (..., d, d), Q (..., d, d)."""
        ...

    def input_noise(self, x: Array, u: Array, dt: Array) -> tuple[Array, Array]:
        """G = dx'/du (..., d, k) and the covariance W (..., k, k) of the odometry u's error: Q = G W G'."""
        ...

    def sample(self, x: Array, u: Array, dt: Array, noise: Array) -> Array:
        """x' with the odometry's error drawn: `noise` (..., 2) is standard normal."""
        ...

    def retrace(self, trail: Array, u: Array, dt: Array) -> Array:
        """`trail` (..., M, 2): where past positions lie as seen from the robot's pose, after one more move."""
        ...

    def place(self, x: Array, trail: Array) -> Array:
        """The positions (..., 2) in the world of a trail point (..., 2) seen from poses x (..., d)."""
        ...


class Sensor(Protocol):
    """What a reading says about a state. x (..., d), a place q (..., 2), a reading z (..., k).

    Those of `world.sensors` have `expect(x, q)` too, the mean reading (..., k), for filters that need no slopes.
    """

    @property
    def R(self) -> Array:
        """The reading's noise covariance (k, k)."""
        ...

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        """y = z - h(x, q) (..., k) with angles wrapped, H = dh/dx (..., k, d), Hq = dh/dq (..., k, 2)."""
        ...


@dataclass(frozen=True, eq=False)
class World:
    """What the team knows in advance, the same for every estimator. Its models are assumed ones, not the truth."""

    robots: int
    tick: float  # [s]
    arena: Array  # (2, 2)  lower left and upper right corner [m]
    motion: Motion
    sensors: Mapping[str, Sensor]  # by channel
    anchors: Array = field(default_factory=lambda: np.zeros((0, 2)))  # (a, 2) [m]
    landmarks: Array = field(default_factory=lambda: np.zeros((0, 2)))  # (l, 2) [m]
    t0: float = 0.0  # time of the prior [s]

    def __post_init__(self) -> None:
        for name in ("arena", "anchors", "landmarks"):
            array = np.array(getattr(self, name), float)
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def fixed(self, z: Senses) -> Iterator[tuple[Sensor, Array, Array]]:
        """Readings of fixed things as (sensor, place (2,), reading (r, k)), anchors first; absent ones are left out."""
        for sensor, places, readings in self._of_fixed(z):
            yield from ((sensor, places[i], one) for i, one in _present(readings, len(places)))

    def relative(self, z: Senses, mail: Mail) -> Iterator[tuple[Sensor, int, Array]]:
        """Readings of teammates as (sensor, sender, reading (r, k)): sightings, then radio RSSI, then radio range."""
        for sensor, readings in self._of_mates(z, mail):
            yield from ((sensor, j, one) for j, one in _present(readings, self.robots))

    def stacked(self, x: Array, z: Senses, mail: Mail | None = None, mates: Belief | None = None) -> "Stacked":
        """All readings of a tick as one vector, linearised at x (..., d): for filters that update once a tick.

        Its length is the same in every tick: what `fixed` has, and with `mail` and `mates`, what is believed of the
        teammates (x (..., n, d), P (..., n, d, d)), what `relative` has. y is nan where a reading is absent or refused:
        use the rows where it is finite. The mates' covariance is added to R as if it were independent of the own; a
        filter that fuses beliefs received again and again must not rely on that.
        """
        parts = []
        for sensor, places, readings in self._of_fixed(z):
            for i, q in enumerate(places):
                parts.append((*sensor.innovation(x, q, readings[..., i, :])[:2], sensor.R))
        if mail is not None and mates is not None:
            for sensor, readings in self._of_mates(z, mail):
                for j in range(self.robots):
                    y, H, Hq = sensor.innovation(x, mates.x[..., j, :2], readings[..., j, :])
                    parts.append((y, H, sensor.R + Hq @ mates.P[..., j, :2, :2] @ Hq.mT))
        return _stacked(x, parts)

    def _of_fixed(self, z: Senses) -> Iterator[tuple[Sensor, Array, Array]]:
        """Every channel of fixed things: sensor, places (m, 2), readings (r, m, k)."""
        rssi, sighted, ranged = (self.sensors.get(name) for name in ("anchor_rssi", "landmark", "anchor_range"))
        if rssi is not None:
            yield rssi, self.anchors, z.anchor_rssi[..., None]
        if sighted is not None:
            yield sighted, self.landmarks, z.landmark
        if ranged is not None:
            yield ranged, self.anchors, z.extra["anchor_range"][..., None]

    def _of_mates(self, z: Senses, mail: Mail) -> Iterator[tuple[Sensor, Array]]:
        """Every channel of teammates: sensor, readings (r, n, k)."""
        channels = {"sighting": z.sighting, "radio_rssi": mail.rssi[..., None], "radio_range": mail.range[..., None]}
        for channel, readings in channels.items():
            sensor = self.sensors.get(channel)
            if sensor is not None:
                yield sensor, readings


def _present(readings: Array, things: int) -> Iterator[tuple[int, Array]]:
    """The number of each thing that any row has a reading (..., k) of, and these, from readings (..., things, k)."""
    absent = np.logical_and.reduce(np.isnan(readings), (*range(readings.ndim - 2), -1))
    return ((i, readings[..., i, :]) for i in (~absent[:things]).nonzero()[0].tolist())


class Stacked(NamedTuple):
    """All readings of one tick as one vector."""

    y: Array  # (..., m) innovation, nan where absent
    H: Array  # (..., m, d)
    R: Array  # (..., m, m)


def _stacked(x: Array, parts: list[tuple[Array, Array, Array]]) -> Stacked:
    lead, d = x.shape[:-1], x.shape[-1]
    y = np.concatenate([np.zeros((*lead, 0)), *(part[0] for part in parts)], -1)
    H = np.concatenate([np.zeros((*lead, 0, d)), *(part[1] for part in parts)], -2)
    R, at = np.zeros((*lead, y.shape[-1], y.shape[-1])), 0
    for _, _, block in parts:
        k = block.shape[-1]
        R[..., at : at + k, at : at + k] = block
        at += k
    return Stacked(y, H, R)
