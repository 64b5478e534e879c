"""Checks of readings against the truth: ranges, bearings and signal strength; and where ranges put a shifted frame."""

from collections.abc import Iterator

import numpy as np
from scipy.optimize import least_squares, linear_sum_assignment
from scipy.stats import theilslopes

from cooploc.estimators.interface import Array, Indices
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings import sampling
from cooploc.scenarios.recordings.inspect.finding import CheckedLog, divide_columns
from cooploc.scenarios.recordings.inspect.motion import concentration, median, robust_sd
from cooploc.scenarios.recordings.team_log import Channel, Readings, TeamLog, fixed_places, other_names

# Table of log.toml, of the channels with ranges.
TABLES = {"range": "ranges", "anchor_range": "ranges", "sighting": "sightings", "landmark": "sightings"}
FEWEST = 20  # readings of a channel or pair
NEAREST = 0.05  # [m] readings of things nearer than this are left out: no direction, and a ratio means nothing

# --- Geometry


def distances(log: TeamLog, channel: Channel, readings: Readings, shift: float = 0.0) -> Array:
    """Return the true distance (m,) [m] to what was measured, `shift` seconds later; nan where it is not known."""
    here, there = ends(log, channel, readings._replace(time=readings.time + shift))
    distance = np.hypot(*(there - here[:, :2]).T)
    return np.where(distance > NEAREST, distance, np.nan)


def ends(log: TeamLog, channel: Channel, readings: Readings) -> tuple[Array, Array]:
    """Return the true poses (m, 3) of those who measured, and the places (m, 2) of what they measured."""
    here, fixed = true_poses(log, readings.robot, readings.time), fixed_places(log, channel)
    if fixed is None:
        return here, true_poses(log, readings.other, readings.time)[:, :2]
    return here, fixed.positions[readings.other]


def true_poses(log: TeamLog, robot: Indices, time: Array) -> Array:
    """Return the true poses (m, 3) of several robots, each at its own stamps: interpolated, nan in gaps."""
    poses = np.full((len(time), 3), np.nan)
    for i in np.unique(robot):
        truth = log.truth[i]
        if truth is not None and len(truth.time) > 1:
            max_gap = max(5 * float(np.median(np.diff(truth.time))), 0.5)
            poses[robot == i] = sampling.poses(truth, time[robot == i], max_gap)
    return poses


def range_channels(log: TeamLog) -> Iterator[tuple[Channel, Readings]]:
    """Yield the channels that have ranges, with enough readings."""
    for channel, readings in log.readings.items():
        if channel in TABLES and len(readings.time) >= FEWEST:
            yield channel, readings


def pairs(readings: Readings, channel: Channel) -> Iterator[tuple[int, int, Indices]]:
    """Yield robot, other, and the rows of their readings; of robot-to-robot ranges, both directions together."""
    first, second = readings.robot, readings.other
    if channel in ("range", "rssi"):
        first, second = np.minimum(first, second), np.maximum(first, second)
    for i, k in np.unique(np.stack([first, second]), axis=1).T:
        yield int(i), int(k), np.flatnonzero((first == i) & (second == k))


def _rows(readings: Readings, rows: Indices | slice) -> Readings:
    return readings._replace(**{name: getattr(readings, name)[rows] for name in ("time", "robot", "other", "values")})


# --- Ranges

BIAS = 0.1  # [m] a smaller one matters little beside the noise of ranges
UNITS = {1000.0: "mm", 100.0: "cm", 0.01: "m", 0.001: "m"}
BIAS_KEYS = {"range": "range_bias", "anchor_range": "anchor_range_bias"}


def check_range_units(c: CheckedLog) -> None:
    """Ranges that are 100 or 1000 times the distance; within a factor of 2.5, as frames may still be wrong."""
    for channel, readings in range_channels(c.log):
        ratio = median(readings.values[:, 0] / distances(c.log, channel, readings))
        for factor, unit in UNITS.items():
            if factor / 2.5 < ratio < factor * 2.5:
                fact, setting = f"ranges are {ratio:.3g} times the distances", f'unit = "{unit}"'
                c.add("unit", None, readings.source, fact, "sure", setting, TABLES[channel], ("range",))
                c.correct_readings(channel, divide_columns(readings, factor, (0,)))


def check_names(c: CheckedLog) -> None:
    """Readings whose numbers fit another robot, landmark or anchor than the one they name."""
    for channel, readings in range_channels(c.log):
        other, changes, names = readings.other.copy(), [], other_names(c.log, channel)
        for i in np.unique(readings.robot).tolist():
            for named, fitting in _find_renamed(c.log, channel, readings, i).items():
                other[(readings.robot == i) & (readings.other == named)] = fitting
                changes.append(f"{c.log.robots[i]}: {names[named]} is {names[fitting]}")
        if changes:
            fact = "ranges fit the distances of other names: " + ", ".join(changes)
            setting = 'nodes = { "name in the file" = "name here" }'
            c.add("robots", None, readings.source, fact, "likely", setting, TABLES[channel], ("nodes",))
            c.correct_readings(channel, readings._replace(other=other))


