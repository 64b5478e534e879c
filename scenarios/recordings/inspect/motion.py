"""Motion by odometry and by truth, summed up since the start; true distances; robust statistics.

Sums can be looked up at any stamp: two series with clocks of their own are compared over common windows of time, and
a shift of one clock against the other costs one interpolation.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtri

from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings import sampling
from cooploc.scenarios.recordings.team_log import Channel, ReadingSeries, Series, TeamLog

MOST_WINDOWS = 3000  # of one robot; longer recordings have longer windows
FEWEST_POSITIONS = 10  # of a truth that is used


class SummedMotion(NamedTuple):
    """Sums of motion over time; a column that is not known is nan throughout."""

    time: Array  # (m,)
    length: Array  # (m,)    driven, backwards is negative [m]; of the truth: not known
    turn: Array  # (m,)      turned to the left [rad]
    place: Array  # (m, 2)   where it is [m]; of odometry: in a compass frame, or not known


class Steps(NamedTuple):
    """The motion in each window of time; nan where there are no samples."""

    length: Array  # (w,)  driven [m]; of places: how far apart they are
    turn: Array  # (w,)  to the left [rad]
    move: Array  # (w, 2)  [m]


class RobotMotion(NamedTuple):
    """The motion of one robot, by both sources."""

    odometry: SummedMotion
    truth: SummedMotion
    poses: Series  # the truth where its position is known
    window: float  # [s] two intervals of the slower of both, at least 0.2 s

    def steps(self, motion: SummedMotion, edges: Array | None = None) -> Steps:
        """Return the motion between edges (w + 1,) [s]; by default between windows of all the motion's time."""
        t = motion.time
        if edges is None:
            edges = np.arange(t[0], t[-1], self.window) if len(t) > 1 else np.empty(0)
        if len(edges) < 2:
            return Steps(np.empty(0), np.empty(0), np.empty((0, 2)))
        right = np.clip(np.searchsorted(t, edges), 1, len(t) - 1)
        missing = (t[right] - t[right - 1] > 3 * self.window) | (edges < t[0] - 1e-9) | (edges > t[-1] + 1e-9)

        def change(column: Array) -> Array:
            return np.where(missing[1:] | missing[:-1], np.nan, np.diff(np.interp(edges, t, column)))

        move = np.stack([change(motion.place[:, 0]), change(motion.place[:, 1])], -1)
        length = np.hypot(*move.T) if np.isnan(motion.length).all() else change(motion.length)
        return Steps(length, change(motion.turn), move)

    def common_steps(self) -> tuple[Steps, Steps]:
        """Return the steps of odometry and of truth in the windows that both have."""
        a, b = self.odometry.time, self.truth.time
        edges = np.arange(max(a[0], b[0]), min(a[-1], b[-1]), self.window) if len(a) and len(b) else np.empty(0)
        return self.steps(self.odometry, edges), self.steps(self.truth, edges)


def robot_motion(log: TeamLog, robot: int) -> RobotMotion:
    """Return the motion of a robot; its truth is empty where fewer than ten positions are known."""
    poses = known_truth(log, robot) or Series(np.empty(0), np.empty((0, 3)), "")
    series = [s.time for s in (log.odometry[robot], log.truth[robot]) if s is not None and len(s.time) > 1]
    slowest = max((float(np.median(np.diff(t))) for t in series), default=0.5)
    longest = max((float(t[-1] - t[0]) for t in series), default=0.0)
    unknown, heading = np.full(len(poses.time), np.nan), poses.values[:, 2]
    turn, known = unknown, np.flatnonzero(np.isfinite(heading))
    if len(known) > 0.5 * len(heading):
        turn = np.interp(np.arange(len(heading)), known, np.unwrap(heading[known]))
    truth = SummedMotion(poses.time, unknown, turn, poses.values[:, :2])
    return RobotMotion(_odometry_motion(log, robot), truth, poses, max(2 * slowest, 0.2, longest / MOST_WINDOWS))


