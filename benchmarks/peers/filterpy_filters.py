"""filterpy's filters on odometry and anchors or landmarks, each lifted by `PerRobot`.

Linear filters get each model linearised where they are: x' = F x + c, z = H x + (z - h(x)). Those of sigma points and
of ensembles get the model itself; what they are given of a reading is its innovation, so no angle is averaged.
"""

import filterpy.kalman as fk
import numpy as np
from filterpy.kalman.CubatureKalmanFilter import spherical_radial_sigmas

from cooploc import Belief


class Kalman:
    """filterpy's KalmanFilter."""

    uses = ("odometry", "anchor_rssi|landmark")

    def __init__(self, prior, world, robot, key):
        self.world, self.f = world, self.made(prior)

    def made(self, prior, kind=fk.KalmanFilter, scale=1.0):
        f = kind(len(prior.x), 1, len(prior.x))
        f.x, f.P, f.B, f.scale = prior.x.copy(), prior.P.copy(), np.eye(len(prior.x)), scale
        return f

    def parts(self):
        return [self.f]

    def predict(self, z):
        x, F, Q = self.world.motion.move(self.f.x, z.odometry, z.dt)
        for f in self.parts():
            f.F, f.Q = F, f.scale * Q
        self.f.predict(x - F @ self.f.x)

    def correct(self, z):
        for sensor, q, reading in self.world.fixed(z):
            y, H, _ = sensor.innovation(self.f.x, q, reading)
            if np.isfinite(y).all():
                self.update(y + H @ self.f.x, H, sensor.R)

    def update(self, z, H, R):
        self.f.update(z, R, H)

    def estimate(self):
        x = np.concatenate([self.f.x[:2], np.arctan2(np.sin(self.f.x[2:]), np.cos(self.f.x[2:]))])
        return Belief(x, (self.f.P + self.f.P.T) / 2)


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
        x, F, Q = self.world.motion.move(self.f.x, z.odometry, z.dt)
        self.f.F, self.f.Q = F, Q + 1e-15 * np.eye(len(x))
        self.f.predict(x - F @ self.f.x)

    def update(self, z, H, R):
        self.f.dim_z, self.f.M = len(z), np.zeros((len(z) + len(self.f.x),) * 2)
        self.f.H = H
        self.f.update(z, np.linalg.cholesky(R))


class Imm(Kalman):
    """IMMEstimator of two noises of motion."""

    own_motion = "the mixture of two noises moves by neither"

    def made(self, prior):
        models = [super(Imm, self).made(prior, scale=scale) for scale in (1.0, 9.0)]
        return fk.IMMEstimator(models, [0.5, 0.5], np.array([[0.95, 0.05], [0.05, 0.95]]))

    def parts(self):
        return self.f.filters

    def update(self, z, H, R):
        for f in self.parts():
            f.H, f.R, f.dim_z = H, R, len(z)
        self.f.update(z)


class Mmae(Imm):
    """MMAEFilterBank of the same two; its covariance is made here, as the bank subtracts single coordinates."""

    def made(self, prior):
        return fk.MMAEFilterBank(super().made(prior).filters, [0.5, 0.5], len(prior.x))

    def predict(self, z):
        super().predict(z)
        self.merge()

    def update(self, z, H, R):
        self.f.update(z, R, H)
        self.f.p = np.maximum(self.f.p, 1e-6)
        self.merge()

    def merge(self):
        p, x = self.f.p / sum(self.f.p), np.stack([f.x for f in self.parts()])
        self.f.x = p @ x
        spread = [f.P + np.outer(f.x - self.f.x, f.x - self.f.x) for f in self.parts()]
        self.f.P = np.tensordot(p, spread, 1)


class Ukf(Kalman):
    """UnscentedKalmanFilter with Merwe's scaled sigma points."""

    axes = "its sigma points lie along the axes"
    own_motion = "an unscented mean of a turning robot differs from its dead reckoning"

    def __init__(self, prior, world, robot, key, alpha: float = 0.5):
        self.alpha = alpha
        super().__init__(prior, world, robot, key)

    def made(self, prior):
        n = len(prior.x)
        points = fk.MerweScaledSigmaPoints(n, self.alpha, 2.0, 3.0 - n)
        f = fk.UnscentedKalmanFilter(n, 1, 1.0, None, None, points)
        f.x, f.P = prior.x.copy(), prior.P.copy()
        return f

    def predict(self, z):
        move = self.world.motion.move
        self.f.Q = move(self.f.x, z.odometry, z.dt)[2]
        self.f.fx = lambda x, dt: moved(move, x, z)
        self.f.predict(dt=z.dt)

    def correct(self, z):
        for sensor, q, reading in self.world.fixed(z):
            if np.isfinite(reading).all():
                self.renew()
                self.f.hx = lambda x, s=sensor, q=q, r=reading: -s.innovation(x, q, r)[0]
                self.observe(np.zeros(len(reading)), sensor.R)

    def renew(self):
        self.f.sigmas_f = self.f.points_fn.sigma_points(self.f.x, self.f.P)

    def observe(self, z, R):
        self.f.update(z, R)


class Ckf(Ukf):
    """CubatureKalmanFilter."""

    axes = "its cubature points lie along the axes"

    def made(self, prior):
        f = fk.CubatureKalmanFilter(len(prior.x), 1, 1.0, None, None)
        f.x, f.P = prior.x.copy(), prior.P.copy()
        return f

    def predict(self, z):
        super().predict(z)
        self.f.x = self.f.x.ravel()

    def renew(self):
        self.f.sigmas_f = spherical_radial_sigmas(self.f.x, self.f.P)

    def observe(self, z, R):
        self.f.dim_z, self.f.sigmas_h = len(z), np.zeros((2 * len(self.f.x), len(z)))
        self.f.residual_z = lambda a, b: a - b.ravel()
        self.f.update(z, R)
        self.f.x = self.f.x.ravel()


class Enkf(Ukf):
    """EnsembleKalmanFilter, which draws from numpy's global state."""

    axes = ""
    own_random = True

    def __init__(self, prior, world, robot, key, N: int = 30):
        self.N = N
        super().__init__(prior, world, robot, key)

    def made(self, prior):
        return fk.EnsembleKalmanFilter(prior.x, prior.P, 1, 1.0, self.N, None, None)

    def predict(self, z):
        move = self.world.motion.move
        self.f.Q = move(self.f.x, z.odometry, z.dt)[2]
        self.f.fx = lambda x, dt: moved(move, x, z)
        self.f.predict()

    def renew(self):
        pass

    def observe(self, z, R):
        self.f.dim_z, self.f._mean_z = len(z), np.zeros(len(z))
        self.f.update(z, R)

    def estimate(self):
        self.f.x, self.f.P = self.f.sigmas.mean(0), np.cov(self.f.sigmas.T)
        return super().estimate()


def moved(move, x, z):
    """x' with a heading that is not wrapped, so that points on both sides of pi have their mean between them."""
    there = move(x, z.odometry, z.dt)[0]
    there[2:] = x[2:] + np.arctan2(np.sin(there[2:] - x[2:]), np.cos(there[2:] - x[2:]))
    return there
