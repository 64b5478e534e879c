"""A filter with velocities in its state, on anchors alone: no odometry.

State (x, y, vx, vy): white acceleration moves the velocity, anchors correct the position, and through their correlation
the velocity. `Layout` shows the world's sensors such a state.

    v' = v + a dt,  Q = s^2 [[dt^3/3, dt^2/2], [dt^2/2, dt]] per axis

Source: Y. Bar-Shalom, X. Li, T. Kirubarajan, "Estimation with applications to tracking and navigation", 2001, sec.
6.2.2 (the discretised continuous white noise acceleration).

    cooploc check examples/constant_velocity.py:ConstantVelocity
    cooploc run quick --estimators ekf-local,examples/constant_velocity.py:ConstantVelocity[jerk=0.1]
"""

import numpy as np

import cooploc as cl


class ConstantVelocity:
    """One robot."""

    uses = ("anchor_rssi|landmark",)

    def __init__(
        self,
        prior,
        world,
        robot,
        key,
        speed: float = cl.tunable(0.3, 0.05, 2, log=True),  # sd of the velocity at first, per axis [m/s]
        jerk: float = cl.tunable(0.1, 0.01, 1, log=True),  # sd of the acceleration over a second, per axis [m/s^2]
    ):
        d = len(prior.x)  # 3: with a heading, which stays where it is and grows uncertain
        self.layout = cl.Layout(d + 2, heading=2 if d == 3 else None)
        self.world, self.jerk, self.v = self.layout.world(world), jerk, [d, d + 1]
        self.x, self.P = self.layout.prior(prior, [speed**2] * 2)

    def predict(self, z):
        F, Q = np.eye(len(self.x)), np.zeros_like(self.P)
        for at, v in enumerate(self.v):
            F[at, v] = z.dt
            Q[np.ix_([at, v], [at, v])] = self.jerk**2 * np.array([[z.dt**3 / 3, z.dt**2 / 2], [z.dt**2 / 2, z.dt]])
        if self.layout.heading:
            Q[2, 2] = z.dt  # it may turn as it likes
        self.x, self.P = F @ self.x, F @ self.P @ F.T + Q

    def correct(self, z):
        y, H, R = self.world.stack(self.x, z)
        there = np.isfinite(y)
        y, H, R = y[there], H[there], R[np.ix_(there, there)]
        K = np.linalg.solve(H @ self.P @ H.T + R, H @ self.P).T
        I_KH = np.eye(len(self.x)) - K @ H
        self.x, self.P = self.x + K @ y, I_KH @ self.P @ I_KH.T + K @ R @ K.T

    def estimate(self):
        x, P = self.layout.estimate(self.x, self.P)
        x[2:] = np.arctan2(np.sin(x[2:]), np.cos(x[2:]))
        return cl.Belief(x, (P + P.T) / 2)
