"""Intervals and tests over trials. The trial is the unit: ticks and robots of one trial are never independent samples.

Below five trials nothing is claimed: every interval is nan.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from scipy import stats

from cooploc.estimators.interface import Array

LEAST_TRIALS = 5
LEVEL = 0.95
Z = float(stats.norm.ppf((1 + LEVEL) / 2))
POWER = float(stats.norm.ppf(0.8))  # a planned number of trials succeeds in 4 of 5 repetitions
RESAMPLES = 1999


class Interval(NamedTuple):
    """A value with its 95 % interval."""

    value: float
    low: float
    high: float


def mean_of_positive(values: Array) -> Interval:
    """The mean of positive, skewed values, such as squared errors: jackknife on the logarithm of the mean, t quantile.

    Over lognormal and gamma values its coverage is nearer to the nominal one than that of the t interval (measured in
    `reports/statistics.md`), and it never reaches below zero.
    """
    mean = float(np.mean(values)) if len(values) else np.nan
    log = log_contrast(np.asarray(values)[:, None], np.ones(1))
    return Interval(mean, float(np.exp(log.low)), float(np.exp(log.high)))


def log_contrast(values: Array, weights: Array) -> Interval:
    """sum_j weights_j log mean_j over trials of positive `values` (trial, j): jackknife, t quantile.

    Columns of one row belong together, whether they are correlated or not: rows are what is independent.
    """
    n, mean = len(values), values.mean(0) if len(values) else np.full(len(weights), np.nan)
    if not (np.isfinite(mean).all() and (mean > 0).all()):
        return Interval(np.nan, np.nan, np.nan)
    value = float((weights * np.log(mean)).sum())
    left_out = (values.sum(0) - values) / max(n - 1, 1)
    if n < LEAST_TRIALS or (left_out <= 0).any():
        return Interval(value, np.nan, np.nan)
    log = (weights * np.log(left_out)).sum(1)
    half = _quantile(n) * float(np.sqrt((n - 1) / n * ((log - log.mean()) ** 2).sum()))
    return Interval(value, value - half, value + half)


def mean_difference(a: Array, b: Array) -> Interval:
    """mean(b - a) over paired trials, t interval."""
    return mean(b - a)


def mean(d: Array) -> Interval:
    """The mean over trials, t interval."""
    n, value = len(d), float(np.mean(d)) if len(d) else np.nan
    if n < LEAST_TRIALS or not np.isfinite(value):
        return Interval(value, np.nan, np.nan)
    half = _quantile(n) * float(d.std(ddof=1)) / np.sqrt(n)
    return Interval(value, value - half, value + half)


def improvement(a: Array, b: Array) -> Interval:
    """1 - sqrt(mean b^2 / mean a^2), of squared errors `a`, `b` over paired trials, with Fieller's interval.

    Fieller (1954): the ratio r of two means is accepted where the mean of b - r a does not differ from 0 by the t test.
    Where the denominator is not distinguishable from 0 the set is unbounded, and the interval is nan.
    """
    value, A, B = _gain(a, b), _mean(a), _mean(b)
    n = len(a)
    if n < LEAST_TRIALS or not (np.isfinite(value) and A > 0):
        return Interval(value, np.nan, np.nan)
    q = _quantile(n) ** 2 / n
    C = np.cov(a, b)
    qa, qb, qc = A * A - q * C[0, 0], A * B - q * C[0, 1], B * B - q * C[1, 1]
    root = qb * qb - qa * qc
    if qa <= 0 or root < -1e-12 * qb * qb:  # below zero by rounding alone where b is a multiple of a
        return Interval(value, np.nan, np.nan)
    low, high = (max((qb + sign * np.sqrt(max(root, 0.0))) / qa, 0.0) for sign in (-1, 1))
    return Interval(value, float(1 - np.sqrt(high)), float(1 - np.sqrt(low)))


def improvement_bca(a: Array, b: Array) -> Interval:
    """As `improvement`, with the bias-corrected accelerated bootstrap (Efron 1987); the cross-check of Fieller's."""
    value = _gain(a, b)
    if len(a) < LEAST_TRIALS or not np.isfinite(value):
        return Interval(value, np.nan, np.nan)
    if np.allclose(b * _mean(a), a * _mean(b), rtol=1e-9):  # every resample is the same
        return Interval(value, value, value)
    done = stats.bootstrap((a, b), _gains, paired=True, n_resamples=RESAMPLES, rng=np.random.default_rng(0))
    return Interval(value, float(done.confidence_interval.low), float(done.confidence_interval.high))


