"""What readings say of every particle: the sums over anchors, teammates and past directions that the filters add up.

`anchors`, `teammates` and `window` take a compiled loop for the sensors of models.py and numpy for any other. The numpy
forms, `*_reference`, state the same densities by the sensor's own `innovation`; tests hold both equal.

Links come in the outer loop, particles in the inner one. With D the squared distance and z = A - slope ln D, the
variance of an RSSI is v = m/D^2. Some links share a division and a logarithm: sum y^2/v + ln v = over/under + ln under
- 2 sum ln D, with under = prod m and over/under = sum (y D)^2/m; all in units of the noise, sigma = 1.

Particles are a cloud. Where its box, seen from a link's place, spans little of D, ln D is ln D_0 and a short polynomial
of D/D_0 - 1, D_0 the middle; such links are "far", the others "near".
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from cooploc.estimators.doa import GradientDoa
from cooploc.estimators.elementary import COMPACT, arc, inlined, kernel, ln, log, log1p_compact, ordered, readable, wide
from cooploc.estimators.interface import Array, Motion, Sensor
from cooploc.estimators.models import NEAR, TOO_NEAR_TO_RANGE, Displacement, LogDistance, Range

FIXED, RSSI, RANGE = range(3)  # kinds of links
NUMBERS = 8  # that the loops need of a link
MANY = 8  # links between robots: with fewer, to sort them costs more than it spares

Fixed = tuple[Sensor, Array, Array]  # of a place: sensor, place (2,), readings (r, 1), as `World.fixed` yields them


def log_normal(y: Array, v: Array) -> Array:
    """log N(y; 0, v) without its constant; 0 where the reading is absent."""
    return np.where(np.isnan(y), 0.0, -0.5 * y**2 / v - 0.5 * np.log(v))


def anchors(fixed: Sequence[Fixed], x: Array, logw: Array) -> Array:
    """`logw` (r, N) and the log-likelihoods of scalar readings of fixed places, at particles x (r, N, d).

    Args:
        fixed: scalar readings of fixed places.
        x: particles.
        logw: log-weights so far.

    """
    if not alike(fixed):
        return anchors_reference(fixed, x, logw)
    out = np.empty_like(logw, order="C")
    _anchors(planes(x), x.shape[-1], readable(logw), *told(fixed, len(x)), out)
    return out


def alike(fixed: Sequence[Fixed]) -> bool:
    """Whether there is a loop for these readings: RSSI by one sensor, or none."""
    return not fixed or (type(fixed[0][0]) is LogDistance and all(sensor is fixed[0][0] for sensor, _, _ in fixed))


def told(fixed: Sequence[Fixed], rows: int) -> tuple[Any, ...]:
    """What that loop is told: places (a, 2), readings (rows, a), and of the sensor A, the slope, 1/sigma."""
    if not fixed:
        return np.empty((0, 2)), np.empty((rows, 0)), 0.0, 0.0, 1.0
    sensor = cast(LogDistance, fixed[0][0])
    readings = np.concatenate([z for _, _, z in fixed], -1)
    return np.array([q for _, q, _ in fixed]), readings, sensor.A, _slope(sensor), 1 / sensor.sigma


def anchors_reference(fixed: Sequence[Fixed], x: Array, logw: Array) -> Array:
    """`anchors` in numpy, for any scalar sensor."""
    for sensor, place, reading in fixed:
        y, _, _ = sensor.innovation(x, place, reading[:, None, :])
        logw = logw + log_normal(y[..., 0], sensor.R[0, 0])
    return logw


class Heard(NamedTuple):
    """What reached each robot: packets, and the radio's reading of each."""

    sensor: Sensor  # of the readings
    packets: Array  # (r, n, 5)  x, y, P_xx, P_xy, P_yy of each sender
    readings: Array  # (r, n)     nan where nothing was heard
    integrate: bool  # senders out, or else take them to be where they say, P_j = 0

    @property
    def compiled(self) -> bool:
        """Whether there is a loop for this sensor."""
        return type(self.sensor) in (LogDistance, Range)

    def told(self) -> tuple[Any, ...]:
        """What that loop is told."""
        packets, readings = readable(self.packets), readable(self.readings)
        if isinstance(self.sensor, LogDistance):
            slope = _slope(self.sensor)
            gain = (2 * slope / self.sensor.sigma) ** 2 if self.integrate else 0.0
            return packets, readings, False, self.sensor.A, slope, 1 / self.sensor.sigma, gain
        precision = 1 / float(self.sensor.R[0, 0])
        return packets, readings, True, 0.0, 0.0, precision**0.5, precision if self.integrate else 0.0


def nothing_heard(rows: int) -> Heard:
    """No packets in any of these rows."""
    return Heard(Range(), np.empty((rows, 0, 5)), np.empty((rows, 0)), False)


def teammates(heard: Heard, x: Array, logw: Array) -> Array:
    """`logw` (r, N) and the log-likelihoods of the readings heard, at particles x (r, N, d).

    The sender is integrated out of each: variance sigma^2 + J P_j J', with J the slope at the particle.
    """
    if not heard.compiled:
        return teammates_reference(heard, x, logw)
    out = np.empty_like(logw, order="C")
    _teammates(planes(x), x.shape[-1], readable(logw), *heard.told(), out)
    return out


