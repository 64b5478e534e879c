"""The arrays of a robot's tick (prior knowledge, senses, mail) and the protocols that estimators satisfy.

One leading axis `r` holds (trial, robot) rows, trial-major. Robots meet only through mail, which the runner carries. An
estimator is a frozen dataclass of parameters with pure methods; its state is a NamedTuple of arrays, plus `world` and
scalars that all rows share. A tick is predict, correct, send, carry, fuse, estimate: odometry of tick k covers
(k-1, k], readings are taken at k, and the estimate after `fuse` is compared with the truth at k.

An estimator with hindsight, `offline = True`, has one method instead: `smooth(prior, world, rows, z, air)` returns
beliefs x (t, T, n, d), P (t, T, n, d, d) of every trial, tick and robot. The prior, before tick 0, and rows are
(t, n, ...), senses (t, T, n, ...); `air` has `heard`, `rssi`, `range` (t, T, n, n), axis 2 the receiver, no packets.

nan means absent, width 0 that the channel does not exist. SI units; x points east, y north, headings are
counter-clockwise from x in (-pi, pi].
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

API = 1  # the version of this interface
HEADER = 8  # bytes of a packet in addition to its payload

TOO_NEAR_TO_RANGE = 0.2  # [m] a range reading below this says nothing about direction and is refused
TEAM_PRIOR = "team_prior"  # the channel of a scenario that tells everyone's prior, x and P (r, n, d + d d)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]
Keys = NDArray[np.uint32]


class Belief(NamedTuple):
    """A Gaussian per row: the prior before tick 0, and the estimate after every tick."""

    x: Array  # (r, d)     x [m], y [m], and heading [rad] where d = 3
    P: Array  # (r, d, d)  its covariance


class Rows(NamedTuple):
    """The identity of each row. Identity and randomness come from here, never from a row's position."""

    trial: Indices  # (r,)
    robot: Indices  # (r,)  0 .. n-1
    key: Keys  # (r, 2)  seeds a counter-based generator; the same for every estimator


class Senses(NamedTuple):
    """The readings of all rows in one tick."""

    odometry: Array  # (r, k)     Displacement: dx, dy [m]; Unicycle: v [m/s], omega [rad/s]
    dt: Array  # (r,)       what the odometry covers [s]
    anchor_rssi: Array  # (r, a)     [dBm]
    landmark: Array  # (r, l, 2)  range [m], bearing [rad]; (r, l, k) of a sensor of k numbers, as a bearing alone
    sighting: Array  # (r, n, 2)  of teammates, likewise
    extra: Mapping[str, Array]  # anchor_range (r, a) [m], team_prior, and channels of plug-in scenarios, (r, ...)


class Mail(NamedTuple):
    """The packets that reached each row in one tick; axis 1 is the sender. Readings exist where something was heard."""

    heard: Mask  # (r, n)
    packets: Array  # (r, n, m)  nan where nothing was heard
    rssi: Array  # (r, n)     of the packet's own signal [dBm]
    range: Array  # (r, n)     from the same exchange [m]


class Traffic(NamedTuple):
    """The messages and bytes that each robot sent in one tick."""

    messages: Array  # (trial, n)
    bytes: Array  # (trial, n)


class Motion(Protocol):
    """A motion model: odometry moves a state. Shapes broadcast: x (..., d), u (..., k), dt (...)."""

    def move(self, x: Array, u: Array, dt: Array) -> tuple[Array, Array, Array]:
        """Return x', F = dx'/dx (..., d, d), Q (..., d, d)."""
        ...

    def sample(self, x: Array, u: Array, dt: Array, noise: Array) -> Array:
        """Return x' with the odometry's error drawn: `noise` (..., 2) is standard normal."""
        ...

    def retrace(self, trail: Array, u: Array, dt: Array) -> Array:
        """Return past positions `trail` (..., M, 2), as seen from the robot's pose, after one more move."""
        ...

    def place(self, x: Array, trail: Array) -> Array:
        """Return the positions (..., 2) in the world of a trail point (..., 2) seen from poses x (..., d)."""
        ...


class Sensor(Protocol):
    """A sensor model: x (..., d), a place q (..., 2), a reading z (..., k)."""

    @property
    def R(self) -> Array:
        """The reading's noise covariance (k, k)."""
        ...

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        """Return y = z - h(x, q) (..., k) with angles wrapped, H = dh/dx (..., k, d), Hq = dh/dq (..., k, 2).

        Derivatives are finite, also where x is at q.
        """
        ...


