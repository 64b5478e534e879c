"""Lengths in mm or cm, angles in degrees: seen from truth against odometry, without a common clock.

How fast a robot is said to move is a number that no shift of a clock, turn or mirroring of a frame changes: the third
quartile, over windows, of the length driven. Truth and odometry must agree on it; a ratio near 100 or 1000 is a unit.
"""

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.inspect.corrected import scaled, truth_of, with_odometry, with_truth
from cooploc.scenarios.recordings.inspect.finding import Change, Finding, Looked, Sure
from cooploc.scenarios.recordings.inspect.robust import concentration, length_unit
from cooploc.scenarios.recordings.inspect.travelled import (
    Steps,
    Travelled,
    course,
    integrated,
    steps,
    travelled_truly,
    window_of,
)
from cooploc.scenarios.recordings.team_log import Series, TeamLog

FASTEST = 15.0  # [m/s] of ground robots; faster is a unit or a fault
DEGREE = np.pi / 180
LENGTHS = {"velocity": ((0,), ("speed",)), "path": ((0,), ("length",)), "displacement": ((0, 1), ("dx", "dy"))}
POSE = ((0, 1), ("x", "y"))


def look_at_lengths(log: TeamLog) -> Looked:
    """The unit of every robot's truth and odometry."""
    findings: list[Finding] = []
    for i, robot in enumerate(log.robots):
        window = window_of(log, i)
        driven = _typical(integrated(log.odometry[i], log.odometry_kind), window)
        truth = truth_of(log, i)
        moved = np.nan if truth is None else _typical(travelled_truly(truth), window)
        columns, names = LENGTHS.get(log.odometry_kind, POSE)
        if truth is not None and (unit := length_unit(moved / driven) if driven > 0 else ""):
            factor = {"mm": 1000.0, "cm": 100.0}[unit]
            fact = f"the truth is {moved / driven:.3g} times as fast as odometry ({moved:.3g} against {driven:.3g} m/s)"
            change = Change("truth", ("x", "y"), f'unit = "{unit}"')
            findings.append(Finding("unit", robot, truth.source, fact, _certainty(driven, moved), change))
            log = with_truth(log, i, values=scaled(truth.values, factor, (0, 1)), time=truth.time)
        elif unit := length_unit(driven / moved) if moved > 0 else "":
            factor = {"mm": 1000.0, "cm": 100.0}[unit]
            source = log.odometry[i].source
            fact = f"odometry is {driven / moved:.3g} times as fast as the truth ({driven:.3g} against {moved:.3g} m/s)"
            change = Change("odometry", names, f'unit = "{unit}"')
            findings.append(Finding("unit", robot, source, fact, _certainty(moved, driven), change))
            log = with_odometry(log, i, values=scaled(log.odometry[i].values, factor, columns))
        else:
            findings += _too_fast(log, i, moved, driven)
    return Looked(tuple(findings), log)


def look_at_headings(log: TeamLog) -> Looked:
    """Whether a truth's heading, compared with the direction of its own moves, is in degrees or radians."""
    findings: list[Finding] = []
    for i, robot in enumerate(log.robots):
        truth = truth_of(log, i)
        found = None if truth is None else _angle_unit(truth, window_of(log, i))
        if truth is None or found is None:
            continue
        kind, unit, factor, sure = found
        largest = np.nanmax(np.abs(truth.values[:, 2]))
        fact = f"headings reach {largest:.4g} as read; with the unit {unit} they follow the direction of motion"
        change = Change("truth", ("heading",), f'unit = "{unit}"')
        findings.append(Finding(kind, robot, truth.source, fact, sure, change))
        log = with_truth(log, i, values=scaled(truth.values, factor, (2,)), time=truth.time)
    return Looked(tuple(findings), log)


