"""Fits the models of a run on the other runs: on their truth and readings, never on its own.

A value that the description states, or a parameter overrides, is not fitted. With `robust`, Huber's loss is minimised.
Then sigma of RSSI is that of the Gaussian core, as filters refuse what is far from it; sigma of odometry, which no
filter refuses, is the median run's root mean square.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.stats import norm

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Indices, Motion, Sensor
from cooploc.estimators.models import NEAR, Displacement, LogDistance, Range, Sighting, Unicycle, wrap
from cooploc.scenarios.recordings.robot_run import LogRun
from cooploc.scenarios.recordings.sampling import Gaps, Grid, bearing, odometry, poses
from cooploc.scenarios.recordings.team_log import Channel, OdometryKind, TeamLog

MOVING = 0.03  # [m] in a tick; a shorter step does not show the direction

Sample = tuple[Array, Array, Array]  # odometry, truth, interval [s]


class PathLossFit(NamedTuple):
    """z = A - 10 eta log10 d."""

    A: float  # [dBm]
    eta: float
    sigma: float  # [dB] of the residuals
    lag1: float  # correlation of the residuals from line to line, per anchor


class OdometryFit(NamedTuple):
    """True motion = scale x odometry + noise, whose standard deviations are quoted at a tick."""

    length_scale: float
    turn_scale: float
    sigma_v: float  # [m/s]
    sigma_omega: float  # [rad/s]


def fit_path_loss(
    runs: Sequence[LogRun], anchors: Array, A: float | None = None, eta: float | None = None, robust: bool = False
) -> PathLossFit:
    """A [dBm] and eta, where they are not given, by (robust) least squares over all readings at known positions."""
    c = np.array([np.nan if value is None else value for value in (A, eta)])
    logs = [-10 * np.log10(np.maximum(_distance(run.truth, anchors), NEAR)) for run in runs]
    L, z = (np.concatenate([np.empty((0, len(anchors))), *part]) for part in (logs, [run.rssi for run in runs]))
    there, free = np.isfinite(L) & np.isfinite(z), np.isnan(c)
    if there.sum() < 3:
        return PathLossFit(float(c[0]), float(c[1]), np.nan, np.nan)
    X = np.stack([np.ones(there.sum()), L[there]], -1)
    rest = z[there] - X[:, ~free] @ c[~free]
    line = huber(X[:, free], rest) if robust else None
    c[free] = line.beta if line else np.linalg.lstsq(X[:, free], rest)[0]
    residuals = [run.rssi - (c[0] + c[1] * log) for run, log in zip(runs, logs, strict=True)]
    square = sum(float(np.nansum(e**2)) for e in residuals)
    sigma = line.sigma if line else np.sqrt(square / max(int(there.sum()) - int(free.sum()), 1))
    return PathLossFit(float(c[0]), float(c[1]), float(sigma), _lag1(residuals))


def fit_wheel_odometry(
    runs: Sequence[LogRun],
    tick: float,
    length_scale: float | None = None,
    turn_scale: float | None = None,
    robust: bool = False,
) -> OdometryFit:
    """Noise of (v, omega), quoted at `tick` [s], and their scales where they are not given; 1 if there are no runs."""
    length, sigma_v = fit_proportional([_arcs(run) for run in runs], length_scale, robust)
    turn, sigma_omega = fit_proportional([_turns(run) for run in runs], turn_scale, robust)
    return OdometryFit(length, turn, sigma_v / tick**0.5, sigma_omega / tick**0.5)


def fit_displacement(runs: Sequence[LogRun], tick: float, scale: float = 1.0, robust: bool = False) -> float:
    """sigma [m] per axis, of displacements in a tick of `tick` seconds."""
    return float(fit_proportional([_displacements(run) for run in runs], scale, robust)[1] * tick**0.5)


def _distance(truth: Array, anchors: Array) -> Array:
    delta = truth[:, None, :2] - anchors
    return np.hypot(delta[..., 0], delta[..., 1])


def _lag1(residuals: list[Array]) -> float:
    """Correlation of a residual with the one of the same anchor in the line before."""
    before, after = (np.concatenate([e[s].ravel() for e in residuals]) for s in (np.s_[:-1], np.s_[1:]))
    both = np.isfinite(before) & np.isfinite(after)
    a, b = before[both], after[both]
    return float((a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum())) if both.any() else 0.0


def fit_proportional(parts: Sequence[Sample], scale: float | None, robust: bool) -> tuple[float, float]:
    """y = scale x + noise of variance sigma^2 dt, by weighted (robust) least squares: scale and sigma."""
    x, y, dt = (np.concatenate([np.empty(0), *(part[i] for part in parts)]) for i in range(3))
    if robust and len(x) > 1:
        free = scale is None and bool(x.any())
        known = 0.0 if free else 1.0 if scale is None else scale
        line = huber((x / np.sqrt(dt))[:, None][:, : int(free)], (y - known * x) / np.sqrt(dt))
        robust_scale = float(line.beta[0]) if free else known
        squares = [((b - robust_scale * a) ** 2 / t).mean() for a, b, t in parts if len(a)]
        return robust_scale, float(np.sqrt(np.median(squares)))
    if scale is None:
        scale = float((x * y / dt).sum() / (x**2 / dt).sum()) if x.any() else 1.0
    return scale, float(np.sqrt(((y - scale * x) ** 2 / dt).mean())) if len(x) else np.nan


def _arcs(run: LogRun) -> Sample:
    """Per tick with truth at both ends: length by odometry [m], true length [m], interval [s]."""
    step = np.diff(run.truth[:, :2], axis=0)
    arc, length = np.abs(run.odometry[:, 0]) * run.dt, np.hypot(step[:, 0], step[:, 1])
    good = run.known & np.isfinite(arc) & np.isfinite(length)
    return arc[good], length[good], run.dt[good]


def _turns(run: LogRun) -> Sample:
    """Between two known true directions: turn by odometry [rad], true turn [rad], interval [s].

    The direction is the recorded heading, or else the course in a tick that moved, which is the heading in mid-tick.
    """
    step = np.diff(run.truth[:, :2], axis=0)
    turn = np.where(run.known, run.odometry[:, 1] * run.dt, np.nan)
    turned, unknown = (np.concatenate([[0.0], np.cumsum(a)]) for a in (np.nan_to_num(turn), np.isnan(turn)))
    at, direction = run.time, run.truth[:, 2]
    if np.isnan(direction).all():
        at, turned, unknown = ((a[1:] + a[:-1]) / 2 for a in (at, turned, unknown))
        backward = np.where(run.odometry[:, 0] < 0, np.pi, 0.0)
        moved = np.hypot(step[:, 0], step[:, 1]) > MOVING
        direction = np.where(moved, np.arctan2(step[:, 1], step[:, 0]) + backward, np.nan)
    x, y, dt, lost = (np.diff(a[np.isfinite(direction)]) for a in (turned, direction, at, unknown))
    good = lost == 0
    return x[good], x[good] + wrap(y - x)[good], dt[good]


def _displacements(run: LogRun) -> Sample:
    """Per tick and axis: displacement by odometry [m], true displacement [m], interval [s]."""
    step, dt = np.diff(run.truth[:, :2], axis=0), np.repeat(run.dt[:, None], 2, 1)
    good = run.known[:, None] & np.isfinite(run.odometry) & np.isfinite(step)
    return run.odometry[good], step[good], dt[good]


# What readings and odometry were off by, in parts of recordings whose truth may be looked at.

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


# Least squares that one bad recording cannot turn: Huber's.
#
# Source: P. J. Huber, E. M. Ronchetti, "Robust Statistics", 2nd ed., 2009, secs. 7.7 and 7.8 (proposal 2, by iterated
# weights).

K = 1.345  # [standard deviations] a larger residual counts linearly: 95 % efficient where all are Gaussian
# E min(z^2, K^2) of a standard normal z
INSIDE = float(2 * norm.cdf(K) - 1 - 2 * K * norm.pdf(K) + 2 * K**2 * norm.sf(K))
ROUNDS, SETTLED, LEAST_ROBUST = 100, 1e-9, 1e-9


class Line(NamedTuple):
    """y = X beta + noise."""

    beta: Array  # (p,)
    sigma: float  # standard deviation of the Gaussian core of the noise


def huber(X: Array, y: Array) -> Line:
    """Minimise sum rho((y - X beta)/sigma), with sigma^2 = mean min(r^2, K^2 sigma^2) / INSIDE.

    Args:
        X: (m, p) of full rank; p may be 0, and then the line is that of sigma about zero.
        y: (m,), m > p.

    """
    m, p = X.shape
    beta = np.asarray(np.linalg.lstsq(X, y)[0], float)
    sigma = _robust_spread(y - X @ beta)
    for _ in range(ROUNDS):
        scale = max(sigma, LEAST_ROBUST)
        root = np.sqrt(np.minimum(1, K * scale / np.maximum(np.abs(y - X @ beta), LEAST_ROBUST)))
        beta = np.asarray(np.linalg.lstsq(X * root[:, None], y * root)[0], float)
        r = y - X @ beta
        sigma = float(np.sqrt(np.minimum(r**2, (K * scale) ** 2).sum() / ((m - p) * INSIDE)))
        if abs(sigma - scale) <= SETTLED * scale:
            break
    return Line(beta, sigma)


def _robust_spread(r: Array) -> float:
    """A first sigma: the median residual's, or the plain one where more than half are zero."""
    return float(np.median(np.abs(r)) / norm.ppf(0.75)) or float(np.sqrt((r**2).mean()))


