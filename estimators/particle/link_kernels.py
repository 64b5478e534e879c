"""The compiled loops of likelihood.py over links (anchors, teammates), links in the outer loop.

With D the squared distance and z = A - slope ln D, the variance of an RSSI is v = m/D^2. Some links share a division
and a logarithm: sum y^2/v + ln v = over/under + ln under - 2 sum ln D, with under = prod m and over/under = sum (y
D)^2/m; all in units of the noise, sigma = 1.

Where the box of a row's particles, seen from a link's place, spans little of D, ln D is ln D_0 and a short polynomial
of D/D_0 - 1, D_0 the middle; such links are "far", the others "near".

In single precision products stay within 1e-38 and 1e38: only four links between robots share a logarithm, D is in units
of D_0 for far links, v is taken as a ratio for near ones, and no variance counts as more than `VAGUE`. Constants that
all particles share are left out.
"""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.compiled.elementary_functions import COMPACT, ln, log1p_compact
from cooploc.estimators.compiled.formats import is_single
from cooploc.estimators.compiled.jit import inlined, kernel, wide
from cooploc.estimators.compiled.row_buffers import extent, load, row_buffer, store
from cooploc.estimators.interface import Array
from cooploc.estimators.models.sensors import NEAR, TOO_NEAR_TO_RANGE

FIXED, RSSI, RANGE = range(3)  # kinds of links
NUMBERS = 8  # per link, for the loops
VAGUE = 2.0**30  # times the noise's variance: what the sender's position adds at most, in single precision
MANY = 8  # links between robots: with fewer, sorting them costs more than it saves


class Row(NamedTuple):
    """The particles of one row, in buffers."""

    X: Array  # (n,) [m]
    Y: Array  # (n,) [m]
    logw: Array  # (n,)


class Link(NamedTuple):
    """One place, its reading and its covariance, in units of the reading's noise."""

    x: float
    y: float
    lost: float  # the reading less the one at D = 1
    xx: float
    xy: float
    yy: float


@kernel
def add_anchor_rows(x, d, logw, anchors, out):
    """`likelihood.anchors` of RSSI, for particles x (r d, N)."""
    wide()
    row, links = row_of(logw), np.empty((len(anchors[0]), NUMBERS), logw.dtype)
    for r in range(len(logw)):
        load_row(x, d, logw, r, row)
        west, east = extent(row.X)
        south, north = extent(row.Y)
        add_anchors(row, (west, east, south, north), r, anchors, links)
        store(row.logw, out, r)


@inlined
def row_of(logw):
    """Buffers for one row of particles."""
    return Row(row_buffer(logw), row_buffer(logw), row_buffer(logw))


@inlined
def load_row(x, d, logw, r, row):
    """Row r of particles x (r d, N) into buffers."""
    load(x, d * r, row.X)
    load(x, d * r + 1, row.Y)
    load(logw, r, row.logw)


@inlined
def add_anchors(row, box, r, anchors, links):
    """Row r of `anchors`, with the particles' box and scratch for the links that were heard."""
    places, readings, A, slope, unit = anchors
    far, near, ln_unit = 0, 0, np.log(unit)
    for a in range(len(places)):
        z = readings[r, a]
        if not np.isnan(z):
            link = Link(places[a, 0], places[a, 1], z - A, 0.0, 0.0, 0.0)
            far, near = _note(FIXED, links, (far, near), box, link, (slope, unit, ln_unit))
    _add(FIXED, row, links, (far, near), slope * unit)


@kernel
def add_teammate_rows(x, d, logw, heard, out):
    """`likelihood.teammates` of RSSI or ranges, for particles x (r d, N)."""
    wide()
    row, links = row_of(logw), np.empty((heard[1].shape[1], NUMBERS), logw.dtype)
    for r in range(len(logw)):
        load_row(x, d, logw, r, row)
        add_teammates(row, r, heard, links)
        store(row.logw, out, r)


@inlined
def add_teammates(row, r, heard, links):
    """Row r of `teammates`, with scratch for the links that were heard."""
    packets, readings, ranged, A, slope, unit, gain = heard
    far, near, ln_unit = 0, 0, np.log(unit)
    box = np.nan, np.nan, np.nan, np.nan  # no link is far from such a box
    if len(links) >= MANY and not ranged:
        (west, east), (south, north) = extent(row.X), extent(row.Y)
        box = west, east, south, north
    for j in range(len(links)):
        z, qx, qy = readings[r, j], packets[r, j, 0], packets[r, j, 1]
        if np.isnan(z) or np.isnan(qx) or np.isnan(qy) or (ranged and z < TOO_NEAR_TO_RANGE):
            continue
        xx, xy, yy = gain * packets[r, j, 2], 2 * gain * packets[r, j, 3], gain * packets[r, j, 4]
        link = Link(qx, qy, z - A, xx, xy, yy)
        far, near = _note(RSSI, links, (far, near), box, link, (slope, unit, ln_unit))
    if ranged:
        _add(RANGE, row, links, (0, near), -unit)
    else:
        _add(RSSI, row, links, (far, near), slope * unit)


