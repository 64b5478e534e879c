"""The compiled loops of covariance intersection: small matrices, criteria, and the weights of every kind of fusion.

All matrices of one fusion lie in one array M (slots, d, d) and are named by their slots, all vectors in one array R
(5, m): numba counts references to every slice. `axes` is a tuple of d zeros: the length of a tuple is part of its type,
so that numba unrolls the loops over it.
"""

from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.compiled import inlined, kernel, readable, strict_inlined, strict_kernel
from cooploc.estimators.interface import Array, Indices, Mask

PIVOT = 1e-15  # a Cholesky pivot this small beside its diagonal is rounding

S, U, T, W, G, C, Y, Q, X, FIRST = range(10)  # slots of M; the sources B_k begin at FIRST
WEIGHT, SLOPE, STEP, LEFT, RIGHT = range(5)  # slots of R


@strict_inlined
def factor(M, s, axes):
    """U = the upper triangular root of matrix s = U U', and whether that is positive definite. Reads the upper half."""
    d = len(axes)
    for j in range(d - 1, -1, -1):
        for i in range(j, -1, -1):
            v = M[s, i, j]
            for k in range(j + 1, d):
                v -= M[U, i, k] * M[U, j, k]
            if i < j:
                M[U, i, j] = v / M[U, j, j]
            elif v > PIVOT * M[s, j, j] and v < np.inf:
                M[U, j, j] = np.sqrt(v)
            else:
                return False
    return True


@strict_inlined
def invert_factor(M, axes):
    """T = U^-1, with zeros below."""
    for j in range(len(axes)):
        M[T, j, j] = 1.0 / M[U, j, j]
        for i in range(j - 1, -1, -1):
            v = 0.0
            for k in range(i + 1, j + 1):
                v -= M[U, i, k] * M[T, k, j]
            M[T, i, j] = v * M[T, i, i]
            M[T, j, i] = 0.0


@strict_inlined
def invert(M, s, axes):
    """W = the inverse of matrix s, and whether that is positive definite."""
    if not factor(M, s, axes):
        return False
    invert_factor(M, axes)
    for i in range(len(axes)):
        for j in range(i, len(axes)):
            v = 0.0
            for k in range(i + 1):
                v += M[T, k, i] * M[T, k, j]
            M[W, i, j] = M[W, j, i] = v
    return True


@strict_inlined
def product(M, a, b, c, axes):
    """Matrix c = a b."""
    for i in range(len(axes)):
        for j in range(len(axes)):
            v = 0.0
            for k in range(len(axes)):
                v += M[a, i, k] * M[b, k, j]
            M[c, i, j] = v


@strict_inlined
def inner(M, a, b, axes):
    """tr(a' b)."""
    v = 0.0
    for i in range(len(axes)):
        for j in range(len(axes)):
            v += M[a, i, j] * M[b, i, j]
    return v


@strict_inlined
def copy(M, a, matrix, axes):
    """Matrix a = the given one."""
    for i in range(len(axes)):
        for j in range(len(axes)):
            M[a, i, j] = matrix[i, j]


@strict_inlined
def combine(M, R, row, a, axes):
    """Matrix a = sum R_k B_k."""
    for i in range(len(axes)):
        for j in range(len(axes)):
            M[a, i, j] = 0.0
    for k in range(R.shape[1]):
        if R[row, k] != 0.0:
            for i in range(len(axes)):
                for j in range(len(axes)):
                    M[a, i, j] += R[row, k] * M[FIRST + k, i, j]


@strict_inlined
def load(M, B, C_, axes):
    """One fusion into its slots."""
    copy(M, C, C_, axes)
    for k in range(len(B)):
        copy(M, FIRST + k, B[k], axes)


# The criteria of covariance intersection, trace and determinant of the fused covariance, and their gradient.
#
# Both have a gradient g_k = tr(G B_k): G = Y^-1 / d for the logarithm of the determinant (per dimension), and G = Y^-1
# C Y^-1 / tr(C Y^-1) for the trace.

LEAST = 1e-6  # the least weight of one's own belief, so that P / w stays a number to compute with
GAP = 1e-11  # the duality gap that ends a search


