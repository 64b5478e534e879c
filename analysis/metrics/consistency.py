"""Whether a covariance is consistent: flags by the intervals of ANEES and coverage; the band of a consistent filter."""

import numpy as np
import pandas as pd
import scipy

from cooploc.analysis.metrics.statistics import LEAST_TRIALS, Interval

OVER_CONFIDENT, CONSERVATIVE = 1.5, 0.67  # ANEES limits: the whole interval must lie beyond
COLLAPSED = 100.0  # ANEES of a trial whose errors are ten times as large as their covariance says
# A whole interval of ANEES below it: standard deviations more than three times what the errors ask for. Covariance
# intersection is conservative by right, and far from it: its least upper end in the study of the paper is 0.65.
OVER_WIDE = 0.1
DOUBTFUL = 2 * OVER_CONFIDENT  # ANEES above which an estimator that is not shown consistent cannot be called best
# Share of truths in the 95 % ellipses of Gaussian errors whose ANEES is OVER_CONFIDENT.
LEAST_COVERAGE = 1 - 0.05 ** (1 / OVER_CONFIDENT)


def flag(trials: float, anees: Interval, coverage: Interval) -> str:
    """Return over-confident, over-wide, conservative, consistent or not shown, by 95 % intervals over trials.

    Over-confident: the whole interval of ANEES lies above 1.5, or that of the coverage of the 95 % ellipse below the
    0.86 that goes with it (where a few covariances all but vanished, only coverage tells). Over-wide: the whole
    interval of ANEES lies below 0.1; conservative: below 0.67; consistent: within 0.67 to 1.5; not shown: it holds a
    limit. Below five trials, and without covariances: not assessed.
    """
    if trials < LEAST_TRIALS or np.isnan(anees.value):
        return "not assessed"
    if anees.low > OVER_CONFIDENT or anees.value == np.inf or coverage.high < LEAST_COVERAGE:
        return "over-confident"
    if anees.high < CONSERVATIVE:
        return "over-wide" if anees.high < OVER_WIDE else "conservative"
    return "consistent" if anees.low >= CONSERVATIVE and anees.high <= OVER_CONFIDENT else "not shown"


def consistency(table: pd.DataFrame) -> pd.Series:
    """Return the flag of every row of a table of `summarize`."""
    ends = [table[[name, f"{name}_low", f"{name}_high"]].to_numpy(float) for name in ("anees", "coverage95")]
    flags = [flag(t, Interval(*a), Interval(*c)) for t, a, c in zip(table["trials"], *ends, strict=True)]
    return pd.Series(flags, index=table.index, dtype=object)


def band(count: int, d: int) -> tuple[float, float]:
    """Return the 95 % band of the ANEES over `count` independent d-dimensional errors of a consistent Gaussian filter.

    chi2.ppf([0.025, 0.975], count d) / (count d) (Bar-Shalom, Li & Kirubarajan 2001, sec. 5.4).
    """
    if count < 1:
        return np.nan, np.nan
    low, high = (float(scipy.stats.chi2.ppf(q, count * d)) / (count * d) for q in (0.025, 0.975))
    return low, high
