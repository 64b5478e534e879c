"""Checks of the truth by itself: copies, frames of each robot's own, held headings, noise, positions that cannot be.

What it says of the truth holds whatever the odometry is, which only tells whether the robot drove and turned.
"""

import itertools

import numpy as np

from cooploc.estimators.errors import count_of
from cooploc.estimators.interface import Mask
from cooploc.scenarios.recordings import sampling
from cooploc.scenarios.recordings.inspect import motion
from cooploc.scenarios.recordings.inspect.findings import CheckedLog
from cooploc.scenarios.recordings.team_log import Series

FASTEST = 15.0  # [m/s] of ground robots; faster is a unit or a fault
NOTHING = "nothing: errors are known no better than that"


ALIKE = 0.8  # correlation with its own truth, from which odometry is a robot's own


def check_copies(c: CheckedLog) -> None:
    """Find two robots whose truth or odometry is the same in every line; the worse fit is not looked at further.

    Robots that were told to drive alike have the same odometry, and both fit.
    """
    fits = [motion.agreement(*motion.robot_motion(c.log, i).common_steps()) for i in range(len(c.log.robots))]
    for table, every in (("truth", c.log.truth), ("odometry", c.log.odometry)):
        for i, j in itertools.combinations(range(len(every)), 2):
            one, other = every[i], every[j]
            if one is None or other is None or not np.array_equal(one.values, other.values) or np.ptp(one.values) == 0:
                continue
            copy = i if fits[i] < fits[j] else j
            if table == "odometry" and fits[copy] > ALIKE:
                continue
            fact = f"the {table} of {c.log.robots[i]} and {c.log.robots[j]} is the same in every line"
            source = (one if copy == i else other).source
            c.add("robots", copy, source, fact, "sure", "nothing: get the file of each robot", table)
            c.correct("truth", copy, None)


NEAR = 0.05  # [m] robots do not come so near


def check_own_frames(c: CheckedLog) -> None:
    """Find truths that begin at one place, as each robot's own frame does."""
    known = [t for i in range(len(c.log.robots)) if motion.moves(c.log, i) and (t := motion.known_truth(c.log, i))]
    if len(known) < 2:
        return
    begin = np.array([max(series.time[0] for series in known)])
    places = np.concatenate([sampling.poses(series, begin, np.inf, headings=False)[:, :2] for series in known])
    if np.ptp(places, axis=0).max() < NEAR:
        x, y = places[0] + 0.0
        fact = f"the truths of all robots begin at {x:.2g}, {y:.2g}: each is in a frame of its own, perhaps"
        setting = "nothing: bring them into one frame in the files, by where each robot started"
        c.add("frame", None, known[0].source, fact, "sure", setting, "truth", ("x", "y"))


def check_held_heading(c: CheckedLog, i: int) -> None:
    """Find a true heading that never changes, of a robot that turns."""
    m = motion.robot_motion(c.log, i)
    heading = m.poses.values[:, 2]
    if not np.isfinite(heading).any() or np.nanmax(heading) > np.nanmin(heading):
        return
    turned = np.nancumsum(motion.course_turns(m.steps(m.truth).move))
    odometry = m.odometry.turn[np.isfinite(m.odometry.turn)]
    if max(np.ptp(odometry) if len(odometry) else 0.0, np.ptp(turned) if len(turned) else 0.0) > np.pi:
        fact = f"the heading is {np.nanmin(heading):g} in every line, and the robot turns: it was not measured"
        setting = 'leave heading out, and write heading = "first motion" in [prior]'
        c.add("heading", i, m.poses.source, fact, "sure", setting, "truth", ("heading",))
        c.correct("truth", i, m.poses._replace(values=m.poses.values * [1.0, 1.0, np.nan]))


# --- How well positions are known

COARSE = 0.05  # [m] steps, noise, or half of a bend between two lines, from which that is worth a word
SHORT = 0.25  # [s] between lines, in which the speed of a robot hardly changes


def resolution(truth: Series) -> float:
    """Return the steps of positions [m], if they are rounded to more than 5 cm; else 0."""
    for column in truth.values[:, :2].T:
        steps = np.diff(np.unique(column))
        step = float(steps.min()) if len(steps) > 5 else 0.0
        if COARSE < step < np.ptp(column) / 10 and np.abs(steps / step - np.rint(steps / step)).max() < 0.01:
            return step
    return 0.0


