"""Checks of a recording: gaps, units, clocks, impossible positions and frames.

Units come first, as they need neither clocks nor frames: the speed of a robot is a number that no shift of a clock,
turn or mirroring of a frame changes. Then clocks; then frames and headings. A finding is reported, never applied: it
comes from the truth, which would otherwise reach the estimators that are judged by that same truth.

`truth_checks` has the faults of the truth alone, `odometry_checks` and `reading_checks` those of odometry and readings.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import scipy

from cooploc.estimators.errors import count_of
from cooploc.estimators.interface import Array
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings.inspect import motion
from cooploc.scenarios.recordings.inspect.findings import (
    EVIDENCE,
    FOLLOWS,
    LEAST_DELAY,
    LENGTH_UNITS,
    LONGEST_DELAY,
    CheckedLog,
    divide_columns,
    unit_of_ratio,
)
from cooploc.scenarios.recordings.inspect.odometry_checks import (
    SMOOTH,
    check_dropouts,
    check_odometry_jumps,
    check_sideways,
    check_standstill,
    check_turn_bias,
)
from cooploc.scenarios.recordings.inspect.reading_checks import (
    SHARPER,
    check_bearings,
    check_biases,
    check_delays,
    check_height,
    check_names,
    check_places,
    check_range_units,
)
from cooploc.scenarios.recordings.inspect.rssi_checks import check_rssi
from cooploc.scenarios.recordings.inspect.truth_checks import (
    FASTEST,
    STALE_TIME,
    check_copies,
    check_held_heading,
    check_jumps,
    check_own_frames,
    check_precision,
    check_stale,
)
from cooploc.scenarios.recordings.team_log import Channel, ReadingSeries, TeamLog

TO_NAME = {  # in a sentence on what was left out -> what to write, and the table
    "nor an anchor": ("places = { NAME = [X, Y], ... }, of an anchor", "anchors"),
    "nor a landmark": ("places = { NAME = [X, Y], ... }, of a landmark", "landmarks"),
    "no robot of the team": ('nodes = { THEIRS = "NAME", ... } in that table, if they are robots', ""),
}


def check_recording(log: TeamLog) -> CheckedLog:
    """Find everything odd about a recording, in an order in which no fault hides the next."""
    c = CheckedLog(log)
    for warning in dict.fromkeys(log.warnings):  # such as a last line that was cut off
        setting = next(
            (setting for words, setting in TO_NAME.items() if words in warning), ("nothing: it is left out", "")
        )
        c.add("dropped", None, "", warning, "sure", *setting)

    def check_robots(*checks: Callable[[CheckedLog, int], None]) -> None:
        for check in checks:
            for i in range(len(log.robots)):
                check(c, i)

    check_gaps(c)
    check_copies(c)
    check_robots(
        check_held_heading,
        check_odometry_jumps,
        check_lengths,
        check_heading_unit,
        check_turn_unit,
        check_standstill,
        check_clock_of_turns,
    )
    check_clocks(c)
    check_clocks_of_readings(c)
    check_robots(check_stale, check_jumps, check_precision)
    check_own_frames(c)
    check_range_units(c)
    of_frame = check_compass_frame if log.odometry_kind == "displacement" else check_frame
    check_robots(of_frame, check_sideways, check_turn_bias, check_dropouts)
    c.join_offsets("heading_offset", "turn_bias")
    check_delays(c)
    check_height(c)
    check_places(c)
    check_names(c)
    check_biases(c)
    check_bearings(c)
    check_rssi(c)
    return c


# --- Gaps

GAP = 10.0  # median intervals without a sample are a gap, if it is longer than a second
ENDS = 0.1  # share of the recording that a series may lack at an end


def check_gaps(c: CheckedLog) -> None:
    """Find gaps of odometry and truth, and series that lack a tenth of the recording at an end."""
    series = [("odometry", i, s) for i, s in enumerate(c.log.odometry)]
    series += [("truth", i, s) for i, s in enumerate(c.log.truth) if s is not None]
    stamps = [s.time[[0, -1]] for _, _, s in series if len(s.time) > 1]
    start, end = np.median(stamps, axis=0) if stamps else (0.0, 0.0)
    for table, i, s in series:
        this = "the truth" if table == "truth" else table
        if end > start and len(s.time):
            late, early, span = s.time[0] - start, end - s.time[-1], end - start
            if max(ENDS * span, 1.0) <= max(late, early) <= span:
                words = f"begins {late:.3g} s late" if late > early else f"ends {early:.3g} s early"
                setting = "nothing: what is missing is not known"
                c.add("span", i, s.source, f"{this} {words} in {span:.3g} s", "sure", setting, table)
        intervals = np.diff(s.time)
        usual = float(np.median(intervals)) if len(s.time) >= 10 else np.inf
        if count := int((intervals > max(GAP * usual, 1.0)).sum()):
            gaps = f"{this} has {count_of(count, 'gap')}, the longest"
            fact = f"{gaps} {intervals.max():.3g} s; the usual interval is {usual:.3g} s"
            holds = table == "odometry" and c.log.odometry_kind in ("velocity", "path")
            setting = "nothing: max_gap in [sample] is the longest gap that is bridged"
            setting = "nothing: max_hold in [sample] is how long a speed holds" if holds else setting
            c.add("gap", i, s.source, fact, "sure", setting, table)


# --- Units

SLOWEST = 0.005  # [m/s] of a robot that drives for a quarter of the time
SCALE = 1.5  # times as fast as the truth: no calibration is so far off
DEGREE = np.pi / 180
ANGLE_UNITS = (("degrees", "deg", 1 / DEGREE), ("radians", "rad", DEGREE))
CM_FOR_MM = ("unit", "cm", 0.1)
INDOORS = 2.0  # [m/s] of robots
WINDING = 5.0  # [s] in which robots drive curves
POSITIONS = ((0, 1), ("x", "y"))
LENGTHS = {"velocity": ((0,), ("speed",)), "path": ((0,), ("length",)), "displacement": ((0, 1), ("dx", "dy"))}


def check_lengths(c: CheckedLog, i: int) -> None:
    """Find lengths of truth or odometry in mm or cm: the third quartile of their speeds differs by 1000 or 100.

    Of the truth also those in cm that were taken for mm, by how far they span.
    """
    m, odometry = motion.robot_motion(c.log, i), c.log.odometry[i]

    def speeds(window: float) -> tuple[float, float]:
        of_window = m._replace(window=window)
        odometry, truth = (motion.quantile(np.abs(of_window.steps(of).length), 0.75, 8) for of in (m.odometry, m.truth))
        return odometry / window, truth / window

    driven, moved = speeds(m.window)
    names_of_odometry = LENGTHS.get(c.log.odometry_kind, POSITIONS)
    sides = (
        ("truth", "the truth is", moved, "odometry", driven, m.poses, POSITIONS),
        ("odometry", "odometry is", driven, "the truth", moved, odometry, names_of_odometry),
    )
    for table, this, speed, that, other, series, (columns, names) in sides:
        known = (*LENGTH_UNITS[:2], *[CM_FOR_MM] * (table == "truth" and driven < INDOORS))
        ratio = speed / other if other > 0 else np.nan
        if unit := unit_of_ratio(ratio, known, 1.25):  # odometry is calibrated to better than 25 %
            fact = f"{this} {ratio:.3g} times as fast as {that} ({speed:.3g} against {other:.3g} m/s)"
            sure = "sure" if 0.01 < other < FASTEST and not 0.01 < speed < INDOORS else "likely"
            c.add("unit", i, series.source, fact, sure, f'unit = "{unit[1]}"', table, names)
            c.correct(table, i, divide_columns(series, unit[2], columns))
            return
    drives = motion.moves(c.log, i) and driven > 0 and max(driven, moved) > SLOWEST
    if drives and moved > SCALE * driven:  # noise of the truth makes short steps longer
        driven, moved = speeds(max(m.window, SMOOTH))
    drives &= moved > driven or m.window < WINDING  # between places that are far apart in time, a way is longer
    if drives and not 1 / SCALE < driven / moved < SCALE:
        fact = f"odometry is {driven / moved:.3g} times as fast as the truth ({driven:.3g} against {moved:.3g} m/s)"
        setting, table = "the unit of speed or of stamps; length_scale is fitted in any case", "model"
        interval = float(np.median(np.diff(odometry.time)))
        if c.log.odometry_kind == "velocity" and abs(driven / moved / interval - 1) < 0.1:
            fact += f", as its lines are {interval:.3g} s apart: each is a step since the one before"
            setting, table = 'kind = "increment", with dx and turn in place of speed and turn_rate', "odometry"
            c.correct("odometry", i, odometry._replace(values=odometry.values / interval))
        c.add("scale", i, odometry.source, fact, "likely", setting, table)


def check_heading_unit(c: CheckedLog, i: int) -> None:
    """Find headings of the truth in degrees or radians, compared with the direction of its own moves."""
    m = motion.robot_motion(c.log, i)
    t, heading = m.poses.time, m.poses.values[:, 2]
    edges = np.arange(t[0], t[-1], m.window) if len(t) else t
    if np.isfinite(heading).sum() < 10 or len(edges) < 3:
        return
    direction = motion.course(m.steps(m.truth, edges).move)
    there = heading[np.clip(np.searchsorted(t, edges[:-1] + m.window / 2), 0, len(t) - 1)]
    largest = float(np.nanmax(np.abs(heading)))

    as_read, in_degrees, in_radians = (
        max(motion.concentration(factor * there - direction)[0], motion.concentration(factor * there + direction)[0])
        for factor in (1.0, DEGREE, 1 / DEGREE)
    )
    needed = max(0.6, as_read + 0.3)
    if largest > 2.1 * np.pi and in_degrees > needed:
        kind, unit, factor = ANGLE_UNITS[0]
    elif motion.concentration(direction)[0] < 0.8 and in_radians > needed:
        kind, unit, factor = ANGLE_UNITS[1]
    else:
        return
    fact = f"headings reach {largest:.4g} as read; with the unit {unit} they follow the direction of motion"
    c.add(kind, i, m.poses.source, fact, "sure", f'unit = "{unit}"', "truth", ("heading",))
    c.correct("truth", i, divide_columns(m.poses, factor, (2,)))


def check_turn_unit(c: CheckedLog, i: int) -> None:
    """Find odometry that turns about 57 times as fast as the truth, or 1/57."""
    if c.log.odometry_kind == "displacement":
        return
    m, odometry = motion.robot_motion(c.log, i), c.log.odometry[i]
    measured = motion.quantile(np.abs(m.steps(m.odometry).turn), 0.75, 8)
    true = motion.quantile(np.abs(motion.true_turns(m.steps(m.truth))), 0.75, 8)
    column, name, per = (2, "heading", "") if c.log.odometry_kind == "pose" else (1, "turn_rate", "/s")
    ratio = measured / true if true > 0.01 * m.window else np.nan
    if found := unit_of_ratio(ratio, ANGLE_UNITS, 2.5):
        kind, unit, factor = found
        fact = f"odometry turns {ratio:.3g} times as fast as the truth, which is about {factor:.3g}"
        c.add(kind, i, odometry.source, fact, "sure", f'unit = "{unit}{per}"', "odometry", (name,))
        c.correct("odometry", i, divide_columns(odometry, factor, (column,)))


# --- Clocks
# In windows as long as two intervals, the lengths and turns of odometry are correlated with those of the truth, for
# shifts up to a minute or a third of the recording. A robot's odometry must fit its own truth best.

LONGEST_SHIFT = 60.0  # [s]
FITS = 0.5  # correlation from which odometry fits a truth
SAME_CLOCK = 0.2  # [s] shifts of robots that differ by more are of their own clocks
OWN = 0.8  # correlation from which a truth is the robot's own, without comparing it with the others'


class ClockFit(NamedTuple):
    """The best agreement of odometry with a truth."""

    shift: float = 0.0  # by which the truth's stamps are later than odometry's [s]
    correlation: float = 0.0  # at that shift
    unshifted: float = 0.0  # correlation at no shift
    evidence: float = 0.0  # standard errors between both (Fisher's z)


def check_clocks(c: CheckedLog) -> None:
    """Find truths that belong to other robots than their names say, and truths whose stamps are shifted.

    With no time in common, odometry and truth are taken to begin together.
    """
    robots, truths = c.log.robots, c.log.truth
    motions = [motion.robot_motion(c.log, i) for i in range(len(robots))]
    own = {i: _best_fit(m, m.truth) for i, m in enumerate(motions) if motion.moves(c.log, i)}
    for i, (j, correlation) in _find_exchanged(motions, own).items():
        fact = f"odometry of {robots[i]} fits the truth of {robots[j]} (correlation {correlation:.2f}), not its own"
        fact += f" ({own[i].correlation:.2f})"
        setting = f"nothing: exchange the truths of {robots[i]} and {robots[j]}"
        c.add("robots", i, motions[j].poses.source, fact, "sure", setting, "truth")
        if (other := truths[j]) is not None:
            c.correct("truth", i, other)
            own[i] = _best_fit(motions[i], motions[j].truth)
    shifts = dict[int, tuple[float, str, str]]()  # robot -> shift [s], what shows it, how sure that is
    for i in range(len(robots)):
        m = motion.robot_motion(c.log, i)
        t, wheels, apart, fit = m.truth.time, m.odometry.time, 0.0, own.get(i)
        if len(t) and len(wheels) and min(t[-1], wheels[-1]) <= max(t[0], wheels[0]):
            apart = float(t[0] - wheels[0])
            fit = _best_fit(m, m.truth._replace(time=t - apart))
        if fit is None or not len(t):
            continue
        shifts[i] = 0.0, "", ""
        if not apart:
            interval = max(float(np.median(np.diff(stamps))) for stamps in (wheels, t))
            least = max(0.05, 1.5 * interval)
            moving = motion.without_repeats(m.truth, STALE_TIME)
            if _shows_shift(fit, least) and len(moving.time) < len(t):
                fit = _best_fit(m, moving)  # a truth that was frozen for a while fits best where that is left out
            if not _shows_shift(fit, least):
                continue
        shown = f"(correlation {fit.correlation:.2f}"
        shown += " once both begin together)" if apart else f"; {fit.unshifted:.2f} without the shift)"
        shifts[i] = apart + fit.shift, shown, "sure" if fit.correlation > 0.7 else "likely"
    _report_shifts(c, shifts)


def _report_shifts(c: CheckedLog, shifts: Mapping[int, tuple[float, str, str]]) -> None:
    """Report shifts of robots' truths against their odometry: of the truth's clock, of odometry's, or of the robots'.

    It is odometry's, as of commands that a robot follows later, if readings fit the truth much better as it is; and the
    robots' own if they do with the shifts of these.
    """
    log, by_robot = c.log, {i: shift for i, (shift, _, _) in shifts.items() if shift}
    differ = len(by_robot) < len(shifts) or np.ptp([*by_robot.values()] or [0.0]) > SAME_CLOCK
    truths = tuple(s and s._replace(time=s.time - by_robot.get(i, 0.0)) for i, s in enumerate(log.truth))
    later = {channel: _on_own_clocks(r, by_robot) for channel, r in log.readings.items()}
    of_truth, of_odometry, of_robots = (
        _spreads(one) for one in (log._replace(truth=truths), log, log._replace(readings=later if differ else {}))
    )
    robots_fit, wheels_fit = _sharpest(of_robots, of_truth), _sharpest(of_odometry, of_truth)
    own = robots_fit < min(wheels_fit, SHARPER)
    of_wheels = not own and wheels_fit < SHARPER
    digits = ".4g" if max(map(abs, by_robot.values()), default=0.0) < 1000 else ".12g"
    sign = 1 if own or of_wheels else -1
    common = float(np.median([*by_robot.values()])) if by_robot else 0.0
    offsets = ", ".join(f"{log.robots[i]} = {sign * shift:{digits}}" for i, shift in by_robot.items())
    tables = ", ".join(dict.fromkeys(f"[{motion.TABLES.get(channel, 'rssi')}]" for channel in log.readings))
    for i, (shift, shown, sure) in ((i, one) for i, one in shifts.items() if i in by_robot):
        fact = f"the truth's stamps are {shift:+.4g} s from odometry's {shown}"
        setting = f"clock_offset = {{ {offsets} }}" if differ else f"clock_offset = {sign * common:{digits}}"
        odometry, truth = log.odometry[i], truths[i]
        if own or of_wheels:
            setting += f", also in {tables}" * own
            fact += ", and readings agree with the truth" * of_wheels
            c.add("clock", i, odometry.source, fact, sure, setting, "odometry")
            c.correct("odometry", i, odometry._replace(time=odometry.time + shift))
        elif truth is not None:
            c.add("clock", i, truth.source, fact, sure, setting, "truth")
            c.correct("truth", i, truth)
    for channel in later if own else ():
        c.correct(channel, None, later[channel])


def _spreads(log: TeamLog) -> dict[tuple[Channel, int], float]:
    """Return how ranges, and bearings of sightings, spread about the truth, by channel and column."""
    columns = {channel: (0, 1)[: r.values.shape[1]] for channel, r in motion.range_channels(log)}
    return {(c, k): motion.spread_of_readings(log, c, 0.0, k) for c, several in columns.items() for k in several}


def _sharpest(spreads: Mapping[tuple[Channel, int], float], others: Mapping[tuple[Channel, int], float]) -> float:
    """Return the smallest ratio of spreads to others, 1 if one is much larger or there is none."""
    ratios = [spread / others[key] for key, spread in spreads.items() if 0 < others[key] < np.inf]
    return min(ratios, default=1.0) if max(ratios, default=np.inf) < 1 / SHARPER else 1.0


def _on_own_clocks(readings: ReadingSeries, shifts: Mapping[int, float]) -> ReadingSeries:
    """Return readings with the shift of the robot that took them added to their stamps."""
    of_each = np.array([shifts.get(i, 0.0) for i in range(1 + int(np.max(readings.robot, initial=0)))])
    time, robot, other, values, source = readings._replace(time=readings.time + of_each[readings.robot])
    order = np.argsort(time, kind="stable")
    return ReadingSeries(time[order], robot[order], other[order], values[order], source)


def check_clock_of_turns(c: CheckedLog, i: int) -> None:
    """Find turn rates of a file of their own whose stamps are shifted against the speeds'."""
    odometry, m = c.log.odometry[i], motion.robot_motion(c.log, i)
    a, b = m.odometry.time, m.truth.time
    if ", " not in odometry.source or not motion.moves(c.log, i) or len(a) < motion.FEWEST_WINDOWS:
        return
    edges = np.arange(max(a[0], b[0]), min(a[-1], b[-1]), m.window)
    true, shifts = m.steps(m.truth, edges), np.linspace(-LONGEST_DELAY, LONGEST_DELAY, 101)
    measured = [m.steps(m.odometry, edges + shift) for shift in shifts]
    turns = np.array([motion.correlation(steps.turn, motion.true_turns(true)) for steps in measured])
    lengths = np.array([motion.correlation(steps.length, true.length) for steps in measured])
    best, now = int(np.argmax(turns)), len(shifts) // 2
    gain, loss = (np.arctanh(of[best]) - np.arctanh(of[now]) for of in np.clip([turns, lengths], -0.9999, 0.9999))
    evidence, late = np.sqrt(max(len(edges) - 3, 1) / 2), shifts[best]
    if abs(late) >= LEAST_DELAY and turns[best] >= FITS and gain * evidence > EVIDENCE and -loss * evidence > 2:
        fact = f"the turn rates' stamps are {late:+.3g} s from the speeds': turns fit the truth's with a correlation of"
        fact += f" {turns[best]:.2f} then, {turns[now]:.2f} without the shift"
        c.add("clock", i, odometry.source, fact, "likely", f"clock_offset = {-late:.3g}", "turns")
        rows = np.searchsorted(a, a + late).clip(0, len(a) - 1)
        values = np.stack([odometry.values[:, 0], odometry.values[rows, 1]], -1)
        c.correct("odometry", i, odometry._replace(values=values))


