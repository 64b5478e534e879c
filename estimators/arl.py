"""Autonomous robot localization: a particle filter on the robot's own odometry and anchors, without teammates.

The comparison's non-cooperative baseline. With `anchor_reading="rssi"` it is the plain RSSI particle filter.

Source: R. Parashar, R. Parasuraman, "Particle filter based localization of access points using direction of arrival on
mobile robots", VTC-Fall 2020, as Latif & Parasuraman use it ("ARL").
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from cooploc.estimators import particles as shared
from cooploc.estimators.dead_reckoning import send_nothing
from cooploc.estimators.interface import Mail, Senses
from cooploc.estimators.models import RAW
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


@dataclass(frozen=True)
@shared.explain
class Arl:
    """Particle filter on own readings; sends nothing."""

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "nothing"
    particles: int = 200
    anchor_reading: shared.AnchorReading = "doa"
    density: Literal["constant", "exact"] = tunable("constant", choices=("constant", "exact"), where=shared.DOA)
    residual: Literal["wrapped", "sum", "corners", "code"] = "wrapped"
    M: int = tunable(5, 1, 10, where=shared.DOA)
    K: int = tunable(5, 1, 10, where=shared.DOA)
    decay: float = tunable(0.99, 0.5, 1.0, where=shared.DOA)
    temper: bool = tunable(True, choices=(True, False), where=shared.DOA)
    point: Literal["mean", "max"] = "mean"
    proposal: Literal["walk", "box", "best"] = "walk"
    box: float = 0.5  # [m]
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    precision: Literal["double", "single"] = "double"
    loss: AssumedLoss = "world"

    uses = property(shared.own_channels)
    init = shared.init
    predict = shared.predict
    correct = shared.correct
    send = send_nothing
    estimate = shared.estimate

    @property
    def consistency(self) -> str:
        """Return what theory says of its covariance."""
        if self.anchor_reading in RAW:
            return "consistent but for the number of particles"
        return "over-confident: a constant angle error, smoothed angles"

    def fuse(self, s: shared.FilterState, z: Senses, mail: Mail) -> shared.FilterState:
        return shared.resample_and_estimate(self, s)
