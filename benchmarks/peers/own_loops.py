"""What one writes without a library: multilateration without odometry, and odometry by Euler's integration."""

import numpy as np
from scipy.optimize import least_squares

import cooploc as cl


class Multilateration:
    """Where four or more signals, or the landmarks that are seen, say the robot is in this tick; no odometry."""

    uses = ("anchor_rssi|landmark",)

    def __init__(self, prior, world, robot, key, pull: float = 0.05):
        self.x, self.P = prior
        self.prior, self.world, self.pull = prior, world, pull  # pull: weight of the last estimate, against ambiguity

    def predict(self, z):
        pass

    def correct(self, z):
        seen = [(one, np.linalg.cholesky(np.linalg.inv(one.R)).T) for one in cl.readings_of(self.world, z)]
        own = self.pull * np.linalg.cholesky(np.linalg.inv(self.prior.P)).T
        before = self.x
        if seen:
            found = least_squares(
                lambda x: np.concatenate([own @ (x - before), *(W @ (one.h(x) - one.z) for one, W in seen)]),
                before,
                lambda x: np.concatenate([own, *(W @ one.H(x) for one, W in seen)]),
            )
            self.x, self.P = found.x, np.linalg.inv(found.jac.T @ found.jac)


class Euler:
    """An extended Kalman filter that drives the whole tick in the direction in which it began."""

    uses = ("odometry", "anchor_rssi|landmark")
    own_motion = "it integrates odometry by Euler's method"

    def __init__(self, prior, world, robot, key):
        self.x, self.P, self.world = *prior, world

    def predict(self, z):
        _, F, Q = self.world.motion.move(self.x, z.odometry, z.dt)
        u = np.nan_to_num(z.odometry)
        if len(self.x) == 3:
            v, omega = u * z.dt
            u = np.array([v * np.cos(self.x[2]), v * np.sin(self.x[2]), omega])
        self.x, self.P = self.x + u, F @ self.P @ F.T + Q

    def correct(self, z):
        for one in cl.readings_of(self.world, z):
            seen, R, H = one.linear(self.x)
            K = np.linalg.solve(H @ self.P @ H.T + R, H @ self.P).T
            I_KH = np.eye(len(self.x)) - K @ H
            self.x, self.P = self.x + K @ (seen - H @ self.x), I_KH @ self.P @ I_KH.T + K @ R @ K.T
