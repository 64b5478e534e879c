"""Fusions in the coordinates in which their sources' mean information is the identity.

B_k = T A_k T' with A_k = P_k^-1, T = U^-1 and U U' = mean A_k. The determinant of the fused covariance changes by a
constant factor, its trace becomes tr(C Y^-1) with C = T T' and Y = sum w_k B_k, and near-singular inputs do no harm.
U is upper triangular, so that the leading (position) block of Y^-1 stays the leading block of the fused covariance.
"""

from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.compiled.jit import strict_inlined, strict_kernel
from cooploc.estimators.covariance_intersection.small_matrices import PIVOT, S, T, U, factor, invert_factor
from cooploc.estimators.interface import Array, Indices, Mask

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
