"""Direction of arrival from the gradient of four corner readings.

The gradient of the signal strength over the arena, by central differences between the corner nodes, points along the
direction of the robot. Its noise is Gaussian in the gradient, not in the angle: near the centre the gradient vanishes
and the angle says nothing (RMS error 79 deg within 0.5 m, 7 deg beyond 3 m). Hence several densities: the paper's
Gaussian of constant sigma, whose error can be read in three ways, the exact projected normal, and that of the gradient.

Sources: Latif & Parasuraman, eqs. (1)-(4); R. Parasuraman et al., "Spatial sampling strategy for a 3D sound source
localization sensor network using RSSI", 2013 (the central differences); K. V. Mardia, "Statistics of Directional Data",
1972, sec. 3.4.7 (the projected, or offset, normal).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cooploc.estimators.interface import Array, World
from cooploc.estimators.models.angles import wrap
from cooploc.estimators.models.sensors import NEAR, LogDistance
from cooploc.estimators.plugins.errors import BadInput


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
        corners: Array = np.array(self.corner) + np.array([[0, 0], [0, b], [a, b], [a, 0]])
        return corners

    @property
    def sigma(self) -> float:
        """RMS angle error [rad] over the arena under the noise model: computed, not tuned."""
        return _rms_error(self.rssi.eta, self.rssi.sigma, self.sides)

    @property
    def R(self) -> Array:
        return np.array([[self.sigma**2]])

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
        return _angle(self.gradient(S))

    def expect(self, x: Array) -> Array:
        """The gradient (..., 2) that the path-loss model gives at x (..., d): removes the gradient's own bias."""
        return self.gradient(np.moveaxis(self.rssi.level(x, self._beside(x)), 0, -1))

    def _beside(self, x: Array) -> Array:
        """The nodes (4, 1 .., 2) on an axis before those of x: numpy's inner loops stay long."""
        return self.anchors.reshape(4, *[1] * (x.ndim - 1), 2)

    def bearing(self, x: Array) -> Array:
        """ADOA (...) [rad]: the direction of the expected gradient."""
        return _angle(self.expect(x))

    def slope(self, x: Array) -> Array:
        """d expect / d position (..., 2 of position, 2 of gradient) [dB/m^2]."""
        return self.gradient(np.moveaxis(self.rssi.slope(x, self._beside(x)), 0, -1))

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        """The constant-sigma form; `q` is not used. d angle = (g_x dg_y - g_y dg_x) / |g|^2."""
        g, dg = self.expect(x), self.slope(x)
        strength = np.maximum((g**2).sum(-1), NEAR**2)[..., None]
        slope = (g[..., :1] * dg[..., 1] - g[..., 1:] * dg[..., 0]) / strength
        H = np.concatenate([slope, np.zeros((*slope.shape[:-1], x.shape[-1] - 2))], -1)[..., None, :]
        y = wrap(z - np.arctan2(g[..., 1:], g[..., :1]))
        return y, H, np.zeros((*H.shape[:-1], 2))

    def log_constant(self, x: Array, angle: Array) -> Array:
        """log N(wrap(ADOA(x) - DOA); 0, sigma^2) up to a constant  (eq. 5 of the paper)."""
        return -0.5 * (wrap(self.bearing(x) - angle) / self.sigma) ** 2

    def log_sum(self, x: Array, angle: Array) -> Array:
        """log N(err; 0, sigma^2) up to a constant, err = sum_j (ADOA_j - DOA_j), signed and not wrapped  (eqs. 4, 5).

        "The error between actual DOA (ADOA) for all wireless sensors at a potential candidate position [...] to the
        perceived DOA values for each sensor". Only one DOA is perceived, that of eq. (3), "concerning the WSN's
        center": here ADOA is the same angle at the candidate, and every node repeats both.
        """
        err = len(self.anchors) * (self.bearing(x) - angle)
        density: Array = -0.5 * (err / self.sigma) ** 2
        return density

    def log_corners(self, x: Array, angle: Array) -> Array:
        """`log_sum` with ADOA_j the direction of x seen from node j, in (-pi, pi].

        Directions of the nodes seen from x have the same sum. It is smallest far outside the arena, where all nodes lie
        in one direction.
        """
        away = x[..., :2] - self._beside(x)
        err = np.arctan2(away[..., 1], away[..., 0]).sum(0) - len(self.anchors) * angle
        density: Array = -0.5 * (err / self.sigma) ** 2
        return density

    def log_gradient(self, x: Array, g: Array) -> Array:
        """log N(g - g(x); 0, sigma^2 diag(1/a^2, 1/b^2)) up to a constant, for a measured gradient g (..., 2)."""
        whitened = (g - self.expect(x)) * np.array(self.sides) / self.rssi.sigma
        density: Array = -0.5 * (whitened**2).sum(-1)
        return density

    def log_exact(self, x: Array, angle: Array) -> Array:
        """log of the projected normal density of the angle, for a gradient g ~ N(g(x), sigma^2 diag(1/a^2, 1/b^2))."""
        a, b = self.sides
        mu = self.expect(x) * np.array([a, b]) / self.rssi.sigma  # whitened
        u = np.stack([np.cos(angle) * a, np.sin(angle) * b], -1) / self.rssi.sigma
        A = (u**2).sum(-1)
        t = (u * mu).sum(-1) / np.sqrt(A)
        density: Array = np.log(a * b / self.rssi.sigma**2 / (2 * np.pi * A)) - 0.5 * (mu**2).sum(-1) + _log_tail(t)
        return density


def gradient_doa(world: World) -> GradientDoa:
    """The DOA sensor of a world.

    Raises:
        BadInput: the world's anchors are not four corners in the order (0,0) (0,b) (a,b) (a,0).

    """
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
    tail: Array = np.where(t > 0, log_sum, np.log(np.maximum(below, np.finfo(float).tiny)))
    return tail


def _angle(g: Array) -> Array:
    angle: Array = np.arctan2(g[..., 1], g[..., 0])
    return angle


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
