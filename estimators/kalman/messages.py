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
        i, j = _triangle(self.x.shape[-1])
        sightings = self.sightings.reshape(*self.x.shape[:-1], 2 * self.sightings.shape[-2])
        return np.concatenate([self.x, *(P[..., i, j] for P in self.P), sightings], -1)

    @classmethod
    def unpack(cls, packets: Array, d: int, parts: int = 1) -> Self:
        """The messages in packets (..., m) of a state of d numbers and a covariance in `parts`."""
        i, j = _triangle(d)
        covariances = []
        for begin in range(d, d + parts * len(i), len(i)):
            P = np.empty((*packets.shape[:-1], d, d))
            P[..., i, j] = P[..., j, i] = packets[..., begin : begin + len(i)]
            covariances.append(P)
        x, sightings = packets[..., :d], packets[..., d + parts * len(i) :]
        pairs = sightings.reshape(*packets.shape[:-1], sightings.shape[-1] // 2, 2)
        return cls(x, tuple(covariances), pairs)


@lru_cache
def _triangle(d: int) -> tuple[Indices, Indices]:
    """Rows and columns of the upper triangle of a (d, d) matrix."""
    i, j = np.triu_indices(d)
    return i, j


def no_traffic(x: Array) -> Traffic:
    """Nothing sent by robots with states x (t, n, d)."""
    return Traffic(np.zeros(x.shape[:2]), np.zeros(x.shape[:2]))


def count(sent: Traffic, robot: int, when: Mask, numbers: int) -> None:
    """Add, in place, a robot's message of so many numbers, 8 bytes each, in the trials `when` (t,) it was sent."""
    sent.messages[:, robot] += when
    sent.bytes[:, robot] += when * (8.0 * numbers + HEADER)
