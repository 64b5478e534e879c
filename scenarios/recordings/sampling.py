"""A recording on a grid of ticks: odometry over each tick, true poses at its ends, each reading at the nearest tick.

Nothing is invented: across gaps truth is unknown, and so is a velocity; a counter, a pose or displacements still give
the distance. Of several readings in one cell the last is kept, and the others are counted.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Indices, Senses
from cooploc.estimators.models import wrap, wrap_heading
from cooploc.scenarios.recordings import team_log
from cooploc.scenarios.recordings.team_log import Channel, OdometryKind, ReadingSeries, Series, TeamLog
from cooploc.scenarios.stream import Air


def interpolate(stamps: Array, values: Array, at: Array, max_gap: float) -> Array:
    """Interpolate values (m, k), angles unwrapped, at times (T,): (T, k), nan outside and in gaps over `max_gap`."""
    after = np.searchsorted(stamps, at)
    inside = (after < len(stamps)) & (at >= stamps[0])
    after = np.minimum(after, len(stamps) - 1)
    gap = stamps[after] - stamps[np.maximum(after - 1, 0)]
    known = inside & ((gap <= max_gap) | (stamps[after] == at))
    line = np.stack([np.interp(at, stamps, column) for column in values.T], -1)
    return np.where(known[:, None], line, np.nan)


class Gaps(NamedTuple):
    """Longest intervals between two stamps across which values are known."""

    truth: float  # [s] it is not interpolated across longer gaps
    hold: float  # [s] a speed or a turn rate holds until the next line, at most so long


class Grid(NamedTuple):
    """Ticks of one length, or from each line of odometry to the next."""

    t0: float  # time of the prior [s]
    tick: float  # [s] of lines: their median interval
    ticks: int
    lines: Array | None = None  # (T + 1,) stamps [s]

    @property
    def edges(self) -> Array:
        """Ends of the ticks, after the prior's time (T + 1,) [s]."""
        return self.t0 + self.tick * np.arange(self.ticks + 1.0) if self.lines is None else self.lines

    @property
    def dt(self) -> Array:
        """Length of each tick (T,) [s]."""
        return np.full(self.ticks, self.tick) if self.lines is None else np.diff(self.lines)

    def nearest(self, time: Array) -> Indices:
        """Return the number of the tick whose end is nearest; -1 is before the first, `ticks` after the last."""
        if self.lines is None:
            return np.clip(np.floor((time - self.t0) / self.tick + 0.5), 0, self.ticks + 1).astype(np.int64) - 1
        return np.asarray(np.searchsorted(self.lines, time) - 1, np.int64)


def grid_of_lines(log: TeamLog, begin: float, end: float) -> Grid:
    """Return the ticks from each line of a lone robot's odometry to the next."""
    lines = log.odometry[0].time
    lines = lines[(lines >= begin) & (lines <= end)]
    if len(lines) < 2:
        raise BadInput(f"run {log.name!r} has {len(lines)} lines to be judged; choose a smaller start in log.toml")
    return Grid(float(lines[0]), float(np.median(np.diff(lines))), len(lines) - 1, lines)


def span(log: TeamLog) -> tuple[float, float]:
    """Return when every robot has odometry, from each one's first truth (if it has any) to the last truth [s]."""
    truths = [series for series in log.truth if series is not None and len(series.time)]
    if empty := next((series.source for series in log.odometry if not len(series.time)), ""):
        raise BadInput(f"run {log.name!r}: {empty} has no odometry: leave that robot out of robots in log.toml")
    begin = max(series.time[0] for series in (*log.odometry, *truths))
    end = min(min(s.time[-1] for s in log.odometry), max((s.time[-1] for s in truths), default=-np.inf))
    if not end > begin:
        sources = {s.source: (s.time[0], s.time[-1]) for s in (*log.odometry, *truths)}
        late, early = max(sources, key=lambda s: sources[s][0]), min(sources, key=lambda s: sources[s][1])
        raise BadInput(
            f"run {log.name!r}: {late} begins at {sources[late][0]:.3f} s and {early} ends at {sources[early][1]:.3f} "
            "s; they share no time: state clock_offset [s] in log.toml for those whose clock is off"
        )
    return float(begin), float(end)


