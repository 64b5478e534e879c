"""Fits of the assumed models, on recordings, or parts of them, that are not judged.

A value that the description states, or a parameter overrides, is not fitted. With `robust`, Huber's loss is minimised.
Then sigma of readings is that of the Gaussian core, as filters refuse what is far from it; sigma of odometry, which no
filter refuses, is the median run's root mean square.

Source: P. J. Huber, E. M. Ronchetti, "Robust Statistics", 2nd ed., 2009, secs. 7.7 and 7.8 (proposal 2, by iterated
weights).
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Indices, Mask, Motion, Sensor
from cooploc.estimators.models import NEAR, Displacement, LogDistance, Range, Sighting, Unicycle, wrap
from cooploc.scenarios.recordings.sampling import Gaps, Grid, bearing, ends, grid_of_lines, odometry, poses
from cooploc.scenarios.recordings.team_log import Channel, TeamLog, fixed_places, other_names


def normal_density(z: Array | float) -> Array:
    """Return exp(-z^2 / 2) / sqrt(2 pi), the density of a standard normal variable."""
    return np.asarray(np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi))


# ---- Huber's least squares, which one bad recording cannot turn

K = 1.345  # [standard deviations] a larger residual counts linearly: 95 % efficient where all are Gaussian
# E min(z^2, K^2) of a standard normal z
INSIDE = float(2 * ndtr(K) - 1 - 2 * K * normal_density(K) + 2 * K**2 * ndtr(-K))
ROUNDS, TOLERANCE, LEAST_SCALE = 100, 1e-9, 1e-9


def huber(X: Array, y: Array) -> tuple[Array, float]:
    """Minimise sum rho((y - X beta)/sigma), with sigma^2 = mean min(r^2, K^2 sigma^2) / INSIDE; y (m,), X (m, p).

    Returns beta (p,) and sigma, the standard deviation of the noise's Gaussian core.
    """
    m, p = X.shape
    beta = np.asarray(np.linalg.lstsq(X, y)[0], float)
    r = y - X @ beta
    # The first sigma is the median residual's, or the plain one where more than half are zero.
    sigma = float(np.median(np.abs(r)) / ndtri(0.75)) or float(np.sqrt((r**2).mean()))
    for _ in range(ROUNDS):
        scale = max(sigma, LEAST_SCALE)
        root = np.sqrt(np.minimum(1, K * scale / np.maximum(np.abs(y - X @ beta), LEAST_SCALE)))
        beta = np.asarray(np.linalg.lstsq(X * root[:, None], y * root)[0], float)
        r = y - X @ beta
        sigma = float(np.sqrt(np.minimum(r**2, (K * scale) ** 2).sum() / ((m - p) * INSIDE)))
        if abs(sigma - scale) <= TOLERANCE * scale:
            break
    return beta, sigma


# ---- What is fitted on, and how

SENSOR: Mapping[Channel, str] = {"range": "radio_range", "rssi": "radio_rssi"}  # other channels have the same name
LONG = 10_000  # [ticks]
MOST_CORRELATED = 0.99


class FitPart(NamedTuple):
    """A part of a recording on which models may be fitted."""

    log: TeamLog
    begin: float  # [s]
    end: float  # [s]
    lines: bool  # whether the ticks are the lines of its one robot
    ends: Mapping[Channel, tuple[Array, Array]]  # of all readings of the recording, as `sampling.ends` returns them


def fit_part(log: TeamLog, begin: float, end: float, gaps: Gaps, lines: bool = False) -> FitPart:
    """Return a part of a recording, with the true poses at its readings, which every fit needs."""
    return FitPart(log, begin, end, lines, {channel: ends(log, channel, gaps.truth) for channel in log.readings})


class Memory(NamedTuple):
    """Correlation in time of the residuals of a link, with at most one reading in a tick."""

    lag1: float = 0.0  # correlation of a reading with the one before it
    burst: float = 1.0  # how many follow each other without a longer pause, on average over readings


class FitSettings(NamedTuple):
    """Settings of the fit."""

    tick: float  # [s]
    gaps: Gaps
    stated: Mapping[str, float | None]  # by the names of `schema.Model`; None: to be fitted
    bias: Literal["fitted", "none"]
    robust: bool
    inflate: bool  # sigma of readings, for their correlation in time

    def sigma(self, name: str, fitted: float, memory: Memory) -> float:
        """Return the stated sigma of readings, or the fitted one, inflated if that is asked for."""
        return self.stated[name] or fitted * (inflation(memory) if self.inflate else 1.0)


def inflation(memory: Memory) -> float:
    """Factor on sigma: the mean of a burst then has the spread that a filter of independent readings computes.

    The mean of m values of a first-order process has 1 + 2 sum_k (1 - k/m) r^k times the variance of independent ones,
    k = 1 ... m - 1; (1 + r)/(1 - r) for long bursts.
    """
    r = min(max(memory.lag1, 0.0), MOST_CORRELATED)
    m = max(memory.burst, 1.0)
    if np.isinf(m):
        return float(np.sqrt((1 + r) / (1 - r)))
    k = np.arange(1, min(int(np.ceil(m)), LONG))
    return float(np.sqrt(1 + 2 * ((1 - k / m) * r**k).sum()))


# ---- Odometry

WINDOW = 1.0  # [s] odometry is compared with truth over this long: errors of stamps cancel, those of wheels add up
MOVING = 0.03  # [m] in a tick; a shorter step does not show the direction
ENOUGH = 30  # readings of a pair, or windows of a robot; with fewer it gets what is fitted on all


class Track(NamedTuple):
    """Odometry and truth of one robot. Odometry k leads from row k to row k + 1."""

    time: Array  # (T + 1,)   rising [s]
    odometry: Array  # (T, 2)     v [m/s], omega [rad/s]; of displacements dx, dy [m]
    known: Mask  # (T,)       whether this interval may be fitted on
    truth: Array  # (T + 1, 3) x [m], y [m], heading [rad]; nan where unknown

    @property
    def dt(self) -> Array:
        """Length of each interval (T,) [s]."""
        return np.diff(self.time)


def tracks_of(parts: Sequence[FitPart], robot: str, how: FitSettings) -> list[Track]:
    """Return a robot's odometry and truth over windows; those in which it moved may be fitted on."""
    window, tracks = max(WINDOW, how.tick), []
    for log, begin, end, lines, _ in parts:
        if robot not in log.robots or end - begin < 2 * window:
            continue
        i = log.robots.index(robot)
        grid = grid_of_lines(log, begin, end) if lines else Grid(begin, window, int((end - begin) / window))
        u = odometry(log.odometry_kind, log.odometry[i], grid, how.gaps.hold)
        truth = poses(log.truth[i], grid.edges, how.gaps.truth)
        if lines:
            tracks.append(Track(grid.edges, u, grid.dt <= how.gaps.hold, truth))
            continue
        if log.odometry_kind == "displacement":
            moved = np.hypot(u[:, 0], u[:, 1]) > MOVING
        else:
            turn = u[:, 1] * window
            moved = (np.abs(u[:, 0] * window) > MOVING) | (np.abs(turn) > MOVING)
            u[:, 0] *= np.sinc(turn / 2 / np.pi)  # the chord of an arc, as the truth shows it
        moved |= np.hypot(*np.diff(truth[:, :2], axis=0).T) > MOVING
        tracks.append(Track(grid.edges - grid.t0, u, moved, truth))
    return tracks