def _shows_shift(fit: ClockFit, least: float) -> bool:
    return fit.correlation >= FITS and fit.evidence > EVIDENCE and abs(fit.shift) >= least


def check_clocks_of_readings(c: CheckedLog) -> None:
    """Find readings that share no time with odometry: both are taken to begin together."""
    stamps = [series.time[[0, -1]] for series in c.log.odometry if len(series.time)]
    for channel, readings in c.log.readings.items() if stamps else ():
        begin, end = min(first for first, _ in stamps), max(last for _, last in stamps)
        first, last = readings.time[[0, -1]]
        if first > end or last < begin:
            table = motion.TABLES.get(channel, "rssi")
            both = f"readings from {first:.10g} to {last:.10g} s, odometry from {begin:.10g} to {end:.10g} s"
            if ("clock", table) not in {(one.kind, one.table) for one in c.findings}:
                offset = f"clock_offset = {begin - first:.12g}"
                c.add("clock", None, readings.source, f"{both}: no common time", "sure", offset, table)
            c.correct(channel, None, readings._replace(time=readings.time + (begin - first)))


def _find_exchanged(motions: list[motion.RobotMotion], own: Mapping[int, ClockFit]) -> dict[int, tuple[int, float]]:
    """Return robots whose odometry fits another one's truth, not their own -> that other, and the correlation."""
    if sum(fit.correlation < OWN for fit in own.values()) < 2:
        return {}
    fits = np.array([[_best_fit(motions[i], motions[j].truth).correlation for j in own] for i in own])
    robots, best = list(own), zip(*scipy.optimize.linear_sum_assignment(-fits), strict=True)
    found = [(r, k) for r, k in best if r != k and fits[r, k] > max(FITS, fits[r, r] + 0.2)]
    better = {robots[r]: (robots[k], fits[r, k]) for r, k in found}
    return better if set(better) == {j for j, _ in better.values()} else {}


