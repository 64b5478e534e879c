"""Small robust statistics: half of the samples may be wrong."""

import numpy as np
from scipy.stats import median_abs_deviation

from cooploc.estimators.interface import Array

LENGTH_FACTORS = {1000.0: "mm", 100.0: "cm"}
NEAR_FACTOR = 1.25  # a factor of 100 or 1000 is recognised up to this ratio: odometry is calibrated to better than 25 %


def median(values: Array) -> float:
    """The median of the finite values, nan where there is none."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan


def spread(values: Array) -> float:
    """Median absolute deviation, scaled to the standard deviation of a normal distribution; of finite values."""
    known = values[np.isfinite(values)]
    return float(median_abs_deviation(known, scale="normal")) if len(known) else np.nan


def slope(x: Array, y: Array) -> tuple[float, float]:
    """y = b x by least absolute deviations: b, and its standard error as if the residuals were independent.

    b is the median of y/x with weights |x| (Boscovich, Laplace), so samples with little x have little say.
    """
    known = np.isfinite(x) & np.isfinite(y) & (x != 0)
    x, y = x[known], y[known]
    if len(x) < 8:
        return np.nan, np.nan
    ratio, weight = y / x, np.abs(x)
    order = np.argsort(ratio)
    middle = np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)
    b = float(ratio[order][middle])
    error = 1.2533 * spread(y - b * x) / np.sqrt((x**2).sum())
    return b, float(error)


def length_unit(factor: float) -> str:
    """The unit of lengths that come out `factor` times too large when read as metres: mm, cm, or "" for neither."""
    for known, unit in LENGTH_FACTORS.items():
        if factor > 0 and known / NEAR_FACTOR < factor < known * NEAR_FACTOR:
            return unit
    return ""


def concentration(angle: Array) -> tuple[float, float]:
    """Mean resultant length (1: all angles are equal) and mean direction of the finite angles [rad]."""
    known = angle[np.isfinite(angle)]
    if len(known) < 8:
        return 0.0, np.nan
    mean = np.exp(1j * known).mean()
    return float(abs(mean)), float(np.angle(mean))