Pairs = tuple[Array, Array, Array]  # (m,) each: by odometry, true, interval [s]


def _arcs(track: Track) -> Pairs:
    """Lengths [m] of the intervals with truth at both ends."""
    step = np.diff(track.truth[:, :2], axis=0)
    arc, length = np.abs(track.odometry[:, 0]) * track.dt, np.hypot(step[:, 0], step[:, 1])
    good = track.known & np.isfinite(arc) & np.isfinite(length)
    return arc[good], length[good], track.dt[good]


def _turns(track: Track) -> Pairs:
    """Turns [rad] between two known true directions.

    The direction is the recorded heading, or else the course in an interval that moved, which is the heading in its
    middle.
    """
    step = np.diff(track.truth[:, :2], axis=0)
    turn = np.where(track.known, track.odometry[:, 1] * track.dt, np.nan)
    turned, unknown = (np.concatenate([[0.0], np.cumsum(a)]) for a in (np.nan_to_num(turn), np.isnan(turn)))
    at, direction = track.time, track.truth[:, 2]
    if np.isnan(direction).all():
        at, turned, unknown = ((a[1:] + a[:-1]) / 2 for a in (at, turned, unknown))
        backward = np.where(track.odometry[:, 0] < 0, np.pi, 0.0)
        moved = np.hypot(step[:, 0], step[:, 1]) > MOVING
        direction = np.where(moved, np.arctan2(step[:, 1], step[:, 0]) + backward, np.nan)
    x, y, dt, lost = (np.diff(a[np.isfinite(direction)]) for a in (turned, direction, at, unknown))
    good = lost == 0
    return x[good], x[good] + wrap(y - x)[good], dt[good]


