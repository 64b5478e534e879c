"""When is a covariance honest: flags by the interval of ANEES, and the band of a truly consistent filter."""

import numpy as np
import pandas as pd
from scipy import stats

from cooploc.analysis.statistics import LEAST_TRIALS

OVER_CONFIDENT, CONSERVATIVE = 1.5, 0.67  # ANEES limits: the whole interval must lie beyond


def consistency(table: pd.DataFrame) -> pd.Series:
    """over-confident, conservative, or consistent, by the 95 % interval of ANEES; "not assessed" below five trials.

    An infinite ANEES, of a covariance that vanished, has no interval and is over-confident.
    """
    enough = (table["trials"] >= LEAST_TRIALS).to_numpy()
    infinite = np.isinf(table["anees"].to_numpy(float))
    words = [
        ~enough | (table["anees_low"].isna().to_numpy() & ~infinite),
        (table["anees_low"] > OVER_CONFIDENT).to_numpy() | infinite,
        (table["anees_high"] < CONSERVATIVE).to_numpy(),
    ]
    return pd.Series(
        np.select(words, ["not assessed", "over-confident", "conservative"], "consistent"), index=table.index
    )


def band(count: int, d: int) -> tuple[float, float]:
    """Where the ANEES over `count` independent d-dimensional errors of a consistent Gaussian filter lies, 95 %.

    chi2.ppf([0.025, 0.975], count d) / (count d) (Bar-Shalom, Li & Kirubarajan 2001, sec. 5.4). Errors of one trial's
    ticks and robots are correlated: count trials.
    """
    if count < 1:
        return np.nan, np.nan
    low, high = (float(stats.chi2.ppf(q, count * d)) / (count * d) for q in (0.025, 0.975))
    return low, high