def _find_renamed(log: TeamLog, channel: Channel, readings: Readings, i: int) -> dict[int, int]:
    """Named other -> the one that the ranges of robot i fit, if that is another, and fits three times as well."""
    named = np.unique(readings.other[readings.robot == i])
    mutual = fixed_places(log, channel) is None
    candidates = [k for k in range(len(other_names(log, channel))) if not (mutual and k == i)]
    misfit = np.full((len(named), len(candidates)), np.inf)
    for row, k in enumerate(named):
        rows = np.flatnonzero((readings.robot == i) & (readings.other == k))
        some = _rows(readings, rows[:: max(1, len(rows) // 500)])
        for column, candidate in enumerate(candidates):
            here, there = ends(log, channel, some._replace(other=np.full(len(some.time), candidate)))
            residual = some.values[:, 0] - np.hypot(*(there - here[:, :2]).T)
            if np.isfinite(residual).sum() >= FEWEST:
                misfit[row, column] = median(np.abs(residual - median(residual)))
    found = {
        int(named[r]): candidates[k]
        for r, k in zip(*linear_sum_assignment(np.where(np.isfinite(misfit), misfit, 1e6)), strict=True)
        if named[r] != candidates[k] and misfit[r, k] < misfit[r, candidates.index(named[r])] / 3 < np.inf
    }
    return found if set(found) == set(found.values()) else {}  # an exchange needs both; a landmark misread at times not


def check_reading_clocks(c: CheckedLog) -> None:
    """Ranges that fit the distances of some seconds earlier or later."""
    for channel, readings in range_channels(c.log):
        shift, with_it, without = _best_shift(c.log, channel, readings)
        gaps = np.diff(np.unique(readings.time))
        interval = float(np.median(gaps)) if len(gaps) else 0.0
        # A third less spread; of few readings more, as a spread of n errs by about 1/sqrt(n), and many are tried.
        less = min(2 / 3, np.exp(-4 / np.sqrt(len(readings.time))))
        if abs(shift) > max(0.1, 1.5 * interval) and with_it < less * without:
            fact = (
                f"ranges fit the distances of {abs(shift):.3g} s {'later' if shift > 0 else 'earlier'} "
                f"(spread {with_it:.3g} m, {without:.3g} m as stamped)"
            )
            sure = "sure" if with_it < 0.4 * without else "likely"
            c.add("clock", None, readings.source, fact, sure, f"clock_offset = {shift:.3g}", TABLES[channel])
            c.correct_readings(channel, readings._replace(time=readings.time + shift))


def _best_shift(log: TeamLog, channel: Channel, readings: Readings) -> tuple[float, float, float]:
    """Return the shift [s] of the stamps at which ranges fit distances best, the spread [m] there, and without it."""
    few = _rows(readings, slice(None, None, max(1, len(readings.time) // 2000)))
    groups = [rows for _, _, rows in pairs(few, channel) if len(rows) >= 10]
    if not groups:
        return 0.0, np.nan, np.nan

    def misfit(shift: float) -> float:
        residual = few.values[:, 0] - distances(log, channel, few, shift)
        centred = np.concatenate([residual[rows] - median(residual[rows]) for rows in groups])
        return robust_sd(centred) if np.isfinite(centred).sum() >= FEWEST else np.inf

    span = float(readings.time[-1] - readings.time[0])
    reach, step = min(30.0, span / 4), max(0.05, min(1.0, span / 400))
    best = min(step * np.arange(-int(reach / step), int(reach / step) + 1), key=misfit)
    fine = best + step * np.linspace(-1, 1, 11)
    misfits = [misfit(s) for s in fine]
    return float(fine[int(np.argmin(misfits))]), min(misfits), misfit(0.0)


def check_biases(c: CheckedLog) -> None:
    """Ranges of a pair that are too long or too short by a constant."""
    for channel, readings in range_channels(c.log):
        residual = readings.values[:, 0] - distances(c.log, channel, readings)
        found = {}
        for i, k, rows in pairs(readings, channel):
            bias, error = median(residual[rows]), 1.2533 * robust_sd(residual[rows]) / np.sqrt(len(rows))
            if np.isfinite(residual[rows]).sum() >= FEWEST and abs(bias) > max(BIAS, 5 * error):
                found[f"{c.log.robots[i]}-{other_names(c.log, channel)[k]}"] = bias
        if found:
            fact = "ranges minus distances, medians: " + ", ".join(f"{pair} {b:+.2f} m" for pair, b in found.items())
            key, typical = BIAS_KEYS.get(channel), np.median(list(found.values()))
            setting = f"{key} = {typical:.2f}" if key else "calibrate the camera"
            c.add("bias", None, readings.source, fact, "sure", setting, "model")


def shift_that_fits(log: TeamLog, i: int) -> Array | None:
    """Return the shift (2,) [m] of robot i's true positions that its ranges fit best; None if it has too few.

    Least squares with a loss that spares outliers; a bias is fitted as well, as it must not look like a shift.
    """
    deltas, ranges = [np.empty((0, 2))], [np.empty(0)]
    for channel, readings in range_channels(log):
        own = _rows(readings, np.flatnonzero(readings.robot == i))
        here, there = ends(log, channel, own)
        deltas.append(there - here[:, :2])
        ranges.append(own.values[:, 0])
    delta, measured = np.concatenate(deltas), np.concatenate(ranges)
    known = np.flatnonzero(np.isfinite(delta).all(axis=1) & np.isfinite(measured))
    if len(known) < FEWEST:
        return None
    known = known[:: max(1, len(known) // 400)]
    delta, measured = delta[known], measured[known]
    middle, reach = delta.mean(axis=0), float(np.median(measured))
    around = [middle + reach * np.array([np.cos(a), np.sin(a)]) for a in np.arange(4) * np.pi / 2]

    def residuals(guess: Array) -> Array:  # x, y of the shift, and the bias
        return np.asarray(np.hypot(*(delta - guess[:2]).T) + guess[2] - measured)

    starts = [np.append(start, 0.0) for start in (np.zeros(2), middle, *around)]
    fits = [least_squares(residuals, start, loss="soft_l1", f_scale=0.3) for start in starts]
    return np.asarray(min(fits, key=lambda fit: float(fit.cost)).x[:2])


# --- Bearings and signal strength

FOLLOWS = 0.6  # mean resultant length
OFFSET = 0.15  # [rad] of a camera against straight ahead
DECAY = (0.8, 8.0)  # path-loss exponents from free space with reflections to a building
MOST = 700  # samples: pairs of samples grow with the square


def check_bearings(c: CheckedLog) -> None:
    """Bearings in degrees, to the right, or from elsewhere than straight ahead."""
    place = ("sightings", ("bearing",))
    for channel, readings in range_channels(c.log):
        if TABLES[channel] != "sightings":
            continue
        here, there = ends(c.log, channel, readings)
        x, y = (there - here[:, :2]).T
        expected = wrap(np.arctan2(y, x) - here[:, 2])
        if np.isfinite(expected).sum() < FEWEST:
            continue
        largest = np.nanmax(np.abs(readings.values[:, 1]))
        if largest > 2.1 * np.pi:
            fact = f"bearings reach {largest:.4g} as read: they are in degrees"
            c.add("degrees", None, readings.source, fact, "sure", 'unit = "deg"', *place)
            readings = divide_columns(readings, 180 / np.pi, (1,))
            c.correct_readings(channel, readings)
        bearing = readings.values[:, 1]
        (follows, offset), (opposes, _) = concentration(bearing - expected), concentration(bearing + expected)
        if opposes > max(FOLLOWS, follows + 0.1) and concentration(expected)[0] < 0.95:
            fact = f"bearings grow to the right (agreement {opposes:.2f}, {follows:.2f} to the left)"
            c.add("bearing", None, readings.source, fact, "sure", "write -bearing into the files", *place)
            c.correct_readings(channel, divide_columns(readings, -1.0, (1,)))
        elif follows > FOLLOWS and abs(offset) > OFFSET:
            degrees = np.degrees(offset)
            fact = f"bearings are {degrees:+.0f} deg from the true directions (agreement {follows:.2f})"
            c.add("bearing", None, readings.source, fact, "likely", f"subtract {degrees:.0f} deg in the files", *place)


def check_rssi(c: CheckedLog) -> None:
    """Signal strength that rises with the distance, or is not in dBm."""
    for channel, readings in c.log.readings.items():
        if not channel.endswith("rssi") or len(readings.time) < 50:
            continue
        rssi, distance = readings.values[:, 0], distances(c.log, channel, readings)
        known = np.flatnonzero(np.isfinite(rssi) & np.isfinite(distance))
        known = known[:: max(1, len(known) // MOST)]
        middle, sure, fact = median(rssi), "likely", ""
        if middle > 0:
            fact = f"signal strengths are above 0 (median {middle:.3g}): dBm without their sign, or a share"
            sure = "sure"
        elif len(known) >= 50 and np.ptp(np.log10(distance[known])) >= 0.3:
            fit = theilslopes(rssi[known], -10 * np.log10(distance[known]))
            if fit.high_slope < 0 or not DECAY[0] < fit.high_slope or fit.low_slope > DECAY[1]:
                fact = (
                    f"signal strength falls by {10 * fit.slope:.1f} dB where the distance is ten times as long "
                    f"(eta {fit.slope:.2f}, 95 % from {fit.low_slope:.2f} to {fit.high_slope:.2f}); 1.5 to 6 is usual"
                )
        if fact:
            setting = "write dBm, which are below 0, into the files"
            c.add("rssi", None, readings.source, fact, sure, setting, "rssi", ("rssi",))
