"""How many trials a comparison needs: for an interval of a width, or to exclude a value."""

import numpy as np
from scipy import stats

from cooploc.analysis.metrics.statistics import LEAST_TRIALS, Interval, Z, quantile

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


def _spread(interval: Interval, n: int) -> float:
    """The standard deviation of one trial's share in an interval over n, by its wider side."""
    half = max(interval.value - interval.low, interval.high - interval.value)
    return half * np.sqrt(n) / quantile(n) if n >= LEAST_TRIALS else np.nan


def _trials(needed: float) -> float:
    return float(max(np.ceil(needed), LEAST_TRIALS)) if np.isfinite(needed) else np.nan