def _displacements(track: Track) -> Pairs:
    """Displacements [m], by interval and axis."""
    step, dt = np.diff(track.truth[:, :2], axis=0), np.repeat(track.dt[:, None], 2, 1)
    good = track.known[:, None] & np.isfinite(track.odometry) & np.isfinite(step)
    return track.odometry[good], step[good], dt[good]


PAIRS = {"displacement": _displacements, "length": _arcs, "turn": _turns}


def fit_proportional(parts: Sequence[Pairs], scale: float | None, robust: bool) -> tuple[float, float]:
    """Fit y = scale x + noise of variance sigma^2 dt, by weighted (robust) least squares: scale and sigma.

    A scale that is given is not fitted; without data it is 1.
    """
    x, y, dt = (np.concatenate([np.empty(0), *(part[i] for part in parts)]) for i in range(3))
    if robust and len(x) > 1:
        free = scale is None and bool(x.any())
        known = 0.0 if free else 1.0 if scale is None else scale
        beta, _ = huber((x / np.sqrt(dt))[:, None][:, : int(free)], (y - known * x) / np.sqrt(dt))
        robust_scale = float(beta[0]) if free else known
        squares = [((b - robust_scale * a) ** 2 / t).mean() for a, b, t in parts if len(a)]
        return robust_scale, float(np.sqrt(np.median(squares)))
    if scale is None:
        scale = float((x * y / dt).sum() / (x**2 / dt).sum()) if x.any() else 1.0
    return scale, float(np.sqrt(((y - scale * x) ** 2 / dt).mean())) if len(x) else np.nan


def fit_odometry(parts: Sequence[FitPart], log: TeamLog, how: FitSettings) -> tuple[Array, list[float]]:
    """Fit scales of length and turn (n, 2), and sigmas at the tick of v [m/s] and omega [rad/s], or of dx, dy [m].

    Scales are of each robot where they are not given; a robot with few windows gets those fitted on all.
    """
    displaced, n = log.odometry_kind == "displacement", len(log.robots)
    stated = [how.stated["length_scale"], how.stated["turn_scale"]]
    tracks = [tracks_of(parts, robot, how) for robot in log.robots]
    every = [track for mine in tracks for track in mine]

    def fit(some: Sequence[Track], scales: Sequence[float | None]) -> tuple[list[float], list[float]]:
        pairs = (PAIRS["displacement"],) if displaced else (PAIRS["length"], PAIRS["turn"])
        fits = [
            fit_proportional([of(track) for track in some], scale, how.robust)
            for of, scale in zip(pairs, scales, strict=True)
        ]
        root = how.tick**0.5
        return [scale for scale, _ in fits], [sigma * root if displaced else sigma / root for _, sigma in fits]

    if displaced:
        scale = stated[0] or 1.0
        return np.full((n, 2), scale), fit(every, [scale])[1]
    common, sigmas = fit(every, stated)
    if n == 1:
        return np.array([common]), sigmas
    scales, scaled = [], []
    for mine in tracks:
        enough = sum(int(track.known.sum()) for track in mine) >= ENOUGH
        scales.append(fit(mine, stated)[0] if enough else common)
        scaled += [track._replace(odometry=track.odometry * np.array(scales[-1])) for track in mine]
    return np.array(scales), fit(scaled, (1.0, 1.0))[1]


# ---- Readings, less what is true

