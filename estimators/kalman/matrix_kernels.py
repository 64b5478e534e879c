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
        out[s] = P[s] + 0.0
        for i in range(n):
            for a in range(d):
                for b in range(d):
                    out[s, i * d + a, i * d + b] += Q[s, i, a, b]
        for a in range(n * d):
            for b in range(a):
                out[s, a, b] = out[s, b, a] = (out[s, a, b] + out[s, b, a]) / 2
