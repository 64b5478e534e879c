"""What an anchor's signal strength says of the range to it, learned instead of assumed.

The path-loss law A - 10 eta log10 d is a line in the logarithm of the distance, with one spread everywhere. Behind
walls it is neither. Here both are polynomials in log10 d, fitted by ridge regression to signals whose true ranges are
known: of `cl.training`, which gives streams that no result is reported of. What was learned stands in
`learned_range.npz`, which the class names in `artifacts`: it is hashed with the source, and tables say what it was
trained on.

    python examples/learned_range.py                                     # learns again, and writes learned_range.npz
    cooploc check examples/learned_range.py:LearnedRange
    cooploc tune examples/learned_range.toml --budget 100                # against the law, both tuned alike

Bayes' rule asks how likely a signal is at a range, not which range is likely for a signal: so the signal is learned
over the range, and the filter turns it around.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

import cooploc as cl
from cooploc.estimators.ekf_local import EkfLocal
from cooploc.estimators.models import inflate

FILE = Path(__file__).with_name("learned_range.npz")
NEAR = 0.1  # [m] shorter ranges count as this
DEGREE, RIDGE = 4, 1e-3
MEAN_LOG_CHI2 = -1.27036  # of one degree of freedom: what a logarithm of a squared residual lies below its variance's


@dataclass(frozen=True)
class LearnedSignal:
    """A sensor: polynomials of u = log10 d for the mean [dBm] and for the logarithm of the variance."""

    mean: tuple[float, ...]  # from the highest power down
    log_variance: tuple[float, ...]
    sigma: float = 1.0  # the learned spread times this

    @property
    def R(self):
        return np.array([[self.sigma**2]])

    def innovation(self, x, q, z):
        """(z - f(u)) / s(u), and its slopes with s held."""
        away = x[..., :2] - q
        d = np.maximum(np.hypot(away[..., 0], away[..., 1]), NEAR)
        u, spread = np.log10(d), self.spread(d)
        slope = np.polyval(np.polyder(self.mean), u) / (np.log(10) * d**2 * spread)
        g = (slope[..., None] * away)[..., None, :]
        H = np.concatenate([g, np.zeros((*g.shape[:-1], x.shape[-1] - 2))], -1)
        return (z - np.polyval(self.mean, u)[..., None]) / spread[..., None], H, -g

    def spread(self, d):
        """The standard deviation [dB] at a range [m]."""
        return np.exp(np.polyval(self.log_variance, np.log10(d)) / 2)


@dataclass(frozen=True)
class LearnedRange(EkfLocal):
    """EKF on odometry and anchors, whose signals it knows from training."""

    artifacts: ClassVar[tuple[str, ...]] = ("learned_range.npz",)
    trained_on: ClassVar[str] = "nlos, 100 trials"
    anchor_reading: Literal["rssi"] = "rssi"

    def assumed_world(self, world):
        with np.load(FILE) as found:
            learned = LearnedSignal(*(tuple(found[name].tolist()) for name in ("mean", "log_variance")))
        sensors = {**world.sensors, "anchor_rssi": learned}
        return inflate(cl.World(**{**vars(world), "sensors": sensors}), self.inflation)


def learn(trials=100):
    """The coefficients of both polynomials, from true ranges and their signals."""
    truth, stream = cl.training("nlos", trials)
    away = truth.x[..., None, :2] - stream.world.anchors
    u = np.log10(np.maximum(np.hypot(away[..., 0], away[..., 1]), NEAR)).ravel()
    signal = stream.senses.anchor_rssi.ravel()
    mean = ridge(u, signal)
    residual = signal - np.polyval(mean, u)
    return {"mean": mean, "log_variance": ridge(u, np.log(residual**2 + 1e-9) - MEAN_LOG_CHI2)}


def ridge(u, y):
    """Coefficients w of a polynomial, from the highest power down: (U'U / n + RIDGE I) w = U'y / n, but for w_0."""
    U = np.vander(u, DEGREE + 1)
    penalty = RIDGE * np.diag([1.0] * DEGREE + [0.0])
    return np.linalg.solve(U.T @ U / len(y) + penalty, U.T @ y / len(y))


if __name__ == "__main__":
    np.savez(FILE, **learn())
