"""Covariance intersection: fusing estimates whose correlation is unknown.

Both covariances are inflated, P_i / w and P_j / (1 - w) with 0 < w < 1; their block diagonal matrix is at least the
joint covariance with any possible cross-covariance. A relative measurement y = h(x_i, x_j) + noise of variance R, with
Jacobians H_i and H_j, then gives

    P^-1 = w P_i^-1 + H_i' (H_j P_j H_j' / (1 - w) + R)^-1 H_i.    (1)

This is concave in w, so the w that minimises the determinant or the trace of P is found exactly, or by cvxpy.

Sources: S. J. Julier, J. K. Uhlmann, "A non-divergent estimation algorithm in the presence of unknown correlations",
ACC 1997. (1) L. C. Carrillo-Arce et al., "Decentralized multi-robot cooperative localization using covariance
intersection", IROS 2013.
"""

import logging
from typing import Literal, NamedTuple

import numpy as np

from cooploc.estimators.compiled import inlined, kernel, readable, spread_out, strict_inlined, strict_kernel
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.estimators.kalman import symmetric
from cooploc.estimators.kalman_kernels import fill_product, whiten

Criterion = Literal["det", "trace"]
Solver = Literal["cvxpy", "exact"]

LEAST = 1e-6  # the least weight of one's own belief, so that P / w stays a number to compute with
TRUSTED = 3e-7  # the excess up to which cvxpy's weights are taken: a determinant is then within 1e-6 up to d = 3

log = logging.getLogger("cooploc")


class Solution(NamedTuple):
    """Weights, and where cvxpy did not give them."""

    w: Array  # (K,)  of one's own belief
    fallback: Mask  # (K,)  cvxpy failed here and the exact weight was taken instead


def solve_relative(
    P_i: Array,
    P_j: Array,
    H_i: Array,
    H_j: Array,
    R: Array,
    criterion: Criterion = "trace",
    solver: Solver = "cvxpy",
    block: int = 2,
) -> Solution:
    """Find the best w of (1) for own P_i (K, d, d), received P_j (K, e, e), H_i (K, k, d), H_j (K, k, e), R (k, k).

    w is in [LEAST, 1]. It is 1, which leaves the belief as it is, where anything is nan, where the sender knows nothing
    (every variance infinite), and where the reading cannot help. The criterion is about so many leading states as
    `block` says. "cvxpy" takes states of two numbers. A covariance that is none raises BadInput.
    """
    P_i, P_j = np.array(P_i, float, order="C"), np.array(P_j, float, order="C")
    R = spread_out(np.asarray(R, float), (len(P_i), H_i.shape[1], H_i.shape[1]))
    solution = Solution(np.ones(len(P_i)), np.zeros(len(P_i), bool))
    kind = np.empty(len(P_j), np.int64)
    _fill_kinds(P_j, kind, (0,) * P_j.shape[-1])
    _require(kind != BAD, "P_j", np.arange(len(P_j)))
    absent = [np.isnan(part).any((1, 2)) for part in (P_i, H_i, H_j, R)]
    rows = np.flatnonzero((kind == FINE) & ~np.logical_or.reduce(absent))
    if rows.size == 0 or R.shape[-1] == 0:
        return solution
    P, H, R, U = P_i[rows], H_i[rows], readable(R[rows]), symmetric(H_j @ P_j @ H_j.mT)[rows]
    w, one_number = np.empty(len(rows)), H.shape[1] == 1 and block == 2 <= H.shape[2]
    scalar = ~H[..., 2:].any((1, 2)) if one_number else np.zeros(len(rows), bool)
    _scalar_weights(readable(P), readable(H), readable(U), R, criterion == "trace", scalar, w)
    if solver == "cvxpy" or not scalar.all():
        z, axes = (*_whiten(P, H, U, R, block, rows), criterion == "trace", block), (0,) * P.shape[-1]
        search_weights(*z, scalar, w, axes)
    if solver == "cvxpy":
        from cooploc.estimators import covariance_intersection_cvxpy

        def value(w: Array) -> Array:
            values = np.empty(len(w))
            _fill_values(*z, w, values, axes)
            return values

        found = np.maximum(covariance_intersection_cvxpy.solve(*z[:4]), LEAST)
        found[(value(np.ones_like(w)) <= value(found)) & np.isfinite(found)] = 1.0  # cvxpy only comes near 1
        failed = solution.fallback[rows] = ~(value(found) / value(w) - 1 <= TRUSTED)
        if failed.any():
            log.warning("cvxpy failed on fusions %s; the exact weights are used there", rows[failed].tolist())
        w = np.where(failed, w, found)
    solution.w[rows] = w
    return solution


