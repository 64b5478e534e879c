"""Intervals and tests over trials. The trial is the unit: ticks and robots of one trial are never independent samples.

Below five trials nothing is claimed: every interval is nan.
"""

from typing import NamedTuple

import numpy as np
from scipy import stats

from cooploc.estimators.interface import Array

LEAST_TRIALS = 5
LEVEL = 0.95


class Interval(NamedTuple):
    """A value with its 95 % interval."""

    value: float
    low: float
    high: float


def mean_of_positive(values: Array) -> Interval:
    """The mean of positive, skewed values, such as squared errors: jackknife on the logarithm of the mean, t quantile.

    Over lognormal and gamma values its coverage is nearer to the nominal one than that of the t interval (see
    `tests/test_statistics.py`), and it never reaches below zero.
    """
    n, mean = len(values), float(np.mean(values)) if len(values) else np.nan
    if n < LEAST_TRIALS or not np.isfinite(mean) or mean <= 0:
        return Interval(mean, np.nan, np.nan)
    left_out = (values.sum() - values) / (n - 1)
    if (left_out <= 0).any():
        return Interval(mean, np.nan, np.nan)
    log = np.log(left_out)
    error = np.sqrt((n - 1) / n * ((log - log.mean()) ** 2).sum())
    factor = float(np.exp(_quantile(n) * error))
    return Interval(mean, mean / factor, mean * factor)


def mean_difference(a: Array, b: Array) -> Interval:
    """mean(b - a) over paired trials, t interval."""
    d = b - a
    n, mean = len(d), float(np.mean(d)) if len(d) else np.nan
    if n < LEAST_TRIALS or not np.isfinite(mean):
        return Interval(mean, np.nan, np.nan)
    half = _quantile(n) * float(d.std(ddof=1)) / np.sqrt(n)
    return Interval(mean, mean - half, mean + half)


def improvement(a: Array, b: Array) -> Interval:
    """1 - sqrt(mean b^2 / mean a^2), of squared errors `a`, `b` over paired trials, with Fieller's interval.

    Fieller (1954): the ratio r of two means is accepted where the mean of b - r a does not differ from 0 by the t test.
    Where the denominator is not distinguishable from 0 the set is unbounded, and the interval is nan.
    """
    n, A, B = len(a), float(np.mean(a)) if len(a) else np.nan, float(np.mean(b)) if len(b) else np.nan
    value = 1 - np.sqrt(B / A) if A > 0 else np.nan
    if n < LEAST_TRIALS or not (np.isfinite(value) and A > 0):
        return Interval(float(value), np.nan, np.nan)
    q = _quantile(n) ** 2 / n
    C = np.cov(a, b)
    qa, qb, qc = A * A - q * C[0, 0], A * B - q * C[0, 1], B * B - q * C[1, 1]
    root = qb * qb - qa * qc
    if qa <= 0 or root < 0:
        return Interval(float(value), np.nan, np.nan)
    low, high = (max((qb + sign * np.sqrt(root)) / qa, 0.0) for sign in (-1, 1))
    return Interval(float(value), float(1 - np.sqrt(high)), float(1 - np.sqrt(low)))


def signed_rank(a: Array, b: Array) -> tuple[float, float]:
    """Wilcoxon signed-rank p, and the matched-pairs rank-biserial effect of b - a in [-1, 1] (negative: b smaller)."""
    d = b - a
    d = d[d != 0]
    if len(d) == 0:
        return 1.0, 0.0
    ranks = stats.rankdata(np.abs(d))
    effect = float((ranks * np.sign(d)).sum() / ranks.sum())
    return float(stats.wilcoxon(d).pvalue), effect


def holm(p: Array) -> Array:
    """Holm's adjusted p over a family; nan (no test) stays nan and does not count."""
    from statsmodels.stats.multitest import multipletests

    adjusted, tested = np.full(p.shape, np.nan), ~np.isnan(p)
    if tested.any():
        adjusted[tested] = multipletests(p[tested], method="holm")[1]
    return adjusted


def _quantile(n: int) -> float:
    return float(stats.t.ppf((1 + LEVEL) / 2, n - 1))
