"""From an interval to a verdict: zones of numbers, and how many more trials would decide.

The verdict is the first whose zone holds the whole interval, both ends included; without one it is undecided.
"""

from typing import NamedTuple

import numpy as np
from scipy import stats

from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.statistics import Interval
from cooploc.estimators.interface import Array

Zones = tuple[tuple[str, float, float], ...]  # verdict, from, to
FALLS: Zones = (("contradicted", 0.0, np.inf), ("supported", -np.inf, 0.0))  # no difference at all contradicts
GROWS: Zones = (("contradicted", -np.inf, 0.0), ("supported", 0.0, np.inf))
ALPHA = (1 - statistics.LEVEL) / 2  # one-sided, as an end of the interval


class Finding(NamedTuple):
    """A case's number and verdict."""

    interval: Interval
    trials: int
    verdict: str
    needed: float  # trials that would decide
    scenario: str = ""  # of several, the one that the number is of
    than: str = ""


def of_size(size: float, least: float) -> Zones:
    """The zones of a claimed change: supported up to `least`, direction only between nothing and `size`."""
    if size > 0:
        return ("contradicted", -np.inf, 0.0), ("supported", least, np.inf), ("direction only", 0.0, size)
    return ("contradicted", 0.0, np.inf), ("supported", -np.inf, least), ("direction only", size, 0.0)


def at_most(limit: float) -> Zones:
    """The zones of a number that is claimed not to be above a limit."""
    return ("supported", -np.inf, limit), ("contradicted", limit, np.inf)


def decide(interval: Interval, n: int, zones: Zones) -> Finding:
    """The verdict on an interval over n trials."""
    for verdict, low, high in zones:
        if low <= interval.low and interval.high <= high:
            return Finding(interval, n, verdict, np.nan)
    value = interval.value
    edges = [min(value - low, high - value) for _, low, high in zones if low <= value <= high]
    needed = [statistics.trials_to_exclude(interval, n, distance) for distance in edges]
    return Finding(interval, n, "undecided", min((v for v in needed if np.isfinite(v)), default=np.nan))


def decide_all(pairs: list[Array], labels: list[tuple[str, str]], zones: Zones, p: list[float]) -> Finding:
    """The verdict on several changes at once: supported where each is; contradicted where one is, after Holm over all.

    Args:
        pairs: squared errors (trial, 2) of each case, before and after.
        labels: scenario and `than` of each case.
        zones: of each case.
        p: one-sided p of each case, small where it contradicts the claim.

    """
    found = [decide(statistics.change(*case.T), len(case), zones) for case in pairs]
    (low, high) = next(ends for verdict, *ends in zones if verdict == "supported")
    room = [min(f.interval.low - low, high - f.interval.high) for f in found]
    adjusted = statistics.holm(np.array(p))
    refuted = bool((adjusted < ALPHA).any())
    worst = int(np.nanargmin(adjusted)) if refuted else int(np.argmin(np.nan_to_num(room, nan=-np.inf)))
    needed = np.nan
    if all(f.verdict == "supported" for f in found):
        verdict = "supported"
    elif refuted:
        verdict = "contradicted"
    else:
        verdict, needed = "undecided", _needed(found, low, high)
    scenario, than = labels[worst]
    return found[worst]._replace(verdict=verdict, needed=needed, scenario=scenario, than=than)


def _needed(found: list[Finding], low: float, high: float) -> float:
    """Trials until one case is decided against the claim, or all are for it."""
    outside = [f for f in found if not low <= f.interval.value <= high]
    needed = np.array([f.needed if f.verdict == "undecided" else f.trials for f in outside or found], float)
    if not outside:
        return float(needed.max())
    return float(np.nanmin(needed)) if np.isfinite(needed).any() else np.nan


def p_above(a: Array, b: Array, factor: float) -> float:
    """One-sided p of a t test over paired trials; small where mean b is above `factor` times mean a."""
    d = b - factor * a
    if len(d) < statistics.LEAST_TRIALS:
        return np.nan
    if np.ptp(d) <= 1e-12 * np.abs(a).max():
        return float(d[0] < 0)
    return float(stats.ttest_1samp(d, 0, alternative="greater").pvalue)