# Fits the models of a team, robustly, on parts of recordings that are not judged.
#
# A value that the description states, or a parameter overrides, is not fitted.

ENOUGH = 30  # readings of a pair, or windows of a robot; with fewer it gets what is fitted on all
LEAST = 1e-3  # [m] or [rad]: no sensor is taken to be better
MOST_CORRELATED = 0.99
FAR = 3.0  # [sigma]
LONG = 10_000  # [ticks]


class Memory(NamedTuple):
    """How residuals of a link follow each other, with at most one reading in a tick."""

    lag1: float  # correlation of a reading with the one before it
    burst: float  # how many follow each other without a longer pause, on average over readings


NONE = Memory(0.0, 1.0)


class RangeFit(NamedTuple):
    """z = distance + bias of the pair + noise."""

    bias: dict[int, float]  # by link [m]
    common: float  # of links that are not in `bias` [m]
    sigma: float  # [m]
    memory: Memory


class Odometry(NamedTuple):
    """True motion = scale x odometry + noise."""

    scales: Array  # (n, 2) of length and turn, by robot
    sigmas: tuple[float, ...]  # of v [m/s] and omega [rad/s], or of dx and dy [m], at the tick


def fit_range(r: Residuals, bias: float | None, robust: bool) -> RangeFit:
    """Bias by pair, unless one is given, and sigma; nan where there are too few readings."""
    e = r.z[:, 0] - r.distance
    if len(e) < 3:
        return RangeFit({}, bias if bias is not None else np.nan, np.nan, NONE)
    if bias is not None:
        by_link, common = {}, bias
    else:
        common = _location(e, robust)
        links = [int(link) for link in np.unique(r.link) if (r.link == link).sum() >= ENOUGH]
        by_link = {link: _location(e[r.link == link], robust) for link in links}
    rest = e - np.array([by_link.get(int(link), common) for link in r.link])
    sigma, moved = max(_spread(rest, robust), LEAST), rest - np.median(rest)
    return RangeFit(by_link, common, sigma, memory(r, _inside(moved, _spread(moved, robust), robust)))


