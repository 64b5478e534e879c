"""Differential RSS: the place on a grid that fits the differences of the anchors' signals, in which A cancels.

    e_a = z_a - h_a(x),  x = argmin sum_a (e_a - mean e)^2,  P = the spread of exp(-sum / 2 sigma^2) around x

No odometry, no memory: fewer than three signals leave the last place. A baseline in E. Latif, R. Parasuraman, IEEE
Internet of Things Journal 11(2), 2024. The public script (cdoa-localization) takes no differences of anchors: it keeps
the least sum of e_a, signed, with shadowing drawn for every point.
"""

import numpy as np

import cooploc as cl


class DifferentialRss:
    """One robot."""

    uses, own_motion = ("anchor_rssi",), "none: it has no memory"

    def __init__(self, prior, world, robot, key, cells: int = 60):
        self.prior, self.sigma, self.x, self.P = prior, world.sensors["anchor_rssi"].sigma, prior.x[:2], prior.P[:2, :2]
        self.cell = np.ptp(world.arena, 0) / cells
        self.grid = world.arena[0] + (np.indices((cells, cells)).reshape(2, -1).T + 0.5) * self.cell
        self.level = world.sensors["anchor_rssi"].level(self.grid[:, None], world.anchors)

    def predict(self, z):
        """It has no motion model."""

    def correct(self, z):
        there = np.isfinite(z.anchor_rssi)
        if there.sum() >= 3:
            misfit = there.sum() * (z.anchor_rssi - self.level)[:, there].var(1)
            self.x = self.grid[np.argmin(misfit)]
            w, away = np.exp((misfit.min() - misfit) / (2 * self.sigma**2)), self.grid - self.x
            self.P = (w * away.T) @ away / w.sum() + np.diag(self.cell**2 / 12)

    def estimate(self):
        x, P = self.prior.x.copy(), self.prior.P.copy()
        x[:2], P[:, :2], P[:2], P[:2, :2] = self.x, 0, 0, self.P
        return cl.Belief(x, P)
