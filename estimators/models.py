"""Models of the world as the team assumes it: motion, sensors, angles, the direction of arrival.

Sensors and motions read the width d of a state x (2: a robot with a compass, 3: with a heading of its own), accept any
leading axes, and are immutable. Angles live in (-pi, pi] and are never averaged or subtracted raw.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from cooploc.estimators.compiled import strict_kernel
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import TOO_NEAR_TO_RANGE as TOO_NEAR_TO_RANGE
from cooploc.estimators.interface import Array, Senses, Sensor, World
from cooploc.estimators.robust import AssumedLoss, Loss


def wrap(angle: Array) -> Array:
    """Return the same angle in (-pi, pi] [rad], any shape; nan stays nan."""
    wrapped = np.pi - np.mod(np.pi - angle, 2 * np.pi)
    return np.where(wrapped <= -np.pi, np.pi, wrapped)  # rounding may land on the open end


def wrap_heading(x: Array) -> Array:
    """Return states (..., d) with the heading, where there is one (d = 3), wrapped."""
    if x.shape[-1] < 3:
        return x
    x = x.copy()
    if x.dtype == np.float64:
        _wrap_headings(x.reshape(-1, x.shape[-1]))
    else:
        x[..., 2] = wrap(x[..., 2])
    return x


@strict_kernel
def wrap_angle(angle: float) -> float:
    """Wrap one number."""
    inside = np.pi - (np.pi - angle) % (2 * np.pi)
    return np.pi if inside <= -np.pi else inside


@strict_kernel
def _wrap_headings(x: Array) -> None:
    for r in range(len(x)):
        x[r, 2] = wrap_angle(x[r, 2])


def circular_mean(angle: Array, weight: Array) -> Array:
    """Return the weighted mean direction over the last axis [rad]: the angle of the sum of unit vectors."""
    return np.asarray(np.arctan2((weight * np.sin(angle)).sum(-1), (weight * np.cos(angle)).sum(-1)))


# Sensor models, each with its Jacobians and its noise.

NEAR = 0.1  # [m] distances in a logarithm or a quotient are clamped here


def variance(sensor: Any) -> Array:
    """Return the noise covariance (1, 1) of a reading of one number."""
    return np.array([[sensor.sigma**2]])


@dataclass(frozen=True)
class LogDistance:
    """Received signal strength, log-distance path loss: z = A - 10 eta log10 d  [dBm], d >= 0.1 m.

    Source: Latif & Parasuraman, the equation of RSSI_m.
    """

    A: float = -40.0  # [dBm] at 1 m
    eta: float = 3.0  # path-loss exponent
    sigma: float = 5**0.5  # [dB] shadowing and fast noise together
    loss: Loss = "none"

    R = property(variance)

    def level(self, x: Array, q: Array) -> Array:
        """Return the mean reading (...) [dBm]."""
        d2 = (x[..., 0] - q[..., 0]) ** 2 + (x[..., 1] - q[..., 1]) ** 2
        return self.A - 5 * self.eta * np.log10(np.maximum(d2, NEAR**2))

    def slope(self, x: Array, q: Array) -> Array:
        """d level / d position (..., 2) [dB/m]; zero inside the clamp."""
        east, north = x[..., 0] - q[..., 0], x[..., 1] - q[..., 1]
        d2 = east**2 + north**2
        far, clamped, fall = d2 > NEAR**2, np.maximum(d2, NEAR**2), -10 * self.eta / np.log(10)
        return np.stack([np.where(far, fall * away / clamped, 0.0) for away in (east, north)], -1)

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        g = self.slope(x, q)
        return z - self.level(x, q)[..., None], _widen(g[..., None, :], x), -g[..., None, :]


@dataclass(frozen=True)
class Range:
    """Distance to a place [m]. Readings below 0.2 m are refused (nan)."""

    sigma: float = 0.1  # [m]
    loss: Loss = "none"

    R = property(variance)

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        delta, d = _offset(x, q)
        u = delta / np.maximum(d, NEAR)
        y = np.where(z < TOO_NEAR_TO_RANGE, np.nan, z - d)
        return y, _widen(u[..., None, :], x), -u[..., None, :]

    def curvature(self, x: Array, q: Array, D: Array) -> tuple[Array, Array]:
        """Second-order mean shift (..., 1) and extra variance (..., 1, 1) when x - q has covariance D (..., 2, 2).

        With M = (I - u u')/d the Hessian of the distance: tr(M D)/2 and tr(M D M D)/2
        (Bar-Shalom, Li & Kirubarajan 2001, eq. 10.3.3).
        """
        delta, d = _offset(x, q)
        d = np.maximum(d, TOO_NEAR_TO_RANGE)
        t = np.stack([-delta[..., 1], delta[..., 0]], -1) / d
        across = (t * (D @ t[..., None])[..., 0]).sum(-1, keepdims=True) / d
        return across / 2, (across**2 / 2)[..., None]


@dataclass(frozen=True)
class Bearing:
    """Direction of a place [rad], relative to the heading where the state has one, else to the x axis."""

    sigma: float = 0.02  # [rad]
    loss: Loss = "none"

    R = property(variance)

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        delta, d = _offset(x, q)
        away: Array = np.arctan2(-delta[..., 1:], -delta[..., :1])
        y = wrap(z - (away - (x[..., 2:3] if x.shape[-1] > 2 else 0.0)))
        g = np.stack([-delta[..., 1], delta[..., 0]], -1) / np.maximum(d, NEAR) ** 2
        H = _widen(g[..., None, :], x)
        if x.shape[-1] > 2:
            H[..., 0, 2] = -1.0
        return y, H, -g[..., None, :]


@dataclass(frozen=True)
class Sighting:
    """A camera's range [m] and bearing [rad] of one thing: one vector, gated once."""

    sigma_range: float = 0.15
    sigma_bearing: float = 0.02
    loss: Loss = "none"

    @property
    def R(self) -> Array:
        return np.array([[self.sigma_range**2, 0.0], [0.0, self.sigma_bearing**2]])

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        y0, H0, Hq0 = Range().innovation(x, q, z[..., :1])
        y1, H1, Hq1 = Bearing().innovation(x, q, z[..., 1:])
        return np.concatenate([y0, y1], -1), np.concatenate([H0, H1], -2), np.concatenate([Hq0, Hq1], -2)


@dataclass(frozen=True)
class Orientation:
    """A teammate's heading relative to the own [rad]; both states have headings."""

    sigma: float = 0.05  # [rad]
    loss: Loss = "none"

    R = property(variance)

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        """y = wrap(z + heading) of a thing that faces along the x axis; `q` is not used."""
        H = np.zeros((*z.shape, x.shape[-1]))
        H[..., 2] = -1.0
        return wrap(z + x[..., 2:]), H, np.zeros((*z.shape, 2))

    def between(self, x: Array, x_j: Array, z: Array) -> tuple[Array, Array, Array]:
        """y = wrap(z - (heading_j - heading)), H and H_j (..., 1, 3) for a teammate at x_j (..., 3)."""
        y, H, _ = self.innovation(x, x_j[..., :2], z - x_j[..., 2:])
        return y, H, -H


def _offset(x: Array, q: Array) -> tuple[Array, Array]:
    delta = x[..., :2] - q
    return delta, np.sqrt(delta[..., :1] ** 2 + delta[..., 1:] ** 2)


def _widen(H: Array, x: Array) -> Array:
    """Widen a position Jacobian (..., k, 2) to (..., k, d)."""
    return np.concatenate([H, np.zeros((*H.shape[:-1], x.shape[-1] - 2))], -1)


# Motion models, each with its Jacobian and its noise: the variance is proportional to dt, sigmas are quoted at `tick`.


@dataclass(frozen=True)
class Displacement:
    """Odometry in a compass frame: u = (dx, dy) [m] with independent Gaussian errors."""

    sigma: float = 0.02  # [m] per axis and `tick`
    tick: float = 1.0  # [s]

    def move(self, x: Array, u: Array, dt: Array) -> tuple[Array, Array, Array]:
        """x' = x + u,  F = I,  Q = sigma^2 dt/tick I on the position."""
        d, moved = x.shape[-1], _add_position(x, _replace_absent(u))
        Q = self._variance(dt)[..., None, None] * np.diag(np.arange(d) < 2).astype(float)
        shape = (*moved.shape, d)
        return moved, np.broadcast_to(np.eye(d), shape), np.broadcast_to(Q, shape)

    def sample(self, x: Array, u: Array, dt: Array, noise: Array) -> Array:
        return _add_position(x, _replace_absent(u) + np.sqrt(self._variance(dt))[..., None] * noise)

    def retrace(self, trail: Array, u: Array, dt: Array) -> Array:
        return trail - _replace_absent(u)[..., None, :]

    def place(self, x: Array, trail: Array) -> Array:
        return x[..., :2] + trail

    def _variance(self, dt: Array) -> Array:
        return np.asarray(self.sigma**2 / self.tick * np.asarray(dt))


@dataclass(frozen=True)
class Unicycle:
    """Odometry of a wheeled robot: u = (v [m/s], omega [rad/s]) with independent Gaussian errors."""

    sigma_v: float = 0.04  # [m/s] at `tick`
    sigma_omega: float = 0.15  # [rad/s] at `tick`
    tick: float = 0.1  # [s]

    def move(self, x: Array, u: Array, dt: Array) -> tuple[Array, Array, Array]:
        """x' = x + v dt (cos a, sin a), heading' = heading + omega dt, with a = heading + omega dt / 2.

        Q = G diag(sigma_v^2, sigma_omega^2) G' tick dt, G = d(move)/d(v dt, omega dt).
        """
        u, dt = _replace_absent(u), np.asarray(dt)
        arc, turn = u[..., 0] * dt, u[..., 1] * dt
        a = x[..., 2] + turn / 2
        c, s = np.cos(a), np.sin(a)
        zero, one = np.zeros_like(a), np.ones_like(a)
        F = np.stack([one, zero, -arc * s, zero, one, arc * c, zero, zero, one], -1).reshape(*a.shape, 3, 3)
        G = np.stack([c, -arc * s / 2, s, arc * c / 2, zero, one], -1).reshape(*a.shape, 3, 2)
        W = np.array([self.sigma_v**2, self.sigma_omega**2]) * self.tick
        Q = (G * (W * dt[..., None])[..., None, :]) @ G.mT
        return self._step(x, arc, turn), F, Q

    def sample(self, x: Array, u: Array, dt: Array, noise: Array) -> Array:
        u, dt = _replace_absent(u), np.asarray(dt)
        spread = np.array([self.sigma_v, self.sigma_omega]) * np.sqrt(self.tick * dt)[..., None]
        move = u * dt[..., None] + spread * noise
        return self._step(x, move[..., 0], move[..., 1])

    def retrace(self, trail: Array, u: Array, dt: Array) -> Array:
        u, dt = _replace_absent(u), np.asarray(dt)
        turn = u[..., 1] * dt
        along = np.stack([np.cos(turn / 2), np.sin(turn / 2)], -1) * (u[..., 0] * dt)[..., None]
        return _rotate(trail - along[..., None, :], -turn[..., None])

    def place(self, x: Array, trail: Array) -> Array:
        return x[..., :2] + _rotate(trail, x[..., 2])

    @staticmethod
    def _step(x: Array, arc: Array, turn: Array) -> Array:
        a = x[..., 2] + turn / 2
        return np.stack([x[..., 0] + arc * np.cos(a), x[..., 1] + arc * np.sin(a), wrap(x[..., 2] + turn)], -1)


def _replace_absent(u: Array) -> Array:
    """Return odometry without nan: where it is absent, the robot did not move."""
    return np.where(np.isnan(u), 0.0, u)


def _add_position(x: Array, step: Array) -> Array:
    position = x[..., :2] + step
    return np.concatenate([position, np.broadcast_to(x[..., 2:], (*position.shape[:-1], x.shape[-1] - 2))], -1)


def _rotate(v: Array, angle: Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * v[..., 0] - s * v[..., 1], s * v[..., 0] + c * v[..., 1]], -1)


