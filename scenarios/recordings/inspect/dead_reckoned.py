"""Where odometry alone says that a robot went, from its true start."""

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.inspect.corrected import truth_of
from cooploc.scenarios.recordings.inspect.travelled import course, integrated, window_of
from cooploc.scenarios.recordings.team_log import TeamLog


def dead_reckoned(log: TeamLog, robot: int) -> Array | None:
    """Positions (m, 2) [m] at odometry's stamps; None where the start is not known.

    A robot without a true heading starts in the direction of its first moves.
    """
    truth = truth_of(log, robot)
    wheels = integrated(log.odometry[robot], log.odometry_kind)
    if truth is None or len(wheels.time) < 2 or truth.time[0] > wheels.time[-1]:
        return None
    begin = int(np.searchsorted(wheels.time, truth.time[0]))
    start = truth.values[0, :2]
    if np.isfinite(wheels.place).any():
        return np.asarray(wheels.place[begin:] - wheels.place[begin] + start)
    heading = wheels.turn[begin:] - wheels.turn[begin] + _first_heading(truth.time, truth.values, window_of(log, robot))
    middle, apart = (heading[1:] + heading[:-1]) / 2, np.diff(wheels.length[begin:])
    steps = np.stack([apart * np.cos(middle), apart * np.sin(middle)], -1)
    return np.concatenate([start[None], start + np.cumsum(steps, axis=0)])


def _first_heading(time: Array, poses: Array, window: float) -> float:
    if np.isfinite(poses[0, 2]):
        return float(poses[0, 2])
    places = poses[np.searchsorted(time, np.arange(time[0], time[-1], window)), :2]
    directions = course(np.diff(places, axis=0))
    known = directions[np.isfinite(directions)]
    return float(known[0]) if len(known) else 0.0
