"""What a robot remembers of the packets it received: the last M of each sender, for the product over past samples.

"To get the weight for the probability based on the shared information from all neighboring robots, we can use the
Gaussian probability formula same as (Eq. 5) with RSSI as an error": and eq. (5) is a product over M past samples.

Source: Latif & Parasuraman, "Synergistic Localization", eqs. (5)-(8).
"""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Motion, Senses
from cooploc.estimators.models.motion import Displacement
from cooploc.estimators.particle.likelihood import ReceivedPackets, teammates


class PastPackets(NamedTuple):
    """The last M packets of each sender, the newest first. A tick without a packet leaves a sender's as they are."""

    packets: Array  # (r, n, M, 5)  x, y, P_xx, P_xy, P_yy of the sender then
    readings: Array  # (r, n, M)
    trail: Array  # (r, n, M, 2)  where the robot was then, seen from where it is now [m]


def empty(rows: int, senders: int, samples: int) -> PastPackets:
    """Nothing received yet."""
    shape = rows, senders, samples
    return PastPackets(np.full((*shape, 5), np.nan), np.full(shape, np.nan), np.zeros((*shape, 2)))


def moved(past: PastPackets, motion: Motion, z: Senses) -> PastPackets:
    """The same packets, after the robot's next move."""
    r, n, samples, _ = past.trail.shape
    trail = motion.retrace(past.trail.reshape(r, n * samples, 2), z.odometry, z.dt)
    return past._replace(trail=trail.reshape(past.trail.shape))


def received(past: PastPackets, heard: ReceivedPackets) -> PastPackets:
    """With the packets of this tick in front, where there are any, and the oldest forgotten."""
    here = np.zeros_like(past.trail[:, :, 0])
    newest = PastPackets(heard.packets, heard.readings, here)
    new = ~np.isnan(heard.readings)
    return PastPackets(*(_pushed(memory, one, new) for memory, one in zip(past, newest, strict=True)))


def _pushed(memory: Array, newest: Array, new: Array) -> Array:
    """A memory (r, n, M, ...) with one more entry in front where there is a new one (r, n)."""
    longer = np.concatenate([newest[:, :, None], memory[:, :, :-1]], 2)
    return np.where(new.reshape(*new.shape, *[1] * (memory.ndim - 2)), longer, memory)


def weigh(past: PastPackets, heard: ReceivedPackets, motion: Motion, x: Array, logw: Array, power: float) -> Array:
    """`logw` (r, N) and `power` times the log-likelihoods of the last M readings of each sender heard now.

    Each is taken at the particle shifted back along the path, as past directions are.

    Args:
        past: packets, those of this tick among them.
        heard: the packets of this tick.
        motion: shifts a particle back.
        x: particles (r, N, d).
        logw: log-weights so far.
        power: exponent of every likelihood.

    """
    r, n, samples = past.readings.shape
    readings = np.where(np.isnan(heard.readings)[..., None], np.nan, past.readings)
    total = np.zeros_like(logw)
    if type(motion) is Displacement and heard.compiled:  # the particle moves back, or the sender forth: it is the same
        packets = past.packets.copy()
        packets[..., :2] -= past.trail
        flat = heard._replace(packets=packets.reshape(r, n * samples, 5), readings=readings.reshape(r, n * samples))
        return logw + power * teammates(flat, x, total)
    for j in range(n):
        for k in range(samples):
            there = motion.place(x, past.trail[:, j, None, k])
            one = heard._replace(packets=past.packets[:, j, None, k], readings=readings[:, j, None, k])
            total = teammates(one, there, total)
    return logw + power * total
