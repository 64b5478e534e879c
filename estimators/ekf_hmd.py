"""Harmonic mean density with readings of teammates: beliefs are averaged where covariance intersection multiplies them.

A teammate's belief and a reading make an estimate of H x with the covariance N = H_j P_j H_j' + R; its harmonic mean
with the robot's own belief replaces that, and the rest of the state follows (`inverse_covariance_intersection.py`). No
bound is known, and a teammate that knows less takes away from what a robot knows.

Source: N. Sharma, R. Tharmarasa, S. Bhaumik, T. Kirubarajan, "On pooling-based track fusion strategies: harmonic mean
density", arXiv 2412.06716, 2024. Its use with a reading of part of the state is ours.
"""

from dataclasses import dataclass
from typing import ClassVar

from cooploc.estimators import broadcasts, kalman
from cooploc.estimators.errors import Limits
from cooploc.estimators.interface import Array, Belief
from cooploc.estimators.inverse_covariance_intersection import combine, harmonic_mean
from cooploc.estimators.models import AnchorReading
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


@dataclass(frozen=True)
@kalman.explain
class EkfHmd:
    """EKF on own readings, harmonic mean density of own and received beliefs.

    Parameters:
        weight: of the robot's own density in the mean, between 0 and 1. One mean is taken per teammate: of ten robots,
            0.8 has three quarters of the error that 0.5 has (`reports/fusion.md`).
    """

    api: ClassVar[int] = 1
    limits: ClassVar[Limits] = {"weight": (0, 1)}
    sends: ClassVar[str] = "mean, covariance, sightings"
    consistency: ClassVar[str] = "no bound is known"
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(kalman.GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    engine: kalman.EngineName = "batched"
    reading: kalman.RadioReading = "range"
    both: bool = True
    weight: float = 0.5
    loss: AssumedLoss = "world"

    uses = property(kalman.team_channels)
    init = broadcasts.start_broadcasting
    predict = kalman.predict_belief
    correct = kalman.correct_belief
    send = broadcasts.broadcast
    fuse = broadcasts.fuse_broadcasts
    estimate = kalman.estimate_belief

    def combine(self, belief: Belief, y: Array, H: Array, H_j: Array, P_j: Array, R: Array) -> Belief:
        """C^-1 = a^-1 + N^-1 - G^-1,  a = H P H',  N = H_j P_j H_j' + R,  G = v N + (1 - v) a + v (1 - v) y y'."""
        N = H_j @ P_j @ H_j.mT + R
        return combine(lambda a, b, y, _: harmonic_mean(self.weight, a, b, y), belief, y, H, N, self.gate)
