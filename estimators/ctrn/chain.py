"""The compiled loop of moments.py: covariance intersection with one sender after the other, each row by itself.

As `moments.step_by_step` states it: linearise at the belief so far, weigh, update in Joseph's form.
"""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.compiled.jit import inlined, kernel, readable
from cooploc.estimators.covariance_intersection.scalar_readings import weight_equation, weight_root
from cooploc.estimators.covariance_intersection.small_matrices import PIVOT
from cooploc.estimators.ctrn.state import Sample, empty_sample
from cooploc.estimators.interface import Array, Belief, Mask, Sensor
from cooploc.estimators.models.sensors import NEAR, TOO_NEAR_TO_RANGE, LogDistance, Range

COLLAPSED = 1e-12  # smallest eigenvalue over the trace of a covariance that is not inverted any more


class Model(NamedTuple):
    """The sensor of a chain."""

    ranged: bool  # else RSSI
    A: float  # [dBm] RSSI at 1 m
    slope: float  # [dB] RSSI lost per unit of ln d
    R: float  # variance of a reading [m^2] or [dB^2]


class Links(NamedTuple):
    """What was heard."""

    packets: Array  # (r, n, 5)  x, y, P_xx, P_xy, P_yy of each sender, nan where nothing was heard
    readings: Array  # (r, n) [m] or [dBm]
    recorded: Mask  # (r, n)  fusions that are written into the sample


def chain(
    belief: Belief, sensor: Sensor, packets: Array, readings: Array, criterion: str, recorded: Mask
) -> tuple[Belief, Array, Sample] | None:
    """Beliefs after one sender's reading after the other, how many were fused (r,), and a sample of the fusions.

    Args:
        belief: x (r, d), P (r, d, d).
        sensor: a Range or a LogDistance.
        packets: x, y, P_xx, P_xy, P_yy of each sender (r, n, 5), nan where nothing was heard.
        readings: (r, n) [m] or [dBm].
        criterion: "trace" or "det" of the position's covariance.
        recorded: which fusions (r, n) the sample is to hold.

    Returns:
        None where a packet is not a covariance: `solve_relative` names what is wrong with it.

    """
    d = belief.x.shape[-1]
    after, fusions = Belief(belief.x.copy(), belief.P.copy()), np.zeros(len(belief.x))
    sample = empty_sample(int(recorded.sum()), d)
    sample.R[:] = sensor.R
    A, slope = (sensor.A, 10 * sensor.eta / np.log(10)) if isinstance(sensor, LogDistance) else (0.0, 0.0)
    model = Model(isinstance(sensor, Range), A, slope, float(sensor.R[0, 0]))
    links = Links(readable(packets), readable(readings), readable(recorded))
    used = _chain(tuple(links), tuple(model), criterion == "trace", tuple(after), fusions, sample, (0,) * d)
    return None if used < 0 else (after, fusions, sample.take(slice(used)))


@inlined
def _invertible(P, axes):
    """Whether P's smallest eigenvalue is above COLLAPSED times its trace: the pivots of P less that are positive."""
    trace = P[0, 0] + P[1, 1] + (P[2, 2] if len(axes) == 3 else 0.0)
    least = COLLAPSED * max(trace, np.finfo(np.float64).tiny)
    first, ratio = P[0, 0] - least, P[1, 0] / (P[0, 0] - least)
    second = P[1, 1] - least - ratio * P[1, 0]
    invertible = first > 0.0 and second > 0.0
    if len(axes) == 3 and invertible:
        rest = P[2, 1] - ratio * P[2, 0]
        invertible = P[2, 2] - least - P[2, 0] * P[2, 0] / first - rest * rest / second > 0.0
    return invertible


@inlined
def _definite(xx, xy, yy):
    """Whether a packet's covariance is positive definite by more than rounding."""
    return np.isfinite(xx) and yy > 0.0 and np.isfinite(yy) and xx - xy / yy * xy > PIVOT * xx


@inlined
def _linearise(model, dx, dy, z):
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
def _update(x, P, y, ux, uy, N, w, M, K, axes):
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
def _record(f, sample, r, w, own, packet, ux, uy, axes):
    """Write fusion number f into the sample."""
    P, P_j, H, H_j = sample.P, sample.P_j, sample.H, sample.H_j
    sample.row[f], sample.w[f] = r, w
    H[f, 0, 0], H[f, 0, 1], H_j[f, 0, 0], H_j[f, 0, 1] = ux, uy, -ux, -uy
    P_j[f, 0, 0], P_j[f, 0, 1], P_j[f, 1, 0], P_j[f, 1, 1] = packet[2], packet[3], packet[3], packet[4]
    for i in range(len(axes)):
        for j in range(len(axes)):
            P[f, i, j] = own[i, j]


@kernel
def _chain(links, model, trace, belief, fusions, sample, axes):
    """Update the belief by all readings; how many fusions were recorded, -1 where a packet is not a covariance."""
    (x, P), (packets, readings, recorded) = belief, links
    M, K, used, R = np.empty((3, 3)), np.empty(3), 0, model[3]
    for r in range(len(x)):
        invertible = _invertible(P[r], axes)
        for j in range(readings.shape[1]):
            packet = packets[r, j]
            y, ux, uy = _linearise(model, x[r, 0] - packet[0], x[r, 1] - packet[1], readings[r, j])
            xx, xy, yy = packet[2], packet[3], packet[4]
            if not invertible or np.isnan(y) or np.isnan(xx) or np.isnan(xy) or np.isnan(yy):
                continue
            fusions[r] += 1
            v = 0.0
            if not (xx == np.inf and yy == np.inf):  # else the sender knows nothing
                q = ux * (ux * xx + uy * xy) + uy * (ux * xy + uy * yy)
                if not (_definite(xx, xy, yy) and q + R > 0.0):
                    return -1
                v = weight_root(*weight_equation(P[r, 0, 0], P[r, 0, 1], P[r, 1, 1], ux, uy, q, R, trace))
            if recorded[r, j]:
                _record(used, sample, r, 1 - v, P[r], packet, ux, uy, axes)
                used += 1
            if v > 0.0:
                _update(x[r], P[r], y, ux, uy, q / v + R, 1 - v, M, K, axes)
                invertible = _invertible(P[r], axes)
    return used
