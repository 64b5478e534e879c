"""The joint EKF in pieces: every robot keeps its own mean and covariance, and cross terms as factors that do not move.

Between readings P_ij = Phi_i Pi_ij Phi_j', where Phi_i gathers robot i's own motion and Pi_ij stands still, so nothing
need be said. Whoever takes a reading is the interim master: it asks the robot that it measured for its belief, and
broadcasts what everybody needs to update; each keeps its own copy of all Pi. While no message is lost this is the joint
EKF, reading after reading. It has no remedy for loss: a robot that misses one update goes on with stale cross terms.

Sent, in numbers of 8 bytes and with a header of 8: request 0; reply x, P, Phi, d + d(d+1)/2 + d^2; update of k readings
of a teammate 2 + k (1 + 4 d), of a fixed thing 1 + k (1 + 2 d), once, to all. Where either way between the two fails,
the reading is lost. Ours: a gate; and a robot refuses an update that would make its covariance indefinite or whose
factors have run away (`RUNAWAY`), which happens after losses only.

Source: S. Kia, S. Rounds, S. Martinez, "Cooperative localization for mobile agents: a recursive decentralized algorithm
based on Kalman-filter decoupling", IEEE Control Systems Magazine 36(2), 2016, the interim-master algorithm.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numba
import numpy as np

from cooploc.estimators.angles import wrap_heading
from cooploc.estimators.doa import fixed, gradient_doa
from cooploc.estimators.gaussian import GATE, distance, present, symmetric
from cooploc.estimators.interface import Array, Belief, Mail, Mask, Rows, Senses, Traffic, World
from cooploc.estimators.relative import HEADER, linearise, pairs

At = Mapping[int, Array]  # a Jacobian (t, k, d) by robot
RUNAWAY = 1e6  # a factor Gamma beyond this is no covariance of anything in metres; keeps stale copies finite


class State(NamedTuple):
    """What the robots remember; axis 1 is whose memory it is."""

    x: Array  # (t, n, d)
    P: Array  # (t, n, d, d)
    Phi: Array  # (t, n, d, d)
    Pi: Array  # (t, n, n, n, d, d)  each robot's copy of every Pi_jl; the diagonal is not used
    world: World


@dataclass(frozen=True)
class EkfInterim:
    """Decentralised joint EKF, exact while no message is lost."""

    api: ClassVar[int] = 1
    bound: ClassVar[bool] = False
    own: Literal["doa", "rssi"] = "doa"
    reading: Literal["rssi", "range"] = "range"  # radio reading used where no camera sees teammates
    gate: float = GATE

    @property
    def uses(self) -> tuple[str, ...]:
        return ("odometry", "anchor_rssi|landmark", f"sighting|radio_{self.reading}")

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        if self.own == "doa" and "anchor_rssi" in world.sensors:
            gradient_doa(world)
        t, n, d = prior.x.shape
        return State(prior.x, prior.P, np.zeros_like(prior.P) + np.eye(d), np.zeros((t, n, n, n, d, d)), world)

    def predict(self, s: State, z: Senses) -> State:
        """P_i' = F_i P_i F_i' + Q_i,  Phi_i' = F_i Phi_i,  Pi' = Pi."""
        x, F, Q = s.world.motion.move(s.x, z.odometry, z.dt)
        return s._replace(x=x, P=symmetric(F @ s.P @ F.mT + Q), Phi=F @ s.Phi)

    def correct(self, s: State, z: Senses) -> State:
        """Nothing yet: readings of fixed things move the whole team, so they need the air, too."""
        return s

    def exchange(self, s: State, z: Senses, air: Mail) -> tuple[State, Traffic]:
        """Readings of fixed things, then of teammates, one after the other, each with its own messages."""
        d, s = s.x.shape[-1], s._replace(Pi=s.Pi.copy())
        messages, sent = np.zeros(s.x.shape[:2]), np.zeros(s.x.shape[:2])

        def say(robot: int, when: Mask, numbers: int) -> None:
            messages[:, robot] += when
            sent[:, robot] += when * (8.0 * numbers + HEADER)

        for sensor, place, reading in fixed(s.world, z, self.own):
            for a in range(s.world.robots):
                y, H, _ = sensor.innovation(s.x[:, a], place, reading[:, a])
                s, used = self._master(s, a, y, {a: H}, sensor.R, air.heard[:, :, a])
                say(a, used & (s.world.robots > 1), 1 + y.shape[-1] * (1 + 2 * d))
        for sensor, a, b, reading in pairs(s.world, z, air):
            asked, answered = np.asarray(~np.isnan(reading).any(-1)), air.heard[:, b, a]
            y, H_a, H_b = linearise(sensor, s.x[:, a], s.x[:, b], reading)
            y = np.where((answered & air.heard[:, a, b])[:, None], y, np.nan)
            s, used = self._master(s, a, y, {a: H_a, b: H_b}, sensor.R, air.heard[:, :, a])
            say(a, asked, 0)
            say(b, asked & answered, d + d * (d + 1) // 2 + d * d)
            say(a, used, 2 + y.shape[-1] * (1 + 4 * d))
        return s, Traffic(messages, sent)

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.x), s.P)

    def _master(self, s: State, a: int, y: Array, at: Mapping[int, Array], R: Array, heard: Mask) -> tuple[State, Mask]:
        """Master a's update, in its memory and in that of those who `heard` it (t, n); which trials used it (t,).

        S = R + H P H' over the robots that it is `at`,  r = S^-1/2 y,  Gamma_m = (Phi_m^-1 P_m H_m' + ..) S^-1/2, then
        x_i' = x_i + Phi_i Gamma_i r,  P_i' = P_i - Phi_i Gamma_i Gamma_i' Phi_i',  Pi_jl' = Pi_jl - Gamma_j Gamma_l'.
        """
        PH = {m: self._cross(s, a, m, at) for m in at}
        S = symmetric(np.asarray(R + sum(H @ PH[m] for m, H in at.items())))
        use = np.asarray(np.stack([present(y, H, S) for H in at.values()]).all(0))
        use &= np.linalg.eigvalsh(np.where(use[:, None, None], S, np.eye(y.shape[-1])))[:, 0] > 0
        S, y = np.where(use[:, None, None], S, np.eye(y.shape[-1])), np.where(use[:, None], y, 0.0)
        use &= distance(y, S) <= self.gate
        half = np.linalg.inv(np.linalg.cholesky(S)).mT
        V = {m: np.where(use[:, None, None], s.Phi[:, m].mT @ H.mT @ half, 0.0) for m, H in at.items()}
        Gamma = np.asarray(sum(s.Pi[:, :, :, m] @ v[:, None, None] for m, v in V.items()))  # (t, n, n, d, k)
        for m, ph in PH.items():
            Gamma[:, :, m] = np.linalg.solve(s.Phi[:, m], np.where(use[:, None, None], ph @ half, 0.0))[:, None]
        mine = s.Phi @ np.einsum("tiiak->tiak", Gamma)  # (t, n, d, k)
        sound = np.linalg.eigvalsh(symmetric(mine.mT @ np.linalg.solve(s.P, mine)))[..., -1] < 1
        sound &= (np.abs(Gamma) < RUNAWAY).all((2, 3, 4))
        use &= np.stack([sound[:, m] for m in at]).all(0)
        takes = use[:, None] & sound & (heard | (np.arange(s.world.robots) == a))
        r = half.mT @ y[..., None]
        mine = np.where(takes[..., None, None], mine, 0.0)
        _downdate(s.Pi, Gamma, takes)
        return s._replace(x=s.x + (mine @ r[:, None])[..., 0], P=symmetric(s.P - mine @ mine.mT)), use

    @staticmethod
    def _cross(s: State, a: int, m: int, at: At) -> Array:
        """Cov(x_m, reading) = sum_j P_mj H_j' (t, d, k), by master a's copy of Pi."""
        blocks = {j: s.P[:, m] if j == m else s.Phi[:, m] @ s.Pi[:, a, m, j] @ s.Phi[:, j].mT for j in at}
        return np.asarray(sum(block @ at[j].mT for j, block in blocks.items()))


def _downdated(Pi: Array, Gamma: Array, takes: Mask) -> None:
    """Pi_jl -= Gamma_j Gamma_l' in the memory of whoever takes the update."""
    t, n, _, d, k = Gamma.shape
    for s in range(t):
        for i in range(n):
            if takes[s, i]:
                for j in range(n):
                    for m in range(n):
                        if j != m:
                            for a in range(d):
                                for b in range(d):
                                    for c in range(k):
                                        Pi[s, i, j, m, a, b] -= Gamma[s, i, j, a, c] * Gamma[s, i, m, b, c]


_downdate = numba.njit(cache=True, error_model="numpy")(_downdated)
