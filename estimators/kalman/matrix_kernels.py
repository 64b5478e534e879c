"""Compiled steps on small matrices that the loops of this room share."""

import numpy as np

from cooploc.estimators.compiled.jit import strict_kernel
from cooploc.estimators.interface import Array, Mask


@strict_kernel
def whiten(C: Array, B: Array) -> None:
    """Turn S (k, k) into its Cholesky factor C, and B (k, m) into C^-1 B, in place."""
    for c in range(len(C)):
        for b in range(c + 1):
            for a in range(b):
                C[c, b] -= C[c, a] * C[b, a]
            if b < c:
                C[c, b] /= C[b, b]
        C[c, c] = np.sqrt(C[c, c])
        for m in range(B.shape[1]):
            for a in range(c):
                B[c, m] -= C[c, a] * B[a, m]
            B[c, m] /= C[c, c]


@strict_kernel
def fill_definite(P: Array, out: Mask) -> None:
    """The last pivot of a Cholesky factor is above 0 if all are, and nan if one before it was not."""
    d = P.shape[1]
    C, nothing = np.empty((d, d)), np.empty((d, 0))
    for s in range(len(P)):
        C[:] = P[s]
        whiten(C, nothing)
        out[s] = C[d - 1, d - 1] > 0


@strict_kernel
def fill_widened(P: Array, Q: Array, out: Array) -> None:
    """(P + P')/2 with Q_i added to P_ii."""
    t, n, d, _ = Q.shape
    for s in range(t):
        for a in range(n * d):  # a loop: an array assigned to a slice takes seconds to compile
            for b in range(n * d):
                out[s, a, b] = P[s, a, b] + 0.0
        for i in range(n):
            for a in range(d):
                for b in range(d):
                    out[s, i * d + a, i * d + b] += Q[s, i, a, b]
        for a in range(n * d):
            for b in range(a):
                out[s, a, b] = out[s, b, a] = (out[s, a, b] + out[s, b, a]) / 2


@strict_kernel
def solve(S, B):
    """Turn B (k, m) into S^-1 B by elimination with row pivots; S (k, k) is destroyed."""
    for c in range(len(S)):
        pivot = c
        for r in range(c + 1, len(S)):
            pivot = r if abs(S[r, c]) > abs(S[pivot, c]) else pivot
        if pivot != c:
            for m in range(c, len(S)):
                S[c, m], S[pivot, m] = S[pivot, m], S[c, m]
            for m in range(B.shape[1]):
                B[c, m], B[pivot, m] = B[pivot, m], B[c, m]
        for r in range(c + 1, len(S)):
            factor = S[r, c] / S[c, c]
            for m in range(c + 1, len(S)):
                S[r, m] -= factor * S[c, m]
            for m in range(B.shape[1]):
                B[r, m] -= factor * B[c, m]
    for c in range(len(S) - 1, -1, -1):
        for m in range(B.shape[1]):
            for r in range(c + 1, len(S)):
                B[c, m] -= S[c, r] * B[r, m]
            B[c, m] /= S[c, c]


@strict_kernel
def joseph(P, H, K, R, A, out):
    """out = (I - K H) P (I - K H)' + K R K', symmetric, for K' (k, d); A (d, d) is scratch, out may be P."""
    d, k = P.shape[0], H.shape[0]
    for a in range(d):
        for b in range(d):
            v = P[a, b]
            for i in range(k):
                HP = 0.0
                for c in range(d):
                    HP += H[i, c] * P[c, b]
                v -= K[i, a] * HP
            A[a, b] = v
    for a in range(d):
        for b in range(d):
            v = A[a, b]
            for i in range(k):
                AH, RK = 0.0, 0.0
                for c in range(d):
                    AH += A[a, c] * H[i, c]
                for j in range(k):
                    RK += K[j, a] * R[j, i]
                v += (RK - AH) * K[i, b]
            out[a, b] = v
    for a in range(d):
        for b in range(a):
            out[a, b] = out[b, a] = (out[a, b] + out[b, a]) / 2


@strict_kernel
def fill_product(A, B, out):
    """A B into out."""
    for a in range(len(A)):
        for b in range(B.shape[1]):
            out[a, b] = 0.0
            for c in range(len(B)):
                out[a, b] += A[a, c] * B[c, b]


@strict_kernel
def fill_square(A, out):
    """A A' into out."""
    for a in range(len(A)):
        for b in range(a + 1):
            total = 0.0
            for c in range(A.shape[1]):
                total += A[a, c] * A[b, c]
            out[a, b] = out[b, a] = total


@strict_kernel
def fill_sum(u, A, v, B, out):
    """u A + v B into out; a loop, because each line of array arithmetic takes a second to compile."""
    for a in range(len(A)):
        for b in range(A.shape[1]):
            out[a, b] = u * A[a, b] + v * B[a, b]
