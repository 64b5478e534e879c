"""Recursive decentralised localization: cross-covariances kept as factors, communication only when two robots meet.

P_ij = sigma_ij sigma_ji', and robot i keeps sigma_ij. A robot's own readings change only its own factors. When robot i
measures robot j, the two assemble their joint Gaussian and update it exactly; each then updates its cross terms with
all others approximately, as if its new belief came from a reading of its own.

Sent, in numbers of 8 bytes and with a header of 8: request 0; reply x_j, P_j, sigma_ji, d + d(d+1)/2 + d^2; result
x_j', P_j', d + d(d+1)/2. If the link fails in either direction, the reading is lost. Ours: a gate, and the limit on the
correlation of two robots (`LIMIT`).

Source: L. Luft, T. Schubert, S. Roumeliotis, W. Burgard, "Recursive decentralized localization for multi-robot systems
with asynchronous pairwise communication", IJRR 37(10), 2018.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from cooploc.estimators import kalman
from cooploc.estimators.interface import Array, Belief, Mail, Mask, Rows, Senses, Traffic, World
from cooploc.estimators.joint_kernels import limit_correlation, meet
from cooploc.estimators.models import AnchorReading
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


class State(NamedTuple):
    """The memory of the robots; axis 1 is the robot that keeps it."""

    x: Array  # (t, n, d)
    P: Array  # (t, n, d, d)
    sigma: Array  # (t, n, n, d, d)  sigma_ij; the diagonal is not used
    world: World


@dataclass(frozen=True)
@kalman.explain
class EkfLuft:
    """Decentralised EKF with pairwise communication and factored cross terms."""

    api: ClassVar[int] = 1
    bound: ClassVar[bool] = False
    sends: ClassVar[str] = "belief and cross factor, on request"
    consistency: ClassVar[str] = "approximate: correlations with third robots are guessed"
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(kalman.GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    engine: kalman.EngineName = "batched"
    reading: kalman.RadioReading = "range"
    loss: AssumedLoss = "world"

    uses = property(kalman.team_channels)
    estimate = kalman.estimate_belief

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        world = kalman.assume(self, world)
        t, n, d = prior.x.shape
        return State(prior.x, prior.P, np.zeros((t, n, n, d, d)), world)

    def predict(self, s: State, z: Senses) -> State:
        """P_i' = F_i P_i F_i' + Q_i,  sigma_ij' = F_i sigma_ij."""
        x, P, F = kalman.predict_ekf(self, s.world, s.x, s.P, z)
        return s._replace(x=x, P=P, sigma=F[:, :, None] @ s.sigma)

    def correct(self, s: State, z: Senses) -> State:
        """Private update: the EKF's, then sigma_ij' = (I - K H) sigma_ij = P_i' P_i^-1 sigma_ij."""
        x, P = kalman.correct_ekf(self, s.world, s.x, s.P, z)
        if (P == s.P).all():
            return s
        return s._replace(x=x, P=P, sigma=_carry_factors(s.P, P)[:, :, None] @ s.sigma)

    def exchange(self, s: State, z: Senses, air: Mail) -> tuple[State, Traffic]:
        d = s.x.shape[-1]
        sent, belief = kalman.no_traffic(s.x), d + d * (d + 1) // 2
        s = s._replace(x=s.x.copy(), P=s.P.copy(), sigma=s.sigma.copy())  # every meeting writes into these
        for sensor, i, j, reading in kalman.pair_readings(s.world, z, air):
            asked = np.asarray(~np.isnan(reading).any(-1))
            answered = asked & air.heard[:, j, i]
            heard = np.where((answered & air.heard[:, i, j])[:, None], reading, np.nan)
            linear = kalman.linearise(sensor, s.x[:, i], s.x[:, j], heard)
            P_ij = s.sigma[:, i, j], s.sigma[:, j, i].mT
            y, H_i, H_j = kalman.soften_pair(sensor, *linear, s.P[:, i], s.P[:, j], *P_ij)
            linear = y.copy(), np.concatenate([H_i, H_j], -1), sensor.R.copy()
            update = update_pair if self.engine == "filterpy" else meet
            used = np.asarray(update(s.x, s.P, s.sigma, i, j, linear, self.gate))
            kalman.count(sent, i, asked, 0)
            kalman.count(sent, j, answered, belief + d * d)
            kalman.count(sent, i, used, belief)
        return s, sent


def update_pair(
    x: Array, P: Array, sigma: Array, i: int, j: int, reading: tuple[Array, Array, Array], gate: float
) -> Mask:
    """Joint update of (x_i, x_j); sigma_ij' = P_ij', sigma_ji' = I; else sigma_ik' = P_i' P_i^-1 sigma_ik.

    In place, by filterpy's filter; `meet` is the same in a compiled loop. Return which trials used it (t,).
    """
    d = x.shape[-1]
    parts = P[:, i].copy(), P[:, j].copy(), sigma[:, i, j] @ sigma[:, j, i].mT
    P_ij = np.stack([limit_correlation(*trial) for trial in zip(*parts, strict=True)])
    before = np.block([[P[:, i], P_ij], [P_ij.mT, P[:, j]]])
    pair, after = kalman.ENGINES["filterpy"].update(np.concatenate([x[:, i], x[:, j]], -1), before, *reading, gate)
    used = np.asarray((after != before).any((1, 2)))
    for robot, at in ((i, slice(0, d)), (j, slice(d, None))):
        sigma[:, robot] = _carry_factors(P[:, robot], after[:, at, at])[:, None] @ sigma[:, robot]
        x[:, robot], P[:, robot] = pair[:, at], after[:, at, at]
    sigma[used, i, j], sigma[used, j, i] = after[used, :d, d:], np.eye(d)
    return used


def _carry_factors(P: Array, P1: Array) -> Array:
    """Return P' P^-1, the identity where nothing changed."""
    same = np.asarray((P == P1).all((-2, -1)))
    return np.where(same[..., None, None], np.eye(P.shape[-1]), np.linalg.solve(P, P1).mT)
