"""An extended Kalman filter on a robot's own readings, without teammates.

Source: S. Thrun, W. Burgard, D. Fox, "Probabilistic Robotics", 2005, table 7.2.
"""

from dataclasses import dataclass
from typing import ClassVar

from cooploc.estimators import kalman
from cooploc.estimators.dead_reckoning import State, ignore_mail, send_nothing
from cooploc.estimators.interface import Belief, Rows, World
from cooploc.estimators.models import AnchorReading
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


@dataclass(frozen=True)
@kalman.explain
class EkfLocal:
    """EKF on odometry and anchors or landmarks; sends nothing."""

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "nothing"
    consistency: ClassVar[str] = "consistent up to linearisation"
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(kalman.GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    engine: kalman.EngineName = "batched"
    loss: AssumedLoss = "world"

    uses = property(kalman.own_channels)
    predict = kalman.predict_belief
    correct = kalman.correct_belief
    send = send_nothing
    fuse = ignore_mail
    estimate = kalman.estimate_belief

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        return State(prior.x, prior.P, kalman.assume(self, world))
