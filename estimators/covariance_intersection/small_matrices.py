"""Small symmetric matrices in compiled loops: Cholesky roots, inverses, products, traces.

All matrices of one fusion lie in one array M (slots, d, d) and are named by their slots, all vectors in one array R
(5, m): numba counts references to every slice. `axes` is a tuple of d zeros: the length of a tuple is part of its type,
so that numba unrolls the loops over it.
"""

import numpy as np

from cooploc.estimators.compiled.jit import strict_inlined

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