def lasting(time: Array, same: Mask, least: float) -> Array:
    """Return the intervals (k, 2) [s] in which neighbouring samples are the `same` (m - 1,) for so long."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(int)))
    found = time[edges].reshape(-1, 2)
    return found[np.diff(found, axis=1)[:, 0] >= least]


def without_repeats(truth: SummedMotion, least: float) -> SummedMotion:
    """Return a truth without positions that repeat exactly for so long [s]: the tracking may have been frozen there."""
    t, kept = truth.time, np.ones(len(truth.time), bool)
    for start, end in lasting(t, (np.diff(truth.place, axis=0) == 0).all(-1), least):
        kept &= (t <= start) | (t >= end)
    return SummedMotion(*(column[kept] for column in truth))


def known_truth(log: TeamLog, robot: int) -> Series | None:
    """Return the lines of a robot's truth whose position is known; None where there are fewer than ten."""
    series = log.truth[robot]
    if series is None:
        return None
    known = np.isfinite(series.values[:, :2]).all(axis=1)
    some = series._replace(time=series.time[known], values=series.values[known])
    return some if known.sum() >= FEWEST_POSITIONS else None


def moves(log: TeamLog, robot: int) -> bool:
    """Return whether a robot's truth goes a metre from its start: one that stands shows no clock and no frame."""
    truth = known_truth(log, robot)
    return truth is not None and bool((np.hypot(*(truth.values[:, :2] - truth.values[0, :2]).T) > 1.0).any())


def _odometry_motion(log: TeamLog, robot: int) -> SummedMotion:
    """Sum up a robot's odometry; a missing value counts as no motion."""
    t, values = log.odometry[robot].time, log.odometry[robot].values
    unknown, nowhere = np.full(len(t), np.nan), np.full((len(t), 2), np.nan)

    def integral(rate: Array) -> Array:  # a rate holds until the next line
        return np.concatenate([[0.0], np.cumsum(np.diff(t) * np.nan_to_num(rate[:-1]))])

    if log.odometry_kind == "displacement":
        return SummedMotion(t, unknown, unknown, np.cumsum(np.nan_to_num(values), axis=0))
    if log.odometry_kind == "velocity":
        return SummedMotion(t, integral(values[:, 0]), integral(values[:, 1]), nowhere)
    if log.odometry_kind == "path":
        return SummedMotion(t, values[:, 0], integral(values[:, 1]), nowhere)
    pose = pd.DataFrame(values).bfill().ffill().fillna(0.0).to_numpy()
    heading, apart = np.unwrap(pose[:, 2]), np.diff(pose[:, :2], axis=0)
    middle = (heading[1:] + heading[:-1]) / 2
    along = apart[:, 0] * np.cos(middle) + apart[:, 1] * np.sin(middle)
    length = np.hypot(*apart.T) * np.where(along < 0, -1.0, 1.0)
    return SummedMotion(t, np.concatenate([[0.0], np.cumsum(length)]), heading, nowhere)


def course(move: Array) -> Array:
    """Return the direction of moves (w, 2) [rad], nan for those shorter than a third of the median: they are noise."""
    length = np.hypot(*move.T)
    known = length[np.isfinite(length) & (length > 0)]
    shortest = np.median(known) / 3 if len(known) else np.inf
    return np.where(length > shortest, wrap(np.arctan2(move[:, 1], move[:, 0])), np.nan)


def course_turns(move: Array) -> Array:
    """Return changes of the direction of moves (w, 2) [rad]: half of the one from the window before to the next."""
    direction, turned = course(move), np.full(len(move), np.nan)
    if len(direction) > 2:
        turned[1:-1] = np.angle(np.exp(1j * (direction[2:] - direction[:-2]))) / 2
    return turned


def true_turns(truth: Steps) -> Array:
    """Return the turns of the truth (w,) [rad]: of its heading if there is one, else of the direction of its moves."""
    return truth.turn if np.isfinite(truth.turn).any() else course_turns(truth.move)