# Direction of arrival: the gradient of the signal strength over the arena, by central differences between four corner
# nodes, points towards the robot. Its noise is Gaussian in the gradient, not in the angle, which says nothing near the
# centre. Hence several densities: the paper's constant sigma, read in three ways, the exact one, and the gradient's.
#
# Sources: Latif & Parasuraman, eqs. (1)-(4); R. Parasuraman et al., "Spatial sampling strategy for a 3D sound source
# localization sensor network using RSSI", 2013 (the central differences); K. V. Mardia, "Statistics of Directional
# Data", 1972, sec. 3.4.7 (the projected, or offset, normal).


@dataclass(frozen=True)
class GradientDoa:
    """The DOA reading of a robot among four nodes at (0, 0), (0, b), (a, b), (a, 0), shifted by `corner`."""

    rssi: LogDistance
    corner: tuple[float, float]  # N1 [m]
    sides: tuple[float, float]  # Delta_X, Delta_Y [m]

    @property
    def anchors(self) -> Array:
        """N1 .. N4 (4, 2) [m]."""
        a, b = self.sides
        return np.asarray(np.array(self.corner) + np.array([[0, 0], [0, b], [a, b], [a, 0]]))

    loss = property(lambda self: self.rssi.loss)

    @property
    def sigma(self) -> float:
        """RMS angle error [rad] over the arena under the noise model: computed, not tuned."""
        return _rms_error(self.rssi.eta, self.rssi.sigma, self.sides)

    R = property(variance)

    def gradient(self, S: Array) -> Array:
        """g (..., 2) [dB/m] from readings S (..., 4).

        g_x = (S_3 - S_2 + S_4 - S_1) / (2 Delta_X)  (1),   g_y = (S_3 - S_4 + S_2 - S_1) / (2 Delta_Y)  (2)
        """
        a, b = self.sides
        gx = (S[..., 2] - S[..., 1] + S[..., 3] - S[..., 0]) / (2 * a)
        gy = (S[..., 2] - S[..., 3] + S[..., 1] - S[..., 0]) / (2 * b)
        return np.stack([gx, gy], -1)

    def measure(self, S: Array) -> Array:
        """DOA = arctan2(g_y, g_x) (...) [rad]  (3), where the paper writes arctan and so loses the half plane."""
        return _angle_of(self.gradient(S))

    def expect(self, x: Array) -> Array:
        """The gradient (..., 2) that the path-loss model gives at x (..., d): removes the gradient's own bias."""
        return self.gradient(np.moveaxis(self.rssi.level(x, self._two_block_row(x)), 0, -1))

    def _two_block_row(self, x: Array) -> Array:
        """The nodes (4, 1 .., 2) on an axis before those of x: numpy's inner loops stay long."""
        return self.anchors.reshape(4, *[1] * (x.ndim - 1), 2)

    def bearing(self, x: Array) -> Array:
        """Return ADOA (...) [rad], the direction of the expected gradient."""
        return _angle_of(self.expect(x))

    def slope(self, x: Array) -> Array:
        """d expect / d position (..., 2 of position, 2 of gradient) [dB/m^2]."""
        return self.gradient(np.moveaxis(self.rssi.slope(x, self._two_block_row(x)), 0, -1))

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        """The constant-sigma form; `q` is not used. d angle = (g_x dg_y - g_y dg_x) / |g|^2."""
        g, dg = self.expect(x), self.slope(x)
        strength = np.maximum((g**2).sum(-1), NEAR**2)[..., None]
        slope = (g[..., :1] * dg[..., 1] - g[..., 1:] * dg[..., 0]) / strength
        H = _widen(slope[..., None, :], x)
        y = wrap(z - np.arctan2(g[..., 1:], g[..., :1]))
        return y, H, np.zeros((*H.shape[:-1], 2))

    def log_constant(self, x: Array, angle: Array) -> Array:
        """log N(wrap(ADOA(x) - DOA); 0, sigma^2) up to a constant  (eq. 5 of the paper)."""
        return -0.5 * (wrap(self.bearing(x) - angle) / self.sigma) ** 2

    def log_sum(self, x: Array, angle: Array) -> Array:
        """log N(err; 0, sigma^2) up to a constant, err = sum_j (ADOA_j - DOA_j), signed and not wrapped  (eqs. 4, 5).

        One DOA is perceived, that of eq. (3): ADOA is the same angle at the candidate, and every node repeats both.
        """
        return -0.5 * (len(self.anchors) * (self.bearing(x) - angle) / self.sigma) ** 2

    def log_corners(self, x: Array, angle: Array) -> Array:
        """`log_sum` with ADOA_j the direction of x seen from node j, in (-pi, pi]; smallest far outside the arena."""
        away = x[..., :2] - self._two_block_row(x)
        err = _angle_of(away).sum(0) - len(self.anchors) * angle
        return np.asarray(-0.5 * (err / self.sigma) ** 2)

    def log_gradient(self, x: Array, g: Array) -> Array:
        """log N(g - g(x); 0, sigma^2 diag(1/a^2, 1/b^2)) up to a constant, for a measured gradient g (..., 2)."""
        whitened = (g - self.expect(x)) * np.array(self.sides) / self.rssi.sigma
        return np.asarray(-0.5 * (whitened**2).sum(-1))

    def log_exact(self, x: Array, angle: Array) -> Array:
        """log of the projected normal density of the angle, for a gradient g ~ N(g(x), sigma^2 diag(1/a^2, 1/b^2))."""
        a, b = self.sides
        mu = self.expect(x) * np.array([a, b]) / self.rssi.sigma  # whitened
        u = np.stack([np.cos(angle) * a, np.sin(angle) * b], -1) / self.rssi.sigma
        A = (u**2).sum(-1)
        t = (u * mu).sum(-1) / np.sqrt(A)
        return np.asarray(np.log(a * b / self.rssi.sigma**2 / (2 * np.pi * A)) - 0.5 * (mu**2).sum(-1) + _log_tail(t))


