"""Compiled loops of the particle filters: resampling, likelihoods over links and directions, a tick of a row."""

from typing import NamedTuple

import numpy as np

from cooploc.estimators import compiled, random_numbers
from cooploc.estimators.compiled import extent, fill, inlined, is_single, kernel, ln, load, row_buffer, store, wide
from cooploc.estimators.interface import Array, Indices
from cooploc.estimators.models import NEAR, TOO_NEAR_TO_RANGE

FRACTION = 40  # bits behind the point of an expected count


def systematic(w: Array, u: Array) -> Indices:
    """Resample systematically: ancestors (r, n) by weights w (r, n) that sum to one and a uniform u (r,) per row."""
    out = np.empty(w.shape, np.int64)
    _fill_ancestors(compiled.readable(w), compiled.readable(u), out)
    return out


@inlined
def mark_ancestors(w, total, u, count, out):
    """Resample one row without branches, for weights w (n,) that sum to `total`; `count` (n,) is scratch.

    Particle j takes the places from ceil(n C_j-1 - u) on, C the cumulative weights in fixed point, and writes its
    number at the first. A running maximum of `out` (n + 1,) then is the ancestor of every place.
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


# Links (anchors, teammates), links in the outer loop.
#
# With D the squared distance and z = A - slope ln D, the variance of an RSSI is v = m/D^2. Some links share a division
# and a logarithm: sum y^2/v + ln v = over/under + ln under - 2 sum ln D, with under = prod m and over/under = sum (y
# D)^2/m; all in units of the noise, sigma = 1, without constants that all particles share.
#
# Where the box of a row's particles, seen from a link's place, spans little of D, ln D is ln D_0 and a short polynomial
# of D/D_0 - 1, D_0 the middle; such links are "far", the others "near".
#
# In single precision products stay within 1e-38 and 1e38: only four links between robots share a logarithm, D is in
# units of D_0 for far links, v is a ratio for near ones, and no variance counts as more than `VAGUE`.

FIXED, RSSI, RANGE = range(3)  # kinds of links
NUMBERS = 8  # per link, for the loops
VAGUE = 2.0**30  # times the noise's variance: what the sender's position adds at most, in single precision
MANY = 8  # links between robots: with fewer, sorting them costs more than it saves


class Row(NamedTuple):
    """The particles of one row, in buffers."""

    X: Array  # (n,) [m]
    Y: Array  # (n,) [m]
    logw: Array  # (n,)


@kernel
def add_anchor_rows(x, d, logw, anchors, out):
    """Write `particle_likelihood.anchors` of RSSI, for particles x (r d, N)."""
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
    """Return buffers for one row of particles."""
    return Row(row_buffer(logw), row_buffer(logw), row_buffer(logw))


@inlined
def load_row(x, d, logw, r, row):
    """Load row r of particles x (r d, N) into buffers."""
    load(x, d * r, row.X)
    load(x, d * r + 1, row.Y)
    load(logw, r, row.logw)


@inlined
def add_anchors(row, box, r, anchors, links):
    """Add row r of `anchors`, with the particles' box and scratch for the links that were heard."""
    places, readings, A, slope, unit = anchors
    far, near, ln_unit = np.int64(0), np.int64(0), np.log(unit)  # a literal 0 would be compiled as a type of its own
    for a in range(len(places)):
        z = readings[r, a]
        if not np.isnan(z):
            link = places[a, 0], places[a, 1], z - A, 0.0, 0.0, 0.0
            far, near = _write_link(FIXED, links, (far, near), box, link, (slope, unit, ln_unit))
    _add_links(FIXED, True, row, links, np.int64(0), far, slope * unit)
    _add_links(FIXED, False, row, links, len(links) - near, len(links), slope * unit)


@kernel
def add_teammate_rows(x, d, logw, heard, out):
    """Write `particle_likelihood.teammates` of RSSI or ranges, for particles x (r d, N)."""
    wide()
    row, links = row_of(logw), np.empty((heard[1].shape[1], NUMBERS), logw.dtype)
    for r in range(len(logw)):
        load_row(x, d, logw, r, row)
        add_teammates(row, r, heard, links)
        store(row.logw, out, r)


