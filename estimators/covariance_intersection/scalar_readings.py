"""Covariance intersection with scalar readings of teammates: the weight of one, and a whole chain of them in one loop.

One's own position block P and a reading with row u, variance q / (1 - w) from the sender and R of its own: with
h = u P u', t = tr P, and in units of h (q/h, R/h are called q and rho), v = 1 - w, r = v / w and e = q + rho v,

    trace = t (w e + k v) / (w (w e + v)),   k = |u|^2 det P / (t h),    det = det P e / (w (w e + v)).

Their slopes in w are zero where

    e^2 + 2 b r e + c r^2 = level:   b = c = k, level = q (1 - k) for the trace;   b = 1/4, c = 0, level = q/2 for det,

(1 - k is |P u'|^2 / (t h), which needs no difference). The left side is convex and grows with v, so Newton's method
falls from any v above the root to it and never passes it. Such a v, close by, comes of e >= q and of r >= v: either
makes the equation quadratic. Where the left side exceeds the level at v = 0 the reading cannot help and w is 1.

A chain takes a row through its senders one after the other, as ctrn.py states it step by step: linearise at the belief
so far, weigh, update in Joseph's form.
"""

from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.compiled import random_numbers
from cooploc.estimators.compiled.elementary_functions import inlined, kernel, readable
from cooploc.estimators.covariance_intersection.exact_kernels import LEAST, PIVOT
from cooploc.estimators.interface import Array, Belief, Indices, Keys, Mask, Sensor
from cooploc.estimators.models.sensors import NEAR, TOO_NEAR_TO_RANGE, LogDistance, Range

CERTAIN = 1e-15  # the least share of the sender in a reading's variance: below, w would be 1 to the last bit
CLOSE = 1e-9  # a Newton step this small, relatively, is the last one: its square is rounding
STEPS = 100  # never needed: 11 were the most where variances lay ten decades apart
COLLAPSED = 1e-12  # smallest eigenvalue over the trace of a covariance that is not inverted any more


class Sample(NamedTuple):
    """Fusions that were written down, to be solved again by another method."""

    row: Indices  # (k,)
    w: Array  # (k,)
    P: Array  # (k, d, d)  own
    P_j: Array  # (k, 2, 2)  the sender's
    H: Array  # (k, 1, d)
    H_j: Array  # (k, 1, 2)
    R: Array  # (k, 1, 1)

    def take(self, which: Any) -> "Sample":
        """Some of them."""
        return Sample(self.row[which], *(each[which] for each in self[1:]))


class Lot(NamedTuple):
    """Who draws which fusions are written down."""

    key: Keys  # (r, 2)
    counter: int
    share: float


def scalar(H: Array, block: int) -> Mask:
    """Which readings (K,) with Jacobian H (K, k, d) this file is about: one number that tells of the position alone."""
    one = H.shape[1] == 1 and block == 2 <= H.shape[2]
    return np.asarray(one & ~H[..., 2:].any((1, 2)))


def weights(P: Array, H: Array, q: Array, R: Array, criterion: str) -> tuple[Array, Array]:
    """One's own weights (K,) and their gaps, for P (K, d, d), H (K, 1, d), q = H_j P_j H_j' (K, 1, 1), R (K, 1, 1)."""
    w, gap = np.empty(len(P)), np.empty(len(P))
    _weights(readable(P), readable(H), readable(q), readable(R), criterion == "trace", w, gap)
    return w, gap


def chain(
    belief: Belief, sensor: Sensor, packets: Array, readings: Array, criterion: str, lot: Lot
) -> tuple[Belief, Array, Sample] | None:
    """Beliefs after one sender's reading after the other, how many were fused (r,), and a sample of the fusions.

    Args:
        belief: x (r, d), P (r, d, d).
        sensor: a Range or a LogDistance.
        packets: x, y, P_xx, P_xy, P_yy of each sender (r, n, 5), nan where nothing was heard.
        readings: (r, n).
        criterion: "trace" or "det" of the position's covariance.
        lot: what is sampled.

    None where a packet is no covariance: `solve_relative` names what is wrong with it.

    """
    d = belief.x.shape[-1]
    x, P, fusions = belief.x.copy(), belief.P.copy(), np.zeros(len(belief.x))
    chosen = np.zeros(readings.shape, bool)
    _draw(readable(lot.key), lot.counter, lot.share, readable(readings), chosen)
    sample = blank(int(chosen.sum()), d)
    sample.R[:] = sensor.R
    A, slope = (sensor.A, 10 * sensor.eta / np.log(10)) if isinstance(sensor, LogDistance) else (0.0, 0.0)
    model = isinstance(sensor, Range), A, slope, float(sensor.R[0, 0])
    told = readable(packets), readable(readings), readable(chosen)
    used = _chain(*told, model, criterion == "trace", x, P, fusions, sample, (0,) * d)
    if used < 0:
        return None
    return Belief(x, P), fusions, sample.take(slice(used))


