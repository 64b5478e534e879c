"""Fits the models of a run on the other runs: on their truth and readings, never on its own.

A value that the description states, or a parameter overrides, is not fitted. With `robust`, Huber's loss is minimised.
Then sigma of RSSI is that of the Gaussian core, as filters refuse what is far from it; sigma of odometry, which no
filter refuses, is the median run's root mean square.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.estimators.models import NEAR, wrap
from cooploc.scenarios.recordings.logs.run import LogRun
from cooploc.scenarios.recordings.robust import huber

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
    length, sigma_v = _proportional([_arcs(run) for run in runs], length_scale, robust)
    turn, sigma_omega = _proportional([_turns(run) for run in runs], turn_scale, robust)
    return OdometryFit(length, turn, sigma_v / tick**0.5, sigma_omega / tick**0.5)


def fit_displacement(runs: Sequence[LogRun], tick: float, scale: float = 1.0, robust: bool = False) -> float:
    """sigma [m] per axis, of displacements in a tick of `tick` seconds."""
    return float(_proportional([_displacements(run) for run in runs], scale, robust)[1] * tick**0.5)


def _distance(truth: Array, anchors: Array) -> Array:
    delta = truth[:, None, :2] - anchors
    return np.hypot(delta[..., 0], delta[..., 1])


def _lag1(residuals: list[Array]) -> float:
    """Correlation of a residual with the one of the same anchor in the line before."""
    before, after = (np.concatenate([e[s].ravel() for e in residuals]) for s in (np.s_[:-1], np.s_[1:]))
    both = np.isfinite(before) & np.isfinite(after)
    a, b = before[both], after[both]
    return float((a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum())) if both.any() else 0.0


def _proportional(parts: Sequence[Sample], scale: float | None, robust: bool) -> tuple[float, float]:
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