@strict_inlined
def evaluate(M, y, trace, block, axes):
    """The criterion at matrix y: tr(C Y^-1), or det^(1/b) of Y^-1's leading block; infinity where y is singular."""
    if not invert(M, y, axes):
        return np.inf
    if trace:
        return inner(M, C, W, axes)
    value = 1.0  # of T'T's leading block, T being upper triangular
    for i in range(block):
        value *= M[T, i, i] ** (2.0 / block)
    return value


@strict_inlined
def sensitivity(M, y, trace, axes):
    """G and W of matrix y; whether that is positive definite."""
    if not invert(M, y, axes):
        return False
    if trace:
        product(M, W, C, U, axes)
        product(M, U, W, G, axes)
    scale = 1.0 / inner(M, C, W, axes) if trace else 1.0 / len(axes)
    for i in range(len(axes)):
        for j in range(len(axes)):
            M[G, i, j] = scale * (M[G, i, j] if trace else M[W, i, j])
    return True


# One step of Newton's method for the weights of several sources: its direction among those in use, and its length.

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


# The weights of several sources: a closed form for two, Newton's method with a certificate for more.
#
# sum w_k g_k = 1 for the gradient g above, and as both criteria are convex no weights can do better than
# these by more than max g_k - 1, relatively: the certified duality gap, which is zero at the optimum (the equivalence
# theorem: J. Kiefer, J. Wolfowitz, "The equivalence of two extremum problems", Canad. J. Math. 1960).
#

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
def _start_several(M, R, present, trace, axes):
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
def best_of_several(B, C_, present, trace, weights, gap, axes):
    """Weights (K, m) and their gaps (K,) for whitened sources B (K, m, d, d); zeros where no source is present."""
    m, d = B.shape[1], len(axes)
    M, R, H, chosen = np.empty((FIRST + m, d, d)), np.empty((5, m)), np.empty((m, m)), np.empty(m, np.int64)
    for f in range(len(B)):
        load(M, B[f], C_[f], axes)
        R[WEIGHT] = 0.0
        gap[f] = 0.0
        if _start_several(M, R, present[f], trace, axes) >= 0:
            gap[f] = max(_descend(M, R, H, chosen, trace, axes), 0.0)
        weights[f] = R[WEIGHT]


@strict_kernel
def values_of_several(B, C_, trace, weights, value, axes):
    """The criterion (K,) of any weights (K, m)."""
    m, d = B.shape[1], len(axes)
    M, R = np.empty((FIRST + m, d, d)), np.empty((5, m))
    for f in range(len(B)):
        load(M, B[f], C_[f], axes)
        R[WEIGHT] = weights[f]
        combine(M, R, WEIGHT, Y, axes)
        value[f] = evaluate(M, Y, trace, d, axes)


# One's own weight for one relative reading: the zero of the criterion's slope in w, in a bracket that certifies it.
#

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
def best_relative(B, C_, sigma, trace, block, weights, gap, axes):
    """One's own weights (K,) and their gaps (K,)."""
    m, d = B.shape[1], len(axes)
    M, R = np.empty((FIRST + m, d, d)), np.zeros((5, m))
    for f in range(len(B)):
        load(M, B[f], C_[f], axes)
        weights[f], gap[f] = _search(M, R, sigma[f], trace, block, axes)


@strict_kernel
def values_relative(B, C_, sigma, trace, block, weights, value, axes):
    """The criterion (K,) of any own weights (K,)."""
    m, d = B.shape[1], len(axes)
    M, R = np.empty((FIRST + m, d, d)), np.zeros((5, m))
    for f in range(len(B)):
        load(M, B[f], C_[f], axes)
        _relative(M, R, sigma[f], weights[f], axes)
        value[f] = evaluate(M, Y, trace, block, axes)


