"""Covariance intersection with relative readings: one EKF per robot, no independence assumption between robots.

Each robot keeps an EKF of its own state and broadcasts it with its sightings of teammates. A robot uses its own
readings of each robot it receives, and their sightings of it. Both covariances of a reading are first inflated, by 1/w
and 1/(1-w), so that no unknown correlation can make the result over-confident; the reading's own noise is not.

Source: L. C. Carrillo-Arce, E. D. Nerurkar, J. L. Gordillo, S. I. Roumeliotis, "Decentralized multi-robot cooperative
localization using covariance intersection", IROS 2013; here blkdiag(P_i/w, P_j/(1-w)) is inflated before the update
of robot i, which is overlapping covariance intersection (arXiv 2603.16768) of a pair of beliefs and one reading.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from cooploc.estimators import broadcasts, kalman
from cooploc.estimators.covariance_intersection import solve_relative
from cooploc.estimators.interface import Array, Belief, Mail, Senses
from cooploc.estimators.models import AnchorReading
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


@dataclass(frozen=True)
@kalman.explain
class EkfCi:
    """EKF on own readings, covariance intersection on received beliefs.

    Parameters:
        criterion: what w minimises of the result: its "trace" or its "det".
        over: what the criterion is about. Over the "position" [m^2] alone, headings that no reading sees are inflated
            without bound; over the whole "state", the trace adds m^2 to rad^2.
    """

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "mean, covariance, sightings"
    consistency: ClassVar[str] = "conservative by construction"
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(kalman.GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    engine: kalman.EngineName = "batched"
    reading: kalman.RadioReading = "range"
    criterion: Literal["trace", "det"] = tunable("trace", choices=("trace", "det"))
    over: Literal["position", "state"] = tunable("state", choices=("state", "position"))
    loss: AssumedLoss = "world"

    uses = property(kalman.team_channels)
    init = broadcasts.start_broadcasting
    predict = kalman.predict_belief
    correct = kalman.correct_belief
    estimate = kalman.estimate_belief

    def send(self, s: broadcasts.BroadcastState, z: Senses) -> Array:
        """Return x, the upper triangle of P, the sightings: d + d (d + 1) / 2 + 2 n numbers at most."""
        return kalman.Message(s.x, (s.P,), z.sighting).pack()

    def fuse(self, s: broadcasts.BroadcastState, z: Senses, mail: Mail) -> broadcasts.BroadcastState:
        rule = broadcasts.Rule(intersect=True, trace=self.criterion == "trace", block=self._block(s.x))
        return broadcasts.fuse_compiled(self, s, z, mail, rule)

    def _block(self, x: Array) -> int:
        """Return how many leading states the criterion is about."""
        return 2 if self.over == "position" else x.shape[-1]

    def combine(self, belief: Belief, y: Array, H: Array, H_j: Array, P_j: Array, R: Array) -> Belief:
        """x' = x + K y,  P' = (I - K H) P/w  with  K = P/w H' (H P/w H' + H_j P_j/(1-w) H_j' + R)^-1.

        Gated by the S of independent robots, twice as wide: a true reading passes whatever the correlation.
        """
        rows = np.flatnonzero(~(np.isnan(y).any(-1) | np.isnan(P_j).any((-2, -1))))
        S = H[rows] @ belief.P[rows] @ H[rows].mT + H_j[rows] @ P_j[rows] @ H_j[rows].mT + R
        rows = rows[kalman.distance(y[rows], S) <= 2 * self.gate]
        if rows.size == 0:
            return belief
        x, P, y, H, H_j, P_j = (part[rows] for part in (*belief, y, H, H_j, P_j))
        w = solve_relative(P, P_j, H, H_j, R, self.criterion, "exact", self._block(x)).w
        after = kalman.inflated_update(Belief(x, P), y, H, H_j, P_j, R, w, kalman.ENGINES[self.engine].update)
        x, P = belief.x.copy(), belief.P.copy()
        x[rows], P[rows] = after
        return Belief(x, P)
