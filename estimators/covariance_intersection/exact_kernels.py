"""The weights of covariance intersection without a solver: a closed form, and a Newton method with a certificate.

Every fusion is first written in coordinates in which its sources' mean information is the identity,
B_k = T A_k T' with A_k = P_k^-1, T = U^-1 and U U' = mean A_k. The determinant of the fused covariance changes by a
constant factor, its trace becomes tr(C Y^-1) with C = T T' and Y = sum w_k B_k, and near-singular inputs do no harm.
U is upper triangular, so that the leading (position) block of Y^-1 stays the leading block of the fused covariance.

Both criteria have a gradient g_k = tr(G B_k): G = Y^-1 / d for the logarithm of the determinant (per dimension), and
G = Y^-1 C Y^-1 / tr(C Y^-1) for the trace. sum w_k g_k = 1, and as both are convex no weights can do better than these
by more than max g_k - 1, relatively: the certified duality gap, which is zero at the optimum (the equivalence theorem:
J. Kiefer, J. Wolfowitz, "The equivalence of two extremum problems", Canad. J. Math. 1960).

Each fusion is a loop of its own, so its bits do not depend on what else is in the call. The matrices of one fusion lie
in one array M and its vectors in one array R, named by their slots: numba counts references to every slice.
"""

from typing import Any, NamedTuple

import numba
import numpy as np

from cooploc.estimators.interface import Array, Mask

FINE, ABSENT, INFINITE, ASYMMETRIC, INDEFINITE, SINGULAR = range(6)

SKEW = 1e-8  # how far P may be from symmetric, as a correlation
PIVOT = 1e-15  # a Cholesky pivot this small beside its diagonal is rounding
GAP = 1e-11  # the duality gap that ends a search
ROUNDS = 200
WIDTH = 1e-15  # of a bracket that cannot be halved any more
RIDGE = 1e-13  # keeps the Newton system definite where sources nearly coincide
LEAST = 1e-6  # the least weight of one's own belief, so that P / w stays a number to compute with

S, U, T, W, G, C, Y, Q, X, FIRST = range(10)  # slots of M (.., d, d); the sources B_k begin at FIRST
WEIGHT, SLOPE, STEP, LEFT, RIGHT = range(5)  # slots of R (5, m)

# No fastmath at all: nan and infinity mean something here.
compiled = numba.njit(cache=True, error_model="numpy")
inlined = numba.njit(cache=True, error_model="numpy", forceinline=True)


class Prepared(NamedTuple):
    """K fusions of m sources in the coordinates above."""

    B: Array  # (K, m, d, d)  information of the sources; 0 where absent
    C: Array  # (K, d, d)  weighs the trace; its trace is 1
    present: Mask  # (K, m)
    sigma: Array  # (K, k)  of a relative measurement: B is one's own and k terms of rank one; else (K, 0)
    block: int  # the leading states that the criterion is about
    trace: bool  # the trace, else the determinant

    def take(self, rows: Any) -> "Prepared":
        """Some of the fusions."""
        B, C, present, sigma = (array[rows] for array in self[:4])
        return self._replace(B=B, C=C, present=present, sigma=sigma)


# ---------------------------------------------------------------- small matrices
# `axes` has d entries. The length of a tuple is part of its type, so numba unrolls the loops over it.


@inlined
def _factor(M, s, axes):  # type: ignore[no-untyped-def]
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


@inlined
def _invert_factor(M, axes):  # type: ignore[no-untyped-def]
    """T = U^-1, with zeros below."""
    for j in range(len(axes)):
        M[T, j, j] = 1.0 / M[U, j, j]
        for i in range(j - 1, -1, -1):
            v = 0.0
            for k in range(i + 1, j + 1):
                v -= M[U, i, k] * M[T, k, j]
            M[T, i, j] = v * M[T, i, i]
            M[T, j, i] = 0.0


@inlined
def _invert(M, s, axes):  # type: ignore[no-untyped-def]
    """W = the inverse of matrix s, and whether that is positive definite."""
    if not _factor(M, s, axes):
        return False
    _invert_factor(M, axes)
    for i in range(len(axes)):
        for j in range(i, len(axes)):
            v = 0.0
            for k in range(i + 1):
                v += M[T, k, i] * M[T, k, j]
            M[W, i, j] = M[W, j, i] = v
    return True


@inlined
def _product(M, a, b, c, axes):  # type: ignore[no-untyped-def]
    """Matrix c = a b."""
    for i in range(len(axes)):
        for j in range(len(axes)):
            v = 0.0
            for k in range(len(axes)):
                v += M[a, i, k] * M[b, k, j]
            M[c, i, j] = v