@inlined
def _note(kind, links, count, box, link, sensor):
    """Write what the loops need of a link, far ones from the front, near ones from the back; the count of both.

    The place, the reading less the one at D = 1, or at D_0, the place's covariance, 1/D_0, and a constant.
    """
    (far, near), (west, east, south, north), (slope, unit, ln_unit) = count, box, sensor
    qx, qy, lost, xx, xy, yy = link
    half_x, half_y = (east - west) / 2, (north - south) / 2
    dx, dy = abs((west + east) / 2 - qx), abs((south + north) / 2 - qy)
    far_x, far_y, near_x, near_y = dx + half_x, dy + half_y, max(dx - half_x, 0.0), max(dy - half_y, 0.0)
    largest = far_x * far_x + far_y * far_y  # nan where a particle is, and then the link counts as near
    least = near_x * near_x + near_y * near_y
    middle = (least + largest) / 2
    if least > NEAR**2 and largest - least <= 2 * COMPACT * middle:
        k, ln_D = far, ln(middle)
        far += 1
    else:
        near += 1
        k, ln_D, middle = len(links) - near, 0.0, 1.0
    links[k, 0], links[k, 1], links[k, 2] = qx, qy, (lost + slope * ln_D) * unit
    links[k, 3], links[k, 4], links[k, 5] = xx, xy, yy
    links[k, 6], links[k, 7] = 1 / middle, ln_unit if kind == FIXED else ln_unit + ln_D
    if is_single(links[k, 7]):
        links[k, 7] = 0.0
        for c in range(3, 6):
            links[k, c] *= links[k, 6] * links[k, 6]
    return far, near


@inlined
def _add(kind, row, links, count, slope):
    """Add the log-likelihoods of all links."""
    far, near = count
    if kind != RANGE:
        _add_all(kind, True, row, links, 0, far, slope)
    _add_all(kind, False, row, links, len(links) - near, len(links), slope)


@inlined
def _add_all(kind, far, row, links, k, last, slope):
    """Links from k to the last: eight at a time where numbers reach far enough, then four, two, one."""
    if kind == FIXED or not is_single(row.X[0]):
        while k + 8 <= last:
            _add_group(kind, far, 8, row, links, k, slope)
            k += 8
    while k + 4 <= last:
        _add_group(kind, far, 4, row, links, k, slope)
        k += 4
    if k + 2 <= last:
        _add_group(kind, far, 2, row, links, k, slope)
        k += 2
    if k < last:
        _add_group(kind, far, 1, row, links, k, slope)


@inlined
def _add_group(kind, far, size, row, links, k, slope):
    """Add `size` links. Compiled apart for each `kind`, `far` and `size`, which are constants where this is inlined."""
    wide()
    X, Y, logw = row
    real = X.dtype.type
    slope, half, constant = real(slope), real(0.5), real(0.0)
    a, b = _numbers(links, k), _numbers(links, k + min(1, size - 1))
    c, d = _numbers(links, k + min(2, size - 1)), _numbers(links, k + min(3, size - 1))
    e, f = _numbers(links, k + min(4, size - 1)), _numbers(links, k + min(5, size - 1))
    g, h = _numbers(links, k + min(6, size - 1)), _numbers(links, k + min(7, size - 1))
    for j in range(size):
        constant += links[k + j, 7]
    for i in range(len(logw)):
        x, y = X[i], Y[i]
        sums = _link(kind, far, x, y, a, slope)
        if size > 1:
            sums = _both(sums, _link(kind, far, x, y, b, slope))
        if size > 2:
            two = _both(_link(kind, far, x, y, c, slope), _link(kind, far, x, y, d, slope))
            sums = _both(sums, two)
        if size > 4:
            two = _both(_link(kind, far, x, y, e, slope), _link(kind, far, x, y, f, slope))
            four = _both(two, _both(_link(kind, far, x, y, g, slope), _link(kind, far, x, y, h, slope)))
            sums = _both(sums, four)
        sum_ln, over, under = sums
        if kind == FIXED:
            logw[i] += constant - half * over
        else:
            logw[i] += (constant + sum_ln) - half * (over / under + ln(under))


@inlined
def _numbers(links, k):
    return links[k, 0], links[k, 1], links[k, 2], links[k, 3], links[k, 4], links[k, 5], links[k, 6]


@inlined
def _both(a, b):
    """The sums over two groups of links: of ln D, and of (y D)^2/m as a fraction."""
    return a[0] + b[0], a[1] * b[2] + b[1] * a[2], a[2] * b[2]


@inlined
def _link(kind, far, x, y, link, slope):
    """ln D, (y D)^2 and m of RSSI, 0, y^2 and v of a range, and 0, y^2, 1 where the variance is the same everywhere.

    The slope of RSSI is J = 2 slope delta / D outside the clamp and 0 inside, that of a range delta / max(d, 0.1 m).
    """
    qx, qy, lost, xx, xy, yy, inverse = link
    zero, one, near, vague = type(x)(0.0), type(x)(1.0), type(x)(NEAR**2), type(x)(VAGUE)
    dx, dy = x - qx, y - qy
    D = dx * dx + dy * dy
    q = dx * (xx * dx + xy * dy) + yy * (dy * dy)
    if kind == RANGE:
        rest, q = lost + slope * np.sqrt(D), q / max(D, near)
        return zero, rest * rest, one + (min(q, vague) if is_single(q) else q)
    if far:
        D = D * inverse if is_single(D) else D
        ln_D = log1p_compact(D - one if is_single(D) else D * inverse - one)
        q = min(q, vague) if is_single(q) else q
    else:
        q = q if near < D else zero
        D = max(D, near)
        ln_D = ln(D)
    rest = lost + slope * ln_D
    if kind == FIXED:
        return zero, rest * rest, one
    if is_single(D) and not far:
        return zero, rest * rest, one + min(q / (D * D), vague)
    return ln_D, (rest * D) * (rest * D), D * D + q
