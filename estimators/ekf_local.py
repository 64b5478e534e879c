"""An extended Kalman filter on a robot's own readings, without teammates.

Source: S. Thrun, W. Burgard, D. Fox, "Probabilistic Robotics", 2005, table 7.2.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cooploc.estimators import kalman
from cooploc.estimators.dead_reckoning import State
from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World


@kalman.explain
@dataclass(frozen=True)
class EkfLocal(kalman.KalmanParameters):
    """EKF on odometry and anchors or landmarks; sends nothing."""

    sends: ClassVar[str] = "nothing"
    consistency: ClassVar[str] = "consistent up to linearisation"

    predict = kalman.predict_belief
    correct = kalman.correct_belief
    estimate = kalman.estimate_belief

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        return State(prior.x, prior.P, kalman.assume(self, world))

    def send(self, s: State, z: Senses) -> Array:
        return np.empty((len(s.x), 0))

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        return s
