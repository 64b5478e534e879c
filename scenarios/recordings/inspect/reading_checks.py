"""Checks of readings against the truth: units, clocks and biases of ranges, directions of bearings."""

from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from cooploc.estimators.errors import first_of
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings import sampling, team_log
from cooploc.scenarios.recordings.inspect import motion
from cooploc.scenarios.recordings.inspect.findings import (
    FOLLOWS,
    LEAST_DELAY,
    LENGTH_UNITS,
    LONGEST_DELAY,
    CheckedLog,
    divide_columns,
    unit_of_ratio,
)
from cooploc.scenarios.recordings.radio_nodes import NodeRanges, assign
from cooploc.scenarios.recordings.team_log import Channel, other_names

RANGE_UNITS = (*LENGTH_UNITS, ("unit", "mm", 10.0), ("unit", "cm", 0.1))  # cm taken for mm, or mm for cm
BEST_SPREAD = 0.03  # [m] of ranges about distances
BIAS = 0.1  # [m] a smaller one matters little beside the noise of ranges
BIAS_KEYS = {"range": "range_bias", "anchor_range": "anchor_range_bias"}


def check_range_units(c: CheckedLog) -> None:
    """Find ranges that are 10, 100 or 1000 times the distance; within a factor of 2.5, as frames may still be wrong."""
    for channel, readings in motion.range_channels(c.log):
        ratio = motion.quantile(readings.values[:, 0] / motion.distances(c.log, channel), 0.5)
        if unit := unit_of_ratio(ratio, RANGE_UNITS, 2.5):
            fact, setting = f"ranges are {ratio:.3g} times the distances", f'unit = "{unit[1]}"'
            c.add("unit", None, readings.source, fact, "sure", setting, motion.TABLES[channel], ("range",))
            c.correct(channel, None, divide_columns(readings, unit[2], (0,)))


SHARPER = 0.7  # times the spread of ranges about the distances, from which another cause is believed
MOST_UNKNOWN = 100  # of a fit
ASIDE, FARTHEST = 0.1, 1.0  # [m] of an antenna from the point that is tracked


def check_delays(c: CheckedLog) -> None:
    """Find ranges with shifted stamps, or from a point that is not the one tracked: they spread least with that.

    Of sightings also bearings, which tell more of a robot that turns.
    """
    for channel, readings in motion.range_channels(c.log):
        columns = ((1, "bearings", "rad", "directions"), (0, "ranges", "m", "distances"))
        for column, what, unit, true in columns[motion.TABLES[channel] != "sightings" :]:
            spread = partial(motion.spread_of_readings, c.log, channel, column=column)
            shift, now, longest = 0.0, spread(0.0), min(LONGEST_DELAY, float(np.ptp(readings.time)) / 10)
            for width in (longest, longest / 20, longest / 200) if np.isfinite(now) else ():
                shift = float(min(shift + width * np.linspace(-1, 1, 41), key=spread))
                if abs(shift) < LEAST_DELAY:
                    break
            least = SHARPER * now if abs(shift) < LEAST_DELAY else min(SHARPER * now, 0.9 * spread(shift))
            named = ("clock", motion.TABLES[channel]) in {(one.kind, one.table) for one in c.findings}
            if (column == 0 and find_antennas(c, channel, now, least)) or named:
                continue
            if abs(shift) >= LEAST_DELAY and spread(shift) < min(SHARPER * now, VAGUE):
                fact = f"stamps of {what} are {-shift:+.3g} s from the truth's: they spread by {now:.2g} {unit} about"
                fact += f" {true}, and by {spread(shift):.2g} {unit} without that"
                setting = f"clock_offset = {shift:.3g}"
                c.add("clock", None, readings.source, fact, "likely", setting, motion.TABLES[channel])
                c.correct(channel, None, readings._replace(time=readings.time + shift))


