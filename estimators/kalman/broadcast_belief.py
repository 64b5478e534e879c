"""What the filters have in common that broadcast one belief a tick: they differ in how they combine it with a reading.

Sent, in one broadcast a tick: x and the triangle of P (5 numbers, with a heading 9) and, with a camera, range and
bearing of every teammate in sight; 8 bytes each. A robot that was sighted uses that reading, too (`both`).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

from cooploc.estimators.interface import Array, Belief, Indices, Mail, Rows, Senses, World
from cooploc.estimators.kalman.messages import Message
from cooploc.estimators.kalman.own_filter import OwnFilter
from cooploc.estimators.kalman.team_readings import received


class State(NamedTuple):
    """What one robot remembers."""

    x: Array  # (r, d)
    P: Array  # (r, d, d)
    robot: Indices  # (r,)
    world: World


@dataclass(frozen=True)
class BroadcastBelief(OwnFilter, ABC):
    """EKF on own readings that broadcasts its belief.

    Parameters:
        both: whether a sighting corrects the robot that was seen, too.
    """

    both: bool = True

    @abstractmethod
    def combine(self, x: Array, P: Array, y: Array, H: Array, N: Array) -> tuple[Array, Array]:
        """x', P' by a reading with innovation y (r, k), own Jacobian H (r, k, d), noise N = H_j P_j H_j' + R (r, k, k).

        Rows in which anything is nan must come back as they are, bit for bit.
        """

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        world = self.assumed(world)
        return State(prior.x, prior.P, rows.robot, world)

    def send(self, s: State, z: Senses) -> Array:
        """The belief before this tick's fusion, and the sightings."""
        return Message(s.x, (s.P,), z.sighting if self.both else z.sighting[:, :0]).pack()

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        """One reading after the other, each linearised at the belief that the last one left."""
        x, P = s.x, s.P
        sent = Message.unpack(mail.packets, x.shape[-1])
        for pair in received(s.world, z, mail, sent.sightings, s.robot):
            y, H, H_j = pair.linearise(x, sent.x[:, pair.sender])
            x, P = self.combine(x, P, y, H, H_j @ sent.P[0][:, pair.sender] @ H_j.mT + pair.sensor.R)
        return s._replace(x=x, P=P)
