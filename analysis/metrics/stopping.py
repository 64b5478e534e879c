"""Two ways to judge a run: its number of trials was fixed before, or it may have stopped at any look at its results.

`FIXED` is what tables and reports use: t intervals, and Fieller's for a relative change. `ANYTIME` is for runs that
stop when their questions are decided: confidence sequences (`sequences`) of means, and of logarithms of means by the
jackknife, a relative change of RMSE among them. Either way a p-value is at most 0.05 where the interval excludes a
value, and nowhere else.

The jackknife takes a mean for nearly normal, which it is not where a few trials decide it: of errors of which one in a
hundred is twentyfold, two equals would be called different in 20 % of runs. The sequences are therefore as wide as over
the effective number of trials, (sum v)^2 / sum v^2 (Kish 1965) of the mean where it is smallest, times 1.5: all trials
where their standard deviation is up to 0.7 of the mean, and four or five where three of a hundred decide. There is none
below seven. The factor is the largest of 1, 1.5, 2 and 3 that keeps false decisions below 5 % in all worlds of
`reports/statistics.md`.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cooploc.analysis.metrics import sequences, statistics
from cooploc.analysis.metrics.sequences import ALPHA
from cooploc.analysis.metrics.statistics import Interval
from cooploc.estimators.interface import Array

WORTH = 1.5  # trials that an effective one counts for
HALVES = np.array([-0.5, 0.5])  # of the logarithms of two mean squared errors: that of the ratio of their RMSE


class Stopping(NamedTuple):
    """Intervals and tests, as functions of trials."""

    mean: Callable[[Array], Interval]
    mean_of_positive: Callable[[Array], Interval]
    log_contrast: Callable[[Array, Array], Interval]  # of values (trial, j) and weights (j,)
    change: Callable[[Array, Array], Interval]  # of RMSE, from squared errors (k,) before and after
    p_of_change: Callable[[Array, Array, float], float]  # two-sided, against a true change
    p_above: Callable[[Array, Array, float], float]  # one-sided, against mean b <= factor x mean a
    p_of_mean: Callable[[Interval, int, float], float]  # two-sided, of an interval symmetric about its value
    equal: Callable[[Array, Array, float], bool]  # whether two RMSE tie within a margin, from squared errors

    def p_of_difference(self, a: Array, b: Array) -> float:
        """Two-sided p against equal RMSE; 1 for equals, nan where there is no interval."""
        if np.isnan(self.change(a, b).low):
            return np.nan
        return 1.0 if np.array_equal(a, b) else self.p_of_change(a, b, 0.0)


def effective(values: Array) -> float:
    """The number of trials that a sequence over positive `values` (trial, j) counts, as above."""
    kish = (values.sum(0) ** 2 / (values**2).sum(0)).min()
    return float(np.minimum(len(values), WORTH * kish))


def mean(d: Array) -> Interval:
    """The mean of `d` (k,) over trials with its confidence sequence."""
    return statistics.mean(d, sequences.boundary)


def mean_of_positive(values: Array) -> Interval:
    """The mean of positive values (k,) with its confidence sequence."""
    return statistics.mean_of_positive(values, lambda _: sequences.boundary(effective(values[:, None])))


def log_contrast(values: Array, weights: Array) -> Interval:
    """sum_j weights_j log mean_j over trials of positive `values` (trial, j), with its confidence sequence."""
    return statistics.log_contrast(values, weights, lambda _: sequences.boundary(effective(values)))


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
    return sequences.e_value(*_t(_log_ratio(a, b), len(a), float(np.log1p(value))))


def p_above(a: Array, b: Array, factor: float) -> float:
    """One-sided p against mean b <= `factor` times mean a, valid at any stopping; as `statistics.p_above`."""
    log, value = _log_ratio(a, b), float(np.log(factor)) / 2
    if log.low == log.high:
        return float(log.value < value)
    return _p(sequences.one_sided_e_value(*_t(log, len(a), value)))


def p_of_mean(interval: Interval, n: int, value: float) -> float:
    """Two-sided p against a true value, of a sequence over n trials: 1 / e, and 0 where no spread is left."""
    if interval.low == interval.high:
        return 0.0
    return _p(sequences.e_value(*_t(interval, n, value)))


def _p(e: float) -> float:
    """1 / e, at most 1; nan where e is nan. Where data speak strongly for the opposite, e is rounded to 0."""
    return float(1 / np.maximum(1.0, e))


def equal(a: Array, b: Array, margin: float) -> bool:
    """Whether the sequence of the change of RMSE lies within 1/(1 + margin) .. 1 + margin."""
    return within(change(a, b), margin)


def within(found: Interval, margin: float) -> bool:
    """Whether a change of RMSE lies within 1/(1 + margin) .. 1 + margin."""
    return -margin / (1 + margin) <= found.low and found.high <= margin


def _log_ratio(a: Array, b: Array) -> Interval:
    """The logarithm of the ratio of the RMSE of b to that of a, with its sequence."""
    return log_contrast(np.stack([a, b], 1), HALVES)


def _t(interval: Interval, n: int, value: float) -> tuple[float, int]:
    """How far a sequence's number is above a value, in ends of the sequence, as a t statistic over n trials."""
    half, above = interval.high - interval.value, interval.value - value
    if half == 0:
        return (float(np.copysign(np.inf, above)) if above else 0.0), n
    return above / half * sequences.boundary(n), n


FIXED = Stopping(
    statistics.mean,
    statistics.mean_of_positive,
    statistics.log_contrast,
    statistics.change,
    statistics.p_of_change,
    statistics.p_above,
    statistics.p_of_mean,
    lambda a, b, margin: statistics.equivalence(a, b, margin) < ALPHA,
)
ANYTIME = Stopping(mean, mean_of_positive, log_contrast, change, p_of_change, p_above, p_of_mean, equal)
