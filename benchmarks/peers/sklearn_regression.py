"""scikit-learn: a tick's readings and the belief before it, whitened, as the rows of a linear regression."""

import numpy as np
from sklearn.linear_model import LinearRegression

import cooploc as cl


class SklearnRegression:
    """One robot."""

    uses = ("odometry", "anchor_rssi|landmark")

    def __init__(self, prior, world, robot, key):
        self.x, self.P, self.world = *prior, world

    def predict(self, z):
        F, c, Q = cl.motion_of(self.world, z).linear(self.x)
        self.x, self.P = F @ self.x + c, F @ self.P @ F.T + Q

    def correct(self, z):
        y, H, R = self.world.stack(self.x, z)
        there, own = np.isfinite(y), np.linalg.inv(np.linalg.cholesky(self.P))
        white = np.linalg.inv(np.linalg.cholesky(R[np.ix_(there, there)]))
        rows = np.concatenate([own, white @ H[there]])
        fit = LinearRegression(fit_intercept=False).fit(rows, np.concatenate([np.zeros(len(own)), white @ y[there]]))
        self.x, self.P = self.x + fit.coef_, np.linalg.inv(rows.T @ rows)