def require_common_time(log: TeamLog) -> None:
    """Refuse readings of which none lies between the first odometry and the last: their clock is another."""
    stamps = np.array([s.time[[0, -1]] for s in log.odometry if len(s.time)])
    begin, end = np.min(stamps, initial=np.inf), np.max(stamps, initial=-np.inf)
    for readings in (r for r in log.readings.values() if len(r.time) and stamps.size):
        first, last = readings.time[[0, -1]]
        if first > end or last < begin:
            raise BadInput(
                f"run {log.name!r}: {readings.source} has readings from {first:.3f} to {last:.3f} s, and odometry "
                f"is from {begin:.3f} to {end:.3f} s; they share no time: state clock_offset [s] in that table"
            )


def poses(series: Series | None, at: Array, max_gap: float, headings: bool = True) -> Array:
    """Return true poses (len(at), 3) at some times [s]; nan where unknown, and headings only if asked for."""
    found = np.full((len(at), 3), np.nan)
    if series is None:
        return found
    t = at[0] if len(at) else 0.0  # small numbers keep their digits
    for columns in (slice(2), slice(2, 3))[: 1 + headings]:
        stamps, known = series.time, series.values[:, columns]
        if not np.isfinite(known).all():
            there = np.isfinite(known).all(-1)
            stamps, known = stamps[there], known[there]
        if len(known):
            known = np.unwrap(known, axis=0) if columns.start else known
            found[:, columns] = interpolate(stamps - t, known, at - t, max_gap)
    return wrap_heading(found)


def poses_at(log: TeamLog, robot: Indices, time: Array, max_gap: float | None = None, headings: bool = True) -> Array:
    """Return the true poses (m, 3) of robots (m,), each at its own time [s]; nan where unknown.

    Without `max_gap` [s] they are interpolated across five usual intervals, at least half a second.
    """
    found = np.full((len(time), 3), np.nan)
    for i in np.unique(robot):
        truth = log.truth[i]
        if truth is not None and len(truth.time) > 1:
            gap = max(5 * float(np.median(np.diff(truth.time))), 0.5) if max_gap is None else max_gap
            found[robot == i] = poses(truth, time[robot == i], gap, headings)
    return found


def ends(log: TeamLog, channel: Channel, max_gap: float | None = None, headings: bool = True) -> tuple[Array, Array]:
    """Return the true poses (m, 3) of those who measured, and the places (m, 2) of what they measured."""
    readings, fixed = log.readings[channel], team_log.fixed_places(log, channel)
    here = poses_at(log, readings.robot, readings.time, max_gap, headings)
    if fixed is None:
        return here, poses_at(log, readings.other, readings.time, max_gap, headings=False)[:, :2]
    return here, fixed.positions[readings.other]


def odometry(kind: OdometryKind, series: Series, grid: Grid, max_hold: float) -> Array:
    """Return the odometry of a robot in each tick (T, 2): v [m/s], omega [rad/s]; or dx, dy [m]."""
    time, edges, u = series.time - grid.t0, grid.edges - grid.t0, series.values
    if kind == "velocity":
        return _hold_values(time, u, grid, max_hold)
    if kind == "path":
        length = np.diff(interpolate(time, u[:, :1], edges, np.inf), axis=0) / grid.dt[:, None]
        return np.concatenate([length, _hold_values(time, u[:, 1:], grid, max_hold)], -1)
    if kind == "displacement":
        return np.diff(interpolate(time, np.cumsum(u, axis=0), edges, np.inf), axis=0)
    turned = np.concatenate([u[:, :2], np.unwrap(u[:, 2:], axis=0)], -1)
    step = np.diff(interpolate(time, turned, edges, np.inf), axis=0)
    course = interpolate(time, turned, edges[:-1], np.inf)[:, 2] + step[:, 2] / 2
    forward = step[:, 0] * np.cos(course) + step[:, 1] * np.sin(course)
    return np.stack([forward, step[:, 2]], -1) / grid.dt[:, None]


def cells(readings: ReadingSeries, grid: Grid, robots: int, others: int) -> tuple[Array, dict[str, Any]]:
    """Return readings (T, robots, others, k), each at the tick nearest to its stamp, and counts of them."""
    k = grid.nearest(readings.time)
    inside = (k >= 0) & (k < grid.ticks)
    shape = (grid.ticks, robots, others)
    flat = np.asarray(
        np.ravel_multi_index((k[inside], readings.robot[inside], readings.other[inside]), shape), np.int64
    )
    cell, last = np.unique(flat[::-1], return_index=True)
    table = np.full((grid.ticks * robots * others, readings.values.shape[1]), np.nan)
    table[cell] = readings.values[inside][::-1][last]
    counts = {
        "readings": len(k),
        "kept": len(cell),
        "collisions": int(inside.sum()) - len(cell),
        "outside_span": int((~inside).sum()),
    }
    return table.reshape(*shape, -1), counts