def blank(k: int, d: int) -> Sample:
    """Room for k fusions of a state of width d."""
    shapes = (), (d, d), (2, 2), (1, d), (1, 2), (1, 1)
    return Sample(np.zeros(k, np.int64), *(np.zeros((k, *shape)) for shape in shapes))


def sampled(lot: Lot, senders: int) -> Mask:
    """Which fusions (r, senders) are written down."""
    chosen = np.zeros((len(lot.key), senders), bool)
    _draw(readable(lot.key), lot.counter, lot.share, readable(np.zeros(chosen.shape)), chosen)
    return chosen


@kernel
def _draw(key, counter, share, readings, chosen):  # type: ignore[no-untyped-def]
    for r in range(chosen.shape[0]):
        for j in range(chosen.shape[1]):
            if not np.isnan(readings[r, j]):
                u, _ = random_numbers.uniform_pair(np.int64(key[r, 0]), np.int64(key[r, 1]), counter, j)
                chosen[r, j] = u < share


@inlined
def _start(q, rho, b, c, rest):  # type: ignore[no-untyped-def]
    """A v that is not below the root: the lesser of what e >= q and r >= v leave of the equation."""
    r = rest / (b * q + np.sqrt((b * q) * (b * q) + c * rest))
    half = q * (rho + b)
    v = rest / (half + np.sqrt(half * half + (rho * rho + 2 * b * rho + c) * rest))
    return min(min(r / (1 + r), v), 1 - LEAST)


@inlined
def _left(q, rho, b, c, v):  # type: ignore[no-untyped-def]
    """e^2 + 2 b r e + c r^2, and its slope in v."""
    w = 1 - v
    r, e = v / w, q + rho * v
    return e * e + r * (2 * b * e + c * r), 2 * (rho * (e + b * r) + (b * e + c * r) / (w * w))


@inlined
def _equation(xx, xy, yy, ux, uy, q, R, trace):  # type: ignore[no-untyped-def]
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
def _root(q, rho, b, c, level):  # type: ignore[no-untyped-def]
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
def _weights(P, H, q, R, trace, out, gap):  # type: ignore[no-untyped-def]
    for f in range(len(P)):
        part = P[f, 0, 0], P[f, 0, 1], P[f, 1, 1], H[f, 0, 0], H[f, 0, 1], q[f, 0, 0], R[f, 0, 0]
        q_, rho, b, c, level = _equation(*part, trace)
        v = _root(q_, rho, b, c, level)
        w = out[f] = 1 - v
        gap[f] = 0.0
        if 0.0 < v < 1 - LEAST:  # the relative slope, of the determinant's root, times the width of [0, 1]
            e, off = q_ + rho * v, abs(_left(q_, rho, b, c, v)[0] - level)
            gap[f] = off / (w * e + v) * (w / (w * e + c * v) if trace else 2 / e)


@inlined
def _sound(P, axes):  # type: ignore[no-untyped-def]
    """Whether P's smallest eigenvalue is above COLLAPSED times its trace: the pivots of P less that are positive."""
    trace = P[0, 0] + P[1, 1] + (P[2, 2] if len(axes) == 3 else 0.0)
    least = COLLAPSED * max(trace, np.finfo(np.float64).tiny)
    first, ratio = P[0, 0] - least, P[1, 0] / (P[0, 0] - least)
    second = P[1, 1] - least - ratio * P[1, 0]
    sound = first > 0.0 and second > 0.0
    if len(axes) == 3 and sound:
        rest = P[2, 1] - ratio * P[2, 0]
        sound = P[2, 2] - least - P[2, 0] * P[2, 0] / first - rest * rest / second > 0.0
    return sound