def _angle_of(vector: Array) -> Array:
    return np.asarray(np.arctan2(vector[..., 1], vector[..., 0]))


def gradient_doa(world: World) -> GradientDoa:
    """Return the DOA sensor of a world; BadInput where its anchors are not four corners (0,0) (0,b) (a,b) (a,0)."""
    rssi, anchors = world.sensors["anchor_rssi"], world.anchors
    if isinstance(rssi, LogDistance) and anchors.shape == (4, 2):
        (ax, ay), (bx, by) = anchors[0].tolist(), anchors[2].tolist()
        doa = GradientDoa(rssi, (ax, ay), (bx - ax, by - ay))
        if min(doa.sides) > 0 and np.abs(doa.anchors - anchors).max() < 1e-6 * min(doa.sides):
            return doa
    raise BadInput(
        f"a gradient DOA needs four corner anchors in the order (0,0) (0,b) (a,b) (a,0) and a LogDistance sensor; this "
        f"world has {len(anchors)} anchors and {type(rssi).__name__}: use anchor_reading='rssi' there"
    )


def _log_tail(t: Array) -> Array:
    """log(1 + t Phi(t) / phi(t)), in the form that neither overflows above 0 nor cancels below."""
    from scipy.special import erfcx, log_ndtr  # late, as every process of a plug-in would wait for it

    below = 1 + t * np.sqrt(np.pi / 2) * erfcx(-np.minimum(t, 0.0) / np.sqrt(2))
    positive = np.maximum(t, np.finfo(float).tiny)
    above = np.log(positive) + log_ndtr(positive) + 0.5 * positive**2 + 0.5 * np.log(2 * np.pi)
    log_sum = np.maximum(above, 0.0) + np.log1p(np.exp(-np.abs(above)))  # of 1 and exp(above); lets nan pass quietly
    return np.asarray(np.where(t > 0, log_sum, np.log(np.maximum(below, np.finfo(float).tiny))))