@inlined
def add_teammates(row, r, heard, links):
    """Add row r of `teammates`, with scratch for the links that were heard."""
    packets, readings, ranged, A, slope, unit, gain = heard
    far, near, ln_unit = np.int64(0), np.int64(0), np.log(unit)  # a literal 0 would be compiled as a type of its own
    box = np.nan, np.nan, np.nan, np.nan  # no link is far from such a box
    if len(links) >= MANY and not ranged:
        (west, east), (south, north) = extent(row.X), extent(row.Y)
        box = west, east, south, north
    for j in range(len(links)):
        z, qx, qy = readings[r, j], packets[r, j, 0], packets[r, j, 1]
        if np.isnan(z) or np.isnan(qx) or np.isnan(qy) or (ranged and z < TOO_NEAR_TO_RANGE):
            continue
        xx, xy, yy = gain * packets[r, j, 2], 2 * gain * packets[r, j, 3], gain * packets[r, j, 4]
        link = qx, qy, z - A, xx, xy, yy
        far, near = _write_link(RSSI, links, (far, near), box, link, (slope, unit, ln_unit))
    if ranged:
        _add_links(RANGE, False, row, links, len(links) - near, len(links), -unit)
    else:
        _add_links(RSSI, True, row, links, np.int64(0), far, slope * unit)
        _add_links(RSSI, False, row, links, len(links) - near, len(links), slope * unit)


@inlined
def _write_link(kind, links, count, box, link, sensor):
    """Write what the loops need of a link, far ones from the front, near ones from the back; return the count of both.

    The place, the reading less the one at D = 1, or at D_0, the place's covariance in units of the noise, 1/D_0, and a
    constant.
    """
    (far, near), (west, east, south, north), (slope, unit, ln_unit) = count, box, sensor
    qx, qy, lost, xx, xy, yy = link
    half_x, half_y = (east - west) / 2, (north - south) / 2
    dx, dy = abs((west + east) / 2 - qx), abs((south + north) / 2 - qy)
    far_x, far_y, near_x, near_y = dx + half_x, dy + half_y, max(dx - half_x, 0.0), max(dy - half_y, 0.0)
    largest = far_x * far_x + far_y * far_y  # nan where a particle is, and then the link counts as near
    least = near_x * near_x + near_y * near_y
    middle = (least + largest) / 2
    if least > NEAR**2 and largest - least <= 2 * compiled.COMPACT * middle:
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
def _add_links(kind, far, row, links, k, last, slope):
    """Add links from k to the last: eight at a time where numbers reach far enough, then four, two, one."""
    if kind == FIXED or not is_single(row.X[0]):
        while k + 8 <= last:
            _add_group(kind, far, _four(links, k) + _four(links, k + 4), row, links, k, slope)
            k += 8
    while k + 4 <= last:
        _add_group(kind, far, _four(links, k), row, links, k, slope)
        k += 4
    if k + 2 <= last:
        _add_group(kind, far, (_numbers(links, k), _numbers(links, k + 1)), row, links, k, slope)
        k += 2
    if k < last:
        _add_group(kind, far, (_numbers(links, k),), row, links, k, slope)


@inlined
def _add_group(kind, far, group, row, links, k, slope):
    """Add links from k on, the numbers of each in `group`: its length is a type, `kind` and `far` are constants."""
    wide()
    X, Y, logw = row
    real = X.dtype.type
    slope, half, constant = real(slope), real(0.5), real(0.0)
    for j in range(len(group)):
        constant += links[k + j, 7]
    for i in range(len(logw)):
        x, y = X[i], Y[i]
        sums = _link(kind, far, x, y, group[0], slope)
        if len(group) > 1:
            sums = _join(sums, _link(kind, far, x, y, group[1], slope))
        if len(group) > 2:
            two = _join(_link(kind, far, x, y, group[2], slope), _link(kind, far, x, y, group[3], slope))
            sums = _join(sums, two)
        if len(group) > 4:
            two = _join(_link(kind, far, x, y, group[4], slope), _link(kind, far, x, y, group[5], slope))
            last = _join(_link(kind, far, x, y, group[6], slope), _link(kind, far, x, y, group[7], slope))
            sums = _join(sums, _join(two, last))
        sum_ln, over, under = sums
        if kind == FIXED:
            logw[i] += constant - half * over
        else:
            logw[i] += (constant + sum_ln) - half * (over / under + ln(under))