def fit_path_loss_of_links(
    r: Residuals, A: float | None, eta: float | None, robust: bool
) -> tuple[float, float, float, Memory]:
    """A [dBm], eta, sigma [dB] and memory of z = A - 10 eta log10 d; nan where readings are too few."""
    given = np.array([np.nan if value is None else value for value in (A, eta)])
    free = np.isnan(given)
    if len(r.z) < 3:
        return float(given[0]), float(given[1]), np.nan, NONE
    X = np.stack([np.ones(len(r.z)), -10 * np.log10(np.maximum(r.distance, NEAR))], -1)
    rest = r.z[:, 0] - X[:, ~free] @ given[~free]
    given[free] = _line(X[:, free], rest, robust)
    e = r.z[:, 0] - X @ given
    sigma = max(_spread(e, robust), LEAST)
    return float(given[0]), float(given[1]), sigma, memory(r, _inside(e, sigma, robust))


def fit_sighting(r: Residuals, robust: bool) -> tuple[tuple[float, Memory], ...]:
    """sigma and memory of range [m] and of bearing [rad]; nan where readings or true headings are few."""
    found = []
    for e in (r.z[:, 0] - r.distance, r.z[:, 1]):
        known = np.isfinite(e)
        of_known = Residuals(r.link[known], r.tick[known], r.distance[known], r.z[known], r.apart)
        enough = known.sum() > 2
        sigma = max(_spread(e[known], robust), LEAST) if enough else np.nan
        found.append((sigma, memory(of_known, _inside(e[known], sigma, robust)) if enough else NONE))
    return tuple(found)


