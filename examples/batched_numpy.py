"""The filter of `filterpy_loop.py` written once for one robot and run for all rows (trial, robot) at once, in numpy.

Arrays have a leading axis of rows; absent readings are nan, and `kalman` leaves such rows alone, bit by bit. Sums over
rows are what to avoid: a row's result must not depend on which other rows there are.

    cooploc check examples/batched_numpy.py:Batched
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from cooploc import Belief
from cooploc.estimators.kalman import kalman

WEIGHTS = (0.5, 0.75, 0.9)


class State(NamedTuple):
    """What the robots remember."""

    x: np.ndarray  # (r, 2) [m]
    P: np.ndarray  # (r, 2, 2)
    world: object


@dataclass(frozen=True)
class Batched:
    """EKF on own readings, covariance intersection with received beliefs by range."""

    api: ClassVar[int] = 1
    uses: tuple[str, ...] = ("odometry", "anchor_rssi", "radio_range")

    def init(self, prior, world, rows):
        return State(prior.x, prior.P, world)

    def predict(self, s, z):
        x, F, Q = s.world.motion.move(s.x, z.odometry, z.dt)
        return s._replace(x=x, P=F @ s.P @ F.mT + Q)

    def correct(self, s, z):
        x, P = s.x, s.P
        for sensor, place, reading in s.world.fixed(z):
            y, H, _ = sensor.innovation(x, place, reading)
            x, P = kalman(x, P, y, H, sensor.R)
        return s._replace(x=x, P=P)

    def send(self, s, z):
        return np.concatenate([s.x, s.P.reshape(-1, 4)], -1)

    def fuse(self, s, z, mail):
        x, P = s.x, s.P
        for sensor, j, reading in s.world.relative(z, mail):
            x_j, P_j = mail.packets[:, j, :2], mail.packets[:, j, 2:].reshape(-1, 2, 2)
            y, H, H_j = sensor.innovation(x, x_j, reading)
            best_x, best_P = x, P
            for w in WEIGHTS:
                x_w, P_w = kalman(x, P / w, y, H, sensor.R + H_j @ P_j @ H_j.mT / (1 - w))
                better = trace(P_w) < trace(best_P)
                best_x = np.where(better[:, None], x_w, best_x)
                best_P = np.where(better[:, None, None], P_w, best_P)
            x, P = best_x, best_P
        return s._replace(x=x, P=P)

    def estimate(self, s):
        return Belief(s.x, s.P)


def trace(P):
    """Of each row (r,)."""
    return P[:, 0, 0] + P[:, 1, 1]
