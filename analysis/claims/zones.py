"""From an interval to a verdict: zones of numbers, and how many more trials would decide.

The verdict is the first whose zone holds the whole interval, both ends included; without one it is undecided. Its p is
that of the nearer end of its zone, by the test that the interval inverts: at most 0.05 where it is decided. The p of an
undecided case is that of the zone which holds its number.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from cooploc.analysis.metrics import statistics, trials_needed
from cooploc.analysis.metrics.statistics import Interval
from cooploc.analysis.metrics.stopping import FIXED, Stopping
from cooploc.estimators.interface import Array

Zones = tuple[tuple[str, float, float], ...]  # verdict, from, to
Test = Callable[[float], float]  # two-sided p against a true value
FALLS: Zones = (("contradicted", 0.0, np.inf), ("supported", -np.inf, 0.0))  # no difference at all contradicts
GROWS: Zones = (("contradicted", -np.inf, 0.0), ("supported", 0.0, np.inf))
ALPHA = (1 - statistics.LEVEL) / 2  # one-sided, as an end of the interval


class Finding(NamedTuple):
    """A case's number and verdict."""

    interval: Interval
    trials: int
    verdict: str
    needed: float  # trials that would decide
    p: float  # of the verdict; nan without an interval
    scenario: str = ""  # of several, the one that the number is of
    than: str = ""


def of_size(size: float, least: float) -> Zones:
    """The zones of a claimed change: supported up to `least`, direction only between nothing and `size`."""
    if size > 0:
        return ("contradicted", -np.inf, 0.0), ("supported", least, np.inf), ("direction only", 0.0, size)
    return ("contradicted", 0.0, np.inf), ("supported", -np.inf, least), ("direction only", size, 0.0)


def or_flat(zones: Zones, limit: float) -> Zones:
    """These zones, but flat within a limit to either side of 0, whether or not the number differs from 0."""
    return ("flat", -limit, limit), *zones


def at_most(limit: float) -> Zones:
    """The zones of a number that is claimed not to be above a limit."""
    return ("supported", -np.inf, limit), ("contradicted", limit, np.inf)


def at_least(limit: float) -> Zones:
    """The zones of a number that is claimed not to be below a limit."""
    return ("supported", limit, np.inf), ("contradicted", -np.inf, limit)


def both(first: Finding, second: Finding) -> Finding:
    """Supported where both are; contradicted where one is, after Holm over the two. The number is the first's."""
    against = np.array([f.p if f.verdict == "contradicted" else np.nan for f in (first, second)])
    refuted = float(np.fmin.reduce(2 * against))
    if refuted <= 1 - statistics.LEVEL:
        return first._replace(verdict="contradicted", needed=np.nan, p=refuted)
    for_both = 1.0 if np.isfinite(refuted) else float(np.max([first.p, second.p]))
    if first.verdict == second.verdict == "supported":
        return first._replace(p=for_both)
    return first._replace(verdict="undecided", p=float(np.fmin(for_both, refuted)))


def decide(interval: Interval, n: int, zones: Zones, test: Test) -> Finding:
    """The verdict on an interval over n trials, and its p by the test that the interval inverts."""
    for verdict, low, high in zones:
        if low <= interval.low and interval.high <= high:
            return Finding(interval, n, verdict, np.nan, _p(low, high, test))
    value = interval.value
    around = [(low, high) for _, low, high in zones if low <= value <= high]
    needed = [trials_needed.trials_to_exclude(interval, n, min(value - low, high - value)) for low, high in around]
    p = np.nan if np.isnan(interval.low) else min(_p(low, high, test) for low, high in around)
    return Finding(interval, n, "undecided", min((v for v in needed if np.isfinite(v)), default=np.nan), p)


def _p(low: float, high: float, test: Test) -> float:
    """Of a zone that holds the number: both of its ends must be excluded (Berger 1982)."""
    return max((test(end) for end in (low, high) if np.isfinite(end)), default=0.0)


def decide_all(
    pairs: list[Array], labels: list[tuple[str, str]], zones: Zones, p: list[float], stopping: Stopping = FIXED
) -> Finding:
    """The verdict on several changes at once: supported where each is; contradicted where one is, after Holm over all.

    Args:
        pairs: squared errors (trial, 2) of each case, before and after.
        labels: scenario and `than` of each case.
        zones: of each case.
        p: one-sided p of each case, small where it contradicts the claim.
        stopping: how the number of trials came about.

    """
    found = [
        decide(stopping.change(*case.T), len(case), zones, partial(stopping.p_of_change, *case.T)) for case in pairs
    ]
    (low, high) = next(ends for verdict, *ends in zones if verdict == "supported")
    room = [min(f.interval.low - low, high - f.interval.high) for f in found]
    adjusted = statistics.holm(np.array(p))
    refuted = bool((adjusted < ALPHA).any())
    worst = int(np.nanargmin(adjusted)) if refuted else int(np.argmin(np.nan_to_num(room, nan=-np.inf)))
    scenario, than = labels[worst]
    needed = np.nan
    for_all, against = _p_of_all(found, low, high), float(np.minimum(1.0, 2 * np.fmin.reduce(adjusted)))
    if all(f.verdict == "supported" for f in found):
        verdict, chance = "supported", for_all
    elif refuted:
        verdict, chance = "contradicted", against
    else:
        verdict, chance, needed = "undecided", float(np.fmin(for_all, against)), _needed(found, low, high)
    return found[worst]._replace(verdict=verdict, needed=needed, p=chance, scenario=scenario, than=than)


def _p_of_all(found: list[Finding], low: float, high: float) -> float:
    """That every case is in the zone: the largest p; 1 where the number of one is outside; nan without an interval."""
    return float(np.max([f.p if low <= f.interval.value <= high else 1.0 for f in found]))


def _needed(found: list[Finding], low: float, high: float) -> float:
    """Trials until one case is decided against the claim, or all are for it."""
    outside = [f for f in found if not low <= f.interval.value <= high]
    needed = np.array([f.needed if f.verdict == "undecided" else f.trials for f in outside or found], float)
    if not outside:
        return float(needed.max())
    return float(np.nanmin(needed)) if np.isfinite(needed).any() else np.nan
