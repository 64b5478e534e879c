"""A packet of five numbers: x, y, and the position covariance's P_xx, P_xy, P_yy."""

import numpy as np

from cooploc.estimators.interface import Array, Belief


def pack(belief: Belief) -> Array:
    """A packet (r, 5) of a belief's position."""
    x, P = belief
    return np.stack([x[:, 0], x[:, 1], P[:, 0, 0], P[:, 0, 1], P[:, 1, 1]], -1)


def unpack(packet: Array) -> tuple[Array, Array]:
    """The position (r, 2) and covariance (r, 2, 2) of a packet (r, 5)."""
    return packet[:, :2], np.stack([packet[:, 2:4], packet[:, 3:5]], -2)
