"""Where the truth puts both ends of a reading."""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Indices
from cooploc.scenarios.recordings.inspect.corrected import truth_of
from cooploc.scenarios.recordings.team_log import Channel, Readings, TeamLog

TEAMMATES: tuple[Channel, ...] = ("range", "rssi", "sighting")
NEAREST = 0.05  # [m] readings of things nearer than this are left out: no direction, and a ratio means nothing


class Geometry(NamedTuple):
    """Of every reading, by the truth; nan where that has no position within its usual interval."""

    distance: Array  # (m,) [m]
    direction: Array  # (m,) of what was measured, from x [rad]
    heading: Array  # (m,) of the robot that measured [rad]


def at(log: TeamLog, robot: int, time: Array) -> Array:
    """The true pose (m, 3) of a robot at any stamps: interpolated, nan in gaps."""
    truth = truth_of(log, robot)
    if truth is None:
        return np.full((len(time), 3), np.nan)
    t, values = truth.time, truth.values
    right = np.clip(np.searchsorted(t, time), 1, len(t) - 1)
    usual = float(np.median(np.diff(t)))
    unknown = (t[right] - t[right - 1] > max(5 * usual, 0.5)) | (time < t[0] - usual) | (time > t[-1] + usual)
    heading = values[:, 2]
    cosine, sine = (np.interp(time, t, part(heading)) for part in (np.cos, np.sin))
    x, y = (np.interp(time, t, column) for column in values[:, :2].T)
    pose = np.column_stack([x, y, np.arctan2(sine, cosine)])
    pose[unknown] = np.nan
    return pose


def geometry(log: TeamLog, channel: Channel, readings: Readings, shift: float = 0.0) -> Geometry:
    """Distance and direction from the robots that measured to what they measured, `shift` seconds later."""
    time = readings.time + shift
    here = poses(log, readings.robot, time)
    there = others(log, channel, readings.other, time)
    delta = there - here[:, :2]
    distance = np.hypot(*delta.T)
    distance = np.where(distance > NEAREST, distance, np.nan)
    return Geometry(distance, np.arctan2(delta[:, 1], delta[:, 0]), here[:, 2])


def poses(log: TeamLog, robot: Indices, time: Array) -> Array:
    """The true poses (m, 3) of several robots, each at its own stamps."""
    found = np.full((len(time), 3), np.nan)
    for i in np.unique(robot):
        own = robot == i
        found[own] = at(log, int(i), time[own])
    return found


def others(log: TeamLog, channel: Channel, other: Indices, time: Array) -> Array:
    """Where what was measured is (m, 2): a teammate by its truth, a landmark or an anchor by its surveyed place."""
    if channel in TEAMMATES:
        return poses(log, other, time)[:, :2]
    places = log.landmarks if channel == "landmark" else log.anchors
    return places.positions[other]


def other_name(log: TeamLog, channel: Channel, other: int) -> str:
    """The name of what was measured."""
    if channel in TEAMMATES:
        return log.robots[other]
    return (log.landmarks if channel == "landmark" else log.anchors).names[other]
