"""GTSAM: every tick's most probable state, given the belief before it and its readings, by Levenberg and Marquardt."""

import gtsam
import numpy as np

from cooploc import Belief


class GtsamMap:
    """One robot."""

    uses = ("odometry", "anchor_rssi|landmark")

    def __init__(self, prior, world, robot, key):
        self.x, self.P, self.world = *prior, world

    def predict(self, z):
        self.x, F, Q = self.world.motion.move(self.x, z.odometry, z.dt)
        self.P = F @ self.P @ F.T + Q

    def correct(self, z):
        graph, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
        start.insert(0, self.x)
        graph.add(gtsam.PriorFactorVector(0, self.x, gtsam.noiseModel.Gaussian.Covariance(self.P)))
        for sensor, q, reading in self.world.fixed(z):
            if np.isfinite(reading).all():
                graph.add(factor(sensor, q, reading))
        found = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
        self.x, self.P = found.atVector(0), gtsam.Marginals(graph, found).marginalCovariance(0)

    def estimate(self):
        x = np.concatenate([self.x[:2], np.arctan2(np.sin(self.x[2:]), np.cos(self.x[2:]))])
        return Belief(x, (self.P + self.P.T) / 2)


def factor(sensor, q, reading):
    def error(_, values, slopes):
        y, H, _ = sensor.innovation(values.atVector(0), q, reading)
        if slopes is not None:
            slopes[0] = -H
        return y

    return gtsam.CustomFactor(gtsam.noiseModel.Gaussian.Covariance(sensor.R), [0], error)