def alternate_ranges(readings: ReadingSeries) -> ReadingSeries:
    """Give a pair's readings of each other to its two robots in turn, so that each is used once and both profit."""
    low, high = np.minimum(readings.robot, readings.other), np.maximum(readings.robot, readings.other)
    robot, other = low.copy(), high.copy()
    for a, b in sorted(set(zip(low.tolist(), high.tolist(), strict=True))):
        second = np.flatnonzero((low == a) & (high == b))[1::2]
        robot[second], other[second] = b, a
    return readings._replace(robot=robot, other=other)


def bearing(pose: Array, place: Array) -> Array:
    """Return the bearing of places (m, 2) as seen from poses (m, 3) [rad]."""
    return wrap(np.arctan2(place[:, 1] - pose[:, 1], place[:, 0] - pose[:, 0]) - pose[:, 2])


def _hold_values(time: Array, u: Array, grid: Grid, max_hold: float) -> Array:
    """Return the means (T, k) of values (m, k) that hold until the next stamp (time less t0).

    They are nan where the next stamp is far, and where an interval begins before the first stamp or after the last, as
    what held there is unknown.
    """
    edges = grid.edges - grid.t0
    if grid.lines is None:
        knots = np.append(time, max(time[-1], edges[-1]))
        integral = np.cumsum(np.concatenate([np.zeros_like(u[:1]), u * np.diff(knots)[:, None]]), axis=0)
        at_edges = np.stack([np.interp(edges, knots, column) for column in integral.T], -1)
        known = (edges[:-1] >= time[0]) & (edges[:-1] <= time[-1])
        mean = np.where(known[:, None], np.diff(at_edges, axis=0) / np.diff(edges)[:, None], np.nan)
    else:
        mean = u[np.searchsorted(time, edges[:-1])]
    gap = np.append(np.diff(time, prepend=time[0]), 0.0)  # before each stamp, and after the last
    begins, ends = gap[np.searchsorted(time, edges[:-1], side="right")], gap[np.searchsorted(time, edges[1:])]
    return np.where(((begins > max_hold) | (ends > max_hold))[:, None], np.nan, mean)


# ---- A team's recording on the grid of ticks, as estimators get it


class Sampled(NamedTuple):
    """A recording in ticks; width 0 where a channel does not exist."""

    poses: Array  # (T + 1, n, 3)  true, nan where unknown
    senses: Senses  # one trial
    air: Air
    counts: dict[str, Any]  # of readings, by channel


def sample_log(
    log: TeamLog,
    grid: Grid,
    gaps: Gaps,
    scales: Array | float = 1.0,
    bias: Mapping[Channel, Array] = MappingProxyType({}),
    packets: Literal["every tick", "with a reading"] = "every tick",
) -> Sampled:
    """Return a recording in ticks: readings at the one nearest to their stamps, ranges less `bias` (n, others) [m].

    `scales` (n, 2) are factors of the odometry.
    """
    n, counts = len(log.robots), dict[str, Any]()
    tables = {c: np.empty((1, grid.ticks, n, 0, len(columns))) for c, columns in team_log.READING_COLUMNS.items()}
    for channel, readings in log.readings.items():
        used = alternate_ranges(readings) if channel == "range" else readings
        if channel in bias:
            used = used._replace(values=used.values - bias[channel][used.robot, used.other][:, None])
        table, counts[channel] = cells(used, grid, n, len(team_log.other_names(log, channel)))
        tables[channel] = table[None]
    ranges, rssi, anchor_rssi, anchor_range = (
        tables[channel][..., 0] for channel in ("range", "rssi", "anchor_rssi", "anchor_range")
    )
    link = np.broadcast_to(~np.eye(n, dtype=bool), (1, grid.ticks, n, n)).copy()
    if packets == "with a reading":
        measured = [np.isfinite(each) for each in (ranges, rssi) if each.shape[-1]]
        link &= np.any(measured, axis=0) if measured else False
    u = np.stack([odometry(log.odometry_kind, series, grid, gaps.hold) for series in log.odometry], 1) * scales
    dt = np.broadcast_to(grid.dt[:, None], (1, *u.shape[:2])).copy()
    extra = {"anchor_range": anchor_range} if "anchor_range" in counts else {}
    senses = Senses(u[None], dt, anchor_rssi, tables["landmark"], tables["sighting"], extra)
    path = np.stack([poses(series, grid.edges, gaps.truth) for series in log.truth], 1)
    return Sampled(path, senses, Air(link, rssi, ranges), counts)
