"""A recording with one series replaced, for the looks that follow a finding."""

from typing import Any

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.team_log import Channel, Readings, Series, TeamLog

LEAST = 1.0  # [m] from the start


def with_truth(log: TeamLog, robot: int, **changed: Any) -> TeamLog:
    """The log with fields of one robot's truth replaced; one without truth stays without."""
    truth = list(log.truth)
    series = truth[robot]
    truth[robot] = None if series is None else series._replace(**changed)
    return log._replace(truth=tuple(truth))


def with_odometry(log: TeamLog, robot: int, **changed: Any) -> TeamLog:
    """The log with fields of one robot's odometry replaced."""
    odometry = list(log.odometry)
    odometry[robot] = odometry[robot]._replace(**changed)
    return log._replace(odometry=tuple(odometry))


def with_readings(log: TeamLog, channel: Channel, readings: Readings) -> TeamLog:
    """The log with the readings of one channel replaced."""
    return log._replace(readings={**log.readings, channel: readings})


def scaled(values: Array, factor: float, columns: tuple[int, ...]) -> Array:
    """Some columns of values (m, k) divided by a factor."""
    factors = np.ones(values.shape[1])
    factors[list(columns)] = 1 / factor
    return values * factors


def truth_of(log: TeamLog, robot: int) -> Series | None:
    """The lines of a robot's truth whose position is known; None where there are fewer than ten."""
    series = log.truth[robot]
    if series is None:
        return None
    known = np.isfinite(series.values[:, :2]).all(axis=1)
    if known.sum() < 10:
        return None
    return series._replace(time=series.time[known], values=series.values[known])


def moves(log: TeamLog, robot: int) -> bool:
    """Whether a robot's truth goes a metre from where it began: one that stands says nothing of clocks and frames."""
    truth = truth_of(log, robot)
    return truth is not None and bool((np.hypot(*(truth.values[:, :2] - truth.values[0, :2]).T) > LEAST).any())