# One scalar reading of a teammate: the weight of one's own belief in covariance intersection, by Newton's method.
#
# For one's own position block P and a reading with row u, variance q / (1 - w) from the sender and R of its own: with h
# = u P u', t = tr P, and in units of h (q/h, R/h are called q and rho), v = 1 - w, r = v / w and e = q + rho v,
#
#     trace = t (w e + k v) / (w (w e + v)),   k = |u|^2 det P / (t h),    det = det P e / (w (w e + v)).
#
# Their slopes in w are zero where
#
#     e^2 + 2 b r e + c r^2 = level:   b = c = k, level = q (1 - k) for the trace;   b = 1/4, c = 0, level = q/2 for det
#
# (1 - k is |P u'|^2 / (t h), which needs no difference). The left side is convex and grows with v, so Newton's method
# falls from any v above the root to it and never passes it. Such a v, close by, comes of e >= q and of r >= v: either
# makes the equation quadratic. Where the left side exceeds the level at v = 0 the reading cannot help and w is 1.

CERTAIN = 1e-15  # the least share of the sender in a reading's variance: below, w would be 1 to the last bit
CLOSE = 1e-9  # a Newton step this small, relatively, is the last one: its square is rounding
STEPS = 100  # never needed: 11 were the most where variances lay ten decades apart


def is_scalar(H: Array, block: int) -> Mask:
    """Readings (K,) with Jacobian H (K, k, d) that this file is for: one number, a function of the position alone."""
    if not (H.shape[1] == 1 and block == 2 <= H.shape[2]):
        return np.zeros(len(H), bool)
    return np.asarray(~H[..., 2:].any((1, 2)))


def scalar_weights(P: Array, H: Array, q: Array, R: Array, criterion: str) -> tuple[Array, Array]:
    """One's own weights (K,) and their gaps, for P (K, d, d), H (K, 1, d), q = H_j P_j H_j' (K, 1, 1), R (K, 1, 1)."""
    w, gap = np.empty(len(P)), np.empty(len(P))
    _weights(readable(P), readable(H), readable(q), readable(R), criterion == "trace", w, gap)
    return w, gap


@inlined
def _start_root(q, rho, b, c, rest):
    """A v that is not below the root: the lesser of what e >= q and r >= v leave of the equation."""
    r = rest / (b * q + np.sqrt((b * q) * (b * q) + c * rest))
    half = q * (rho + b)
    v = rest / (half + np.sqrt(half * half + (rho * rho + 2 * b * rho + c) * rest))
    return min(min(r / (1 + r), v), 1 - LEAST)


@inlined
def _left_side(q, rho, b, c, v):
    """e^2 + 2 b r e + c r^2, and its slope in v."""
    w = 1 - v
    r, e = v / w, q + rho * v
    return e * e + r * (2 * b * e + c * r), 2 * (rho * (e + b * r) + (b * e + c * r) / (w * w))


@inlined
def weight_equation(xx, xy, yy, ux, uy, q, R, trace):
    """q, rho, b, c and the level; the level is 0 where the reading says nothing."""
    gx, gy = xx * ux + xy * uy, xy * ux + yy * uy
    h, t = gx * ux + gy * uy, xx + yy
    if not h > 0.0:
        return 1.0, 0.0, 0.0, 0.0, 0.0
    q = max(q, CERTAIN * (q + R)) / h
    if not trace:
        return q, R / h, 0.25, 0.0, q / 2
    k = max(xx * yy - xy * xy, 0.0) / t * ((ux * ux + uy * uy) / h)
    return q, R / h, k, k, q * ((gx / t) * (gx / h) + (gy / t) * (gy / h))


@inlined
def weight_root(q, rho, b, c, level):
    """v in [0, 1 - LEAST]."""
    rest = level - q * q
    if not rest > 0.0:
        return 0.0
    v = _start_root(q, rho, b, c, rest)
    for _ in range(STEPS):
        left, slope = _left_side(q, rho, b, c, v)
        step = (left - level) / slope
        if not step > 0.0:
            break
        v -= step
        if step < CLOSE * min(v, 1 - v):
            break
    return v


