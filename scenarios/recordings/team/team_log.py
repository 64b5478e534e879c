"""One recording of a team, as every format is read: series with stamps of their own, in SI units, nothing resampled.

Readers (`csv`, `bags`, `pyfg`, `mrclam`) make it, `cooploc inspect` looks at it, and the scenario `log` turns it into
ticks. Stamps are seconds since the epoch or since an arbitrary zero, the same for all series unless a clock is off.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Indices, Mask

OdometryKind = Literal["velocity", "pose", "displacement", "path"]
Channel = Literal["range", "rssi", "sighting", "landmark", "anchor_rssi", "anchor_range"]

# What the columns of a series are. Headings are counter-clockwise from x.
ODOMETRY_COLUMNS: Mapping[OdometryKind, tuple[str, ...]] = {
    "velocity": ("v [m/s]", "omega [rad/s]"),
    "pose": ("x [m]", "y [m]", "heading [rad]"),  # in a frame of its own, integrated since some start
    "displacement": ("dx [m]", "dy [m]"),  # since the line before, in a compass frame
    "path": ("length [m]", "omega [rad/s]"),  # length is a counter
}
READING_COLUMNS: Mapping[Channel, tuple[str, ...]] = {
    "range": ("range [m]",),  # robot to robot, by radio
    "rssi": ("rssi [dBm]",),  # robot to robot
    "sighting": ("range [m]", "bearing [rad]"),  # of a teammate
    "landmark": ("range [m]", "bearing [rad]"),  # of a surveyed landmark
    "anchor_rssi": ("rssi [dBm]",),  # of a fixed radio node
    "anchor_range": ("range [m]",),  # to a fixed radio node
}


class Series(NamedTuple):
    """Values of one robot over time."""

    time: Array  # (m,)    rises [s]
    values: Array  # (m, k)  nan where a value is absent
    source: str  # file or topic, to be named in messages


class Readings(NamedTuple):
    """Measurements between a robot and a teammate, a landmark or an anchor."""

    time: Array  # (m,)    rises, equal stamps allowed [s]
    robot: Indices  # (m,)    who measured: index into `TeamLog.robots`
    other: Indices  # (m,)    what was measured: index into robots, landmarks or anchors, as the channel says
    values: Array  # (m, k)
    source: str


class Places(NamedTuple):
    """Fixed things with names."""

    names: tuple[str, ...]
    positions: Array  # (p, 2)  nan where not known [m]


class TeamLog(NamedTuple):
    """One recording of one or more robots."""

    name: str
    robots: tuple[str, ...]
    odometry_kind: OdometryKind
    odometry: tuple[Series, ...]  # one a robot
    truth: tuple[Series | None, ...]  # x, y [m], heading [rad] (nan where it was not recorded)
    readings: Mapping[Channel, Readings]
    landmarks: Places
    anchors: Places
    warnings: tuple[str, ...] = ()  # what was dropped while reading, one sentence each


def with_known_places(log: TeamLog) -> TeamLog:
    """The log without fixed things whose place is not known, of which no estimator can make anything."""
    log = _known(log, "landmarks", ("landmark",))
    return _known(log, "anchors", ("anchor_rssi", "anchor_range"))


def _known(log: TeamLog, what: Literal["landmarks", "anchors"], channels: tuple[Channel, ...]) -> TeamLog:
    places: Places = getattr(log, what)
    there: Mask = np.asarray(np.isfinite(places.positions).all(-1))
    if there.all():
        return log
    lost = [name for name, known in zip(places.names, there, strict=True) if not known]
    number = np.where(there, np.cumsum(there) - 1, -1)
    readings = dict(log.readings)
    for channel in set(channels) & set(readings):
        r = readings[channel]
        kept = there[r.other]
        readings[channel] = Readings(r.time[kept], r.robot[kept], number[r.other][kept], r.values[kept], r.source)
        if not kept.any():
            del readings[channel]
    names = tuple(name for name, known in zip(places.names, there, strict=True) if known)
    told = f"the places of {', '.join(lost)} are not known; their readings were left out"
    log, found = log._replace(readings=readings, warnings=(*log.warnings, told)), Places(names, places.positions[there])
    return log._replace(landmarks=found) if what == "landmarks" else log._replace(anchors=found)
