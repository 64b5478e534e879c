"""Ranges against true distances: unit, names exchanged, a bias of each pair, a clock of their own."""

from collections.abc import Iterator

import numpy as np
from scipy.optimize import linear_sum_assignment

from cooploc.estimators.interface import Array, Indices
from cooploc.scenarios.recordings.inspect.corrected import scaled, with_readings
from cooploc.scenarios.recordings.inspect.finding import Change, Finding, Looked, Sure
from cooploc.scenarios.recordings.inspect.geometry import TEAMMATES, geometry, other_name, others, poses
from cooploc.scenarios.recordings.inspect.robust import median, spread
from cooploc.scenarios.recordings.team_log import Channel, Readings, TeamLog

RANGED: dict[Channel, str] = {
    "range": "ranges",
    "anchor_range": "ranges",
    "sighting": "sightings",
    "landmark": "sightings",
}  # channels with ranges, and their table of log.toml
FEWEST = 20  # readings of a pair
BIAS = 0.1  # [m] a smaller one matters little beside the noise of ranges
UNITS = {1000.0: "mm", 100.0: "cm", 0.01: "m", 0.001: "m"}


def look_at_range_units(log: TeamLog) -> Looked:
    """Ranges that are 100 or 1000 times the distance; within a factor of 2.5, as frames may still be wrong."""
    findings = []
    for channel, readings in ranged(log):
        ratio = median(readings.values[:, 0] / geometry(log, channel, readings).distance)
        for factor, unit in UNITS.items():
            if factor / 2.5 < ratio < factor * 2.5:
                fact = f"ranges are {ratio:.3g} times the distances"
                change = Change(RANGED[channel], ("range",), f'unit = "{unit}"')
                findings.append(Finding("unit", "", readings.source, fact, "sure", change))
                readings = readings._replace(values=scaled(readings.values, factor, (0,)))
                log = with_readings(log, channel, readings)
    return Looked(tuple(findings), log)


def look_at_reading_clocks(log: TeamLog) -> Looked:
    """Ranges that fit the distances of some seconds earlier or later."""
    findings = []
    for channel, readings in ranged(log):
        shift, with_it, without = best_shift(log, channel, readings)
        interval = _interval(readings)
        # A third less spread; of few readings more, as a spread of n errs by about 1/sqrt(n), and many are tried.
        less = min(2 / 3, np.exp(-4 / np.sqrt(len(readings.time))))
        if abs(shift) > max(0.1, 1.5 * interval) and with_it < less * without:
            fact = (
                f"ranges fit the distances of {abs(shift):.3g} s {'later' if shift > 0 else 'earlier'} "
                f"(spread {with_it:.3g} m, {without:.3g} m as stamped)"
            )
            change = Change(RANGED[channel], (), f"clock_offset = {shift:.3g}")
            sure: Sure = "sure" if with_it < 0.4 * without else "likely"
            findings.append(Finding("clock", "", readings.source, fact, sure, change))
            log = with_readings(log, channel, readings._replace(time=readings.time + shift))
    return Looked(tuple(findings), log)


def look_at_names(log: TeamLog) -> Looked:
    """Readings whose numbers fit another robot, landmark or anchor than the one they name."""
    findings = []
    for channel, readings in ranged(log):
        other, said = readings.other.copy(), []
        for i in np.unique(readings.robot):
            rows = readings.robot == i
            for named, fitting in _renamed(log, channel, readings, int(i)).items():
                other[rows & (readings.other == named)] = fitting
                names = [other_name(log, channel, k) for k in (named, fitting)]
                said.append(f"{log.robots[i]}: {names[0]} is {names[1]}")
        if said:
            fact = "ranges fit the distances of other names: " + ", ".join(said)
            change = Change(RANGED[channel], ("nodes",), 'nodes = { "name in the file" = "name here" }')
            findings.append(Finding("robots", "", readings.source, fact, "likely", change))
            log = with_readings(log, channel, readings._replace(other=other))
    return Looked(tuple(findings), log)


