"""The filter of `filterpy_loop.py` with its two loops, over anchors and over teammates, compiled by numba.

A kernel is written for one row; `guvectorize` runs it for all of them, whatever their layout, without ever mixing two.
Leave `fastmath` off: it deletes the tests for nan. It is compiled at every start, in seconds: with `cache=True` we saw
it crash where two processes had filled numba's cache at the same time.

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
def update(x, P, y, h, R):
    """Kalman update of one row, in place, by a scalar reading."""
    g0, g1 = P[0, 0] * h[0] + P[0, 1] * h[1], P[1, 0] * h[0] + P[1, 1] * h[1]
    S = h[0] * g0 + h[1] * g1 + R
    x[0] += g0 / S * y
    x[1] += g1 / S * y
    P[0, 0] -= g0 * g0 / S
    P[1, 1] -= g1 * g1 / S
    P[0, 1] -= g0 * g1 / S
    P[1, 0] = P[0, 1]


@numba.guvectorize(
    "void(f8[:], f8[:, :], f8[:], f8[:, :], f8, f8, f8, f8[:], f8[:, :])",
    "(d),(d,d),(a),(a,d),(),(),()->(d),(d,d)",
    **FAST,
)
def anchored(x, P, rssi, anchors, A, eta, sigma, out_x, out_P):
    """Update by the anchors that were heard, one after the other."""
    out_x[:], out_P[:] = x, P
    h = np.empty(2)
    for a in range(len(rssi)):
        if not np.isnan(rssi[a]):
            h[:] = out_x - anchors[a]
            d2 = h[0] ** 2 + h[1] ** 2
            y = rssi[a] - (A - 5 * eta * np.log10(max(d2, NEAR**2)))
            h *= -10 * eta / np.log(10) / d2 if d2 > NEAR**2 else 0.0
            update(out_x, out_P, y, h, sigma**2)


@numba.guvectorize(
    "void(f8[:], f8[:, :], f8[:, :], f8[:], f8[:], f8, f8[:], f8[:, :])",
    "(d),(d,d),(n,m),(n),(w),()->(d),(d,d)",
    **FAST,
)
def fused(x, P, packets, ranges, weights, sigma, out_x, out_P):
    """Covariance intersection with the teammates that were heard, one after the other."""
    out_x[:], out_P[:] = x, P
    h, x_w, P_w = np.empty(2), np.empty(2), np.empty((2, 2))
    for j in range(len(ranges)):
        if np.isnan(ranges[j]) or np.isnan(packets[j, 0]) or ranges[j] < TOO_NEAR_TO_RANGE:
            continue
        own_x, own_P = out_x.copy(), out_P.copy()
        h[:] = own_x - packets[j, :2]
        d = np.sqrt(h[0] ** 2 + h[1] ** 2)
        h /= max(d, NEAR)
        spread = packets[j, 2] * h[0] ** 2 + 2 * packets[j, 3] * h[0] * h[1] + packets[j, 5] * h[1] ** 2
        for w in weights:
            x_w[:], P_w[:] = own_x, own_P / w
            update(x_w, P_w, ranges[j] - d, h, sigma**2 + spread / (1 - w))
            if P_w[0, 0] + P_w[1, 1] < out_P[0, 0] + out_P[1, 1]:
                out_x[:], out_P[:] = x_w, P_w


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
