"""What Kalman filters put on the air: a belief and its sightings in one packet, and the count of what was sent."""

from typing import NamedTuple, Self

import numpy as np

from cooploc.estimators.interface import HEADER, Array, Mask, Traffic


class Message(NamedTuple):
    """A broadcast belief; a whole row of them where the leading axes are (receiver, sender)."""

    x: Array  # (..., d)
    P: tuple[Array, ...]  # (..., d, d) each: the covariance, or the parts that add up to it
    sightings: Array  # (..., n, 2)  range [m] and bearing [rad] of each teammate; n = 0 where none are sent

    def pack(self) -> Array:
        """The packet (..., m): x, the upper triangle of each covariance, the sightings."""
        i, j = np.triu_indices(self.x.shape[-1])
        sightings = self.sightings.reshape(*self.x.shape[:-1], 2 * self.sightings.shape[-2])
        return np.concatenate([self.x, *(P[..., i, j] for P in self.P), sightings], -1)

    @classmethod
    def unpack(cls, packets: Array, d: int, parts: int = 1) -> Self:
        """The messages in packets (..., m) of a state of d numbers and a covariance in `parts`."""
        i, j = np.triu_indices(d)
        x, *triangles, sightings = np.split(packets, d + len(i) * np.arange(parts + 1), -1)
        covariances = []
        for triangle in triangles:
            P = np.empty((*packets.shape[:-1], d, d))
            P[..., i, j] = P[..., j, i] = triangle
            covariances.append(P)
        pairs = sightings.reshape(*packets.shape[:-1], sightings.shape[-1] // 2, 2)
        return cls(x, tuple(covariances), pairs)


def no_traffic(x: Array) -> Traffic:
    """Nothing sent by robots with states x (t, n, d)."""
    return Traffic(np.zeros(x.shape[:2]), np.zeros(x.shape[:2]))


def count(sent: Traffic, robot: int, when: Mask, numbers: int) -> None:
    """Add, in place, a robot's message of so many numbers, 8 bytes each, in the trials `when` (t,) it was sent."""
    sent.messages[:, robot] += when
    sent.bytes[:, robot] += when * (8.0 * numbers + HEADER)
