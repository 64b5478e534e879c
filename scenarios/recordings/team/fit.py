"""Fits the models of a team, robustly, on parts of recordings that are not judged.

A value that the description states, or a parameter overrides, is not fitted.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.estimators.models import NEAR
from cooploc.scenarios.recordings.logs import fit as single
from cooploc.scenarios.recordings.logs.run import LogRun
from cooploc.scenarios.recordings.robust import huber
from cooploc.scenarios.recordings.team.residuals import Part, Residuals, of_robot
from cooploc.scenarios.recordings.team.sampling import Gaps
from cooploc.scenarios.recordings.team.team_log import OdometryKind

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


def fit_path_loss(r: Residuals, A: float | None, eta: float | None, robust: bool) -> tuple[float, float, float, Memory]:
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
        sigma = single.fit_displacement(every, tick, scale, robust)
        return Odometry(np.full((len(robots), 2), scale), (sigma, sigma))
    common = single.fit_wheel_odometry(every, tick, *stated, robust)
    scales = []
    for robot in robots:
        enough = sum(int(run.known.sum()) for run in mine[robot]) >= ENOUGH
        own = single.fit_wheel_odometry(mine[robot], tick, *stated, robust) if enough else common
        scales.append([own.length_scale, own.turn_scale])
    scaled = [_scaled(run, scale) for robot, scale in zip(robots, scales, strict=True) for run in mine[robot]]
    rest = single.fit_wheel_odometry(scaled, tick, 1.0, 1.0, robust)
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
