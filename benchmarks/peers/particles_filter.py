"""A bootstrap filter of the library `particles`, one tick at a time; it resamples by numpy's global state."""

import numpy as np
import particles

import cooploc as cl


class Model(particles.FeynmanKac):
    """Moves by the tick's odometry with its error drawn; weighs by the tick's readings."""

    def __init__(self, prior, world, key):
        self.prior, self.world, self.rng, self.z = prior, world, np.random.default_rng(key), None

    def done(self, smc):
        return False

    def M0(self, N):
        return self.M(0, self.rng.multivariate_normal(*self.prior, N))

    def M(self, t, xp):
        return cl.motion_of(self.world, self.z).sample(xp, self.rng.standard_normal((len(xp), 2)))

    def logG(self, t, xp, x):
        off = [(one.z - one.h(x), one.R) for one in cl.readings_of(self.world, self.z)]
        return -0.5 * sum(((y @ np.linalg.inv(R)) * y).sum(1) for y, R in off) + np.zeros(len(x))


class Bootstrap:
    """One robot."""

    uses = ("odometry", "anchor_rssi|landmark")
    own_random = True
    own_motion = "a cloud of particles moves by what it draws"

    def __init__(self, prior, world, robot, key, N: int = 500):
        self.f = particles.SMC(Model(prior, world, key), N, collect="off")

    def predict(self, z):
        self.f.fk.z = z

    def correct(self, z):
        next(self.f)

    def estimate(self):
        return np.average(self.f.X, 0, self.f.W), np.cov(self.f.X.T, aweights=self.f.W, ddof=0)
