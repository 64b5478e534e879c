"""Weighted centroid: the mean of the anchors, each weighted by the inverse of the range that its signal says.

    w_a ~ 10^((z_a - A) / (10 eta)),  x = sum_a w_a q_a / sum_a w_a,  P = sum_a w_a (q_a - x)(q_a - x)' / sum_a w_a

A cancels. No odometry, no memory: without signals the last place stays. P is the spread of the weighted anchors, for
want of a theory. A baseline in E. Latif, R. Parasuraman, IEEE Internet of Things Journal 11(2), 2024. The public script
(cdoa-localization) computes the same; on dataset2 with an exponent fitted on the true distances of the run.
"""

import numpy as np

import cooploc as cl


class WeightedCentroid:
    """One robot."""

    uses, own_motion = ("anchor_rssi",), "none: it has no memory"

    def __init__(self, prior, world, robot, key):
        self.world, self.prior = world, prior
        self.x, self.P = prior.x[:2], prior.P[:2, :2]

    def predict(self, z):
        """It has no motion model."""

    def correct(self, z):
        there = np.isfinite(z.anchor_rssi)
        if there.any():
            level, q = z.anchor_rssi[there], self.world.anchors[there]
            w = 10 ** ((level - level.max()) / (10 * self.world.sensors["anchor_rssi"].eta))
            self.x = w @ q / w.sum()
            self.P = (w * (q - self.x).T) @ (q - self.x) / w.sum() + 1e-6 * np.eye(2)

    def estimate(self):
        x, P = self.prior.x.copy(), self.prior.P.copy()
        x[:2], P[:, :2], P[:2], P[:2, :2] = self.x, 0, 0, self.P
        return cl.Belief(x, P)
