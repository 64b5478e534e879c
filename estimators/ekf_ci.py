"""Covariance intersection with relative readings: an EKF each, and no trust in what is independent of what.

Each robot keeps an EKF of its own state and broadcasts it with its sightings of teammates. A robot uses its own
readings of whoever it hears, and what it hears of itself. Both covariances of a reading are first inflated, by 1/w and
1/(1-w), so that no unknown correlation can make the result over-confident.

- `form="relative"`: the reading updates the inflated joint; its own noise is independent and is not inflated.
- `form="ls"`: whoever sees a teammate works out where that teammate is; the teammate intersects this with its own
  belief, reading noise and all. Needs sightings.

Source: L. C. Carrillo-Arce, E. D. Nerurkar, J. L. Gordillo, S. I. Roumeliotis, "Decentralized multi-robot cooperative
localization using covariance intersection", IROS 2013, for "ls"; the relative form inflates blkdiag(P_i/w, P_j/(1-w))
before the update of robot i.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from cooploc.estimators.covariance_intersection.weights import relative_weights
from cooploc.estimators.interface import Array, Belief, Indices, Mail, Mask, Rows, Senses, Sensor, World
from cooploc.estimators.kalman.settings import TeamSettings
from cooploc.estimators.kalman.update import distance, inflated_update, kalman, symmetric
from cooploc.estimators.models.angles import wrap_heading
from cooploc.estimators.models.gradient_doa import fixed

EXACT = 1e-9 * np.eye(2)  # [m^2] a position that is all belief and no reading


class State(NamedTuple):
    """What one robot remembers."""

    x: Array  # (r, d)
    P: Array  # (r, d, d)
    who: Indices  # (r,)  one number per robot and trial: nobody shares a program, whose last bits would tell of others
    robot: Indices  # (r,)
    world: World


class Relation(NamedTuple):
    """One reading between a robot and a sender, linearised: y = z - h, own H, the sender's H_j and P_j, noise R."""

    y: Array  # (r, k)
    H: Array  # (r, k, d)
    H_j: Array  # (r, k, e)
    P_j: Array  # (r, e, e)
    R: Array  # (k, k)


@dataclass(frozen=True)
class EkfCi(TeamSettings):
    """EKF on own readings, covariance intersection on received beliefs.

    Parameters:
        form: "relative", the reading updates the inflated joint; "ls", the sender states where the robot is.
        weights: which solver finds w: "exact", a search of our own, or "cvxpy", a cone program.
        criterion: what w minimises of the result: its "trace" or its "det".
        over: what the criterion is about. Over the "position" [m^2] alone, headings that no reading sees are inflated
            without bound; over the whole "state", the trace adds m^2 to rad^2.

    """

    form: Literal["relative", "ls"] = "relative"
    weights: Literal["cvxpy", "exact"] = "exact"
    criterion: Literal["trace", "det"] = "trace"
    over: Literal["position", "state"] = "state"

    @property
    def uses(self) -> tuple[str, ...]:
        relative = "sighting" if self.form == "ls" else f"sighting|radio_{self.reading}"
        return ("odometry", "anchor_rssi|landmark", relative)

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        self.require_corners(world)
        return State(prior.x, prior.P, rows.trial * world.robots + rows.robot, rows.robot, world)

    def predict(self, s: State, z: Senses) -> State:
        """x' = f(x, u),  P' = F P F' + Q."""
        x, F, Q = s.world.motion.move(s.x, z.odometry, z.dt)
        return s._replace(x=x, P=symmetric(F @ s.P @ F.mT + Q))

    def correct(self, s: State, z: Senses) -> State:
        x, P = s.x, s.P
        for sensor, place, reading in fixed(s.world, z, self.anchor_reading):
            y, H, _ = sensor.innovation(x, place, reading)
            x, P = kalman(x, P, y, H, sensor.R, self.gate)
        return s._replace(x=x, P=P)

    def send(self, s: State, z: Senses) -> Array:
        """x, the upper triangle of P, and the sightings of every teammate: d + d (d + 1) / 2 + 2 n numbers at most."""
        i, j = np.triu_indices(s.x.shape[-1])
        return np.concatenate([s.x, s.P[:, i, j], z.sighting.reshape(len(s.x), -1)], -1)

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        """One reading after the other, each linearised at the belief that the last one left."""
        seen = s.world.sensors.get("sighting")
        for sensor, sender, reading in s.world.relative(z, mail):
            if self.form == "relative":
                s = self._intersect(s, _of_sender(s, sensor, mail.packets[:, sender], reading))
        if seen is not None:
            relate = _of_me if self.form == "relative" else _where_i_am
            for sender in range(s.world.robots):
                s = self._intersect(s, relate(s, seen, mail.packets[:, sender]))
        return s

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.x), s.P)

    def _intersect(self, s: State, relation: Relation) -> State:
        """x' = x + K y,  P' = (I - K H) P/w  with  K = P/w H' (H P/w H' + H_j P_j/(1-w) H_j' + R)^-1."""
        y, H, H_j, P_j, R = relation
        use: Mask = np.asarray(~(np.isnan(y).any(-1) | np.isnan(P_j).any((-2, -1))))
        # Gated by what would hold if the two were independent: a fair reading passes whatever the correlation.
        plain = H @ s.P @ H.mT + H_j @ P_j @ H_j.mT + R
        safe = np.where(use[:, None, None], plain, np.eye(y.shape[-1]))
        use &= distance(np.where(use[:, None], y, 0.0), safe) <= 2 * self.gate
        if not use.any():
            return s
        w = np.ones(len(y))
        parts = (s.P[use], P_j[use], H[use], H_j[use], R)
        block = 2 if self.over == "position" else s.x.shape[-1]
        w[use] = relative_weights(*parts, self.criterion, self.weights, block, s.who[use])
        return s._replace(**inflated_update(Belief(s.x, s.P), y, H, H_j, P_j, R, w)._asdict())


