"""Mirrored frames, exchanged axes, headings and turns of the wrong sign.

Three witnesses speak of a robot's turns: the direction of its true moves, its true heading, and its odometry. A mirror
(x and y exchanged is one) reverses the first; a heading counted clockwise the second; a turn rate of the other sign the
third. Two against one says which. Where there are but two, ranges to things elsewhere decide, or both are named.
"""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings.inspect.corrected import moves, truth_of, with_odometry, with_truth
from cooploc.scenarios.recordings.inspect.finding import Change, Finding, Looked, Sure
from cooploc.scenarios.recordings.inspect.placement import shift_that_fits
from cooploc.scenarios.recordings.inspect.robust import concentration, slope
from cooploc.scenarios.recordings.inspect.travelled import (
    Steps,
    Travelled,
    common_edges,
    course,
    integrated,
    steps,
    travelled_truly,
    window_of,
)
from cooploc.scenarios.recordings.inspect.units import course_turns
from cooploc.scenarios.recordings.team_log import TeamLog

FOLLOWS = 0.6  # mean resultant length from which one direction is said to follow another
OFFSET = 0.3  # [rad] of a heading against the direction of motion; a slip or an arc is less
BESIDE = 0.3  # [m] a smaller shift is not told from noise and bias of ranges
SIGN = 6.0  # standard errors of a slope below zero from which a sign is wrong
MIRRORS = {0: ("mirrored", "y is downwards"), 2: ("axes", "x and y are exchanged"), 4: ("mirrored", "x is to the left")}


class Witnesses(NamedTuple):
    """How the turns of one robot agree; a slope is nan where it cannot be known."""

    follows: float  # mean resultant length of heading - course
    offset: float  # heading - course [rad]
    opposes: float  # mean resultant length of heading + course
    mirror: float  # heading + course [rad]
    heading: tuple[float, float]  # odometry's turns against those of the heading: slope, standard error
    course: tuple[float, float]  # the same against those of the course


def look_at_frames(log: TeamLog) -> Looked:
    """Frames, headings and turn rates of the wrong sign, robot by robot."""
    findings: list[Finding] = []
    for i in range(len(log.robots)):
        if not moves(log, i):
            continue
        found, log = _compass(log, i) if log.odometry_kind == "displacement" else _wheels(log, i)
        findings += found
    return Looked(tuple(findings), log)


def witnesses(log: TeamLog, i: int) -> Witnesses:
    """What truth and odometry of robot i say of its turns."""
    truth = truth_of(log, i)
    if truth is None:
        return Witnesses(0.0, np.nan, 0.0, np.nan, (np.nan, np.nan), (np.nan, np.nan))
    window = window_of(log, i)
    wheels, real = integrated(log.odometry[i], log.odometry_kind), travelled_truly(truth)
    own = np.arange(truth.time[0], truth.time[-1], window)
    direction = course(_at(real, own, window).move)
    backwards = _at(wheels, own, window).length < 0
    direction = np.where(backwards, wrap(direction + np.pi), direction)
    heading = wrap(np.interp(own[:-1] + window / 2, real.time, real.turn))
    edges = common_edges(wheels.time, real.time, window)
    said, true = _at(wheels, edges, window), _at(real, edges, window)
    around = np.convolve(said.turn, np.full(3, 1 / 3), "same") if len(said.turn) > 3 else said.turn
    return Witnesses(
        *concentration(heading - direction),
        *concentration(heading + direction),
        slope(true.turn, said.turn),
        slope(course_turns(true.move), around),
    )


def _at(travelled: Travelled, edges: Array, window: float) -> Steps:
    if len(edges) < 2:
        return Steps(np.empty(0), np.empty(0), np.empty((0, 2)))
    return steps(travelled, edges, 3 * window)


def _wheels(log: TeamLog, i: int) -> tuple[list[Finding], TeamLog]:
    """A robot whose odometry turns."""
    seen, robot, truth = witnesses(log, i), log.robots[i], log.truth[i]
    assert truth is not None
    reversed_heading, reversed_course = _negative(seen.heading), _negative(seen.course)
    if seen.opposes > FOLLOWS and seen.opposes > seen.follows + 0.2:
        if reversed_heading:
            return _clockwise(log, i, seen)
        return _mirrored(log, i, seen.mirror, seen, "sure" if np.isfinite(seen.heading[0]) else "likely")
    findings: list[Finding] = []
    if seen.follows > FOLLOWS and abs(seen.offset) > OFFSET:
        degrees = np.degrees(seen.offset)
        fact = f"the heading is {degrees:+.0f} deg from the direction of motion (agreement {seen.follows:.2f})"
        change = Change("truth", ("heading",), f"subtract {degrees:.0f} deg in the file")
        findings.append(Finding("heading", robot, truth.source, fact, "likely", change))
        log = _with_heading(log, i, truth.values[:, 2] - seen.offset)
    if reversed_heading or (not np.isfinite(seen.heading[0]) and reversed_course):
        found, log = _reversed_turns(log, i, seen)
        findings += found
    return findings, log


def _negative(estimate: tuple[float, float]) -> bool:
    b, error = estimate
    return bool(np.isfinite(b) and b < -0.3 and b < -SIGN * error)


def _clockwise(log: TeamLog, i: int, seen: Witnesses) -> tuple[list[Finding], TeamLog]:
    """heading = offset - course, and odometry turns against it: the heading is counted clockwise."""
    truth = log.truth[i]
    assert truth is not None
    start = "from y, as a compass does" if abs(wrap(np.asarray(seen.mirror - np.pi / 2))) < OFFSET else "from x"
    fact = f"the heading falls when the robot turns left (agreement {seen.opposes:.2f}): it is clockwise {start}"
    change = Change("truth", ("heading",), f"write {np.degrees(seen.mirror):.0f} deg - heading into the file")
    log = _with_heading(log, i, seen.mirror - truth.values[:, 2])
    return [Finding("heading", log.robots[i], truth.source, fact, "sure", change)], log


