"""One's own weight for one relative reading: the zero of the criterion's slope in w, in a bracket that certifies it.

Each fusion is a loop of its own, so its bits do not depend on what else is in the call.
"""

import numpy as np

from cooploc.estimators.compiled.jit import strict_inlined, strict_kernel
from cooploc.estimators.covariance_intersection.criterion import GAP, LEAST, evaluate, sensitivity
from cooploc.estimators.covariance_intersection.small_matrices import (
    FIRST,
    STEP,
    WEIGHT,
    G,
    Q,
    T,
    Y,
    combine,
    inner,
    load,
)

WIDTH = 1e-15  # of a bracket that cannot be halved any more


@strict_inlined
def _relative(M, R, sigma, w, axes):
    """Y = w B_0 + sum n_k B_k and Q = dY/dw, with n_k = v / (sigma_k + (1 - sigma_k) v), v = 1 - w."""
    R[WEIGHT, 0], R[STEP, 0] = w, 1.0
    for k in range(len(sigma)):
        c = sigma[k] + (1.0 - sigma[k]) * (1.0 - w)
        R[WEIGHT, k + 1], R[STEP, k + 1] = (1.0 - w) / c, -sigma[k] / (c * c)
    combine(M, R, WEIGHT, Y, axes)
    combine(M, R, STEP, Q, axes)


@strict_inlined
def _relative_slope(M, R, sigma, w, trace, block, axes):
    """The criterion's relative slope in w; nan where Y is singular."""
    _relative(M, R, sigma, w, axes)
    if not sensitivity(M, Y, trace, axes):
        return np.nan
    if trace:
        return -inner(M, G, Q, axes)
    slope = 0.0
    for i in range(len(axes)):
        for j in range(len(axes)):
            for k in range(block):
                slope -= M[T, k, i] * M[T, k, j] * M[Q, i, j] / block
    return slope


@strict_inlined
def _search(M, R, sigma, trace, block, axes):
    """One's own weight in [LEAST, 1] where the slope is zero, and the gap: |slope| times the width of a bracket.

    The bracket is halved, and cut where the line between its slopes is zero, in turn.
    """
    low, high, w, left, right = LEAST, 1.0, 1.0, np.nan, np.nan
    slope = _relative_slope(M, R, sigma, w, trace, block, axes)
    if slope <= 0.0:
        return 1.0, 0.0
    cut = False
    while high - low > WIDTH and not abs(slope) * (high - low) <= GAP:
        w = (low + high) / 2
        if cut and left < 0.0 and right > 0.0:
            w = low + (high - low) * left / (left - right)
        cut = not cut
        slope = _relative_slope(M, R, sigma, w, trace, block, axes)
        if slope > 0.0:
            high, right = w, slope
        else:
            low, left = w, slope
    return w, abs(slope) * (high - low)


@strict_kernel
def best(B, C_, sigma, trace, block, weights, gap, axes):
    """One's own weights (K,) and their gaps (K,)."""
    m, d = B.shape[1], len(axes)
    M, R = np.empty((FIRST + m, d, d)), np.zeros((5, m))
    for f in range(len(B)):
        load(M, B[f], C_[f], axes)
        weights[f], gap[f] = _search(M, R, sigma[f], trace, block, axes)


@strict_kernel
def values(B, C_, sigma, trace, block, weights, value, axes):
    """The criterion (K,) of any own weights (K,)."""
    m, d = B.shape[1], len(axes)
    M, R = np.empty((FIRST + m, d, d)), np.zeros((5, m))
    for f in range(len(B)):
        load(M, B[f], C_[f], axes)
        _relative(M, R, sigma[f], weights[f], axes)
        value[f] = evaluate(M, Y, trace, block, axes)