IN_A_ROW = 2.0  # [s] readings of a link no further apart belong to one burst
BETWEEN = 10_000  # [ticks] between parts
LEAST = 1e-3  # [m] or [rad]: no sensor is taken to be better
FAR = 3.0  # [sigma]


class Residuals(NamedTuple):
    """Readings of one channel whose truth is known, in the order of their stamps."""

    link: Indices  # (m,)  which pair: n robot + other; between robots the same in both directions
    tick: Indices  # (m,)  the tick that each is in, increasing from part to part
    distance: Array  # (m,)  true [m]
    z: Array  # (m, k)  as measured, a bearing less the true one [rad]
    apart: int = 1  # [ticks] readings of a link that are no further apart follow each other


def residuals(parts: Sequence[FitPart], channel: Channel, robots: Sequence[str], how: FitSettings) -> Residuals:
    """Return the readings by robots of the team, with true distances at their stamps."""
    found, first = [(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0), np.empty((0, 2)))], 0
    for log, begin, end, _, known in parts:
        if channel not in log.readings:
            continue
        readings, fixed = log.readings[channel], fixed_places(log, channel)
        mine, theirs = known[channel]
        z = readings.values.copy()
        if channel in ("landmark", "sighting"):
            z[:, 1] = wrap(z[:, 1] - bearing(mine, theirs))
        distance = np.hypot(*(mine[:, :2] - theirs).T)
        numbers = np.array([robots.index(name) if name in robots else -1 for name in log.robots])
        robot, other = numbers[readings.robot], readings.other if fixed else numbers[readings.other]
        used = (readings.time >= begin) & (readings.time <= end) & np.isfinite(distance) & (robot >= 0) & (other >= 0)
        if channel == "range":
            robot, other = np.minimum(robot, other), np.maximum(robot, other)
        link = robot * max(len(robots), len(fixed.names) if fixed else 0) + other
        ticks = np.floor((readings.time[used] - begin) / how.tick).astype(np.int64)
        found.append((link[used].astype(np.int64), ticks + first, distance[used], z[used]))
        first += int(ticks.max(initial=0)) + BETWEEN
    link, ticks, distance, z = (np.concatenate([one[i] for one in found[1:] or found]) for i in range(4))
    return Residuals(link, ticks, distance, z, max(1, round(IN_A_ROW / how.tick)))


def memory(r: Residuals, e: Array) -> Memory:
    """Return the memory of residuals (m,), the last of a tick counting."""
    order = np.lexsort((r.tick, r.link))
    key = np.stack([r.link, r.tick], -1)[order]
    last = np.append((np.diff(key, axis=0) != 0).any(-1), True)[: len(key)]
    key, e = key[last], e[order][last]
    follows = (np.diff(key[:, 0]) == 0) & (np.diff(key[:, 1]) <= r.apart)
    lengths = np.diff(np.flatnonzero(np.concatenate([[True], ~follows, [True]])))
    burst = float((lengths**2).sum() / max(lengths.sum(), 1))
    return Memory(_correlation(e[:-1][follows], e[1:][follows]), burst)


def _correlation(a: Array, b: Array) -> float:
    """Return the correlation of values (m,) whose mean is zero; 0 where they vanish."""
    power = float(np.sqrt((a**2).sum() * (b**2).sum()))
    return float((a * b).sum()) / power if power else 0.0


def _mean(e: Array, robust: bool) -> float:
    X = np.ones((len(e), 1))
    return float((huber(X, e)[0] if robust else np.linalg.lstsq(X, e)[0])[0])


def _sigma(e: Array, robust: bool) -> float:
    """Return the standard deviation about zero; with `robust`, of the Gaussian core."""
    return huber(np.empty((len(e), 0)), e)[1] if robust else float(np.sqrt((e**2).mean()))


def _clip(e: Array, sigma: float, robust: bool) -> Array:
    """Return residuals; with `robust`, within `FAR` sigma: a sensor that fails for a second shows no correlation."""
    return np.clip(e, -FAR * sigma, FAR * sigma) if robust else e


def _noise(r: Residuals, e: Array, robust: bool) -> tuple[float, Memory]:
    """Return sigma and memory of residuals (m,); of fewer than three, nan and none."""
    sigma = max(_sigma(e, robust), LEAST) if len(e) >= 3 else np.nan
    return sigma, memory(r, _clip(e, sigma, robust)) if len(e) >= 3 else Memory()


