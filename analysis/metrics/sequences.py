"""Confidence sequences: intervals and tests that hold at every number of trials at once, however one stops.

A 95 % interval that is looked at again and again misses the truth sooner or later. These miss it, at any of all looks
from the second trial on, in at most 5 % of runs. They take the t statistic of n differences d, as the t test does:

    t = mean(d) / (s / sqrt(n)),   R = t^2 / (n - 1 + t^2)
    e(n) = sqrt(c^2 / (n + c^2)) (1 - R n / (n + c^2))^(-n/2)

e is the likelihood ratio of "mean(d) / sigma is drawn from N(0, 1 / c^2)" to "mean(d) = 0", any sigma. Where the mean
is 0 its expectation is 1 at every n, and it ever reaches 1 / alpha with probability alpha at most (Ville 1939). The
values theta for which the differences d - theta do not reach it are the sequence: mean(d) -+ b(n) s / sqrt(n).

Exact for normal differences at every n. For others it is asymptotic, as the t interval is; `reports/statistics.md`
measures both. Sources: T. L. Lai, "On confidence sequences", Annals of Statistics 4, 1976; H. Wang, A. Ramdas,
"Anytime-valid t-tests and confidence sequences for Gaussian means with unknown variance", Sequential Analysis 44, 2025
(Gaussian mixture; derived here again from the right Haar prior on sigma); I. Waudby-Smith et al., "Time-uniform central
limit theory and asymptotic confidence sequences", Annals of Statistics 52, 2024.
"""

import numpy as np
from scipy import stats

C2 = 4.0  # c^2: an effect of half a standard deviation is expected; b is smallest near 70 trials
ALPHA = 0.05
LARGEST = 700.0  # logarithm of an e-value, beyond which none is told from another


def boundary(n: float) -> float:
    """b(n): how many standard errors the sequence reaches to either side; nan where it is unbounded (n < 7).

    n may be an effective number of trials.

    b^2 = (n - 1) (K - 1) / (1 - K c^2 / (n + c^2)),  K = ((n + c^2) / (c^2 alpha^2))^(1/n).
    """
    K = ((n + C2) / (C2 * ALPHA**2)) ** (1 / n)
    bounded = 1 - K * C2 / (n + C2)
    return float(np.sqrt((n - 1) * (K - 1) / bounded)) if bounded > 0 else np.nan


def e_value(t: float, n: int) -> float:
    """e(n) of a t statistic over n trials: evidence against a mean of 0; its inverse is a p-value at any stopping.

    Values of e of independent comparisons multiply, those of dependent ones may be averaged.
    """
    return float(np.exp(np.minimum(_log_e(t, n), LARGEST)))


def one_sided_e_value(t: float, n: int) -> float:
    """The same against a mean of at most 0: its prior is the positive half of the normal one.

    2 e P(effect > 0 | d), and the posterior of the effect is one of Student's t with n degrees of freedom.
    """
    R = _explained(t, n)
    S = np.sign(t) * np.sqrt(R * n)  # sum of d, over the root of the sum of d^2; nan where there is no sequence
    positive = stats.t.cdf(np.sqrt(n) * S / np.sqrt((n + C2) * (1 - R * n / (n + C2))), n)
    return float(2 * positive * np.exp(np.minimum(_log_e(t, n), LARGEST)))


def _log_e(t: float, n: int) -> float:
    return float(0.5 * np.log(C2 / (n + C2)) - n / 2 * np.log1p(-_explained(t, n) * n / (n + C2)))


def _explained(t: float, n: int) -> float:
    """R: the share of the sum of d^2 that the mean explains; 1 where d has no spread, nan where there is no t."""
    return 1.0 if np.isinf(t) else t * t / (n - 1 + t * t)
