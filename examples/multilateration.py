"""Multilateration: the place whose distances to the anchors best fit the ranges that the signals say, tick by tick.

    r_a = 10^((A - z_a) / (10 eta)),  x = argmin sum_a (|x - q_a| - r_a)^2,  P = J+ diag(s)^2 J+'

with s_a = r_a sigma ln 10 / (10 eta). No odometry, no memory: fewer than three signals leave the last place. A baseline
in E. Latif, R. Parasuraman, IEEE Internet of Things Journal 11(2), 2024. The public script (cdoa-localization) takes
the best of points on the circles, one unit apart, and on dataset2 fits the exponent on the true distances of the run.
"""

import numpy as np
from scipy.optimize import least_squares

import cooploc as cl


class Multilateration:
    """One robot."""

    uses, own_motion = ("anchor_rssi",), "none: it has no memory"

    def __init__(self, prior, world, robot, key):
        self.world, self.prior, self.radio = world, prior, world.sensors["anchor_rssi"]
        self.x, self.P = prior.x[:2], prior.P[:2, :2]

    def predict(self, z):
        """It has no motion model."""

    def correct(self, z):
        there = np.isfinite(z.anchor_rssi)
        if there.sum() >= 3:
            q, r = self.world.anchors[there], 10 ** ((self.radio.A - z.anchor_rssi[there]) / (10 * self.radio.eta))
            found = least_squares(lambda x: np.linalg.norm(x - q, axis=1) - r, q.mean(0))
            self.x = np.clip(found.x, *self.world.arena)
            J = np.linalg.pinv(found.jac) * r * self.radio.sigma * np.log(10) / (10 * self.radio.eta)
            self.P = J @ J.T + 1e-6 * np.eye(2)

    def estimate(self):
        x, P = self.prior.x.copy(), self.prior.P.copy()
        x[:2], P[:, :2], P[:2], P[:2, :2] = self.x, 0, 0, self.P
        return cl.Belief(x, P)
