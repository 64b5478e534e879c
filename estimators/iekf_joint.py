"""The joint EKF with the right-invariant error of SE(2): no reading between robots says where the whole team faces.

The EKF linearises one tick's readings here and the next one's where these moved the estimate, so that its Jacobians
disagree on the direction in which the whole team turns, and its covariance shrinks there without reason. The error xi
of a pose X = exp(xi) X^ is one vector for all robots when the team turns, of which no reading of a teammate says
anything. With e = (position, heading) - estimate, e = T xi to first order, T = [I, J p^; 0, 1], J the turn by 90
degrees. The state holds P = T P_xi T', as ekf-joint does; then F and H are the EKF's own, and only two things differ
after readings: the estimate moves along the group, and P goes with it. With a compass this is ekf-joint with
iterations=1, second_order=false and lost=1.

Sources: A. Barrau, S. Bonnabel, "The invariant extended Kalman filter as a stable observer", IEEE T-AC 62(4), 2017. For
teams, arXiv 2405.04000 and 2303.01205 (the change of coordinates), known by their abstracts; its form is the group's.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from cooploc.estimators import joint_gaussian as joint
from cooploc.estimators import kalman
from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, Traffic, World
from cooploc.estimators.joint_kernels import LinearReadings, distances
from cooploc.estimators.models import AnchorReading, fixed_readings, wrap_heading
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


class State(NamedTuple):
    """The team's joint Gaussian."""

    x: Array  # (t, n, d)
    P: Array  # (t, n, d, n, d)  of position and heading, T P_xi T'
    world: World


@dataclass(frozen=True)
@kalman.explain
class IekfJoint:
    """Centralised invariant EKF over all robots."""

    api: ClassVar[int] = 1
    bound: ClassVar[bool] = False
    sends: ClassVar[str] = "every reading"
    consistency: ClassVar[str] = "consistent up to linearisation; learns no common heading from teammates"
    centralised: ClassVar[bool] = True
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(kalman.GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    engine: kalman.EngineName = "batched"
    reading: kalman.RadioReading = "range"
    loss: AssumedLoss = "world"

    uses = property(kalman.team_channels)

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        world = kalman.assume(self, world)
        return State(prior.x, joint.block_diagonal(prior.P), world)

    def predict(self, s: State, z: Senses) -> State:
        """P_xi' = P_xi + Ad Q Ad', which is P' = F P F' + Q."""
        x, F, Q = kalman.move(s.world.motion, s.x, z)
        return s._replace(x=x, P=joint.move_blocks(self.engine, joint.square(s.P), F, Q).reshape(s.P.shape))

    def correct(self, s: State, z: Senses) -> State:
        for sensor, place, reading in fixed_readings(s.world, z, self.anchor_reading):
            y, H, _ = kalman.innovation(sensor, s.x, place, reading)
            y, H = kalman.soften(sensor, joint.own_blocks(s.P), y, H)
            s = self._update_together(s, joint.linear_fixed(y, H, sensor.R))
        return s

    def exchange(self, s: State, z: Senses, air: Mail) -> tuple[State, Traffic]:
        for sensor, reading in kalman.reading_tables(s.world, z, air):
            linear = kalman.linearise(sensor, s.x[:, :, None], s.x[:, None], reading)
            y, H_i, H_j = kalman.soften_pair(sensor, *linear, *joint.pair_blocks(s.P))
            s = self._update_together(s, joint.linear_readings(y, H_i, H_j, sensor.R))
        return s, kalman.no_traffic(s.x)

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.x), np.stack([s.P[:, i, :, i] for i in range(s.x.shape[1])], 1))

    def _update_together(self, s: State, readings: LinearReadings) -> State:
        """P' = (P^-1 + H'R^-1 H)^-1,  step = P' H'R^-1 y by all readings that the gate allows, then along the group."""
        use = distances(joint.square(s.P), readings) <= self.gate
        step, P = joint.solve_together(self.engine, joint.square(s.P), use, readings)
        return _along_group(s, step.reshape(s.x.shape), P.reshape(s.P.shape))


def _along_group(s: State, step: Array, P: Array) -> State:
    """X' = exp(xi) X^ with xi = T^-1 step:  p' = p + V(a) step_p, a the step's heading;  P' = B P B', B = T(x') T^-1.

    V(a) = [sin a, cos a - 1; 1 - cos a, sin a] / a,  B = [I, J (p' - p); 0, 1].
    """
    if s.x.shape[-1] == 2:
        return s._replace(x=s.x + step, P=P)
    a, (east, north) = step[..., 2], np.moveaxis(step[..., :2], -1, 0)
    along, across = np.sinc(a / np.pi), np.sinc(a / (2 * np.pi)) * np.sin(a / 2)  # sin a / a, (1 - cos a) / a
    moved = np.stack([along * east - across * north, across * east + along * north], -1)
    turned = np.stack([-moved[..., 1], moved[..., 0]], -1)  # J (p' - p), (t, n, 2)
    P = P.copy()
    P[:, :, :2] += turned[:, :, :, None, None] * P[:, :, 2:]
    P[..., :2] += turned[:, None, None] * P[..., 2:]
    P = (P + P.transpose(0, 3, 4, 1, 2)) / 2
    return s._replace(x=s.x + np.concatenate([moved, a[..., None]], -1), P=P)
