"""Autonomous robot localization: a particle filter on the robot's own odometry and anchors, without teammates.

The comparison's non-cooperative baseline. With `own="rssi"` it is the plain RSSI particle filter.

Source: P. Parashar et al. 2020, as Latif & Parasuraman use it ("ARL").
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cooploc.estimators import own
from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World


@dataclass(frozen=True)
class Arl(own.Settings):
    """Particle filter on own readings; sends nothing."""

    api: ClassVar[int] = 1
    uses: tuple[str, ...] = ("odometry", "anchor_rssi")

    def init(self, prior: Belief, world: World, rows: Rows) -> own.Own:
        return own.init(self, prior, world, rows)

    def predict(self, s: own.Own, z: Senses) -> own.Own:
        return own.predict(self, s, z)

    def correct(self, s: own.Own, z: Senses) -> own.Own:
        return own.correct(self, s, z, tell=False)

    def send(self, s: own.Own, z: Senses) -> Array:
        return np.empty((len(s.x), 0))

    def fuse(self, s: own.Own, z: Senses, mail: Mail) -> own.Own:
        return own.finish(self, s)

    def estimate(self, s: own.Own) -> Belief:
        return s.belief
