"""One recording of a team, as every format is read: series with stamps of their own, in SI units, nothing resampled.

Readers (`csv`, `bags`, `pyfg`, `mrclam`) make it, `cooploc inspect` looks at it, and the scenario `log` turns it into
ticks. Stamps are seconds since the epoch or since an arbitrary zero, the same for all series unless a clock is off.

A fault of a recording that does not spoil the rest is repaired or left out where the reader meets it, and becomes a
sentence in `TeamLog.warnings`: lines of a file in `text_files.read_lines`, stamps and gaps in `order_series`,
impossible positions in `true_poses`, names and values of readings in `split_channels`.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from reprlib import repr as short_repr
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from cooploc.estimators.errors import BadInput, count_of, first_of, nearest
from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.scenarios.recordings.schema import (
    GroundTruth,
    PlacesTable,
    ReadingColumns,
    SightingsTable,
    TeamDescription,
    values_of,
)
from cooploc.scenarios.recordings.text_files import time_order

MARGIN = 2.0  # [m] around all fixed things
OdometryKind = Literal["velocity", "pose", "displacement", "path"]
Channel = Literal["range", "rssi", "sighting", "landmark", "anchor_rssi", "anchor_range"]

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


class ReadingSeries(NamedTuple):
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
    readings: Mapping[Channel, ReadingSeries]
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


def arena_around(fixed: Array) -> Array:
    """Return the corners (2, 2) [m] of the arena around fixed things (p, 2): it must not be taken from the truth."""
    return np.stack([fixed.min(0) - MARGIN, fixed.max(0) + MARGIN])


def shift_stamps(log: TeamLog, by: float) -> TeamLog:
    """Return the recording with some seconds added to all stamps."""
    odometry = tuple(s._replace(time=s.time + by) for s in log.odometry)
    truth = tuple(s and s._replace(time=s.time + by) for s in log.truth)
    readings = {channel: r._replace(time=r.time + by) for channel, r in log.readings.items()}
    return log._replace(odometry=odometry, truth=truth, readings=readings)


# ---- True poses as a description declares them: in another frame, and without positions that cannot be


LOST = 0.5  # [m] from a robot's positions before and after: at 0, 0 it was lost by the tracker


def true_poses(time: Array, poses: Array, declared: GroundTruth, robot: str) -> tuple[Array, dict[str, int]]:
    """Return poses (m, 3) in the team's frame, nan where they cannot be; and why, with the number of lines.

    `poses` are x, y [m], heading [rad] as recorded at `time` [s], nan where absent. They are stale, out of reach (no
    `max_speed` leads there from the last valid one), or exactly 0, 0 and far from those before and after, as trackers
    write what they have lost.
    """
    zero, known = (poses[:, :2] == 0).all(-1), np.isfinite(poses[:, :2]).all(-1)
    there = np.flatnonzero(known & ~zero)
    after = np.searchsorted(there, np.flatnonzero(zero))
    near = there[np.clip([after - 1, after], 0, len(there) - 1)] if len(there) else np.zeros((2, len(after)), np.int64)
    lost = np.flatnonzero(zero)[(np.hypot(*poses[near, :2].T) > LOST).all(-1)]
    poses = poses.copy()
    poses[lost] = np.nan
    x, y, heading = poses.T
    if declared.origin:
        x, y = metres_on_globe(y, x, declared.origin)
    if declared.frame == "mirrored":
        y, heading = -y, -heading
    elif declared.frame == "swapped":
        x, y, heading = y, x, np.pi / 2 - heading
    heading = heading + values_of(declared.heading_offset, [robot])
    framed = np.stack([x, y, heading], -1)  # not wrapped: degrees that were not declared must remain visible
    if declared.repeats == "stale":
        framed[1:][(np.diff(framed[:, :2], axis=0) == 0).all(-1)] = np.nan
    jumps = 0
    if declared.max_speed:
        last, *rest = np.flatnonzero(np.isfinite(framed[:, :2]).all(-1)).tolist() or [0]
        for k in rest:
            if np.hypot(*(framed[k, :2] - framed[last, :2])) > declared.max_speed * (time[k] - time[last]):
                framed[k] = np.nan
                jumps += 1
            else:
                last = k
    away = "at exactly 0, 0, far from those before and after: lost by the tracker"
    return framed, {"out of reach at max_speed": jumps, away: len(lost)}


EQUATOR, ECCENTRICITY = 6_378_137.0, 0.0818191908426215  # [m] and of the ellipsoid WGS 84


def metres_on_globe(latitude: Array, longitude: Array, origin: tuple[float, float]) -> tuple[Array, Array]:
    """Return x east and y north [m] of places near an origin, all in degrees: to 0.3 m at 1 km.

    x = N cos(phi) dlambda, y = M dphi, with the radii of curvature N and M of WGS 84 at the origin's latitude phi.
    """
    phi = np.radians(origin[0])
    w = 1 - (ECCENTRICITY * np.sin(phi)) ** 2
    N, M = EQUATOR / w**0.5, EQUATOR * (1 - ECCENTRICITY**2) / w**1.5
    return N * np.cos(phi) * np.radians(longitude - origin[1]), M * np.radians(latitude - origin[0])


# ---- A series of one robot, put into order

LONGEST = 2 * 86_400.0  # [s] from the median stamp; what is further away has a damaged stamp


def is_near(time: Array) -> Mask:
    """Return whether each stamp (m,) [s] is within days of the others; False where it is nan."""
    stamped = time[np.isfinite(time)]
    return np.asarray(np.abs(time - np.median(stamped)) <= LONGEST) if len(stamped) else np.zeros(len(time), bool)


def order_series(time: Array, values: Array, source: str, last: bool = False) -> tuple[Series, list[str]]:
    """Return a series whose stamps rise, and sentences of what was left out or sorted.

    Of the first two columns both must be there, a nan elsewhere is kept; a line in which all are nan is of something
    else, and not counted. Of lines with one stamp the first stays, or the `last`, as of commands.
    """
    other = np.isnan(values).all(-1)
    stamped, near, there = np.isfinite(time), is_near(time), np.isfinite(values[:, :2]).all(-1)
    good = np.flatnonzero(near & there)
    order, notes = time_order(time[good])
    time, values = time[good][order], values[good][order]
    rises = np.diff(time) > 0
    kept = (np.append(rises, True) if last else np.append(True, rises))[: len(time)]
    reasons = {
        "without a stamp": int((~stamped).sum()),
        "without a number": int((near & ~there & ~other).sum()),
        "whose stamp is days from the others": int((stamped & ~near).sum()),
        "whose stamp was given before": int((~kept).sum()),
    }
    left_out = [f"{source}: left out {count_of(n, 'line')} {why}" for why, n in reasons.items() if n]
    return Series(time[kept], values[kept], source), [*left_out, *(f"{source}: {note}" for note in notes)]


LEAP = 10.0  # times a usual speed, and a metre: a counter that goes on faster leaps


def without_leaps(counter: Series) -> tuple[Series, list[str]]:
    """Return a counter of metres (m, 1 or 2) that goes on where it leaps, as one that overflows or begins again."""
    steps = np.diff(counter.values[:, 0])
    speed = np.abs(steps) / np.diff(counter.time)  # across a gap a counter rises by much, and is right
    usual = np.quantile(driven, 0.9) if len(driven := speed[steps != 0]) else np.inf
    leaps = (np.abs(steps) > 1.0) & (speed > LEAP * usual)
    if not leaps.any():
        return counter, []
    values = counter.values.copy()
    values[1:, 0] = values[0, 0] + np.cumsum(np.where(leaps, 0.0, steps))
    longest = f"{steps[np.argmax(np.abs(steps))]:.4g} m"
    note = f"{counter.source}: the counter leaps {count_of(int(leaps.sum()), 'time')}, by up to {longest}; it goes on"
    return counter._replace(values=values), [f"{note} as if it stood"]


def compose_poses(steps: Array) -> Array:
    """Return the poses (m + 1, 3) from the origin on to which steps (m, 3), each in the frame of the pose before, lead.

    x' = x + R(heading) dx, heading' = heading + turn.
    """
    poses = [(0.0, 0.0, 0.0)]
    for dx, dy, turn in steps.tolist():
        x, y, heading = poses[-1]
        c, s = np.cos(heading), np.sin(heading)
        poses.append((x + c * dx - s * dy, y + s * dx + c * dy, heading + turn))
    return np.array(poses)


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


def chosen_robots(found: Sequence[str], d: TeamDescription | None, place: Path) -> tuple[str, ...]:
    """Return the robots of a recording that the description names, in its order; all if it names none."""
    chosen = (d.robots if d else ()) or tuple(found)
    if stranger := next((robot for robot in chosen if robot not in found), ""):
        raise BadInput(f"{place}: there is no robot {stranger!r}; {nearest(stranger, list(found))}")
    return chosen


def stated_places(stated: PlacesTable | None) -> Places:
    """Return the fixed things that a table of a description names."""
    places = stated.places if stated else {}
    return Places(tuple(places), np.array(list(places.values()), float).reshape(-1, 2))


def reading_tables(d: TeamDescription) -> Iterator[tuple[Kind, Sequence[ReadingColumns], Places]]:
    """Yield each kind of reading, its tables in a description, and the fixed things that it may be of."""
    yield "range", d.ranges, stated_places(d.anchors)
    yield "rssi", d.rssi, stated_places(d.anchors)
    yield "sighting", d.sightings, stated_places(d.landmarks)


def build_log(
    place: Path,
    name: str,
    d: TeamDescription,
    odometry: Mapping[str, Series],
    truth: Mapping[str, Series],
    measured: Mapping[Kind, Sequence[Measured]],
    warnings: Sequence[str],
) -> TeamLog:
    """Return the log of what was found of each robot."""
    notes = list(warnings)
    robots = tuple(robot for robot in d.robots if robot in odometry and len(odometry[robot].time) > 1)
    lost = [robot for robot in d.robots if robot not in robots]
    if not robots:
        why = next((f" ({note})" for note in notes if "there is no topic" in note), "")  # the first is of odometry
        raise BadInput(f"{place}: no robot has two samples of odometry{why}; correct [odometry] of log.toml")
    notes += [f"{place}: robot {robot!r} has fewer than two samples of odometry; it was left out" for robot in lost]
    poses: list[Series | None] = []
    for robot in robots:
        series = truth.get(robot)
        if d.truth is None or series is None or len(series.time) < 2:
            notes += [f"{place}: robot {robot!r} has no truth, and so no errors"] * (d.truth is not None)
            poses.append(None)
            continue
        values, left_out = true_poses(series.time, series.values, d.truth, robot)
        poses.append(series._replace(values=values))
        notes += [f"{series.source}: left out {count_of(n, 'true position')} {w}" for w, n in left_out.items() if n]
    readings: dict[Channel, ReadingSeries] = {}
    for kind, _, fixed in reading_tables(d):
        channels, dropped = split_channels(kind, measured.get(kind, []), robots, fixed.names)
        readings |= channels
        notes += dropped
    biases = values_of(d.moves.turn_bias, robots)
    moved = tuple(
        odometry[robot]._replace(values=odometry[robot].values - [0.0, bias]) if bias else odometry[robot]
        for robot, bias in zip(robots, biases, strict=True)
    )
    landmarks, anchors = stated_places(d.landmarks), stated_places(d.anchors)
    if d.anchors and "anchor_range" in readings:
        slant = readings.pop("anchor_range")
        level, near = level_ranges(slant, values_of(d.anchors.height, anchors.names))
        readings |= {"anchor_range": level} if len(level.time) else {}
        notes += [f"{slant.source}: left out {count_of(near, 'range')} no longer than the anchor's height"] * bool(near)
    of: OdometryKind = "pose" if d.moves.kind == "increment" else d.moves.kind
    return TeamLog(name, robots, of, moved, tuple(poses), readings, landmarks, anchors, tuple(notes))


def level_ranges(slant: ReadingSeries, heights: Array) -> tuple[ReadingSeries, int]:
    """Return ranges to anchors of these heights (a,) [m] along the floor, (r^2 - h^2)^1/2, and how many have none."""
    squared = slant.values[:, 0] ** 2 - heights[slant.other] ** 2
    if not heights.any():
        return slant, 0
    k = np.flatnonzero(squared > 0)
    level = ReadingSeries(slant.time[k], slant.robot[k], slant.other[k], np.sqrt(squared[k])[:, None], slant.source)
    return level, len(squared) - len(k)


def without_missing(table: ReadingColumns, values: Array, robots: Sequence[str]) -> Array:
    """Return values (m, k) by robots (m,), nan where they stand for no reading; of sightings range and bearing."""
    if isinstance(table, SightingsTable):
        if table.columns == ("x", "y"):
            values = np.stack([np.hypot(*values.T), np.arctan2(*values.T[::-1])], -1)
        return values + np.stack([np.zeros(len(values)), values_of(table.bearing_offset, robots)], -1)
    limit, least = getattr(table, "missing_from", None), getattr(table, "missing_below", -np.inf)
    return values if limit is None else np.where((values >= limit) | (values < least), np.nan, values)


def split_channels(
    kind: Kind, several: Sequence[Measured], robots: Sequence[str], fixed: Sequence[str]
) -> tuple[dict[Channel, ReadingSeries], list[str]]:
    """Return readings of teammates and of fixed things, by rising stamps, and sentences of what was left out.

    Left out are measurements by or of something else, of oneself, without a number, and ranges that are not positive.
    """
    parts: dict[Channel, list[ReadingSeries]] = {}
    notes: list[str] = []
    for one in several:
        robot, mate, thing = (
            _numbers(names, of) for names, of in ((one.robot, robots), (one.other, robots), (one.other, fixed))
        )
        if kind != "sighting":  # it is of both, whichever the file names first
            anchor = _numbers(one.robot, fixed)
            turned = (robot < 0) & (anchor >= 0)
            robot, mate, thing = np.where(turned, [mate, np.full_like(mate, -1), anchor], [robot, mate, thing])
        near = is_near(one.time)
        whole = pd.DataFrame({"time": one.time, "robot": one.robot, "other": one.other}).join(pd.DataFrame(one.values))
        again = whole.duplicated().to_numpy() & near
        there = np.isfinite(one.values).all(-1) & near
        positive = there & ((one.values[:, 0] > 0) | (kind == "rssi"))
        known, itself = (robot >= 0) & ((mate >= 0) | (thing >= 0)), (robot == mate) & (robot >= 0)
        fixed_is = "a landmark" if kind == "sighting" else "an anchor"
        for dropped, names, what in (
            (there & (robot < 0), one.robot, "measured by {}: no robot of the team"),
            (there & (robot >= 0) & ~known, one.other, f"of {{}}: neither a robot of the team nor {fixed_is}"),
            (there & known & itself, one.robot, "of {} by itself"),
            (~near, one.robot, "by {} with stamps that are days from the others"),
            (there & ~positive, one.robot, "by {} with a range of 0 or less"),
            (there & again, one.robot, "by {}, there twice to the digit"),
        ):
            rows = np.flatnonzero(dropped).tolist()
            whose = sorted({names[row] for row in rows})
            some = first_of(map(short_repr, whose))
            notes += [f"{one.source}: left out {count_of(len(rows), 'reading')} {what.format(some)}"] * bool(rows)
        good = known & ~itself & positive & ~again
        for channel, other in zip(CHANNELS[kind], (mate, thing), strict=True):
            at = np.flatnonzero(good & (other >= 0))
            if len(at):
                found = ReadingSeries(one.time[at], robot[at], other[at], one.values[at], one.source)
                parts.setdefault(channel, []).append(found)
    merged: dict[Channel, ReadingSeries] = {}
    for channel in filter(parts.__contains__, CHANNELS[kind]):
        time, robot, other, values = (np.concatenate([part[i] for part in parts[channel]]) for i in range(4))
        order = np.argsort(time, kind="stable")
        sources = ", ".join(dict.fromkeys(part.source for part in parts[channel]))
        merged[channel] = ReadingSeries(time[order], robot[order], other[order], values[order], sources)
    return merged, notes


def _numbers(names: Sequence[str], known: Sequence[str]) -> Indices:
    """The index of each name among those known, -1 where it is not one."""
    index = {name: i for i, name in enumerate(known)}
    return np.array([index.get(name, -1) for name in names], np.int64)
