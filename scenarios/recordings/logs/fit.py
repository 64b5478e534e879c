"""Models of a run fitted on the other runs: their truth and readings, never its own.

What a description states, or a parameter overrides, is not fitted.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.estimators.models.angles import wrap
from cooploc.estimators.models.sensors import NEAR
from cooploc.scenarios.recordings.logs.run import Run

MOVING = 0.03  # [m] in a tick; the course of less says nothing

Sample = tuple[Array, Array, Array]  # odometry, truth, seconds


class PathLoss(NamedTuple):
    """z = A - 10 eta log10 d."""

    A: float  # [dBm]
    eta: float
    sigma: float  # [dB] of the residuals
    lag1: float  # correlation of the residuals from line to line, per anchor


class Drive(NamedTuple):
    """True motion = scale x odometry + noise, whose standard deviations are quoted at a tick."""

    length_scale: float
    turn_scale: float
    sigma_v: float  # [m/s]
    sigma_omega: float  # [rad/s]


def path_loss(runs: Sequence[Run], anchors: Array, A: float | None = None, eta: float | None = None) -> PathLoss:
    """A and eta, where they are not given, by least squares over every reading whose place is known."""
    c = np.array([np.nan if value is None else value for value in (A, eta)])
    logs = [-10 * np.log10(np.maximum(_distance(run.truth, anchors), NEAR)) for run in runs]
    L, z = (np.concatenate([np.empty((0, len(anchors))), *part]) for part in (logs, [run.rssi for run in runs]))
    there, free = np.isfinite(L) & np.isfinite(z), np.isnan(c)
    if there.sum() < 3:
        return PathLoss(float(c[0]), float(c[1]), np.nan, np.nan)
    X = np.stack([np.ones(there.sum()), L[there]], -1)
    c[free] = np.linalg.lstsq(X[:, free], z[there] - X[:, ~free] @ c[~free])[0]
    rest = [run.rssi - (c[0] + c[1] * log) for run, log in zip(runs, logs, strict=True)]
    square = sum(float(np.nansum(e**2)) for e in rest)
    sigma = np.sqrt(square / max(int(there.sum()) - int(free.sum()), 1))
    return PathLoss(float(c[0]), float(c[1]), float(sigma), _lag1(rest))


def drive(
    runs: Sequence[Run], tick: float, length_scale: float | None = None, turn_scale: float | None = None
) -> Drive:
    """Noise of (v, omega), and their scales where they are not given; without runs to fit on, these are 1."""
    length, sigma_v = _proportional([_arcs(run) for run in runs], length_scale)
    turn, sigma_omega = _proportional([_turns(run) for run in runs], turn_scale)
    return Drive(length, turn, sigma_v / tick**0.5, sigma_omega / tick**0.5)


def displacement(runs: Sequence[Run], tick: float, scale: float = 1.0) -> float:
    """sigma [m] per axis and tick."""
    return float(_proportional([_displacements(run) for run in runs], scale)[1] * tick**0.5)


def _distance(truth: Array, anchors: Array) -> Array:
    delta = truth[:, None, :2] - anchors
    return np.hypot(delta[..., 0], delta[..., 1])


def _lag1(rest: list[Array]) -> float:
    """Correlation of a residual with the one of the line before, same anchor."""
    before, after = (np.concatenate([e[s].ravel() for e in rest]) for s in (np.s_[:-1], np.s_[1:]))
    both = np.isfinite(before) & np.isfinite(after)
    a, b = before[both], after[both]
    return float((a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum())) if both.any() else 0.0


def _proportional(parts: Sequence[Sample], scale: float | None) -> tuple[float, float]:
    """y = scale x + noise whose variance grows as dt: scale, and the standard deviation after one second."""
    x, y, dt = (np.concatenate([np.empty(0), *(part[i] for part in parts)]) for i in range(3))
    if scale is None:
        scale = float((x * y / dt).sum() / (x**2 / dt).sum()) if x.any() else 1.0
    return scale, float(np.sqrt(((y - scale * x) ** 2 / dt).mean())) if len(x) else np.nan


def _arcs(run: Run) -> Sample:
    """Per tick with truth at both ends: odometry's length [m], the true one, seconds."""
    step = np.diff(run.truth[:, :2], axis=0)
    arc, length = np.abs(run.odometry[:, 0]) * run.dt, np.hypot(step[:, 0], step[:, 1])
    good = run.known & np.isfinite(arc) & np.isfinite(length)
    return arc[good], length[good], run.dt[good]


def _turns(run: Run) -> Sample:
    """Between directions that the truth shows: odometry's turn [rad], the true one, seconds.

    The direction is the heading where it was recorded, else the course of a tick that moved: the heading in the middle
    of the tick.
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


def _displacements(run: Run) -> Sample:
    """Per tick and axis: odometry's displacement [m], the true one, seconds."""
    step, dt = np.diff(run.truth[:, :2], axis=0), np.repeat(run.dt[:, None], 2, 1)
    good = run.known[:, None] & np.isfinite(run.odometry) & np.isfinite(step)
    return run.odometry[good], step[good], dt[good]
