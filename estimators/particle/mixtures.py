"""Packets that are mixtures of Gaussians, and the likelihood of a reading of their sender.

A sender's belief is sum_k w_k N(m_k, P_k), with P_k in m^2. A reading z of it has, at a particle x, the likelihood

    sum_k w_k N(z - h(x, m_k); 0, R + J_k P_k J_k'),

the sender's position integrated out of each component, with the sensor linearised in it.
"""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.compiled.jit import readable
from cooploc.estimators.interface import Array, Mask, Sensor
from cooploc.estimators.models.sensors import LogDistance, Range
from cooploc.estimators.particle.likelihood import ReceivedPackets, planes
from cooploc.estimators.particle.mixture_kernels import add_mixture_rows

NUMBERS = 6  # of a component


class Mixture(NamedTuple):
    """Gaussians of positions and their weights, which sum to one; nan where a component is absent."""

    w: Array  # (..., K)
    x: Array  # (..., K, 2) [m]
    P: Array  # (..., K, 2, 2) [m^2]

    def pack(self) -> Array:
        """The packet (..., 6 K): w, x, y, P_xx, P_xy, P_yy of each component."""
        P = self.P
        parts = [self.w, self.x[..., 0], self.x[..., 1], P[..., 0, 0], P[..., 0, 1], P[..., 1, 1]]
        return np.stack(parts, -1).reshape(*self.w.shape[:-1], NUMBERS * self.w.shape[-1])


def unpack(packets: Array) -> Mixture:
    """The mixture in packets (..., 6 K)."""
    parts = packets.reshape(*packets.shape[:-1], packets.shape[-1] // NUMBERS, NUMBERS)
    return Mixture(parts[..., 0], parts[..., 1:3], np.stack([parts[..., 3:5], parts[..., 4:6]], -2))


def log_density(y: Array, S: Array) -> Array:
    """log N(y; 0, S) without its constant, for y (..., k) of one or two numbers; 0 where any of them is absent."""
    if y.shape[-1] == 1:
        distance, det = y[..., 0] ** 2 / S[..., 0, 0], S[..., 0, 0]
    else:
        a, b, c = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
        det = a * c - b * b
        distance = (c * y[..., 0] ** 2 - 2 * b * y[..., 0] * y[..., 1] + a * y[..., 1] ** 2) / det
    return np.where(np.isnan(y).any(-1), 0.0, -0.5 * (distance + np.log(det)))


def weigh(sensor: Sensor, sent: Mixture, z: Array, x: Array, logw: Array) -> Array:
    """`logw` (r, N) and the log-likelihoods of the readings of all senders, at particles x (r, N, d).

    Args:
        sensor: of the readings.
        sent: what each sender believes, (r, n, K).
        z: readings (r, n, k), nan where there is none.
        x: particles.
        logw: log-weights so far.

    """
    if type(sensor) not in (LogDistance, Range):
        return weigh_reference(sensor, sent, z, x, logw)
    out = np.empty_like(logw, order="C")
    number = ReceivedPackets(sensor, sent.pack(), z[..., 0], True).for_loop()
    add_mixture_rows(planes(x), x.shape[-1], readable(logw), tuple(number), out)
    return out


def weigh_reference(sensor: Sensor, sent: Mixture, z: Array, x: Array, logw: Array) -> Array:
    """`weigh` in numpy, for any sensor of one or two numbers: sender by sender, in the rows that have its reading."""
    logw = logw.copy()
    for j in range(z.shape[1]):
        rows = np.flatnonzero(~np.isnan(z[:, j]).any(-1))
        if len(rows):
            w, m, P = (part[rows, None, j] for part in sent)  # (p, 1, K, ...)
            y, _, J = sensor.innovation(x[rows, :, None], m, z[rows, None, None, j])
            logw[rows] += _log_sum(w, log_density(y, J @ P @ J.mT + sensor.R), np.asarray(np.isnan(y).any(-1)))
    return logw


def _log_sum(w: Array, logs: Array, absent: Mask) -> Array:
    """log sum_k w_k exp(logs_k) over the components (..., K) that are not absent; 0 where all are."""
    absent = absent | np.isnan(w) | (w == 0) | ~np.isfinite(logs)  # what overflows says nothing
    logs = np.where(absent, -np.inf, logs + np.log(np.where(absent, 1.0, w)))
    top = np.where(absent.all(-1), 0.0, logs.max(-1))
    total = np.exp(logs - top[..., None]).sum(-1)
    return np.asarray(top + np.log(np.where(absent.all(-1), 1.0, total)))