def fit_odometry(
    parts: Sequence[Part],
    robots: Sequence[str],
    kind: OdometryKind,
    stated: tuple[float | None, float | None],
    tick: float,
    gaps: Gaps,
    robust: bool,
) -> Odometry:
    """Scales by robot where they are not given; for a robot with few windows, those fitted on all."""
    mine = {robot: of_robot(parts, robot, tick, gaps) for robot in robots}
    every = [run for runs in mine.values() for run in runs]
    if kind == "displacement":
        scale = stated[0] or 1.0
        sigma = fit_displacement(every, tick, scale, robust)
        return Odometry(np.full((len(robots), 2), scale), (sigma, sigma))
    common = fit_wheel_odometry(every, tick, *stated, robust)
    scales = []
    for robot in robots:
        enough = sum(int(run.known.sum()) for run in mine[robot]) >= ENOUGH
        own = fit_wheel_odometry(mine[robot], tick, *stated, robust) if enough else common
        scales.append([own.length_scale, own.turn_scale])
    scaled = [_scaled(run, scale) for robot, scale in zip(robots, scales, strict=True) for run in mine[robot]]
    rest = fit_wheel_odometry(scaled, tick, 1.0, 1.0, robust)
    return Odometry(np.array(scales), (rest.sigma_v, rest.sigma_omega))


def inflation(memory: Memory) -> float:
    """Factor on sigma: the mean of a burst then has the spread that a filter of independent readings computes.

    The mean of m values of a first-order process has 1 + 2 sum_k (1 - k/m) r^k times the variance of independent ones,
    k = 1 ... m - 1; (1 + r)/(1 - r) for long bursts.
    """
    r = min(max(memory.lag1, 0.0), MOST_CORRELATED)
    m = max(memory.burst, 1.0)
    k = np.arange(1, min(int(np.ceil(m)), LONG))
    return float(np.sqrt(1 + 2 * ((1 - k / m) * r**k).sum()))


def memory(r: Residuals, e: Array) -> Memory:
    """Of residuals (m,), the last of a tick counting."""
    order = np.lexsort((r.tick, r.link))
    key = np.stack([r.link, r.tick], -1)[order]
    last = np.append((np.diff(key, axis=0) != 0).any(-1), True)[: len(key)]
    key, e = key[last], e[order][last]
    follows = (np.diff(key[:, 0]) == 0) & (np.diff(key[:, 1]) <= r.apart)
    a, b = e[:-1][follows], e[1:][follows]
    power = float(np.sqrt((a**2).sum() * (b**2).sum()))
    lengths = np.diff(np.flatnonzero(np.concatenate([[True], ~follows, [True]])))
    burst = float((lengths**2).sum() / max(lengths.sum(), 1))
    return Memory(float((a * b).sum()) / power if power else 0.0, burst)


def _scaled(run: LogRun, scale: Sequence[float]) -> LogRun:
    return run._replace(odometry=run.odometry * np.array(scale))


def _line(X: Array, y: Array, robust: bool) -> Array:
    return huber(X, y).beta if robust else np.asarray(np.linalg.lstsq(X, y)[0], float)


def _location(e: Array, robust: bool) -> float:
    return float(_line(np.ones((len(e), 1)), e, robust)[0])


def _inside(e: Array, sigma: float, robust: bool) -> Array:
    """Residuals; with `robust`, within `FAR` sigma: what is misread for a second tells no correlation."""
    return np.clip(e, -FAR * sigma, FAR * sigma) if robust else e


def _spread(e: Array, robust: bool) -> float:
    """Standard deviation about zero; with `robust`, of the Gaussian core."""
    return huber(np.empty((len(e), 0)), e).sigma if robust else float(np.sqrt((e**2).mean()))


# What a team is told of its sensors: models that are stated, or fitted on what is not judged.

RANGES: tuple[Channel, ...] = ("range", "anchor_range")
SENSED: Mapping[Channel, str] = {"range": "radio_range", "rssi": "radio_rssi"}  # other channels have the same name


class How(NamedTuple):
    """How models are fitted."""

    tick: float  # [s]
    gaps: Gaps
    stated: Mapping[str, float | None]  # by the names of `schema.Model`
    bias: Literal["fitted", "none"]
    robust: bool
    inflate: bool  # sigma of readings, for their correlation in time


class TeamModels(NamedTuple):
    """Models of one run."""

    motion: Motion
    sensors: dict[str, Sensor]
    scales: Array  # (n, 2)  factors of the odometry
    bias: dict[Channel, Array]  # (n, others) of ranges [m], to be subtracted
    notes: dict[str, Any]  # what was fitted, on what