@inlined
def _inner(M, a, b, axes):  # type: ignore[no-untyped-def]
    """tr(a' b)."""
    v = 0.0
    for i in range(len(axes)):
        for j in range(len(axes)):
            v += M[a, i, j] * M[b, i, j]
    return v


@inlined
def _copy(M, a, matrix, axes):  # type: ignore[no-untyped-def]
    """Matrix a = the given one."""
    for i in range(len(axes)):
        for j in range(len(axes)):
            M[a, i, j] = matrix[i, j]


@inlined
def _combine(M, R, row, a, axes):  # type: ignore[no-untyped-def]
    """Matrix a = sum R_k B_k."""
    for i in range(len(axes)):
        for j in range(len(axes)):
            M[a, i, j] = 0.0
    for k in range(R.shape[1]):
        if R[row, k] != 0.0:
            for i in range(len(axes)):
                for j in range(len(axes)):
                    M[a, i, j] += R[row, k] * M[FIRST + k, i, j]


# ---------------------------------------------------------------- preparation


@inlined
def _judge(P, axes):  # type: ignore[no-untyped-def]
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


@inlined
def _root(M, P, axes):  # type: ignore[no-untyped-def]
    """T with T' T = scale P^-1, and the scale, P's greatest variance; zero where P is not positive definite."""
    scale = 0.0
    for i in range(len(axes)):
        scale = max(scale, P[i, i])
    if not scale > 0.0:
        return 0.0
    for i in range(len(axes)):
        for j in range(i, len(axes)):
            M[S, i, j] = (P[i, j] + P[j, i]) / (2 * scale)
    if not _factor(M, S, axes):
        return 0.0
    _invert_factor(M, axes)
    return scale


@compiled
def roots(P, V, present, fault, axes):  # type: ignore[no-untyped-def]
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


@inlined
def _orthogonalise(A, M, axes):  # type: ignore[no-untyped-def]
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


@inlined
def _weigh(M, C_, block, axes):  # type: ignore[no-untyped-def]
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


@compiled
def whiten(V, mix, block, B, C_, fault, axes):  # type: ignore[no-untyped-def]
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
        _invert_factor(M, axes)
        _weigh(M, C_[f], block, axes)
        for k in range(m):
            if mix[f, k] > 0.0:
                for i in range(d):
                    for j in range(d):
                        for r in range(k * d, k * d + d):
                            B[f, k, i, j] += A[r, i] * A[r, j] / mix[f, k]


# ---------------------------------------------------------------- the search


@inlined
def _adjugate_inner(M, a, b):  # type: ignore[no-untyped-def]
    """tr(adj(a) b) of symmetric 2 x 2 matrices, linear in each."""
    return M[a, 0, 0] * M[b, 1, 1] + M[a, 1, 1] * M[b, 0, 0] - 2 * M[a, 0, 1] * M[b, 0, 1]


@inlined
def _pair(M, i, j, trace):  # type: ignore[no-untyped-def]
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


@inlined
def _value(M, y, trace, block, axes):  # type: ignore[no-untyped-def]
    """The criterion at matrix y: tr(C Y^-1), or det^(1/b) of Y^-1's leading block; infinity where y is singular."""
    if not _invert(M, y, axes):
        return np.inf
    if trace:
        return _inner(M, C, W, axes)
    value = 1.0  # of T'T's leading block, T being upper triangular
    for i in range(block):
        value *= M[T, i, i] ** (2.0 / block)
    return value


@inlined
def _best_source(M, R, present, trace, axes):  # type: ignore[no-untyped-def]
    """The source that would do best alone."""
    best, least = -1, np.inf
    for k in range(R.shape[1]):
        if present[k]:
            value = _value(M, FIRST + k, trace, len(axes), axes)
            best, least = (k, value) if value < least else (best, least)
    return best


@inlined
def _sensitivity(M, y, trace, axes):  # type: ignore[no-untyped-def]
    """G and W of matrix y; whether that is positive definite."""
    if not _invert(M, y, axes):
        return False
    if trace:
        _product(M, W, C, U, axes)
        _product(M, U, W, G, axes)
    scale = 1.0 / _inner(M, C, W, axes) if trace else 1.0 / len(axes)
    for i in range(len(axes)):
        for j in range(len(axes)):
            M[G, i, j] = scale * (M[G, i, j] if trace else M[W, i, j])
    return True


@inlined
def _gradient(M, R, trace, axes):  # type: ignore[no-untyped-def]
    """g_k = tr(G B_k) at Y = sum w_k B_k: where it is greatest, and the gap max g_k - 1."""
    _combine(M, R, WEIGHT, Y, axes)
    if not _sensitivity(M, Y, trace, axes):
        return 0, np.inf
    best = 0
    for k in range(R.shape[1]):
        R[SLOPE, k] = _inner(M, G, FIRST + k, axes)
        best = k if R[SLOPE, k] > R[SLOPE, best] else best
    return best, R[SLOPE, best] - 1.0