def look_at_biases(log: TeamLog) -> Looked:
    """Ranges of a pair that are too long or too short by a constant."""
    findings = []
    for channel, readings in ranged(log):
        residual = readings.values[:, 0] - geometry(log, channel, readings).distance
        found = {}
        for i, k, rows in pairs(readings, channel):
            bias, error = median(residual[rows]), 1.2533 * spread(residual[rows]) / np.sqrt(max(len(rows), 1))
            if np.isfinite(residual[rows]).sum() >= FEWEST and abs(bias) > max(BIAS, 5 * error):
                found[f"{log.robots[i]}-{other_name(log, channel, k)}"] = bias
        if found:
            fact = "ranges minus distances, medians: " + ", ".join(f"{pair} {b:+.2f} m" for pair, b in found.items())
            key = {"range": "range_bias", "anchor_range": "anchor_range_bias"}.get(channel, "")
            typical = f"{key} = {np.median(list(found.values())):.2f}"
            change = Change("model", (), typical if key else "calibrate the camera")
            findings.append(Finding("bias", "", readings.source, fact, "sure", change))
    return Looked(tuple(findings), log)


def ranged(log: TeamLog) -> Iterator[tuple[Channel, Readings]]:
    """The channels that have ranges, with enough readings."""
    for channel, readings in log.readings.items():
        if channel in RANGED and len(readings.time) >= FEWEST:
            yield channel, readings


def pairs(readings: Readings, channel: Channel) -> Iterator[tuple[int, int, Indices]]:
    """Robot, other, and the rows of their readings; of robot-to-robot ranges, both directions together."""
    first, second = readings.robot, readings.other
    if channel in ("range", "rssi"):
        first, second = np.minimum(first, second), np.maximum(first, second)
    for i, k in np.unique(np.stack([first, second]), axis=1).T:
        yield int(i), int(k), np.flatnonzero((first == i) & (second == k))


def best_shift(log: TeamLog, channel: Channel, readings: Readings) -> tuple[float, float, float]:
    """The shift [s] of the stamps at which ranges fit distances best, the spread [m] there, and without a shift."""
    every = max(1, len(readings.time) // 2000)
    few = readings._replace(**{name: getattr(readings, name)[::every] for name in ("time", "robot", "other", "values")})
    groups = [rows for _, _, rows in pairs(few, channel) if len(rows) >= 10]
    if not groups:
        return 0.0, np.nan, np.nan

    def misfit(shift: float) -> float:
        residual = few.values[:, 0] - geometry(log, channel, few, shift).distance
        centred = np.concatenate([residual[rows] - median(residual[rows]) for rows in groups])
        return spread(centred) if np.isfinite(centred).sum() >= FEWEST else np.inf

    span = float(readings.time[-1] - readings.time[0])
    reach, step = min(30.0, span / 4), max(0.05, min(1.0, span / 400))
    coarse = step * np.arange(-int(reach / step), int(reach / step) + 1)
    best = float(coarse[np.argmin([misfit(s) for s in coarse])])
    fine = best + step * np.linspace(-1, 1, 11)
    misfits = [misfit(s) for s in fine]
    return float(fine[int(np.argmin(misfits))]), float(min(misfits)), misfit(0.0)


def _interval(readings: Readings) -> float:
    gaps = np.diff(np.unique(readings.time))
    return float(np.median(gaps)) if len(gaps) else 0.0


def _renamed(log: TeamLog, channel: Channel, readings: Readings, i: int) -> dict[int, int]:
    """Named other -> the one that the ranges of robot i fit, where that is another, and fits three times as well."""
    named = np.unique(readings.other[readings.robot == i])
    candidates = np.arange(len(log.robots) if channel in TEAMMATES else len(_places(log, channel)))
    candidates = candidates[(candidates != i) | (channel not in TEAMMATES)]
    misfit = np.full((len(named), len(candidates)), np.inf)
    for row, k in enumerate(named):
        rows = np.flatnonzero((readings.robot == i) & (readings.other == k))
        rows = rows[:: max(1, len(rows) // 500)]
        here = poses(log, readings.robot[rows], readings.time[rows])[:, :2]
        for column, other in enumerate(candidates):
            there = others(log, channel, np.full(len(rows), other), readings.time[rows])
            residual = readings.values[rows, 0] - np.hypot(*(there - here).T)
            if np.isfinite(residual).sum() >= FEWEST:
                misfit[row, column] = median(np.abs(residual - median(residual)))
    rows_, columns = linear_sum_assignment(np.where(np.isfinite(misfit), misfit, 1e6))
    own = {int(k): c for c, k in enumerate(candidates)}
    found = {
        int(named[r]): int(candidates[c])
        for r, c in zip(rows_, columns, strict=True)
        if named[r] != candidates[c] and misfit[r, c] < misfit[r, own[int(named[r])]] / 3 < np.inf
    }
    return found if set(found) == set(found.values()) else {}  # an exchange needs both; a landmark misread at times not


def _places(log: TeamLog, channel: Channel) -> Array:
    return (log.landmarks if channel == "landmark" else log.anchors).positions
