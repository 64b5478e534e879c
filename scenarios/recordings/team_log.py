"""One recording of a team, as every format is read: series with stamps of their own, in SI units, nothing resampled.

Readers (`csv`, `bags`, `pyfg`, `mrclam`) make it, `cooploc inspect` looks at it, and the scenario `log` turns it into
ticks. Stamps are seconds since the epoch or since an arbitrary zero, the same for all series unless a clock is off.

A fault of a recording that does not spoil the rest is repaired or left out where the reader meets it, and becomes a
sentence in `TeamLog.warnings`: lines of a file in `text_files.read_lines`, stamps and gaps in `order_series`,
impossible positions in `true_poses`, names and values of readings in `split_channels`.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.scenarios.recordings.schema import GroundTruth, ReadingColumns, TeamDescription
from cooploc.scenarios.recordings.text_files import count_of, time_order

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
    positions: Array  # (p, 2) [m]


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
    zero: float = 0.0  # [s] of all stamps, where a lone robot's lines are its ticks: to the nanosecond


def fixed_places(log: TeamLog, channel: Channel) -> Places | None:
    """Return the fixed things that a channel is a reading of; None: it is of teammates."""
    if channel == "landmark":
        return log.landmarks
    return log.anchors if channel.startswith("anchor") else None


def other_names(log: TeamLog, channel: Channel) -> tuple[str, ...]:
    """Return the names of the things that a channel can be a reading of."""
    fixed = fixed_places(log, channel)
    return log.robots if fixed is None else fixed.names


# ---- True poses as a description declares them: in another frame, and without positions that cannot be


def true_poses(time: Array, poses: Array, declared: GroundTruth) -> tuple[Array, int]:
    """Return poses (m, 3) in the team's frame, nan where they are stale or out of reach, and how many are the latter.

    Args:
        time: (m,) rising [s].
        poses: (m, 3) x, y [m], heading [rad], as recorded; nan where absent.
        declared: `frame`, `repeats` and `max_speed`.

    """
    x, y, heading = poses.T
    if declared.frame == "mirrored":
        y, heading = -y, -heading
    elif declared.frame == "swapped":
        x, y, heading = y, x, np.pi / 2 - heading
    framed = np.stack([x, y, heading], -1)  # not wrapped: degrees that were not declared must remain visible
    if declared.repeats == "stale":
        framed[1:][(np.diff(framed[:, :2], axis=0) == 0).all(-1)] = np.nan
    jumps = unreachable(time, framed[:, :2], declared.max_speed or np.inf)
    framed[jumps] = np.nan
    return framed, int(jumps.sum())


def unreachable(time: Array, positions: Array, speed: float) -> Mask:
    """Return which positions (m, 2) cannot be reached from the last valid one at `speed` [m/s]."""
    bad: Mask = np.zeros(len(time), bool)
    if not np.isfinite(speed):
        return bad
    known = np.flatnonzero(np.isfinite(positions).all(-1))
    last = known[0] if len(known) else 0
    for k in map(int, known[1:]):
        bad[k] = np.hypot(*(positions[k] - positions[last])) > speed * (time[k] - time[last])
        last = last if bad[k] else k
    return bad


# ---- A series of one robot, put into order


def order_series(time: Array, values: Array, source: str, last: bool = False) -> tuple[Series, list[str]]:
    """Return a series whose stamps rise, and what was left out or sorted, a sentence each.

    Args:
        time: (m,) [s] as recorded; `text_files.time_order` says what becomes of stamps that step back.
        values: (m, k); of the first two columns both must be there, a nan elsewhere is kept.
        source: file or topic.
        last: whether the last of several lines with one stamp stays, as of commands, instead of the first.

    """
    stamped, there = np.isfinite(time), np.isfinite(values[:, :2]).all(-1)
    good = np.flatnonzero(stamped & there)
    order, notes = time_order(time[good])
    time, values = time[good][order], values[good][order]
    rises = np.diff(time) > 0
    kept = (np.append(rises, True) if last else np.append(True, rises))[: len(time)]
    reasons = {
        "without a stamp": int((~stamped).sum()),
        "without a number": int((stamped & ~there).sum()),
        "whose stamp was given before": int((~kept).sum()),
    }
    left_out = [f"{source}: left out {count_of(n, 'line')} {why}" for why, n in reasons.items() if n]
    return Series(time[kept], values[kept], source), [*left_out, *(f"{source}: {note}" for note in notes)]


# ---- A team's log, put together from what a reader found

Kind = Literal["range", "rssi", "sighting"]
# The channel of readings of teammates, and of fixed things (anchors; of sightings, landmarks).
CHANNELS: Mapping[Kind, tuple[Channel, Channel]] = {
    "range": ("range", "anchor_range"),
    "rssi": ("rssi", "anchor_rssi"),
    "sighting": ("sighting", "landmark"),
}


class Measured(NamedTuple):
    """Measurements of one source, with names."""

    time: Array  # (m,) [s]
    robot: Sequence[str]  # (m,) who measured
    other: Sequence[str]  # (m,) what was measured
    values: Array  # (m, k)  nan where absent
    source: str  # file or topic


def reading_tables(
    d: TeamDescription, anchors: Places, landmarks: Places
) -> Iterator[tuple[Kind, Sequence[ReadingColumns], Places]]:
    """Yield each kind of reading, its tables in a description, and the fixed things that it may be of."""
    yield "range", d.ranges, anchors
    yield "rssi", d.rssi, anchors
    yield "sighting", d.sightings, landmarks


def build_log(
    place: Path,
    name: str,
    d: TeamDescription,
    odometry: Mapping[str, Series],
    truth: Mapping[str, Series],
    measured: Mapping[Kind, Sequence[Measured]],
    anchors: Places,
    landmarks: Places,
    warnings: Sequence[str],
) -> TeamLog:
    """Return the log of what was found of each robot."""
    notes = list(warnings)
    robots = tuple(robot for robot in d.robots if robot in odometry and len(odometry[robot].time) > 1)
    lost = [robot for robot in d.robots if robot not in robots]
    if not robots:
        raise BadInput(f"{place}: no robot has two samples of odometry; correct [odometry] of log.toml")
    notes += [f"{place}: robot {robot!r} has fewer than two samples of odometry; it was left out" for robot in lost]
    moves, declared = d.odometry_and_truth
    poses = tuple(_truth_of(place, robot, truth.get(robot), declared, notes) for robot in robots)
    if all(series is None for series in poses):
        raise BadInput(f"{place}: no robot has a truth; correct [truth] of log.toml")
    readings: dict[Channel, Readings] = {}
    for kind, _, fixed in reading_tables(d, anchors, landmarks):
        channels, left_out = split_channels(kind, measured[kind], robots, fixed.names)
        readings |= channels
        notes += left_out
    series = tuple(odometry[robot] for robot in robots)
    return TeamLog(name, robots, moves.kind, series, poses, readings, landmarks, anchors, tuple(notes))


def _truth_of(place: Path, robot: str, series: Series | None, declared: GroundTruth, notes: list[str]) -> Series | None:
    if series is None or len(series.time) < 2:
        notes.append(f"{place}: robot {robot!r} has no truth, and so no errors")
        return None
    values, jumps = true_poses(series.time, series.values, declared)
    if jumps:
        notes.append(f"{series.source}: {jumps} true positions are out of reach at max_speed, and were left out")
    return series._replace(values=values)


def split_channels(
    kind: Kind, several: Sequence[Measured], robots: Sequence[str], fixed: Sequence[str]
) -> tuple[dict[Channel, Readings], list[str]]:
    """Return readings of teammates and of fixed things, by rising stamps, and sentences of what was left out.

    Left out are measurements by or of something else, of oneself, without a number, and ranges that are not positive.
    """
    parts: list[tuple[Channel, Readings]] = []
    notes: list[str] = []
    for one in several:
        robot, mate, thing = (
            _numbers(names, of) for names, of in ((one.robot, robots), (one.other, robots), (one.other, fixed))
        )
        there = np.isfinite(one.values).all(-1)
        positive = there & ((one.values[:, 0] > 0) | (kind == "rssi"))
        known, itself = (robot >= 0) & ((mate >= 0) | (thing >= 0)), (robot == mate) & (robot >= 0)
        for dropped, names, what in (
            (robot < 0, one.robot, "measured by {}, which is not a robot of the team"),
            ((robot >= 0) & ~known, one.other, "of {}, which is not a robot of the team, nor a place"),
            (known & itself, one.robot, "of {} by itself"),
            (there & ~positive, one.robot, "by {} that are not positive"),
        ):
            notes += _note_of_rows(one, dropped, names, what)
        good = known & ~itself & positive
        for channel, other in zip(CHANNELS[kind], (mate, thing), strict=True):
            rows = np.flatnonzero(good & (other >= 0))
            if len(rows):
                parts.append(
                    (channel, Readings(one.time[rows], robot[rows], other[rows], one.values[rows], one.source))
                )
    return {
        c: _merge_readings([part for of, part in parts if of == c]) for c in CHANNELS[kind] if c in dict(parts)
    }, notes


def _numbers(names: Sequence[str], known: Sequence[str]) -> Indices:
    """The index of each name among those known, -1 where it is not one."""
    index = {name: i for i, name in enumerate(known)}
    return np.array([index.get(name, -1) for name in names], np.int64)


def _note_of_rows(one: Measured, dropped: Mask, names: Sequence[str], what: str) -> list[str]:
    rows = np.flatnonzero(dropped).tolist()
    if not rows:
        return []
    whose = sorted({names[row] for row in rows})
    shown = ", ".join(repr(name) for name in whose[:3]) + (f" and {len(whose) - 3} more" if len(whose) > 3 else "")
    return [f"{one.source}: {len(rows)} readings {what.format(shown)}, were left out"]


def _merge_readings(parts: Sequence[Readings]) -> Readings:
    """One table of several, by rising stamps."""
    time, robot, other, values = (np.concatenate([part[i] for part in parts]) for i in range(4))
    order = np.argsort(time, kind="stable")
    sources = ", ".join(dict.fromkeys(part.source for part in parts))
    return Readings(time[order], robot[order], other[order], values[order], sources)
