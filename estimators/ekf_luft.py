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
from cooploc.estimators.joint_kernels import LIMIT, meet


class State(NamedTuple):
    """The memory of the robots; axis 1 is the robot that keeps it."""

    x: Array  # (t, n, d)
    P: Array  # (t, n, d, d)
    sigma: Array  # (t, n, n, d, d)  sigma_ij; the diagonal is not used
    world: World


@kalman.explain
@dataclass(frozen=True)
class EkfLuft(kalman.TeamParameters):
    """Decentralised EKF with pairwise communication and factored cross terms."""

    sends: ClassVar[str] = "belief and cross factor, on request"
    consistency: ClassVar[str] = "approximate: correlations with third robots are guessed"

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
            used = self._meet(s, i, j, *kalman.linearise(sensor, s.x[:, i], s.x[:, j], heard), sensor.R)
            kalman.count(sent, i, asked, 0)
            kalman.count(sent, j, answered, belief + d * d)
            kalman.count(sent, i, used, belief)
        return s, sent

    def _meet(self, s: State, i: int, j: int, y: Array, H_i: Array, H_j: Array, R: Array) -> Mask:
        """Update robots i and j in place by i's reading of j; return which trials used it (t,)."""
        if self.engine == "filterpy":
            return update_pair(s, i, j, y, H_i, H_j, R, self.gate, kalman.ENGINES["filterpy"].update)
        reading = tuple(map(np.ascontiguousarray, (y, np.concatenate([H_i, H_j], -1), R)))
        return np.asarray(meet(s.x, s.P, s.sigma, i, j, reading, self.gate))


def update_pair(
    s: State, i: int, j: int, y: Array, H_i: Array, H_j: Array, R: Array, gate: float, update: kalman.Update
) -> Mask:
    """Joint update of (x_i, x_j); sigma_ij' = P_ij', sigma_ji' = I; else sigma_ik' = P_i' P_i^-1 sigma_ik.

    In place; `meet` is the same in a compiled loop. Return which trials used it (t,).
    """
    d = s.x.shape[-1]
    P_ij = _possible(s.P[:, i], s.P[:, j], s.sigma[:, i, j] @ s.sigma[:, j, i].mT)
    P = np.block([[s.P[:, i], P_ij], [P_ij.mT, s.P[:, j]]])
    pair, P1 = update(np.concatenate([s.x[:, i], s.x[:, j]], -1), P, y, np.concatenate([H_i, H_j], -1), R, gate)
    used = np.asarray((P1 != P).any((1, 2)))
    for robot, at in ((i, slice(0, d)), (j, slice(d, None))):
        s.sigma[:, robot] = _carry_factors(s.P[:, robot], P1[:, at, at])[:, None] @ s.sigma[:, robot]
        s.x[:, robot], s.P[:, robot] = pair[:, at], P1[:, at, at]
    s.sigma[used, i, j], s.sigma[used, j, i] = P1[used, :d, d:], np.eye(d)
    return used


def _carry_factors(P: Array, P1: Array) -> Array:
    """Return P' P^-1, the identity where nothing changed."""
    same = np.asarray((P == P1).all((-2, -1)))
    return np.where(same[..., None, None], np.eye(P.shape[-1]), np.linalg.solve(P, P1).mT)


def _possible(A: Array, B: Array, C: Array) -> Array:
    """Return the cross term C (t, d, d) of covariances A and B, its canonical correlations cut to `LIMIT`."""
    a, b = np.linalg.cholesky(A), np.linalg.cholesky(B)
    u, correlation, v = np.linalg.svd(np.linalg.solve(a, np.linalg.solve(b, C.mT).mT))
    cut = a @ (u * np.minimum(correlation, LIMIT)[..., None, :]) @ v @ b.mT
    beyond = np.asarray((correlation > LIMIT).any(-1))
    return np.where(beyond[..., None, None], cut, C)
