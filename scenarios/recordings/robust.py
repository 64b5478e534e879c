"""Least squares that one bad recording cannot turn: Huber's.

Source: P. J. Huber, E. M. Ronchetti, "Robust Statistics", 2nd ed., 2009, secs. 7.7 and 7.8 (proposal 2, by iterated
weights).
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from cooploc.estimators.interface import Array

K = 1.345  # [standard deviations] a larger residual counts linearly: 95 % efficient where all are Gaussian
# E min(z^2, K^2) of a standard normal z
INSIDE = float(2 * norm.cdf(K) - 1 - 2 * K * norm.pdf(K) + 2 * K**2 * norm.sf(K))
ROUNDS, SETTLED, LEAST = 100, 1e-9, 1e-9


class Line(NamedTuple):
    """y = X beta + noise."""

    beta: Array  # (p,)
    sigma: float  # standard deviation of the Gaussian core of the noise


def huber(X: Array, y: Array) -> Line:
    """Minimise sum rho((y - X beta)/sigma), with sigma^2 = mean min(r^2, K^2 sigma^2) / INSIDE.

    Args:
        X: (m, p) of full rank; p may be 0, and then the line is that of sigma about zero.
        y: (m,), m > p.

    """
    m, p = X.shape
    beta = np.asarray(np.linalg.lstsq(X, y)[0], float)
    sigma = _spread(y - X @ beta)
    for _ in range(ROUNDS):
        scale = max(sigma, LEAST)
        root = np.sqrt(np.minimum(1, K * scale / np.maximum(np.abs(y - X @ beta), LEAST)))
        beta = np.asarray(np.linalg.lstsq(X * root[:, None], y * root)[0], float)
        r = y - X @ beta
        sigma = float(np.sqrt(np.minimum(r**2, (K * scale) ** 2).sum() / ((m - p) * INSIDE)))
        if abs(sigma - scale) <= SETTLED * scale:
            break
    return Line(beta, sigma)


def _spread(r: Array) -> float:
    """A first sigma: the median residual's, or the plain one where more than half are zero."""
    return float(np.median(np.abs(r)) / norm.ppf(0.75)) or float(np.sqrt((r**2).mean()))
