"""Log-likelihoods of readings at every particle: sums over anchors, teammates and past directions of arrival.

The sensors of models.py have compiled loops; the numpy forms, `*_reference`, serve any other sensor, and tests.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators import particle_kernels
from cooploc.estimators.compiled import readable
from cooploc.estimators.interface import Array, Belief, Motion, Sensor
from cooploc.estimators.models import Displacement, GradientDoa, LogDistance, Range
from cooploc.estimators.robust import Loss, loss_of, penalty


def pack(belief: Belief) -> Array:
    """Return the packet (..., 5) of a belief's position."""
    return np.concatenate([belief.x[..., :2], belief.P[..., [0, 0, 1], [0, 1, 1]]], -1)


def unpack(packet: Array) -> Belief:
    """Return the position (..., 2) and covariance (..., 2, 2) of a packet (..., 5)."""
    return Belief(packet[..., :2], packet.take([[2, 3], [3, 4]], -1))


Fixed = tuple[Sensor, Array, Array]  # sensor, place (2,) and readings (r, k) of a fixed place, as of `World.fixed`


def anchors(fixed: Sequence[Fixed], x: Array, logw: Array) -> Array:
    """Add to `logw` (r, N) the log-likelihoods of scalar readings of fixed places, at particles x (r, N, d)."""
    readings = anchor_readings(fixed, len(x))
    if readings is None:
        return anchors_reference(fixed, x, logw)
    return fill_rows(particle_kernels.add_anchor_rows, x, logw, readings)


def anchor_readings(fixed: Sequence[Fixed], rows: int) -> tuple[Array, Array, float, float, float] | None:
    """Return what the loop takes, None where there is none: it is for RSSI by one sensor, or no readings.

    Places (a, 2) [m], readings (r, a) [dBm], A [dBm], slope [dB], 1/sigma [1/dB].
    """
    if not fixed:
        return np.empty((0, 2)), np.empty((rows, 0)), 0.0, 0.0, 1.0
    sensor = fixed[0][0]
    if type(sensor) is not LogDistance or sensor.loss != "none" or any(other is not sensor for other, _, _ in fixed):
        return None
    readings = np.concatenate([z for _, _, z in fixed], -1)
    return np.array([q for _, q, _ in fixed]), readings, sensor.A, _slope(sensor), 1 / sensor.sigma


def anchors_reference(fixed: Sequence[Fixed], x: Array, logw: Array) -> Array:
    """Compute `anchors` in numpy, for any sensor of one or two numbers, in rows that have a reading."""
    logw = logw.copy()
    for sensor, place, reading in fixed:
        rows = np.flatnonzero(~np.isnan(reading).any(-1))
        y, _, _ = sensor.innovation(x[rows], place, reading[rows, None])
        logw[rows] += log_density(y, sensor.R, loss_of(sensor))
    return logw


class ReceivedPackets(NamedTuple):
    """The packets that reached each robot, and the radio's reading of each."""

    sensor: Sensor  # of the readings
    packets: Array  # (r, n, 5)  x, y, P_xx, P_xy, P_yy of each sender
    readings: Array  # (r, n)     nan where nothing was heard
    integrate: bool  # over the sender's position; else the sender is taken to be at its mean, P_j = 0

    @property
    def has_loop(self) -> bool:
        """Return whether there is a loop for this sensor."""
        return type(self.sensor) in (LogDistance, Range) and loss_of(self.sensor) == "none"

    def for_loop(self) -> tuple[Array, Array, bool, float, float, float, float]:
        """Return what that loop takes: packets and readings, whether they are ranges, A, slope, 1/sigma, and a gain.

        The gain times P_j is the variance that the sender's position adds, sigma = 1; 0 ignores P_j.
        """
        packets, readings = readable(self.packets), readable(self.readings)
        if isinstance(self.sensor, LogDistance):
            slope = _slope(self.sensor)
            gain = (2 * slope / self.sensor.sigma) ** 2 if self.integrate else 0.0
            return packets, readings, False, self.sensor.A, slope, 1 / self.sensor.sigma, gain
        precision = 1 / float(self.sensor.R[0, 0])
        return packets, readings, True, 0.0, 0.0, precision**0.5, precision if self.integrate else 0.0


def teammates(heard: ReceivedPackets, x: Array, logw: Array) -> Array:
    """Add to `logw` (r, N) the log-likelihoods of the readings heard, at particles x (r, N, d).

    The sender is integrated out of each: variance sigma^2 + J P_j J', with J the slope at the particle.
    """
    if not heard.has_loop:
        return teammates_reference(heard, x, logw)
    return fill_rows(particle_kernels.add_teammate_rows, x, logw, heard.for_loop())


def teammates_reference(heard: ReceivedPackets, x: Array, logw: Array) -> Array:
    """Compute `teammates` in numpy, for any scalar sensor."""
    sensor, packets, readings, integrate = heard
    for j in np.flatnonzero(~np.isnan(readings).all(0)):
        x_j, P_j = unpack(packets[:, j])
        y, _, J = sensor.innovation(x, x_j[:, None, :], readings[:, j, None, None])
        v = sensor.R[0, 0] + np.zeros_like(y[..., 0])
        if integrate:
            J = J[..., 0, :]  # (r, N, 2)
            v = v + ((J @ P_j) * J).sum(-1)
        logw = logw + log_density(y, v[..., None, None], loss_of(sensor))
    return logw


