"""Cooperative EKF that ignores cross-covariances: it treats every received belief as independent of its own.

What two robots learned from each other comes back as if it were new, so the covariance falls without reason.

Source: S. Roumeliotis, G. Bekey, "Distributed multirobot localization", IEEE T-RA 18(5), 2002, with P_ij = 0 always;
A. Howard, M. Mataric, G. Sukhatme, "Putting the 'I' in 'team'", ICRA 2003, on such circular reasoning.
"""

from dataclasses import dataclass
from typing import ClassVar

from cooploc.estimators import kalman
from cooploc.estimators.interface import Array


@kalman.explain
@dataclass(frozen=True)
class EkfNaive(kalman.BroadcastFilter):
    """EKF on own readings and on received beliefs, which it treats as independent."""

    consistency: ClassVar[str] = "over-confident: counts shared beliefs again and again"

    def combine(self, x: Array, P: Array, y: Array, H: Array, N: Array) -> tuple[Array, Array]:
        """S = H P H' + N: the sender's uncertainty counts as noise, independent of the robot's own."""
        return kalman.ENGINES[self.engine].update(x, P, y, H, N, self.gate)