def teammates_reference(heard: Heard, x: Array, logw: Array) -> Array:
    """`teammates` in numpy, for any scalar sensor."""
    sensor, packets, readings, integrate = heard
    for j in np.flatnonzero(~np.isnan(readings).all(0)):
        x_j, P_j = unpack(packets[:, j])
        y, _, J = sensor.innovation(x, x_j[:, None, :], readings[:, j, None, None])
        v = sensor.R[0, 0] + np.zeros_like(y[..., 0])
        if integrate:
            J = J[..., 0, :]  # (r, N, 2)
            v = v + ((J @ P_j) * J).sum(-1)
        logw = logw + log_normal(y[..., 0], v)
    return logw


def unpack(packet: Array) -> tuple[Array, Array]:
    """The position (r, 2) and covariance (r, 2, 2) of a packet (r, 5)."""
    return packet[:, :2], np.stack([packet[:, 2:4], packet[:, 3:5]], -2)


def window(
    doa: GradientDoa, motion: Motion, x: Array, logw: Array, angles: Array, trail: Array, density: str, power: float
) -> Array:
    """`logw` (r, N) and `power` times the log-density of past directions, each at the particle shifted back.

    Args:
        doa: the sensor.
        motion: shifts a particle back along the path.
        x: particles (r, N, d).
        logw: log-weights so far.
        angles: directions (r, M) [rad], nan where absent.
        trail: where the robot was then, seen from where it is now (r, M, 2).
        density: "constant" or "exact".
        power: exponent of every density.

    """
    if density != "constant":
        return window_reference(doa, motion, x, logw, angles, trail, density, power)
    if type(motion) is Displacement:
        return _window_at(doa, x, logw, angles, trail, power)
    for k in range(angles.shape[1]):
        there = motion.place(x, trail[:, None, k])
        logw = _window_at(doa, there, logw, angles[:, k : k + 1], np.zeros((len(x), 1, 2)), power)
    return logw


def window_reference(
    doa: GradientDoa, motion: Motion, x: Array, logw: Array, angles: Array, trail: Array, density: str, power: float
) -> Array:
    """`window` in numpy."""
    log_density = doa.log_exact if density == "exact" else doa.log_constant
    for k in range(angles.shape[1]):
        angle = angles[:, k, None]
        if not np.isnan(angle).all():
            there = motion.place(x, trail[:, None, k])
            logw = logw + power * np.where(np.isnan(angle), 0.0, log_density(there, angle))
    return logw


def _window_at(doa: GradientDoa, x: Array, logw: Array, angles: Array, trail: Array, power: float) -> Array:
    out = np.empty_like(logw, order="C")
    corner, sides = np.array(doa.corner), np.array(doa.sides)
    gain = -0.5 * power / doa.sigma**2
    _window(planes(x), x.shape[-1], readable(logw), readable(angles), readable(trail), corner, sides, gain, out)
    return out


def planes(x: Array) -> Array:
    """Particles (r, N, d) as kernels take them, each axis of a row by itself: (r d, N)."""
    r, n, d = x.shape
    return readable(x.transpose(0, 2, 1)).reshape(r * d, n)


def _slope(sensor: LogDistance) -> float:
    """RSSI lost per unit of ln D, D the squared distance [dB]."""
    return float(5 * sensor.eta / np.log(10))


@inlined
def take(rows, r, out):  # type: ignore[no-untyped-def]
    """Row r into scratch, its first entry to the end. A view of the row instead would be a reference to count."""
    wide()
    for i in range(rows.shape[1]):
        out[i] = rows[r, i]
    fill(out, rows.shape[1], rows[r, 0])


@inlined
def fill(out, first, value):  # type: ignore[no-untyped-def]
    """Scratch from `first` on."""
    for i in range(first, len(out)):
        out[np.uint64(i)] = value


@inlined
def give(values, rows, r):  # type: ignore[no-untyped-def]
    """Scratch into row r."""
    wide()
    for i in range(rows.shape[1]):
        rows[r, i] = values[i]


@inlined
def scratch(n):  # type: ignore[no-untyped-def]
    """Room for a row in whole vectors: what is left of a row would be computed one by one."""
    return np.empty((n + 15) // 16 * 16)


@inlined
def extent(values):  # type: ignore[no-untyped-def]
    """The smallest and the largest of a row."""
    wide()
    low = high = ordered(values[0])
    for i in range(len(values)):
        low, high = min(low, ordered(values[i])), max(high, ordered(values[i]))
    return ordered(low), ordered(high)


@kernel
def _anchors(x, d, logw, places, readings, A, slope, unit, out):  # type: ignore[no-untyped-def]
    wide()
    n, links, ln_unit = logw.shape[1], np.empty((len(places), NUMBERS)), np.log(unit)
    X, Y, total = scratch(n), scratch(n), scratch(n)
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
def _teammates(x, d, logw, packets, readings, ranged, A, slope, unit, gain, out):  # type: ignore[no-untyped-def]
    wide()
    n, links, ln_unit = logw.shape[1], np.empty((readings.shape[1], NUMBERS)), np.log(unit)
    X, Y, total = scratch(n), scratch(n), scratch(n)
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
def _window(x, d, logw, angles, trail, corner, sides, gain, out):  # type: ignore[no-untyped-def]
    """gain e^2, e the angle between the direction and the gradient g at the particle.

    With D_k the squared distances to the four corners, g_x ~ (ln p + ln q) / a and g_y ~ (ln p - ln q) / b, p = D_1/D_3
    and q = D_2/D_4. Turned back by the direction, g has the angle e, which needs no wrapping.
    """
    wide()
    n = logw.shape[1]
    X, Y, total = scratch(n), scratch(n), scratch(n)
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
