"""One extended Kalman filter over the whole team, with every cross-covariance: the centralised answer.

A tick's relative readings are used together, in information form, and re-linearised `iterations` times;
`update="sequential"` uses one after the other, as the source does. `second_order` includes the mean shift and the
variance of a range's second-order term. With `update="batch"`, a robot most of whose recent readings the gate has
refused (`lost`) starts again: anywhere in the arena, uncorrelated.

Sources: S. Roumeliotis, G. Bekey, "Distributed multirobot localization", IEEE T-RA 18(5), 2002; Y. Bar-Shalom, X. Li,
T. Kirubarajan, "Estimation with applications to tracking and navigation", 2001, secs. 10.3 (second order) and 10.5.2
(iterated); S. Lenser, M. Veloso, "Sensor resetting localization for poorly modelled mobile robots", ICRA 2000 (starting
again); R. Madhavan, K. Fregene, L. Parker, "Distributed cooperative outdoor multirobot localization and mapping",
Autonomous Robots 17, 2004 (robots without odometry, known by its abstract).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import permutations
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from cooploc.estimators import joint_gaussian as joint
from cooploc.estimators import joint_kernels, kalman, models
from cooploc.estimators.compiled import readable
from cooploc.estimators.errors import BadInput, Limits
from cooploc.estimators.interface import Array, Belief, Mail, Mask, Rows, Senses, Sensor, Traffic, World
from cooploc.estimators.kalman_kernels import add_directions, add_ranges, add_scalars
from cooploc.estimators.models import AnchorReading, Range, fixed_readings, wrap_heading
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable

FORGET = 0.03  # weight of the latest readings in the average share of refused ones: 23 refused in a row make 0.5


class State(NamedTuple):
    """The team's joint Gaussian."""

    x: Array  # (t, n, d)
    P: Array  # (t, n, d, n, d)
    world: World
    refused: Array  # (t, n)  average share of each robot's readings that the gate refused; with update="batch"


