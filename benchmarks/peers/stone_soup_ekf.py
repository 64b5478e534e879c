"""Stone Soup's extended Kalman updater on the world's models; its prediction is the world's motion."""

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.updater.kalman import ExtendedKalmanUpdater

from cooploc import Belief


class Reading(NonLinearGaussianMeasurement):
    """h(x) - z of one reading, so that what is measured is 0 and no angle needs a type."""

    innovation: object = Property()
    ndim_meas = property(lambda self: len(self.noise_covar))

    def function(self, state, noise=False, **_):
        return -self.innovation(state.state_vector.ravel().astype(float))[0][:, None]

    def jacobian(self, state, **_):
        return self.innovation(state.state_vector.ravel().astype(float))[1]


class StoneSoupEkf:
    """One robot."""

    uses = ("odometry", "anchor_rssi|landmark")

    def __init__(self, prior, world, robot, key):
        self.x, self.P, self.world = *prior, world

    def predict(self, z):
        self.x, F, Q = self.world.motion.move(self.x, z.odometry, z.dt)
        self.P = F @ self.P @ F.T + Q

    def correct(self, z):
        for s, q, r in self.world.fixed(z):
            if np.isfinite(r).all():
                model = Reading(len(self.x), None, s.R, innovation=lambda x, s=s, q=q, r=r: s.innovation(x, q, r))
                seen = Detection(np.zeros((len(r), 1)), measurement_model=model)
                before = GaussianStatePrediction(self.x[:, None], self.P)
                after = ExtendedKalmanUpdater(None).update(SingleHypothesis(before, seen))
                self.x, self.P = after.state_vector.ravel().astype(float), np.array(after.covar, float)

    def estimate(self):
        x = np.concatenate([self.x[:2], np.arctan2(np.sin(self.x[2:]), np.cos(self.x[2:]))])
        return Belief(x, (self.P + self.P.T) / 2)
