"""Global-state covariance intersection: every robot estimates where the whole team is, and intersects it with others'.

State of robot i: the positions of all n robots, and its own heading where it has one. It moves its own pose by odometry
and lets all other positions drift; its own readings update the state by an EKF. Each robot broadcasts the positions
with their covariance, and a robot that hears it fuses them by covariance intersection with a fixed weight c of its own:

    P'^-1 = c P^-1 + (1 - c) P_j^-1,  x' = P' (c P^-1 x + (1 - c) P_j^-1 x_j).

No correlation can make the result over-confident, if the drift is at least the motion. Sent, in one broadcast a tick:
2 n + n (2 n + 1) numbers of 8 bytes, before the tick's radio readings are used.

Ours: CoLo takes headings from the truth, here each robot estimates its own; no robot knows where others start; the
drift's variance grows with time, not with its square; a gate; `period`.

Source: T.-K. Chang, K. Chen, A. Mehta, "Resilient and consistent multirobot cooperative localization with covariance
intersection", IEEE T-RO 38(1), 2022, and GS_CI in the authors' repository tsangkai/multirobot_localization.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from cooploc.estimators import kalman
from cooploc.estimators.errors import Limits
from cooploc.estimators.interface import Array, Belief, Indices, Mail, Mask, Rows, Senses, Sensor, World
from cooploc.estimators.models import AnchorReading, fixed_readings, wrap_heading
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


class State(NamedTuple):
    """The memory of one robot; D = 2 n, and one more where it has a heading."""

    x: Array  # (r, D)  x, y [m] of robot 0, of robot 1, ...; its own heading [rad]
    P: Array  # (r, D, D)
    own: Indices  # (r, d)  where its own pose is in x
    world: World
    silent: Array  # (r,)  time since it last sent [s]


@dataclass(frozen=True)
@kalman.explain
class EkfGsCi:
    """EKF of the whole team's positions on each robot, covariance intersection of what the robots broadcast.

    Parameters:
        weight: of a robot's own estimate in an intersection, from 0.01 to 1; 1 ignores what is received. The default is
            that of the authors' code.
        drift: standard deviation [m] per axis of how far a teammate moves in a second; the variance grows with time.
        period: least time [s] between two broadcasts. Each intersection shrinks its own knowledge by `weight`, so
            that four teammates heard ten times a second leave nothing of it; 0 sends in every tick.
    """

    api: ClassVar[int] = 1
    limits: ClassVar[Limits] = {"weight": (0.01, 1), "drift": (0, np.inf), "period": (0, np.inf)}
    sends: ClassVar[str] = "mean and covariance of the whole team"
    consistency: ClassVar[str] = "conservative, if `drift` is at least the motion"
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(kalman.GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    engine: kalman.EngineName = "batched"
    reading: kalman.RadioReading = "range"
    weight: float = 0.8
    drift: float = 0.5
    period: float = 0.0
    loss: AssumedLoss = "world"

    uses = property(kalman.team_channels)

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        """Start from the own prior; teammates are anywhere in the arena, until one of them is heard."""
        world = kalman.assume(self, world)
        r, d, n = *prior.x.shape, world.robots
        own = np.concatenate([2 * rows.robot[:, None] + [0, 1], np.full((r, d - 2), 2 * n)], 1)
        x = np.broadcast_to(np.tile(world.arena.mean(0), n + 1)[: 2 * n + d - 2], (r, 2 * n + d - 2)).copy()
        P = np.broadcast_to(np.diag(np.tile(_anywhere(world), n + 1)[: x.shape[1]]), (*x.shape, x.shape[1])).copy()
        s = State(x, P, own, world, np.full(r, np.inf))
        x[_pose_of(s)] = prior.x
        P[_block_of(s)] = prior.P
        return s

    def predict(self, s: State, z: Senses) -> State:
        """x_i' = f(x_i, u),  P' = F P F' + Q,  where all other positions have F = I and Q = drift^2 dt I."""
        pose, F_i, Q_i = kalman.move(s.world.motion, s.x[_pose_of(s)], z)
        drifts = np.diag((np.arange(s.x.shape[1]) < 2 * s.world.robots) * self.drift**2)
        x, F, Q = s.x.copy(), np.zeros_like(s.P) + np.eye(s.x.shape[1]), z.dt[:, None, None] * drifts
        x[_pose_of(s)], F[_block_of(s)], Q[_block_of(s)] = pose, F_i, Q_i
        return s._replace(x=x, P=kalman.ENGINES[self.engine].predict(s.P, F, Q), silent=s.silent + z.dt)

    def correct(self, s: State, z: Senses) -> State:
        for sensor, place, reading in fixed_readings(s.world, z, self.anchor_reading):
            y, H, _ = kalman.innovation(sensor, s.x[_pose_of(s)], place, reading)
            s = self._update(s, y, _widen(s, H), sensor)
        return s

    def send(self, s: State, z: Senses) -> Array:
        """Return the positions, and the upper triangle of their covariance."""
        m = 2 * s.world.robots
        packet = kalman.Message(s.x[:, :m], (s.P[:, :m, :m],), z.sighting[:, :0]).pack()
        return np.where(self._is_due(s)[:, None], packet, np.nan)

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        """Intersect with all that was heard; then use the readings of teammates, by then no longer anywhere."""
        s = self._intersect(s, kalman.Message.unpack(mail.packets, 2 * s.world.robots))
        s = s._replace(silent=np.where(self._is_due(s), 0.0, s.silent))
        for sensor, j, reading in s.world.relative(z, mail):
            there = slice(2 * j, 2 * j + 2)
            known = np.diagonal(s.P[:, there, there], axis1=1, axis2=2).sum(-1) < _anywhere(s.world).sum() / 2
            y, H, H_j = kalman.innovation(
                sensor, s.x[_pose_of(s)], s.x[:, there], np.where(known[:, None], reading, np.nan)
            )
            H = _widen(s, H)
            H[:, :, there] += H_j
            s = self._update(s, y, H, sensor)
        return s

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.x[_pose_of(s)]), s.P[_block_of(s)])

    def _is_due(self, s: State) -> Mask:
        return s.silent > self.period - 1e-6

    def _update(self, s: State, y: Array, H: Array, sensor: Sensor) -> State:
        y, H = kalman.soften(sensor, s.P, y, H)
        x, P = kalman.ENGINES[self.engine].update(s.x, s.P, y, H, sensor.R, self.gate)
        return s._replace(x=x, P=P)

    def _intersect(self, s: State, sent: kalman.Message) -> State:
        """Intersect with all that was heard, one after the other; a heading follows by its covariance."""
        m = sent.x.shape[-1]
        heard = np.asarray(~np.isnan(sent.x).any(-1))
        use, c = np.flatnonzero(heard.any(1)), self.weight
        x, P, mine = s.x.copy(), s.P.copy(), s.x[use, :m]
        Y = np.linalg.inv(P[use, :m, :m])
        y = np.zeros_like(mine)  # Y (x' - x)
        for j in range(s.world.robots):
            rows = heard[use, j]
            Y_j = np.linalg.inv(sent.P[0][use[rows], j])
            news = (Y_j @ (sent.x[use[rows], j] - mine[rows])[..., None])[..., 0]
            Y[rows], y[rows] = c * Y[rows] + (1 - c) * Y_j, c * y[rows] + (1 - c) * news
        C, H = kalman.symmetric(np.linalg.inv(Y)), np.zeros((len(use), m, x.shape[1])) + np.eye(m, x.shape[1])
        x[use], P[use] = kalman.condition(x[use], P[use], H, (C @ y[..., None])[..., 0], C)
        return s._replace(x=x, P=P)


def _pose_of(s: State) -> tuple[Indices, Indices]:
    """Return the index of each robot's own pose (r, d) in x."""
    return np.arange(len(s.own))[:, None], s.own


def _block_of(s: State) -> tuple[Indices, Indices, Indices]:
    """Return the index of that pose's covariance (r, d, d) in P."""
    return np.arange(len(s.own))[:, None, None], s.own[:, :, None], s.own[:, None]


def _widen(s: State, H: Array) -> Array:
    """Return a Jacobian (r, k, d) by a robot's own pose as one by its whole state (r, k, D)."""
    whole = np.zeros((*H.shape[:2], s.x.shape[1]))
    np.put_along_axis(whole, np.broadcast_to(s.own[:, None], H.shape), H, 2)
    return whole


def _anywhere(world: World) -> Array:
    """Return the variances (2,) [m^2] of a place anywhere in the arena."""
    return np.asarray((world.arena[1] - world.arena[0]) ** 2 / 12)