# ---- Sensors


def fit_range(r: Residuals, bias: float | None, robust: bool) -> tuple[dict[int, float], float, float, Memory]:
    """Fit z = distance + bias + noise: bias [m] by link (unless one is given), of other links, sigma, and memory."""
    e = r.z[:, 0] - r.distance
    if len(e) < 3:
        return {}, np.nan if bias is None else bias, np.nan, Memory()
    by_link: dict[int, float] = {}
    common = _mean(e, robust) if bias is None else bias
    if bias is None:
        links = [int(link) for link in np.unique(r.link) if (r.link == link).sum() >= ENOUGH]
        by_link = {link: _mean(e[r.link == link], robust) for link in links}
    rest = e - np.array([by_link.get(int(link), common) for link in r.link])
    moved = rest - np.median(rest)
    clipped = _clip(moved, _sigma(moved, robust), robust)
    return by_link, common, max(_sigma(rest, robust), LEAST), memory(r, clipped)


def log_distance(distance: Array) -> Array:
    """Return -10 log10 d of distances [m], which are at least `NEAR`."""
    return np.asarray(-10 * np.log10(np.maximum(distance, NEAR)))


PathLoss = tuple[float, float, float, Memory]  # A [dBm], eta, sigma [dB] and memory; nan where readings are too few


def fit_path_loss(r: Residuals, A: float | None, eta: float | None, robust: bool) -> PathLoss:
    """Fit z = A - 10 eta log10 d."""
    c, e, _ = _fit_log_distance(log_distance(r.distance), r.z[:, 0], A, eta, robust)
    return float(c[0]), float(c[1]), *_noise(r, e, robust)


def fit_path_loss_of_lines(
    parts: Sequence[FitPart], A: float | None, eta: float | None, gap: float, robust: bool
) -> PathLoss:
    """Fit the same for a lone robot, whose readings of an anchor follow each other from line to line."""
    tables = []  # (2, lines, anchors)  -10 log10 d, and readings
    for log, begin, end, *_ in parts:
        lines, anchors, r = grid_of_lines(log, begin, end).edges, log.anchors.positions, log.readings["anchor_rssi"]
        z = np.full((len(lines), len(anchors)), np.nan)
        used = np.isin(r.time, lines)
        z[np.searchsorted(lines, r.time[used]), r.other[used]] = r.values[used, 0]
        away = poses(log.truth[0], lines, gap)[:, None, :2] - anchors
        tables.append(np.stack([log_distance(np.hypot(away[..., 0], away[..., 1])), z]))
    L, z = np.concatenate([table.reshape(2, -1) for table in tables], axis=1)
    there = np.isfinite(L) & np.isfinite(z)
    c, e, core = _fit_log_distance(L[there], z[there], A, eta, robust)
    if len(e) < 3:
        return float(c[0]), float(c[1]), np.nan, Memory()
    errors, free = [z - (c[0] + c[1] * L) for L, z in tables], (A is None) + (eta is None)
    square = sum(float(np.nansum(e**2)) for e in errors)
    sigma = core if robust else float(np.sqrt(square / max(len(e) - free, 1)))
    before, after = (np.concatenate([e[rows].ravel() for e in errors]) for rows in (np.s_[:-1], np.s_[1:]))
    both = np.isfinite(before) & np.isfinite(after)
    return float(c[0]), float(c[1]), sigma, Memory(_correlation(before[both], after[both]), np.inf)


def _fit_log_distance(
    L: Array, z: Array, A: float | None, eta: float | None, robust: bool
) -> tuple[Array, Array, float]:
    """Fit z = A + eta L, L = -10 log10 d: (A [dBm], eta), the residuals (m,), and their core's sigma if `robust`."""
    c, sigma = np.array([np.nan if value is None else value for value in (A, eta)]), np.nan
    free, X = np.isnan(c), np.stack([np.ones(len(z)), L], -1)
    if len(z) >= 3:
        rest = z - X[:, ~free] @ c[~free]
        c[free], sigma = huber(X[:, free], rest) if robust else (np.linalg.lstsq(X[:, free], rest)[0], np.nan)
    return c, z - X @ c, sigma


