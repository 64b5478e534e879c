"""Autonomous robot localization: a particle filter on the robot's own odometry and anchors, without teammates.

The comparison's non-cooperative baseline. With `anchor_reading="rssi"` it is the plain RSSI particle filter.

Source: R. Parashar, R. Parasuraman, "Particle filter based localization of access points using direction of arrival on
mobile robots", VTC-Fall 2020, as Latif & Parasuraman use it ("ARL").
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cooploc.estimators import particles as shared
from cooploc.estimators.interface import Array, Mail, Senses


@shared.explain
@dataclass(frozen=True)
class Arl(shared.ParticleParameters):
    """Particle filter on own readings; sends nothing."""

    sends: ClassVar[str] = "nothing"

    uses = property(shared.own_channels)
    init = shared.init
    predict = shared.predict
    correct = shared.correct
    estimate = shared.estimate

    @property
    def consistency(self) -> str:
        """Return what theory says of its covariance."""
        if self.anchor_reading == "rssi":
            return "consistent but for the number of particles"
        return "over-confident: a constant angle error, smoothed angles"

    def send(self, s: shared.FilterState, z: Senses) -> Array:
        return np.empty((len(s.x), 0))

    def fuse(self, s: shared.FilterState, z: Senses, mail: Mail) -> shared.FilterState:
        return shared.resample_and_estimate(self, s)
