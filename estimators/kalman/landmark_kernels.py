"""All of a tick's sightings of landmarks in one loop, for the filters that do more with one than update a row.

Each does what its caller does with one landmark after the other, by the same kernels in the same order, bit for bit:
numpy between them would cost ten times what they do where a team has few readings.
"""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.compiled.jit import strict_kernel
from cooploc.estimators.interface import Array
from cooploc.estimators.kalman.decoupled_kernels import TeamReading, master
from cooploc.estimators.kalman.information_kernels import Readings, fill_distances, tally
from cooploc.estimators.kalman.row_kernels import SIGHTING, absorb_row, is_known, linearise_row
from cooploc.estimators.kalman.sequential_kernels import add_scalars
from cooploc.estimators.kalman.split_kernels import split_row


class Sightings(NamedTuple):
    """What a team sees of its landmarks in a tick."""

    places: Array  # (l, 2) [m]
    z: Array  # (t, n, l, 2)  range [m], bearing [rad]; nan where absent
    R: Array  # (2, 2)
    gate: float  # squared Mahalanobis distance beyond which one is refused


@strict_kernel
def _seen(z, s, i, m):
    """Whether robot i of trial s has any number of landmark m."""
    return not (np.isnan(z[s, i, m, 0]) and np.isnan(z[s, i, m, 1]))


@strict_kernel
def update_split(x, Pd, Pi, seen):
    """`EkfSplitCi.correct` in place: x (t, n, d), Pd and Pi (t, n, d, d); all of a landmark's update goes to Pi."""
    places, z, R, gate = seen
    t, n, d = x.shape
    k = 2
    S, B, A, K, T = np.empty((k, k)), np.empty((k, d + 1)), np.empty((d, d)), np.empty((k, d)), np.empty((k, k))
    y, H, P, nothing = np.empty(k), np.empty((k, d)), np.empty((d, d)), np.zeros((k, k))
    for s in range(t):
        for i in range(n):
            for m in range(len(places)):
                if not _seen(z, s, i, m):
                    continue
                linearise_row(SIGHTING, 0.0, 0.0, x[s, i], places[m], z[s, i, m], y, H)
                if not is_known(y, H, R):
                    continue
                for a in range(d):
                    for b in range(d):
                        P[a, b] = Pd[s, i, a, b] + Pi[s, i, a, b]
                absorb_row(x[s, i], P, y, H, R, gate, S, B, A)
                split_row(P, Pd[s, i], Pi[s, i], H, nothing, R, True, Pd[s, i], Pi[s, i], A, K, T)


@strict_kernel
def update_joint(x, P, refused, seen, forget):
    """`EkfJoint._fixed_together` in place: x (t, n, d), P (t, n d, n d), and the share of `refused` readings (t, n)."""
    places, z, R, gate = seen
    t, n, d = x.shape
    k, variances = 2, np.array([R[0, 0], R[1, 1]])
    y, H, nothing = np.empty((t, n, k)), np.empty((t, n, k, d)), np.zeros((t, n, 1, k, d))
    noise, d2, use = np.empty((t, n, 1, k, k)), np.empty((t, n, 1)), np.empty((t, n), np.bool_)
    for s in range(t):
        for i in range(n):
            for a in range(k):
                for b in range(k):
                    noise[s, i, 0, a, b] = R[a, b]
    for m in range(len(places)):
        some = False
        for s in range(t):
            for i in range(n):
                some = some or _seen(z, s, i, m)
        if not some:
            continue
        for s in range(t):
            for i in range(n):
                linearise_row(SIGHTING, 0.0, 0.0, x[s, i], places[m], z[s, i, m], y[s, i], H[s, i])
                d2[s, i, 0] = np.nan
        fill_distances(P, Readings(y.reshape(t, n, 1, k), H.reshape(t, n, 1, k, d), nothing, noise), d2)
        for s in range(t):
            for i in range(n):
                use[s, i] = d2[s, i, 0] <= gate
        add_scalars(x, P, use, y, H, variances)
        tally(d2, gate, False, forget, refused)


@strict_kernel
def update_decoupled(team, seen, heard, used):
    """The masters' updates of `EkfInterim.exchange` in place, and how many each robot made, into `used` (t, n)."""
    places, z, R, gate = seen
    x = team.x
    (t, n, d), k = x.shape, 2
    y, H, hears, at = np.empty((t, k)), np.empty((t, 1, k, d)), np.empty((t, n), np.bool_), np.empty(1, np.int64)
    for m in range(len(places)):
        for a in range(n):
            some = False
            for s in range(t):
                some = some or _seen(z, s, a, m)
            if not some:
                continue
            at[0] = a
            for s in range(t):
                linearise_row(SIGHTING, 0.0, 0.0, x[s, a], places[m], z[s, a, m], y[s], H[s, 0])
                for i in range(n):
                    hears[s, i] = heard[s, i, a]
            took = master(team, a, at, TeamReading(y, H, R), hears, gate)
            for s in range(t):
                used[s, a] += took[s]
