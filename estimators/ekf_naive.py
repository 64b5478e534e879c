"""Cooperative EKF that ignores cross-covariances: every belief that is heard is taken for independent of one's own.

It is not. What two robots learned from each other comes back as if it were new, so the covariance falls without reason.
This is the mistake that covariance intersection, and the bookkeeping of cross terms, are there to avoid.

Sent, in one broadcast a tick: x and the triangle of P (5 numbers, with a heading 9) and, with a camera, range and
bearing of every teammate in sight; 8 bytes each. A robot that was sighted uses the reading too (`both`).

Source: S. Roumeliotis, G. Bekey, "Distributed multirobot localization", IEEE T-RA 18(5), 2002, with P_ij = 0 always;
A. Howard, M. Mataric, G. Sukhatme, "Putting the 'I' in 'team'", ICRA 2003, on such circular reasoning.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Belief, Indices, Mail, Rows, Senses, World
from cooploc.estimators.kalman.settings import TeamSettings
from cooploc.estimators.kalman.team_readings import packed, received, sightings, unpacked
from cooploc.estimators.kalman.update import ENGINES
from cooploc.estimators.models.angles import wrap_heading
from cooploc.estimators.models.gradient_doa import fixed


class State(NamedTuple):
    """What one robot remembers."""

    x: Array  # (r, d)
    P: Array  # (r, d, d)
    robot: Indices  # (r,)
    world: World


@dataclass(frozen=True)
class EkfNaive(TeamSettings):
    """EKF on own readings and on received beliefs, which it takes for independent.

    Parameters:
        both: whether a sighting corrects the robot that was seen, too.
    """

    both: bool = True

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        self.require_corners(world)
        return State(prior.x, prior.P, rows.robot, world)

    def predict(self, s: State, z: Senses) -> State:
        """x' = f(x, u),  P' = F P F' + Q."""
        x, F, Q = s.world.motion.move(s.x, z.odometry, z.dt)
        x, P = ENGINES[self.engine].predict(x, s.P, F, Q)
        return s._replace(x=x, P=P)

    def correct(self, s: State, z: Senses) -> State:
        """x' = x + K y,  P' = (I - K H) P (I - K H)' + K R K', one reading after the other."""
        x, P = s.x, s.P
        for sensor, place, reading in fixed(s.world, z, self.anchor_reading):
            y, H, _ = sensor.innovation(x, place, reading)
            x, P = ENGINES[self.engine].update(x, P, y, H, sensor.R, self.gate)
        return s._replace(x=x, P=P)

    def send(self, s: State, z: Senses) -> Array:
        """The belief before this tick's fusion, and what was sighted."""
        return np.concatenate([packed(s.x, s.P), sightings(s.world, z) if self.both else s.x[:, :0]], -1)

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        """S = H P H' + H_j P_j H_j' + R: the sender's uncertainty counts as noise, independent of our own."""
        x, P = s.x, s.P
        for heard in received(s.world, z, mail, s.robot, packed(s.x, s.P).shape[-1]):
            x_j, P_j = unpacked(mail.packets[:, heard.sender], x.shape[-1])
            y, H, H_j = heard.linearise(x, x_j)
            x, P = ENGINES[self.engine].update(x, P, y, H, H_j @ P_j @ H_j.mT + heard.sensor.R, self.gate)
        return s._replace(x=x, P=P)

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.x), s.P)
