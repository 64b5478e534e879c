"""Delivers what robots sent over the links that hold, and counts it; compiled, as every tick needs both."""

import numba
import numpy as np

from cooploc.estimators.compiled.jit import readable
from cooploc.estimators.interface import HEADER, Array, Mail, Mask, Traffic


def deliver(sent: Array, robots: int, link: Mask, rssi: Array, distance: Array) -> Mail:
    """What reaches each robot: a packet in which anything was said, where its link holds. A nan carries no message.

    Args:
        sent: (t n, m) for everyone, or (t n, n, m) with axis 1 the addressee.
        robots: n.
        link: (t, n, n) with axis 1 the receiver, as in what follows.
        rssi: (t, n, n) [dBm]
        distance: (t, n, n) [m]

    """
    t, n, m = len(link), robots, sent.shape[-1]
    if sent.dtype == np.float16:  # which numba cannot read
        mail = deliver(sent.astype(np.float32), robots, link, rssi, distance)
        return mail._replace(packets=mail.packets.astype(np.float16))
    heard, packets = np.empty((t, n, n), bool), np.empty((t, n, n, m), sent.dtype)
    signal, away = np.empty((t, n, n)), np.empty((t, n, n))
    wire = readable(sent.reshape(t, n, -1, m) if m else np.empty((t, n, 1, 0)))
    _deliver(wire, readable(link), readable(rssi), readable(distance), heard, packets, signal, away)
    return Mail(*(a.reshape(t * n, *a.shape[2:]) for a in (heard, packets, signal, away)))  # type: ignore[arg-type]


def count(sent: Array, awake: Mask) -> Traffic:
    """Messages and bytes of what the robots `awake` (t, n) sent, whether it arrives or not; none to oneself."""
    t, n = awake.shape
    messages, size = np.zeros((t, n)), np.zeros((t, n))
    if sent.shape[-1]:
        wire = readable(sent.astype(float, copy=False).reshape(t, n, -1, sent.shape[-1]))
        _count(wire, readable(awake), sent.ndim == 3, sent.itemsize, messages, size)
    return Traffic(messages, size)


@numba.njit(cache=True)
def _deliver(wire, link, rssi, distance, heard, packets, signal, away):
    t, n, addressees, m = wire.shape
    for s in range(t):
        for i in range(n):
            for j in range(n):
                to, said = min(i, addressees - 1), False
                for c in range(m):
                    said |= not np.isnan(wire[s, j, to, c])
                heard[s, i, j] = hears = link[s, i, j] and said
                signal[s, i, j] = rssi[s, i, j] if hears else np.nan
                away[s, i, j] = distance[s, i, j] if hears else np.nan
                for c in range(m):
                    number = wire[s, j, to, c]
                    packets[s, i, j, c] = number if hears and not np.isnan(number) else np.nan


@numba.njit(cache=True)
def _count(wire, awake, addressed, itemsize, messages, size):
    t, n, addressees, m = wire.shape
    for s in range(t):
        for j in range(n):
            for to in range(addressees):
                numbers = 0
                for c in range(m):
                    numbers += not np.isnan(wire[s, j, to, c])
                if numbers and awake[s, j] and not (addressed and to == j):
                    messages[s, j] += 1
                    size[s, j] += numbers * itemsize + HEADER
