"""One recording of a team, as every format is read: series with stamps of their own, in SI units, nothing resampled.

Readers (`csv`, `bags`, `pyfg`, `mrclam`) make it, `cooploc inspect` looks at it, and the scenario `log` turns it into
ticks. Stamps are seconds since the epoch or since an arbitrary zero, the same for all series unless a clock is off.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

from cooploc.estimators.interface import Array, Indices

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