@inlined
def _four(links, k):
    return _numbers(links, k), _numbers(links, k + 1), _numbers(links, k + 2), _numbers(links, k + 3)


@inlined
def _numbers(links, k):
    return links[k, 0], links[k, 1], links[k, 2], links[k, 3], links[k, 4], links[k, 5], links[k, 6]


@inlined
def _join(a, b):
    """Return the sums over two groups of links: of ln D, and of (y D)^2/m as a fraction."""
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
        ln_D = compiled.log1p_compact(D - one if is_single(D) else D * inverse - one)
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


# Past directions of arrival, and gradients.

# The forms of a direction's residual, by the length of a tuple: that is a type.
FORMS = {"wrapped": (0,), "sum": (0, 0), "corners": (0, 0, 0)}


@kernel
def add_gradient_rows(x, d, logw, gradients, out):
    """Add log N of the measured gradient less the one at the particle, in units of its noise, for particles x (r d, N).

    `gradients`: measured (r, 2) [dB/m], nan where absent; the first corner and the sides (2,) [m]; RSSI lost per unit
    of ln D, D the squared distance [dB]; sigma [dB].
    """
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
    """Add one gradient (u, v), for particles seen from the first corner."""
    wide()
    (X, Y, logw), real = row, row.X.dtype.type
    u, v, west, south = real(whitened[0]), real(whitened[1]), real(corner[0]), real(corner[1])
    a, b, slope, half = real(sides[0]), real(sides[1]), real(slope), real(0.5)
    for i in range(len(logw)):
        p, q = _log_ratios(X[i] - west, Y[i] - south, a, b)
        gx, gy = u - slope * (p + q), v - slope * (p - q)
        logw[i] -= half * (gx * gx + gy * gy)


@kernel
def add_window_rows(x, d, logw, directions, form, out):
    """Add gain e^2 for each direction and particle of x (r d, N), compiled apart for each of the `FORMS`.

    e is the angle between the direction and the gradient g at the particle; "sum": four times the difference of the two
    angles, not wrapped; "corners": the sum over the corners of the particle's direction from each less the direction.

    `directions`: angles (r, M) [rad], nan where absent; where the robot was then, seen from where it is now (r, M, 2)
    [m]; the first corner and the sides (2,) [m]; the gain -1/2 power / sigma^2 [1/rad^2].
    """
    wide()
    angles, trail, corner, sides, gain = directions
    row = row_of(logw)
    for r in range(len(logw)):
        load_row(x, d, logw, r, row)
        for k in range(angles.shape[1]):
            if not np.isnan(angles[r, k]):
                shift = trail[r, k, 0] - corner[0], trail[r, k, 1] - corner[1]
                _add_direction(form, row, angles[r, k], shift, (sides[0], sides[1]), gain)
        store(row.logw, out, r)


