# SPDX-License-Identifier: MIT
"""Stone Soup's extended Kalman and particle updaters on the world's models; the world's motion predicts."""

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.resampler.particle import ESSResampler
from stonesoup.types.array import StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction, ParticleStatePrediction
from stonesoup.updater.kalman import ExtendedKalmanUpdater
from stonesoup.updater.particle import ParticleUpdater

import cooploc as cl


class Model(NonLinearGaussianMeasurement):
    """h(x) of one reading, at one state or at a cloud of them."""

    reading: object = Property()
    ndim_meas = property(lambda self: len(self.reading.z))

    def function(self, state, noise=False, **_):
        return self.reading.h(np.asarray(state.state_vector, float).T).T

    def jacobian(self, state, **_):
        return self.reading.H(state.state_vector.ravel().astype(float))


class StoneSoupEkf:
    """One robot."""

    uses = ("odometry", "anchor_rssi|landmark")

    def __init__(self, prior, world, robot, key):
        self.x, self.P, self.world = *prior, world

    def predict(self, z):
        F, c, Q = cl.motion_of(self.world, z).linear(self.x)
        self.x, self.P = F @ self.x + c, F @ self.P @ F.T + Q

    def correct(self, z):
        for one in cl.readings_of(self.world, z):
            seen = Detection(one.z[:, None], measurement_model=Model(len(self.x), None, one.R, reading=one))
            before = GaussianStatePrediction(self.x[:, None], self.P)
            after = ExtendedKalmanUpdater(None).update(SingleHypothesis(before, seen))
            self.x, self.P = after.state_vector.ravel().astype(float), after.covar


class StoneSoupParticles:
    """One robot; the library resamples by numpy's global state."""

    uses = ("odometry", "anchor_rssi|landmark")
    own_random = True
    own_motion = "a cloud of particles moves by what it draws"

    def __init__(self, prior, world, robot, key, N: int = 500):
        self.world, self.updater = world, ParticleUpdater(None, resampler=ESSResampler())
        self.rng = np.random.default_rng(key)
        self.points, self.logs = self.rng.multivariate_normal(*prior, N), np.full(N, -np.log(N))

    def predict(self, z):
        noise = self.rng.standard_normal((len(self.points), 2))
        self.points = cl.motion_of(self.world, z).sample(self.points, noise)

    def correct(self, z):
        for one in cl.readings_of(self.world, z):
            seen = Detection(one.z[:, None], measurement_model=Model(self.points.shape[1], None, one.R, reading=one))
            before = ParticleStatePrediction(StateVectors(self.points.T), log_weight=self.logs)
            after = self.updater.update(SingleHypothesis(before, seen))
            self.points, self.logs = np.array(after.state_vector, float).T, np.array(after.log_weight, float)

    def estimate(self):
        w = np.exp(self.logs)
        return np.average(self.points, 0, w), np.cov(self.points.T, aweights=w, ddof=0)
