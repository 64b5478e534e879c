"""One scalar reading of a teammate: the weight of one's own belief in covariance intersection, by Newton's method.

For one's own position block P and a reading with row u, variance q / (1 - w) from the sender and R of its own: with
h = u P u', t = tr P, and in units of h (q/h, R/h are called q and rho), v = 1 - w, r = v / w and e = q + rho v,

    trace = t (w e + k v) / (w (w e + v)),   k = |u|^2 det P / (t h),    det = det P e / (w (w e + v)).

Their slopes in w are zero where

    e^2 + 2 b r e + c r^2 = level:   b = c = k, level = q (1 - k) for the trace;   b = 1/4, c = 0, level = q/2 for det,

(1 - k is |P u'|^2 / (t h), which needs no difference). The left side is convex and grows with v, so Newton's method
falls from any v above the root to it and never passes it. Such a v, close by, comes of e >= q and of r >= v: either
makes the equation quadratic. Where the left side exceeds the level at v = 0 the reading cannot help and w is 1.
"""

import numpy as np

from cooploc.estimators.compiled.jit import inlined, kernel, readable
from cooploc.estimators.covariance_intersection.criterion import LEAST
from cooploc.estimators.interface import Array, Mask

CERTAIN = 1e-15  # the least share of the sender in a reading's variance: below, w would be 1 to the last bit
CLOSE = 1e-9  # a Newton step this small, relatively, is the last one: its square is rounding
STEPS = 100  # never needed: 11 were the most where variances lay ten decades apart


def scalar(H: Array, block: int) -> Mask:
    """Readings (K,) with Jacobian H (K, k, d) that this file is for: one number, a function of the position alone."""
    if not (H.shape[1] == 1 and block == 2 <= H.shape[2]):
        return np.zeros(len(H), bool)
    return np.asarray(~H[..., 2:].any((1, 2)))


def weights(P: Array, H: Array, q: Array, R: Array, criterion: str) -> tuple[Array, Array]:
    """One's own weights (K,) and their gaps, for P (K, d, d), H (K, 1, d), q = H_j P_j H_j' (K, 1, 1), R (K, 1, 1)."""
    w, gap = np.empty(len(P)), np.empty(len(P))
    _weights(readable(P), readable(H), readable(q), readable(R), criterion == "trace", w, gap)
    return w, gap


@inlined
def _start(q, rho, b, c, rest):
    """A v that is not below the root: the lesser of what e >= q and r >= v leave of the equation."""
    r = rest / (b * q + np.sqrt((b * q) * (b * q) + c * rest))
    half = q * (rho + b)
    v = rest / (half + np.sqrt(half * half + (rho * rho + 2 * b * rho + c) * rest))
    return min(min(r / (1 + r), v), 1 - LEAST)


@inlined
def _left(q, rho, b, c, v):
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
    v = _start(q, rho, b, c, rest)
    for _ in range(STEPS):
        left, slope = _left(q, rho, b, c, v)
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
            e, off = q_ + rho * v, abs(_left(q_, rho, b, c, v)[0] - level)
            gap[f] = off / (w * e + v) * (w / (w * e + c * v) if trace else 2 / e)
