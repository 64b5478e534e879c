"""The filter of `filterpy_loop.py` with its two loops, over anchors and over teammates, compiled by numba.

A kernel is written for one row; `guvectorize` runs it for all of them, whatever their layout, without ever mixing two.
Leave `fastmath` off: it deletes the tests for nan. Write numbers, not small arrays: they compile in a fifth of the time
and run faster. It is compiled at every start: with `cache=True` we saw it crash where two processes had filled numba's
cache at the same time.

    cooploc check examples/numba_kernel.py:Compiled
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numba
import numpy as np

from cooploc import Belief
from cooploc.estimators.models import NEAR, TOO_NEAR_TO_RANGE

WEIGHTS = np.array([0.5, 0.75, 0.9])
FAST = {"nopython": True}


@numba.njit(error_model="numpy")
def update(belief, y, hx, hy, R):
    """Kalman update of one row, (x, y, P_xx, P_xy, P_yy), by a scalar reading."""
    x0, x1, a, b, c = belief
    g0, g1 = a * hx + b * hy, b * hx + c * hy
    S = hx * g0 + hy * g1 + R
    return x0 + g0 / S * y, x1 + g1 / S * y, a - g0 * g0 / S, b - g0 * g1 / S, c - g1 * g1 / S


@numba.njit(error_model="numpy")
def write(belief, x, P):
    """Write the numbers of one row into its arrays."""
    x[0], x[1], P[0, 0], P[0, 1], P[1, 1] = belief
    P[1, 0] = P[0, 1]


@numba.guvectorize(
    "void(f8[:], f8[:, :], f8[:], f8[:, :], f8, f8, f8, f8[:], f8[:, :])",
    "(d),(d,d),(a),(a,d),(),(),()->(d),(d,d)",
    **FAST,
)
def anchored(x, P, rssi, anchors, A, eta, sigma, out_x, out_P):
    """Update by the anchors that were heard, one after the other."""
    belief = x[0], x[1], P[0, 0], P[0, 1], P[1, 1]
    for a in range(len(rssi)):
        if not np.isnan(rssi[a]):
            dx, dy = belief[0] - anchors[a, 0], belief[1] - anchors[a, 1]
            d2 = dx * dx + dy * dy
            y = rssi[a] - (A - 5 * eta * np.log10(max(d2, NEAR**2)))
            slope = -10 * eta / np.log(10) / d2 if d2 > NEAR**2 else 0.0
            belief = update(belief, y, slope * dx, slope * dy, sigma * sigma)
    write(belief, out_x, out_P)


@numba.guvectorize(
    "void(f8[:], f8[:, :], f8[:, :], f8[:], f8[:], f8, f8[:], f8[:, :])",
    "(d),(d,d),(n,m),(n),(w),()->(d),(d,d)",
    **FAST,
)
def fused(x, P, packets, ranges, weights, sigma, out_x, out_P):
    """Covariance intersection with the teammates that were heard, one after the other."""
    best = x[0], x[1], P[0, 0], P[0, 1], P[1, 1]
    for j in range(len(ranges)):
        if np.isnan(ranges[j]) or np.isnan(packets[j, 0]) or ranges[j] < TOO_NEAR_TO_RANGE:
            continue
        own = best
        dx, dy = own[0] - packets[j, 0], own[1] - packets[j, 1]
        d = np.sqrt(dx * dx + dy * dy)
        hx, hy = dx / max(d, NEAR), dy / max(d, NEAR)
        spread = packets[j, 2] * hx * hx + 2 * packets[j, 3] * hx * hy + packets[j, 5] * hy * hy
        for i in range(len(weights)):
            w = weights[i]
            wider = own[0], own[1], own[2] / w, own[3] / w, own[4] / w
            found = update(wider, ranges[j] - d, hx, hy, sigma * sigma + spread / (1 - w))
            if found[2] + found[4] < best[2] + best[4]:
                best = found
    write(best, out_x, out_P)


class State(NamedTuple):
    """What the robots remember."""

    x: np.ndarray  # (r, 2) [m]
    P: np.ndarray  # (r, 2, 2)
    world: object


@dataclass(frozen=True)
class Compiled:
    """EKF on own readings, covariance intersection with received beliefs by range; compiled."""

    api: ClassVar[int] = 1
    uses: tuple[str, ...] = ("odometry", "anchor_rssi", "radio_range")

    def init(self, prior, world, rows):
        return State(prior.x, prior.P, world)

    def predict(self, s, z):
        x, _, Q = s.world.motion.move(s.x, z.odometry, z.dt)
        return s._replace(x=x, P=s.P + Q)

    def correct(self, s, z):
        radio = s.world.sensors["anchor_rssi"]
        x, P = anchored(s.x, s.P, z.anchor_rssi, s.world.anchors, radio.A, radio.eta, radio.sigma)
        return s._replace(x=x, P=P)

    def send(self, s, z):
        return np.concatenate([s.x, s.P.reshape(-1, 4)], -1)

    def fuse(self, s, z, mail):
        x, P = fused(s.x, s.P, mail.packets, mail.range, WEIGHTS, s.world.sensors["radio_range"].sigma)
        return s._replace(x=x, P=P)

    def estimate(self, s):
        return Belief(s.x, s.P)
