"""The criteria of covariance intersection, trace and determinant of the fused covariance, and their gradient.

Both have a gradient g_k = tr(G B_k): G = Y^-1 / d for the logarithm of the determinant (per dimension), and
G = Y^-1 C Y^-1 / tr(C Y^-1) for the trace.
"""

import numpy as np

from cooploc.estimators.compiled.jit import strict_inlined
from cooploc.estimators.covariance_intersection.small_matrices import C, G, T, U, W, inner, invert, product

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
