"""Cooperative EKF that ignores cross-covariances: it treats every received belief as independent of its own.

What two robots learned from each other comes back as if it were new, so the covariance falls without reason.

Source: S. Roumeliotis, G. Bekey, "Distributed multirobot localization", IEEE T-RA 18(5), 2002, with P_ij = 0 always;
A. Howard, M. Mataric, G. Sukhatme, "Putting the 'I' in 'team'", ICRA 2003, on such circular reasoning.
"""

from dataclasses import dataclass
from typing import ClassVar

from cooploc.estimators import broadcasts, kalman
from cooploc.estimators.interface import Array, Belief, Mail, Senses
from cooploc.estimators.models import AnchorReading
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


@dataclass(frozen=True)
@kalman.explain
class EkfNaive:
    """EKF on own readings and on received beliefs, which it treats as independent."""

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "mean, covariance, sightings"
    consistency: ClassVar[str] = "over-confident: counts shared beliefs again and again"
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(kalman.GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    engine: kalman.EngineName = "batched"
    reading: kalman.RadioReading = "range"
    both: bool = True
    loss: AssumedLoss = "world"

    uses = property(kalman.team_channels)
    init = broadcasts.start_broadcasting
    predict = kalman.predict_belief
    correct = kalman.correct_belief
    send = broadcasts.broadcast
    estimate = kalman.estimate_belief

    def fuse(self, s: broadcasts.BroadcastState, z: Senses, mail: Mail) -> broadcasts.BroadcastState:
        return broadcasts.fuse_compiled(self, s, z, mail, broadcasts.Rule())

    def combine(self, belief: Belief, y: Array, H: Array, H_j: Array, P_j: Array, R: Array) -> Belief:
        """S = H P H' + H_j P_j H_j' + R: the sender's uncertainty counts as noise, independent of the robot's own."""
        return Belief(*kalman.ENGINES[self.engine].update(*belief, y, H, H_j @ P_j @ H_j.mT + R, self.gate))