@inlined
def _support(R, newcomer, chosen):  # type: ignore[no-untyped-def]
    """How many sources are in use, with the newcomer; they are listed in `chosen`."""
    n = 0
    for k in range(R.shape[1]):
        if R[WEIGHT, k] > 0.0 or k == newcomer:
            chosen[n] = k
            n += 1
    return n


@inlined
def _factor_newton(M, R, H, chosen, n, trace, axes):  # type: ignore[no-untyped-def]
    """H_kl = tr(G B_k W B_l), twice that for the trace, among the n chosen sources; then its upper root, in place."""
    top = 0.0
    for i in range(n):
        _product(M, W, FIRST + chosen[i], T, axes)
        _product(M, T, G, U, axes)
        for j in range(i + 1):
            H[j, i] = (2.0 if trace else 1.0) * _inner(M, U, FIRST + chosen[j], axes)
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


@inlined
def _solve(R, row, H, n):  # type: ignore[no-untyped-def]
    """R = (H H')^-1 R for the first n entries of a row."""
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            R[row, i] -= H[i, k] * R[row, k]
        R[row, i] /= H[i, i]
    for i in range(n):
        for k in range(i):
            R[row, i] -= H[k, i] * R[row, k]
        R[row, i] /= H[i, i]


@inlined
def _newton(M, R, H, chosen, n, trace, axes):  # type: ignore[no-untyped-def]
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


@inlined
def _reach(R):  # type: ignore[no-untyped-def]
    """How far the step can be followed before a weight is zero, and whose."""
    first, reach = -1, np.inf
    for k in range(R.shape[1]):
        if R[STEP, k] < 0.0 and R[WEIGHT, k] < -R[STEP, k] * reach:
            first, reach = k, -R[WEIGHT, k] / R[STEP, k]
    return first, reach


@inlined
def _slope(M, t, trace, axes):  # type: ignore[no-untyped-def]
    """The gain per unit of t at Y + t Q; minus infinity where that is not positive definite."""
    for i in range(len(axes)):
        for j in range(len(axes)):
            M[X, i, j] = M[Y, i, j] + t * M[Q, i, j]
    return _inner(M, G, Q, axes) if _sensitivity(M, X, trace, axes) else -np.inf


@inlined
def _length(M, reach, trace, axes):  # type: ignore[no-untyped-def]
    """How far to go along Q, at most `reach`: near the best point of the line, on its near side.

    Newton's length 1 first, which is all it takes near the optimum; then a bracket, halved in the logarithm, because
    from a nearly singular start the best length may be many orders of magnitude more.
    """
    gain = _inner(M, G, Q, axes)
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


@inlined
def _descend(M, R, H, chosen, trace, axes):  # type: ignore[no-untyped-def]
    """Newton among the sources in use and the one that is most missed, until the gap is GAP; returns it."""
    gap = np.inf
    for _ in range(ROUNDS):
        best, gap = _gradient(M, R, trace, axes)
        if not GAP < gap < np.inf:
            break
        newcomer = best
        for _ in range(2):
            _newton(M, R, H, chosen, _support(R, newcomer, chosen), trace, axes)
            if R[WEIGHT, best] > 0.0 or R[STEP, best] > 0.0:
                break
            newcomer = -1  # it would have to be negative: move the others first
        first, reach = _reach(R)
        if first < 0:
            break
        _combine(M, R, STEP, Q, axes)
        t = _length(M, reach, trace, axes)
        total = 0.0
        for k in range(R.shape[1]):
            R[WEIGHT, k] = 0.0 if k == first and t == reach else max(R[WEIGHT, k] + t * R[STEP, k], 0.0)
            total += R[WEIGHT, k]
        for k in range(R.shape[1]):
            R[WEIGHT, k] /= total
    return gap


@inlined
def _start(M, R, present, trace, axes):  # type: ignore[no-untyped-def]
    """The best source alone; with d = 2 beside the one that it misses most, which is the answer where two are present.

    Returns the index of the best source, -1 where none is present.
    """
    best = _best_source(M, R, present, trace, axes)
    if best >= 0:
        R[WEIGHT, best] = 1.0
    if best >= 0 and len(axes) == 2:
        other, gap = _gradient(M, R, trace, axes)
        if gap > GAP:
            R[WEIGHT, best] = _pair(M, FIRST + best, FIRST + other, trace)
            R[WEIGHT, other] = 1.0 - R[WEIGHT, best]
    return best