def _best_fit(m: motion.RobotMotion, truth: motion.SummedMotion) -> ClockFit:
    """Return the shift at which a robot's odometry fits a truth best.

    Of the peaks of correlation that are as likely as the highest, it is the one of least shift, since a robot in laps
    fits at every lap. -n/2 ln(1 - R^2) is the log-likelihood of n samples; as likely are those within EVIDENCE^2 / 2.
    """
    t, window = m.odometry.time, m.window
    if len(t) < motion.FEWEST_WINDOWS or not len(truth.time):
        return ClockFit()
    edges = np.arange(t[0], t[-1], window)
    measured = motion.drop_jumps(m.steps(m.odometry, edges))

    def correlations(shifts: Array) -> Array:
        return np.array(
            [motion.agreement(measured, motion.drop_jumps(m.steps(truth, edges + shift))) for shift in shifts]
        )

    longest = min(LONGEST_SHIFT, min(t[-1] - t[0], truth.time[-1] - truth.time[0]) / 3)
    count = int(2 * longest / window)
    coarse = np.linspace(-count * window / 2, count * window / 2, 2 * count + 1)
    windows = t[0] + window * np.arange(len(edges) + count)  # shifts are half windows: all steps are in one of two rows
    rows = [motion.drop_jumps(m.steps(truth, windows + coarse[k])) for k in range(min(2, len(coarse)))]
    moved = [motion.Steps(*(part[k // 2 :][: len(edges) - 1] for part in rows[k % 2])) for k in range(len(coarse))]
    rough = np.array([motion.agreement(measured, steps) for steps in moved])
    likelihood = -len(edges) / 4 * np.log1p(-(np.minimum(rough, 0.9999) ** 2))
    around = np.pad(rough, 1, constant_values=-1.0)
    peaks = (rough >= around[:-2]) & (rough >= around[2:])
    good = np.flatnonzero(peaks & (likelihood >= likelihood.max() - EVIDENCE**2 / 2))
    at = coarse[good[np.argmin(np.abs(coarse[good]))]]
    fine = np.linspace(at - 0.6 * window, at + 0.6 * window, 25)
    sharp = correlations(fine)
    best, unshifted = int(np.argmax(sharp)), float(correlations(np.zeros(1))[0])
    with_it, without = np.arctanh(np.clip([sharp[best], unshifted], -0.999, 0.999))
    evidence = (with_it - without) * np.sqrt(max(int(np.isfinite(measured.length).sum()) - 3, 1) / 2)
    return ClockFit(float(fine[best]), float(sharp[best]), unshifted, float(evidence))


# --- Frames
# Three sources tell a robot's turns: the direction of its true moves (its course), its true heading, and its odometry.
# A mirror (x and y exchanged is one) reverses the first; a heading counted clockwise the second; a turn rate of the
# other sign the third. Two against one decide. With only two, ranges to things elsewhere decide, or both are named.

OFFSET = 0.1  # [rad] of a heading against the direction of motion; a slip or an arc is less
SIGN = 6.0  # standard errors of a slope below zero from which a sign is wrong
STRAIGHT = 1e-3  # [1/m] spread of curvatures, up to which a lever does not show
BACK = "nothing: turn the positions back in the files"
MIRRORS = {  # by eighths of a turn
    0: ("mirrored", "y is downwards", 'frame = "mirrored"'),
    2: ("axes", "x and y are exchanged", 'frame = "swapped"'),
    -2: ("axes", "x and y are exchanged, and one is reversed", BACK),
    4: ("mirrored", "x is to the left", BACK),
    -4: ("mirrored", "x is to the left", BACK),
}


def check_frame(c: CheckedLog, i: int) -> None:
    """Find frames, headings and turn rates of the wrong sign, of a robot whose odometry turns."""
    if not motion.moves(c.log, i):
        return
    m = motion.robot_motion(c.log, i)
    poses, span = m.poses.values, float(m.truth.time[-1] - m.truth.time[0])
    window = max(2 * float(np.median(np.diff(m.truth.time))), 0.2, span / motion.MOST_WINDOWS)
    own = np.arange(m.truth.time[0], m.truth.time[-1], window)
    direction, driven = motion.course(m.steps(m.truth, own).move), m.steps(m.odometry, own).length
    direction = np.where(driven < 0, wrap(direction + np.pi), direction)  # it drives backwards
    heading = wrap(np.interp(own[:-1] + window / 2, m.truth.time, m.truth.turn))
    follows, offset = motion.concentration(heading - direction)
    opposes, mirror = motion.concentration(heading + direction)
    straight = offset + _less_lever(wrap(heading - direction - offset), m.steps(m.truth, own))
    offset = min(offset, straight, key=abs)  # who drives one circle says little of straight lines
    measured, true = m.common_steps()
    smoothed = np.convolve(measured.turn, np.full(3, 1 / 3), "same") if len(measured.turn) > 3 else measured.turn
    of_heading, of_course = (
        motion.robust_slope(true.turn, measured.turn),
        motion.robust_slope(motion.course_turns(true.move), smoothed),
    )
    headed = bool(np.isfinite(of_heading[0]))
    slope, error = of_heading if headed else of_course
    reversed_turns = slope < -0.3 and slope < -SIGN * error

    def report_heading(fact: str, sure: str, setting: str, offset: float, correct: Array) -> None:
        setting += f"heading_offset = {{ {c.log.robots[i]} = {offset:.3g} }}"
        c.add("heading", i, m.poses.source, fact, sure, setting, "truth")
        c.correct("truth", i, m.poses._replace(values=np.column_stack([poses[:, :2], wrap(correct)])))

    if opposes > FOLLOWS and opposes > follows + 0.2:
        if headed and reversed_turns:  # odometry turns against the heading, and with the course
            start = "from y, as a compass does" if abs(mirror - np.pi / 2) < OFFSET else "from x"
            fact = f"the heading falls when the robot turns left (agreement {opposes:.2f}): it is clockwise {start}"
            report_heading(fact, "sure", 'heading with unit = "-rad" (or "-deg"), ', mirror, mirror - poses[:, 2])
        else:
            fact = f"the positions turn left where the heading turns right (agreement {opposes:.2f})"
            _add_mirror(c, i, mirror, fact, "sure" if headed else "likely")
        return
    if follows > FOLLOWS and abs(offset) > OFFSET:
        degrees = np.degrees(offset)
        fact = f"the heading is {degrees:+.0f} deg from the direction of motion (agreement {follows:.2f})"
        report_heading(fact, "likely", "", -offset, poses[:, 2] - offset)
    if reversed_turns:
        fact = f"odometry turns right where the truth turns left (slope {slope:.2f})"
        fact += "" if headed else "; or the truth is mirrored (its heading was not recorded)"
        poses_too = c.log.odometry_kind == "pose"
        columns, names = ((1, 2), ("y", "heading")) if poses_too else ((1,), ("turn_rate",))
        setting = 'unit = "-m" and "-rad"' if poses_too else 'unit = "-rad/s" (or "-deg/s")'
        sure = "sure" if headed and follows > FOLLOWS else "likely"
        c.add("turn sign", i, c.log.odometry[i].source, fact, sure, setting, "odometry", names)
        c.correct("odometry", i, divide_columns(c.log.odometry[i], -1.0, columns))


def _less_lever(off: Array, true: motion.Steps) -> float:
    """Return how far headings are off directions of motion [rad] on a straight line: in curves a lever adds to that."""
    curvature = true.turn / np.maximum(np.hypot(*true.move.T), 1e-9)
    known = np.isfinite(off) & np.isfinite(curvature)
    known &= np.abs(off) < 5 * max(motion.robust_sd(off), 1e-9)
    if known.sum() < motion.FEWEST_WINDOWS or np.std(curvature[known]) < STRAIGHT:
        return 0.0
    return float(np.polynomial.polynomial.polyfit(curvature[known], off[known], 1)[0])


def check_compass_frame(c: CheckedLog, i: int) -> None:
    """Find the turn or reflection that takes displacements to the true moves (orthogonal Procrustes)."""
    measured, true = (steps.move for steps in motion.robot_motion(c.log, i).common_steps())
    if not motion.moves(c.log, i) or (np.isfinite(measured) & np.isfinite(true)).all(axis=1).sum() < 20:
        return
    follows, offset = motion.concentration(wrap(motion.course(true) - motion.course(measured)))
    opposes, mirror = motion.concentration(wrap(motion.course(true) + motion.course(measured)))
    if 0 < max(follows, opposes) < FOLLOWS / 2:  # 0: of too few
        fact = f"the positions move elsewhere than dx, dy (agreement {follows:.2f}), which are perhaps ahead and left"
        setting = 'with a column of turns kind = "increment", turn = "..."'
        c.add("frame", i, c.log.odometry[i].source, fact, "sure", setting, "odometry", ("dx", "dy"))
    elif opposes > FOLLOWS and opposes > follows + 0.2:
        fact = f"the positions move as the mirror image of odometry (agreement {opposes:.2f})"
        _add_mirror(c, i, mirror, fact, "likely")
    elif follows > FOLLOWS and abs(offset) > OFFSET:
        degrees = np.degrees(offset)
        fact = f"the positions move {degrees:+.0f} deg from where odometry says (agreement {follows:.2f})"
        setting = f"nothing: turn dx, dy by {degrees:.0f} deg in the files"
        c.add("frame", i, c.log.odometry[i].source, fact, "likely", setting, "odometry", ("dx", "dy"))


def _add_mirror(c: CheckedLog, i: int, mirror: float, fact: str, sure: str) -> None:
    """Report positions mirrored in a line at half of `mirror` [rad], and reflect them."""
    line = f"in a line at {np.degrees(mirror) / 2:.0f} deg"
    kind, words, setting = MIRRORS.get(int(np.rint(mirror / (np.pi / 4))), ("mirrored", line, BACK))
    truth = motion.robot_motion(c.log, i).poses
    cosine, sine = np.cos(mirror), np.sin(mirror)
    values = truth.values.copy()
    values[:, :2] = values[:, :2] @ np.array([[cosine, sine], [sine, -cosine]])
    c.correct("truth", i, truth._replace(values=values))
    c.add(kind, i, truth.source, f"{fact}: {words}", sure, setting, "truth")
