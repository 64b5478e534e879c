"""Readings of anchors and of packets as the loops of link_kernels.py take them."""

from typing import NamedTuple

from cooploc.estimators.interface import Array


class AnchorReadings(NamedTuple):
    """RSSI of anchors, and of the sensor what the loop needs."""

    places: Array  # (a, 2) [m]
    readings: Array  # (r, a) [dBm], nan where absent
    A: float  # [dBm] at 1 m
    slope: float  # RSSI lost per unit of ln D, D the squared distance [dB]
    unit: float  # 1/sigma [1/dB]


class PacketReadings(NamedTuple):
    """RSSI or ranges of packets, and of the sensor what the loop needs."""

    packets: Array  # (r, n, 5)  x, y, P_xx, P_xy, P_yy of each sender
    readings: Array  # (r, n) [dBm] or [m], nan where nothing was heard
    ranged: bool  # ranges, else RSSI
    A: float  # as of anchors; 0 of ranges
    slope: float
    unit: float  # 1/sigma [1/dB] or [1/m]
    gain: float  # times P_j: the variance that the sender's position adds, sigma = 1; 0 ignores P_j
