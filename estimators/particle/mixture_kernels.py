"""The compiled loop of mixtures.py over senders, their components, and particles."""

import numpy as np

from cooploc.estimators.compiled.elementary_functions import exp, ln
from cooploc.estimators.compiled.jit import inlined, kernel, wide
from cooploc.estimators.compiled.row_buffers import row_buffer, store
from cooploc.estimators.models.sensors import NEAR, TOO_NEAR_TO_RANGE
from cooploc.estimators.particle.link_kernels import load_row, row_of

LEAST = -1e300  # below any logarithm of a density


@kernel
def add_mixture_rows(x, d, logw, heard, out):
    """`mixtures.weigh` of RSSI or ranges, for particles x (r d, N); `heard` has packets (r, n, 6 K)."""
    wide()
    packets, readings, ranged, A, slope, unit, gain = heard
    row, top, total = row_of(logw), row_buffer(logw), row_buffer(logw)
    logs = np.empty((packets.shape[2] // 6, len(top)), logw.dtype)
    for r in range(len(logw)):
        load_row(x, d, logw, r, row)
        for j in range(readings.shape[1]):
            z = readings[r, j]
            if not (np.isnan(z) or (ranged and z < TOO_NEAR_TO_RANGE)):
                used = _components(row, packets[r, j], ranged, (z - A, slope, unit, gain), logs, top)
                if used > 0:
                    _add_sum(row, logs, used, top, total)
        store(row.logw, out, r)


@inlined
def _components(row, packet, ranged, sensor, logs, top):
    """The log-likelihoods (K, N) of each component that is present, their maximum (N,), and their number."""
    lost, slope, unit, gain = sensor
    used = 0
    for i in range(len(top)):
        top[i] = LEAST
    for k in range(len(logs)):
        w, qx, qy = packet[6 * k], packet[6 * k + 1], packet[6 * k + 2]
        if w > 0.0 and not np.isnan(qx + qy):
            P = gain * packet[6 * k + 3], 2 * gain * packet[6 * k + 4], gain * packet[6 * k + 5]
            if ranged:
                _range(row, (qx, qy), P, (lost * unit, unit), np.log(w), logs[used], top)
            else:
                _rssi(row, (qx, qy), P, (lost * unit, slope * unit), np.log(w), logs[used], top)
            used += 1
    return used


@inlined
def _range(row, place, P, reading, ln_w, logs, top):
    """One component and a range: y = z - d, v = 1 + u' P u, in units of the noise."""
    wide()
    (X, Y, _), (qx, qy, xx, xy, yy, lost, unit, ln_w) = row, _like(row.X, place, P, reading, ln_w)
    one, half, near = X.dtype.type(1.0), X.dtype.type(0.5), X.dtype.type(NEAR**2)
    for i in range(len(top)):
        dx, dy = X[i] - qx, Y[i] - qy
        D = dx * dx + dy * dy
        v = one + (dx * (xx * dx + xy * dy) + yy * (dy * dy)) / max(D, near)
        y = lost - unit * np.sqrt(D)
        logs[i] = ln_w - half * (y * y / v + ln(v))
        top[i] = max(top[i], logs[i])


@inlined
def _rssi(row, place, P, reading, ln_w, logs, top):
    """One component and an RSSI: y = z - A + slope ln D, v = 1 + J P J', in units of the noise."""
    wide()
    (X, Y, _), (qx, qy, xx, xy, yy, lost, slope, ln_w) = row, _like(row.X, place, P, reading, ln_w)
    zero, one, half, near = X.dtype.type(0.0), X.dtype.type(1.0), X.dtype.type(0.5), X.dtype.type(NEAR**2)
    for i in range(len(top)):
        dx, dy = X[i] - qx, Y[i] - qy
        D = dx * dx + dy * dy
        q = dx * (xx * dx + xy * dy) + yy * (dy * dy)
        q = q if near < D else zero
        D = max(D, near)
        v = one + q / (D * D)
        y = lost + slope * ln(D)
        logs[i] = ln_w - half * (y * y / v + ln(v))
        top[i] = max(top[i], logs[i])


@inlined
def _like(X, place, P, reading, ln_w):
    """The same numbers, of the type of the particles."""
    (qx, qy), (xx, xy, yy), (lost, slope), real = place, P, reading, X.dtype.type
    return real(qx), real(qy), real(xx), real(xy), real(yy), real(lost), real(slope), real(ln_w)


@inlined
def _add_sum(row, logs, used, top, total):
    """logw += top + ln sum_k exp(logs_k - top)."""
    wide()
    X, _, logw = row
    for i in range(len(X)):
        total[i] = 0.0
    for k in range(used):
        for i in range(len(X)):
            total[i] += exp(logs[k, i] - top[i])
    for i in range(len(X)):
        logw[i] += top[i] + ln(total[i])