@inlined
def _add_direction(form, row, angle, shift, sides, gain):
    """Add one direction, with particles shifted by (east, north) to where they were then, seen from the first corner.

    With D_k the squared distances to the four corners, g_x ~ (ln p + ln q) / a and g_y ~ (ln p - ln q) / b, p = D_1/D_3
    and q = D_2/D_4. Turned back by the direction, g has the angle e, which needs no wrapping.
    """
    wide()
    (X, Y, logw), (east, north), (a, b), real = row, shift, sides, row.X.dtype.type
    cx, cy = real(np.cos(angle) / a), real(np.sin(angle) / b)
    sx, sy = real(np.sin(angle) / a), real(np.cos(angle) / b)
    east, north, a, b, gain, angle, four = real(east), real(north), real(a), real(b), real(gain), real(angle), real(4)
    for i in range(len(logw)):
        w, s = X[i] + east, Y[i] + north
        if len(form) == 3:
            e = _direction(s, w) + _direction(s - b, w) + _direction(s - b, w - a) + _direction(s, w - a) - four * angle
        else:
            p, q = _log_ratios(w, s, a, b)
            if len(form) == 2:
                e = four * (_direction((p - q) / b, (p + q) / a) - angle)
            else:
                gx, gy = p + q, p - q
                e = compiled.arc(gy * sy - gx * sx, gx * cx + gy * cy)
        logw[i] += gain * (e * e)


@inlined
def _direction(north, east):
    """arctan2 in (-pi, pi]."""
    angle = compiled.arc(north, east)
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
    return compiled.log(D1 * D4 * inverse), compiled.log(D2 * D3 * inverse)


# The two passes of a tick over rows, each row by itself, in buffers. Python hands over plain tuples: numba needs a
# microsecond to recognise each NamedTuple of a call.

BANDWIDTH = 0.3  # h of Liu and West's kernel, times n^(-1/6)


@kernel
def advance_rows(cloud, step, anchors, sends, out, belief):
    """Write `particles.advance` of a cloud into `out`, and where it sends its moments into the belief.

    `cloud`: x (2 r, n), x of a row, then y [m]; logw (r, n); the rows to resample (r,). `step`: odometry (r, 2) [m],
    nan where absent; its standard deviation (r,) [m]; the key (r, 2); the counter of the tick's first random number.
    """
    wide()
    (x, logw, due), (u, sd, key, counter), (x_out, logw_out) = cloud, step, out
    n, links = logw.shape[1], np.empty((len(anchors[0]), NUMBERS), logw.dtype)
    row, w = row_of(logw), row_buffer(logw)
    words, drawn = np.empty((2, len(w)), np.uint32), np.empty((2, n), logw.dtype)
    noise, resampling = (row_buffer(logw), row_buffer(logw)), (np.empty(n, np.int64), np.empty(n + 1, np.int64))
    for r in range(len(logw)):
        k = np.int64(key[r, 0]), np.int64(key[r, 1])
        load(logw, r, row.logw)
        if due[r]:
            load(x, 2 * r, row.X)
            load(x, 2 * r + 1, row.Y)
            _resample_row(row, k, counter - random_numbers.PURPOSES, w, noise, resampling, words, drawn)
        random_numbers.draw_words(k[0], k[1], counter + random_numbers.MOVE, words)
        random_numbers.normal_pairs(words, row.X, row.Y)
        if due[r]:
            fill(row.logw, 0, 0.0)
            west, east = _move(drawn, 0, u[r, 0], sd[r], row.X)
            south, north = _move(drawn, 1, u[r, 1], sd[r], row.Y)
        else:
            west, east = _move(x, 2 * r, u[r, 0], sd[r], row.X)
            south, north = _move(x, 2 * r + 1, u[r, 1], sd[r], row.Y)
        store(row.X, x_out, 2 * r)
        store(row.Y, x_out, 2 * r + 1)
        if len(links) > 0:
            add_anchors(row, (west, east, south, north), r, anchors, links)
        store(row.logw, logw_out, r)
        if sends:
            _write_moments(belief, r, row, n, w)


@inlined
def _move(rows, r, way, sd, noise):
    """Move one axis of a row's particles, in the place of the noise; return their extent."""
    wide()
    n, real = rows.shape[1], rows.dtype.type
    way, sd = real(0.0 if np.isnan(way) else way), real(sd)
    low = high = compiled.order(rows[r, 0] + way + sd * noise[0])
    for i in range(n):
        noise[i] = rows[r, i] + way + sd * noise[i]
        low, high = min(low, compiled.order(noise[i])), max(high, compiled.order(noise[i]))
    fill(noise, n, noise[0])
    return compiled.order(low), compiled.order(high)


