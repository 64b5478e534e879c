"""Markov localization: a histogram over places of the arena, moved by odometry and read by the anchors' signals.

    p'(i) = sum_j N(x_i; x_j + u, s^2) p(j),  p(i) ~ p'(i) prod_a N(z_a; h_a(i), sigma^2)

A baseline in E. Latif, R. Parasuraman, IEEE Internet of Things Journal 11(2), 2024. The public script
(cdoa-localization) keeps the point of the best direction, and has no memory. The heading here is that of odometry.
"""

import numpy as np
from scipy.linalg import block_diag
from scipy.stats import norm


class MarkovGrid:
    """One robot."""

    uses, own_motion = ("odometry", "anchor_rssi"), "its cells end at the walls"

    def __init__(self, prior, world, robot, key, cells: int = 40):
        self.world, self.pose, self.P, self.cell = world, prior.x, prior.P, np.ptp(world.arena, 0) / cells
        self.axes = world.arena[0] + (np.arange(cells)[:, None] + 0.5) * self.cell
        self.p = np.outer(*norm.pdf(self.axes, prior.x[:2], (self.P.diagonal()[:2] + self.cell**2) ** 0.5).T).ravel()
        self.places = np.stack(np.meshgrid(*self.axes.T, indexing="ij"), -1).reshape(-1, 2)

    def predict(self, z):
        before, (self.pose, F, Q) = self.pose, self.world.motion.move(self.pose, z.odometry, z.dt)
        self.P = F[:, 2:] @ self.P[2:, 2:] @ F[:, 2:].T + Q
        k, s = np.arange(-1, 2).reshape(3, 1, 1, 1) * self.cell, np.sqrt(self.P.diagonal()[:2] + 1e-6)
        t = self.axes[:, None] - self.axes - (self.pose - before)[:2] + k  # from anywhere in a cell to anywhere
        K = np.diff(t * norm.cdf(t / s) + s * norm.pdf(t / s), 2, axis=0)[0].clip(0) / self.cell
        self.p = (K[..., 0] @ self.p.reshape(len(K), -1) @ K[..., 1].T).ravel()

    def correct(self, z):
        radio = self.world.sensors["anchor_rssi"]
        misfit = np.nansum((z.anchor_rssi - radio.level(self.places[:, None], self.world.anchors)) ** 2, 1)
        self.p = (self.p / self.p.sum() + 1e-100) * np.exp((misfit.min() - misfit) / (2 * radio.sigma**2))

    def estimate(self):
        P = np.cov(self.places.T, aweights=self.p, bias=True) + np.diag(self.cell**2 / 12)
        return np.r_[self.p @ self.places / self.p.sum(), self.pose[2:]], block_diag(P, self.P[2:, 2:])
