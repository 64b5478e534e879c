"""The weights of several sources: a closed form for two, Newton's method with a certificate for more.

sum w_k g_k = 1 for the gradient g of criterion.py, and as both criteria are convex no weights can do better than these
by more than max g_k - 1, relatively: the certified duality gap, which is zero at the optimum (the equivalence theorem:
J. Kiefer, J. Wolfowitz, "The equivalence of two extremum problems", Canad. J. Math. 1960).

Each fusion is a loop of its own, so its bits do not depend on what else is in the call.
"""

import numpy as np

from cooploc.estimators.compiled.jit import strict_inlined, strict_kernel
from cooploc.estimators.covariance_intersection.criterion import GAP, evaluate, sensitivity
from cooploc.estimators.covariance_intersection.newton import newton_step, reach, step_length, support
from cooploc.estimators.covariance_intersection.small_matrices import (
    FIRST,
    SLOPE,
    STEP,
    WEIGHT,
    C,
    G,
    Q,
    Y,
    combine,
    inner,
    load,
)

ROUNDS = 200


@strict_inlined
def _adjugate_inner(M, a, b):
    """tr(adj(a) b) of symmetric 2 x 2 matrices, linear in each."""
    return M[a, 0, 0] * M[b, 1, 1] + M[a, 1, 1] * M[b, 0, 0] - 2 * M[a, 0, 1] * M[b, 0, 1]


@strict_inlined
def _best_of_two(M, i, j, trace):
    """The weight of B_i beside B_j, d = 2, in closed form.

    det(u B_i + v B_j) = bi u^2 + x u v + bj v^2, and the trace is (ni u + nj v) over that; ni = nj = 1 stands for the
    determinant. The slopes in u and in v are equal where a u^2 + 2 h u v - c v^2 = 0. Source i alone is best where
    a <= 0, source j where c <= 0 (nested covariances), and both are where the two are equal.
    """
    bi, bj = _adjugate_inner(M, i, i) / 2, _adjugate_inner(M, j, j) / 2
    x = _adjugate_inner(M, i, j)
    ni, nj = (_adjugate_inner(M, C, i), _adjugate_inner(M, C, j)) if trace else (1.0, 1.0)
    a, h, c = ni * (x - bi) - nj * bi, ni * bj - nj * bi, nj * (x - bj) - ni * bj
    if a <= 0.0 or c <= 0.0:
        return 0.5 * (1.0 + (a <= 0.0) - (c <= 0.0))
    root = np.sqrt(h * h + a * c)
    return c / (c + h + root) if h >= 0.0 else (root - h) / (root - h + a)


@strict_inlined
def _best_source(M, R, present, trace, axes):
    """The source that would do best alone."""
    best, least = -1, np.inf
    for k in range(R.shape[1]):
        if present[k]:
            value = evaluate(M, FIRST + k, trace, len(axes), axes)
            best, least = (k, value) if value < least else (best, least)
    return best


@strict_inlined
def _gradient(M, R, trace, axes):
    """g_k = tr(G B_k) at Y = sum w_k B_k: where it is greatest, and the gap max g_k - 1."""
    combine(M, R, WEIGHT, Y, axes)
    if not sensitivity(M, Y, trace, axes):
        return 0, np.inf
    best = 0
    for k in range(R.shape[1]):
        R[SLOPE, k] = inner(M, G, FIRST + k, axes)
        best = k if R[SLOPE, k] > R[SLOPE, best] else best
    return best, R[SLOPE, best] - 1.0


@strict_inlined
def _start(M, R, present, trace, axes):
    """The best source alone; with d = 2 beside the one that it misses most, which is the answer where two are present.

    Returns the index of the best source, -1 where none is present.
    """
    best = _best_source(M, R, present, trace, axes)
    if best >= 0:
        R[WEIGHT, best] = 1.0
    if best >= 0 and len(axes) == 2:
        other, gap = _gradient(M, R, trace, axes)
        if gap > GAP:
            R[WEIGHT, best] = _best_of_two(M, FIRST + best, FIRST + other, trace)
            R[WEIGHT, other] = 1.0 - R[WEIGHT, best]
    return best


@strict_inlined
def _descend(M, R, H, chosen, trace, axes):
    """Newton among the sources in use and the one that is most missed, until the gap is GAP; returns it."""
    gap = np.inf
    for _ in range(ROUNDS):
        best, gap = _gradient(M, R, trace, axes)
        if not GAP < gap < np.inf:
            break
        newcomer = best
        for _ in range(2):
            newton_step(M, R, H, chosen, support(R, newcomer, chosen), trace, axes)
            if R[WEIGHT, best] > 0.0 or R[STEP, best] > 0.0:
                break
            newcomer = -1  # it would have to be negative: move the others first
        first, most = reach(R)
        if first < 0:
            break
        combine(M, R, STEP, Q, axes)
        t = step_length(M, most, trace, axes)
        total = 0.0
        for k in range(R.shape[1]):
            R[WEIGHT, k] = 0.0 if k == first and t == most else max(R[WEIGHT, k] + t * R[STEP, k], 0.0)
            total += R[WEIGHT, k]
        for k in range(R.shape[1]):
            R[WEIGHT, k] /= total
    return gap


@strict_kernel
def best(B, C_, present, trace, weights, gap, axes):
    """Weights (K, m) and their gaps (K,) for whitened sources B (K, m, d, d); zeros where no source is present."""
    m, d = B.shape[1], len(axes)
    M, R, H, chosen = np.empty((FIRST + m, d, d)), np.empty((5, m)), np.empty((m, m)), np.empty(m, np.int64)
    for f in range(len(B)):
        load(M, B[f], C_[f], axes)
        R[WEIGHT] = 0.0
        gap[f] = 0.0
        if _start(M, R, present[f], trace, axes) >= 0:
            gap[f] = max(_descend(M, R, H, chosen, trace, axes), 0.0)
        weights[f] = R[WEIGHT]


@strict_kernel
def values(B, C_, trace, weights, value, axes):
    """The criterion (K,) of any weights (K, m)."""
    m, d = B.shape[1], len(axes)
    M, R = np.empty((FIRST + m, d, d)), np.empty((5, m))
    for f in range(len(B)):
        load(M, B[f], C_[f], axes)
        R[WEIGHT] = weights[f]
        combine(M, R, WEIGHT, Y, axes)
        value[f] = evaluate(M, Y, trace, d, axes)
