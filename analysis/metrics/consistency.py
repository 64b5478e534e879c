"""Is a covariance consistent: flags by the intervals of ANEES and coverage; the band of a consistent filter."""

import numpy as np
import pandas as pd
from scipy import stats

from cooploc.analysis.metrics.statistics import LEAST_TRIALS, Interval, share
from cooploc.estimators.interface import Array

OVER_CONFIDENT, CONSERVATIVE = 1.5, 0.67  # ANEES limits: the whole interval must lie beyond
COLLAPSED = 100.0  # ANEES of a trial whose errors are ten times as large as their covariance says
DOUBTFUL = 2 * OVER_CONFIDENT  # an undecided estimator above this ANEES does not qualify as best
# Share of truths in the 95 % ellipses of Gaussian errors whose ANEES is OVER_CONFIDENT.
LEAST_COVERAGE = float(stats.chi2.cdf(stats.chi2.ppf(0.95, 2) / OVER_CONFIDENT, 2))


def flag(trials: float, anees: Interval, coverage: Interval) -> str:
    """over-confident, conservative, consistent or undecided, by 95 % intervals over trials.

    Over-confident: the whole interval of ANEES lies above 1.5, or that of the coverage of the 95 % ellipse below the
    0.86 that goes with it (a few trials whose covariance all but vanished make the interval of ANEES useless, but not
    that of coverage). Conservative: the whole interval of ANEES lies below 0.67. Consistent: ANEES lies between, and
    its interval excludes one of the limits. Undecided: the estimate crosses a limit, but its interval does not exclude
    the limit, or the interval holds both. Below five trials: not assessed.
    """
    if trials < LEAST_TRIALS:
        return "not assessed"
    if anees.low > OVER_CONFIDENT or anees.value == np.inf or coverage.high < LEAST_COVERAGE:
        return "over-confident"
    if anees.high < CONSERVATIVE:
        return "conservative"
    between = CONSERVATIVE <= anees.value <= OVER_CONFIDENT
    return "consistent" if between and (anees.low > CONSERVATIVE or anees.high < OVER_CONFIDENT) else "undecided"


def collapsed(anees: Array) -> Interval:
    """The share of trials whose ANEES exceeds `COLLAPSED`, with Wilson's interval; of trials that have one.

    The mean of ANEES over trials can be that of a single collapsed particle cloud (1e4 to 1e27 occur); this share and
    the median say how a typical trial went, and how many went wrong.
    """
    return share((anees > COLLAPSED).astype(float))


def consistency(table: pd.DataFrame) -> pd.Series:
    """The flag of every row of a table of `summarize`."""
    ends = [table[[name, f"{name}_low", f"{name}_high"]].to_numpy(float) for name in ("anees", "coverage95")]
    flags = [flag(t, Interval(*a), Interval(*c)) for t, a, c in zip(table["trials"], *ends, strict=True)]
    return pd.Series(flags, index=table.index, dtype=object)


def band(count: int, d: int) -> tuple[float, float]:
    """Where the ANEES over `count` independent d-dimensional errors of a consistent Gaussian filter lies, 95 %.

    chi2.ppf([0.025, 0.975], count d) / (count d) (Bar-Shalom, Li & Kirubarajan 2001, sec. 5.4). Errors of one trial's
    ticks and robots are correlated: count trials.
    """
    if count < 1:
        return np.nan, np.nan
    low, high = (float(stats.chi2.ppf(q, count * d)) / (count * d) for q in (0.025, 0.975))
    return low, high