def _require(good: Mask, name: str, fusion: Indices) -> None:
    if not good.all():
        raise BadInput(
            f"{name} of fusion {fusion[good.argmin()]} is not a covariance to compute with: it must be symmetric and "
            "positive definite by more than rounding, with finite entries, or only infinite variances if unknown"
        )


def _whiten(P: Array, H: Array, U: Array, R: Array, block: int, fusion: Indices) -> tuple[Array, Array, Array]:
    """Return B (K, 1 + k, d, d), C (K, d, d) and sigma (K, k) of `whiten_information`."""
    (K, k, d), kinds = H.shape, np.empty((3, len(P)), np.int64)
    B, C, sigma = np.empty((K, 1 + k, d, d)), np.empty(P.shape), np.empty((K, k))
    whiten_information(P, H, U, R, block, B, C, sigma, kinds, (0,) * d)
    for kind, name in zip(kinds, ("P_i", "H_j P_j H_j' + R", "the information"), strict=True):
        _require(kind == FINE, name, fusion)
    return B, C, sigma


# Compiled loops over small matrices. All matrices of one fusion lie in one array M (slots, d, d) and are named by their
# slots: numba counts references to every slice. `axes` is a tuple of d zeros: the length of a tuple is part of its
# type, so that numba unrolls the loops over it.

PIVOT = 1e-15  # a Cholesky pivot this small beside its diagonal is rounding
SKEW = 1e-8  # how far P may be from symmetric, as a correlation
GAP = 1e-11  # the relative slope times the width of a bracket that ends a search
WIDTH = 1e-15  # of a bracket that cannot be halved any more
SWEEPS = 20  # of rotations, at most: a matrix of two numbers takes one

S, U, T, W, G, C, Y, Q = range(8)  # slots of M
FINE, ABSENT, BAD = range(3)  # kinds of covariances


@strict_inlined
def factor(M, s, axes):
    """Write U, the upper triangular root of matrix s = U U'; return whether that is positive definite."""
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
    """Write T = U^-1, with zeros below."""
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
    """Write W, the inverse of matrix s; return whether that is positive definite."""
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
    """Write matrix c = a b."""
    for i in range(len(axes)):
        for j in range(len(axes)):
            v = 0.0
            for k in range(len(axes)):
                v += M[a, i, k] * M[b, k, j]
            M[c, i, j] = v


@strict_inlined
def inner(M, a, b, scale, axes):
    """Return tr(scale a' b)."""
    v = 0.0
    for i in range(len(axes)):
        for j in range(len(axes)):
            v += scale * M[a, i, j] * M[b, i, j]
    return v


@strict_inlined
def _add_terms(M, B, f, sigma, w, axes):
    """Write Y = w B_0 + sum n_k B_k and Q = dY/dw, with n_k = v / (sigma_k + (1 - sigma_k) v), v = 1 - w."""
    for k in range(B.shape[1]):
        n, slope = w, 1.0
        if k > 0:
            s = sigma[f, k - 1]
            c = s + (1.0 - s) * (1.0 - w)
            n, slope = (1.0 - w) / c, -s / (c * c)
        for i in range(len(axes)):
            for j in range(len(axes)):
                M[Y, i, j] = (M[Y, i, j] if k > 0 else 0.0) + n * B[f, k, i, j]
                M[Q, i, j] = (M[Q, i, j] if k > 0 else 0.0) + slope * B[f, k, i, j]


