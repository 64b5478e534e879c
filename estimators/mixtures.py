"""Beliefs as mixtures of Gaussians: packets, the likelihood of a reading of their sender, clusters and samples.

A sender's belief is sum_k w_k N(m_k, P_k), with P_k in m^2. A reading z of it has, at a particle x, the likelihood

    sum_k w_k N(z - h(x, m_k); 0, R + J_k P_k J_k'),

the sender's position integrated out of each component, with the sensor linearised in it.
"""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.compiled import exp, inlined, kernel, ln, readable, row_buffer, store, wide
from cooploc.estimators.interface import Array, Belief, Sensor
from cooploc.estimators.models import NEAR, TOO_NEAR_TO_RANGE, LogDistance, Range
from cooploc.estimators.particle_kernels import load_row, row_of
from cooploc.estimators.particle_likelihood import ReceivedPackets, fill_rows, log_density, pack
from cooploc.estimators.particle_likelihood import unpack as read_packet
from cooploc.estimators.particles import summary, weights
from cooploc.estimators.robust import loss_of

LEAST = -1e300  # below any logarithm of a density


@kernel
def add_mixture_rows(x, d, logw, heard, out):
    """Write `mixtures.weigh` of RSSI or ranges, for particles x (r d, N); `heard` has packets (r, n, 6 K)."""
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
    """Write the log-likelihoods (K, N) of each component that is present, and their maximum; return their number."""
    lost, slope, unit, gain = sensor
    used = 0
    for i in range(len(top)):
        top[i] = LEAST
    for k in range(len(logs)):
        w, qx, qy = packet[6 * k], packet[6 * k + 1], packet[6 * k + 2]
        if w > 0.0 and not np.isnan(qx + qy):
            P = gain * packet[6 * k + 3], 2 * gain * packet[6 * k + 4], gain * packet[6 * k + 5]
            if ranged:
                _add_component(True, row, (qx, qy), P, (lost * unit, unit), np.log(w), logs[used], top)
            else:
                _add_component(False, row, (qx, qy), P, (lost * unit, slope * unit), np.log(w), logs[used], top)
            used += 1
    return used


@inlined
def _add_component(ranged, row, place, P, reading, ln_w, logs, top):
    """Write one component's log-likelihoods, in units of the noise.

    Of a range y = z - d, v = 1 + u' P u; of an RSSI y = z - A + slope ln D, v = 1 + J P J'.
    """
    wide()
    (X, Y, _), (qx, qy), (xx, xy, yy), (lost, slope), real = row, place, P, reading, row.X.dtype.type
    qx, qy, xx, xy, yy, lost = real(qx), real(qy), real(xx), real(xy), real(yy), real(lost)
    slope, ln_w, zero, one, half, near = real(slope), real(ln_w), real(0.0), real(1.0), real(0.5), real(NEAR**2)
    for i in range(len(top)):
        dx, dy = X[i] - qx, Y[i] - qy
        D = dx * dx + dy * dy
        q = dx * (xx * dx + xy * dy) + yy * (dy * dy)
        if ranged:
            v, y = one + q / max(D, near), lost - slope * np.sqrt(D)
        else:
            q = q if near < D else zero
            D = max(D, near)
            v, y = one + q / (D * D), lost + slope * ln(D)
        logs[i] = ln_w - half * (y * y / v + ln(v))
        top[i] = max(top[i], logs[i])


@inlined
def _add_sum(row, logs, used, top, total):
    """Add top + ln sum_k exp(logs_k - top)."""
    wide()
    X, _, logw = row
    for i in range(len(X)):
        total[i] = 0.0
    for k in range(used):
        for i in range(len(X)):
            total[i] += exp(logs[k, i] - top[i])
    for i in range(len(X)):
        logw[i] += top[i] + ln(total[i])


NUMBERS = 6  # of a component


class Mixture(NamedTuple):
    """Gaussians of positions and their weights, which sum to one; nan where a component is absent."""

    w: Array  # (..., K)
    x: Array  # (..., K, 2) [m]
    P: Array  # (..., K, 2, 2) [m^2]

    def pack(self) -> Array:
        """Return the packet (..., 6 K): w, x, y, P_xx, P_xy, P_yy of each component."""
        numbers = np.concatenate([self.w[..., None], pack(Belief(self.x, self.P))], -1)
        return numbers.reshape(*self.w.shape[:-1], NUMBERS * self.w.shape[-1])


