"""The team's maximum a posteriori estimate over all readings up to now: a bound for every filter.

One computer gets every reading and finds the team's most probable last `window` positions by the Gauss-Newton method: a
Kalman smoother over the window, repeated `iterations` times. The past beyond is one Gaussian. While the window holds
the whole past, a second start is tried, where readings of fixed things put each track. Nothing is gated.

Sources: B. Bell, "The iterated Kalman smoother as a Gauss-Newton method", SIAM J. Optimization 4(3), 1994; G. Sibley,
L. Matthies, G. Sukhatme, "Sliding window filter with application to planetary landing", J. Field Robotics 27(5), 2010.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from cooploc.estimators import kalman_window as window
from cooploc.estimators.errors import require
from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, Traffic, World
from cooploc.estimators.kalman import no_traffic
from cooploc.estimators.kalman_window import Window
from cooploc.estimators.models import fixed_channels, wrap_heading


@dataclass(frozen=True)
class MapJoint:
    """Maximum a posteriori estimate of the whole team over all readings up to now.

    Parameters:
        window: ticks that are estimated together [ticks, at least 1]; 1 is the iterated EKF.
        iterations: Gauss-Newton passes over the window in every tick [count, at least 1].
        anchor_reading: "rssi", each raw reading of whatever fixed things there are: RSSI [dBm] and ranges [m] of
            anchors, sightings of landmarks; or "none".
        reading: the radio readings between robots: "both", "rssi" [dBm], "range" [m], or "none".
    """

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "every reading"
    consistency: ClassVar[str] = "consistent where the models are right"
    bound: ClassVar[bool] = True
    window: int = 10
    iterations: int = 2
    anchor_reading: Literal["rssi", "none"] = "rssi"
    reading: Literal["both", "rssi", "range", "none"] = "both"

    @property
    def uses(self) -> tuple[str, ...]:
        """Return all channels that `anchor_reading` and `reading` do not leave out."""
        fixed = fixed_channels("none" if self.anchor_reading == "none" else "any")
        radio = tuple(f"radio_{name}?" for name in ("rssi", "range") if self.reading in (name, "both"))
        return ("odometry", *fixed, "sighting?", *radio)

    def __post_init__(self) -> None:
        require(self, {"window": (1, 10_000), "iterations": (1, 1000)})

    def init(self, prior: Belief, world: World, rows: Rows) -> Window:
        return window.empty(prior, world)

    def predict(self, s: Window, z: Senses) -> Window:
        """Add a new state x' = f(x, u) at the end of the window."""
        return window.append_tick(s, z)

    def correct(self, s: Window, z: Senses) -> Window:
        return s

    def exchange(self, s: Window, z: Senses, air: Mail) -> tuple[Window, Traffic]:
        """Repeat Gauss-Newton over the window, by readings of fixed things too. Then the oldest state may leave."""
        s = s._replace(air=Mail(*map(window.append, s.air, air)))
        best, filtered = _optimise(s, self.iterations)
        if s.young:
            best, filtered = _more_probable((best, filtered), _optimise(window.second_start(s), self.iterations))
        if best.x.shape[1] == self.window:
            best = window.drop_oldest(best, filtered[0])
        return best, no_traffic(best.last)

    def estimate(self, s: Window) -> Belief:
        t, n, d = s.last.shape
        return Belief(wrap_heading(s.last), np.einsum("tiaib->tiab", s.P.reshape(t, n, d, n, d)))


Optimum = tuple[Window, list[Belief]]  # and the last pass's filter


def _optimise(s: Window, iterations: int) -> Optimum:
    """Return the window after so many Gauss-Newton passes."""
    for _ in range(iterations):
        found = window.smooth_window(s)
        s = s._replace(x=found.x, P=found.filtered[-1].P)
    return s, found.filtered


def _more_probable(one: Optimum, other: Optimum) -> Optimum:
    """Return the optimum of larger posterior density, trial by trial."""
    (s, filtered), (s1, others) = one, other
    better = window.cost(s1) < window.cost(s)

    def choose(a: Array, b: Array) -> Array:
        return np.where(better.reshape(-1, *[1] * (a.ndim - 1)), b, a)

    filtered = [Belief(*map(choose, a, b)) for a, b in zip(filtered, others, strict=True)]
    return s._replace(x=choose(s.x, s1.x), P=choose(s.P, s1.P)), filtered
