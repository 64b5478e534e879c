"""What readings say of every particle: the sums over anchors, teammates and past directions that the filters add up.

`anchors`, `teammates` and `window` take a compiled loop for the sensors of models.py and numpy for any other. The numpy
forms, `*_reference`, state the same densities by the sensor's own `innovation`; tests hold both equal.

Links come in the outer loop, particles in the inner one, in blocks that stay in the first cache. With D the squared
distance and z = A - slope ln D, the variance of an RSSI is v = m/D^2. Four links share a division and a logarithm:
sum y^2/v + ln v = over/under + ln under - 2 sum ln D, with under = prod m and over/under = sum (y D)^2/m.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.doa import GradientDoa
from cooploc.estimators.elementary import arc, inlined, kernel, log, readable, wide
from cooploc.estimators.interface import Array, Motion, Sensor
from cooploc.estimators.models import NEAR, TOO_NEAR_TO_RANGE, Displacement, LogDistance, Range

BLOCK = 512  # particles
FIXED, RSSI, RANGE = range(3)  # kinds of links


def log_normal(y: Array, v: Array) -> Array:
    """log N(y; 0, v) without its constant; 0 where the reading is absent."""
    return np.where(np.isnan(y), 0.0, -0.5 * y**2 / v - 0.5 * np.log(v))


def anchors(fixed: Sequence[tuple[Sensor, Array, Array]], x: Array, logw: Array) -> Array:
    """`logw` (r, N) and the log-likelihoods of scalar readings of fixed places, at particles x (r, N, d).

    Args:
        fixed: (sensor, place (2,), reading (r, 1)), as `World.fixed` yields them.
        x: particles.
        logw: log-weights so far.

    """
    sensor = fixed[0][0] if fixed else None
    if type(sensor) is not LogDistance or not all(other is sensor for other, _, _ in fixed):
        return anchors_reference(fixed, x, logw)
    places, readings = np.array([q for _, q, _ in fixed]), np.concatenate([z for _, _, z in fixed], -1)
    out = np.empty_like(logw, order="C")
    _anchors(*_cloud(x), readable(logw), places, readings, sensor.A, _slope(sensor), sensor.sigma**2, out)
    return out


def anchors_reference(fixed: Sequence[tuple[Sensor, Array, Array]], x: Array, logw: Array) -> Array:
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
            gain = 4 * slope**2 if self.integrate else 0.0
            return packets, readings, False, self.sensor.A, slope, self.sensor.sigma**2, gain
        return packets, readings, True, 0.0, 0.0, float(self.sensor.R[0, 0]), 1.0 if self.integrate else 0.0


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
    _teammates(*_cloud(x), readable(logw), *heard.told(), out)
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
    _window(*_cloud(x), readable(logw), readable(angles), readable(trail), corner, sides, gain, out)
    return out


def _cloud(x: Array) -> tuple[Array, int]:
    """Particles as kernels take them: (r, N d), and d."""
    return readable(x.reshape(len(x), -1)), x.shape[-1]


def _slope(sensor: LogDistance) -> float:
    """RSSI lost per unit of ln D, D the squared distance [dB]."""
    return float(5 * sensor.eta / np.log(10))


@inlined
def _start(x, d, logw, first, last, X, Y, out):  # type: ignore[no-untyped-def]
    """A block's positions, each axis by itself, and its log-weights so far."""
    wide()
    x = x[d * first :]
    for i in range(last - first):
        out[first + i] = logw[first + i]
    if d == 2:
        for i in range(last - first):
            X[i], Y[i] = x[2 * i], x[2 * i + 1]
    else:
        for i in range(last - first):
            X[i], Y[i] = x[d * i], x[d * i + 1]


@kernel
def _anchors(x, d, logw, places, readings, A, slope, variance, out):  # type: ignore[no-untyped-def]
    wide()
    n, links = logw.shape[1], np.empty((places.shape[0], 6))
    X, Y = np.empty(BLOCK), np.empty(BLOCK)
    for r in range(logw.shape[0]):
        heard = 0
        for a in range(places.shape[0]):
            if not np.isnan(readings[r, a]):
                _note(links[heard], places[a, 0], places[a, 1], readings[r, a] - A, 0.0, 0.0, 0.0)
                heard += 1
        for first in range(0, n, BLOCK):
            last = min(first + BLOCK, n)
            _start(x[r], d, logw[r], first, last, X, Y, out[r])
            _add(FIXED, X, Y, links[:heard], slope, variance, out[r, first:last])


@kernel
def _teammates(x, d, logw, packets, readings, ranged, A, slope, variance, gain, out):  # type: ignore[no-untyped-def]
    wide()
    X, Y, links = np.empty(BLOCK), np.empty(BLOCK), np.empty((readings.shape[1], 6))
    for r in range(logw.shape[0]):
        told = packets[r], readings[r], ranged, A, slope, variance, gain
        add_teammates(x[r], d, logw[r], told, X, Y, links, out[r])


