"""Cooperative EKF that ignores cross-covariances: it treats every received belief as independent of its own.

It is not: what two robots learned from each other comes back as if it were new, so the covariance falls without reason.
Covariance intersection, and the filters that keep cross terms, exist to avoid this mistake.

Sent, in one broadcast a tick: x and the triangle of P (5 numbers, with a heading 9) and, with a camera, range and
bearing of every teammate in sight; 8 bytes each. A robot that was sighted uses that reading, too (`both`).

Source: S. Roumeliotis, G. Bekey, "Distributed multirobot localization", IEEE T-RA 18(5), 2002, with P_ij = 0 always;
A. Howard, M. Mataric, G. Sukhatme, "Putting the 'I' in 'team'", ICRA 2003, on such circular reasoning.
"""

from dataclasses import dataclass
from typing import NamedTuple

from cooploc.estimators.interface import Array, Belief, Indices, Mail, Rows, Senses, World
from cooploc.estimators.kalman.messages import Message
from cooploc.estimators.kalman.own_steps import corrected, moved
from cooploc.estimators.kalman.settings import TeamSettings
from cooploc.estimators.kalman.team_readings import received
from cooploc.estimators.kalman.update import ENGINES
from cooploc.estimators.models.angles import wrap_heading


class State(NamedTuple):
    """What one robot remembers."""

    x: Array  # (r, d)
    P: Array  # (r, d, d)
    robot: Indices  # (r,)
    world: World


@dataclass(frozen=True)
class EkfNaive(TeamSettings):
    """EKF on own readings and on received beliefs, which it treats as independent.

    Parameters:
        both: whether a sighting corrects the robot that was seen, too.
    """

    both: bool = True

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        self.require_corners(world)
        return State(prior.x, prior.P, rows.robot, world)

    def predict(self, s: State, z: Senses) -> State:
        """x' = f(x, u),  P' = F P F' + Q."""
        x, P, _ = moved(self, s.world, s.x, s.P, z)
        return s._replace(x=x, P=P)

    def correct(self, s: State, z: Senses) -> State:
        x, P = corrected(self, s.world, s.x, s.P, z)
        return s._replace(x=x, P=P)

    def send(self, s: State, z: Senses) -> Array:
        """The belief before this tick's fusion, and the sightings."""
        return Message(s.x, (s.P,), z.sighting if self.both else z.sighting[:, :0]).pack()

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        """S = H P H' + H_j P_j H_j' + R: the sender's uncertainty counts as noise, independent of the robot's own."""
        x, P = s.x, s.P
        sent = Message.unpack(mail.packets, x.shape[-1])
        for pair in received(s.world, z, mail, sent.sightings, s.robot):
            y, H, H_j = pair.linearise(x, sent.x[:, pair.sender])
            noise = H_j @ sent.P[0][:, pair.sender] @ H_j.mT + pair.sensor.R
            x, P = ENGINES[self.engine].update(x, P, y, H, noise, self.gate)
        return s._replace(x=x, P=P)

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.x), s.P)
