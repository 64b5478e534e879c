"""An extended Kalman filter on a robot's own readings, without teammates.

Source: S. Thrun, W. Burgard, D. Fox, "Probabilistic Robotics", 2005, table 7.2.
"""

from dataclasses import dataclass

import numpy as np

from cooploc.estimators.dead_reckoning import State
from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World
from cooploc.estimators.kalman import Settings, correct_row, predict_row
from cooploc.estimators.models import wrap_heading


@dataclass(frozen=True)
class EkfLocal(Settings):
    """EKF on odometry and anchors or landmarks; sends nothing."""

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        world = self.assumed_world(world)
        return State(prior.x, prior.P, world)

    def predict(self, s: State, z: Senses) -> State:
        """x' = f(x, u),  P' = F P F' + Q."""
        x, P, _ = predict_row(self, s.world, s.x, s.P, z)
        return s._replace(x=x, P=P)

    def correct(self, s: State, z: Senses) -> State:
        """x' = x + K y,  P' = (I - K H) P (I - K H)' + K R K', one reading after the other."""
        x, P = correct_row(self, s.world, s.x, s.P, z)
        return s._replace(x=x, P=P)

    def send(self, s: State, z: Senses) -> Array:
        return np.empty((len(s.x), 0))

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        return s

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.x), s.P)
