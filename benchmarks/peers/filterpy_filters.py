"""filterpy's filters on odometry and anchors or landmarks, each lifted by `PerRobot`.

Linear ones get each model linearised where they are, those of sigma points and of ensembles the model itself.
"""

import warnings

import filterpy.kalman as fk
import numpy as np
from filterpy.hinfinity import HInfinityFilter
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


class Fading(Kalman):
    """KalmanFilter that forgets: P' = alpha^2 F P F' + Q."""

    own_motion = "its uncertainty grows by alpha^2 a tick beside that of odometry"

    def __init__(self, prior, world, robot, key, alpha: float = 1.01):
        super().__init__(prior, world, robot, key)
        self.f.alpha = alpha


class SquareRoot(Kalman):
    """SquareRootKalmanFilter; it wants a Q that has a Cholesky factor."""

    def made(self, prior):
        return super().made(prior, fk.SquareRootKalmanFilter)

    def predict(self, z):
        self.f.F, c, Q = cl.motion_of(self.world, z).linear(self.f.x)
        self.f.Q = Q + 1e-15 * np.eye(len(Q))
        self.f.predict(c)

    def correct(self, z):
        for one in cl.readings_of(self.world, z):
            seen, R, self.f.H = one.linear(self.f.x)
            self.f.update(seen, np.linalg.cholesky(R))


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


class Mmae(Kalman):
    """MMAEFilterBank of the same two; its mixture is made here, as the bank subtracts single coordinates."""

    own_motion = "the mixture of two noises moves by neither"

    def made(self, prior):
        return fk.MMAEFilterBank([super().made(prior), super().made(prior)], [0.5, 0.5], len(prior.x))

    def predict(self, z):
        for f, scale in zip(self.f.filters, (1.0, 9.0), strict=True):
            f.F, c, Q = cl.motion_of(self.world, z).linear(f.x)
            f.Q = scale * Q
            f.predict(c)

    def correct(self, z):
        for one in cl.readings_of(self.world, z):
            self.f.update(*one.linear(self.estimate()[0]))
            self.f.p = np.maximum(self.f.p, 1e-6)

    def estimate(self):
        p, x = self.f.p / np.sum(self.f.p), np.stack([f.x for f in self.f.filters])
        off = x - p @ x
        return p @ x, np.tensordot(p, [f.P + np.outer(e, e) for f, e in zip(self.f.filters, off, strict=True)], 1)


class HInfinity(Kalman):
    """HInfinityFilter, of which filterpy warns that it is likely incorrect; a tick's readings are one vector."""

    own_motion = "it allows for a worst case beside the noise"

    def __init__(self, prior, world, robot, key, gamma: float = 0.01):
        with warnings.catch_warnings(action="ignore"):
            self.world, self.f = world, HInfinityFilter(len(prior.x), 1, 0, gamma)
        self.f.x, self.f.P, self.f.B = *prior, np.eye(len(prior.x))

    def predict(self, z):
        self.f.F, c, self.f.W = cl.motion_of(self.world, z).linear(self.f.x)
        self.f.Q = z.dt * np.eye(len(c))
        self.f.predict(c)

    def correct(self, z):
        y, H, R = self.world.stack(self.f.x, z)
        there = np.isfinite(y)
        self.f.H, self.f._V_inv = H[there], np.linalg.inv(R[np.ix_(there, there)])
        self.f.update(y[there] + H[there] @ self.f.x)


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
