"""What one tick holds, as arrays: what is sensed, what is heard, what is believed, and what was sent."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

API = 1  # the version of this interface
HEADER = 8  # bytes of a packet in addition to its payload

TOO_NEAR_TO_RANGE = 0.2  # [m] a range reading below this says nothing about direction and is refused
TEAM_PRIOR = "team_prior"  # the channel of a scenario that tells everyone's prior, x and P (r, n, d + d d)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]
Keys = NDArray[np.uint32]


class Belief(NamedTuple):
    """A Gaussian per row: what an estimator is given before tick 0, and what it returns after every tick."""

    x: Array  # (r, d)     x [m], y [m], and heading [rad] where d = 3
    P: Array  # (r, d, d)  its covariance


class Rows(NamedTuple):
    """Who each row is. Identity and randomness come from here, never from a row's position."""

    trial: Indices  # (r,)
    robot: Indices  # (r,)  0 .. n-1
    key: Keys  # (r, 2)  seeds a counter-based generator; the same for every estimator


class Senses(NamedTuple):
    """What the robots sensed in one tick."""

    odometry: Array  # (r, k)     Displacement: dx, dy [m]; Unicycle: v [m/s], omega [rad/s]
    dt: Array  # (r,)       what the odometry covers [s]
    anchor_rssi: Array  # (r, a)     [dBm]
    landmark: Array  # (r, l, 2)  range [m], bearing [rad]
    sighting: Array  # (r, n, 2)  of teammates: range [m], bearing [rad]
    extra: Mapping[str, Array]  # anchor_range (r, a) [m], team_prior, and channels of plug-in scenarios, (r, ...)


class Mail(NamedTuple):
    """What reached each row in one tick. Axis 1 is the sender; radio readings exist only where something was heard."""

    heard: Mask  # (r, n)
    packets: Array  # (r, n, m)  nan where nothing was heard
    rssi: Array  # (r, n)     of the packet's own signal [dBm]
    range: Array  # (r, n)     from the same exchange [m]


class Traffic(NamedTuple):
    """What each robot put on the air in one tick."""

    messages: Array  # (trial, n)
    bytes: Array  # (trial, n)