@lru_cache(maxsize=64)
def _rms_error(eta: float, sigma: float, sides: tuple[float, float], grid: int = 40, angles: int = 360) -> float:
    """sqrt E[(DOA - ADOA)^2], by quadrature of the exact density over a grid of positions."""
    doa = GradientDoa(LogDistance(eta=eta, sigma=sigma), (0.0, 0.0), sides)
    cell = (np.arange(grid) + 0.5) / grid
    x = np.stack(np.meshgrid(cell * sides[0], cell * sides[1], indexing="ij"), -1).reshape(-1, 1, 2)
    angle = (np.arange(angles) + 0.5) / angles * 2 * np.pi - np.pi
    density = np.exp(doa.log_exact(x, angle))
    error = wrap(angle - doa.bearing(x))
    return float(np.sqrt((error**2 * density).sum() / density.sum()))


# What a Kalman filter makes of the four corner anchors: a direction, the gradient it comes from, or raw readings.
# With u = (a g_x, b g_y)/sigma measured and m expected, a and b the arena's sides, the angle between them has, given
# |u|, a von Mises density of concentration |u||m|, and a variance near 1/(|u||m|).
#
# Source: K. V. Mardia, P. E. Jupp, "Directional Statistics", 2000, sec. 3.5.4 (the angle of a Gaussian vector, given
# its length, is von Mises).