@dataclass(frozen=True)
@kalman.explain
class EkfJoint:
    """Centralised EKF over all robots. Plain mode: iterations=1, second_order=False, update="sequential".

    The plain mode errs less on MRCLAM's set 6 where no robot sees a landmark (reports/real-robots.md).

    Parameters:
        iterations: how often a tick's relative readings are linearised; below 1 raises ValueError.
        second_order: whether the mean shift and the variance of a range's second-order term are taken into account.
        update: "batch", a tick's readings together, or "sequential", one by one.
        lost: average share of refused readings beyond which a robot starts again; 1: never. With update="batch" only.
        sighting: what is used of a camera's sighting of a teammate: "both" its range [m] and bearing [rad], "range",
            "bearing", or "none"; with "none" no radio reading of teammates is used either.
        orientation: whether readings of a teammate's heading relative to the own are used, in worlds that have them.
        absent_odometry: what a robot does that has no reading of odometry: it stands "still", or it moves at "random".
        speed: standard deviation of a random velocity along each axis [m/s].
        turn_rate: standard deviation of a random turn rate [rad/s].
        hold: how long a random velocity lasts before another one [s].
    """

    api: ClassVar[int] = 1
    limits: ClassVar[Limits] = {
        **{"iterations": (1, 1000), "lost": (0, 1)},
        **{"speed": (0, 1000), "turn_rate": (0, 1000), "hold": (0, 1000)},
    }
    bound: ClassVar[bool] = False
    sends: ClassVar[str] = "every reading"
    consistency: ClassVar[str] = "consistent up to linearisation"
    centralised: ClassVar[bool] = True
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(kalman.GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    engine: kalman.EngineName = "batched"
    reading: kalman.RadioReading = "range"
    sighting: Literal["both", "range", "bearing", "none"] = "both"
    orientation: bool = False
    absent_odometry: Literal["still", "random"] = "still"
    speed: float = 0.5
    turn_rate: float = 0.5
    hold: float = 2.0
    iterations: int = tunable(3, 1, 5)
    second_order: bool = tunable(True, choices=(True, False))
    update: Literal["batch", "sequential"] = tunable("batch", choices=("batch", "sequential"))
    lost: float = tunable(0.5, 0.1, 1.0)
    loss: AssumedLoss = "world"

    @property
    def uses(self) -> tuple[str, ...]:
        """Return the channels, in order of preference."""
        used = kalman.team_channels(self)[: -1 if self.sighting == "none" else None]
        return (*used, "orientation") if self.orientation else used

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        world = kalman.assume(self, world)
        return State(prior.x, joint.block_diagonal(prior.P), world, np.zeros(prior.x.shape[:2]))

    def predict(self, s: State, z: Senses) -> State:
        """P_ij' = F_i P_ij F_j',  P_ii' = F_i P_ii F_i' + Q_i.

        A random move has x' = x, F = I, Q = diag(speed^2, speed^2, turn_rate^2) hold dt, as the steps of a random walk.
        """
        x, F, Q = kalman.move(s.world.motion, s.x, z)
        if self.absent_odometry == "random":
            blind = np.asarray(np.isnan(z.odometry).any(-1))[..., None, None]
            anyhow = np.diag([self.speed**2, self.speed**2, self.turn_rate**2][: x.shape[-1]])
            Q = np.where(blind, anyhow * self.hold * z.dt[..., None, None], Q)
        if self.engine == "batched" and isinstance(s.world.motion, models.Displacement):
            P = s.P.copy()  # F = I
            np.einsum("tiaib->tiab", P)[...] += Q
            return s._replace(x=x, P=P)
        return _set_belief(s, x, joint.move_blocks(self.engine, joint.square(s.P), F, Q))

    def correct(self, s: State, z: Senses) -> State:
        if self.update == "batch" and (seen := kalman.landmarks_alone(self, s.world, z)):
            x, P, refused = s.x.copy(), joint.square(s.P.copy()), s.refused.copy()
            joint_kernels.sight_joint(x, P, refused, seen, FORGET)
            return _set_belief(s, x, P)._replace(refused=refused)
        for sensor, place, reading in fixed_readings(s.world, z, self.anchor_reading):
            if self.update == "batch":
                s = self._update_by_fixed(s, sensor, place, reading)
            elif self.engine == "batched" and isinstance(sensor, models.GradientDoa) and sensor.loss == "none":
                x, P = s.x.copy(), joint.square(s.P.copy())
                weights, slope = sensor.gradient(np.eye(4)), float(5 * sensor.rssi.eta / np.log(10))
                add_directions(x, P, reading[..., 0], sensor.anchors, weights, slope, sensor.R.item(), self.gate)
                s = _set_belief(s, x, P)
            else:
                for i in np.flatnonzero(~np.isnan(reading).all((0, 2))).tolist():
                    y, H, _ = kalman.innovation(sensor, s.x[:, i], place, reading[:, i])
                    y, H = kalman.soften(sensor, s.P[:, i, :, i], y, H)
                    s = self._update(s, y, {i: H}, sensor.R)
        return s

    def exchange(self, s: State, z: Senses, air: Mail) -> tuple[State, Traffic]:
        if self.update == "batch":
            for sensor, readings in self._team_readings(s.world, z, air):
                s = self._update_together(s, sensor, readings)
            s = self._restart(s)
        else:
            s = self._one_by_one(s, z, air)
        return s, kalman.no_traffic(s.x)

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.x), np.ascontiguousarray(s.P.diagonal(axis1=1, axis2=3).transpose(0, 3, 1, 2)))

    def _team_readings(self, world: World, z: Senses, air: Mail) -> Iterator[tuple[Sensor, Array]]:
        """Yield the readings of teammates that are used, (t, receiver, sender, k) by sensor."""
        camera = world.sensors.get("sighting")
        if camera is not None and self.sighting != "both":  # a part of it
            if not isinstance(camera, models.Sighting):
                raise BadInput(
                    f"sighting={self.sighting!r} needs sightings of range and bearing, not those of {camera!r}"
                )
            part: Sensor = models.Bearing(camera.sigma_bearing, camera.loss)
            numbers = z.sighting[..., 1:]
            if self.sighting == "range":
                part, numbers = Range(camera.sigma_range, camera.loss), z.sighting[..., :1]
            world, z = replace(world, sensors={**world.sensors, "sighting": part}), z._replace(sighting=numbers)
        yield from kalman.reading_tables(world, z, air)
        if self.orientation and not np.isnan(readings := z.extra["orientation"]).all():
            yield world.sensors["orientation"], readings

    def _update_by_fixed(self, s: State, sensor: Sensor, place: Array, reading: Array) -> State:
        """Update by every robot's reading (t, n, k) of one fixed thing, linearised and gated before any is used."""
        y, H, _ = kalman.innovation(sensor, s.x, place, reading)
        y, H = kalman.soften(sensor, joint.own_blocks(s.P), y, H)
        readings = joint.linear_fixed(y, H, sensor.R)
        d2 = joint_kernels.distances(joint.square(s.P), readings)
        use = d2 <= self.gate
        if self.engine == "batched" and np.count_nonzero(sensor.R) == len(sensor.R):  # it is diagonal
            x, P = s.x.copy(), joint.square(s.P.copy())
            add_scalars(x, P, use[:, :, 0], y, H, sensor.R.diagonal().copy())
            after = _set_belief(s, x, P)
        else:
            after = self._add(s, use, readings)
        return _count_distances(after, d2, self.gate, False)

    def _update_together(self, s: State, sensor: Sensor, readings: Array) -> State:
        """Use all readings (t, n, n, k) at once: P' = (P^-1 + H'R^-1 H)^-1,  x' = x + P' H'R^-1 (y + H (x^ - x)).

        Each reading is gated alone, against the belief before all of them.
        """
        if self.engine == "batched" and isinstance(sensor, Range) and sensor.loss == "none":
            return self._add_ranges(s, sensor.R.item(), np.ascontiguousarray(readings[..., 0]))
        shift, extra = np.zeros(1), np.zeros((1, 1))
        if self.second_order and isinstance(sensor, Range):
            blocks = s.P[:, :, :2, :, :2].swapaxes(2, 3)  # (t, n, n, 2, 2)
            own = np.einsum("tiiab->tiab", blocks)
            D = own[:, :, None] + own[:, None] - blocks - blocks.swapaxes(1, 2)  # of every difference of two positions
            shift, extra = kalman.curvature(sensor, s.x[:, :, None], s.x[:, None], D)
        R, at, model = sensor.R + extra, s, kalman.loop_model(sensor) if self.engine == "batched" else None
        for k in range(self.iterations):
            if model:
                y, H_i, H_j = joint_kernels.linearise_pairs(model, s.x, at.x, readable(readings))
            else:
                y, H_i, H_j = kalman.linearise(sensor, at.x[:, :, None], at.x[:, None], readings)
                back = (at.x - s.x)[..., None]
                y = y - shift + (H_i @ back[:, :, None] + H_j @ back[:, None])[..., 0]
                y, H_i, H_j = kalman.soften_pair(sensor, y, H_i, H_j, *joint.pair_blocks(s.P), extra=extra)
            linear = joint.linear_readings(y, H_i, H_j, R)
            if k == 0:
                d2 = joint_kernels.distances(joint.square(s.P), linear)
            at = self._add(s, d2 <= self.gate, linear, last=k == self.iterations - 1)
        return _count_distances(at, d2, self.gate, True)

    def _add_ranges(self, s: State, variance: float, z: Array) -> State:
        """Do what `_update_together` does with ranges z (t, n, n), by two compiled loops."""
        P, x = joint.square(s.P), joint.flat(s.x)
        d2, shift, noise = joint_kernels.gate_ranges(x, P, z, variance, self.second_order)
        use, at, P1 = d2 <= self.gate, x, P
        for k in range(self.iterations):
            eta, Lambda = joint_kernels.range_information(x, at, z, use, shift, noise)
            step, P1 = joint.add_information(P, eta, Lambda, last=k == self.iterations - 1)
            at = x + step
        return _count_distances(_set_belief(s, at, P1), d2, self.gate, True)

    def _restart(self, s: State) -> State:
        """Restart the most refused robot of a trial, if lost, anywhere in the arena, uncorrelated."""
        lost = s.refused > self.lost
        if not lost.any():
            return s
        lost &= np.arange(s.world.robots) == s.refused.argmax(1)[:, None]
        (low, high), d = s.world.arena, s.x.shape[-1]
        x = np.where(lost[..., None] & (np.arange(d) < 2), np.append((low + high) / 2, 0.0)[:d], s.x)
        uniform = np.diag(np.append((high - low) ** 2 / 12, np.pi**2 / 3)[:d])
        P = np.where(lost[:, :, None, None, None] | lost[:, None, None, :, None], 0.0, s.P)
        P = P + joint.block_diagonal(np.where(lost[..., None, None], uniform, 0.0))
        return s._replace(x=x, P=P, refused=np.where(lost, 0.0, s.refused))

    def _one_by_one(self, s: State, z: Senses, air: Mail) -> State:
        """Update by readings of teammates sender by sender, each linearised at what the last one left."""
        plain = self.iterations == 1 and not self.second_order and self.engine == "batched"
        for sensor, readings in self._team_readings(s.world, z, air):
            if plain and isinstance(sensor, Range) and sensor.loss == "none":
                x, P = s.x.copy(), joint.square(s.P.copy())
                add_ranges(x, P, readings[..., 0], sensor.R.item(), self.gate)
                s = _set_belief(s, x, P)
                continue
            for j, i in permutations(range(s.world.robots), 2):
                if not np.isnan(readings[:, i, j]).all():
                    s = self._relate(s, sensor, i, j, readings[:, i, j])
        return s

    def _relate(self, s: State, sensor: Sensor, i: int, j: int, reading: Array) -> State:
        """Update by robot i's reading of robot j: y + H (x^ - x), re-linearised at the last iterate x^."""
        shift, extra = np.zeros(()), np.zeros((1, 1))
        if self.second_order:
            P = s.P[:, :, :2, :, :2]
            D = P[:, i, :, i] + P[:, j, :, j] - P[:, i, :, j] - P[:, j, :, i]
            shift, extra = kalman.curvature(sensor, s.x[:, i], s.x[:, j], D)
        at = s
        for _ in range(self.iterations):
            y, H_i, H_j = kalman.linearise(sensor, at.x[:, i], at.x[:, j], reading)
            back = at.x - s.x
            y = y - shift + (H_i @ back[:, i, :, None] + H_j @ back[:, j, :, None])[..., 0]
            blocks = s.P[:, i, :, i], s.P[:, j, :, j], s.P[:, i, :, j]
            y, H_i, H_j = kalman.soften_pair(sensor, y, H_i, H_j, *blocks, extra=extra)
            at = self._update(s, y, {i: H_i, j: H_j}, sensor.R + extra)
        return at

    def _add(self, s: State, use: Mask, readings: joint_kernels.LinearReadings, last: bool = True) -> State:
        """P' = (P^-1 + H'R^-1 H)^-1,  x' = x + P' H'R^-1 y, over the readings that `use` allows."""
        step, P = joint.solve_together(self.engine, joint.square(s.P), use, readings, last)
        return _set_belief(s, joint.flat(s.x) + step, P)

    def _update(self, s: State, y: Array, at: Mapping[int, Array], R: Array) -> State:
        """Kalman update of the joint state by a reading whose Jacobian is given `at` some robots and 0 elsewhere."""
        if self.engine == "batched":
            return _set_belief(s, *joint.sparse_update(s.x, joint.square(s.P), y, at, R, self.gate))
        H, update = joint.dense(at, s.world.robots), kalman.ENGINES[self.engine].update
        return _set_belief(s, *update(joint.flat(s.x), joint.square(s.P), y, H, R, self.gate))


def _set_belief(s: State, x: Array, P: Array) -> State:
    return s._replace(x=x.reshape(s.x.shape), P=P.reshape(s.P.shape))


def _count_distances(s: State, d2: Array, gate: float, between: bool) -> State:
    """Count the readings (t, n, m) that the gate refused into each robot's average."""
    joint_kernels.count_refused(d2, gate, between, FORGET, refused := s.refused.copy())
    return s._replace(refused=refused)
