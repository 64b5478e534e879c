"""A filter that estimates the bias of its own radio ranges beside its position.

State (x, y, heading where there is one, b): a range to a teammate reads d + b, as where the antenna's delay is not
calibrated; b drifts slowly. Beliefs of teammates come by radio, and their covariance is doubled: a crude guard against
counting the same reading twice, which `ekf-ci` does better.

    cooploc check examples/range_bias.py:RangeBias
    cooploc run quick --estimators ekf-local,examples/range_bias.py:RangeBias[bias=0.5]
"""

import numpy as np

import cooploc as cl


class RangeBias:
    """One robot."""

    uses = ("odometry", "anchor_rssi|landmark", "radio_range")

    def __init__(
        self,
        prior,
        world,
        robot,
        key,
        bias: float = cl.tunable(0.2, 0.01, 2, log=True),  # its sd at first [m]
        drift: float = 0.002,  # its sd after a second more [m]
    ):
        d = len(prior.x)
        self.layout, self.drift = cl.Layout(d + 1, heading=2 if d == 3 else None), drift
        self.world = self.layout.world(world)
        self.x, self.P = self.layout.prior(prior, [bias**2])

    def predict(self, z):
        self.x, F, Q = self.world.motion.move(self.x, z.odometry, z.dt)
        Q[-1, -1] = self.drift**2 * z.dt
        self.P = F @ self.P @ F.T + Q

    def correct(self, z):
        for sensor, place, reading in self.world.fixed(z):
            y, H, _ = sensor.innovation(self.x, place, reading)
            self.update(y, H, sensor.R)

    def send(self):
        return np.concatenate([self.x[:2], self.P[:2, :2].ravel()])

    def fuse(self, mail):
        ranging = self.world.sensors["radio_range"]
        for j in np.flatnonzero(mail.heard):
            x_j, P_j = mail.packets[j, :2], 2 * mail.packets[j, 2:].reshape(2, 2)
            y, H, H_j = ranging.innovation(self.x, x_j, mail.range[[j]] - self.x[-1])
            H[:, -1] = 1.0  # the bias is read as it is
            self.update(y, H, ranging.R + H_j @ P_j @ H_j.T)

    def estimate(self):
        x, P = self.layout.estimate(self.x, self.P)
        x[2:] = np.arctan2(np.sin(x[2:]), np.cos(x[2:]))
        return cl.Belief(x, (P + P.T) / 2)

    def update(self, y, H, R):
        if np.isfinite(y).all():  # nan: the reading is absent
            K = np.linalg.solve(H @ self.P @ H.T + R, H @ self.P).T
            I_KH = np.eye(len(self.x)) - K @ H
            self.x, self.P = self.x + K @ y, I_KH @ self.P @ I_KH.T + K @ R @ K.T
