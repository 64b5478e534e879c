"""The compiled loops of likelihood.py.

Links come in the outer loop, particles in the inner one. With D the squared distance and z = A - slope ln D, the
variance of an RSSI is v = m/D^2. Some links share a division and a logarithm: sum y^2/v + ln v = over/under + ln under
- 2 sum ln D, with under = prod m and over/under = sum (y D)^2/m; all in units of the noise, sigma = 1.

Particles are a cloud. Where its box, seen from a link's place, spans little of D, ln D is ln D_0 and a short polynomial
of D/D_0 - 1, D_0 the middle; such links are "far", the others "near".
"""

import numpy as np

from cooploc.estimators.compiled.elementary_functions import COMPACT, arc, ln, log, log1p_compact
from cooploc.estimators.compiled.jit import inlined, kernel, wide
from cooploc.estimators.compiled.row_buffers import blank, extent, give, take
from cooploc.estimators.models.sensors import NEAR, TOO_NEAR_TO_RANGE

FIXED, RSSI, RANGE = range(3)  # kinds of links
NUMBERS = 8  # that the loops need of a link
MANY = 8  # links between robots: with fewer, to sort them costs more than it spares


@kernel
def add_anchor_rows(x, d, logw, places, readings, A, slope, unit, out):  # type: ignore[no-untyped-def]
    """`likelihood.anchors` of RSSI, for particles x (r d, N)."""
    wide()
    n, links, ln_unit = logw.shape[1], np.empty((len(places), NUMBERS)), np.log(unit)
    X, Y, total = blank(n), blank(n), blank(n)
    for r in range(len(logw)):
        take(x, d * r, X)
        take(x, d * r + 1, Y)
        take(logw, r, total)
        west, east = extent(X)
        south, north = extent(Y)
        add_anchors(X, Y, (west, east, south, north), r, places, readings, A, slope, unit, ln_unit, links, total)
        give(total, out, r)


@inlined
def add_anchors(X, Y, box, r, places, readings, A, slope, unit, ln_unit, links, total):  # type: ignore[no-untyped-def]
    """Row r of `anchors`, with the particles' box and scratch for the links that were heard."""
    far = near = 0
    for a in range(len(places)):
        z = readings[r, a]
        if not np.isnan(z):
            q = places[a, 0], places[a, 1]
            far, near = _note(FIXED, links, far, near, box, q, z - A, slope, unit, ln_unit, 0.0, 0.0, 0.0)
    _add(FIXED, X, Y, links, far, near, slope * unit, total)


@kernel
def add_teammate_rows(x, d, logw, packets, readings, ranged, A, slope, unit, gain, out):  # type: ignore[no-untyped-def]
    """`likelihood.teammates` of RSSI or ranges, for particles x (r d, N)."""
    wide()
    n, links, ln_unit = logw.shape[1], np.empty((readings.shape[1], NUMBERS)), np.log(unit)
    X, Y, total = blank(n), blank(n), blank(n)
    for r in range(len(logw)):
        take(x, d * r, X)
        take(x, d * r + 1, Y)
        take(logw, r, total)
        add_teammates(X, Y, r, packets, readings, ranged, A, slope, unit, ln_unit, gain, links, total)
        give(total, out, r)


@inlined
def add_teammates(  # type: ignore[no-untyped-def]
    X, Y, r, packets, readings, ranged, A, slope, unit, ln_unit, gain, links, total
):
    """Row r of `teammates`, with scratch for the links that were heard."""
    far = near = 0
    west, east, south, north = np.nan, np.nan, np.nan, np.nan  # no link is far from such a box
    if len(links) >= MANY and not ranged:
        west, east = extent(X)
        south, north = extent(Y)
    box = west, east, south, north
    for j in range(len(links)):
        z, q = readings[r, j], (packets[r, j, 0], packets[r, j, 1])
        if np.isnan(z) or np.isnan(q[0]) or np.isnan(q[1]) or (ranged and z < TOO_NEAR_TO_RANGE):
            continue
        xx, xy, yy = gain * packets[r, j, 2], 2 * gain * packets[r, j, 3], gain * packets[r, j, 4]
        far, near = _note(RSSI, links, far, near, box, q, z - A, slope, unit, ln_unit, xx, xy, yy)
    if ranged:
        _add(RANGE, X, Y, links, 0, near, -unit, total)
    else:
        _add(RSSI, X, Y, links, far, near, slope * unit, total)


@inlined
def _note(kind, links, far, near, box, q, lost, slope, unit, ln_unit, xx, xy, yy):  # type: ignore[no-untyped-def]
    """What the loops need of a link, far ones from the front, near ones from the back; how many there are of both.

    The place, the reading less the one at D = 1, or at D_0, the place's covariance, 1/D_0, and a constant.
    """
    (qx, qy), (west, east, south, north) = q, box
    half_x, half_y = (east - west) / 2, (north - south) / 2
    dx, dy = abs((west + east) / 2 - qx), abs((south + north) / 2 - qy)
    largest = (dx + half_x) ** 2 + (dy + half_y) ** 2  # nan where a particle is, and then the link counts as near
    least = max(dx - half_x, 0.0) ** 2 + max(dy - half_y, 0.0) ** 2
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
    return far, near