# ---- The models of a team's run, stated or fitted


class TeamModels(NamedTuple):
    """Models of one run."""

    motion: Motion
    sensors: dict[str, Sensor]
    scales: Array  # (n, 2)  factors of the odometry
    bias: dict[Channel, Array]  # (n, others) of ranges [m], to be subtracted
    notes: dict[str, Any]  # what was fitted, on what


def team_models(log: TeamLog, parts: Sequence[FitPart], how: FitSettings) -> TeamModels:
    """Return the models of a run, fitted on parts of recordings that are not judged."""
    others = ", ".join(part.log.name for part in parts)
    names = f"the other runs {others}" if parts else "no other run"
    if others == log.name:
        names = f"its first {parts[0].end - parts[0].begin:g} s, which are not judged"
    scales, fitted_sigmas = fit_odometry(parts, log, how)
    displaced = log.odometry_kind == "displacement"
    parameters = ("sigma_move",) if displaced else ("sigma_v", "sigma_omega")
    sigmas = [how.stated[name] or sigma for name, sigma in zip(parameters, fitted_sigmas, strict=True)]
    motion: Motion = Displacement(sigmas[0], how.tick) if displaced else Unicycle(sigmas[0], sigmas[1], how.tick)
    by_robot = {robot: scales[i].tolist() for i, robot in enumerate(log.robots)}
    notes: dict[str, Any] = {"odometry_scales": by_robot} | dict(zip(parameters, sigmas, strict=True))
    models = TeamModels(motion, {}, scales, {}, {"fitted_on": names} | notes)
    for channel in log.readings:
        found, model = residuals(parts, channel, log.robots, how), SENSOR.get(channel, channel)
        if channel in ("range", "anchor_range"):
            models.sensors[model], models.bias[channel], fitted = _range_model(log, channel, found, how)
        elif channel in ("sighting", "landmark"):
            models.sensors[model], fitted = _sighting_model(channel, found, how)
        else:
            models.sensors[model], fitted = _rssi_model(log, channel, parts, found, how)
        models.notes.update(fitted)
    lacking = [name for name, value in models.notes.items() if isinstance(value, float) and not np.isfinite(value)]
    lacking += [n for n, v in models.notes.items() if n.endswith("_bias") and not np.isfinite(list(v.values())).all()]
    if lacking:
        lost = ", ".join(robot for robot, truth in zip(log.robots, log.truth, strict=True) if truth is None)
        where = f"{names}{', without a truth of ' * bool(lost)}{lost}"
        raise BadInput(
            f"run {log.name!r} is fitted on {where}, too little for {', '.join(lacking)}: state them in [model] of "
            'log.toml, or [fit] on = "first part" with seconds = ...'
        )
    return models


def _range_model(
    log: TeamLog, channel: Channel, found: Residuals, how: FitSettings
) -> tuple[Range, Array, dict[str, Any]]:
    """Sensor, bias (n, others) [m] and notes; of raw ranges sigma is about zero, so that it contains the bias."""
    stated = 0.0 if how.bias == "none" else how.stated[f"{channel}_bias"]
    by_link, common, fitted, memory = fit_range(found, stated, how.robust)
    sigma = how.sigma(f"{channel}_sigma", fitted, memory)
    mutual, n, others = channel == "range", len(log.robots), other_names(log, channel)
    table = np.full((n, len(others)), common)
    for link, bias in by_link.items():
        i, j = divmod(link, max(n, len(others)))
        table[i, j] = bias
        if mutual:
            table[j, i] = bias
    measured = zip(log.readings[channel].robot.tolist(), log.readings[channel].other.tolist(), strict=True)
    pairs = sorted({(min(pair), max(pair)) if mutual else pair for pair in measured})
    notes = {
        f"{channel}_sigma": sigma,
        f"{channel}_bias": {f"{log.robots[i]} - {others[j]}": float(table[i, j]) for i, j in pairs},
        f"{channel}_lag1": memory.lag1,
        f"{channel}_fitted_on": len(found.z),
    }
    return Range(sigma), table, notes