def check_precision(c: CheckedLog, i: int) -> None:
    """Find positions that are rounded, noisy, or too far apart for a line between them."""
    m = motion.robot_motion(c.log, i)
    t, places = m.truth.time, m.truth.place
    if len(t) < motion.FEWEST_POSITIONS:
        return
    interval = float(np.median(np.diff(t)))
    bends = places[2:] - 2 * places[1:-1] + places[:-2]
    noise = motion.robust_sd(bends) / 6**0.5 if interval < SHORT else 0.0
    far = motion.quantile(np.hypot(*np.diff(places, axis=0).T), 0.9)
    often = len(m.odometry.time) > 1 and float(np.median(np.diff(m.odometry.time))) < interval
    steps = m._replace(window=interval).steps(m.odometry)
    bend = motion.quantile(np.abs(steps.length * steps.turn) / 8, 0.9, 8)  # of an arc, above its chord
    if step := resolution(m.poses):
        fact, setting = f"positions are in steps of {step:.2g} m", f"{NOTHING}; write more digits"
    elif noise > max(COARSE, far / 5):
        fact, setting = f"positions scatter by {noise:.2g} m about a smooth path", NOTHING
    elif often and bend > 2 * COARSE:
        turned = np.degrees(motion.quantile(np.abs(steps.turn), 0.9))
        fact = f"positions come every {interval:.3g} s, in which the robot turns by up to {turned:.0f} deg: its path is"
        fact += f" {bend:.2g} m off the line between them"
        setting = f"{NOTHING}; and its heading at the start: heading_sd = {np.radians(turned / 2):.1g} in [prior]"
    else:
        return
    c.add("coarse", i, m.poses.source, fact, "likely", setting, "truth", ("x", "y"))


# --- Positions that cannot be

JUMP = 0.3  # [m] a shorter one is noise of the tracking
FAST = 5.0  # times the 90th percentile of speed, from which a step is a jump
STALE_TIME = 0.5  # [s]
STALE_LENGTH = 0.1  # [m] driven meanwhile, by odometry
STALE_PLACE = 0.5  # [m] the same where the heading goes on: one that turns on the spot drives less


def check_stale(c: CheckedLog, i: int) -> None:
    """Find positions that are repeated exactly while odometry says that the robot drives."""
    m = motion.robot_motion(c.log, i)
    t, change = m.truth.time, np.diff(m.poses.values, axis=0)
    if not len(t) or len(m.odometry.time) < 2:
        return
    place = m.odometry.place
    apart = np.hypot(*np.diff(place, axis=0).T) if np.isfinite(place).any() else np.abs(np.diff(m.odometry.length))
    length = np.concatenate([[0.0], np.cumsum(np.nan_to_num(apart))])

    def repeats(same: Mask, least: float) -> list[tuple[float, float]]:
        """Return intervals of `same` (m - 1,) that last, and in which at least that much is driven."""
        found = motion.lasting(t, same, STALE_TIME)
        driven = np.diff(np.interp(found, m.odometry.time, length), axis=1)[:, 0]
        return [(a, b) for (a, b), far in zip(found.tolist(), driven, strict=True) if far >= least]

    coarse = 2 * resolution(m.poses)  # positions that are rounded repeat, too
    same_place = (change[:, :2] == 0).all(axis=1)
    same_pose = same_place & ((change[:, 2] == 0) | np.isnan(change[:, 2]))
    if found := repeats(same_pose, STALE_LENGTH + coarse) or repeats(same_place, STALE_PLACE + coarse):
        longest = max(end - start for start, end in found)
        often = count_of(len(found), "time")
        fact = f"the position repeats exactly while the robot drives: {often}, for up to {longest:.1f} s"
        c.add("stale", i, m.poses.source, fact, "sure", 'repeats = "stale"', "truth")
        stale = np.any([(t > start) & (t <= end) for start, end in found], axis=0)
        c.correct("truth", i, m.poses._replace(time=t[~stale], values=m.poses.values[~stale]))


def check_jumps(c: CheckedLog, i: int) -> None:
    """Find positions between a step away and the step back, at most a second later; and steps that nothing follows."""
    truth = motion.known_truth(c.log, i)
    if truth is None:
        return
    t, apart = truth.time, np.hypot(*np.diff(truth.values[:, :2], axis=0).T)
    speed = apart / np.maximum(np.diff(t), 1e-3)
    usual, longest = motion.quantile(speed[speed > 0], 0.9), max(1.0, 3 * float(np.median(np.diff(t))))
    least = max(JUMP, 2 * resolution(truth))
    away, jumps, leaps = -1, set[int](), list[int]()  # the row before the last step that has no step back yet
    for step in np.flatnonzero((apart > least) & (speed > FAST * max(usual, 0.05))).tolist():
        if away < 0 or (t[step] - t[away] > longest and speed[step] < 10 * FASTEST):
            leaps += [away] * (away >= 0)
            away = step
        elif np.hypot(*(truth.values[step + 1, :2] - truth.values[away, :2])) < apart[away] / 2:
            jumps |= {*range(away + 1, step + 1)}
            away = -1
    leaps += [away] * (away >= 0)
    if jumps:
        plural = "s jump" if len(jumps) > 1 else " jumps"
        fact = f"{len(jumps)} position{plural} away and back; the first {t[min(jumps)] - t[0]:.1f} s after the start"
        c.add("jump", i, truth.source, fact, "sure", f"max_speed = {max(2 * usual, 0.5):.2g}", "truth")
        kept = np.setdiff1d(np.arange(len(t)), [*jumps])
        c.correct("truth", i, truth._replace(time=t[kept], values=truth.values[kept]))
    if leaps:
        often = f" {len(leaps)} times" * (len(leaps) > 1)
        fact = f"the position leaps{often} by up to {apart[leaps].max():.2g} m and stays; the first time"
        fact += f" {t[leaps[0]] - t[0]:.1f} s after the start: the tracker began again, or took another robot for it"
        c.add("jump", i, truth.source, fact, "likely", "nothing: make a run of each part", "truth", ("x", "y"))