def unpack(packets: Array) -> Mixture:
    """Return the mixture in packets (..., 6 K)."""
    parts = packets.reshape(*packets.shape[:-1], packets.shape[-1] // NUMBERS, NUMBERS)
    return Mixture(parts[..., 0], *read_packet(parts[..., 1:]))


def weigh(sensor: Sensor, sent: Mixture, z: Array, x: Array, logw: Array) -> Array:
    """Add to `logw` (r, N) the log-likelihoods of all senders' readings z (r, n, k), at particles x (r, N, d).

    `sent` (r, n, K) are the senders' beliefs; z is nan where there is none.
    """
    if type(sensor) not in (LogDistance, Range) or loss_of(sensor) != "none":
        return weigh_reference(sensor, sent, z, x, logw)
    return fill_rows(add_mixture_rows, x, logw, ReceivedPackets(sensor, sent.pack(), z[..., 0], True).for_loop())


def weigh_reference(sensor: Sensor, sent: Mixture, z: Array, x: Array, logw: Array) -> Array:
    """Compute `weigh` in numpy, for any sensor of one or two numbers: sender by sender, in rows that have a reading."""
    logw = logw.copy()
    for j in range(z.shape[1]):
        rows = np.flatnonzero(~np.isnan(z[:, j]).any(-1))
        if len(rows):
            w, m, P = (part[rows, None, j] for part in sent)  # (p, 1, K, ...)
            y, _, J = sensor.innovation(x[rows, :, None], m, z[rows, None, None, j])
            logs = log_density(y, J @ P @ J.mT + sensor.R, loss_of(sensor))  # (p, N, K)
            absent = np.isnan(y).any(-1) | np.isnan(w) | (w == 0) | ~np.isfinite(logs)  # what overflows says nothing
            nothing = absent.all(-1)
            logs = np.where(absent, -np.inf, logs + np.log(np.where(absent, 1.0, w)))
            top = np.where(nothing, 0.0, logs.max(-1))
            logw[rows] += top + np.log(np.where(nothing, 1.0, np.exp(logs - top[..., None]).sum(-1)))
    return logw


# Particles as a few clusters: the widest is halved at its mean, along its widest axis, until there are K.
#
# Source: A. Prorok, A. Bahr, A. Martinoli, "Low-cost collaborative localization for large-scale multi-robot systems",
# ICRA 2012: a cost of K passes over the particles, with no iteration.

WEIGHT, X, Y, XX, XY, YY = range(NUMBERS)


def clusters(x: Array, w: Array, K: int) -> Mixture:
    """Return at most K clusters (r, K) of particles x (r, N, d) with weights w (r, N); the rest are nan."""
    out = np.full((len(x), K, NUMBERS), np.nan)
    _cluster_rows(readable(x[..., :2]), readable(w), out)
    return unpack(out.reshape(len(x), K * NUMBERS))


@kernel
def _cluster_rows(x, w, out):
    label = np.empty(w.shape[1], np.int64)
    for r in range(len(w)):
        label[:] = 0
        _moments(x, w, r, label, 0, out)
        for new in range(1, out.shape[1]):
            widest, axis, most = -1, 0, 0.0
            for k in range(new):
                for a in range(2):
                    variance = out[r, k, YY] if a == 1 else out[r, k, XX]
                    if variance > most:
                        widest, axis, most = k, a, variance
            if widest < 0:
                break
            middle = out[r, widest, X + axis]
            for i in range(len(label)):
                if label[i] == widest and x[r, i, axis] > middle:
                    label[i] = new
            _moments(x, w, r, label, widest, out)
            _moments(x, w, r, label, new, out)


@kernel
def _moments(x, w, r, label, k, out):
    """Write the share, mean and covariance of cluster k of row r."""
    total, mx, my = 0.0, 0.0, 0.0
    for i in range(len(label)):
        if label[i] == k:
            total += w[r, i]
            mx += w[r, i] * x[r, i, 0]
            my += w[r, i] * x[r, i, 1]
    if not total > 0.0:
        out[r, k, :] = np.nan
        return
    mx, my = mx / total, my / total
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(len(label)):
        if label[i] == k:
            ex, ey = x[r, i, 0] - mx, x[r, i, 1] - my
            xx += w[r, i] * ex * ex
            xy += w[r, i] * ex * ey
            yy += w[r, i] * ey * ey
    out[r, k, WEIGHT], out[r, k, X], out[r, k, Y] = total, mx, my
    out[r, k, XX], out[r, k, XY], out[r, k, YY] = xx / total, xy / total, yy / total


# A few particles as a density: kernels N(m + a (x_s - m), h^2 P) around a sample of them, with a = sqrt(1 - h^2), which
# keep mean m and covariance P. h = S^(-1/6) is Scott's rule for S samples of two numbers.
#
# Source: J. Liu, M. West, "Combined parameter and state estimation in simulation-based filtering", 2001; D. Scott,
# "Multivariate density estimation", 1992.


def sample(x: Array, logw: Array, u: Array, S: int) -> Array:
    """Return the packet (r, 3 + 2 S) of particles x (r, N, d): the kernel's P_xx, P_xy, P_yy, then S kernels' places.

    The places are a systematic sample of the particles by their log-weights (r, N), with one uniform u (r,) per row.
    """
    mean, P = summary(x[..., :2], logw)
    points = (np.arange(S) + u[:, None]) / S
    cumulated = np.cumsum(weights(logw), -1)
    chosen = np.stack([np.searchsorted(c, p) for c, p in zip(cumulated, points, strict=True)])
    chosen = np.minimum(chosen, x.shape[1] - 1)  # where rounding leaves the sum below 1
    h2 = S ** (-1 / 3)
    away = np.take_along_axis(x[..., :2], chosen[..., None], 1) - mean[:, None]
    places = mean[:, None] + np.sqrt(1 - h2) * away
    return np.concatenate([h2 * P[:, (0, 0, 1), (0, 1, 1)], places.reshape(len(x), 2 * S)], -1)


def density(packets: Array) -> Mixture:
    """Return the density of packets (..., 3 + 2 S), as a mixture of S equal kernels; nan where there is no packet."""
    H = np.stack([packets[..., 0:2], packets[..., 1:3]], -2)[..., None, :, :]
    places = packets[..., 3:].reshape(*packets.shape[:-1], (packets.shape[-1] - 3) // 2, 2)
    w = np.where(np.isnan(places[..., 0]), np.nan, 1 / places.shape[-2])
    return Mixture(w, places, np.broadcast_to(H, (*places.shape, 2)))
