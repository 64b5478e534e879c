"""Collaborative terrain-relative navigation (CTRN): particle filters whose beliefs meet by covariance intersection.

Each robot runs its own particle filter and broadcasts mean and covariance. A robot that hears a packet has a reading of
the sender (range or RSSI), but does not know how far the sender's belief depends on its own: covariance intersection
finds the weight w that is safe whatever the correlation. Of the original we have only the abstract; these are our
interpretations of it, one file each: moments.py, message.py and received.py.

Sources: A. Wiktor, S. Rock, "Collaborative multi-robot localization in natural terrain", ICRA 2020; for the relative
form of covariance intersection, L. C. Carrillo-Arce et al., "Decentralized multi-robot cooperative localization using
covariance intersection", IROS 2013.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cooploc.estimators.ctrn import audit, message, moments, received
from cooploc.estimators.ctrn.intersection import where_definite
from cooploc.estimators.ctrn.state import Counts, Settings, State, empty_sample
from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World
from cooploc.estimators.particle import own_filter
from cooploc.estimators.particle.packet import pack

FUSE = {"moments": moments.fuse, "message": message.fuse, "received": received.fuse}


@dataclass(frozen=True)
class Ctrn(Settings):
    """Particle filter on own readings, covariance intersection with received beliefs.

    Args:
        reading: what is measured of a packet: "rssi" [dBm] or "range" [m].
        fusion: "moments", "message" or "received", a file each.
        weights: "cvxpy" solves a cone program for the weights, "exact" a closed form or Newton's method.
        criterion: what the weights minimise: "trace" [m^2] or "det" [m^4] of the position's covariance.
        audit: with weights="exact", the share of fusions, in [0, 1], that cvxpy solves again; see `notes`.

    """

    api: ClassVar[int] = 1

    @property
    def uses(self) -> tuple[str, ...]:
        return (*super().uses, f"radio_{self.reading}")

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        senders, d = (world.robots, 2) if self.fusion == "received" else (0, prior.x.shape[-1])
        solver_group, counts = rows.trial * world.robots + rows.robot, Counts(*np.zeros((2, len(prior.x))))
        own = own_filter.init(self, prior, world, rows)
        nothing = received.nothing(len(prior.x), senders)
        return State(own, solver_group, nothing, prior, counts, empty_sample(0, d))

    def predict(self, s: State, z: Senses) -> State:
        s, before = s._replace(own=own_filter.predict(self, s.own, z)), s.own.belief.x
        return received.predict(s, z, before) if self.fusion == "received" else s

    def correct(self, s: State, z: Senses) -> State:
        return s._replace(own=own_filter.correct(self, s.own, z))

    def send(self, s: State, z: Senses) -> Array:
        """x, y, and the position covariance's P_xx, P_xy, P_yy: five numbers. Nothing received is sent on.

        A robot whose particles have collapsed onto a line or a point has no covariance to send: silence.
        """
        return where_definite(pack(own_filter.to_send(s.own)))

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        s = FUSE[self.fusion](self, s, z, mail)
        own = own_filter.finish(self, s.own)
        belief = received.combined(own.belief, s.received) if self.fusion == "received" else own.belief
        return s._replace(own=own, belief=belief)

    def estimate(self, s: State) -> Belief:
        return s.belief

    def notes(self, s: State) -> dict[str, Array]:
        """How many fusions there were, and how far the exact weights lie from cvxpy's where both were computed."""
        notes = {"fusions": s.counts.fusions, "fallbacks": s.counts.fallbacks}
        return notes | audit.notes(self, s) if self.weights == "exact" else notes