@kernel
def _weights(P, H, q, R, trace, out, gap):
    for f in range(len(P)):
        part = P[f, 0, 0], P[f, 0, 1], P[f, 1, 1], H[f, 0, 0], H[f, 0, 1], q[f, 0, 0], R[f, 0, 0]
        q_, rho, b, c, level = weight_equation(*part, trace)
        v = weight_root(q_, rho, b, c, level)
        w = out[f] = 1 - v
        gap[f] = 0.0
        if 0.0 < v < 1 - LEAST:  # the relative slope, of the determinant's root, times the width of [0, 1]
            e, off = q_ + rho * v, abs(_left_side(q_, rho, b, c, v)[0] - level)
            gap[f] = off / (w * e + v) * (w / (w * e + c * v) if trace else 2 / e)


# Fusions in the coordinates in which their sources' mean information is the identity.
#
# B_k = T A_k T' with A_k = P_k^-1, T = U^-1 and U U' = mean A_k. The determinant of the fused covariance changes by a
# constant factor, its trace becomes tr(C Y^-1) with C = T T' and Y = sum w_k B_k, and near-singular inputs do no harm.
# U is upper triangular, so that the leading (position) block of Y^-1 stays the leading block of the fused covariance.

FINE, ABSENT, INFINITE, ASYMMETRIC, INDEFINITE, SINGULAR = range(6)

SKEW = 1e-8  # how far P may be from symmetric, as a correlation


class Whitened(NamedTuple):
    """K fusions of m sources in these coordinates."""

    B: Array  # (K, m, d, d)  information of the sources; 0 where absent
    C: Array  # (K, d, d)  weighs the trace; its trace is 1
    present: Mask  # (K, m)
    sigma: Array  # (K, k)  of a relative reading: B is one's own and k terms of rank one; else (K, 0)
    fusion: Indices  # (K,)  its number in the call, for messages
    group: Indices  # (K,)  fusions of one group may be stacked into one program
    block: int  # the leading states that the criterion is about
    trace: bool  # the trace, else the determinant

    @property
    def relative(self) -> bool:
        """Whether these are relative readings."""
        return bool(self.sigma.shape[1])

    @property
    def axes(self) -> tuple[int, ...]:
        """d zeros, as kernels take d."""
        d: int = self.B.shape[-1]
        return (0,) * d

    def take(self, rows: Any) -> "Whitened":
        """Some of the fusions."""
        B, C, present, sigma, fusion, group = (array[rows] for array in self[:6])
        return Whitened(B, C, present, sigma, fusion, group, self.block, self.trace)


@strict_inlined
def _judge(P, axes):
    """What a source is: FINE, ABSENT (a nan, or every variance infinite), or what is wrong with it."""
    vague, finite = 0, True
    for i in range(len(axes)):
        vague += P[i, i] == np.inf
        for j in range(len(axes)):
            finite = finite and np.isfinite(P[i, j])
            if np.isnan(P[i, j]):
                return ABSENT
    if not finite:
        return ABSENT if vague == len(axes) else INFINITE
    for i in range(len(axes)):
        for j in range(i):
            if abs(P[i, j] - P[j, i]) > SKEW * np.sqrt(abs(P[i, i])) * np.sqrt(abs(P[j, j])):
                return ASYMMETRIC
    return FINE


@strict_inlined
def _root(M, P, axes):
    """T with T' T = scale P^-1, and the scale, P's greatest variance; zero where P is not positive definite."""
    scale = 0.0
    for i in range(len(axes)):
        scale = max(scale, P[i, i])
    if not scale > 0.0:
        return 0.0
    for i in range(len(axes)):
        for j in range(i, len(axes)):
            M[S, i, j] = (P[i, j] + P[j, i]) / (2 * scale)
    if not factor(M, S, axes):
        return 0.0
    invert_factor(M, axes)
    return scale


