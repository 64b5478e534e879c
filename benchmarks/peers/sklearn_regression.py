"""scikit-learn: a tick's readings and the belief before it, whitened, as the rows of a linear regression."""

import numpy as np
from sklearn.linear_model import LinearRegression

from cooploc import Belief


class SklearnRegression:
    """One robot."""

    uses = ("odometry", "anchor_rssi|landmark")

    def __init__(self, prior, world, robot, key):
        self.x, self.P, self.world = *prior, world

    def predict(self, z):
        self.x, F, Q = self.world.motion.move(self.x, z.odometry, z.dt)
        self.P = F @ self.P @ F.T + Q

    def correct(self, z):
        y, H, R = self.world.stacked(self.x, z)
        there = np.isfinite(y)
        white, own = (
            np.linalg.inv(np.linalg.cholesky(R[np.ix_(there, there)])),
            np.linalg.inv(np.linalg.cholesky(self.P)),
        )
        rows = np.concatenate([own, white @ H[there]])
        fit = LinearRegression(fit_intercept=False).fit(rows, np.concatenate([np.zeros(len(own)), white @ y[there]]))
        self.x, self.P = self.x + fit.coef_, np.linalg.inv(rows.T @ rows)

    def estimate(self):
        x = np.concatenate([self.x[:2], np.arctan2(np.sin(self.x[2:]), np.cos(self.x[2:]))])
        return Belief(x, (self.P + self.P.T) / 2)
