"""One unscented Kalman filter over the whole team: sigma points in place of Jacobians.

Like ekf-joint it is centralised. 2 n d + 1 points pass through every motion and every reading, one reading after the
other. Odometry noise is additive. A reading that would make P' indefinite, by negative weights, is refused.

Sources: S. Julier, J. Uhlmann, "Unscented filtering and nonlinear estimation", Proc. IEEE 92(3), 2004; R. van der
Merwe, "Sigma-point Kalman filters for probabilistic inference in dynamic state-space models", PhD thesis, OGI, 2004
(the scaled points). engine="filterpy" is filterpy's UnscentedKalmanFilter, one trial at a time.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from cooploc.estimators import kalman
from cooploc.estimators.interface import Array, Belief, Mail, Mask, Rows, Senses, Sensor, Traffic, World
from cooploc.estimators.joint_gaussian import block_diagonal, definite, square
from cooploc.estimators.models import (
    AnchorReading,
    Bearing,
    GradientDoa,
    Sighting,
    WeightedDoa,
    fixed_readings,
    wrap,
    wrap_heading,
)
from cooploc.estimators.robust import AssumedLoss, loss_of, weights
from cooploc.estimators.tunable import tunable

Points = Callable[[Array, slice], Array]  # moves sigma points (t, s, .., d) of these trials, or reads a sensor there


class State(NamedTuple):
    """The team's joint Gaussian."""

    x: Array  # (t, n, d)
    P: Array  # (t, n d, n d)
    world: World


