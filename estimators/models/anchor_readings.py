"""What a Kalman filter makes of the four corner anchors: a direction, the gradient it comes from, or raw readings.

The gradient g of the signal strength is measured with independent Gaussian errors of standard deviation sigma/a and
sigma/b [dB/m], a and b the sides of the arena. So the variance of its direction is known: with u = (a g_x, b g_y)/sigma
measured and m expected, the angle between them has, given the length |u|, a von Mises density of concentration |u||m|,
and a variance near 1/(|u||m|). Near the centre, where the gradient vanishes, that is large, and the reading counts
little; a constant variance counts it too much there, and too little near the walls.

Source: K. V. Mardia, P. E. Jupp, "Directional Statistics", 2000, sec. 3.5.4 (the angle of a Gaussian vector, given its
length, is von Mises).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cooploc.estimators.interface import Array, Senses, Sensor, World
from cooploc.estimators.models.angles import wrap
from cooploc.estimators.models.gradient_doa import GradientDoa, gradient_doa
from cooploc.estimators.models.sensors import NEAR

AnchorReading = Literal["doa", "gradient", "rssi", "doa-constant", "none", "any"]
RAW = ("rssi", "any")  # readings as they are: of anchors in dBm; or of whatever fixed things there are
NOWHERE = np.zeros(2)  # a direction of arrival has no place of its own
WEAKEST = 1e-9  # concentrations are clamped here


@dataclass(frozen=True)
class WeightedDoa:
    """The direction of a measured gradient (..., 2), in units of its own standard deviation."""

    doa: GradientDoa

    @property
    def R(self) -> Array:
        return np.eye(1)

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        """sqrt(kappa) wrap(angle u - angle m), and its slopes with kappa held; `q` is not used."""
        u, m, root = self._whitened(x, z)
        dm = self.doa.slope(x) * self._scale
        length2 = np.maximum((m**2).sum(-1, keepdims=True), NEAR**2)
        turn = (m[..., :1] * dm[..., 1] - m[..., 1:] * dm[..., 0]) / length2
        y = wrap(np.arctan2(u[..., 1:], u[..., :1]) - np.arctan2(m[..., 1:], m[..., :1]))
        H = _widened((root * turn)[..., None, :], x)
        return root * y, H, np.zeros((*H.shape[:-1], 2))

    def at(self, x: Array, z: Array) -> tuple[Array, Array]:
        """The angle (..., 1) [rad] of a gradient z and its variance (..., 1, 1) [rad^2] for a robot at x."""
        _, _, root = self._whitened(x, z)
        return np.arctan2(z[..., 1:], z[..., :1]), (root**-2)[..., None]

    @property
    def _scale(self) -> Array:
        return np.array(self.doa.sides) / self.doa.rssi.sigma

    def _whitened(self, x: Array, z: Array) -> tuple[Array, Array, Array]:
        """u, m and sqrt(kappa) (..., 1), kappa = |u||m|."""
        u, m = z * self._scale, self.doa.expect(x) * self._scale
        kappa = np.sqrt((u**2).sum(-1, keepdims=True) * (m**2).sum(-1, keepdims=True))
        return u, m, np.sqrt(np.maximum(kappa, WEAKEST))


@dataclass(frozen=True)
class GradientReading:
    """The measured gradient (..., 2) [dB/m] itself: direction and strength."""

    doa: GradientDoa

    @property
    def R(self) -> Array:
        return np.diag((self.doa.rssi.sigma / np.array(self.doa.sides)) ** 2)

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        """z - g(x) and its slopes; `q` is not used."""
        H = _widened(self.doa.slope(x).mT, x)
        return z - self.doa.expect(x), H, np.zeros((*H.shape[:-1], 2))


def fixed(world: World, z: Senses, reading: AnchorReading) -> Iterator[tuple[Sensor, Array, Array]]:
    """`world.fixed`, with the four anchor readings replaced by what `reading` says is made of them; "none": nothing."""
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


def _widened(H: Array, x: Array) -> Array:
    """Position Jacobian (..., k, 2) to (..., k, d)."""
    return np.concatenate([H, np.zeros((*H.shape[:-1], x.shape[-1] - 2))], -1)
