"""The compiled loops of likelihood.py over past directions of arrival, and over gradients."""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.compiled.elementary_functions import arc, log
from cooploc.estimators.compiled.jit import inlined, kernel, wide
from cooploc.estimators.compiled.row_buffers import store
from cooploc.estimators.interface import Array
from cooploc.estimators.models.sensors import NEAR
from cooploc.estimators.particle.link_kernels import load_row, row_of

WRAPPED, SUM, CORNERS = range(3)  # forms of the residual


class Directions(NamedTuple):
    """Past directions of arrival, and where the corners are."""

    angles: Array  # (r, M) [rad], nan where absent
    trail: Array  # (r, M, 2)  where the robot was then, seen from where it is now [m]
    corner: Array  # (2,)  the first corner [m]
    sides: Array  # (2,) [m]
    gain: float  # -1/2 power / sigma^2 [1/rad^2]


class Gradients(NamedTuple):
    """A measured gradient per row, and of the sensor what the loop needs."""

    measured: Array  # (r, 2) [dB/m], nan where absent
    corner: Array  # (2,)  the first corner [m]
    sides: Array  # (2,) [m]
    slope: float  # RSSI lost per unit of ln D, D the squared distance [dB]
    sigma: float  # [dB]


@kernel
def add_gradient_rows(x, d, logw, gradients, out):
    """log N of the measured gradient less the one at the particle, in units of its noise, for particles x (r d, N)."""
    wide()
    measured, corner, sides, slope, sigma = gradients
    row = row_of(logw)
    for r in range(len(logw)):
        load_row(x, d, logw, r, row)
        u, v = measured[r, 0] * sides[0] / sigma, measured[r, 1] * sides[1] / sigma
        if not (np.isnan(u) or np.isnan(v)):
            _add_gradient(row, (u, v), (corner[0], corner[1]), (sides[0], sides[1]), slope / (2 * sigma))
        store(row.logw, out, r)


@inlined
def _add_gradient(row, whitened, corner, sides, slope):
    """One gradient (u, v), for particles seen from the first corner."""
    wide()
    (X, Y, logw), real = row, row.X.dtype.type
    u, v, west, south = real(whitened[0]), real(whitened[1]), real(corner[0]), real(corner[1])
    a, b, slope, half = real(sides[0]), real(sides[1]), real(slope), real(0.5)
    for i in range(len(logw)):
        p, q = _log_ratios(X[i] - west, Y[i] - south, a, b)
        gx, gy = u - slope * (p + q), v - slope * (p - q)
        logw[i] -= half * (gx * gx + gy * gy)


@kernel
def add_window_rows(x, d, logw, directions, out):
    """gain e^2, e the angle between the direction and the gradient g at the particle, for particles x (r d, N)."""
    _add_all(WRAPPED, x, d, logw, directions, out)


@kernel
def add_sum_rows(x, d, logw, directions, out):
    """The same with e four times the difference of the two angles, not wrapped."""
    _add_all(SUM, x, d, logw, directions, out)


@kernel
def add_corner_rows(x, d, logw, directions, out):
    """The same with e the sum over the corners of the particle's direction from each less the direction."""
    _add_all(CORNERS, x, d, logw, directions, out)


@inlined
def _add_all(form, x, d, logw, directions, out):
    """All rows and directions. Compiled apart for each `form`, a constant where this is inlined."""
    wide()
    angles, trail, corner, sides, gain = directions
    row = row_of(logw)
    for r in range(len(logw)):
        load_row(x, d, logw, r, row)
        for k in range(angles.shape[1]):
            if not np.isnan(angles[r, k]):
                shift = trail[r, k, 0] - corner[0], trail[r, k, 1] - corner[1]
                if form == WRAPPED:
                    _add_direction(row, angles[r, k], shift, (sides[0], sides[1]), gain)
                else:
                    _add_sum(form, row, angles[r, k], shift, (sides[0], sides[1]), gain)
        store(row.logw, out, r)


@inlined
def _add_direction(row, angle, shift, sides, gain):
    """One direction, with particles shifted by (east, north) to where they were then, seen from the first corner.

    With D_k the squared distances to the four corners, g_x ~ (ln p + ln q) / a and g_y ~ (ln p - ln q) / b, p = D_1/D_3
    and q = D_2/D_4. Turned back by the direction, g has the angle e, which needs no wrapping.
    """
    wide()
    (X, Y, logw), (east, north), (a, b), real = row, shift, sides, row.X.dtype.type
    cx, cy = real(np.cos(angle) / a), real(np.sin(angle) / b)
    sx, sy = real(np.sin(angle) / a), real(np.cos(angle) / b)
    east, north, a, b, gain = real(east), real(north), real(a), real(b), real(gain)
    for i in range(len(logw)):
        p, q = _log_ratios(X[i] + east, Y[i] + north, a, b)
        gx, gy = p + q, p - q
        e = arc(gy * sy - gx * sx, gx * cx + gy * cy)
        logw[i] += gain * (e * e)


@inlined
def _add_sum(form, row, angle, shift, sides, gain):
    """The same with a residual that is a sum over the corners."""
    wide()
    (X, Y, logw), real, four = row, row.X.dtype.type, row.X.dtype.type(4)
    east, north, a, b = real(shift[0]), real(shift[1]), real(sides[0]), real(sides[1])
    angle, gain = real(angle), real(gain)
    for i in range(len(logw)):
        w, s = X[i] + east, Y[i] + north
        if form == SUM:
            p, q = _log_ratios(w, s, a, b)
            e = four * (_direction((p - q) / b, (p + q) / a) - angle)
        else:
            e = _direction(s, w) + _direction(s - b, w) + _direction(s - b, w - a) + _direction(s, w - a) - four * angle
        logw[i] += gain * (e * e)


@inlined
def _direction(north, east):
    """arctan2 in (-pi, pi]."""
    angle = arc(north, east)
    return -angle if north < 0 else angle


@inlined
def _log_ratios(w, s, a, b):
    """ln D_1/D_3 and ln D_2/D_4, D_k the squared distance to corner k, at w east and s north of the first."""
    real = type(w)
    near = real(NEAR**2)
    w2, s2, e2, n2 = w * w, s * s, (w - a) * (w - a), (s - b) * (s - b)
    D1, D2 = max(w2 + s2, near), max(w2 + n2, near)
    D3, D4 = max(e2 + n2, near), max(e2 + s2, near)
    inverse = real(1) / (D3 * D4)
    return log(D1 * D4 * inverse), log(D2 * D3 * inverse)