def as_ratio(gain: Interval) -> Interval:
    """From the error reduction 1 - b/a to the other definition of "better by", a/b - 1; both rise together."""
    return Interval(*(1 / (1 - g) - 1 if g != 1 else np.inf for g in gain))


def share(shares: Array) -> Interval:
    """The mean of per-trial shares in [0, 1], such as the share of robots that diverged: Wilson's interval.

    Robots of a trial are not independent, so the number that Wilson's formula takes is the effective one, p (1 - p)
    over the squared standard error between trials, reduced for its degrees of freedom (Korn & Graubard 1998), and never
    less than the number of trials: no variable in [0, 1] varies more than one that is either 0 or 1.
    """
    from statsmodels.stats.proportion import proportion_confint

    m, p = len(shares), _mean(shares)
    if m < LEAST_TRIALS or not np.isfinite(p):
        return Interval(p, np.nan, np.nan)
    variance = float(shares.var(ddof=1)) / m
    effective = p * (1 - p) / variance * (Z / _quantile(m)) ** 2 if variance > 0 else 0.0
    n = max(effective, float(m))
    low, high = proportion_confint(p * n, n, alpha=1 - LEVEL, method="wilson")
    return Interval(p, max(float(low), 0.0), min(float(high), 1.0))


def signed_rank(a: Array, b: Array) -> tuple[float, float]:
    """Wilcoxon signed-rank p, and the matched-pairs rank-biserial effect of b - a in [-1, 1] (negative: b smaller)."""
    d = b - a
    d = d[d != 0]
    if len(d) == 0:
        return 1.0, 0.0
    ranks = stats.rankdata(np.abs(d))
    effect = float((ranks * np.sign(d)).sum() / ranks.sum())
    return float(stats.wilcoxon(d).pvalue), effect


def equivalence(a: Array, b: Array, margin: float) -> float:
    """p against "the typical ratio b/a of paired errors lies outside 1/(1 + margin) .. 1 + margin": small means a tie.

    Two one-sided t tests (Schuirmann 1987) on the logarithms, so that it is the geometric mean of b/a that is judged.
    """
    from statsmodels.stats.weightstats import ttost_paired

    if len(a) < LEAST_TRIALS or not ((a > 0).all() and (b > 0).all()):
        return np.nan
    bound, d = np.log1p(margin), np.log(b) - np.log(a)
    if np.ptp(d) <= 1e-12:
        return float(abs(d[0]) >= bound)
    return float(ttost_paired(np.log(b), np.log(a), -bound, bound)[0])


def holm(p: Array) -> Array:
    """Holm's adjusted p over a family; nan (no test) stays nan and does not count."""
    from statsmodels.stats.multitest import multipletests

    adjusted, tested = np.full(p.shape, np.nan), ~np.isnan(p)
    if tested.any():
        adjusted[tested] = multipletests(p[tested], method="holm")[1]
    return adjusted


def trials_for_width(interval: Interval, n: int, half: float) -> float:
    """Trials at which an interval over n of them would be `half` wide to either side; nan where it says nothing.

    From n = (z s / h)^2 + (z^2 + 1) / 2, the second term for the t quantile.
    """
    return _trials((Z * _spread(interval, n) / half) ** 2 + (Z * Z + 1) / 2)


def trials_to_exclude(interval: Interval, n: int, distance: float) -> float:
    """Trials whose interval would, in 4 of 5 repetitions, exclude a value this far away; nan where it says nothing.

    From n = ((z + z_0.8) s / distance)^2 + z^2 / 2 (Guenther 1981).
    """
    if not distance > 0:
        return np.nan
    return _trials(((Z + POWER) * _spread(interval, n) / distance) ** 2 + Z * Z / 2)


def _spread(interval: Interval, n: int) -> float:
    """The standard deviation of one trial's share in an interval over n, by its wider side."""
    half = max(interval.value - interval.low, interval.high - interval.value)
    return half * np.sqrt(n) / _quantile(n) if n >= LEAST_TRIALS else np.nan


def _trials(needed: float) -> float:
    return float(max(np.ceil(needed), LEAST_TRIALS)) if np.isfinite(needed) else np.nan


def _mean(values: Array) -> float:
    return float(np.mean(values)) if len(values) else np.nan


def _gain(a: Array, b: Array) -> float:
    A = _mean(a)
    return float(1 - np.sqrt(_mean(b) / A)) if A > 0 else np.nan


def _gains(a: Array, b: Array, axis: int = -1) -> Array:
    gains: Array = 1 - np.sqrt(b.mean(axis) / a.mean(axis))
    return gains


@cache
def _quantile(n: int) -> float:
    return float(stats.t.ppf((1 + LEVEL) / 2, n - 1))