@strict_kernel
def roots(P, V, present, fault, axes):
    """V_k' V_k = c P_k^-1 with one c per fusion; which sources are present; what is wrong first, and with which."""
    m, d = P.shape[1], len(axes)
    M, scale = np.empty((3, d, d)), np.empty(m)
    for f in range(len(P)):
        least = np.inf
        for k in range(m):
            verdict = _judge(P[f, k], axes)
            present[f, k] = verdict == FINE
            if verdict == FINE:
                scale[k] = _root(M, P[f, k], axes)
                least = min(least, scale[k])
                verdict = FINE if scale[k] > 0.0 else INDEFINITE
            if verdict > ABSENT and fault[f, 0] == FINE:
                fault[f, 0], fault[f, 1] = verdict, k
            for i in range(d):
                for j in range(d):
                    V[f, k, i, j] = M[T, i, j] if present[f, k] else 0.0
        for k in range(m):
            c = np.sqrt(least / scale[k]) if present[f, k] else 0.0
            for i in range(d):
                for j in range(d):
                    V[f, k, i, j] *= c


@strict_kernel
def complete(parts, there):
    """Clear the rows of `there` (K,) in which anything of some arrays (K, a, b) is nan."""
    for array in parts:
        for f in range(len(array)):
            for i in range(array.shape[1]):
                for j in range(array.shape[2]):
                    there[f] = there[f] and not np.isnan(array[f, i, j])


@strict_kernel
def diagonal(R):
    """Whether all of R (K, k, k) are diagonal, with no entry below zero."""
    for f in range(len(R)):
        for i in range(R.shape[1]):
            for j in range(R.shape[1]):
                if not (R[f, i, j] >= 0.0 if i == j else R[f, i, j] == 0.0):
                    return False
    return True


@strict_inlined
def _orthogonalise(A, M, axes):
    """A = Q U' for the rows (n, d) of A, which becomes Q; False where its columns are dependent.

    Gram and Schmidt from the last column to the first, each twice. A'A = U U' is never formed, so that its condition
    number may be the square of what fits into double precision.
    """
    for j in range(len(axes) - 1, -1, -1):
        before = 0.0
        for r in range(len(A)):
            before += A[r, j] * A[r, j]
        for i in range(j, len(axes)):
            M[U, j, i] = 0.0
        for _ in range(2):
            for i in range(len(axes) - 1, j, -1):
                v = 0.0
                for r in range(len(A)):
                    v += A[r, i] * A[r, j]
                for r in range(len(A)):
                    A[r, j] -= v * A[r, i]
                M[U, j, i] += v
        v = 0.0
        for r in range(len(A)):
            v += A[r, j] * A[r, j]
        if not np.sqrt(v) > PIVOT * np.sqrt(before):
            return False
        M[U, j, j] = np.sqrt(v)
        for r in range(len(A)):
            A[r, j] /= M[U, j, j]
    return True


@strict_inlined
def _weigh(M, C_, block, axes):
    """C = T E (T E)' / tr, with E the first columns of the identity."""
    total = 0.0
    for i in range(len(axes)):
        for j in range(len(axes)):
            C_[i, j] = 0.0
            for k in range(block):
                C_[i, j] += M[T, i, k] * M[T, j, k]
        total += C_[i, i]
    for i in range(len(axes)):
        for j in range(len(axes)):
            C_[i, j] /= total


@strict_kernel
def whiten(V, mix, block, B, C_, fault, axes):
    """B_k = T A_k T' and C (of the leading block), where T = U^-1, U U' = sum mix_k A_k and A_k = V_k' V_k."""
    m, d = V.shape[1], len(axes)
    M, A = np.empty((3, d, d)), np.empty((m * d, d))
    for f in range(len(V)):
        some = False
        for k in range(m):
            some = some or mix[f, k] > 0.0
            for i in range(d):
                for j in range(d):
                    A[k * d + i, j] = np.sqrt(mix[f, k]) * V[f, k, i, j]
                    B[f, k, i, j] = 0.0
        if not some or not _orthogonalise(A, M, axes):
            C_[f] = 0.0
            if some and fault[f, 0] == FINE:
                fault[f, 0] = SINGULAR
            continue
        invert_factor(M, axes)
        _weigh(M, C_[f], block, axes)
        for k in range(m):
            if mix[f, k] > 0.0:
                for i in range(d):
                    for j in range(d):
                        for r in range(k * d, k * d + d):
                            B[f, k, i, j] += A[r, i] * A[r, j] / mix[f, k]