@strict_inlined
def _slope(M, B, f, sigma, w, trace, block, axes):
    """Return the relative slope in w of tr(C Y^-1) or of the leading block's det^(1/block); nan if Y is singular."""
    _add_terms(M, B, f, sigma, w, axes)
    if not invert(M, Y, axes):
        return np.nan
    if trace:
        product(M, W, C, U, axes)
        product(M, U, W, G, axes)
        return -inner(M, G, Q, 1.0 / inner(M, C, W, 1.0, axes), axes)
    slope = 0.0
    for i in range(len(axes)):
        for j in range(len(axes)):
            for k in range(block):
                slope -= M[T, k, i] * M[T, k, j] * M[Q, i, j] / block
    return slope


@strict_kernel
def search_weights(B, C_, sigma, trace, block, scalar, weights, axes):
    """Write one's own weights in [LEAST, 1] where the slope is zero, for the fusions that are not `scalar`.

    The bracket is halved, and cut where the line between its slopes is zero, in turn.
    """
    M = np.empty((8, len(axes), len(axes)))
    for f in range(len(B)):
        if scalar[f]:
            continue
        for i in range(len(axes)):
            for k in range(len(axes)):
                M[C, i, k] = C_[f, i, k]
        low, high, w, left, right, cut = LEAST, 1.0, 1.0, np.nan, np.nan, False
        slope = _slope(M, B, f, sigma, w, trace, block, axes)
        if slope <= 0.0:
            low = high
        while high - low > WIDTH and not abs(slope) * (high - low) <= GAP:
            w = (low + high) / 2
            if cut and left < 0.0 and right > 0.0:
                w = low + (high - low) * left / (left - right)
            cut = not cut
            slope = _slope(M, B, f, sigma, w, trace, block, axes)
            if slope > 0.0:
                high, right = w, slope
            else:
                low, left = w, slope
        weights[f] = w


@strict_kernel
def _fill_values(B, C_, sigma, trace, block, weights, value, axes):
    """Write tr(C Y^-1), or det^(1/block) of Y^-1's leading block, at any own weights; infinity where Y is singular."""
    M = np.empty((8, len(axes), len(axes)))
    for f in range(len(B)):
        for i in range(len(axes)):
            for k in range(len(axes)):
                M[C, i, k] = C_[f, i, k]
        _add_terms(M, B, f, sigma, weights[f], axes)
        if not invert(M, Y, axes):
            value[f] = np.inf
        elif trace:
            value[f] = inner(M, C, W, 1.0, axes)
        else:
            value[f] = 1.0  # of T'T's leading block, T being upper triangular
            for i in range(block):
                value[f] *= M[T, i, i] ** (2.0 / block)


@strict_inlined
def _kind(P, axes):
    """Return FINE, ABSENT (a nan, or every variance infinite), or BAD: not symmetric."""
    vague, skew = 0, False
    for i in range(len(axes)):
        vague += P[i, i] == np.inf
        for j in range(len(axes)):
            if np.isnan(P[i, j]):
                return ABSENT
            skew = skew or abs(P[i, j] - P[j, i]) > SKEW * np.sqrt(abs(P[i, i])) * np.sqrt(abs(P[j, j]))
    return ABSENT if vague == len(axes) else BAD if skew else FINE


@strict_kernel
def root(P, M, axes):
    """Write T with T' T = c P^-1; return the kind of P, and c, its greatest variance."""
    kind, scale = _kind(P, axes), 0.0
    for i in range(len(axes)):
        scale = max(scale, P[i, i])
    for i in range(len(axes)):
        for j in range(i, len(axes)):
            M[S, i, j] = (P[i, j] + P[j, i]) / (2 * scale)
    if kind == FINE and not (scale > 0.0 and factor(M, S, axes)):
        kind = BAD
    if kind == FINE:
        invert_factor(M, axes)
    return kind, scale