def look_at_turn_rates(log: TeamLog) -> Looked:
    """Whether odometry turns about 57 times as fast as the truth, or 1/57."""
    findings: list[Finding] = []
    for i, robot in enumerate(log.robots):
        truth = truth_of(log, i)
        if truth is None or log.odometry_kind == "displacement":
            continue
        window = window_of(log, i)
        wheels = _windows(integrated(log.odometry[i], log.odometry_kind), window)
        real = turns(_windows(travelled_truly(truth), window))
        said, true = _quartile(np.abs(wheels.turn)), _quartile(np.abs(real))
        column, name = (2, "heading") if log.odometry_kind == "pose" else (1, "turn_rate")
        ratio = said / true if true > 0.01 * window else np.nan
        for kind, factor, unit in (("degrees", 1 / DEGREE, "deg"), ("radians", DEGREE, "rad")):
            if factor / 2.5 < ratio < factor * 2.5:
                fact = f"odometry turns {ratio:.3g} times as fast as the truth, which is about {factor:.3g}"
                written = unit if name == "heading" else f"{unit}/s"
                change = Change("odometry", (name,), f'unit = "{written}"')
                findings.append(Finding(kind, robot, log.odometry[i].source, fact, "sure", change))
                log = with_odometry(log, i, values=scaled(log.odometry[i].values, factor, (column,)))
    return Looked(tuple(findings), log)


def turns(real: Steps) -> Array:
    """Turns of the truth (w,) [rad]: of its heading where there is one, else of the direction of its moves."""
    if np.isfinite(real.turn).any():
        return real.turn
    return course_turns(real.move)


def course_turns(move: Array) -> Array:
    """How the direction of moves (w, 2) changes around each window [rad]: half of the change over both neighbours."""
    direction = course(move)
    turned = np.full(len(direction), np.nan)
    if len(direction) > 2:
        turned[1:-1] = np.angle(np.exp(1j * (direction[2:] - direction[:-2]))) / 2
    return turned


def _typical(travelled: Travelled, window: float) -> float:
    """Third quartile of the speed over windows [m/s]."""
    return _quartile(np.abs(_windows(travelled, window).length)) / window


def _windows(travelled: Travelled, window: float) -> Steps:
    t = travelled.time
    edges = np.arange(t[0], t[-1], window) if len(t) > 1 else np.empty(0)
    if len(edges) < 2:
        return Steps(np.empty(0), np.empty(0), np.empty((0, 2)))
    return steps(travelled, edges, 3 * window)


def _quartile(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, 0.75)) if len(known) >= 8 else np.nan


def _certainty(other: float, wrong: float) -> Sure:
    """Sure where the other speed is that of a robot; likely where both could be."""
    return "sure" if 0.01 < other < FASTEST and not 0.01 < wrong < 2.0 else "likely"


def _too_fast(log: TeamLog, i: int, moved: float, driven: float) -> list[Finding]:
    """Speeds beyond those of ground robots, where no comparison tells the unit."""
    found = []
    truth, names = log.truth[i], LENGTHS.get(log.odometry_kind, POSE)[1]
    wheels = log.odometry[i].source
    sources = (("truth", moved, ("x", "y"), truth.source if truth else ""), ("odometry", driven, names, wheels))
    for table, speed, columns, source in sources:
        if speed > FASTEST:
            fact = f"it moves at {speed:.3g} m/s (third quartile), ground robots at {FASTEST:g} m/s at most"
            change = Change(table, columns, 'unit = "mm"')
            found.append(Finding("speed", log.robots[i], source, fact, "likely", change))
    return found


def _angle_unit(truth: Series, window: float) -> tuple[str, str, float, Sure] | None:
    """Kind, unit, factor and certainty of a heading in the wrong unit; None where it is in radians."""
    if np.isfinite(truth.values[:, 2]).sum() < 10:
        return None
    t, heading = truth.time, truth.values[:, 2]
    edges = np.arange(t[0], t[-1], window)
    direction = course(steps(travelled_truly(truth), edges, 3 * window).move)
    there = heading[np.clip(np.searchsorted(t, edges[:-1] + window / 2), 0, len(t) - 1)]
    largest = float(np.nanmax(np.abs(heading)))

    def follows(factor: float) -> float:
        return max(concentration(factor * there - direction)[0], concentration(factor * there + direction)[0])

    as_read = follows(1.0)
    if largest > 2.1 * np.pi and follows(DEGREE) > max(0.6, as_read + 0.3):
        return "degrees", "deg", 1 / DEGREE, "sure"
    if 4 * np.pi < largest <= 361 and np.max(np.abs(np.diff(there))) > 180 and as_read < 0.5:
        return "degrees", "deg", 1 / DEGREE, "likely"
    wanders = concentration(direction)[0] < 0.8
    if largest < 2.1 * np.pi * DEGREE and wanders and follows(1 / DEGREE) > max(0.6, as_read + 0.3):
        return "radians", "rad", DEGREE, "sure"
    return None