@inlined
def _load(M, R, B, C_, weights, axes):  # type: ignore[no-untyped-def]
    """One fusion into its slots."""
    _copy(M, C, C_, axes)
    for k in range(len(B)):
        _copy(M, FIRST + k, B[k], axes)
        R[WEIGHT, k] = weights[k]


@compiled
def best(B, C_, present, trace, weights, gap, axes):  # type: ignore[no-untyped-def]
    """Weights (K, m) and their gaps (K,) for prepared sources B (K, m, d, d); zeros where no source is present."""
    m, d = B.shape[1], len(axes)
    M, R, H, chosen = np.empty((FIRST + m, d, d)), np.empty((5, m)), np.empty((m, m)), np.empty(m, np.int64)
    for f in range(len(B)):
        weights[f] = 0.0
        gap[f] = 0.0
        _load(M, R, B[f], C_[f], weights[f], axes)
        if _start(M, R, present[f], trace, axes) >= 0:
            gap[f] = max(_descend(M, R, H, chosen, trace, axes), 0.0)
        for k in range(m):
            weights[f, k] = R[WEIGHT, k]


@compiled
def values(B, C_, trace, weights, value, axes):  # type: ignore[no-untyped-def]
    """The criterion (K,) of any weights (K, m)."""
    m, d = B.shape[1], len(axes)
    M, R = np.empty((FIRST + m, d, d)), np.empty((5, m))
    for f in range(len(B)):
        _load(M, R, B[f], C_[f], weights[f], axes)
        _combine(M, R, WEIGHT, Y, axes)
        value[f] = _value(M, Y, trace, d, axes)


@inlined
def _relative(M, R, sigma, w, axes):  # type: ignore[no-untyped-def]
    """Y = w B_0 + sum n_k B_k and Q = dY/dw, with n_k = v / (sigma_k + (1 - sigma_k) v), v = 1 - w."""
    R[WEIGHT, 0], R[STEP, 0] = w, 1.0
    for k in range(len(sigma)):
        c = sigma[k] + (1.0 - sigma[k]) * (1.0 - w)
        R[WEIGHT, k + 1], R[STEP, k + 1] = (1.0 - w) / c, -sigma[k] / (c * c)
    _combine(M, R, WEIGHT, Y, axes)
    _combine(M, R, STEP, Q, axes)


@inlined
def _relative_slope(M, R, sigma, w, trace, block, axes):  # type: ignore[no-untyped-def]
    """The criterion's relative slope in w; nan where Y is singular."""
    _relative(M, R, sigma, w, axes)
    if not _sensitivity(M, Y, trace, axes):
        return np.nan
    if trace:
        return -_inner(M, G, Q, axes)
    slope = 0.0
    for i in range(len(axes)):
        for j in range(len(axes)):
            for k in range(block):
                slope -= M[T, k, i] * M[T, k, j] * M[Q, i, j] / block
    return slope


@inlined
def _search(M, R, sigma, trace, block, axes):  # type: ignore[no-untyped-def]
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


@compiled
def best_relative(B, C_, sigma, trace, block, weights, gap, axes):  # type: ignore[no-untyped-def]
    """One's own weights (K,) and their gaps (K,)."""
    m, d = B.shape[1], len(axes)
    M, R = np.empty((FIRST + m, d, d)), np.zeros((5, m))
    for f in range(len(B)):
        _load(M, R, B[f], C_[f], R[WEIGHT], axes)
        weights[f], gap[f] = _search(M, R, sigma[f], trace, block, axes)


@compiled
def relative_values(B, C_, sigma, trace, block, weights, value, axes):  # type: ignore[no-untyped-def]
    """The criterion (K,) of any own weights (K,)."""
    m, d = B.shape[1], len(axes)
    M, R = np.empty((FIRST + m, d, d)), np.zeros((5, m))
    for f in range(len(B)):
        _load(M, R, B[f], C_[f], R[WEIGHT], axes)
        _relative(M, R, sigma[f], weights[f], axes)
        value[f] = _value(M, Y, trace, block, axes)


@inlined
def _same(X, Y, axes):  # type: ignore[no-untyped-def]
    for i in range(len(axes)):
        for j in range(len(axes)):
            if X[i, j] != Y[i, j]:
                return False
    return True


@compiled
def share(B, weights, axes):  # type: ignore[no-untyped-def]
    """Sources whose covariances are the same, bit for bit, share their weight equally."""
    m = weights.shape[1]
    for f in range(len(weights)):
        for k in range(m):
            total, count = weights[f, k], 1
            for j in range(m):
                if j != k and _same(B[f, k], B[f, j], axes):
                    count = 0 if j < k or count == 0 else count + 1  # the first of them does it
                    total += weights[f, j]
            for j in range(k, m):
                if count > 1 and _same(B[f, k], B[f, j], axes):
                    weights[f, j] = total / count