def dead_reckoned(log: TeamLog, robot: int) -> Array | None:
    """Return where odometry alone leads from the true start (m, 2) [m], at its stamps; None without a true start.

    A robot without a true heading starts in the direction of its first moves. Where no robot has a truth, all start at
    0, 0, 0.
    """
    motion = robot_motion(log, robot)
    odometry, t = motion.odometry, motion.truth.time
    if not any(log.truth):
        t, motion = odometry.time[:1], motion._replace(poses=Series(t, np.zeros((1, 3)), ""))
    if not len(t) or len(odometry.time) < 2 or t[0] > odometry.time[-1]:
        return None
    start = motion.poses.values[0]
    begin = int(np.searchsorted(odometry.time, t[0]))
    if np.isfinite(odometry.place).any():
        return np.asarray(odometry.place[begin:] - odometry.place[begin] + start[:2])
    first = start[2]
    if np.isnan(first):
        windows = np.arange(t[0], t[-1], motion.window)  # by rounding, the last may begin after the end
        places = motion.truth.place[np.searchsorted(t, windows).clip(max=len(t) - 1)]
        directions = course(np.diff(places, axis=0))
        first = next(iter(directions[np.isfinite(directions)]), 0.0)
    heading = odometry.turn[begin:] - odometry.turn[begin] + first
    middle, apart = (heading[1:] + heading[:-1]) / 2, np.diff(odometry.length[begin:])
    moved = np.cumsum(np.stack([apart * np.cos(middle), apart * np.sin(middle)], -1), axis=0)
    return np.concatenate([start[None, :2], start[:2] + moved])


FEWEST_WINDOWS = 25  # that two series must have in common


LEADS_ASTRAY = 0.2  # [rad] in all that a bias must turn to matter
LONG, MANY = 5.0, 100  # [s] of windows, and how many there may be of shorter ones, in which turns are compared


def turn_bias(m: RobotMotion) -> tuple[float, float, float]:
    """Return what odometry turns where the truth does not [rad/s], its standard error, and the time it is of [s].

    It is the intercept of a line; of those by odometry's and by the truth's noise alone the one that is nearer to 0.
    """
    span = float(m.truth.time[-1] - m.truth.time[0]) if len(m.truth.time) else 0.0
    longer = m._replace(window=max(m.window, min(LONG, span / MANY)))
    steps, of_truth = longer.common_steps()
    x, y = true_turns(of_truth) / longer.window, steps.turn / longer.window
    off = np.abs(y - x - quantile(y - x, 0.5))
    kept = off <= 5 * max(robust_sd(y - x), 1e-9)
    x, y = x[kept], y[kept]
    if len(x) < FEWEST_WINDOWS or not (both := np.cov(x, y))[0, 1] > 0:
        return 0.0, np.inf, span
    slopes = both[0, 1] / both[0, 0], both[1, 1] / both[0, 1]
    first, second = (float(y.mean() - slope * x.mean()) for slope in slopes)
    error = np.std(y - slopes[0] * x) * (1 / len(x) + x.mean() ** 2 / (len(x) * both[0, 0])) ** 0.5
    return min(first, second, key=abs) if first * second > 0 else 0.0, float(error), len(x) * longer.window


def agreement(measured: Steps, true: Steps) -> float:
    """Return the correlation of moves over all turns and reflections; else of lengths and turns of any sign.

    The first is the nuclear norm of the moves' products; of the second 1 - R^2 = (1 - r^2) (1 - s^2).
    """
    if np.isfinite(measured.move).any():
        known = np.isfinite(measured.move).all(axis=1) & np.isfinite(true.move).all(axis=1)
        a, b = measured.move[known].T, true.move[known].T
        scale = np.sqrt((a**2).sum() * (b**2).sum())
        return float(np.linalg.norm(a @ b.T, "nuc") / scale) if known.sum() >= FEWEST_WINDOWS and scale > 0 else 0.0
    r, s = max(correlation(measured.length, true.length), 0.0), correlation(measured.turn, true_turns(true))
    return float(np.sqrt(1 - (1 - r**2) * (1 - s**2)))


def correlation(a: Array, b: Array) -> float:
    """Return Pearson's correlation over the samples known to both; 0 of too few or of a constant."""
    known = np.isfinite(a) & np.isfinite(b)
    if known.sum() < FEWEST_WINDOWS:
        return 0.0
    a, b = a[known] - a[known].mean(), b[known] - b[known].mean()
    scale = np.sqrt((a @ a) * (b @ b))
    return float(a @ b / scale) if scale > 1e-12 * len(a) else 0.0


def drop_jumps(steps: Steps) -> Steps:
    """Return the steps with those longer than ten times the mean as not known."""
    length = np.abs(steps.length)
    known = length[np.isfinite(length)]
    jump = length > 10 * known.mean() if len(known) else np.zeros(len(length), bool)
    return Steps(*(np.where(jump if part.ndim == 1 else jump[:, None], np.nan, part) for part in steps))