def find_antennas(c: CheckedLog, channel: Channel, now: float, least: float) -> bool:
    """Find antennas beside the point of a robot that is tracked, if ranges spread by less than `least` [m] then.

    Each robot has one, at a place ahead and to the left that turns with it; each pair of robots a bias.
    """
    readings, n = c.log.readings[channel], len(c.log.robots)
    here, there = sampling.ends(c.log, channel)
    between = team_log.fixed_places(c.log, channel) is None
    poses = [here, sampling.poses_at(c.log, readings.other, readings.time)] if between else [here]
    known = np.isfinite(np.concatenate([*poses, there], axis=1)).all(axis=1)
    rows = np.flatnonzero(known)
    rows = rows[:: 1 + len(rows) // SOME]
    if channel not in BIAS_KEYS or len(rows) < motion.FEWEST or not now > BEST_SPREAD:
        return False
    ends = np.sort([readings.robot, readings.other + n * (not between)], axis=0)
    each_pair, pair = np.unique(ends, axis=1, return_inverse=True)
    unknown = 2 * n + each_pair.shape[1]
    if unknown > MOST_UNKNOWN:
        return False
    headings = [pose[:, 2] for pose in poses]
    owners = [readings.robot, readings.other][: len(poses)]

    def distances(places: Array, rows: Any) -> Array:
        apart = there[rows] - here[rows, :2]
        for sign, heading, owner in zip((-1, 1), headings, owners, strict=False):
            ahead, left = places[owner[rows]].T
            cosine, sine = np.cos(heading[rows]), np.sin(heading[rows])
            apart = apart + sign * np.stack([ahead * cosine - left * sine, ahead * sine + left * cosine], -1)
        return np.asarray(np.hypot(*apart.T))

    def residuals(s: Array) -> Array:
        off = distances(s[: 2 * n].reshape(n, 2), rows) + s[2 * n :][pair[rows]] - readings.values[rows, 0]
        return np.concatenate([off, s * BIAS / OFFSET])

    fit: Any = least_squares(residuals, np.zeros(unknown), loss="soft_l1", f_scale=BIAS)
    rest, places = motion.robust_sd(residuals(fit.x)[: len(rows)]), fit.x[: 2 * n].reshape(n, 2)
    errors = max(rest, BEST_SPREAD) * np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))[: 2 * n].reshape(n, 2)
    aside = (np.abs(places) > np.maximum(ASIDE, DEVIATIONS * errors)).any(axis=1)
    if rest >= min(least, VAGUE) or not aside.any() or np.abs(places).max() > FARTHEST:
        return False
    words = [
        f"{abs(x):.2f} m {'ahead' if x > 0 else 'behind'}, {abs(y):.2f} m {'left' if y > 0 else 'right'}"
        for x, y in places
    ]
    each = ", ".join(f"{c.log.robots[i]} {words[i]}" for i in np.flatnonzero(aside))
    fact = f"ranges are from elsewhere than the point that is tracked: {each}; they spread by {now:.2g} m about"
    fact += f" distances, and by {rest:.2g} m from there"
    setting = "nothing: move the true positions to the antennas in the files"
    c.add("places", None, readings.source, fact, "likely", setting, motion.TABLES[channel])
    off = distances(places, slice(None)) - distances(0 * places, slice(None))
    c.correct(channel, None, readings._replace(values=readings.values - np.nan_to_num(off)[:, None]))
    return True


