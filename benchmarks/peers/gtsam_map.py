# SPDX-License-Identifier: MIT
"""GTSAM: every tick's most probable state, given the belief before it and its readings, by Levenberg and Marquardt."""

import gtsam
import numpy as np

import cooploc as cl


class GtsamMap:
    """One robot."""

    uses = ("odometry", "anchor_rssi|landmark")

    def __init__(self, prior, world, robot, key):
        self.x, self.P, self.world = *prior, world

    def predict(self, z):
        F, c, Q = cl.motion_of(self.world, z).linear(self.x)
        self.x, self.P = F @ self.x + c, F @ self.P @ F.T + Q

    def correct(self, z):
        graph, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
        start.insert(0, self.x)
        graph.add(gtsam.PriorFactorVector(0, self.x, gtsam.noiseModel.Gaussian.Covariance(self.P)))
        for one in cl.readings_of(self.world, z):
            graph.add(gtsam.CustomFactor(gtsam.noiseModel.Gaussian.Covariance(one.R), [0], error(one)))
        found = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
        self.x, self.P = found.atVector(0), gtsam.Marginals(graph, found).marginalCovariance(0)


def error(one):
    def of(_, values, slopes):
        x = np.array(values.atVector(0))
        if slopes is not None:
            slopes[0] = one.H(x)
        return one.h(x) - one.z

    return of
