"""Clocks that are off, and robots that were exchanged: by correlation of odometry with truth at every shift.

In windows as long as two intervals, the lengths and turns that odometry says are correlated with those of the truth,
for shifts up to a minute or a third of the recording. A robot's odometry must fit its own truth best.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.inspect.corrected import moves, truth_of, with_truth
from cooploc.scenarios.recordings.inspect.finding import Change, Finding, Looked, Sure
from cooploc.scenarios.recordings.inspect.travelled import (
    Steps,
    Travelled,
    integrated,
    steps,
    travelled_truly,
    window_of,
)
from cooploc.scenarios.recordings.inspect.units import turns
from cooploc.scenarios.recordings.team_log import TeamLog

LONGEST_SHIFT = 60.0  # [s]
FEWEST = 25  # windows that two series must have in common
FITS = 0.5  # correlation from which odometry is said to fit a truth
OWN = 0.8  # correlation from which a truth is the robot's own without a look at the others'
EVIDENCE = 5.0  # standard errors between the correlations (Fisher's z) with and without the shift


class Fit(NamedTuple):
    """How well odometry fits a truth."""

    shift: float  # by which the truth's stamps are later than odometry's [s]
    correlation: float  # at that shift
    unshifted: float  # correlation at no shift
    windows: int


def look_at_clocks(log: TeamLog) -> Looked:
    """Truths that belong to other robots than their names say, and truths whose stamps are shifted against odometry."""
    own = {i: best_fit(log, i, i) for i in range(len(log.robots)) if moves(log, i)}
    log, exchanged = _exchanged(log, own)
    own |= {i: best_fit(log, i, i) for i in range(len(log.robots)) if any(f.robot == log.robots[i] for f in exchanged)}
    shifted = []
    for i in range(len(log.robots)):
        found, log = _shifted(log, i, own.get(i))
        shifted += found
    return Looked((*exchanged, *shifted), log)


def _exchanged(log: TeamLog, own: Mapping[int, Fit]) -> tuple[TeamLog, list[Finding]]:
    """Robots whose odometry fits the truth of another of them, and not their own."""
    pairs = list(own)
    if sum(fit.correlation < OWN for fit in own.values()) < 2:
        return log, []
    fits = np.array([[best_fit(log, i, j).correlation for j in pairs] for i in pairs])
    _, chosen = linear_sum_assignment(-fits)
    better = {
        pairs[row]: pairs[column]
        for row, column in enumerate(chosen)
        if row != column and fits[row, column] > max(FITS, fits[row, row] + 0.2)
    }
    if set(better) != set(better.values()):
        return log, []
    findings, truth = [], list(log.truth)
    for i, j in better.items():
        fact = (
            f"odometry of {log.robots[i]} fits the truth of {log.robots[j]} "
            f"(correlation {fits[pairs.index(i), pairs.index(j)]:.2f}), not its own ({own[i].correlation:.2f})"
        )
        other = log.truth[j]
        change = Change("truth", (), f"exchange the truths of {log.robots[i]} and {log.robots[j]}")
        findings.append(Finding("robots", log.robots[i], other.source if other else "", fact, "sure", change))
        truth[i] = other
    return log._replace(truth=tuple(truth)), findings


def _shifted(log: TeamLog, i: int, fit: Fit | None) -> tuple[list[Finding], TeamLog]:
    """A truth whose stamps are later or earlier than odometry's; with no time in common, once both begin together."""
    truth, apart = truth_of(log, i), _apart(log, i)
    if truth is None or (fit is None and not apart):
        return [], log
    if fit is None or apart:
        fit = best_fit(with_truth(log, i, time=truth.time - apart, values=truth.values), i, i)
    shift = apart + fit.shift
    if not (apart or _is_shift(log, i, fit)):
        return [], log
    fact = f"the truth's stamps are {shift:+.4g} s from odometry's (correlation {fit.correlation:.2f}"
    fact += " once both begin together)" if apart else f"; {fit.unshifted:.2f} without the shift)"
    sure: Sure = "sure" if fit.correlation > 0.7 else "likely"
    change = Change("truth", (), f"clock_offset = {-shift:.4g}")
    log = with_truth(log, i, time=truth.time - shift, values=truth.values)
    return [Finding("clock", log.robots[i], truth.source, fact, sure, change)], log


