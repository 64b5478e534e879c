"""One extended Kalman filter over the whole team, with every cross-covariance.

The centralised answer: what a team would know if every reading reached one computer at once. A bound, not a protocol.
Plainly linearised ranges make 1 to 2 % of robots diverge, so each relative reading is re-linearised (`iterations`) and
ranges carry the mean shift and variance of their second-order term (`second_order`).

Sources: S. Roumeliotis, G. Bekey, "Distributed multirobot localization", IEEE T-RA 18(5), 2002; Y. Bar-Shalom, X. Li,
T. Kirubarajan, "Estimation with applications to tracking and navigation", 2001, secs. 10.3 (second order) and 10.5.2
(iterated).
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from cooploc.estimators.angles import wrap_heading
from cooploc.estimators.doa import fixed, gradient_doa
from cooploc.estimators.gaussian import ENGINES, GATE, EngineName
from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, Sensor, Traffic, World
from cooploc.estimators.models import Range


class State(NamedTuple):
    """The team's joint Gaussian."""

    x: Array  # (t, n, d)
    P: Array  # (t, n, d, n, d)
    world: World


@dataclass(frozen=True)
class EkfJoint:
    """Centralised EKF over all robots, cross-covariances kept. Plain mode: iterations=1, second_order=False."""

    api: ClassVar[int] = 1
    bound: ClassVar[bool] = True
    own: Literal["doa", "rssi"] = "doa"
    reading: Literal["rssi", "range"] = "range"  # radio reading used where no camera sees teammates
    iterations: int = 3
    second_order: bool = True
    gate: float = GATE
    engine: EngineName = "batched"

    def __post_init__(self) -> None:
        if self.iterations < 1:
            raise ValueError(f"iterations is {self.iterations}; it must be at least 1")

    @property
    def uses(self) -> tuple[str, ...]:
        return ("odometry", "anchor_rssi|landmark", f"sighting|radio_{self.reading}")

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        if self.own == "doa" and "anchor_rssi" in world.sensors:
            gradient_doa(world)
        return State(prior.x, _block_diagonal(prior.P), world)

    def predict(self, s: State, z: Senses) -> State:
        """P_ij' = F_i P_ij F_j',  P_ii' = F_i P_ii F_i' + Q_i."""
        x, F, Q = s.world.motion.move(s.x, z.odometry, z.dt)
        joint = ENGINES[self.engine].predict(
            _flat(x), _square(s.P), _square(_block_diagonal(F)), _square(_block_diagonal(Q))
        )
        return s._replace(x=x, P=joint[1].reshape(s.P.shape))

    def correct(self, s: State, z: Senses) -> State:
        for sensor, place, reading in fixed(s.world, z, self.own):
            for i in range(s.world.robots):
                y, H, _ = sensor.innovation(s.x[:, i], place, reading[:, i])
                s = self._update(s, y, {i: H}, sensor.R)
        return s

    def exchange(self, s: State, z: Senses, air: Mail) -> tuple[State, Traffic]:
        for sensor, j, reading in s.world.relative(z, air):
            for i in range(s.world.robots):
                if i != j and not np.isnan(reading[:, i]).all():
                    s = self._relate(s, sensor, i, j, reading[:, i])
        nothing = np.zeros(s.x.shape[:2])
        return s, Traffic(nothing, nothing)

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.x), np.stack([s.P[:, i, :, i] for i in range(s.x.shape[1])], 1))

    def _relate(self, s: State, sensor: Sensor, i: int, j: int, reading: Array) -> State:
        """Update by robot i's reading of robot j: y + H (x^ - x), re-linearised at the last iterate x^."""
        shift, extra = np.zeros(()), np.zeros((1, 1))
        if self.second_order and isinstance(sensor, Range):
            P = s.P[:, :, :2, :, :2]
            D = P[:, i, :, i] + P[:, j, :, j] - P[:, i, :, j] - P[:, j, :, i]
            shift, extra = sensor.curvature(s.x[:, i], s.x[:, j, :2], D)
        at = s
        for _ in range(self.iterations):
            y, H, Hq = sensor.innovation(at.x[:, i], at.x[:, j, :2], reading)
            H_j = np.concatenate([Hq, np.zeros((*Hq.shape[:-1], s.x.shape[-1] - 2))], -1)
            back = at.x - s.x
            y = y - shift + (H @ back[:, i, :, None] + H_j @ back[:, j, :, None])[..., 0]
            at = self._update(s, y, {i: H, j: H_j}, sensor.R + extra)
        return at

    def _update(self, s: State, y: Array, blocks: dict[int, Array], R: Array) -> State:
        """Kalman update of the joint state by a reading whose Jacobian is `blocks` at those robots, 0 elsewhere."""
        H = np.zeros((*y.shape, *s.x.shape[1:]))
        for i, block in blocks.items():
            H[..., i, :] = block
        H = H.reshape(*y.shape, -1)
        x, P = ENGINES[self.engine].update(_flat(s.x), _square(s.P), y, H, R, self.gate)
        return s._replace(x=x.reshape(s.x.shape), P=P.reshape(s.P.shape))


def _flat(x: Array) -> Array:
    return x.reshape(len(x), -1)


def _square(P: Array) -> Array:
    t, n, d = P.shape[:3]
    return P.reshape(t, n * d, n * d)


def _block_diagonal(blocks: Array) -> Array:
    """(t, n, d, d) on the diagonal of (t, n, d, n, d)."""
    t, n, d, _ = blocks.shape
    P = np.zeros((t, n, d, n, d))
    for i in range(n):
        P[:, i, :, i] = blocks[:, i]
    return P
