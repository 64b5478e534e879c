"""One recording of a team, as every format is read: series with stamps of their own, in SI units, nothing resampled.

Readers (`csv`, `bags`, `pyfg`, `mrclam`) make it, `cooploc inspect` looks at it, and the scenario `log` turns it into
ticks. Stamps are seconds since the epoch or since an arbitrary zero, the same for all series unless a clock is off.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.scenarios.recordings.schema import GroundTruth
from cooploc.scenarios.recordings.text_files import MAX_STEP_BACK

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


# True poses as a description declares them: in another frame, and without positions that cannot be.


def true_poses(time: Array, poses: Array, declared: GroundTruth) -> tuple[Array, int]:
    """Poses (m, 3) in the team's frame, and how many became nan as the robot cannot have been there.

    Args:
        time: (m,) rising [s].
        poses: (m, 3) x, y [m], heading [rad], as recorded; nan where absent.
        declared: `frame` and `max_speed`.

    """
    x, y, heading = poses.T
    if declared.frame == "mirrored":
        y, heading = -y, -heading
    elif declared.frame == "swapped":
        x, y, heading = y, x, np.pi / 2 - heading
    framed = np.stack([x, y, heading], -1)  # not wrapped: degrees that were not declared must remain visible
    jumps = unreachable(time, framed[:, :2], declared.max_speed or np.inf)
    framed[jumps] = np.nan
    return framed, int(jumps.sum())


def unreachable(time: Array, positions: Array, speed: float) -> Mask:
    """Positions (m, 2) that cannot be reached from the last valid one at `speed` [m/s]."""
    bad: Mask = np.zeros(len(time), bool)
    if not np.isfinite(speed):
        return bad
    known = np.flatnonzero(np.isfinite(positions).all(-1))
    last = known[0] if len(known) else 0
    for k in map(int, known[1:]):
        bad[k] = np.hypot(*(positions[k] - positions[last])) > speed * (time[k] - time[last])
        last = last if bad[k] else k
    return bad


# What a reader found of each robot, demanded and put in order: odometry of all, and truth of some.


def odometry_of(place: Path, found: Mapping[str, Series], robots: Sequence[str]) -> tuple[Series, ...]:
    """Odometry of every robot.

    Raises:
        BadInput: one has fewer than two samples.

    """
    for robot in robots:
        if robot not in found or len(found[robot].time) < 2:
            raise BadInput(
                f"{place}: robot {robot!r} has fewer than two samples of odometry; correct [odometry] of log.toml, or "
                "take it out of `robots`"
            )
    return tuple(found[robot] for robot in robots)


def truth_of(
    place: Path, found: Mapping[str, Series], robots: Sequence[str], table: GroundTruth, warnings: list[str]
) -> tuple[Series | None, ...]:
    """True poses of every robot, None of those that have none; what is missing or left out goes into `warnings`.

    Raises:
        BadInput: no robot has a truth.

    """
    poses: list[Series | None] = []
    for robot in robots:
        series = found.get(robot)
        if series is None or len(series.time) < 2:
            warnings.append(f"{place}: robot {robot!r} has no truth, and so no errors")
            poses.append(None)
            continue
        values, jumps = true_poses(series.time, series.values, table)
        if jumps:
            warnings.append(f"{series.source}: {jumps} true positions are out of reach at max_speed, and were left out")
        poses.append(series._replace(values=values))
    if all(series is None for series in poses):
        raise BadInput(f"{place}: no robot has a truth; correct [truth] of log.toml")
    return tuple(poses)


# A series of one robot, put into order.


def in_order(time: Array, values: Array, source: str, where: Callable[[int], str]) -> tuple[Series, list[str]]:
    """A series whose stamps rise, and what was left out: lines without a number, and repeated stamps.

    Args:
        time: (m,) [s] as recorded; steps back of up to `MAX_STEP_BACK` are sorted.
        values: (m, k); of the first two columns both must be there, a nan elsewhere is kept.
        source: file or topic.
        where: the place of a row, for an error.

    Raises:
        BadInput: a stamp is missing, or steps back by more.

    """
    if np.isnan(time).any():
        raise BadInput(f"{where(int(np.argmax(np.isnan(time))))}: the stamp is missing; correct or remove the line")
    late = np.maximum.accumulate(time) - time if len(time) else time
    if (late > MAX_STEP_BACK).any():
        row = int(np.argmax(late > MAX_STEP_BACK))
        raise BadInput(f"{where(row)}: its time is {late[row]:.3f} s before an earlier line's; sort the file by time")
    order = np.argsort(time, kind="stable")
    time, values = time[order], values[order]
    there = np.isfinite(values[:, :2]).all(-1)
    time, values = time[there], values[there]
    first = np.append(True, np.diff(time) > 0)[: len(time)]
    reasons = {"lines without a number": int((~there).sum()), "lines that repeat a stamp": int((~first).sum())}
    warnings = [f"{source}: {count} {what} were left out" for what, count in reasons.items() if count]
    return Series(time[first], values[first], source), warnings


# Measurements between named things, divided into the channels of a team's log.

Kind = Literal["range", "rssi", "sighting"]
OF_ROBOTS: Mapping[Kind, Channel] = {"range": "range", "rssi": "rssi", "sighting": "sighting"}
OF_FIXED: Mapping[Kind, Channel] = {"range": "anchor_range", "rssi": "anchor_rssi", "sighting": "landmark"}


class Measured(NamedTuple):
    """Measurements of one source, with names."""

    time: Array  # (m,) [s]
    robot: Sequence[str]  # (m,) who measured
    other: Sequence[str]  # (m,) what was measured
    values: Array  # (m, k)  nan where absent
    source: str  # file or topic


def divided(
    kind: Kind, several: Sequence[Measured], robots: Sequence[str], fixed: Sequence[str]
) -> tuple[dict[Channel, Readings], list[str]]:
    """Readings of teammates, and of fixed things (anchors; of a sighting, landmarks), sorted by time.

    A measurement by or of something that is neither is left out, as are one of oneself, one without a number and a
    range that is not positive; each is told in a warning.
    """
    parts: dict[Channel, list[Readings]] = {OF_ROBOTS[kind]: [], OF_FIXED[kind]: []}
    warnings: list[str] = []
    for one in several:
        robot, mate, thing = (
            _numbers(names, of) for names, of in ((one.robot, robots), (one.other, robots), (one.other, fixed))
        )
        there = np.isfinite(one.values).all(-1)
        positive = there & ((one.values[:, 0] > 0) | (kind == "rssi"))
        known, itself = (robot >= 0) & ((mate >= 0) | (thing >= 0)), (robot == mate) & (robot >= 0)
        warnings += _told(one, robot < 0, one.robot, "measured by {}, which is not a robot of the team")
        warnings += _told(one, (robot >= 0) & ~known, one.other, "of {}, which is not a robot of the team, nor a place")
        warnings += _told(one, known & itself, one.robot, "of {} by itself")
        warnings += _told(one, there & ~positive, one.robot, "by {} that are not positive")
        good = known & ~itself & positive
        for channel, other in ((OF_ROBOTS[kind], mate), (OF_FIXED[kind], thing)):
            rows = np.flatnonzero(good & (other >= 0))
            parts[channel].append(Readings(one.time[rows], robot[rows], other[rows], one.values[rows], one.source))
    return {
        channel: _joined(channel, part) for channel, part in parts.items() if sum(len(p.time) for p in part)
    }, warnings


def _numbers(names: Sequence[str], known: Sequence[str]) -> Indices:
    """The index of each name among those known, -1 where it is not one."""
    index = {name: i for i, name in enumerate(known)}
    return np.array([index.get(name, -1) for name in names], np.int64)


def _told(one: Measured, dropped: Mask, names: Sequence[str], what: str) -> list[str]:
    rows = np.flatnonzero(dropped).tolist()
    if not rows:
        return []
    whose = sorted({names[row] for row in rows})
    shown = ", ".join(repr(name) for name in whose[:3]) + (f" and {len(whose) - 3} more" if len(whose) > 3 else "")
    return [f"{one.source}: {len(rows)} readings {what.format(shown)}, were left out"]


def _joined(channel: Channel, parts: Sequence[Readings]) -> Readings:
    """One table of several, by rising stamps."""
    time, robot, other = (np.concatenate([part[i] for part in parts]) for i in range(3))
    values = np.concatenate([part.values.reshape(-1, len(READING_COLUMNS[channel])) for part in parts])
    order = np.argsort(time, kind="stable")
    sources = dict.fromkeys(part.source for part in parts if len(part.time))
    return Readings(
        time[order], robot[order].astype(np.int64), other[order].astype(np.int64), values[order], ", ".join(sources)
    )
