"""How many trials a comparison needs: for an interval of a width, or to exclude a value."""

import numpy as np
import pandas as pd
from scipy import stats

from cooploc.analysis.metrics.decisions import FIRST
from cooploc.analysis.metrics.sequences import boundary
from cooploc.analysis.metrics.statistics import LEAST_TRIALS, Interval, Z, quantile

PILOT = 10  # trials from which a study is planned
ROUNDS = 8  # of n = f(b(n))
POWER = float(stats.norm.ppf(0.8))  # a planned number of trials succeeds in 4 of 5 repetitions


def trials_for_width(interval: Interval, n: int, half: float) -> float:
    """Trials at which an interval over n of them would be `half` wide to either side; nan without one.

    From n = (z s / h)^2 + (z^2 + 1) / 2, the second term for the t quantile.
    """
    return _trials((Z * _spread(interval, n) / half) ** 2 + (Z * Z + 1) / 2)


def trials_to_exclude(interval: Interval, n: int, distance: float) -> float:
    """Trials whose interval would, in 4 of 5 repetitions, exclude a value this far away; nan without one.

    From n = ((z + z_0.8) s / distance)^2 + z^2 / 2 (Guenther 1981).
    """
    if not distance > 0:
        return np.nan
    return _trials(((Z + POWER) * _spread(interval, n) / distance) ** 2 + Z * Z / 2)


def trials_until_decided(interval: Interval, n: int, distance: float) -> float:
    """As `trials_to_exclude`, by a confidence sequence instead of one look; nan without an interval.

    n = ((b(n) + z_0.8) s / distance)^2, from above: b hardly depends on n.
    """
    if not distance > 0:
        return np.nan
    needed = 10 * trials_to_exclude(interval, n, distance)
    for _ in range(ROUNDS if np.isfinite(needed) else 0):
        needed = ((boundary(needed) + POWER) * _spread(interval, n) / distance) ** 2
        needed = max(needed, float(FIRST))
    return _trials(needed)


def minutes(found: pd.DataFrame, column: str, jobs: int = 1) -> float:
    """How long the estimators of a plan take [min] for the trials of `trials` or `until_decided`, without streams.

    A baseline runs as often as the comparison that needs most in its scenario; one whose need is unknown does not
    count.
    """
    needed = found[column].fillna(0.0)
    own = (needed * found["seconds"]).sum()
    base = (needed * found["baseline_seconds"]).groupby(found["scenario"]).max().sum()
    return float(own + base) / 60 / jobs


def _spread(interval: Interval, n: int) -> float:
    """The standard deviation of one trial's share in an interval over n, by its wider side."""
    half = max(interval.value - interval.low, interval.high - interval.value)
    return half * np.sqrt(n) / quantile(n) if n >= LEAST_TRIALS else np.nan


def _trials(needed: float) -> float:
    return float(max(np.ceil(needed), LEAST_TRIALS)) if np.isfinite(needed) else np.nan
