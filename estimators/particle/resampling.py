"""Systematic resampling, compiled by numba: one uniform number per row chooses all its particles.

filterpy's `systematic_resample`, but with the uniform given and without its global generator.
"""

import numpy as np

from cooploc.estimators.compiled.jit import inlined, kernel, readable, wide
from cooploc.estimators.interface import Array, Indices

FRACTION = 40  # bits behind the point of an expected count


def systematic(w: Array, u: Array) -> Indices:
    """The ancestors (r, n) of all places, for weights w (r, n) that sum to one and one uniform u (r,) per row."""
    out = np.empty(w.shape, np.int64)
    _fill_ancestors(readable(w), readable(u), out)
    return out


@inlined
def mark_ancestors(w, total, u, count, out):
    """Systematic resampling of one row without branches, for weights w (n,) that sum to `total`.

    Particle j takes the places from ceil(n C_j-1 - u) on, C the cumulative weights in fixed point. Each writes its
    number at its first place, over an earlier one that takes none. A running maximum of `out` (n + 1,) then is the
    ancestor of every place; its last entry is for particles that take no place. `count` (n,) is scratch.
    """
    wide()
    n = len(count)
    scale = n / total * 2.0**FRACTION
    for j in range(n):
        count[j] = np.int64(w[j] * scale + 0.5)
        out[j] = 0
    last = np.uint64(n)
    cumulated = (1 << FRACTION) - 1 - np.int64(u * 2.0**FRACTION)
    for j in range(n):
        place = np.uint64(cumulated >> FRACTION)  # where weights are nan it may be negative, which is large here
        out[place if place < last else last] = j
        cumulated += count[j]


@kernel
def _fill_ancestors(w, u, out):
    n = w.shape[1]
    count, marks = np.empty(n, np.int64), np.empty(n + 1, np.int64)
    for r in range(w.shape[0]):
        mark_ancestors(w[r], 1.0, u[r], count, marks)
        latest = 0
        for i in range(n):
            latest = max(latest, marks[i])
            out[r, i] = latest