def _mirrored(log: TeamLog, i: int, mirror: float, seen: Witnesses, sure: Sure) -> tuple[list[Finding], TeamLog]:
    """heading = mirror - course, and odometry agrees with the heading: the positions are mirrored."""
    truth = log.truth[i]
    assert truth is not None
    kind, words = _mirror(mirror)
    fact = f"the positions turn left where the heading turns right (agreement {seen.opposes:.2f}): {words}"
    log, moved = _reflected(log, i, mirror)
    return [Finding(kind, log.robots[i], truth.source, fact + moved, sure, _mirror_change(kind, mirror))], log


def _reversed_turns(log: TeamLog, i: int, seen: Witnesses) -> tuple[list[Finding], TeamLog]:
    """Odometry turns against a truth that agrees with itself: the sign of one, or a mirrored frame of the other."""
    b = seen.heading[0] if np.isfinite(seen.heading[0]) else seen.course[0]
    source, values = log.odometry[i].source, log.odometry[i].values.copy()
    fact = f"odometry turns right where the truth turns left (slope {b:.2f})"
    if not np.isfinite(seen.heading[0]):
        fact += "; or the truth is mirrored (its heading was not recorded)"
    if log.odometry_kind == "pose":
        values[:, 1:] *= -1
        change = Change("odometry", ("y", "heading"), "write -y and -heading into the files")
    else:
        values[:, 1] *= -1
        change = Change("odometry", ("turn_rate",), "write -turn_rate into the files")
    sure: Sure = "sure" if np.isfinite(seen.heading[0]) and seen.follows > FOLLOWS else "likely"
    return [Finding("turn sign", log.robots[i], source, fact, sure, change)], with_odometry(log, i, values=values)


def _compass(log: TeamLog, i: int) -> tuple[list[Finding], TeamLog]:
    """A robot with displacements: the turn or reflection that takes them to the true moves (orthogonal Procrustes)."""
    truth = truth_of(log, i)
    wheels = integrated(log.odometry[i], log.odometry_kind)
    if truth is None:
        return [], log
    window, real = window_of(log, i), travelled_truly(truth)
    edges = common_edges(wheels.time, real.time, window)
    said, true = _at(wheels, edges, window).move, _at(real, edges, window).move
    known = np.isfinite(said).all(axis=1) & np.isfinite(true).all(axis=1)
    if known.sum() < 20:
        return [], log
    direct = wrap(course(true) - course(said))
    against = wrap(course(true) + course(said))
    (follows, offset), (opposes, mirror) = concentration(direct), concentration(against)
    robot = log.robots[i]
    if opposes > FOLLOWS and opposes > follows + 0.2:
        kind, words = _mirror(mirror)
        fact = f"the positions move as the mirror image of odometry (agreement {opposes:.2f}): {words}"
        log, moved = _reflected(log, i, mirror)
        return [Finding(kind, robot, truth.source, fact + moved, "likely", _mirror_change(kind, mirror))], log
    if follows > FOLLOWS and abs(offset) > OFFSET:
        fact = f"the positions move {np.degrees(offset):+.0f} deg from where odometry says (agreement {follows:.2f})"
        change = Change("odometry", ("dx", "dy"), f"turn dx, dy by {np.degrees(offset):.0f} deg in the files")
        return [Finding("frame", robot, log.odometry[i].source, fact, "likely", change)], log
    return [], log


def _reflected(log: TeamLog, i: int, mirror: float) -> tuple[TeamLog, str]:
    """Positions reflected in a line at half of `mirror` [rad], where ranges fit best; headings stay.

    Also says by how much the mirror lies beside the origin.
    """
    truth = log.truth[i]
    assert truth is not None
    c, s = np.cos(mirror), np.sin(mirror)
    values = truth.values.copy()
    values[:, :2] = values[:, :2] @ np.array([[c, s], [s, -c]])
    log = with_truth(log, i, values=values)
    shift = shift_that_fits(log, i)
    if shift is None or np.hypot(*shift) < BESIDE:
        return log, ""
    values[:, :2] += shift
    return with_truth(log, i, values=values), f"; ranges then ask for a shift by {shift[0]:+.2f}, {shift[1]:+.2f} m"


def _mirror(mirror: float) -> tuple[str, str]:
    """The kind of a mirror, by the angle heading + course [rad]: 0, 90 or 180 deg; else a line at half of it."""
    eighths = int(np.rint(abs(wrap(np.asarray(mirror))) / (np.pi / 4)))
    if eighths == 2 and mirror < 0:
        return "axes", "x and y are exchanged, and one is reversed"
    return MIRRORS.get(eighths, ("mirrored", f"in a line at {np.degrees(mirror) / 2:.0f} deg"))


def _mirror_change(kind: str, mirror: float) -> Change:
    if kind == "axes" and mirror > 0:
        return Change("truth", (), 'frame = "swapped"')
    if kind == "mirrored" and abs(mirror) < np.pi / 8:
        return Change("truth", (), 'frame = "mirrored"')
    return Change("truth", ("x", "y"), "turn the positions back in the files")


def _with_heading(log: TeamLog, i: int, heading: Array) -> TeamLog:
    truth = log.truth[i]
    assert truth is not None
    return with_truth(log, i, values=np.column_stack([truth.values[:, :2], wrap(heading)]))
