"""Intervals and tests over trials, none below five. The trial is the unit: its ticks and robots are not independent.

The rates at which these intervals and tests err are measured in `reports/statistics.md`.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy import special

from cooploc.estimators.interface import Array

LEAST_TRIALS = 5
LEVEL = 0.95
Z = float(special.ndtri((1 + LEVEL) / 2))
MARGIN = 0.05  # two estimators whose RMSE differ by less than this share tie
HALVES = np.array([-0.5, 0.5])  # of the logarithms of two mean squared errors: that of the ratio of their RMSE


class Interval(NamedTuple):
    """A value with its 95 % interval; the ends are nan where there is none."""

    value: float
    low: float
    high: float

    def columns(self, name: str) -> dict[str, float]:
        """Return the columns of a table: `name`, `name_low` and `name_high`."""
        return {name: self.value, f"{name}_low": self.low, f"{name}_high": self.high}


def quantile(n: float) -> float:
    """Return the quantile of the t distribution over n trials, at LEVEL to either side."""
    return float(special.stdtrit(n - 1, (1 + LEVEL) / 2))


def trials_without_skew(values: Array) -> float:
    """Return the trials without skew whose t interval is as good as that of positive `values` (k,): k, or fewer.

    1 + (k - 1) / (1 + 3 CV^2): Satterthwaite's degrees of freedom (1946), with gamma's excess kurtosis 6 CV^2.
    """
    k = len(values)
    if k <= LEAST_TRIALS or not values.any():
        return k
    with np.errstate(over="ignore", invalid="ignore"):  # of a filter that diverged: no interval
        variation = float(values.var(ddof=1) / values.mean() ** 2)
    return float(max(1 + (k - 1) / (1 + 3 * variation), LEAST_TRIALS))


def least_without_skew(values: Array) -> float:
    """Return `trials_without_skew` of the most skewed column of `values` (k, j)."""
    return min(map(trials_without_skew, values.T))


class Stopping(NamedTuple):
    """Intervals and tests by how the number of trials came about: fixed before, or by looking at the results.

    Errors `a`, `b` (k,) are squared, over paired trials, before and after. Columns of `values` (trial, j) may be
    correlated: rows are what is independent. A p-value is at most 0.05 where its interval excludes a value.
    """

    reach: Callable[[float], float]  # standard errors that an interval over n trials reaches to either side
    trials: Callable[[Array], float]  # how many those of positive, skewed `values` count as
    contrast_trials: Callable[[Array], float]  # the same in a contrast of several
    test_trials: Callable[[Array], float]  # the same in a test of a change
    p: Callable[[float, float], float]  # two-sided, of a t statistic over n trials
    p_one_sided: Callable[[float, float], float]  # small where t is large
    equal: Callable[[Array, Array], bool]  # whether two RMSE tie, from squared errors

    def mean(self, d: Array) -> Interval:
        """Return the mean of `d` (k,) over trials, such as paired differences b - a: t interval."""
        n, value = len(d), float(np.mean(d)) if len(d) else np.nan
        if n < LEAST_TRIALS or not np.isfinite(value):
            return Interval(value, np.nan, np.nan)
        half = self.reach(n) * float(d.std(ddof=1)) / np.sqrt(n)
        return Interval(value, value - half, value + half)

    def mean_of_positive(self, values: Array) -> Interval:
        """Return the mean of positive, skewed values (k,): jackknife on its logarithm."""
        mean = float(np.mean(values)) if len(values) else np.nan
        log = self._contrast(values[:, None], np.ones(1), self.trials)
        return Interval(mean, float(np.exp(log.low)), float(np.exp(log.high)))

    def log_contrast(self, values: Array, weights: Array) -> Interval:
        """Return sum_j weights_j log mean_j over trials of positive `values` (trial, j): jackknife, t quantile."""
        return self._contrast(values, weights, self.contrast_trials)

    def log_change(self, a: Array, b: Array) -> Interval:
        """Return log(RMSE of b / RMSE of a): jackknife, t quantile.

        Fieller's interval calls an erratic one better in up to a fifth of ties.
        """
        return self._contrast(np.stack([a, b], 1), HALVES, self.trials)

    def change(self, a: Array, b: Array) -> Interval:
        """Return the relative change of the RMSE, sqrt(mean b / mean a) - 1."""
        return Interval(*(float(np.expm1(end)) for end in self.log_change(a, b)))

    def _contrast(self, values: Array, weights: Array, trials: Callable[[Array], float]) -> Interval:
        n, mean = len(values), values.mean(0) if len(values) else np.full(len(weights), np.nan)
        if not (np.isfinite(mean).all() and (mean > 0).all()):
            return Interval(np.nan, np.nan, np.nan)
        value = float((weights * np.log(mean)).sum())
        left_out = (values.sum(0) - values) / max(n - 1, 1)
        if n < LEAST_TRIALS or (left_out <= 0).any():
            return Interval(value, np.nan, np.nan)
        log = (weights * np.log(left_out)).sum(1)
        half = self.reach(trials(values)) * float(np.sqrt((n - 1) / n * ((log - log.mean()) ** 2).sum()))
        return Interval(value, value - half, value + half)

    def p_above(self, a: Array, b: Array, factor: float) -> float:
        """Return the one-sided p; small where mean b is above `factor` times mean a."""
        log, n = self.log_change(a, b), self.test_trials(np.stack([a, b], 1))
        above, half = log.value - float(np.log(factor)) / 2, log.high - log.value
        return float(above < 0) if half == 0 else self.p_one_sided(above / half * self.reach(n), n)

    def p_of_change(self, a: Array, b: Array, value: float) -> float:
        """Return the two-sided p against a true change of `value`: 0.05 at either end of the interval of `change`."""
        return self.p_of_mean(self.log_change(a, b), self.test_trials(np.stack([a, b], 1)), float(np.log1p(value)))

    def p_of_mean(self, interval: Interval, n: float, value: float) -> float:
        """Return the two-sided p against a true value, of an interval over n trials; nan where there is none."""
        half = interval.high - interval.value
        return 0.0 if half == 0 else self.p((interval.value - value) / half * self.reach(n), n)

    def p_of_difference(self, a: Array, b: Array) -> float:
        """Return the two-sided p against equal RMSE; 1 for equals, nan where there is no interval."""
        p = self.p_of_change(a, b, 0.0)
        return 1.0 if p == p and np.array_equal(a, b) else p


FIXED = Stopping(
    quantile,
    trials=least_without_skew,
    contrast_trials=len,
    test_trials=least_without_skew,
    p=lambda t, n: float(2 * special.stdtr(n - 1, -abs(t))),
    p_one_sided=lambda t, n: float(special.stdtr(n - 1, -t)),
    equal=lambda a, b: equivalence(a, b) < 1 - LEVEL,
)


def decisive_trial(a: Array, b: Array) -> int | None:
    """Return the place of the one trial without which the interval of `change` would be half as wide; None: no such.

    Its share of the jackknife's variance is above 3/4. None below ten trials, and where the interval excludes 0.
    """
    if len(a) < 10 or not (found := FIXED.change(a, b)).low <= 0 <= found.high:
        return None
    left_out = np.log((b.sum() - b) / (a.sum() - a))
    shares = (left_out - left_out.mean()) ** 2
    return int(shares.argmax()) if shares.max() > 0.75 * shares.sum() else None


def share(shares: Array) -> Interval:
    """Return the mean of per-trial shares in [0, 1], such as the share of robots that diverged: Wilson's interval.

    Robots of a trial are not independent: Wilson's n is the effective one, p (1 - p) over the squared standard error
    between trials, reduced for its degrees of freedom (Korn & Graubard 1998), and at least the number of trials. The
    formula is here because importing statsmodels, which has it, takes a second.
    """
    m, p = len(shares), float(np.mean(shares)) if len(shares) else np.nan
    if m < LEAST_TRIALS or not np.isfinite(p):
        return Interval(p, np.nan, np.nan)
    variance = float(shares.var(ddof=1)) / m
    effective = p * (1 - p) / variance * (Z / quantile(m)) ** 2 if variance > 0 else 0.0
    n = max(effective, float(m))
    middle, half = p + Z**2 / (2 * n), Z * np.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2))
    low, high = ((middle + side * half) / (1 + Z**2 / n) for side in (-1, 1))
    return Interval(p, max(float(low), 0.0), min(float(high), 1.0))


def rank_biserial(a: Array, b: Array) -> float:
    """Return the matched-pairs rank-biserial effect of b - a in [-1, 1] (Kerby 2014); negative where b is smaller."""
    d = (b - a)[b != a]
    ranks = pd.Series(np.abs(d)).rank().to_numpy(float)  # as scipy.stats.rankdata, which takes a second to import
    return float((ranks * np.sign(d)).sum() / ranks.sum()) if len(d) else 0.0


def equivalence(a: Array, b: Array, margin: float = MARGIN) -> float:
    """Return p against "the RMSE of b is not within 1/(1 + margin) .. 1 + margin times that of a"; small means a tie.

    Of squared errors `a`, `b` (k,), paired: two one-sided tests (Schuirmann 1987), each that of `change`.
    """
    if len(a) < LEAST_TRIALS:
        return np.nan
    least = (1 + margin) ** -2
    return 0.0 if np.array_equal(a, b) else max(FIXED.p_above(a, b, least), FIXED.p_above(b, a, least))


def expected_false(p: Array) -> float:
    """Return how many of a family's decisions at 5 % are expected to be false, from its p-values; nan: not tested.

    5 % of the tests whose null hypothesis is true, of which there are about (1 + number of p above 0.5) / 0.5 (J. D.
    Storey, J. E. Taylor, D. Siegmund, J. Royal Statistical Society B 66, 2004).
    """
    tested = p[~np.isnan(p)]
    return (1 - LEVEL) * 2 * (1 + int((tested > 0.5).sum())) if len(tested) else 0.0


def holm(p: Array) -> Array:
    """Return Holm's adjusted p over a family; nan (no test) stays nan and does not count.

    As `multipletests` of statsmodels, which collects all garbage at every call: a third of a second in a large process.
    """
    order = np.argsort(p)[: np.count_nonzero(~np.isnan(p))]  # nan comes last
    adjusted = np.full(p.shape, np.nan)
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(order), 0, -1)), 1.0)
    return adjusted