def team_models(log: TeamLog, parts: Sequence[Part], how: How) -> TeamModels:
    """The models of a run, fitted on parts of recordings that are not judged.

    Raises:
        BadInput: a value is not stated, and the parts do not suffice to fit it; or RSSI does not fall with distance.

    """
    motion, scales, notes = _motion(log, parts, how)
    sensors: dict[str, Sensor] = {}
    bias: dict[Channel, Array] = {}
    for channel in log.readings:
        found = residuals(parts, channel, log.robots, how.tick, how.gaps)
        prefix = "anchor_" if channel.startswith("anchor") else ""
        if channel in RANGES:
            fitted = _ranges(channel, found, how, prefix)
            sensors[SENSED.get(channel, channel)] = Range(fitted.sigma)
            bias[channel] = _table(log, channel, fitted)
            notes |= {
                f"{prefix}range_sigma": fitted.sigma,
                f"{prefix}range_bias": _by_name(log, channel, bias[channel]),
            }
            notes |= {f"{prefix}range_lag1": fitted.memory.lag1, f"{prefix}range_fitted_on": len(found.z)}
        elif channel in ("sighting", "landmark"):
            told = _sightings(channel, found, how)
            sensors[channel] = Sighting(told[f"{channel}_sigma_range"], told[f"{channel}_sigma_bearing"])
            notes |= told
        else:
            sensors[SENSED.get(channel, channel)], told = _path_loss(log, found, how, prefix)
            notes |= told
    _demand_all(log, parts, notes)
    return TeamModels(motion, sensors, scales, bias, {"fitted_on": _told(parts, log), **notes})


def _motion(log: TeamLog, parts: Sequence[Part], how: How) -> tuple[Motion, Array, dict[str, Any]]:
    stated = how.stated["length_scale"], how.stated["turn_scale"]
    found = fit_odometry(parts, log.robots, log.odometry_kind, stated, how.tick, how.gaps, how.robust)
    names = ("sigma_move",) if log.odometry_kind == "displacement" else ("sigma_v", "sigma_omega")
    sigmas = [how.stated[name] or sigma for name, sigma in zip(names, found.sigmas, strict=False)]
    moves = log.odometry_kind == "displacement"
    motion = Displacement(sigmas[0], how.tick) if moves else Unicycle(sigmas[0], sigmas[1], how.tick)
    scales = {robot: found.scales[i].tolist() for i, robot in enumerate(log.robots)}
    return motion, found.scales, {"odometry_scales": scales, **dict(zip(names, sigmas, strict=True))}


def _ranges(channel: Channel, found: Residuals, how: How, prefix: str) -> RangeFit:
    """Bias and sigma; of raw ranges sigma is about zero, so that it contains the bias."""
    stated = how.stated[f"{prefix}range_bias"]
    fitted = fit_range(found, 0.0 if how.bias == "none" else stated, how.robust)
    sigma = how.stated[f"{prefix}range_sigma"] or fitted.sigma * (inflation(fitted.memory) if how.inflate else 1.0)
    return fitted._replace(sigma=sigma)


def _table(log: TeamLog, channel: Channel, fitted: RangeFit) -> Array:
    """The bias of each (robot, other) [m]."""
    n = len(log.robots)
    others = n if channel == "range" else len(log.anchors.names)
    size, table = max(n, others), np.full((n, others), fitted.common)
    for link, bias in fitted.bias.items():
        i, j = divmod(link, size)
        table[i, j] = bias
        if channel == "range":
            table[j, i] = bias
    return table


def _by_name(log: TeamLog, channel: Channel, table: Array) -> dict[str, float]:
    """The bias of each pair that has readings [m]."""
    readings, others = log.readings[channel], log.robots if channel == "range" else log.anchors.names
    pairs = sorted({(int(i), int(j)) for i, j in zip(readings.robot, readings.other, strict=True)})
    if channel == "range":
        pairs = sorted({(min(pair), max(pair)) for pair in pairs})
    return {f"{log.robots[i]} - {others[j]}": float(table[i, j]) for i, j in pairs}


def _sightings(channel: Channel, found: Residuals, how: How) -> dict[str, float]:
    told: dict[str, float] = {}
    for what, (sigma, memory) in zip(("range", "bearing"), fit_sighting(found, how.robust), strict=True):
        inflated = sigma * (inflation(memory) if how.inflate else 1.0)
        told |= {f"{channel}_sigma_{what}": how.stated[f"{channel}_sigma_{what}"] or inflated}
        told |= {f"{channel}_{what}_lag1": memory.lag1}
    return told


