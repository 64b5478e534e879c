"""Two ways to judge a run: its number of trials was fixed before, or it may have stopped at any look at its results.

`FIXED` is what tables and reports use: t intervals, and Fieller's for a relative change. `ANYTIME` is for runs that
stop when their questions are decided: the confidence sequences of `sequences`, on the jackknife of logarithms for a
relative change, which over few skewed trials misses half as often as Fieller's (`reports/statistics.md`). Either way
a p-value is at most 0.05 where the interval excludes a value, and nowhere else.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cooploc.analysis.metrics import sequences, statistics
from cooploc.analysis.metrics.statistics import Interval, Quantile
from cooploc.estimators.interface import Array

HALVES = np.array([-0.5, 0.5])  # of the logarithms of two mean squared errors: that of the ratio of their RMSE


class Stopping(NamedTuple):
    """Intervals and tests, as functions of trials."""

    reach: Quantile  # standard errors of an interval over n trials, to either side
    change: Callable[[Array, Array], Interval]  # of RMSE, from squared errors (k,) before and after
    p_of_change: Callable[[Array, Array, float], float]  # two-sided, against a true change
    p_above: Callable[[Array, Array, float], float]  # one-sided, against mean b <= factor x mean a
    p_of_mean: Callable[[Interval, int, float], float]  # two-sided, of an interval symmetric about its value


FIXED = Stopping(
    statistics.quantile, statistics.change, statistics.p_of_change, statistics.p_above, statistics.p_of_mean
)


def change(a: Array, b: Array) -> Interval:
    """sqrt(mean b / mean a) - 1 with its confidence sequence, of squared errors `a`, `b` (k,) over paired trials."""
    return Interval(*(float(np.expm1(end)) for end in _log_ratio(a, b)))


def p_of_change(a: Array, b: Array, value: float) -> float:
    """Two-sided p against a true change of `value`, valid at any stopping."""
    return p_of_mean(_log_ratio(a, b), len(a), float(np.log1p(value)))


def e_of_change(a: Array, b: Array, value: float = 0.0) -> float:
    """The e-value against a true change of `value`: where it is true, 20 is reached, ever, in at most 5 % of runs.

    Over A/A comparisons, of two that should be the same, its mean stays at 1. nan where there is no sequence.
    """
    return sequences.e_value(_t(_log_ratio(a, b), len(a), float(np.log1p(value))), len(a))


def p_above(a: Array, b: Array, factor: float) -> float:
    """One-sided p against mean b <= `factor` times mean a, valid at any stopping; as `statistics.p_above`."""
    log, value = _log_ratio(a, b), float(np.log(factor)) / 2
    if log.low == log.high:
        return float(log.value < value)
    return float(np.minimum(1.0, 1 / sequences.one_sided_e_value(_t(log, len(a), value), len(a))))


def p_of_mean(interval: Interval, n: int, value: float) -> float:
    """Two-sided p against a true value, of a sequence over n trials: 1 / e, and 0 where no spread is left."""
    if interval.low == interval.high:
        return 0.0
    return float(np.minimum(1.0, 1 / sequences.e_value(_t(interval, n, value), n)))


def _log_ratio(a: Array, b: Array) -> Interval:
    """The logarithm of the ratio of the RMSE of b to that of a, with its sequence."""
    return statistics.log_contrast(np.stack([a, b], 1), HALVES, sequences.boundary)


def _t(interval: Interval, n: int, value: float) -> float:
    """How many standard errors a sequence's number is above a value."""
    half, above = interval.high - interval.value, interval.value - value
    if half == 0:
        return float(np.copysign(np.inf, above)) if above else 0.0
    return above / half * sequences.boundary(n)


ANYTIME = Stopping(sequences.boundary, change, p_of_change, p_above, p_of_mean)
