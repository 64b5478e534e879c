"""What Kalman filters put on the air: a belief and its sightings in one packet, and the count of what was sent."""

from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np

from cooploc.estimators.interface import HEADER, Array, Indices, Mask, Traffic


class Message(NamedTuple):
    """A broadcast belief; a whole row of them where the leading axes are (receiver, sender)."""

    x: Array  # (..., d)
    P: tuple[Array, ...]  # (..., d, d) each: the covariance, or the parts that add up to it
    sightings: Array  # (..., n, 2)  range [m] and bearing [rad] of each teammate; n = 0 where none are sent

    def pack(self) -> Array:
        """The packet (..., m): x, the upper triangle of each covariance, the sightings."""
        lead, d = self.x.shape[:-1], self.x.shape[-1]
        upper = (P.reshape(*lead, d * d).take(_triangle(d), -1) for P in self.P)
        return np.concatenate([self.x, *upper, self.sightings.reshape(*lead, 2 * self.sightings.shape[-2])], -1)

    @classmethod
    def unpack(cls, packets: Array, d: int, parts: int = 1) -> Self:
        """The messages in packets (..., m) of a state of d numbers and a covariance in `parts`."""
        where, size = _square(d), d * (d + 1) // 2
        covariances = [packets.take(where + d + part * size, -1) for part in range(parts)]
        x, sightings = packets[..., :d], packets[..., d + parts * size :]
        pairs = sightings.reshape(*packets.shape[:-1], sightings.shape[-1] // 2, 2)
        return cls(x, tuple(covariances), pairs)


@lru_cache
def _triangle(d: int) -> Indices:
    """Where the upper triangle of a (d, d) matrix is among its d^2 numbers."""
    i, j = np.triu_indices(d)
    return i * d + j


@lru_cache
def _square(d: int) -> Indices:
    """Which of the triangle's numbers is each entry of a (d, d) matrix."""
    which, triangle = np.empty((d, d), np.int64), np.triu_indices(d)
    which[triangle] = which.T[triangle] = np.arange(len(triangle[0]))
    return which


def no_traffic(x: Array) -> Traffic:
    """Nothing sent by robots with states x (t, n, d)."""
    return Traffic(np.zeros(x.shape[:2]), np.zeros(x.shape[:2]))


def count(sent: Traffic, robot: int, when: Mask, numbers: int) -> None:
    """Add, in place, a robot's message of so many numbers, 8 bytes each, in the trials `when` (t,) it was sent."""
    sent.messages[:, robot] += when
    sent.bytes[:, robot] += when * (8.0 * numbers + HEADER)