AnchorReading = Literal["doa", "gradient", "rssi", "doa-constant", "none", "any"]
RAW = ("rssi", "any")  # readings as they are, of anchors or landmarks
FIXED = "anchor_rssi", "landmark", "anchor_range"  # channels of fixed things
NOWHERE = np.zeros(2)  # a direction of arrival has no place of its own
WEAKEST = 1e-9  # concentrations are clamped here


@dataclass(frozen=True)
class WeightedDoa:
    """The direction of a measured gradient (..., 2), in units of its own standard deviation."""

    doa: GradientDoa

    loss = property(lambda self: self.doa.loss)

    @property
    def R(self) -> Array:
        return np.eye(1)

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        """sqrt(kappa) wrap(angle u - angle m), and its slopes with kappa held; `q` is not used."""
        u, m, root = self._whiten(x, z)
        dm = self.doa.slope(x) * self._scale
        length2 = np.maximum((m**2).sum(-1, keepdims=True), NEAR**2)
        turn = (m[..., :1] * dm[..., 1] - m[..., 1:] * dm[..., 0]) / length2
        y = wrap(np.arctan2(u[..., 1:], u[..., :1]) - np.arctan2(m[..., 1:], m[..., :1]))
        H = _widen((root * turn)[..., None, :], x)
        return root * y, H, np.zeros((*H.shape[:-1], 2))

    def at(self, x: Array, z: Array) -> tuple[Array, Array]:
        """The angle (..., 1) [rad] of a gradient z and its variance (..., 1, 1) [rad^2] for a robot at x."""
        _, _, root = self._whiten(x, z)
        return np.arctan2(z[..., 1:], z[..., :1]), (root**-2)[..., None]

    @property
    def _scale(self) -> Array:
        return np.array(self.doa.sides) / self.doa.rssi.sigma

    def _whiten(self, x: Array, z: Array) -> tuple[Array, Array, Array]:
        """u, m and sqrt(kappa) (..., 1), kappa = |u||m|."""
        u, m = z * self._scale, self.doa.expect(x) * self._scale
        kappa = np.sqrt((u**2).sum(-1, keepdims=True) * (m**2).sum(-1, keepdims=True))
        return u, m, np.sqrt(np.maximum(kappa, WEAKEST))