def _sighting_model(channel: Channel, found: Residuals, how: FitSettings) -> tuple[Sighting, dict[str, Any]]:
    notes: dict[str, float] = {}
    for quantity, e in (("range", found.z[:, 0] - found.distance), ("bearing", found.z[:, 1])):
        known, name = np.isfinite(e), f"{channel}_sigma_{quantity}"  # true headings may be few
        some = found._replace(link=found.link[known], tick=found.tick[known])
        sigma, remembered = _noise(some, e[known], how.robust)
        notes[name] = how.sigma(name, sigma, remembered)
        notes[f"{channel}_{quantity}_lag1"] = remembered.lag1
    return Sighting(notes[f"{channel}_sigma_range"], notes[f"{channel}_sigma_bearing"]), notes


LEAST_ETA = 0.1  # path-loss exponents are from about 1.6, along a corridor


def _rssi_model(
    log: TeamLog, channel: Channel, parts: Sequence[FitPart], found: Residuals, how: FitSettings
) -> tuple[LogDistance, dict[str, Any]]:
    prefix = channel.removesuffix("rssi")
    stated = how.stated[f"{prefix}A"], how.stated[f"{prefix}eta"]
    if parts and parts[0].lines:
        A, eta, fitted, memory = fit_path_loss_of_lines(parts, *stated, how.gaps.truth, how.robust)
    else:
        A, eta, fitted, memory = fit_path_loss(found, *stated, how.robust)
    if eta < LEAST_ETA:
        raise BadInput(
            f"run {log.name!r}: RSSI {'of anchors ' * bool(prefix)}does not fall with distance in what it is fitted on "
            f"(eta = {eta:.3g}); check the names and places in log.toml, or state {prefix}eta in [model]"
        )
    sigma = how.sigma(f"{channel}_sigma", fitted, memory)
    notes = {f"{prefix}A": A, f"{prefix}eta": eta, f"{channel}_sigma": sigma, f"{channel}_lag1": memory.lag1}
    return LogDistance(A, eta, sigma), notes


# ---- Residuals of a run after its models, where these were fitted and where they are judged


class LinkResiduals(NamedTuple):
    """Readings of one link, less what the model expects."""

    what: str  # such as "range" or "landmark bearing"
    unit: str
    link: str  # such as "red - blue"
    fitted: bool  # whether the models were fitted on them; else they are of the part that is judged
    distance: Array  # (m,)  true [m]
    residual: Array  # (m,)
    sigma: float  # of the sensor's model


def link_residuals(
    log: TeamLog, parts: Sequence[FitPart], judged: FitPart, models: TeamModels, how: FitSettings
) -> Iterator[LinkResiduals]:
    """Yield residuals by channel, part and link; sightings as range and as bearing."""
    for channel in log.readings:
        others, sensor = other_names(log, channel), models.sensors[SENSOR.get(channel, channel)]
        for fitted, of in ((True, parts), (False, [judged])):
            r = residuals(of, channel, log.robots, how)
            for what, unit, e, sigma in _errors(channel.replace("_", " "), r, sensor):
                for link in np.unique(r.link):
                    mine = (r.link == link) & np.isfinite(e)
                    i, j = divmod(int(link), max(len(log.robots), len(others)))
                    bias = models.bias[channel][i, j] if channel in models.bias else 0.0
                    name = f"{log.robots[i]} - {others[j]}"
                    yield LinkResiduals(what, unit, name, fitted, r.distance[mine], e[mine] - bias, sigma)


def _errors(name: str, r: Residuals, sensor: Sensor) -> Iterator[tuple[str, str, Array, float]]:
    """Yield quantity, unit, residuals (m,) before any bias, and sigma."""
    too_long = r.z[:, 0] - r.distance
    if isinstance(sensor, Range):
        yield name, "m", too_long, sensor.sigma
    elif isinstance(sensor, LogDistance):
        expected = sensor.A + sensor.eta * log_distance(r.distance)
        yield name.replace("rssi", "RSSI"), "dB", r.z[:, 0] - expected, sensor.sigma
    elif isinstance(sensor, Sighting):
        yield f"{name} range", "m", too_long, sensor.sigma_range
        yield f"{name} bearing", "rad", r.z[:, 1], sensor.sigma_bearing
