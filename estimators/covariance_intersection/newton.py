"""One step of Newton's method for the weights of several sources: its direction among those in use, and its length."""

import numpy as np

from cooploc.estimators.compiled.jit import strict_inlined
from cooploc.estimators.covariance_intersection.criterion import sensitivity
from cooploc.estimators.covariance_intersection.small_matrices import (
    FIRST,
    LEFT,
    RIGHT,
    SLOPE,
    STEP,
    WEIGHT,
    G,
    Q,
    T,
    U,
    W,
    X,
    Y,
    inner,
    product,
)

RIDGE = 1e-13  # keeps the Newton system definite where sources nearly coincide


@strict_inlined
def support(R, newcomer, chosen):
    """How many sources are in use, with the newcomer; they are listed in `chosen`."""
    n = 0
    for k in range(R.shape[1]):
        if R[WEIGHT, k] > 0.0 or k == newcomer:
            chosen[n] = k
            n += 1
    return n


@strict_inlined
def _factor_newton(M, R, H, chosen, n, trace, axes):
    """H_kl = tr(G B_k W B_l), twice that for the trace, among the n chosen sources; then its upper root, in place."""
    top = 0.0
    for i in range(n):
        product(M, W, FIRST + chosen[i], T, axes)
        product(M, T, G, U, axes)
        for j in range(i + 1):
            H[j, i] = (2.0 if trace else 1.0) * inner(M, U, FIRST + chosen[j], axes)
        top = max(top, H[i, i])
    for j in range(n - 1, -1, -1):
        H[j, j] += RIDGE * top
        for k in range(j + 1, n):
            H[j, j] -= H[j, k] * H[j, k]
        H[j, j] = np.sqrt(H[j, j])
        for i in range(j):
            for k in range(j + 1, n):
                H[i, j] -= H[i, k] * H[j, k]
            H[i, j] /= H[j, j]


@strict_inlined
def _solve(R, row, H, n):
    """R = (H H')^-1 R for the first n entries of a row."""
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            R[row, i] -= H[i, k] * R[row, k]
        R[row, i] /= H[i, i]
    for i in range(n):
        for k in range(i):
            R[row, i] -= H[k, i] * R[row, k]
        R[row, i] /= H[i, i]


@strict_inlined
def newton_step(M, R, H, chosen, n, trace, axes):
    """The step among the chosen sources that keeps their sum: H step = g - mu 1."""
    _factor_newton(M, R, H, chosen, n, trace, axes)
    for i in range(n):
        R[LEFT, i], R[RIGHT, i] = R[SLOPE, chosen[i]] - 1.0, 1.0
    _solve(R, LEFT, H, n)
    _solve(R, RIGHT, H, n)
    left, right = 0.0, 0.0
    for i in range(n):
        left, right = left + R[LEFT, i], right + R[RIGHT, i]
    for k in range(R.shape[1]):
        R[STEP, k] = 0.0
    for i in range(n):
        R[STEP, chosen[i]] = R[LEFT, i] - left / right * R[RIGHT, i]


@strict_inlined
def reach(R):
    """How far the step can be followed before a weight is zero, and whose."""
    first, reach = -1, np.inf
    for k in range(R.shape[1]):
        if R[STEP, k] < 0.0 and R[WEIGHT, k] < -R[STEP, k] * reach:
            first, reach = k, -R[WEIGHT, k] / R[STEP, k]
    return first, reach


@strict_inlined
def _slope(M, t, trace, axes):
    """The gain per unit of t at Y + t Q; minus infinity where that is not positive definite."""
    for i in range(len(axes)):
        for j in range(len(axes)):
            M[X, i, j] = M[Y, i, j] + t * M[Q, i, j]
    return inner(M, G, Q, axes) if sensitivity(M, X, trace, axes) else -np.inf


@strict_inlined
def step_length(M, reach, trace, axes):
    """How far to go along Q, at most `reach`: near the best point of the line, on its near side.

    Newton's length 1 first, which is all it takes near the optimum; then a bracket, halved in the logarithm, because
    from a nearly singular start the best length may be many orders of magnitude more.
    """
    gain = inner(M, G, Q, axes)
    low, high, closed, t = 0.0, reach, False, min(1.0, reach)
    for _ in range(60):
        slope = _slope(M, t, trace, axes)
        if (t == reach and slope >= 0.0) or (abs(slope) <= 0.1 * gain and (slope >= 0.0 or gain < 0.01)):
            return t
        if slope >= 0.0:
            low = t
        else:
            high, closed = t, True
        if low > 0.0:
            t = np.sqrt(low * high) if closed else reach
            continue
        t = high * max(0.1, gain / (gain - slope))
    return low