@inlined
def _resample_row(row, key, counter, w, noise, resampling, words, drawn):
    """Resample one row: m + shrink (x_a - m) + h L noise, L the Cholesky factor of P, which may be singular."""
    wide()
    (X, Y, _), (east, north), (copies, marks) = row, noise, resampling
    n = len(copies)
    h = BANDWIDTH * n ** (-1 / 6)
    shrink = np.sqrt(1 - h * h)
    total, _, mx, my, xx, xy, yy = _compute_moments(row, n, w)
    u, _ = random_numbers.uniform_pair(key[0], key[1], counter + random_numbers.RESAMPLE, 0)
    mark_ancestors(w, total, u, copies, marks)
    random_numbers.draw_words(key[0], key[1], counter + random_numbers.JITTER, words)
    random_numbers.normal_pairs(words, east, north)
    mx, my = (1 - shrink) * mx, (1 - shrink) * my
    a = np.sqrt(max(xx, 0.0))
    b = xy / a if a > 0 else 0.0
    c = h * np.sqrt(max(yy - b * b, 0.0))
    real, a, b = X.dtype.type, h * a, h * b
    shrink, mx, my, a, b, c = real(shrink), real(mx), real(my), real(a), real(b), real(c)
    ancestor = 0
    for i in range(n):
        ancestor = max(ancestor, marks[i])
        j = np.uint64(ancestor)
        g0, g1 = east[i], north[i]
        drawn[0, i] = shrink * X[j] + (mx + a * g0)
        drawn[1, i] = shrink * Y[j] + (my + (b * g0 + c * g1))


@inlined
def _write_moments(belief, r, row, n, w):
    """Write the moments of a row into the belief; return the sum of its weights and of their squares."""
    total, squares, mx, my, xx, xy, yy = _compute_moments(row, n, w)
    mean, P = belief
    if is_single(total):  # rounding may leave a correlation above 1
        most = np.sqrt(np.float64(xx) * np.float64(yy))
        xy = min(max(xy, -most), most)
    mean[r, 0], mean[r, 1] = mx, my
    P[r, 0, 0], P[r, 0, 1], P[r, 1, 0], P[r, 1, 1] = xx, xy, xy, yy
    return total, squares


@inlined
def _compute_moments(row, n, w):
    """Write the weights of a row of n, all equal where it is only -inf; return their sum, squares, and the moments."""
    wide()
    X, Y, logw = row
    fill(logw, n, -np.inf)
    _, top = extent(logw)
    zero = logw.dtype.type(0.0)
    if top == -np.inf:
        top = zero
        for i in range(n):
            logw[i] = zero
    if is_single(top):  # few digits: what all share is left out
        for i in range(len(logw)):
            logw[i] -= top
        top = zero
    total, squares, mx, my = zero, zero, zero, zero
    for i in range(len(logw)):
        w[i] = compiled.exp(logw[i] - top)
        total += w[i]
        squares += w[i] * w[i]
        mx += w[i] * X[i]
        my += w[i] * Y[i]
    mx, my = mx / total, my / total
    xx, xy, yy = zero, zero, zero
    for i in range(len(logw)):
        ex, ey = X[i] - mx, Y[i] - my
        xx += w[i] * (ex * ex)
        xy += w[i] * (ex * ey)
        yy += w[i] * (ey * ey)
    return total, squares, mx, my, xx / total, xy / total, yy / total


@kernel
def summarize_rows(x, logw, heard, belief, logw_out, due):
    """Write `particles.posterior_summary` for particles x (2 r, n) into all that follows `heard`."""
    wide()
    n, links = logw.shape[1], np.empty((heard[1].shape[1], NUMBERS), logw.dtype)
    row, w = row_of(logw), row_buffer(logw)
    for r in range(len(logw)):
        load_row(x, 2, logw, r, row)
        add_teammates(row, r, heard, links)
        total, squares = _write_moments(belief, r, row, n, w)
        due[r] = total * total < n / 2 * squares
        store(row.logw, logw_out, r)
