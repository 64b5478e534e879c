# SPDX-License-Identifier: MIT
"""filterpy's filters on odometry and anchors or landmarks, each wrapped by `PerRobot`.

Linear ones get each model linearised where they are, those of sigma points and of ensembles the model itself.
"""

import filterpy.kalman as fk
import numpy as np
from filterpy.kalman.CubatureKalmanFilter import spherical_radial_sigmas

import cooploc as cl


class Kalman:
    """KalmanFilter."""

    uses = ("odometry", "anchor_rssi|landmark")

    def __init__(self, prior, world, robot, key):
        self.world = world
        self.f = self.made(prior)

    def made(self, prior, kind=fk.KalmanFilter):
        (sensor,) = self.world.sensors.values()
        f = kind(len(prior.x), len(sensor.R))
        f.x, f.P, f.B = *prior, np.eye(len(prior.x))
        return f

    def predict(self, z):
        self.f.F, c, self.f.Q = cl.motion_of(self.world, z).linear(self.f.x)
        self.f.predict(c)

    def correct(self, z):
        for one in cl.readings_of(self.world, z):
            self.f.update(*one.linear(self.f.x))

    def estimate(self):
        return self.f.x, self.f.P


class Imm(Kalman):
    """IMMEstimator of two noises of motion."""

    own_motion = "the mixture of two noises moves by neither"

    def made(self, prior):
        both = [super().made(prior), super().made(prior)]
        return fk.IMMEstimator(both, [0.5, 0.5], np.array([[0.95, 0.05], [0.05, 0.95]]))

    def predict(self, z):
        for f, scale in zip(self.f.filters, (1.0, 9.0), strict=True):
            f.F, c, Q = cl.motion_of(self.world, z).linear(self.f.x)
            f.Q = scale * Q
        self.f.predict(c)

    def correct(self, z):
        for one in cl.readings_of(self.world, z):
            for f in self.f.filters:
                seen, f.R, f.H = one.linear(self.f.x)
            self.f.update(seen)


class Ukf(Kalman):
    """UnscentedKalmanFilter with Merwe's scaled sigma points."""

    axes = "its sigma points lie along the axes"
    own_motion = "an unscented mean of a turning robot differs from its dead reckoning"

    def __init__(self, prior, world, robot, key, alpha: float = 0.5):
        d = len(prior.x)
        points = fk.MerweScaledSigmaPoints(d, alpha, 2.0, 3.0 - d)
        self.world, self.f = world, fk.UnscentedKalmanFilter(d, 1, 1.0, None, None, points)
        self.f.x, self.f.P = prior

    def predict(self, z):
        step = cl.motion_of(self.world, z)
        self.f.Q = step.Q(self.f.x)
        self.f.predict(fx=lambda x, dt: step.f(x))

    def correct(self, z):
        for one in cl.readings_of(self.world, z):
            self.f.sigmas_f = self.f.points_fn.sigma_points(self.f.x, self.f.P)
            self.f.update(one.z, one.R, hx=one.h)


class Ckf(Kalman):
    """CubatureKalmanFilter, whose state is a column."""

    axes = "its cubature points lie along the axes"
    own_motion = "a mean over points of a turning robot differs from its dead reckoning"

    def made(self, prior):
        (sensor,) = self.world.sensors.values()
        f = fk.CubatureKalmanFilter(len(prior.x), len(sensor.R), 1.0, None, None)
        f.x, f.P = prior
        return f

    def predict(self, z):
        step = cl.motion_of(self.world, z)
        self.f.Q, self.f.fx = step.Q(self.f.x.ravel()), lambda x, dt: step.f(x)
        self.f.predict()

    def correct(self, z):
        for one in cl.readings_of(self.world, z):
            self.f.sigmas_f, self.f.hx = spherical_radial_sigmas(self.f.x, self.f.P), one.h
            self.f.update(one.z[:, None], one.R)


class Enkf(Kalman):
    """EnsembleKalmanFilter, which draws from numpy's global state."""

    own_random = True
    own_motion = "an ensemble moves by what it draws"

    def __init__(self, prior, world, robot, key, N: int = 30):
        self.world, self.f = world, fk.EnsembleKalmanFilter(*prior, 1, 1.0, N, None, None)

    def predict(self, z):
        step = cl.motion_of(self.world, z)
        self.f.Q, self.f.fx = step.Q(self.f.x), lambda x, dt: step.f(x)
        self.f.predict()

    def correct(self, z):
        for one in cl.readings_of(self.world, z):
            self.f.hx, self.f._mean_z = one.h, np.zeros(len(one.z))
            self.f.update(one.z, one.R)

    def estimate(self):
        return self.f.sigmas.mean(0), np.cov(self.f.sigmas.T)