def window(
    doa: GradientDoa, motion: Motion, x: Array, logw: Array, angles: Array, trail: Array, form: str, power: float
) -> Array:
    """Add to `logw` (r, N) `power` times the log-density of past directions (r, M) [rad], nan where absent.

    Each is taken at the particle of x (r, N, d) shifted back along the path; `trail` (r, M, 2) is where the robot was
    then, seen from where it is now. The form is "exact", or a constant sigma with one of the residuals, `FORMS`.
    """
    if form == "exact" or doa.loss != "none":
        return window_reference(doa, motion, x, logw, angles, trail, form, power)
    if type(motion) is not Displacement:  # particles are shifted here, one direction after the other
        still = np.zeros((len(x), 1, 2))
        for k in range(angles.shape[1]):
            there = motion.place(x, trail[:, None, k])
            logw = window(doa, Displacement(), there, logw, angles[:, k : k + 1], still, form, power)
        return logw
    corner, sides = np.array(doa.corner), np.array(doa.sides)
    directions = readable(angles), readable(trail), corner, sides, -0.5 * power / doa.sigma**2
    return fill_rows(particle_kernels.add_window_rows, x, logw, directions, particle_kernels.FORMS[form])


def window_reference(
    doa: GradientDoa, motion: Motion, x: Array, logw: Array, angles: Array, trail: Array, form: str, power: float
) -> Array:
    """Compute `window` in numpy."""
    forms = {"exact": doa.log_exact, "wrapped": doa.log_constant, "sum": doa.log_sum, "corners": doa.log_corners}
    for k in range(angles.shape[1]):
        angle = angles[:, k, None]
        if not np.isnan(angle).all():
            there = motion.place(x, trail[:, None, k])
            log_density = forms[form](there, angle)
            if form != "exact":  # that has a loss of its own: a direction says nothing at worst
                log_density = -0.5 * penalty(doa.loss, -2 * log_density, 1)
            logw = logw + power * np.where(np.isnan(angle), 0.0, log_density)
    return logw


def weigh_by_folded_angle(doa: GradientDoa, x: Array, logw: Array, S: Array, errors: Array) -> tuple[Array, Array]:
    """Weigh particles x (r, N, d) as public code of companion work does; return log-weights, and the best one's error.

    The direction is arctan(g_y / g_x), folded to half a plane; its error at a particle, |ADOA - DOA| [rad], is not
    wrapped. Its standard deviation is that of the particle's four residuals of signal strength, [dB] taken as [rad].
    `errors` (r, 3), nan where absent, of the best particles of the last ticks are weighed by the same Gaussian.
    Readings S (r, 4) [dBm]; nothing is weighed without all four, and the error (r,) is nan then.

    Source: herolab-uga/cdoa-localization, commit 3684b64, ros/PFLocalization.py, without its line 251, which uses the
    tracked position, and without its averages over ten readings and a hundred directions.
    """
    error = np.abs(_fold(doa.expect(x)) - _fold(doa.gradient(S))[:, None])
    level = np.stack([doa.rssi.level(x, corner) for corner in doa.anchors], -1)
    sd = np.maximum((level - S[:, None, :]).std(-1), np.finfo(float).tiny ** 0.25)
    past = np.nansum(errors**2, -1)[:, None]
    log_likelihood = -(1 + (~np.isnan(errors)).sum(-1)[:, None]) * np.log(sd) - 0.5 * (error**2 + past) / sd**2
    logw = logw + np.where(np.isnan(error), 0.0, log_likelihood)
    return logw, np.take_along_axis(error, logw.argmax(-1)[:, None], 1)[:, 0]


def _fold(g: Array) -> Array:
    """Return arctan(g_y / g_x) in [-pi/2, pi/2] of gradients (..., 2)."""
    angle = np.arctan2(g[..., 1], g[..., 0])
    return np.asarray(angle - np.pi * np.rint(angle / np.pi))


def gradient(doa: GradientDoa, x: Array, logw: Array, g: Array) -> Array:
    """Add to `logw` (r, N) the log-density of a measured gradient g (r, 2) [dB/m], nan where absent."""
    if type(doa.rssi) is not LogDistance or doa.loss != "none":
        absent = np.isnan(g).any(-1, keepdims=True)
        return logw + np.where(absent, 0.0, -0.5 * penalty(doa.loss, -2 * doa.log_gradient(x, g[:, None, :]), 2))
    slope, sigma = _slope(doa.rssi), float(doa.rssi.sigma)
    gradients = readable(g), np.array(doa.corner), np.array(doa.sides), slope, sigma
    return fill_rows(particle_kernels.add_gradient_rows, x, logw, gradients)


def fill_rows(kernel: Any, x: Array, logw: Array, *told: Any) -> Array:
    """Return the log-weights (r, N) that a loop makes of `logw` at particles x (r, N, d)."""
    out = np.empty_like(logw, order="C")
    kernel(planes(x), x.shape[-1], readable(logw), *told, out)
    return out


def planes(x: Array) -> Array:
    """Return particles (r, N, d) as kernels take them, each axis of a row by itself: (r d, N)."""
    r, n, d = x.shape
    return readable(x.transpose(0, 2, 1)).reshape(r * d, n)


def _slope(sensor: LogDistance) -> float:
    """Return the RSSI lost per unit of ln D, D the squared distance [dB]."""
    return float(5 * sensor.eta / np.log(10))


def log_density(y: Array, S: Array, loss: Loss = "none") -> Array:
    """log N(y; 0, S), or that of a loss, without its constant, y (..., k), k = 1 or 2; 0 where any of it is absent."""
    if y.shape[-1] == 1:
        distance, det = y[..., 0] ** 2 / S[..., 0, 0], S[..., 0, 0]
    else:
        a, b, c = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
        det = a * c - b * b
        distance = (c * y[..., 0] ** 2 - 2 * b * y[..., 0] * y[..., 1] + a * y[..., 1] ** 2) / det
    return np.where(np.isnan(y).any(-1), 0.0, -0.5 * (penalty(loss, distance, y.shape[-1]) + np.log(det)))