def _path_loss(log: TeamLog, found: Residuals, how: How, prefix: str) -> tuple[LogDistance, dict[str, float]]:
    A, eta, sigma, memory = fit_path_loss_of_links(
        found, how.stated[f"{prefix}A"], how.stated[f"{prefix}eta"], how.robust
    )
    if eta <= 0:
        raise BadInput(
            f"run {log.name!r}: {prefix}RSSI does not fall with distance in what it is fitted on (eta = {eta:.3g}); "
            f"check the names and places in log.toml, or state {prefix}eta in [model]"
        )
    sigma = how.stated[f"{prefix}rssi_sigma"] or sigma * (inflation(memory) if how.inflate else 1.0)
    notes = {f"{prefix}A": A, f"{prefix}eta": eta, f"{prefix}rssi_sigma": sigma, f"{prefix}rssi_lag1": memory.lag1}
    return LogDistance(A, eta, sigma), notes


def _demand_all(log: TeamLog, parts: Sequence[Part], notes: Mapping[str, Any]) -> None:
    lacking = [name for name, value in notes.items() if isinstance(value, float) and not np.isfinite(value)]
    lacking += [n for n, v in notes.items() if n.endswith("_bias") and not np.isfinite(list(v.values())).all()]
    if lacking:
        raise BadInput(
            f"run {log.name!r} is fitted on {_told(parts, log)}, too little for {', '.join(lacking)}: state them in "
            '[model] of log.toml, or [fit] on = "first part" with seconds = ...'
        )


def _told(parts: Sequence[Part], log: TeamLog) -> str:
    names = [part.log.name for part in parts]
    if names == [log.name]:
        return f"its first {parts[0].end - parts[0].begin:g} s, which are not judged"
    return f"the other runs {', '.join(names)}" if names else "no other run"


# What readings are off by after the models of a run: residuals, where they were fitted and where they are judged.


class Leftover(NamedTuple):
    """Readings of one link, less what the model expects."""

    what: str  # such as "range" or "landmark bearing"
    unit: str
    link: str  # such as "red - blue"
    fitted: bool  # whether the models were fitted on them; else they are of the part that is judged
    distance: Array  # (m,)  true [m]
    residual: Array  # (m,)
    sigma: float  # that filters are told


def leftovers(log: TeamLog, parts: Sequence[Part], judged: Part, models: TeamModels, how: How) -> Iterator[Leftover]:
    """Residuals by channel, part and link; sightings as range and as bearing."""
    for channel in log.readings:
        for fitted, of in ((True, parts), (False, [judged])):
            r = residuals(of, channel, log.robots, how.tick, how.gaps)
            for what, unit, e, sigma in _errors(channel, r.distance, r.z, models):
                for link in np.unique(r.link):
                    mine = (r.link == link) & np.isfinite(e)
                    i, j, name = _link(log, channel, int(link))
                    bias = models.bias[channel][i, j] if channel in models.bias else 0.0
                    yield Leftover(what, unit, name, fitted, r.distance[mine], e[mine] - bias, sigma)


def _errors(channel: Channel, distance: Array, z: Array, models: TeamModels) -> Iterator[tuple[str, str, Array, float]]:
    """(what, unit, residuals (m,), sigma) before any bias."""
    name, sensor = channel.replace("_", " "), models.sensors[SENSED.get(channel, channel)]
    if isinstance(sensor, Range):
        yield name, "m", z[:, 0] - distance, sensor.sigma
    elif isinstance(sensor, LogDistance):
        expected = sensor.A - 10 * sensor.eta * np.log10(np.maximum(distance, NEAR))
        yield name.replace("rssi", "RSSI"), "dB", z[:, 0] - expected, sensor.sigma
    elif isinstance(sensor, Sighting):
        yield f"{name} range", "m", z[:, 0] - distance, sensor.sigma_range
        yield f"{name} bearing", "rad", z[:, 1], sensor.sigma_bearing


def _link(log: TeamLog, channel: Channel, link: int) -> tuple[int, int, str]:
    """Robot, other, and both names."""
    fixed = {"landmark": log.landmarks, "anchor_rssi": log.anchors, "anchor_range": log.anchors}.get(channel)
    others = log.robots if fixed is None else fixed.names
    i, j = divmod(link, max(len(log.robots), len(others)))
    return i, j, f"{log.robots[i]} - {others[j]}"
