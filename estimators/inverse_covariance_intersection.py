"""Fusion that takes out common information instead of inflating covariances: two rules of one form.

Two beliefs about the same k numbers, N(0, a) and N(y, b), are multiplied, and divided by what they may have in common:

    C^-1 = a^-1 + b^-1 - G^-1,    y' = C (b^-1 y - G^-1 m).                                                          (1)

*Inverse covariance intersection*: G = w a + (1 - w) b, m = (1 - w) y, with the w of least trace: a bound if the
estimates are independent but for information they share. *Harmonic mean density*: the product f g / (v g + (1 - v) f)
of the densities, the denominator a Gaussian of the same moments: G = v b + (1 - v) a + v (1 - v) y y', m = v y.

A *reading* of H x is about part of the state: x' = x + L y', P' = P - L (a - C) L', a = H P H', L = P H' a^-1.

Sources: B. Noack, J. Sijs, M. Reinhardt, U. D. Hanebeck, "Decentralized data fusion with inverse covariance
intersection", Automatica 79, 2017. N. Sharma, R. Tharmarasa, S. Bhaumik, T. Kirubarajan, "On pooling-based track fusion
strategies: harmonic mean density", arXiv 2412.06716. The Gaussian for the denominator, and the reading of part of a
state, are ours.
"""

from collections.abc import Callable

import numpy as np

from cooploc.estimators.compiled import readable, strict_inlined, strict_kernel
from cooploc.estimators.interface import Array, Belief
from cooploc.estimators.joint_gaussian import definite
from cooploc.estimators.kalman import condition, distance, is_present, symmetric

HALVINGS = 60  # of [0, 1], in search of w

# y' (r, k) and C (r, k, k) of a (r, k, k), b (r, k, k), y (r, k), and M (r, k, k), in whose trace C counts as tr(M C)
Rule = Callable[[Array, Array, Array, Array], tuple[Array, Array]]


def combine(rule: Rule, belief: Belief, y: Array, H: Array, N: Array, gate: float) -> Belief:
    """Update beliefs by readings with innovation y (r, k), H (r, k, d) and noise N (r, k, k), with the sender's belief.

    M makes tr(M C) the part of tr P' that a rule can change. Rows whose reading is absent (nan) or beyond twice the
    gate, or whose H P H' is singular, come back as they are.
    """
    x, P = belief
    use = np.flatnonzero(is_present(y, H, N))
    S = H[use] @ P[use] @ H[use].mT + N[use]
    use = use[distance(y[use], S) <= 2 * gate]
    use = use[definite(H[use] @ P[use] @ H[use].mT)]
    if use.size == 0:
        return belief
    x, P, y, H, N = x.copy(), P.copy(), y[use], H[use], N[use]
    a = H @ P[use] @ H.mT
    L = np.linalg.solve(a, H @ P[use]).mT
    fused, C = rule(a, N, y, L.mT @ L)
    x[use], P[use] = condition(x[use], P[use], H, fused, C)
    return Belief(x, P)


def inverse_intersection(a: Array, b: Array, y: Array, M: Array) -> tuple[Array, Array]:
    """Fuse (1) by inverse covariance intersection with the w that minimises tr(M C)."""
    root = np.linalg.cholesky(a)
    half = np.linalg.solve(root, b)
    D, V = np.linalg.eigh(symmetric(np.linalg.solve(root, half.mT)))
    T = root @ V  # a = T T',  b = T diag(D) T'
    w = least_trace(D, ((M @ T) * T).sum(-2))[:, None]
    common = w + (1 - w) * D
    c = 1 / (1 + (1 / D - 1 / common))
    gain = c * (1 / D - (1 - w) / common)
    fused = T @ (gain[..., None] * np.linalg.solve(T, y[..., None]))
    return fused[..., 0], symmetric((T * c[:, None]) @ T.mT)


def least_trace(D: Array, m: Array) -> Array:
    """Return the w (r,) of least sum m_i c_i,  1/c_i = 1 + 1/D_i - 1/(w + (1 - w) D_i),  for D, m (r, k): convex."""
    w = np.empty(len(D))
    _bisect(readable(D), readable(m), w)
    return w


@strict_inlined
def _rises(D, m, w):
    """Return whether the sum rises with w."""
    slope = 0.0
    for i in range(len(D)):
        common = w + (1 - w) * D[i]
        c = 1 / (1 + (1 / D[i] - 1 / common))
        slope += m[i] * (D[i] - 1) * (c / common) ** 2
    return slope > 0


@strict_kernel
def _bisect(D, m, out):
    for r in range(len(D)):
        low, high = 0.0, 1.0
        for _ in range(HALVINGS):
            w = (low + high) / 2
            low, high = (low, w) if _rises(D[r], m[r], w) else (w, high)
        out[r] = (low + high) / 2
        if _rises(D[r], m[r], 0.0):
            out[r] = 0.0
        elif not _rises(D[r], m[r], 1.0):
            out[r] = 1.0


def intersection_at_weight(v: float, a: Array, b: Array, y: Array) -> tuple[Array, Array]:
    """Fuse (1) by inverse covariance intersection with w = 1 - v: the first belief has the weight v."""
    return quotient(a, b, y, v * b + (1 - v) * a, v * y)


def harmonic_mean(v: float, a: Array, b: Array, y: Array) -> tuple[Array, Array]:
    """Fuse (1) by the harmonic mean of the two densities; the first has the weight v."""
    return quotient(a, b, y, v * b + (1 - v) * a + v * (1 - v) * y[..., None] * y[:, None], v * y)


def quotient(a: Array, b: Array, y: Array, G: Array, m: Array) -> tuple[Array, Array]:
    """Return (1): y' (r, k), C (r, k, k) of N(0, a) N(y, b) / N(m, G)."""
    A, B, known = (np.linalg.inv(part) for part in (a, b, G))
    C = symmetric(np.linalg.inv(A + (B - known)))
    return (C @ (B @ y[..., None] - known @ m[..., None]))[..., 0], C
