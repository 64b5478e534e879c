"""How much the direction of a gradient tells of where a robot is, when its strength is forgotten.

A measured gradient in units of its own errors is u ~ N(m, I), with m expected at the robot. Of its angle alone the
Fisher information about m is the variance of the score E[u | angle] - m. Seen along m and across it, it is diagonal:

    across  E[(E[r | a] sin a)^2],   along  E[(E[r | a] cos a - |m|)^2],   a the angle between u and m, r = |u|.

The whole gradient has 1 and 1. Where it is weak, its angle keeps pi/4 of both; where it is strong, all of the part
across and 2/|m|^2 of the part along.

Source: K. V. Mardia, P. E. Jupp, "Directional Statistics", 2000, sec. 3.5.6 (the projected normal distribution).
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.special import erfcx

from cooploc.estimators.interface import Array
from cooploc.estimators.models.gradient_doa import GradientDoa

STRONGEST, STRENGTHS, ANGLES = 30.0, 1201, 1024  # of the table: |m|, its values, angles of each integral
WEAKEST = 1e-9  # |m| below which there is no direction


@dataclass(frozen=True)
class DirectionAlone:
    """The angle of a gradient as a sensor whose H' R^-1 H is that angle's Fisher information about the position."""

    doa: GradientDoa

    @property
    def R(self) -> Array:
        return np.eye(2)

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        """z, nan where the gradient (..., 2) is absent, and H (..., 2, 2) at x (..., 2); `q` is not used."""
        scale = np.array(self.doa.sides) / self.doa.rssi.sigma
        m, dm = self.doa.expect(x) * scale, self.doa.slope(x) * scale
        strength = np.maximum(np.hypot(m[..., 0], m[..., 1]), WEAKEST)
        along = m / strength[..., None]
        across = np.stack([-along[..., 1], along[..., 0]], -1)
        told = np.sqrt(np.stack(information(strength), -1))
        H = told[..., None] * np.stack([(dm @ e[..., None])[..., 0] for e in (along, across)], -2)
        return z, H, np.zeros_like(H)


def information(strength: Array) -> tuple[Array, Array]:
    """The Fisher information of the angle of u ~ N(m, I) about m, along m and across it, for |m| of any shape.

    For |m| above 30 that at 30 is taken: it is too large along m, by less than 0.003, so that a floor stays a floor.
    """
    strengths, along, across = _table()
    return np.interp(strength, strengths, along), np.interp(strength, strengths, across)


@cache
def _table() -> tuple[Array, Array, Array]:
    """|m|, and the information along m and across it, by quadrature over the angle."""
    s = np.linspace(0, STRONGEST, STRENGTHS)[:, None]
    a = 2 * np.pi * np.arange(ANGLES) / ANGLES
    t = s * np.cos(a)
    h = np.sqrt(np.pi / 2) * erfcx(-t / np.sqrt(2))  # Phi(t) / phi(t)
    density = np.exp(-(s**2) / 2) * (1 + t * h) / ANGLES  # of the angle, times the step
    r = (t + (1 + t**2) * h) / (1 + t * h)  # E[r | a]
    along = (density * (r * np.cos(a) - s) ** 2).sum(-1)
    across = (density * (r * np.sin(a)) ** 2).sum(-1)
    return s[:, 0], along, across