@strict_kernel
def _fill_kinds(P, kind, axes):
    """Write the kind of each P (K, d, d)."""
    M = np.empty((3, len(axes), len(axes)))
    for f in range(len(P)):
        kind[f], _ = root(P[f], M, axes)


@strict_inlined
def _orthogonalise(A, M, axes):
    """Factor A = Q U' for the rows (n, d) of A, which becomes Q; False where its columns are dependent.

    Gram and Schmidt from the last column to the first, each twice: A'A = U U' is never formed.
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


@strict_kernel
def diagonalise(G, Q):
    """Turn symmetric G (k, k) = V D V' into D, and Q (k, m) into V' Q, by Jacobi's rotations."""
    for _ in range(SWEEPS):
        rest = 0.0
        for p in range(len(G)):
            for q in range(p + 1, len(G)):
                rest += abs(G[p, q])
                if G[p, q] == 0.0:
                    continue
                tau = (G[q, q] - G[p, p]) / (2 * G[p, q])
                t = (1.0 if tau >= 0.0 else -1.0) / (abs(tau) + np.sqrt(1 + tau * tau))
                c = 1 / np.sqrt(1 + t * t)
                s = t * c
                for r in range(len(G)):
                    G[r, p], G[r, q] = c * G[r, p] - s * G[r, q], s * G[r, p] + c * G[r, q]
                for r in range(len(G)):
                    G[p, r], G[q, r] = c * G[p, r] - s * G[q, r], s * G[p, r] + c * G[q, r]
                for r in range(Q.shape[1]):
                    Q[p, r], Q[q, r] = c * Q[p, r] - s * Q[q, r], s * Q[p, r] + c * Q[q, r]
                G[p, q] = G[q, p] = 0.0
        if rest == 0.0:
            return


@strict_kernel
def whiten_information(P, H, U, R, block, B, C_, sigma, kinds, axes):
    """Write the information (1) as w A + sum n_l h_l h_l', in coordinates in which its mean is the identity.

    U = H_j P_j H_j' (K, k, k) and R are diagonal in common coordinates, sigma and 1 - sigma (K, k), and n = v / (sigma
    + (1 - sigma) v) with v = 1 - w. With A_0 = A and A_l = h_l h_l': B_l = T A_l T' (K, 1 + k, d, d), T = F^-1, F F' =
    sum mix_l A_l, F upper triangular: so the leading block of Y^-1 = (sum n_l B_l)^-1 stays that of the fused
    covariance, whose trace is tr(C Y^-1) with C = T E (T E)' / tr, E the first `block` columns of 1. Also write the
    kinds (3, K) of P, of U + R and of the information.
    """
    k, d = H.shape[1], len(axes)
    M, A, mix = np.empty((3, d, d)), np.empty((d + k, d)), np.empty(d + k)
    V, L, G, LU, h = np.empty((k, k)), np.empty((k, k)), np.empty((k, k)), np.empty((k, k)), np.empty((k, d))
    for f in range(len(P)):
        kinds[0, f], scale = root(P[f], M, axes)
        kinds[1, f], kinds[2, f] = BAD, FINE
        for i in range(k):
            for j in range(k):
                V[i, j], L[i, j] = U[f, i, j] + R[f, i, j], 1.0 if i == j else 0.0
        whiten(V, L)
        if kinds[0, f] != FINE or not (V[k - 1, k - 1] > 0.0 and V[k - 1, k - 1] < np.inf):
            continue
        kinds[1, f] = FINE
        fill_product(L, U[f], LU)
        fill_product(LU, L.T, G)
        fill_product(L, H[f], h)
        diagonalise(G, h)
        for i in range(d):
            mix[i] = 0.5  # the information at w = 1/2
            for j in range(d):
                A[i, j] = np.sqrt(0.5) * M[T, i, j] if j >= i else 0.0
        for i in range(k):
            sigma[f, i] = min(max(G[i, i], 1e-15), 1.0)
            mix[d + i] = 1 / (1 + sigma[f, i])
            for j in range(d):
                A[d + i, j] = np.sqrt(mix[d + i]) * (np.sqrt(scale) * h[i, j])
        if not _orthogonalise(A, M, axes):
            kinds[2, f] = BAD
            continue
        invert_factor(M, axes)
        total = 0.0
        for i in range(d):
            for j in range(d):
                C_[f, i, j] = 0.0
                for m in range(block):
                    C_[f, i, j] += M[T, i, m] * M[T, j, m]
            total += C_[f, i, i]
        for i in range(d):
            for j in range(d):
                C_[f, i, j] /= total
                for m in range(1 + k):
                    B[f, m, i, j] = 0.0
                for r in range(d + k):
                    B[f, max(r - d + 1, 0), i, j] += A[r, i] * A[r, j] / mix[r]


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
# (1 - k is |P u'|^2 / (t h)). The left side is convex and grows with v: Newton's method falls to the root from any v
# above it, such as those that e >= q and r >= v give. Where it exceeds the level at v = 0 the reading cannot help.

