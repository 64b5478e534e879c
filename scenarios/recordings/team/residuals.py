"""What readings and odometry were off by, in parts of recordings whose truth may be looked at."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Indices
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings.logs.fit import MOVING
from cooploc.scenarios.recordings.logs.run import LogRun
from cooploc.scenarios.recordings.team.sampling import Gaps, Grid, bearing, odometry, poses
from cooploc.scenarios.recordings.team.team_log import Channel, TeamLog

WINDOW = 1.0  # [s] odometry is compared with truth over this long: errors of stamps cancel, those of wheels add up
IN_A_ROW = 2.0  # [s] readings of a link no further apart belong to one burst


class Part(NamedTuple):
    """A part of a recording on which models may be fitted."""

    log: TeamLog
    begin: float  # [s]
    end: float  # [s]


class Residuals(NamedTuple):
    """Readings of one channel whose truth is known, in the order of their stamps."""

    link: Indices  # (m,)  which pair: n robot + other; between robots the same in both directions
    tick: Indices  # (m,)  the tick that each is in, increasing from part to part
    distance: Array  # (m,)  true [m]
    z: Array  # (m, k)  as measured, a bearing less the true one [rad]
    apart: int = 1  # [ticks] readings of a link that are no further apart follow each other


def residuals(parts: Sequence[Part], channel: Channel, robots: Sequence[str], tick: float, gaps: Gaps) -> Residuals:
    """Readings by robots of the team, with true distances at their stamps."""
    found = [_of_part(part, channel, robots, tick, gaps) for part in parts if channel in part.log.readings]
    nothing = Residuals(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0), np.empty((0, 2)))
    if not found:
        return nothing
    offset = np.cumsum([0, *(r.tick.max(initial=0) + 10_000 for r in found[:-1])])
    ticks = [r.tick + add for r, add in zip(found, offset, strict=True)]
    link, distance, z = (np.concatenate([r[i] for r in found]) for i in (0, 2, 3))
    apart = max(1, round(IN_A_ROW / tick))
    return Residuals(link.astype(np.int64), np.concatenate(ticks), distance, z, apart)


def of_robot(parts: Sequence[Part], robot: str, tick: float, gaps: Gaps) -> list[LogRun]:
    """A robot's odometry and truth over windows in which it moved, as `logs.fit` takes them."""
    return [
        _windows(part, part.log.robots.index(robot), max(WINDOW, tick), gaps)
        for part in parts
        if robot in part.log.robots and part.end - part.begin >= 2 * max(WINDOW, tick)
    ]


def _of_part(part: Part, channel: Channel, robots: Sequence[str], tick: float, gaps: Gaps) -> Residuals:
    log, readings = part.log, part.log.readings[channel]
    at = readings.time
    used = (at >= part.begin) & (at <= part.end)
    mine, theirs = np.full((len(at), 3), np.nan), np.full((len(at), 2), np.nan)
    fixed = {"landmark": log.landmarks, "anchor_rssi": log.anchors, "anchor_range": log.anchors}.get(channel)
    for i, series in enumerate(log.truth):
        mine[readings.robot == i] = poses(series, at[readings.robot == i], gaps.truth)
        if fixed is None:
            theirs[readings.other == i] = poses(series, at[readings.other == i], gaps.truth)[:, :2]
    if fixed is not None:
        theirs = fixed.positions[readings.other]
    z = readings.values.copy()
    if channel in ("landmark", "sighting"):
        z[:, 1] = wrap(z[:, 1] - bearing(mine, theirs))
    distance = np.hypot(*(mine[:, :2] - theirs).T)
    numbers = np.array([robots.index(name) if name in robots else -1 for name in log.robots])
    robot, other = numbers[readings.robot], readings.other if fixed else numbers[readings.other]
    used &= np.isfinite(distance) & (robot >= 0) & (other >= 0)
    if channel == "range":
        robot, other = np.minimum(robot, other), np.maximum(robot, other)
    size = max(len(robots), len(fixed.names) if fixed else 0)
    ticks = np.floor((at - part.begin) / tick).astype(np.int64)
    return Residuals((robot * size + other)[used], ticks[used], distance[used], z[used])


def _windows(part: Part, robot: int, window: float, gaps: Gaps) -> LogRun:
    grid = Grid(part.begin, window, int((part.end - part.begin) / window))
    log, time = part.log, grid.edges - grid.t0
    u = odometry(log.odometry_kind, log.odometry[robot], grid, gaps.hold)
    truth = poses(log.truth[robot], grid.edges, gaps.truth)
    step = np.hypot(*np.diff(truth[:, :2], axis=0).T)
    if log.odometry_kind == "displacement":
        moved = np.hypot(u[:, 0], u[:, 1]) > MOVING
    else:
        turn = u[:, 1] * window
        moved = (np.abs(u[:, 0] * window) > MOVING) | (np.abs(turn) > MOVING)
        u[:, 0] *= np.sinc(turn / 2 / np.pi)  # the chord of an arc, as the truth shows it
    nothing = np.empty((len(time), 0))
    return LogRun(Path(log.name), grid.edges, time, u, moved | (step > MOVING), nothing, truth, nothing, {})