@dataclass(frozen=True, eq=False)
class World:
    """The team's knowledge in advance, the same for every estimator. Its models are assumed ones, not the truth."""

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
        """Yield the present readings of fixed things as (sensor, place (2,), reading (r, k)), anchors first."""
        for sensor, places, readings in self._of_fixed(z):
            yield from ((sensor, places[i], one) for i, one in _present(readings, len(places)))

    def relative(self, z: Senses, mail: Mail) -> Iterator[tuple[Sensor, int, Array]]:
        """Yield present readings of teammates as (sensor, sender, reading (r, k)), in the order of `of_teammates`."""
        for sensor, readings in self.of_teammates(z, mail):
            yield from ((sensor, j, one) for j, one in _present(readings, self.robots))

    def of_teammates(self, z: Senses, mail: Mail) -> list[tuple[Sensor, Array]]:
        """Return the sensors of teammates and their readings (r, n, k): sightings, then radio RSSI, then range."""
        channels = {"sighting": z.sighting, "radio_rssi": mail.rssi[..., None], "radio_range": mail.range[..., None]}
        return [(self.sensors[channel], readings) for channel, readings in channels.items() if channel in self.sensors]

    def stack(self, x: Array, z: Senses) -> tuple[Array, Array, Array]:
        """Return a tick's readings of fixed things as one vector y (..., m), H (..., m, d) and R (..., m, m).

        They are linearised at x (..., d), and of the same length m in every tick; y is nan where a reading is absent.
        """
        things = [(sensor, q, a[..., i, :]) for sensor, places, a in self._of_fixed(z) for i, q in enumerate(places)]
        parts = [sensor.innovation(x, q, reading) for sensor, q, reading in things]
        y = np.concatenate([x[..., :0], *(part[0] for part in parts)], -1)
        H = np.concatenate([np.zeros((*x.shape[:-1], 0, x.shape[-1])), *(part[1] for part in parts)], -2)
        R, at = np.zeros((*y.shape, y.shape[-1])), 0
        for sensor, _, _ in things:
            k = len(sensor.R)
            R[..., at : at + k, at : at + k] = sensor.R
            at += k
        return y, H, R

    def _of_fixed(self, z: Senses) -> Iterator[tuple[Sensor, Array, Array]]:
        """Yield every channel of fixed things: sensor, places (m, 2), readings (r, m, k)."""
        rssi, sighted, ranged = (self.sensors.get(name) for name in ("anchor_rssi", "landmark", "anchor_range"))
        if rssi is not None:
            yield rssi, self.anchors, z.anchor_rssi[..., None]
        if sighted is not None:
            yield sighted, self.landmarks, z.landmark
        if ranged is not None:
            yield ranged, self.anchors, z.extra["anchor_range"][..., None]


def _present(readings: Array, things: int) -> Iterator[tuple[int, Array]]:
    """Return the number of each thing that some row has a reading of, with these (..., k) of (..., things, k)."""
    absent = np.logical_and.reduce(np.isnan(readings), (*range(readings.ndim - 2), -1))
    return ((i, readings[..., i, :]) for i in (~absent[:things]).nonzero()[0].tolist())


S = TypeVar("S")


class Estimator(Protocol[S]):
    """An estimator that one robot runs.

    `uses` names the channels in order: Senses fields, `radio_rssi`, `radio_range`, or keys of `extra`. "a|b" takes
    the first that the stream has, "a?" is optional. The runner hides everything else, so the declaration is enforced.

    Optional members:
        notes: a method `notes(s)` -> {name: (r,)}, what the estimator counted, shown under the table; values of several
            trials are added, or their maximum is taken where the name begins with "largest".
        axes: a string, why its estimates do not turn with the world, for the check of equivariance.
        own_motion: a string, why it does not move as dead reckoning does where it has odometry alone, for the check of
            silence.
        mutable: True where its state changes in place; the check that inputs stay unchanged then leaves the state out.
    """

    api: ClassVar[int]

    @property
    def uses(self) -> tuple[str, ...]: ...

    def init(self, prior: Belief, world: World, rows: Rows) -> S:
        """Return the state before tick 0."""
        ...

    def predict(self, s: S, z: Senses) -> S:
        """Move by odometry."""
        ...

    def correct(self, s: S, z: Senses) -> S:
        """Use readings of fixed things: anchors, landmarks."""
        ...

    def send(self, s: S, z: Senses) -> Array:
        """Return what to transmit: (r, m) for everyone, or (r, n, m) with axis 1 the addressee. All-nan is silence."""
        ...

    def fuse(self, s: S, z: Senses, mail: Mail) -> S:
        """Use what was heard. Called in every tick, also where nothing was heard."""
        ...

    def estimate(self, s: S) -> Belief:
        """Return the belief that is compared with the truth: x (r, d), P (r, d, d), position first."""
        ...


class TeamEstimator(Protocol[S]):
    """An estimator that holds the whole team: every array is (trial, n, ...). It has neither `send` nor `fuse`.

    `bound` marks one that uses all readings of all robots as well as any estimator could. The optional members are
    those of `Estimator`, and `centralised: bool`, true for one whose readings all reach one computer, and so for every
    bound; such a one is shown beside distributed estimators and not ranked among them.
    """

    api: ClassVar[int]
    bound: ClassVar[bool]

    @property
    def uses(self) -> tuple[str, ...]: ...

    def init(self, prior: Belief, world: World, rows: Rows) -> S: ...

    def predict(self, s: S, z: Senses) -> S: ...

    def correct(self, s: S, z: Senses) -> S: ...

    def exchange(self, s: S, z: Senses, air: Mail) -> tuple[S, Traffic]:
        """Use readings between robots, (trial, n, n) with axis 1 the receiver, and say what was sent.

        `air` has no packets. A centralised one returns zero Traffic: the runner counts what its robots must upload.
        """
        ...

    def estimate(self, s: S) -> Belief: ...