CERTAIN = 1e-15  # the least share of the sender in a reading's variance: below, w would be 1 to the last bit
CLOSE = 1e-9  # a Newton step this small, relatively, is the last one: its square is rounding
STEPS = 100  # never needed: 11 were the most where variances lay ten decades apart


@inlined
def weight_equation(xx, xy, yy, ux, uy, q, R, trace):
    """Return q, rho, b, c and the level; the level is 0 where the reading says nothing."""
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
    """Return v in [0, 1 - LEAST], from the lesser of those that e >= q and r >= v leave of the equation."""
    rest = level - q * q
    if not rest > 0.0:
        return 0.0
    r = rest / (b * q + np.sqrt((b * q) * (b * q) + c * rest))
    half = q * (rho + b)
    v = rest / (half + np.sqrt(half * half + (rho * rho + 2 * b * rho + c) * rest))
    v = min(min(r / (1 + r), v), 1 - LEAST)
    for _ in range(STEPS):
        w = 1 - v
        r, e = v / w, q + rho * v
        left = e * e + r * (2 * b * e + c * r)
        slope = 2 * (rho * (e + b * r) + (b * e + c * r) / (w * w))
        step = (left - level) / slope
        if not step > 0.0:
            break
        v -= step
        if step < CLOSE * min(v, 1 - v):
            break
    return v


@kernel
def _scalar_weights(P, H, q, R, trace, scalar, weights):
    for f in range(len(P)):
        if scalar[f]:
            part = P[f, 0, 0], P[f, 0, 1], P[f, 1, 1], H[f, 0, 0], H[f, 0, 1], q[f, 0, 0], R[f, 0, 0]
            weights[f] = 1 - weight_root(*weight_equation(*part, trace))


@strict_kernel
def least_weight(P, H, U, R, trace, block, axes):
    """Return the exact weight of one's own P (d, d) in a reading by H (k, d) with U = H_j P_j H_j' and R (k, k).

    It is nan where P, U + R or the information is not positive definite.
    """
    k, d = H.shape
    B, C, sigma = np.empty((1, 1 + k, d, d)), np.empty((1, d, d)), np.empty((1, k))
    kinds, w = np.empty((3, 1), np.int64), np.empty(1)
    one = P.reshape((1, d, d)), H.reshape((1, k, d)), U.reshape((1, k, k)), R.reshape((1, k, k))
    whiten_information(*one, block, B, C, sigma, kinds, axes)
    for i in range(len(kinds)):
        if kinds[i, 0] != FINE:
            return np.nan
    search_weights(B, C, sigma, trace, block, np.zeros(1, np.bool_), w, axes)
    return w[0]
