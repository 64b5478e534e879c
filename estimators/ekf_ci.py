"""Covariance intersection with relative readings: one EKF per robot, no independence assumption between robots.

Each robot keeps an EKF of its own state and broadcasts it with its sightings of teammates. A robot uses its own
readings of each robot it receives, and their sightings of it. Both covariances of a reading are first inflated, by 1/w
and 1/(1-w), so that no unknown correlation can make the result over-confident.

- `form="relative"`: the reading updates the inflated joint; its own noise is independent and is not inflated.
- `form="ls"`: a robot that sees a teammate computes where that teammate is; the teammate intersects this with its own
  belief, reading noise and all. Needs sightings.

The relative form is overlapping covariance intersection (arXiv 2603.16768) of a pair of beliefs and one reading. Of
ranges it is the filter of hal-04039619: a range helps at most one of two robots, and by the trace only one with
h' P_i^2 h / h' P_j h > tr P_i.

Source: L. C. Carrillo-Arce, E. D. Nerurkar, J. L. Gordillo, S. I. Roumeliotis, "Decentralized multi-robot cooperative
localization using covariance intersection", IROS 2013, for "ls"; the relative form inflates blkdiag(P_i/w, P_j/(1-w))
before the update of robot i.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from cooploc.estimators import kalman
from cooploc.estimators.covariance_intersection import solve_relative
from cooploc.estimators.interface import Array, Belief, Indices, Mail, Rows, Senses, World
from cooploc.estimators.tunable import tunable

EXACT = 1e-9 * np.eye(2)  # [m^2] noise of a position that is all belief and no reading


class State(NamedTuple):
    """The memory of one robot."""

    x: Array  # (r, d)
    P: Array  # (r, d, d)
    group: Indices  # (r,)  solved separately, so that a result cannot depend on another robot in its last bits
    robot: Indices  # (r,)
    world: World


@kalman.explain
@dataclass(frozen=True)
class EkfCi(kalman.TeamParameters):
    """EKF on own readings, covariance intersection on received beliefs.

    Parameters:
        form: "relative", the reading updates the inflated joint; "ls", the sender states where the robot is.
        weights: which solver finds w: "exact", a search of our own, or "cvxpy", a cone program.
        criterion: what w minimises of the result: its "trace" or its "det".
        over: what the criterion is about. Over the "position" [m^2] alone, headings that no reading sees are inflated
            without bound; over the whole "state", the trace adds m^2 to rad^2.
    """

    sends: ClassVar[str] = "mean, covariance, sightings"
    consistency: ClassVar[str] = "conservative by construction"
    form: Literal["relative", "ls"] = "relative"
    weights: Literal["cvxpy", "exact"] = "exact"
    criterion: Literal["trace", "det"] = tunable("trace", choices=("trace", "det"))
    over: Literal["position", "state"] = tunable("state", choices=("state", "position"))

    predict = kalman.predict_belief
    correct = kalman.correct_belief
    estimate = kalman.estimate_belief

    @property
    def uses(self) -> tuple[str, ...]:
        *own, between = kalman.team_channels(self)
        return (*own, "sighting" if self.form == "ls" else between)

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        world = kalman.assume(self, world)
        return State(prior.x, prior.P, rows.trial * world.robots + rows.robot, rows.robot, world)

    def send(self, s: State, z: Senses) -> Array:
        """Return x, the upper triangle of P, the sightings: d + d (d + 1) / 2 + 2 n numbers at most."""
        return kalman.Message(s.x, (s.P,), z.sighting).pack()

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        """Intersect with one reading after the other, each linearised at the belief that the last one left."""
        sent = kalman.Message.unpack(mail.packets, s.x.shape[-1])
        for pair in kalman.receive(s.world, z, mail, sent.sightings, s.robot):
            x_j, P_j = sent.x[:, pair.sender], sent.P[0][:, pair.sender]
            if self.form == "relative":
                s = self._intersect(s, *pair.linearise(s.x, x_j), P_j, pair.sensor.R)
            elif pair.by_sender:
                s = self._intersect(s, *_locate_by_sender(s.x, x_j, P_j, pair), EXACT)
        return s

    def _intersect(self, s: State, y: Array, H: Array, H_j: Array, P_j: Array, R: Array) -> State:
        """x' = x + K y,  P' = (I - K H) P/w  with  K = P/w H' (H P/w H' + H_j P_j/(1-w) H_j' + R)^-1.

        By readings y (r, k) with H (r, k, d), the sender's H_j (r, k, e) and P_j (r, e, e), and R (k, k). Gated by the
        S of independent robots, twice as wide: a true reading passes whatever the correlation.
        """
        rows = np.flatnonzero(~(np.isnan(y).any(-1) | np.isnan(P_j).any((-2, -1))))
        S = H[rows] @ s.P[rows] @ H[rows].mT + H_j[rows] @ P_j[rows] @ H_j[rows].mT + R
        rows = rows[kalman.distance(y[rows], S) <= 2 * self.gate]
        if rows.size == 0:
            return s
        x, P, y, H, H_j, P_j = (part[rows] for part in (s.x, s.P, y, H, H_j, P_j))
        block = 2 if self.over == "position" else x.shape[-1]
        w = solve_relative(P, P_j, H, H_j, R, self.criterion, self.weights, block, s.group[rows]).w
        after = kalman.inflated_update(Belief(x, P), y, H, H_j, P_j, R, w, kalman.ENGINES[self.engine].update)
        x, P = s.x.copy(), s.P.copy()
        x[rows], P[rows] = after
        return s._replace(x=x, P=P)


def _locate_by_sender(x: Array, x_j: Array, P_j: Array, pair: kalman.PairReading) -> tuple[Array, Array, Array, Array]:
    """Return y, H, H_j and covariance of the position that the sender's sighting (range, bearing) gives the robot."""
    away, angle = pair.z[:, 0], pair.z[:, 1] + (x_j[:, 2] if x_j.shape[-1] > 2 else 0.0)
    u, v = np.stack([np.cos(angle), np.sin(angle)], -1), np.stack([-np.sin(angle), np.cos(angle)], -1)
    N = np.stack([u, v * away[:, None]], -1)  # d place / d (range, bearing)
    G = np.broadcast_to(np.eye(2, x_j.shape[-1]), (*x_j.shape[:1], 2, x_j.shape[-1])).copy()
    if x_j.shape[-1] > 2:
        G[:, :, 2] = N[:, :, 1]
    y = x_j[:, :2] + away[:, None] * u - x[:, :2]
    H, one = (np.broadcast_to(np.eye(2, d), (len(y), 2, d)) for d in (x.shape[-1], 2))
    return y, H, one, G @ P_j @ G.mT + N @ pair.sensor.R @ N.mT
