"""Odometry and truth brought to one form: what a robot has travelled and turned since the start, at any time.

Sums can be looked up at any stamp, so two series with clocks of their own are compared over common windows, and a
shift of one against the other costs one interpolation.
"""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings.team_log import OdometryKind, Series, TeamLog

MOST_WINDOWS = 3000  # of one robot; longer recordings have longer windows


class Travelled(NamedTuple):
    """Sums over time; a column that is not known is nan throughout."""

    time: Array  # (m,)
    length: Array  # (m,)    driven, backwards is negative [m]; of the truth: not known
    turn: Array  # (m,)      turned to the left [rad]
    place: Array  # (m, 2)   where it is [m]; of odometry: in a compass frame, or not known


class Steps(NamedTuple):
    """What one source says happened in each window; nan where it has no samples there."""

    length: Array  # (w,)  driven [m]; of places: how far apart they are
    turn: Array  # (w,)  to the left [rad]
    move: Array  # (w, 2)  [m]


def integrated(series: Series, kind: OdometryKind) -> Travelled:
    """Odometry summed up; a missing value counts as no motion."""
    t = series.time
    unknown = np.full(len(t), np.nan)
    if kind == "displacement":
        place = np.cumsum(np.nan_to_num(series.values), axis=0)
        return Travelled(t, unknown, unknown, place)
    if kind == "velocity":
        length, turn = (_over_time(t, column) for column in series.values.T)
    elif kind == "path":
        length, turn = series.values[:, 0], _over_time(t, series.values[:, 1])
    else:
        length, turn = _of_poses(series.values)
    return Travelled(t, length, turn, np.full((len(t), 2), np.nan))


def travelled_truly(series: Series) -> Travelled:
    """The truth; its heading is unwrapped, and where it was not recorded the turn is not known."""
    known = np.isfinite(series.values[:, :2]).all(axis=1)
    t, values = series.time[known], series.values[known]
    heading = values[:, 2]
    turn = _unwrapped(heading) if np.isfinite(heading).mean() > 0.5 else np.full(len(t), np.nan)
    return Travelled(t, np.full(len(t), np.nan), turn, values[:, :2])


def window_of(log: TeamLog, robot: int) -> float:
    """Length of the windows [s]: two intervals of the slower of odometry and truth, at least 0.2 s."""
    series = [s for s in (log.odometry[robot], log.truth[robot]) if s is not None and len(s.time) > 1]
    if not series:
        return 1.0
    slowest = max(float(np.median(np.diff(s.time))) for s in series)
    span = max(float(s.time[-1] - s.time[0]) for s in series)
    return max(2 * slowest, 0.2, span / MOST_WINDOWS)


def common_edges(a: Array, b: Array, window: float) -> Array:
    """Edges of the windows (w + 1,) that two series of stamps have in common [s]."""
    if not len(a) or not len(b):
        return np.empty(0)
    start, end = max(a[0], b[0]), min(a[-1], b[-1])
    return np.arange(start, end, window) if end > start else np.empty(0)


def steps(travelled: Travelled, edges: Array, gap: float) -> Steps:
    """What happened between edges (w + 1,); nan where an edge lies in an interval longer than `gap` [s]."""
    t = travelled.time
    right = np.clip(np.searchsorted(t, edges), 1, len(t) - 1)
    missing = (t[right] - t[right - 1] > gap) | (edges < t[0] - 1e-9) | (edges > t[-1] + 1e-9)
    unknown = missing[1:] | missing[:-1]

    def change(column: Array) -> Array:
        return np.where(unknown, np.nan, np.diff(np.interp(edges, t, column)))

    move = np.stack([change(travelled.place[:, 0]), change(travelled.place[:, 1])], -1)
    length = np.hypot(*move.T) if np.isnan(travelled.length).all() else change(travelled.length)
    return Steps(length, change(travelled.turn), move)


def _over_time(t: Array, rate: Array) -> Array:
    """The integral of a rate that holds until the next line."""
    return np.concatenate([[0.0], np.cumsum(np.diff(t) * np.nan_to_num(rate[:-1]))])


def _of_poses(pose: Array) -> tuple[Array, Array]:
    """Length and turn of poses (m, 3): a step is as long as its places are apart, negative against its heading."""
    pose = pose.copy()
    for column in pose.T:
        known = np.flatnonzero(np.isfinite(column))
        nearest = np.clip(np.searchsorted(known, np.arange(len(column))), 0, max(len(known) - 1, 0))
        column[:] = column[known[nearest]] if len(known) else 0.0
    heading = np.unwrap(pose[:, 2])
    middle = (heading[1:] + heading[:-1]) / 2
    along = np.diff(pose[:, 0]) * np.cos(middle) + np.diff(pose[:, 1]) * np.sin(middle)
    apart = np.hypot(*np.diff(pose[:, :2], axis=0).T) * np.where(along < 0, -1.0, 1.0)
    return np.concatenate([[0.0], np.cumsum(apart)]), heading


def _unwrapped(heading: Array) -> Array:
    """A heading without leaps of a full turn; where it is missing, as before."""
    known = np.isfinite(heading)
    turned = np.unwrap(heading[known])
    return np.interp(np.arange(len(heading)), np.flatnonzero(known), turned)


def course(move: Array) -> Array:
    """Direction of moves (w, 2) [rad], nan for those shorter than a third of the median: noise has no direction."""
    length = np.hypot(*move.T)
    known = length[np.isfinite(length) & (length > 0)]
    shortest = np.median(known) / 3 if len(known) else np.inf
    return np.where(length > shortest, wrap(np.arctan2(move[:, 1], move[:, 0])), np.nan)