def best_fit(log: TeamLog, i: int, j: int) -> Fit:
    """The shift at which the odometry of robot i fits the truth of robot j best."""
    truth = truth_of(log, j)
    wheels = integrated(log.odometry[i], log.odometry_kind)
    if truth is None or len(wheels.time) < FEWEST:
        return Fit(0.0, 0.0, 0.0, 0)
    real, window = travelled_truly(truth), window_of(log, i)
    span = min(wheels.time[-1] - wheels.time[0], truth.time[-1] - truth.time[0])
    edges = np.arange(wheels.time[0], wheels.time[-1], window)
    longest = min(LONGEST_SHIFT, span / 3)
    said = _without_outliers(steps(wheels, edges, 3 * window))
    count = int(2 * longest / window)
    coarse = np.linspace(-count * window / 2, count * window / 2, 2 * count + 1)
    at = coarse[_nearest_peak(_correlations(said, real, edges, coarse, window), coarse, len(edges) / 2)]
    fine = np.linspace(at - 0.6 * window, at + 0.6 * window, 25)
    sharp = _correlations(said, real, edges, fine, window)
    best = int(np.argmax(sharp))
    unshifted = float(_correlations(said, real, edges, np.zeros(1), window)[0])
    return Fit(float(fine[best]), float(sharp[best]), unshifted, int(np.isfinite(said.length).sum()))


def _correlations(said: Steps, real: Travelled, edges: Array, shifts: Array, window: float) -> Array:
    """Correlation (s,) of odometry with the truth at each shift; 0 where they have too few windows in common."""
    return np.array([_agreement(said, steps(real, edges + shift, 3 * window)) for shift in shifts])


def _nearest_peak(correlation: Array, shifts: Array, samples: float) -> int:
    """Of the peaks that are as likely as the highest, the one of least shift: a robot in laps fits at every lap.

    -n/2 ln(1 - R^2) is the log-likelihood of n samples; as likely are those within EVIDENCE^2 / 2.
    """
    likelihood = -samples / 2 * np.log1p(-(np.minimum(correlation, 0.9999) ** 2))
    around = np.pad(correlation, 1, constant_values=-1.0)
    peaks = (correlation >= around[:-2]) & (correlation >= around[2:])
    good = np.flatnonzero(peaks & (likelihood >= likelihood.max() - EVIDENCE**2 / 2))
    return int(good[np.argmin(np.abs(shifts[good]))])


def _agreement(said: Steps, true: Steps) -> float:
    """R of lengths and turns together, 1 - R^2 = (1 - r^2) (1 - s^2), whatever the sign of turns; or of moves."""
    true = _without_outliers(true)
    if np.isfinite(said.move).any():
        return _rotated_correlation(said.move, true.move)
    r, s = max(_correlation(said.length, true.length), 0.0), _correlation(said.turn, turns(true))
    return float(np.sqrt(1 - (1 - r**2) * (1 - s**2)))


def _correlation(a: Array, b: Array) -> float:
    """Pearson's, over the samples known to both."""
    known = np.isfinite(a) & np.isfinite(b)
    if known.sum() < FEWEST:
        return 0.0
    a, b = a[known], b[known]
    scale = a.std() * b.std()
    return float(((a - a.mean()) * (b - b.mean())).mean() / scale) if scale > 1e-12 else 0.0


def _without_outliers(steps_: Steps) -> Steps:
    """Steps longer than ten times the mean are leaps, and are not known."""
    length = np.abs(steps_.length)
    known = length[np.isfinite(length)]
    leap = length > 10 * known.mean() if len(known) else np.zeros(len(length), bool)
    return Steps(*(np.where(leap if part.ndim == 1 else leap[:, None], np.nan, part) for part in steps_))


def _rotated_correlation(a: Array, b: Array) -> float:
    """The largest correlation of moves (w, 2) over all turns and reflections: the nuclear norm of their products."""
    known = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    if known.sum() < FEWEST:
        return 0.0
    a, b = a[known].T, b[known].T
    scale = np.sqrt((a**2).sum() * (b**2).sum())
    return float(np.linalg.norm(a @ b.T, "nuc") / scale) if scale > 0 else 0.0


def _is_shift(log: TeamLog, i: int, fit: Fit) -> bool:
    """Whether a shift is longer than an interval and a half, fits, and fits much better than none."""
    truth = log.truth[i]
    intervals = [float(np.median(np.diff(s.time))) for s in (log.odometry[i], truth) if s is not None]
    if fit.correlation < FITS or abs(fit.shift) < max(0.05, 1.5 * max(intervals)):
        return False
    with_it, without = np.arctanh(np.clip([fit.correlation, fit.unshifted], -0.999, 0.999))
    return bool((with_it - without) * np.sqrt(max(fit.windows - 3, 1) / 2) > EVIDENCE)


def _apart(log: TeamLog, i: int) -> float:
    """By how much the truth begins later than odometry, where the two have no time in common; else 0 [s]."""
    truth, wheels = log.truth[i], log.odometry[i]
    if truth is None or not len(wheels.time) or not len(truth.time):
        return 0.0
    together = min(truth.time[-1], wheels.time[-1]) - max(truth.time[0], wheels.time[0])
    return 0.0 if together > 0 else float(truth.time[0] - wheels.time[0])
