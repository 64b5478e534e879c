# SPDX-License-Identifier: MIT
"""navlie's extended Kalman filter, on a state that is a vector; its models are those of the world."""

import navlie
from navlie.lib.states import VectorState

import cooploc as cl


class Motion(navlie.ProcessModel):
    """A tick's motion, which navlie passes on as the input."""

    def evaluate(self, x, u, dt):
        return VectorState(u.f(x.value), x.stamp)

    def jacobian(self, x, u, dt):
        return u.linear(x.value)[0]

    def covariance(self, x, u, dt):
        return u.Q(x.value)


class Seen(navlie.MeasurementModel):
    """A reading of an anchor or landmark."""

    def __init__(self, one):
        self.one = one

    def evaluate(self, x):
        return self.one.h(x.value)

    def jacobian(self, x):
        return self.one.H(x.value)

    def covariance(self, x):
        return self.one.R


class NavlieEkf:
    """ExtendedKalmanFilter."""

    uses = ("odometry", "anchor_rssi|landmark")
    filter = navlie.ExtendedKalmanFilter(Motion())

    def __init__(self, prior, world, robot, key):
        self.belief, self.world = navlie.StateWithCovariance(VectorState(prior.x, 0.0), prior.P), world

    def predict(self, z):
        self.belief = self.filter.predict(self.belief, cl.motion_of(self.world, z), z.dt)

    def correct(self, z):
        for one in cl.readings_of(self.world, z):
            self.belief = self.filter.correct(self.belief, navlie.Measurement(one.z, model=Seen(one)), None)

    def estimate(self):
        return self.belief.state.value, self.belief.covariance
