"""Particles as a few clusters: the widest is halved at its mean, along its widest axis, until there are K.

Source: A. Prorok, A. Bahr, A. Martinoli, "Low-cost collaborative localization for large-scale multi-robot systems",
ICRA 2012: a cost of K passes over the particles, with no iteration.
"""

import numpy as np

from cooploc.estimators.compiled.jit import kernel, readable
from cooploc.estimators.interface import Array
from cooploc.estimators.particle.mixtures import NUMBERS, Mixture, unpack

WEIGHT, X, Y, XX, XY, YY = range(NUMBERS)


def clusters(x: Array, w: Array, K: int) -> Mixture:
    """The share, mean and covariance (r, K) of at most K clusters of particles x (r, N, d) with weights w (r, N).

    Fewer where nothing is left to divide; the rest are nan.
    """
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
    """The share, mean and covariance of cluster k of row r."""
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
