"""Sensor models, each with its Jacobians and its noise.

They read the state's width d from x (2: a robot with a compass, 3: with a heading of its own), accept any leading axes,
and are immutable.
"""

from dataclasses import dataclass

import numpy as np

from cooploc.estimators.interface import TOO_NEAR_TO_RANGE as TOO_NEAR_TO_RANGE
from cooploc.estimators.interface import Array
from cooploc.estimators.models.angles import wrap

NEAR = 0.1  # [m] distances in a logarithm or a quotient are clamped here


@dataclass(frozen=True)
class LogDistance:
    """Received signal strength, log-distance path loss: z = A - 10 eta log10 d  [dBm], d >= 0.1 m.

    Source: Latif & Parasuraman, the equation of RSSI_m.
    """

    A: float = -40.0  # [dBm] at 1 m
    eta: float = 3.0  # path-loss exponent
    sigma: float = 5**0.5  # [dB] shadowing and fast noise together

    @property
    def R(self) -> Array:
        return np.array([[self.sigma**2]])

    def level(self, x: Array, q: Array) -> Array:
        """The mean reading (...) [dBm]."""
        d2 = (x[..., 0] - q[..., 0]) ** 2 + (x[..., 1] - q[..., 1]) ** 2
        return self.A - 5 * self.eta * np.log10(np.maximum(d2, NEAR**2))

    def slope(self, x: Array, q: Array) -> Array:
        """d level / d position (..., 2) [dB/m]; zero inside the clamp."""
        east, north = x[..., 0] - q[..., 0], x[..., 1] - q[..., 1]
        d2 = east**2 + north**2
        far, clamped, fall = d2 > NEAR**2, np.maximum(d2, NEAR**2), -10 * self.eta / np.log(10)
        return np.stack([np.where(far, fall * away / clamped, 0.0) for away in (east, north)], -1)

    def expect(self, x: Array, q: Array) -> Array:
        """The mean reading (..., 1) [dBm]."""
        return self.level(x, q)[..., None]

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        g = self.slope(x, q)
        return z - self.expect(x, q), _widen(g[..., None, :], x), -g[..., None, :]


@dataclass(frozen=True)
class Range:
    """Distance to a place [m]. Readings below 0.2 m are refused (nan)."""

    sigma: float = 0.1  # [m]

    @property
    def R(self) -> Array:
        return np.array([[self.sigma**2]])

    def expect(self, x: Array, q: Array) -> Array:
        """The distance (..., 1) [m]."""
        return _offset(x, q)[1]

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

    @property
    def R(self) -> Array:
        return np.array([[self.sigma**2]])

    def expect(self, x: Array, q: Array) -> Array:
        """The direction (..., 1) in (-pi, pi] [rad]."""
        delta, _ = _offset(x, q)
        heading = x[..., 2:3] if x.shape[-1] > 2 else 0.0
        return wrap(np.arctan2(-delta[..., 1:], -delta[..., :1]) - heading)

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        delta, d = _offset(x, q)
        heading = x[..., 2:3] if x.shape[-1] > 2 else 0.0
        y = wrap(z - (np.arctan2(-delta[..., 1:], -delta[..., :1]) - heading))
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

    @property
    def R(self) -> Array:
        return np.array([[self.sigma_range**2, 0.0], [0.0, self.sigma_bearing**2]])

    def expect(self, x: Array, q: Array) -> Array:
        """Distance [m] and direction in (-pi, pi] [rad], (..., 2)."""
        return np.concatenate([Range().expect(x, q), Bearing().expect(x, q)], -1)

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        parts = (
            Range(self.sigma_range).innovation(x, q, z[..., :1]),
            Bearing(self.sigma_bearing).innovation(x, q, z[..., 1:]),
        )
        (y0, H0, Hq0), (y1, H1, Hq1) = parts
        return np.concatenate([y0, y1], -1), np.concatenate([H0, H1], -2), np.concatenate([Hq0, Hq1], -2)


@dataclass(frozen=True)
class Orientation:
    """A teammate's heading relative to the own [rad]; both states have headings."""

    sigma: float = 0.05  # [rad]

    @property
    def R(self) -> Array:
        return np.array([[self.sigma**2]])

    def expect(self, x: Array, q: Array) -> Array:
        """The heading (..., 1) in (-pi, pi] [rad] of a thing that faces along the x axis, relative to the own."""
        return wrap(-x[..., 2:3])

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        """Of a thing that faces along the x axis, which a place `q` does not change: y = wrap(z + heading)."""
        H = np.zeros((*z.shape, x.shape[-1]))
        H[..., 2] = -1.0
        return wrap(z + x[..., 2:]), H, np.zeros((*z.shape, 2))

    def between(self, x: Array, x_j: Array, z: Array) -> tuple[Array, Array, Array]:
        """y = wrap(z - (heading_j - heading)), H and H_j (..., 1, 3) for a teammate at x_j (..., 3)."""
        y, H, _ = self.innovation(x, x_j[..., :2], z - x_j[..., 2:])
        return y, H, -H


def _offset(x: Array, q: Array) -> tuple[Array, Array]:
    delta = x[..., :2] - q
    return delta, np.sqrt((delta**2).sum(-1, keepdims=True))


def _widen(H: Array, x: Array) -> Array:
    """Position Jacobian (..., k, 2) to (..., k, d)."""
    return np.concatenate([H, np.zeros((*H.shape[:-1], x.shape[-1] - 2))], -1)