@kalman.explain
@dataclass(frozen=True)
class UkfJoint:
    """Centralised UKF over all robots.

    Parameters:
        alpha: spread of the sigma points: they lie alpha sqrt(3) standard deviations from the mean.
        beta: extra weight of the middle point in the covariance (no unit); 2 suits a Gaussian.
    """

    api: ClassVar[int] = 1
    bound: ClassVar[bool] = False
    sends: ClassVar[str] = "every reading"
    consistency: ClassVar[str] = "consistent up to the unscented transform"
    centralised: ClassVar[bool] = True
    axes: ClassVar[str] = "its sigma points lie along the axes of a Cholesky factor"
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(kalman.GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    engine: kalman.EngineName = "batched"
    reading: kalman.RadioReading = "range"
    alpha: float = tunable(0.1, 0.001, 1.0, log=True)
    beta: float = tunable(2.0, 0.0, 4.0)
    loss: AssumedLoss = "world"

    uses = property(kalman.team_channels)

    def __post_init__(self) -> None:
        kalman.require_limits(self, alpha=(1e-6, 10), beta=(0, 10))

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        world = kalman.assume(self, world)
        return State(prior.x, square(block_diagonal(prior.P)), world)

    def predict(self, s: State, z: Senses) -> State:
        """x' = sum Wm f(chi),  P' = sum Wc (f(chi) - x') (f(chi) - x')' + Q."""
        motion = s.world.motion
        noise = square(block_diagonal(motion.move(s.x, z.odometry, z.dt)[2]))

        def f(points: Array, trials: slice) -> Array:
            return motion.move(points, z.odometry[trials, None], z.dt[trials, None])[0]

        x, P = (_predict if self.engine == "batched" else _filterpy_predict)(self, s, f, noise)
        return s._replace(x=wrap_heading(x), P=P)

    def correct(self, s: State, z: Senses) -> State:
        for sensor, place, reading in fixed_readings(s.world, z, self.anchor_reading):
            for i in range(s.world.robots):
                if isinstance(sensor, WeightedDoa):  # its variance is that of the mean: points would each have another
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

        A point reads -y(chi), relative to the reading itself, so that the reading is 0.
        """
        absent = np.asarray(np.isnan(sensor.innovation(s.x[:, i], np.ones(2), reading)[0]).any(-1))
        known = np.where(absent[:, None], 1.0, reading)
        members = [i, place] if isinstance(place, int) else [i]

        def h(points: Array, trials: slice) -> Array:  # (t, s, members, d) of the robots in the reading
            q = points[..., 1, :2] if isinstance(place, int) else place
            return -sensor.innovation(points[..., 0, :], q, known[trials, None])[0]

        if isinstance(sensor, Sighting):
            turns = np.array([False, True])  # which numbers of the reading are angles
        else:
            turns = np.full(len(sensor.R), isinstance(sensor, (Bearing, GradientDoa)))
        update = _update if self.engine == "batched" else _filterpy_update
        R = np.broadcast_to(np.where(absent[:, None, None], np.eye(R.shape[-1]), R), (len(s.x), *R.shape[-2:]))
        if (loss := loss_of(sensor)) != "none":
            y, S, *_ = _read(self, s, h, members, turns, R)
            R = R + (1 / weights(loss, kalman.distance(y, S), y.shape[-1]) - 1)[:, None, None] * S
        x, P, d2, sound = update(self, s, h, members, turns, R)
        use = (~absent & sound & (d2 <= self.gate))[:, None, None]
        return s._replace(x=np.where(use, wrap_heading(x), s.x), P=np.where(use, P, s.P))


def _weights(p: UkfJoint, m: int) -> tuple[float, Array, Array]:
    """m + lambda = 3 alpha^2 (kappa = 3 - m);  Wm_0 = lambda / (m + lambda),  Wc_0 = Wm_0 + 1 - alpha^2 + beta."""
    scale = 3 * p.alpha**2
    Wm = np.full(2 * m + 1, 0.5 / scale)
    Wm[0] = (scale - m) / scale
    Wc = Wm.copy()
    Wc[0] += 1 - p.alpha**2 + p.beta
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


def _whiten_cross(off: Array, scale: float) -> Array:
    """Return C = P_xz' P^-1/2' (t, k, m), what each column of P^1/2 adds to the reading."""
    plus, minus = np.split(off[:, 1:], 2, 1)
    return np.asarray((plus - minus).mT / (2 * np.sqrt(scale)))


def _is_sound(C: Array, S: Array, R: Array) -> Mask:
    """Return where P - K S K' is definite: where S exceeds C C', the part that the state explains."""
    return definite(S - C @ C.mT - R / 10)


def _predict(p: UkfJoint, s: State, f: Points, noise: Array) -> tuple[Array, Array]:
    t, n, d = s.x.shape
    scale, Wm, Wc = _weights(p, n * d)
    points = _points(s.x, _columns(s.P, scale).reshape(t, -1, n, d))
    moved = f(points, slice(None)).reshape(t, -1, n * d)
    mean, off = _moments(moved, Wm, _headings(n, d))
    return mean.reshape(t, n, d), kalman.symmetric((Wc[:, None] * off).mT @ off + noise)


def _update(
    p: UkfJoint, s: State, h: Points, members: list[int], turns: Mask, R: Array
) -> tuple[Array, Array, Array, Mask]:
    """P_xz' = C P^1/2', which needs the points of the robots in the reading only."""
    t, n, d = s.x.shape
    scale, _, _ = _weights(p, n * d)
    y, S, C, columns = _read(p, s, h, members, turns, R)
    K = np.linalg.solve(S, C @ columns / np.sqrt(scale)).mT
    x, P = s.x + (K @ y[..., None]).reshape(t, n, d), kalman.symmetric(s.P - K @ S @ K.mT)
    return x, P, kalman.distance(y, S), _is_sound(C, S, R)


def _read(
    p: UkfJoint, s: State, h: Points, members: list[int], turns: Mask, R: Array
) -> tuple[Array, Array, Array, Array]:
    """Return y (t, k), S (t, k, k), C (t, k, m), and the columns of P^1/2 (t, m, m) times the root of the scale."""
    t, n, d = s.x.shape
    scale, Wm, Wc = _weights(p, n * d)
    columns = _columns(s.P, scale)
    points = _points(s.x[:, members], columns.reshape(t, -1, n, d)[:, :, members])
    mean, off = _moments(h(points, slice(None)), Wm, turns)
    S = kalman.symmetric((Wc[:, None] * off).mT @ off + R)
    return _minus(np.zeros_like(mean), mean, turns), S, _whiten_cross(off, scale), columns


def _filterpy(p: UkfJoint, s: State, i: int, turns: Mask) -> Any:
    """Return filterpy's filter of trial i, with angles as above."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    n, d = s.x.shape[1:]
    m, headings = n * d, _headings(n, d)
    ukf = UnscentedKalmanFilter(
        m,
        len(turns),
        1.0,
        hx=None,
        fx=None,
        points=MerweScaledSigmaPoints(m, p.alpha, p.beta, 3 - m),
        x_mean_fn=lambda points, Wm: _moments(points[None], Wm, headings)[0][0],
        z_mean_fn=lambda points, Wm: _moments(points[None], Wm, turns)[0][0],
        residual_x=lambda a, b: _minus(a, b, headings),
        residual_z=lambda a, b: _minus(a, b, turns),
    )
    ukf.x, ukf.P = s.x[i].ravel(), s.P[i].copy()
    return ukf


def _filterpy_predict(p: UkfJoint, s: State, f: Points, noise: Array) -> tuple[Array, Array]:
    x, P = s.x.copy(), s.P.copy()
    for i in range(len(x)):
        ukf = _filterpy(p, s, i, np.zeros(1, bool))
        ukf.Q = noise[i]
        ukf.predict(fx=lambda point, _, i=i: f(point.reshape(1, 1, *x.shape[1:]), slice(i, i + 1)).ravel())
        x[i], P[i] = ukf.x.reshape(x.shape[1:]), ukf.P
    return x, P


def _filterpy_update(
    p: UkfJoint, s: State, h: Points, members: list[int], turns: Mask, R: Array
) -> tuple[Array, Array, Array, Mask]:
    x, P, d2, sound = s.x.copy(), s.P.copy(), np.zeros(len(s.x)), np.zeros(len(s.x), bool)
    scale, Wm, _ = _weights(p, s.P.shape[-1])
    for i in range(len(x)):
        ukf = _filterpy(p, s, i, turns)
        ukf.sigmas_f = ukf.points_fn.sigma_points(ukf.x, ukf.P)
        read = lambda point, i=i: h(point.reshape(1, 1, *x.shape[1:])[:, :, members], slice(i, i + 1)).ravel()  # noqa: E731
        ukf.update(np.zeros(len(turns)), R=R[i], hx=read)
        x[i], P[i], d2[i] = ukf.x.reshape(x.shape[1:]), ukf.P, ukf.y @ ukf.SI @ ukf.y
        sound[i] = _is_sound(_whiten_cross(_moments(ukf.sigmas_h[None], Wm, turns)[1], scale), ukf.S[None], R[i])[0]
    return x, P, d2, sound


def _headings(n: int, d: int) -> Mask:
    """Return which numbers (n d,) of the state are angles."""
    return np.asarray(np.arange(n * d) % d == 2)
