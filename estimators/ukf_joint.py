"""One unscented Kalman filter over the whole team: sigma points in place of Jacobians.

Like ekf-joint it is centralised. 2 n d + 1 points pass through every motion and every reading, one reading after the
other. Odometry noise is additive. A reading that would make P' indefinite, by negative weights, is refused.

Sources: S. Julier, J. Uhlmann, "Unscented filtering and nonlinear estimation", Proc. IEEE 92(3), 2004; R. van der
Merwe, "Sigma-point Kalman filters for probabilistic inference in dynamic state-space models", PhD thesis, OGI, 2004
(the scaled points).
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from cooploc.estimators import kalman, models
from cooploc.estimators.errors import Limits
from cooploc.estimators.interface import Array, Belief, Mail, Mask, Rows, Senses, Sensor, Traffic, World
from cooploc.estimators.joint_gaussian import block_diagonal, definite, square
from cooploc.estimators.models import AnchorReading, fixed_readings, wrap, wrap_heading
from cooploc.estimators.robust import AssumedLoss, loss_of, weights
from cooploc.estimators.tunable import tunable


class State(NamedTuple):
    """The team's joint Gaussian."""

    x: Array  # (t, n, d)
    P: Array  # (t, n d, n d)
    world: World


@dataclass(frozen=True)
@kalman.explain
class UkfJoint:
    """Centralised UKF over all robots.

    Parameters:
        alpha: spread of the sigma points: they lie alpha sqrt(3) standard deviations from the mean.
        beta: extra weight of the middle point in the covariance (no unit); 2 suits a Gaussian.
    """

    api: ClassVar[int] = 1
    limits: ClassVar[Limits] = {"alpha": (1e-6, 10), "beta": (0, 10)}
    bound: ClassVar[bool] = False
    sends: ClassVar[str] = "every reading"
    consistency: ClassVar[str] = "consistent up to the unscented transform"
    centralised: ClassVar[bool] = True
    axes: ClassVar[str] = "its sigma points lie along the axes of a Cholesky factor"
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(kalman.GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    reading: kalman.RadioReading = "range"
    alpha: float = tunable(0.1, 0.001, 1.0, log=True)
    beta: float = tunable(2.0, 0.0, 4.0)
    loss: AssumedLoss = "world"

    uses = property(kalman.team_channels)

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        world = kalman.assume(self, world)
        return State(prior.x, square(block_diagonal(prior.P)), world)

    def predict(self, s: State, z: Senses) -> State:
        """x' = sum Wm f(chi),  P' = sum Wc (f(chi) - x') (f(chi) - x')' + Q."""
        (t, n, d), motion = s.x.shape, s.world.motion
        Q = square(block_diagonal(motion.move(s.x, z.odometry, z.dt)[2]))
        scale, Wm, Wc = self._weights(n * d)
        points = _points(s.x, _columns(s.P, scale).reshape(t, -1, n, d))
        moved = motion.move(points, z.odometry[:, None], z.dt[:, None])[0].reshape(t, -1, n * d)
        x, off = _moments(moved, Wm, np.arange(n * d) % d == 2)
        return s._replace(x=wrap_heading(x.reshape(t, n, d)), P=kalman.symmetric((Wc[:, None] * off).mT @ off + Q))

    def correct(self, s: State, z: Senses) -> State:
        for sensor, place, reading in fixed_readings(s.world, z, self.anchor_reading):
            for i in range(s.world.robots):
                if isinstance(sensor, models.WeightedDoa):  # one variance, that of the mean, for all points
                    angle, R = sensor.at(s.x[:, i], reading[:, i])
                    s = self._update(s, sensor.doa, i, place, angle, R)
                else:
                    s = self._update(s, sensor, i, place, reading[:, i], sensor.R)
        return s

    def exchange(self, s: State, z: Senses, air: Mail) -> tuple[State, Traffic]:
        for sensor, i, j, reading in kalman.pair_readings(s.world, z, air):
            s = self._update(s, sensor, i, j, reading, sensor.R)
        return s, kalman.no_traffic(s.x)

    def estimate(self, s: State) -> Belief:
        t, n, d = s.x.shape
        return Belief(s.x, np.einsum("tiaib->tiab", s.P.reshape(t, n, d, n, d)))

    def _update(self, s: State, sensor: Sensor, i: int, place: Array | int, reading: Array, R: Array) -> State:
        """K = P_xz S^-1,  x' = x + K y,  P' = P - K S K', by robot i's reading of a place or of a teammate.

        A point reads -y(chi), relative to the reading itself, so that the reading is 0. P_xz' = C P^1/2' needs only the
        points of the robots in the reading.
        """
        t, n, d = s.x.shape
        absent = np.asarray(np.isnan(sensor.innovation(s.x[:, i], np.ones(2), reading)[0]).any(-1))
        known = np.where(absent[:, None], 1.0, reading)
        members = [i, place] if isinstance(place, int) else [i]
        if isinstance(sensor, models.Sighting):
            turns = np.array([False, True])  # which numbers of the reading are angles
        else:
            turns = np.full(len(sensor.R), isinstance(sensor, models.Bearing | models.GradientDoa))
        R = np.broadcast_to(np.where(absent[:, None, None], np.eye(R.shape[-1]), R), (t, *R.shape[-2:]))
        scale, Wm, Wc = self._weights(n * d)
        columns = _columns(s.P, scale)
        points = _points(s.x[:, members], columns.reshape(t, -1, n, d)[:, :, members])
        q = points[..., 1, :2] if isinstance(place, int) else place
        mean, off = _moments(-sensor.innovation(points[..., 0, :], q, known[:, None])[0], Wm, turns)
        y, S = _minus(np.zeros_like(mean), mean, turns), kalman.symmetric((Wc[:, None] * off).mT @ off + R)
        plus, minus = np.split(off[:, 1:], 2, 1)
        C = np.asarray((plus - minus).mT / (2 * np.sqrt(scale)))  # (t, k, m) what each column of P^1/2 adds
        if (loss := loss_of(sensor)) != "none":
            more = (1 / weights(loss, kalman.distance(y, S), y.shape[-1]) - 1)[:, None, None] * S
            R, S = R + more, kalman.symmetric((Wc[:, None] * off).mT @ off + (R + more))
        K = np.linalg.solve(S, C @ columns / np.sqrt(scale)).mT
        x, P = s.x + (K @ y[..., None]).reshape(t, n, d), kalman.symmetric(s.P - K @ S @ K.mT)
        sound = definite(S - C @ C.mT - R / 10)  # where S exceeds C C', the part that the state explains
        use = (~absent & sound & (kalman.distance(y, S) <= self.gate))[:, None, None]
        return s._replace(x=np.where(use, wrap_heading(x), s.x), P=np.where(use, P, s.P))

    def _weights(self, m: int) -> tuple[float, Array, Array]:
        """m + lambda = 3 alpha^2 (kappa = 3 - m);  Wm_0 = lambda / (m + lambda),  Wc_0 = Wm_0 + 1 - alpha^2 + beta."""
        scale = 3 * self.alpha**2
        Wm = np.full(2 * m + 1, 0.5 / scale)
        Wm[0] = (scale - m) / scale
        Wc = Wm.copy()
        Wc[0] += 1 - self.alpha**2 + self.beta
        return scale, Wm, Wc


def _points(x: Array, columns: Array) -> Array:
    """Return chi_0 = x (t, .., d),  chi_k = x +- column k (t, m, .., d) of the Cholesky factor."""
    x = x[:, None]
    return np.asarray(np.concatenate([x, x + columns, x - columns], 1))


def _columns(P: Array, scale: float) -> Array:
    """Return the columns of the Cholesky factor of scale P, as rows (t, m, m)."""
    return np.asarray(np.linalg.cholesky(scale * P).mT, float)


def _moments(points: Array, Wm: Array, turns: Mask) -> tuple[Array, Array]:
    """Return the weighted mean (t, m), taken about the first point, and deviations (t, s, m); angles if it `turns`."""
    mean = points[:, 0] + (Wm[:, None] * _minus(points, points[:, :1], turns)).sum(1)
    return mean, _minus(points, mean[:, None], turns)


def _minus(a: Array, b: Array, turns: Mask) -> Array:
    return np.where(turns, wrap(a - b), a - b) if turns.any() else a - b
