"""Autonomous robot localization: a particle filter on the robot's own odometry and anchors, without teammates.

The comparison's non-cooperative baseline. With `anchor_reading="rssi"` it is the plain RSSI particle filter.

Source: R. Parashar, R. Parasuraman, "Particle filter based localization of access points using direction of arrival on
mobile robots", VTC-Fall 2020, as Latif & Parasuraman use it ("ARL").
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cooploc.estimators import particles
from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World


@dataclass(frozen=True)
class Arl(particles.ParticleSettings):
    """Particle filter on own readings; sends nothing."""

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "nothing"

    @property
    def consistency(self) -> str:
        """Return what theory says of its covariance."""
        if self.anchor_reading == "rssi":
            return "consistent but for the number of particles"
        return "over-confident: a constant angle error, smoothed angles"

    def init(self, prior: Belief, world: World, rows: Rows) -> particles.FilterState:
        return particles.init_single(self, prior, world, rows)

    def predict(self, s: particles.FilterState, z: Senses) -> particles.FilterState:
        return particles.predict_single(self, s, z)

    def correct(self, s: particles.FilterState, z: Senses) -> particles.FilterState:
        return particles.correct_single(self, s, z, sends=False)

    def send(self, s: particles.FilterState, z: Senses) -> Array:
        return np.empty((len(s.x), 0))

    def fuse(self, s: particles.FilterState, z: Senses, mail: Mail) -> particles.FilterState:
        return particles.resample_and_estimate(self, s)

    def estimate(self, s: particles.FilterState) -> Belief:
        return s.belief
