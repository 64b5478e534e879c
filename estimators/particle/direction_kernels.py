"""The compiled loop of likelihood.py over past directions of arrival."""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.compiled.elementary_functions import arc, log
from cooploc.estimators.compiled.jit import inlined, kernel, wide
from cooploc.estimators.compiled.row_buffers import row_buffer, store
from cooploc.estimators.interface import Array
from cooploc.estimators.models.sensors import NEAR
from cooploc.estimators.particle.link_kernels import Row, load_row


class Directions(NamedTuple):
    """Past directions of arrival, and where the corners are."""

    angles: Array  # (r, M) [rad], nan where absent
    trail: Array  # (r, M, 2)  where the robot was then, seen from where it is now [m]
    corner: Array  # (2,)  the first corner [m]
    sides: Array  # (2,) [m]
    gain: float  # -1/2 power / sigma^2 [1/rad^2]


@kernel
def add_window_rows(x, d, logw, directions, out):
    """gain e^2, e the angle between the direction and the gradient g at the particle, for particles x (r d, N).

    With D_k the squared distances to the four corners, g_x ~ (ln p + ln q) / a and g_y ~ (ln p - ln q) / b, p = D_1/D_3
    and q = D_2/D_4. Turned back by the direction, g has the angle e, which needs no wrapping.
    """
    wide()
    angles, trail, corner, sides, gain = directions
    n = logw.shape[1]
    row = Row(row_buffer(n), row_buffer(n), row_buffer(n))
    for r in range(len(logw)):
        load_row(x, d, logw, r, row)
        for k in range(angles.shape[1]):
            if not np.isnan(angles[r, k]):
                east, north = trail[r, k, 0] - corner[0], trail[r, k, 1] - corner[1]
                _add_direction(row, angles[r, k], (east, north), (sides[0], sides[1]), gain)
        store(row.logw, out, r)


@inlined
def _add_direction(row, angle, shift, sides, gain):
    """One direction, with particles shifted by (east, north) to where they were then, seen from the first corner."""
    wide()
    (X, Y, logw), (east, north), (a, b) = row, shift, sides
    cx, cy = np.cos(angle) / a, np.sin(angle) / b
    sx, sy = np.sin(angle) / a, np.cos(angle) / b
    for i in range(len(logw)):
        w, s = X[i] + east, Y[i] + north
        w2, s2, e2, n2 = w * w, s * s, (w - a) * (w - a), (s - b) * (s - b)
        D1, D2 = max(w2 + s2, NEAR**2), max(w2 + n2, NEAR**2)
        D3, D4 = max(e2 + n2, NEAR**2), max(e2 + s2, NEAR**2)
        inverse = 1 / (D3 * D4)
        p, q = log(D1 * D4 * inverse), log(D2 * D3 * inverse)
        gx, gy = p + q, p - q
        e = arc(gy * sy - gx * sx, gx * cx + gy * cy)
        logw[i] += gain * (e * e)