@inlined
def _definite(xx, xy, yy):  # type: ignore[no-untyped-def]
    """Whether a packet's covariance is positive definite by more than rounding."""
    return np.isfinite(xx) and yy > 0.0 and np.isfinite(yy) and xx - xy / yy * xy > PIVOT * xx


@inlined
def _linearise(model, dx, dy, z):  # type: ignore[no-untyped-def]
    """The innovation of a range or an RSSI and its position Jacobian at the offset (dx, dy); nan where refused."""
    ranged, A, slope, _ = model
    D = dx * dx + dy * dy
    if ranged:
        d = np.sqrt(D)
        y = np.nan if z < TOO_NEAR_TO_RANGE else z - d
        return y, dx / max(d, NEAR), dy / max(d, NEAR)
    y, steep = z - A + 0.5 * slope * np.log(max(D, NEAR**2)), -slope / max(D, NEAR**2) if D > NEAR**2 else 0.0
    return (y if D >= 0.0 else np.nan), steep * dx, steep * dy


@inlined
def _update(x, P, y, ux, uy, N, w, M, K, axes):  # type: ignore[no-untyped-def]
    """x + K y and (I - K H) P/w (I - K H)' + K N K', symmetric; M (3, 3) and K (3,) are scratch."""
    for i in range(len(axes)):
        K[i] = (P[i, 0] * ux + P[i, 1] * uy) / w
    S = K[0] * ux + K[1] * uy + N
    for i in range(len(axes)):
        for j in range(len(axes)):
            M[i, j] = P[i, j] / w - K[i] / S * K[j]
    for i in range(len(axes)):
        K[i] /= S
        x[i] += K[i] * y
    for i in range(len(axes)):
        for j in range(i + 1):
            ij = M[i, j] - (M[i, 0] * ux + M[i, 1] * uy) * K[j]
            ji = M[j, i] - (M[j, 0] * ux + M[j, 1] * uy) * K[i]
            P[i, j] = P[j, i] = 0.5 * (ij + ji) + N * K[i] * K[j]


@inlined
def _note(f, sample, r, w, own, packet, ux, uy, axes):  # type: ignore[no-untyped-def]
    """Write fusion number f down."""
    P, P_j, H, H_j = sample.P, sample.P_j, sample.H, sample.H_j
    sample.row[f], sample.w[f] = r, w
    H[f, 0, 0], H[f, 0, 1], H_j[f, 0, 0], H_j[f, 0, 1] = ux, uy, -ux, -uy
    P_j[f, 0, 0], P_j[f, 0, 1], P_j[f, 1, 0], P_j[f, 1, 1] = packet[2], packet[3], packet[3], packet[4]
    for i in range(len(axes)):
        for j in range(len(axes)):
            P[f, i, j] = own[i, j]


@kernel
def _chain(packets, readings, chosen, model, trace, x, P, fusions, sample, axes):  # type: ignore[no-untyped-def]
    """Take x and P through their readings; returns how many fusions were written down, -1 where a packet is wrong."""
    M, K, used, R = np.empty((3, 3)), np.empty(3), 0, model[3]
    for r in range(len(x)):
        sound = _sound(P[r], axes)
        for j in range(readings.shape[1]):
            packet = packets[r, j]
            y, ux, uy = _linearise(model, x[r, 0] - packet[0], x[r, 1] - packet[1], readings[r, j])
            xx, xy, yy = packet[2], packet[3], packet[4]
            if not sound or np.isnan(y) or np.isnan(xx) or np.isnan(xy) or np.isnan(yy):
                continue
            fusions[r] += 1
            v = 0.0
            if not (xx == np.inf and yy == np.inf):  # else the sender knows nothing
                q = ux * (ux * xx + uy * xy) + uy * (ux * xy + uy * yy)
                if not (_definite(xx, xy, yy) and q + R > 0.0):
                    return -1
                v = _root(*_equation(P[r, 0, 0], P[r, 0, 1], P[r, 1, 1], ux, uy, q, R, trace))
            if chosen[r, j]:
                _note(used, sample, r, 1 - v, P[r], packet, ux, uy, axes)
                used += 1
            if v > 0.0:
                _update(x[r], P[r], y, ux, uy, q / v + R, 1 - v, M, K, axes)
                sound = _sound(P[r], axes)
    return used
