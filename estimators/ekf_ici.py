"""Inverse covariance intersection with readings of teammates: what two robots may both know is counted once.

A teammate's belief and a reading make an estimate of H x with the covariance N = H_j P_j H_j' + R; its fusion with the
robot's own belief takes out the largest information that the two can have in common, and the rest of the state follows
(`inverse_covariance_intersection.py`). Of one number, as a range is, C = min(a, N): the better estimate is kept.

Source: B. Noack, J. Sijs, M. Reinhardt, U. D. Hanebeck, "Decentralized data fusion with inverse covariance
intersection", Automatica 79, 2017. Its use with a reading of part of the state is ours.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from cooploc.estimators import broadcasts, kalman
from cooploc.estimators.errors import Limits
from cooploc.estimators.interface import Array, Belief
from cooploc.estimators.inverse_covariance_intersection import combine, intersection_at_weight, inverse_intersection
from cooploc.estimators.models import AnchorReading
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


@dataclass(frozen=True)
@kalman.explain
class EkfIci:
    """EKF on own readings, inverse covariance intersection on received beliefs.

    Parameters:
        form: the weight w of a fusion: "trace", the one of least trace, as published; "fixed", always 1 - weight.
        weight: of the robot's own belief, between 0 and 1, where it is fixed (`reports/fusion.md`).
    """

    api: ClassVar[int] = 1
    limits: ClassVar[Limits] = {"weight": (0, 1)}
    sends: ClassVar[str] = "mean, covariance, sightings"
    consistency: ClassVar[str] = "a bound where robots share common information alone; else not"
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(kalman.GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    engine: kalman.EngineName = "batched"
    reading: kalman.RadioReading = "range"
    both: bool = True
    form: Literal["trace", "fixed"] = "trace"
    weight: float = 0.8
    loss: AssumedLoss = "world"

    uses = property(kalman.team_channels)
    init = broadcasts.start_broadcasting
    predict = kalman.predict_belief
    correct = kalman.correct_belief
    send = broadcasts.broadcast
    fuse = broadcasts.fuse_broadcasts
    estimate = kalman.estimate_belief

    def combine(self, belief: Belief, y: Array, H: Array, H_j: Array, P_j: Array, R: Array) -> Belief:
        """C^-1 = a^-1 + N^-1 - (w a + (1 - w) N)^-1,  a = H P H',  N = H_j P_j H_j' + R.

        The least trace is that of P', as in `ekf-ci`.
        """
        N = H_j @ P_j @ H_j.mT + R
        if self.form == "trace":
            return combine(inverse_intersection, belief, y, H, N, self.gate)
        return combine(lambda a, b, y, _: intersection_at_weight(self.weight, a, b, y), belief, y, H, N, self.gate)
