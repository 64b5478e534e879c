"""The compiled loops of covariance intersection: small matrices, criteria, and the weights of relative readings.

All matrices of one fusion lie in one array M (slots, d, d) and are named by their slots, all vectors in one array R
(2, m): numba counts references to every slice. `axes` is a tuple of d zeros: the length of a tuple is part of its type,
so that numba unrolls the loops over it.
"""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.compiled import inlined, kernel, readable, strict_inlined, strict_kernel
from cooploc.estimators.interface import Array, Indices, Mask

PIVOT = 1e-15  # a Cholesky pivot this small beside its diagonal is rounding

S, U, T, W, G, C, Y, Q, FIRST = range(9)  # slots of M; the terms B_k begin at FIRST
WEIGHT, STEP = range(2)  # slots of R


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
    """Copy one fusion into its slots."""
    for i in range(len(axes)):
        for j in range(len(axes)):
            M[C, i, j] = C_[i, j]
            for k in range(len(B)):
                M[FIRST + k, i, j] = B[k, i, j]


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


# One's own weight for one relative reading: the zero of the criterion's slope in w, in a bracket that certifies it.

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
    M, R = np.empty((FIRST + m, d, d)), np.zeros((2, m))
    for f in range(len(B)):
        load(M, B[f], C_[f], axes)
        weights[f], gap[f] = _search(M, R, sigma[f], trace, block, axes)


@strict_kernel
def values_relative(B, C_, sigma, trace, block, weights, value, axes):
    """The criterion (K,) of any own weights (K,)."""
    m, d = B.shape[1], len(axes)
    M, R = np.empty((FIRST + m, d, d)), np.zeros((2, m))
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


def scalar_weights(P: Array, H: Array, q: Array, R: Array, trace: bool) -> tuple[Array, Array]:
    """One's own weights (K,) and their gaps, for P (K, d, d), H (K, 1, d), q = H_j P_j H_j' (K, 1, 1), R (K, 1, 1)."""
    w, gap = np.empty(len(P)), np.empty(len(P))
    _weights(readable(P), readable(H), readable(q), readable(R), trace, w, gap)
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


# Fusions in the coordinates in which the mean information of their terms is the identity.
#
# B_k = T A_k T' with A_k = V_k' V_k, T = U^-1 and U U' = sum mix_k A_k. The determinant of the fused covariance changes
# by a constant factor, its trace becomes tr(C Y^-1) with C = T T' and Y = sum n_k B_k, and near-singular inputs do no
# harm. U is upper triangular, so that the leading (position) block of Y^-1 stays that of the fused covariance.

FINE, ABSENT, INFINITE, ASYMMETRIC, INDEFINITE, SINGULAR = range(6)

SKEW = 1e-8  # how far P may be from symmetric, as a correlation


class Whitened(NamedTuple):
    """K fusions in these coordinates."""

    B: Array  # (K, 1 + k, d, d)  one's own information, and k terms of rank one for a reading of k numbers
    C: Array  # (K, d, d)  weighs the trace; its trace is 1
    sigma: Array  # (K, k)  of each of these terms
    fusion: Indices  # (K,)  its number in the call, for messages
    group: Indices  # (K,)  fusions of one group may be stacked into one program
    block: int  # the leading states that the criterion is about
    trace: bool  # the trace, else the determinant

    @property
    def axes(self) -> tuple[int, ...]:
        """d zeros, as kernels take d."""
        d: int = self.B.shape[-1]
        return (0,) * d

    def take(self, rows: Indices) -> "Whitened":
        """Some of the fusions."""
        per_fusion = "B", "C", "sigma", "fusion", "group"
        return self._replace(**{name: getattr(self, name)[rows] for name in per_fusion})


@strict_inlined
def _judge(P, axes):
    """Judge a covariance: FINE, ABSENT (a nan, or every variance infinite), or what is wrong with it."""
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
    """T with T' T = scale P^-1, the scale being P's greatest variance; whether P is positive definite."""
    scale = 0.0
    for i in range(len(axes)):
        scale = max(scale, P[i, i])
    if not scale > 0.0:
        return False
    for i in range(len(axes)):
        for j in range(i, len(axes)):
            M[S, i, j] = (P[i, j] + P[j, i]) / (2 * scale)
    if not factor(M, S, axes):
        return False
    invert_factor(M, axes)
    return True


@strict_kernel
def roots(P, V, fault, axes):
    """V with V' V = c P^-1, c the greatest variance of P (K, d, d), and its fault; V is 0 where that is not FINE."""
    M = np.empty((3, len(axes), len(axes)))
    for f in range(len(P)):
        fault[f] = _judge(P[f], axes)
        if fault[f] == FINE and not _root(M, P[f], axes):
            fault[f] = INDEFINITE
        for i in range(len(axes)):
            for j in range(len(axes)):
                V[f, i, j] = M[T, i, j] if fault[f] == FINE else 0.0


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
    """Return whether all of R (K, k, k) are diagonal, with no entry below zero."""
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
    """Write B_k = T A_k T' and C (of the leading block) for mix (K, m), all above zero."""
    m, d = V.shape[1], len(axes)
    M, A = np.empty((3, d, d)), np.empty((m * d, d))
    for f in range(len(V)):
        for k in range(m):
            for i in range(d):
                for j in range(d):
                    A[k * d + i, j] = np.sqrt(mix[f, k]) * V[f, k, i, j]
                    B[f, k, i, j] = 0.0
        if not _orthogonalise(A, M, axes):
            fault[f] = SINGULAR
            continue
        invert_factor(M, axes)
        _weigh(M, C_[f], block, axes)
        for k in range(m):
            for i in range(d):
                for j in range(d):
                    for r in range(k * d, k * d + d):
                        B[f, k, i, j] += A[r, i] * A[r, j] / mix[f, k]
