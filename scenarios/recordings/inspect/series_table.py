"""What a recording holds, series by series: samples, rate, span, gaps."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.inspect.geometry import other_name
from cooploc.scenarios.recordings.team_log import TeamLog

SILENCE = 10.0  # median intervals without a sample are a gap


class SeriesRow(NamedTuple):
    """One series."""

    series: str  # "odometry", "truth" or a channel
    of: str  # a robot, or robot-other
    samples: int
    rate: float  # [1/s], of the median interval
    first: float  # [s] after the recording's first stamp
    last: float  # [s] likewise
    gaps: int
    longest: float  # [s] interval
    time: Array  # (m,) [s] since the recording's first stamp
    source: str


def series_rows(log: TeamLog) -> list[SeriesRow]:
    """A row for each series, pairs of robots and things they measure apart."""
    found = list(_series(log))
    begins = [time[0] for _, _, time, _ in found if len(time)]
    zero = min(begins) if begins else 0.0
    return [_row(name, of, time - zero, source) for name, of, time, source in found]


def _series(log: TeamLog) -> Iterator[tuple[str, str, Array, str]]:
    for robot, series in zip(log.robots, log.odometry, strict=True):
        yield "odometry", robot, series.time, series.source
    for robot, truth in zip(log.robots, log.truth, strict=True):
        if truth is not None:
            yield "truth", robot, truth.time[np.isfinite(truth.values[:, :2]).all(axis=1)], truth.source
    for channel, readings in log.readings.items():
        pairs = np.stack([readings.robot, readings.other])
        for i, k in np.unique(pairs, axis=1).T:
            rows = (readings.robot == i) & (readings.other == k)
            of = f"{log.robots[i]}-{other_name(log, channel, int(k))}"
            yield channel, of, readings.time[rows], readings.source


def _row(name: str, of: str, time: Array, source: str) -> SeriesRow:
    intervals = np.diff(time)
    usual = float(np.median(intervals)) if len(intervals) else np.nan
    first, last = (float(time[0]), float(time[-1])) if len(time) else (np.nan, np.nan)
    gaps = int((intervals > max(SILENCE * usual, 1.0)).sum()) if len(intervals) else 0
    longest = float(intervals.max()) if len(intervals) else np.nan
    return SeriesRow(name, of, len(time), 1 / usual if usual > 0 else np.nan, first, last, gaps, longest, time, source)


def measured_counts(log: TeamLog) -> tuple[tuple[str, ...], tuple[str, ...], Array]:
    """Who measured whom: names of rows and columns, and how often (rows, columns); channels together."""
    names = (*log.robots, *log.landmarks.names, *log.anchors.names)
    counts = np.zeros((len(log.robots), len(names)))
    for channel, readings in log.readings.items():
        start = 0
        if channel == "landmark":
            start = len(log.robots)
        elif channel in ("anchor_rssi", "anchor_range"):
            start = len(log.robots) + len(log.landmarks.names)
        np.add.at(counts, (readings.robot, start + readings.other), 1)
    return log.robots, names, counts
