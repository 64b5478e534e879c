"""navlie's extended Kalman filter, or its iterated one, on the world's models."""

import navlie as nav
from navlie.lib.states import VectorState

import cooploc as cl


class Motion(nav.types.ProcessModel):
    """x' = f(x), the step of a tick as the input."""

    def evaluate(self, x, step, dt):
        return VectorState(step.f(x.value), x.stamp)

    def jacobian(self, x, step, dt):
        return step.linear(x.value).F

    def covariance(self, x, step, dt):
        return step.Q(x.value)


class Model(nav.types.MeasurementModel):
    """z = h(x) of one reading."""

    def __init__(self, one):
        self.one = one

    def evaluate(self, x):
        return self.one.h(x.value)

    def jacobian(self, x):
        return self.one.H(x.value)

    def covariance(self, x):
        return self.one.R


class NavlieEkf:
    """One robot."""

    uses = ("odometry", "anchor_rssi|landmark")

    def __init__(self, prior, world, robot, key, iterated: bool = False):
        self.world, self.f = world, (nav.IteratedKalmanFilter if iterated else nav.ExtendedKalmanFilter)(Motion())
        self.s = nav.StateWithCovariance(VectorState(prior.x, 0.0), prior.P)

    def predict(self, z):
        self.s = self.f.predict(self.s, cl.motion_of(self.world, z), z.dt)

    def correct(self, z):
        for one in cl.readings_of(self.world, z):
            self.s = self.f.correct(self.s, nav.Measurement(one.z, None, Model(one)), None)

    def estimate(self):
        return self.s.state.value, self.s.covariance