@dataclass(frozen=True)
class GradientReading:
    """The measured gradient (..., 2) [dB/m] itself: direction and strength."""

    doa: GradientDoa

    loss = property(lambda self: self.doa.loss)

    @property
    def R(self) -> Array:
        return np.diag((self.doa.rssi.sigma / np.array(self.doa.sides)) ** 2)

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        """z - g(x) and its slopes; `q` is not used."""
        H = _widen(self.doa.slope(x).mT, x)
        return z - self.doa.expect(x), H, np.zeros((*H.shape[:-1], 2))


def fixed_channels(reading: str) -> tuple[str, ...]:
    """Return the channels of fixed things that `anchor_reading` uses: all with "any", else the first that there is."""
    if reading == "any":
        return tuple(f"{channel}?" for channel in FIXED)
    return () if reading == "none" else ("|".join(FIXED),)


def fixed_readings(world: World, z: Senses, reading: AnchorReading) -> Iterator[tuple[Sensor, Array, Array]]:
    """Yield `world.fixed` with the four anchor readings turned into what `reading` names; "none": nothing."""
    if reading == "none":
        return
    if reading in RAW or z.anchor_rssi.shape[-1] == 0:
        yield from world.fixed(z)
        return
    doa = gradient_doa(world)
    gradient = doa.gradient(z.anchor_rssi)
    if np.isnan(gradient).all():
        return
    if reading == "doa-constant":
        yield doa, NOWHERE, doa.measure(z.anchor_rssi)[..., None]
    else:
        yield (WeightedDoa if reading == "doa" else GradientReading)(doa), NOWHERE, gradient