def _of_sender(s: State, sensor: Sensor, packet: Array, reading: Array) -> Relation:
    """The robot's own reading of the sender."""
    x_j, P_j, _ = _unpacked(s, packet)
    y, H, H_j = sensor.innovation(s.x, x_j[:, :2], reading)
    return Relation(y, H, H_j, P_j[:, :2, :2], sensor.R)


def _of_me(s: State, sensor: Sensor, packet: Array) -> Relation:
    """The sender's sighting of the robot: the same sensor, the other way round."""
    x_j, P_j, sighting = _unpacked(s, packet)
    y, H_j, H = sensor.innovation(x_j, s.x[:, :2], sighting)
    return Relation(y, _widened(H, s.x), H_j, P_j, sensor.R)


def _where_i_am(s: State, sensor: Sensor, packet: Array) -> Relation:
    """Where the sender's sighting (range, bearing) puts the robot: a position with a covariance, and no reading."""
    x_j, P_j, sighting = _unpacked(s, packet)
    distance_, a = sighting[:, 0], sighting[:, 1] + (x_j[:, 2] if x_j.shape[-1] > 2 else 0.0)
    u, v = np.stack([np.cos(a), np.sin(a)], -1), np.stack([-np.sin(a), np.cos(a)], -1)
    N = np.stack([u, v * distance_[:, None]], -1)  # d place / d (range, bearing)
    G = np.broadcast_to(np.eye(2, x_j.shape[-1]), (*x_j.shape[:1], 2, x_j.shape[-1])).copy()
    if x_j.shape[-1] > 2:
        G[:, :, 2] = N[:, :, 1]
    y = x_j[:, :2] + distance_[:, None] * u - s.x[:, :2]
    one = np.broadcast_to(np.eye(2), (len(y), 2, 2))
    return Relation(y, _widened(one, s.x), one, G @ P_j @ G.mT + N @ sensor.R @ N.mT, EXACT)


def _unpacked(s: State, packet: Array) -> tuple[Array, Array, Array]:
    """The sender's x (r, d) and P (r, d, d), and its sighting (r, 2) of the receiver."""
    d = s.x.shape[-1]
    i, j = np.triu_indices(d)
    P = np.empty((len(packet), d, d))
    P[:, i, j] = P[:, j, i] = packet[:, d : d + len(i)]
    seen = packet[:, d + len(i) :].reshape(len(packet), -1, 2)
    mine = (
        np.take_along_axis(seen, s.robot[:, None, None], 1)[:, 0]
        if seen.shape[1]
        else np.full((len(packet), 2), np.nan)
    )
    return packet[:, :d], P, mine


def _widened(H: Array, x: Array) -> Array:
    return np.concatenate([H, np.zeros((*H.shape[:-1], x.shape[-1] - 2))], -1)