@inlined
def add_teammates(x, d, logw, told, X, Y, links, out):  # type: ignore[no-untyped-def]
    """One row of `teammates`, with scratch for a block's positions and the links that were heard."""
    packets, readings, ranged, A, slope, variance, gain = told
    heard = 0
    for j in range(len(readings)):
        z, qx, qy = readings[j], packets[j, 0], packets[j, 1]
        if np.isnan(z) or np.isnan(qx) or np.isnan(qy) or (ranged and z < TOO_NEAR_TO_RANGE):
            continue
        _note(links[heard], qx, qy, z - A, gain * packets[j, 2], 2 * gain * packets[j, 3], gain * packets[j, 4])
        heard += 1
    for first in range(0, len(logw), BLOCK):
        last = min(first + BLOCK, len(logw))
        _start(x, d, logw, first, last, X, Y, out)
        if ranged:
            _add(RANGE, X, Y, links[:heard], slope, variance, out[first:last])
        else:
            _add(RSSI, X, Y, links[:heard], slope, variance, out[first:last])


@inlined
def _note(link, qx, qy, lost, xx, xy, yy):  # type: ignore[no-untyped-def]
    """What the loops need of a link: the place, the reading less the one at D = 1, and the place's covariance."""
    link[0], link[1], link[2], link[3], link[4], link[5] = qx, qy, lost, xx, xy, yy


@inlined
def _add(kind, X, Y, links, slope, variance, total):  # type: ignore[no-untyped-def]
    """Add the log-likelihoods of all links to `total`, four at a time, then two, then one."""
    k = 0
    while k + 4 <= len(links):
        _add_group(kind, 4, X, Y, links[k], links[k + 1], links[k + 2], links[k + 3], slope, variance, total)
        k += 4
    if k + 2 <= len(links):
        _add_group(kind, 2, X, Y, links[k], links[k + 1], links[k], links[k], slope, variance, total)
        k += 2
    if k < len(links):
        _add_group(kind, 1, X, Y, links[k], links[k], links[k], links[k], slope, variance, total)


@inlined
def _add_group(kind, size, X, Y, a, b, c, d, slope, variance, total):  # type: ignore[no-untyped-def]
    """Add `size` links. Compiled apart for each `kind` and `size`, which are constants where this is inlined."""
    wide()
    a0, a1, a2, a3, a4, a5 = a[0], a[1], a[2], a[3], a[4], a[5]
    b0, b1, b2, b3, b4, b5 = b[0], b[1], b[2], b[3], b[4], b[5]
    c0, c1, c2, c3, c4, c5 = c[0], c[1], c[2], c[3], c[4], c[5]
    d0, d1, d2, d3, d4, d5 = d[0], d[1], d[2], d[3], d[4], d[5]
    gain, constant = -0.5 / variance, -0.5 * size * np.log(variance)
    for i in range(len(total)):
        x, y = X[i], Y[i]
        sum_ln, over, under = _link(kind, x, y, a0, a1, a2, a3, a4, a5, slope, variance)
        if size > 1:
            ln_b, over_b, under_b = _link(kind, x, y, b0, b1, b2, b3, b4, b5, slope, variance)
            sum_ln += ln_b
            over, under = over * under_b + over_b * under, under * under_b
        if size > 2:
            ln_c, over_c, under_c = _link(kind, x, y, c0, c1, c2, c3, c4, c5, slope, variance)
            ln_d, over_d, under_d = _link(kind, x, y, d0, d1, d2, d3, d4, d5, slope, variance)
            sum_ln += ln_c + ln_d
            over_d, under_d = over_c * under_d + over_d * under_c, under_c * under_d
            over, under = over * under_d + over_d * under, under * under_d
        if kind == FIXED:
            total[i] += gain * over + constant
        else:
            total[i] += sum_ln - 0.5 * (over / under + log(under))


@inlined
def _link(kind, x, y, qx, qy, lost, xx, xy, yy, slope, variance):  # type: ignore[no-untyped-def]
    """ln D, (y D)^2 and m of RSSI, 0, y^2 and v of a range, and 0, y^2, 1 where the variance is the same everywhere.

    The slope of RSSI is J = 2 slope delta / D outside the clamp and 0 inside, that of a range delta / max(d, 0.1 m).
    """
    dx, dy = x - qx, y - qy
    D = dx * dx + dy * dy
    if kind == FIXED:
        rest = lost + slope * log(max(D, NEAR**2))
        return 0.0, rest * rest, 1.0
    q = dx * (xx * dx + xy * dy) + yy * (dy * dy)
    if kind == RANGE:
        rest = lost - np.sqrt(D)
        return 0.0, rest * rest, variance + q / max(D, NEAR**2)
    q = q if D > NEAR**2 else 0.0
    D = max(D, NEAR**2)
    ln_D = log(D)
    rest = (lost + slope * ln_D) * D
    return ln_D, rest * rest, variance * (D * D) + q


@kernel
def _window(x, d, logw, angles, trail, corner, sides, gain, out):  # type: ignore[no-untyped-def]
    """gain e^2, e the angle between the direction and the gradient g at the particle.

    With D_k the squared distances to the four corners, g_x ~ (ln p + ln q) / a and g_y ~ (ln p - ln q) / b, p = D_1/D_3
    and q = D_2/D_4. Turned back by the direction, g has the angle e, which needs no wrapping.
    """
    wide()
    n = logw.shape[1]
    X, Y = np.empty(BLOCK), np.empty(BLOCK)
    for r in range(logw.shape[0]):
        for first in range(0, n, BLOCK):
            last = min(first + BLOCK, n)
            _start(x[r], d, logw[r], first, last, X, Y, out[r])
            for k in range(angles.shape[1]):
                if not np.isnan(angles[r, k]):
                    east, north = trail[r, k, 0] - corner[0], trail[r, k, 1] - corner[1]
                    _add_direction(X, Y, angles[r, k], east, north, sides[0], sides[1], gain, out[r, first:last])


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
