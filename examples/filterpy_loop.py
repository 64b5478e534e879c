"""A cooperative filter as one writes it with filterpy: a plain class for one robot, wrapped by `PerRobot`.

Every robot keeps an extended Kalman filter on its odometry and the anchors, and broadcasts mean and covariance. A robot
that hears a teammate and ranges it corrects itself by covariance intersection: its own covariance is divided by w,
the sender's by 1 - w, so that nothing is counted twice; of three weights and no fusion the smallest trace is kept.

Source: L. C. Carrillo-Arce et al., "Decentralized multi-robot cooperative localization using covariance intersection",
IROS 2013; the weight is searched on a grid here.

    cooploc check examples/filterpy_loop.py:loop
"""

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from cooploc import Belief, PerRobot

WEIGHTS = (0.5, 0.75, 0.9)


class Loop:
    """One robot in a compass frame: x (2,) [m]."""

    def __init__(self, prior, world, robot, key):
        self.world, self.ekf = world, ExtendedKalmanFilter(dim_x=2, dim_z=1)
        self.ekf.x, self.ekf.P, self.ekf.B = prior.x, prior.P, np.eye(2)

    def predict(self, z):
        motion = self.world.motion
        self.ekf.Q = np.eye(2) * motion.sigma**2 * z.dt / motion.tick
        self.ekf.predict(np.nan_to_num(z.odometry))  # absent: it is taken to stand still

    def correct(self, z):
        sensor = self.world.sensors["anchor_rssi"]
        for anchor, rssi in zip(self.world.anchors, z.anchor_rssi, strict=True):
            y, H, _ = sensor.innovation(self.ekf.x, anchor, np.array([rssi]))
            self.update(y, H, sensor.R)

    def send(self):
        return np.concatenate([self.ekf.x, self.ekf.P.ravel()])

    def fuse(self, mail):
        sensor = self.world.sensors["radio_range"]
        for j in np.flatnonzero(mail.heard):
            x_j, P_j = mail.packets[j, :2], mail.packets[j, 2:].reshape(2, 2)
            own = best = Belief(self.ekf.x, self.ekf.P)
            y, H, H_j = sensor.innovation(own.x, x_j, mail.range[[j]])
            for w in WEIGHTS:
                self.ekf.x, self.ekf.P = own.x, own.P / w
                self.update(y, H, sensor.R + H_j @ P_j @ H_j.T / (1 - w))
                if np.trace(self.ekf.P) < np.trace(best.P):
                    best = Belief(self.ekf.x, self.ekf.P)
            self.ekf.x, self.ekf.P = best

    def estimate(self):
        return Belief(self.ekf.x, self.ekf.P)

    def update(self, y, H, R):
        """The world's models linearise; filterpy wants functions."""
        if np.isfinite(y).all():  # nan: the reading is absent
            self.ekf.update(y, HJacobian=lambda _: H, Hx=lambda _: np.zeros(1), R=R)


loop = PerRobot(Loop, uses=("odometry", "anchor_rssi", "radio_range"))
