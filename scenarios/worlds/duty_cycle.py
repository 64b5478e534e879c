"""Robots that wake at their own rate, and what their sleep does to a trial's readings.

A robot that sleeps in a tick senses and sends nothing, and nothing reaches it; its odometry and `dt` at the next waking
cover the whole time since the last one.
"""

import numpy as np

from cooploc.estimators.interface import Array, Mask


def awake(ticks: int, rate: Array, phase: Array) -> Mask:
    """Who is awake when (T, n): a robot of rate f wakes f times a tick on average, evenly, shifted by its phase."""
    k = np.arange(ticks + 1)[:, None]
    count = np.floor(k * rate + phase + 1e-9)
    woke: Mask = count[1:] > count[:-1]
    return woke


def since(wake: Mask) -> Array:
    """Ticks covered (T, n) by a waking robot's odometry, 0 for one that sleeps."""
    k = np.arange(1, len(wake) + 1)[:, None]
    last = np.maximum.accumulate(np.where(wake, k, 0), axis=0)
    before = np.vstack([np.zeros_like(last[:1]), last[:-1]])
    return np.where(wake, k - before, 0).astype(float)


def gathered(odometry: Array, wake: Mask) -> Array:
    """Per-tick displacements (T, n, 2) summed over what each waking covers; nan while asleep."""
    if wake.all():
        return odometry
    total = np.cumsum(odometry, axis=0)
    covered = since(wake).astype(int)
    k = np.arange(len(wake))[:, None]
    start = k - covered  # the last waking, -1 before the first
    before = np.where((start >= 0)[..., None], total[np.maximum(start, 0), np.arange(wake.shape[1])], 0.0)
    return np.where(wake[..., None], total - before, np.nan)
