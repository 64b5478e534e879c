"""Odometry that is too long or turns too much by a constant factor."""

import numpy as np

from cooploc.scenarios.recordings.inspect.corrected import moves, truth_of
from cooploc.scenarios.recordings.inspect.finding import Change, Finding, Looked
from cooploc.scenarios.recordings.inspect.robust import slope
from cooploc.scenarios.recordings.inspect.travelled import common_edges, integrated, steps, travelled_truly, window_of
from cooploc.scenarios.recordings.inspect.units import turns
from cooploc.scenarios.recordings.team_log import TeamLog

MOST = 1.2  # a factor beyond this, or below its inverse, is told; wheels are rarely better calibrated than 5 %
EVIDENCE = 5.0  # standard errors from that limit
LEAST = 1.0  # [m], [rad] that a robot must have moved in all


def look_at_scales(log: TeamLog) -> Looked:
    """Lengths and turns of odometry against those of the truth, by least absolute deviations."""
    findings = []
    for i, robot in enumerate(log.robots):
        truth = truth_of(log, i)
        if truth is None or not moves(log, i):
            continue
        wheels, real, window = integrated(log.odometry[i], log.odometry_kind), travelled_truly(truth), window_of(log, i)
        edges = common_edges(wheels.time, real.time, window)
        if len(edges) < 10:
            continue
        said, true = steps(wheels, edges, 3 * window), steps(real, edges, 3 * window)
        source = log.odometry[i].source
        turned = turns(true)
        for name, key, total, estimate in (
            ("drives", "length_scale", np.nansum(true.length), slope(true.length, np.abs(said.length))),
            ("turns", "turn_scale", np.nansum(np.abs(turned)), slope(turned, said.turn)),
        ):
            b, error = abs(estimate[0]), estimate[1]
            if total < LEAST:
                continue
            if b > MOST + EVIDENCE * error or 0 < b < 1 / MOST - EVIDENCE * error:
                fact = f"odometry {name} {b:.3g} times as far as the truth (standard error {error:.2g})"
                change = Change("model", (), f"{key} = {1 / b:.3g}")
                findings.append(Finding("scale", robot, source, fact, "likely", change))
    return Looked(tuple(findings), log)
