"""The joint EKF in pieces: every robot keeps its own mean and covariance, and cross terms as factors that do not move.

P_ij = Phi_i Pi_ij Phi_j', where Phi_i gathers robot i's own motion and Pi_ij is constant between readings. The robot
that takes a reading is the interim master: it requests the belief of the robot it measured and broadcasts what all
others need to update; each keeps its own copy of all Pi. While no message is lost this is the joint EKF, one reading
after the other; a robot that misses an update keeps stale cross terms.

Sent, in numbers of 8 bytes and with a header of 8: request 0; reply x, P, Phi, d + d(d+1)/2 + d^2; update of k readings
of a teammate 2 + k (1 + 4 d), of a fixed thing 1 + k (1 + 2 d), once, to all. If the link fails in either direction,
the reading is lost. Ours: a gate; and a robot refuses an update that would make its covariance indefinite or whose
factors have diverged (`RUNAWAY`).

Source: S. Kia, S. Rounds, S. Martinez, "Cooperative localization for mobile agents: a recursive decentralized algorithm
based on Kalman-filter decoupling", IEEE Control Systems Magazine 36(2), 2016, the interim-master algorithm.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations
from typing import ClassVar, NamedTuple

import numpy as np

from cooploc.estimators import kalman
from cooploc.estimators.compiled import readable
from cooploc.estimators.interface import HEADER, Array, Belief, Indices, Mail, Mask, Rows, Senses, Traffic, World
from cooploc.estimators.joint_gaussian import block_diagonal, definite, dense, square
from cooploc.estimators.joint_kernels import RUNAWAY, master, sight_decoupled
from cooploc.estimators.models import AnchorReading, fixed_readings
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


class State(NamedTuple):
    """The memory of the robots; axis 1 is the robot that keeps it."""

    x: Array  # (t, n, d)
    P: Array  # (t, n, d, d)
    Phi: Array  # (t, n, d, d)
    Pi: Array  # (t, n, n, d, n, d)  copies of every Pi_jl = Pi_lj'; the diagonal is not used
    copy: Indices  # (t, n)  which of these a robot has: one as long as all heard the same, in the end each its own
    world: World


@dataclass(frozen=True)
@kalman.explain
class EkfInterim:
    """Decentralised joint EKF, exact while no message is lost."""

    api: ClassVar[int] = 1
    bound: ClassVar[bool] = False
    sends: ClassVar[str] = "belief on request, updates to all"
    consistency: ClassVar[str] = "that of `ekf-joint` until the first message is lost"
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
        Pi, copy = np.zeros((t, n, n, d, n, d)), np.zeros((t, n), np.int64)
        return State(prior.x, prior.P, np.zeros_like(prior.P) + np.eye(d), Pi, copy, world)

    def predict(self, s: State, z: Senses) -> State:
        """P_i' = F_i P_i F_i' + Q_i,  Phi_i' = F_i Phi_i,  Pi' = Pi."""
        x, P, F = kalman.predict_ekf(self, s.world, s.x, s.P, z)
        return s._replace(x=x, P=P, Phi=F @ s.Phi)

    def correct(self, s: State, z: Senses) -> State:
        """Leave all as it is: readings of fixed things update the whole team, which takes messages: see `exchange`."""
        return s

    def exchange(self, s: State, z: Senses, air: Mail) -> tuple[State, Traffic]:
        """Use readings of fixed things, then of teammates, one after the other, each with its own messages."""
        trials, d = np.arange(len(s.x)), s.x.shape[-1]
        sent = kalman.no_traffic(s.x)
        s = s._replace(x=s.x.copy(), P=s.P.copy(), Pi=s.Pi.copy(), copy=s.copy.copy())  # all are written into
        if seen := kalman.landmarks_alone(self, s.world, z):
            made = np.zeros(s.x.shape[:2])
            sight_decoupled(s[:5], seen, readable(air.heard), made)
            made = made * (s.world.robots > 1)
            sent = Traffic(made, made * (8.0 * (1 + 2 * (1 + 2 * d)) + HEADER))
        for sensor, place, reading in () if seen else fixed_readings(s.world, z, self.anchor_reading):
            for a in np.flatnonzero(~np.isnan(reading).all((0, 2))).tolist():
                y, H, _ = kalman.innovation(sensor, s.x[:, a], place, reading[:, a])
                y, H = kalman.soften(sensor, s.P[:, a], y, H)
                used = self._master(s, a, y, {a: H}, sensor.R, air.heard[:, :, a])
                kalman.count(sent, a, used & (s.world.robots > 1), 1 + y.shape[-1] * (1 + 2 * d))
        for sensor, a, b, reading in kalman.pair_readings(s.world, z, air):
            asked, answered = np.asarray(~np.isnan(reading).any(-1)), air.heard[:, b, a]
            linear = kalman.linearise(sensor, s.x[:, a], s.x[:, b], reading)
            P_ab = s.Phi[:, a], s.Pi[trials, s.copy[:, a], a, :, b], s.Phi[:, b].mT
            y, H_a, H_b = kalman.soften_pair(sensor, *linear, s.P[:, a], s.P[:, b], *P_ab)
            y = np.where((answered & air.heard[:, a, b])[:, None], y, np.nan)
            used = self._master(s, a, y, {a: H_a, b: H_b}, sensor.R, air.heard[:, :, a])
            kalman.count(sent, a, asked, 0)
            kalman.count(sent, b, asked & answered, d + d * (d + 1) // 2 + d * d)
            kalman.count(sent, a, used, 2 + y.shape[-1] * (1 + 4 * d))
        return s, sent

    def _master(self, s: State, a: int, y: Array, at: Mapping[int, Array], R: Array, heard: Mask) -> Mask:
        """Update master a's memory, and that of robots that `heard` it (t, n), by a reading with Jacobians `at` robots.

        S = R + H P H'; then x_i' = x_i + dx_i,  P_i' = P_i - dP_i,  Pi' = Pi - dPi, in place. Return which trials used
        it (t,).
        """
        if self.engine == "filterpy":
            return _update_by_filterpy(s, a, y, at, R, heard, self.gate)
        reading = y.copy(), np.ascontiguousarray(np.stack(list(at.values()), 1)), R
        used: Mask = master(s[:5], a, np.array(list(at)), reading, heard.copy(), self.gate)
        return used


def _update_by_filterpy(
    s: State, a: int, y: Array, at: Mapping[int, Array], R: Array, heard: Mask, gate: float
) -> Mask:
    """`master` by filterpy's filter over each robot's copy of the team, P_jl = Phi_j Pi_jl Phi_l'."""
    t, n, d = s.x.shape
    s.Pi[:], s.copy[:] = s.Pi[np.arange(t)[:, None], s.copy], np.arange(n)
    Pi, Phi = s.Pi.copy(), square(block_diagonal(s.Phi))[:, None]
    for m, j in permutations(at, 2):  # as the master broadcast them
        Pi[:, :, m, :, j] = s.Pi[:, None, a, m, :, j]
    P = Phi @ Pi.reshape(t, n, n * d, n * d) @ Phi.mT
    for j in range(n):
        P[:, :, j * d : j * d + d, j * d : j * d + d] = s.P[:, None, j]
    H, use = dense(at, n), kalman.is_present(y, dense(at, n), np.broadcast_to(R, (*y.shape, y.shape[-1])))
    S = np.where(use[:, None, None], kalman.symmetric(H @ P[:, a] @ H.mT + R), np.eye(y.shape[-1]))
    use &= definite(S)
    use &= kalman.distance(np.where(use[:, None], y, 0.0), np.where(use[:, None, None], S, np.eye(y.shape[-1]))) <= gate
    y, H = np.where(use[:, None], y, 0.0), np.where(use[:, None, None], H, 0.0)
    y, H = (np.repeat(part[:, None], n, 1) for part in (y, H))
    dx, P1 = kalman.ENGINES["filterpy"].update(np.zeros((t, n, n * d)), P, y, H, R, np.inf)
    inverse = np.linalg.inv(Phi)
    dPi = (inverse @ (P - P1) @ inverse.mT).reshape(s.Pi.shape)
    dx, dP = np.einsum("tiia->tia", dx.reshape(t, n, n, d)), np.einsum("tiiaib->tiab", (P - P1).reshape(s.Pi.shape))
    sound = definite(s.P - dP) & (np.einsum("tijaja->tija", dPi) < RUNAWAY**2).all((2, 3))
    use &= np.stack([sound[:, m] for m in at]).all(0)
    takes = use[:, None] & sound & (heard | (np.arange(n) == a))
    np.subtract(s.Pi, dPi, out=s.Pi, where=takes[(..., *[None] * 4)])
    s.x[:] += np.where(takes[..., None], dx, 0.0)
    s.P[:] -= np.where(takes[..., None, None], dP, 0.0)
    return use
