"""Autonomous robot localization: a particle filter on the robot's own odometry and anchors, without teammates.

The comparison's non-cooperative baseline. With `anchor_reading="rssi"` it is the plain RSSI particle filter.

Source: R. Parashar, R. Parasuraman, "Particle filter based localization of access points using direction of arrival on
mobile robots", VTC-Fall 2020, as Latif & Parasuraman use it ("ARL").
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World
from cooploc.estimators.particle import own_filter


@dataclass(frozen=True)
class Arl(own_filter.Settings):
    """Particle filter on own readings; sends nothing."""

    api: ClassVar[int] = 1

    def init(self, prior: Belief, world: World, rows: Rows) -> own_filter.FilterState:
        return own_filter.init(self, prior, world, rows)

    def predict(self, s: own_filter.FilterState, z: Senses) -> own_filter.FilterState:
        return own_filter.predict(self, s, z)

    def correct(self, s: own_filter.FilterState, z: Senses) -> own_filter.FilterState:
        return own_filter.correct(self, s, z, sends=False)

    def send(self, s: own_filter.FilterState, z: Senses) -> Array:
        return np.empty((len(s.x), 0))

    def fuse(self, s: own_filter.FilterState, z: Senses, mail: Mail) -> own_filter.FilterState:
        return own_filter.finish(self, s)

    def estimate(self, s: own_filter.FilterState) -> Belief:
        return s.belief