def check_height(c: CheckedLog) -> None:
    """Find ranges to anchors that are slant: they are (d^2 + h^2)^1/2, with one height h of all anchors."""
    if "anchor_range" not in c.log.readings:
        return
    readings, distance = c.log.readings["anchor_range"], motion.distances(c.log, "anchor_range")
    rows = np.flatnonzero(np.isfinite(distance))
    rows = rows[:: 1 + len(rows) // SOME]
    if len(rows) < motion.FEWEST:
        return
    d, r = distance[rows], readings.values[rows, 0]

    def residuals(s: Array) -> Array:
        return np.append(np.hypot(d, s[0]) + s[1] - r, s[1] * BIAS / OFFSET)

    fit: Any = least_squares(residuals, [1.0, 0.0], loss="soft_l1", f_scale=BIAS)
    height, off, rest = abs(float(fit.x[0])), motion.robust_sd(r - d), motion.robust_sd(residuals(fit.x)[:-1])
    if height > MOVED and rest < min(SHARPER * off, VAGUE):
        fact = f"ranges are slant, as of anchors {height:.2g} m above the robots: they are {rest:.2g} m off then, and"
        fact += f" {off:.2g} m as read"
        c.add("height", None, readings.source, fact, "likely", f"height = {height:.2f}", "anchors")
        level, _ = team_log.level_ranges(readings, np.full(len(c.log.anchors.names), height))
        c.correct("anchor_range", None, level)


MOVED, DEVIATIONS = 0.3, 5.0  # [m] and standard errors that a place must be from the stated one
OFFSET = 0.3  # [m] that ranges are usually too long
VAGUE = 0.5  # [m] ranges that are so far off any place say nothing of it
SOME = 2000  # readings that a place is fitted on, at most


def check_places(c: CheckedLog) -> None:
    """Find anchors and landmarks that are elsewhere: ranges follow the distance of another place much better."""
    for channel, readings in motion.range_channels(c.log):
        fixed = team_log.fixed_places(c.log, channel)
        if fixed is None:
            continue
        here, _ = sampling.ends(c.log, channel, headings=False)
        known, moved, facts = np.isfinite(here[:, :2]).all(axis=1), fixed.positions.copy(), []
        for k, name in enumerate(fixed.names):
            rows = np.flatnonzero(known & (readings.other == k))
            rows = rows[:: 1 + len(rows) // SOME]
            if len(rows) < motion.FEWEST:
                continue
            ranges, stated = readings.values[rows, 0], fixed.positions[k]
            off = motion.robust_sd(ranges - np.hypot(*(here[rows, :2] - stated).T))
            place, error, rest = fit_place(here[rows, :2], ranges, stated)
            apart = float(np.hypot(*(place - stated)))
            if rest < min(SHARPER * off, VAGUE) and apart > max(MOVED, DEVIATIONS * error):
                moved[k] = place
                facts.append(f"{name} {apart:.2g} m away (they are {rest:.2g} m off there, and {off:.2g} m here)")
        if facts:
            table = "landmarks" if channel == "landmark" else "anchors"
            fact = f"ranges fit other places, as if surveyed in another frame: {first_of(facts, 4)}"
            there = ", ".join(f"{name} = [{x:.2f}, {y:.2f}]" for name, (x, y) in zip(fixed.names, moved, strict=True))
            c.add("places", None, readings.source, fact, "likely", f"places = {{ {there} }}", table)
            there_are = fixed._replace(positions=moved)
            c.log = c.log._replace(landmarks=there_are) if table == "landmarks" else c.log._replace(anchors=there_are)


def fit_place(here: Array, ranges: Array, stated: Array) -> tuple[Array, float, float]:
    """Return the place (2,) [m] that ranges from positions (m, 2) fit, its standard error, and how far off they are.

    They may be too long by a constant. Starts are the stated place, the solution of |p|^2 - r^2 = 2 p'q - |q|^2, and
    the best one's mirror image across the line of the positions. The error is infinite where two places fit.
    """

    def off(s: Array) -> Array:
        return np.asarray(np.hypot(*(here - s[:2]).T) + s[2] - ranges)

    def residuals(s: Array) -> Array:
        return np.append(off(s), s[2] * BIAS / OFFSET)

    def fit(start: Array) -> Any:
        return least_squares(residuals, [*start, 0.0], loss="soft_l1", f_scale=BIAS)

    middle, along = here.mean(0), np.linalg.svd(here - here.mean(0), full_matrices=False)[2][0]
    linear = np.linalg.lstsq(np.column_stack([2 * here, -np.ones(len(here))]), (here**2).sum(1) - ranges**2)[0]
    fits = [fit(stated), fit(linear[:2])]
    best = min(fits, key=lambda one: one.cost)
    fits.append(fit(middle + 2 * along * ((best.x[:2] - middle) @ along) - (best.x[:2] - middle)))
    best = min(fits, key=lambda one: one.cost)
    rest = motion.robust_sd(off(best.x))
    known = float(np.linalg.eigvalsh(best.jac.T @ best.jac)[0])
    error = max(rest, BIAS) / np.sqrt(known) if known > 0 else np.inf
    twice = any(
        np.hypot(*(one.x[:2] - best.x[:2])) > MOVED and motion.robust_sd(off(one.x)) < rest / SHARPER for one in fits
    )
    return np.asarray(best.x[:2]), np.inf if twice else error, rest


def check_biases(c: CheckedLog) -> None:
    """Find ranges of a pair that are too long or too short by a constant."""
    unrelated = {one.table for one in c.findings if one.kind == "names"}
    for channel, readings in motion.range_channels(c.log):
        if motion.TABLES[channel] in unrelated:
            continue
        residual = readings.values[:, 0] - motion.distances(c.log, channel)
        found, most = {}, 0.0
        for i, k, rows in motion.pairs(readings, channel):
            bias, spread = motion.quantile(residual[rows], 0.5), motion.robust_sd(residual[rows])
            error = 1.2533 * spread / np.sqrt(len(rows))
            if np.isfinite(residual[rows]).sum() >= motion.FEWEST and abs(bias) > max(BIAS, 5 * error):
                found[f"{c.log.robots[i]}-{other_names(c.log, channel)[k]}"] = bias
                most = max(most, spread)
        if found:
            fact = "ranges minus distances, medians: " + ", ".join(f"{pair} {b:+.2f} m" for pair, b in found.items())
            key, typical, sure = BIAS_KEYS.get(channel), np.median(list(found.values())), "sure"
            setting = f"nothing: that of each pair is fitted; where nothing is, {key} = {typical:.2f} for all"
            setting = setting if key else "nothing: calibrate the camera"
            if most > VAGUE or min(found.values()) < -VAGUE:  # ranges are too long, if anything
                fact += f"; they spread by up to {most:.2g} m about that"
                setting = "nothing: that is more than a bias; look whether truths and places are in one frame"
                sure = "likely"
            c.add("bias", None, readings.source, fact, sure, setting, "model")


UNRELATED = 0.8  # times the spread of the distances, from which ranges do not follow them
VARIED = 0.3  # [m] spread of distances, from which ranges can follow them


def check_names(c: CheckedLog) -> None:
    """Find ranges that do not follow the distance of the two that they name, and of robots whose they follow."""
    for channel, readings in motion.range_channels(c.log):
        distance, pairs = motion.distances(c.log, channel), list(motion.pairs(readings, channel))
        spreads = [
            (motion.robust_sd(readings.values[rows, 0] - distance[rows]), motion.robust_sd(distance[rows]))
            for _, _, rows in pairs
            if np.isfinite(distance[rows]).sum() >= motion.FEWEST
        ]
        varied = [(off, spread) for off, spread in spreads if spread > VARIED]
        if 2 * sum(off > UNRELATED * spread for off, spread in varied) <= len(varied):
            continue
        off, spread = np.median(varied, axis=0)
        fact = f"ranges do not follow the distance of the two that they name: they are {off:.2g} m off, and distances"
        fact += f" change by {spread:.2g} m"
        setting = "nodes, or the places of anchors: whose name is whose; or are truths in two frames?"
        robots, truths = c.log.robots, [motion.known_truth(c.log, i) for i in range(len(c.log.robots))]
        known = {robots[i]: truth for i, truth in enumerate(truths) if truth is not None}
        if channel == "range" and len(known) == len(robots) > 2:
            values = readings.values[:, 0]
            ranges = [NodeRanges(robots[i], robots[k], readings.time[rows], values[rows]) for i, k, rows in pairs]
            found = assign(ranges, known)
            if found.residual < off / 2 and found.second > 2 * found.residual:
                other = [f"{node} is of {robot}" for robot, node in found.nodes.items() if node != robot]
                fact += f"; with other names they are {found.residual:.2g} m off"
                setting = f"nodes: what is read as {', '.join(other)}"
        c.add("names", None, readings.source, fact, "likely", setting, motion.TABLES[channel])


CAMERA_OFFSET = 0.05  # [rad] of a camera against straight ahead


def check_bearings(c: CheckedLog) -> None:
    """Find bearings in degrees, to the right, or from elsewhere than straight ahead."""
    place = ("sightings", ("bearing",))
    for channel, readings in motion.range_channels(c.log):
        if motion.TABLES[channel] != "sightings":
            continue
        expected = motion.bearings(c.log, channel)
        if np.isfinite(expected).sum() < motion.FEWEST:
            continue
        largest = np.nanmax(np.abs(readings.values[:, 1]))
        if largest > 2.1 * np.pi and motion.concentration(readings.values[:, 1] - expected)[0] < FOLLOWS:
            fact = f"bearings reach {largest:.4g} as read: they are in degrees"
            c.add("degrees", None, readings.source, fact, "sure", 'unit = "deg"', *place)
            readings = divide_columns(readings, 180 / np.pi, (1,))
            c.correct(channel, None, readings)
        bearing = readings.values[:, 1]
        off, opposes = bearing - expected, motion.concentration(bearing + expected)[0]
        follows, offset = motion.concentration(off)
        of_each = [motion.concentration(off[readings.robot == i]) for i in range(len(c.log.robots))]
        aside = {i: angle for i, (agrees, angle) in enumerate(of_each) if agrees > FOLLOWS}
        differ = len(aside) > 1 and np.ptp(np.unwrap([*aside.values()])) > CAMERA_OFFSET
        ahead = motion.concentration(off - np.array([angle for _, angle in of_each])[readings.robot])[0]
        if opposes > FOLLOWS and np.log(opposes) > SHARPER**2 * np.log(max(ahead, follows, 1e-9)):  # -2 log R: spread^2
            fact = f"bearings grow to the right (agreement {opposes:.2f}, {follows:.2f} to the left)"
            c.add("bearing", None, readings.source, fact, "sure", 'unit = "-rad" (or "-deg")', *place)
            c.correct(channel, None, divide_columns(readings, -1.0, (1,)))
        elif follows < FOLLOWS < (agrees := motion.concentration(bearing - motion.bearings(c.log, channel, True))[0]):
            fact = f"bearings are from the x axis of the map, not from straight ahead (agreement {agrees:.2f})"
            c.add("bearing", None, readings.source, fact, "sure", "nothing: subtract the heading in the files", *place)
        elif differ:
            apart = {c.log.robots[i]: angle for i, angle in aside.items() if abs(angle) > CAMERA_OFFSET / 3}
            each = ", ".join(f"{robot} {np.degrees(angle):+.0f} deg" for robot, angle in apart.items())
            offsets = ", ".join(f"{robot} = {-angle:.3g}" for robot, angle in apart.items())
            fact, setting = f"bearings are off the true directions: {each}", f"bearing_offset = {{ {offsets} }}"
            c.add("bearing", None, readings.source, fact, "likely", setting, "sightings")
        elif follows > FOLLOWS and abs(offset) > CAMERA_OFFSET:
            degrees = np.degrees(offset)
            fact = f"bearings are {degrees:+.0f} deg from the true directions (agreement {follows:.2f})"
            setting = f"bearing_offset = {-offset:.3g}"
            c.add("bearing", None, readings.source, fact, "likely", setting, "sightings")