def quantile(values: Array, share: float, fewest: int = 1) -> float:
    """Return a quantile of the finite values; nan if there are fewer than `fewest`."""
    known = values[np.isfinite(values)]
    return float(np.quantile(known, share)) if len(known) >= fewest else np.nan


def robust_sd(values: Array) -> float:
    """Return the median absolute deviation of the finite values, scaled to a normal standard deviation."""
    known = values[np.isfinite(values)]
    return float(np.median(np.abs(known - np.median(known))) / ndtri(0.75)) if len(known) else np.nan


def robust_slope(x: Array, y: Array) -> tuple[float, float]:
    """Fit y = b x by least absolute deviations; return b and its standard error as if residuals were independent.

    b is the median of y/x with weights |x| (Boscovich, Laplace), so samples with little x have little say.
    """
    known = np.isfinite(x) & np.isfinite(y) & (x != 0)
    x, y = x[known], y[known]
    if len(x) < 8:
        return np.nan, np.nan
    ratio, weight = y / x, np.abs(x)
    order = np.argsort(ratio)
    middle = np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)
    b = float(ratio[order][middle])
    return b, float(1.2533 * robust_sd(y - b * x) / np.sqrt((x**2).sum()))


def concentration(angle: Array) -> tuple[float, float]:
    """Return the mean resultant length (1: all equal) and the mean direction of the finite angles [rad]."""
    known = angle[np.isfinite(angle)]
    if len(known) < 8:
        return 0.0, np.nan
    mean = np.exp(1j * known).mean()
    return float(abs(mean)), float(np.angle(mean))


# --- True distances of what was measured

# Table of log.toml, of the channels with ranges.
TABLES = {"range": "ranges", "anchor_range": "ranges", "sighting": "sightings", "landmark": "sightings"}
FEWEST = 20  # readings of a channel or pair
NEAREST = 0.05  # [m] readings of things nearer than this are left out: no direction, and a ratio means nothing


def distances(log: TeamLog, channel: Channel) -> Array:
    """Return the true distance (m,) [m] to what was measured; nan where it is not known."""
    here, there = sampling.ends(log, channel, headings=False)
    distance = np.hypot(*(there - here[:, :2]).T)
    return np.where(distance > NEAREST, distance, np.nan)


def spread_of_readings(log: TeamLog, channel: Channel, shift: float, column: int = 0) -> float:
    """Return how ranges with stamps so much later [s] spread [m] about distances and a bias a pair; inf of too few.

    Of column 1 bearings [rad] about true directions.
    """
    readings = log.readings[channel]
    every = slice(None, None, 1 + len(readings.time) // 2000)
    some = readings._replace(
        time=readings.time[every] + shift,
        robot=readings.robot[every],
        other=readings.other[every],
        values=readings.values[every],
    )
    later = log._replace(readings={channel: some})
    off = some.values[:, column] - (bearings(later, channel) if column else distances(later, channel))
    off = wrap(off) if column else off
    if np.isfinite(off).sum() < max(FEWEST, len(off) / 4):
        return np.inf
    return robust_sd(np.concatenate([off[rows] - quantile(off[rows], 0.5) for _, _, rows in pairs(some, channel)]))


def bearings(log: TeamLog, channel: Channel, of_map: bool = False) -> Array:
    """Return the true direction (m,) [rad] to what was seen, from straight ahead, or from x; nan where unknown."""
    here, there = sampling.ends(log, channel)
    x, y = (there - here[:, :2]).T
    return wrap(np.arctan2(y, x) - here[:, 2] * (not of_map))


def range_channels(log: TeamLog) -> Iterator[tuple[Channel, ReadingSeries]]:
    """Yield the channels that have ranges, with enough readings."""
    for channel, readings in log.readings.items():
        if channel in TABLES and len(readings.time) >= FEWEST:
            yield channel, readings


def pairs(readings: ReadingSeries, channel: Channel) -> Iterator[tuple[int, int, Indices]]:
    """Yield robot, other, and the rows of their readings; of robot-to-robot ranges, both directions together."""
    first, second = readings.robot, readings.other
    if channel in ("range", "rssi"):
        first, second = np.minimum(first, second), np.maximum(first, second)
    for i, k in np.unique(np.stack([first, second]), axis=1).T:
        yield int(i), int(k), np.flatnonzero((first == i) & (second == k))