LEAST, MOST = 0.01, 100.0  # of an inflation


def inflate(world: World, factor: float, loss: AssumedLoss = "world") -> World:
    """Return the world with every sensor's standard deviations multiplied by `factor`, and with another `loss`.

    It is the same object where nothing changes. A sensor that is not built in is inflated where it is a dataclass with
    fields whose names begin with "sigma", and has a loss where it has such a field.
    """
    if factor == 1 and loss == "world":
        return world
    sensors: dict[str, Any] = dict(world.sensors)
    for name, sensor in sensors.items():
        if is_dataclass(sensor) and not isinstance(sensor, type):
            names = [one.name for one in fields(sensor) if one.init]
            changed = {one: factor * getattr(sensor, one) for one in names if one.startswith("sigma")}
            changed |= {"loss": loss} if "loss" in names and loss != "world" else {}
            sensors[name] = replace(sensor, **changed)
    return replace(world, sensors=sensors)


def innovation(xp: Any, sensor: Sensor, x: Any, q: Any, z: Any) -> Any:
    """Return z - h(x, q) (..., k) as a pure function for tracing libraries; nan where absent or a range is refused.

    `xp` is jax.numpy, or another with numpy's names. Nothing is written in place, and no branch looks at a value.
    """

    def turn(angle: Any) -> Any:  # to [-pi, pi)
        return xp.remainder(angle + np.pi, 2 * np.pi) - np.pi

    east, north = q[..., 0] - x[..., 0], q[..., 1] - x[..., 1]
    d2, away = east**2 + north**2, xp.arctan2(north, east)
    if isinstance(sensor, LogDistance):
        return z - (sensor.A - 5 * sensor.eta * xp.log10(xp.clip(d2, min=NEAR**2)))[..., None]
    direction = turn(z[..., -1:] - turn(away - x[..., 2] if x.shape[-1] > 2 else away)[..., None])
    if isinstance(sensor, Bearing):
        return direction
    ranged = xp.where(z[..., :1] < TOO_NEAR_TO_RANGE, xp.nan, z[..., :1] - xp.sqrt(d2)[..., None])
    if isinstance(sensor, Range | Sighting):
        return ranged if isinstance(sensor, Range) else xp.concatenate([ranged, direction], -1)
    known = "known are LogDistance, Range, Bearing and Sighting"
    raise TypeError(f"{type(sensor).__name__} has no traceable form; {known}")