@inlined
def _add(kind, X, Y, links, far, near, slope, total):  # type: ignore[no-untyped-def]
    """Add the log-likelihoods of all links to `total`."""
    if kind != RANGE:
        _add_all(kind, True, X, Y, links, 0, far, slope, total)
    _add_all(kind, False, X, Y, links, len(links) - near, len(links), slope, total)


@inlined
def _add_all(kind, far, X, Y, links, k, last, slope, total):  # type: ignore[no-untyped-def]
    """Links from k to the last: eight at a time, then four, two, one."""
    while k + 8 <= last:
        _add_group(kind, far, 8, X, Y, links, k, slope, total)
        k += 8
    if k + 4 <= last:
        _add_group(kind, far, 4, X, Y, links, k, slope, total)
        k += 4
    if k + 2 <= last:
        _add_group(kind, far, 2, X, Y, links, k, slope, total)
        k += 2
    if k < last:
        _add_group(kind, far, 1, X, Y, links, k, slope, total)


@inlined
def _add_group(kind, far, size, X, Y, links, k, slope, total):  # type: ignore[no-untyped-def]
    """Add `size` links. Compiled apart for each `kind`, `far` and `size`, which are constants where this is inlined."""
    wide()
    a, b = _numbers(links, k), _numbers(links, k + min(1, size - 1))
    c, d = _numbers(links, k + min(2, size - 1)), _numbers(links, k + min(3, size - 1))
    e, f = _numbers(links, k + min(4, size - 1)), _numbers(links, k + min(5, size - 1))
    g, h = _numbers(links, k + min(6, size - 1)), _numbers(links, k + min(7, size - 1))
    constant = 0.0
    for j in range(size):
        constant += links[k + j, 7]
    for i in range(len(total)):
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
            total[i] += constant - 0.5 * over
        else:
            total[i] += (constant + sum_ln) - 0.5 * (over / under + ln(under))


@inlined
def _numbers(links, k):  # type: ignore[no-untyped-def]
    return links[k, 0], links[k, 1], links[k, 2], links[k, 3], links[k, 4], links[k, 5], links[k, 6]


@inlined
def _both(a, b):  # type: ignore[no-untyped-def]
    """The sums over two groups of links: of ln D, and of (y D)^2/m as a fraction."""
    return a[0] + b[0], a[1] * b[2] + b[1] * a[2], a[2] * b[2]


@inlined
def _link(kind, far, x, y, link, slope):  # type: ignore[no-untyped-def]
    """ln D, (y D)^2 and m of RSSI, 0, y^2 and v of a range, and 0, y^2, 1 where the variance is the same everywhere.

    The slope of RSSI is J = 2 slope delta / D outside the clamp and 0 inside, that of a range delta / max(d, 0.1 m).
    """
    qx, qy, lost, xx, xy, yy, inverse = link
    dx, dy = x - qx, y - qy
    D = dx * dx + dy * dy
    q = dx * (xx * dx + xy * dy) + yy * (dy * dy)
    if kind == RANGE:
        rest = lost + slope * np.sqrt(D)
        return 0.0, rest * rest, 1.0 + q / max(D, NEAR**2)
    if far:
        ln_D = log1p_compact(D * inverse - 1.0)
    else:
        q = q if D > NEAR**2 else 0.0
        D = max(D, NEAR**2)
        ln_D = ln(D)
    rest = lost + slope * ln_D
    if kind == FIXED:
        return 0.0, rest * rest, 1.0
    return ln_D, (rest * D) * (rest * D), D * D + q


@kernel
def add_window_rows(x, d, logw, angles, trail, corner, sides, gain, out):  # type: ignore[no-untyped-def]
    """gain e^2, e the angle between the direction and the gradient g at the particle.

    With D_k the squared distances to the four corners, g_x ~ (ln p + ln q) / a and g_y ~ (ln p - ln q) / b, p = D_1/D_3
    and q = D_2/D_4. Turned back by the direction, g has the angle e, which needs no wrapping.
    """
    wide()
    n = logw.shape[1]
    X, Y, total = blank(n), blank(n), blank(n)
    for r in range(len(logw)):
        take(x, d * r, X)
        take(x, d * r + 1, Y)
        take(logw, r, total)
        for k in range(angles.shape[1]):
            if not np.isnan(angles[r, k]):
                east, north = trail[r, k, 0] - corner[0], trail[r, k, 1] - corner[1]
                _add_direction(X, Y, angles[r, k], east, north, sides[0], sides[1], gain, total)
        give(total, out, r)


@inlined
def _add_direction(X, Y, angle, east, north, a, b, gain, total):  # type: ignore[no-untyped-def]
    wide()
    cx, cy = np.cos(angle) / a, np.sin(angle) / b
    sx, sy = np.sin(angle) / a, np.cos(angle) / b
    for i in range(len(total)):
        w, s = X[i] + east, Y[i] + north
        w2, s2, e2, n2 = w * w, s * s, (w - a) * (w - a), (s - b) * (s - b)
        D1, D2 = max(w2 + s2, NEAR**2), max(w2 + n2, NEAR**2)
        D3, D4 = max(e2 + n2, NEAR**2), max(e2 + s2, NEAR**2)
        inverse = 1 / (D3 * D4)
        p, q = log(D1 * D4 * inverse), log(D2 * D3 * inverse)
        gx, gy = p + q, p - q
        e = arc(gy * sy - gx * sx, gx * cx + gy * cy)
        total[i] += gain * (e * e)
