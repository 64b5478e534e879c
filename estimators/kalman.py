"""The steps that the Kalman filters share: moves and updates of a belief, messages, readings of teammates."""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple, Protocol, Self, TypeVar

import numpy as np

from cooploc.estimators import kalman_kernels
from cooploc.estimators.compiled import readable, spread_out
from cooploc.estimators.interface import (
    HEADER,
    Array,
    Belief,
    Indices,
    Mail,
    Mask,
    Motion,
    Rows,
    Senses,
    Sensor,
    Traffic,
    World,
)
from cooploc.estimators.joint_kernels import Sightings
from cooploc.estimators.kalman_parameters import EngineName, Parameters, assumed_world
from cooploc.estimators.models import (
    LogDistance,
    Orientation,
    Range,
    Sighting,
    Unicycle,
    fixed,
    wrap_heading,
)

# The Kalman predict and update of many rows at once, in two engines that compute the same.
#
# `batched` is a compiled loop over rows (`kalman_kernels.py`); `predict` and `kalman` state in numpy what it computes.
# `filterpy` runs filterpy's ExtendedKalmanFilter row by row: what a filterpy user would compute.


class Predict(Protocol):
    """x', F P F' + Q for a motion that its caller has linearised; x is moved already and comes back as it is."""

    def __call__(self, x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]: ...


class Update(Protocol):
    """x + K y, (I - K H) P (I - K H)' + K R K'; rows whose reading is absent (nan) or gated come back bit-identical."""

    def __call__(self, x: Array, P: Array, y: Array, H: Array, R: Array, gate: float) -> tuple[Array, Array]: ...


class Engine(NamedTuple):
    """One way to compute a Kalman filter."""

    predict: Predict
    update: Update


def symmetric(P: Array) -> Array:
    """(P + P') / 2."""
    return (P + P.mT) / 2


def root(P: Array) -> Array:
    """A with A A' = P, of covariances P (..., d, d) that may be singular."""
    values, vectors = np.linalg.eigh(P)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :], float)


def present(y: Array, H: Array, R: Array) -> Mask:
    """Rows (...) whose reading, Jacobian and noise have no nan."""
    finite: Mask = np.asarray(~(np.isnan(y).any(-1) | np.isnan(H).any((-2, -1)) | np.isnan(R).any((-2, -1))))
    return finite


def kalman(x: Array, P: Array, y: Array, H: Array, R: Array, gate: float = np.inf) -> tuple[Array, Array]:
    """Kalman update of rows x (..., d), P (..., d, d) by innovation y (..., k), H (..., k, d), R (..., k, k)."""
    R = np.broadcast_to(R, (*y.shape, y.shape[-1]))
    use = present(y, H, R)
    y = np.where(use[..., None], y, 0.0)
    H = np.where(use[..., None, None], H, 0.0)
    R = np.where(use[..., None, None], R, np.eye(y.shape[-1]))
    S = H @ P @ H.mT + R
    use &= distance(y, S) <= gate
    K = np.linalg.solve(S, H @ P).mT
    I_KH = np.eye(x.shape[-1]) - K @ H
    x1 = x + (K @ y[..., None])[..., 0]
    P1 = symmetric(I_KH @ P @ I_KH.mT + K @ R @ K.mT)
    return np.where(use[..., None], x1, x), np.where(use[..., None, None], P1, P)


def inflated_update(
    belief: Belief, y: Array, H: Array, H_j: Array, P_j: Array, R: Array, w: Array, update: Update = kalman
) -> Belief:
    """Kalman update by a reading of a sender, with P/w and P_j/(1-w); rows with w = 1 come back bit-identical."""
    use = w < 1
    v = np.where(use, w, 0.5)[:, None, None]
    N = H_j @ P_j @ H_j.mT / (1 - v) + R
    y = np.where(use[:, None], y, np.nan)
    x, P = update(belief.x, belief.P / v, y, H, N, np.inf)
    return Belief(x, np.where(use[:, None, None], P, belief.P))


def condition(x: Array, P: Array, H: Array, y: Array, C: Array) -> tuple[Array, Array]:
    """x', P' when H x becomes N(H x + y, C), y (..., k), C (..., k, k): the rest follows by its covariance with H x.

    L = P H' (H P H')^-1,  x' = x + L y,  P' = (I - L H) P (I - L H)' + L C L'.
    """
    L = np.linalg.solve(H @ P @ H.mT, H @ P).mT
    rest = np.eye(x.shape[-1]) - L @ H
    return x + (L @ y[..., None])[..., 0], symmetric(rest @ P @ rest.mT + L @ C @ L.mT)


def distance(y: Array, S: Array) -> Array:
    """Squared Mahalanobis distance y' S^-1 y (...)."""
    d2: Array = np.einsum("...i,...i->...", y, np.linalg.solve(S, y[..., None])[..., 0])
    return d2


def predict(x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]:
    """F P F' + Q of rows P (..., d, d), F and Q."""
    return x, symmetric(F @ P @ F.mT + Q)


def _row_predict(x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]:
    """`predict`, compiled, equal to 1e-12."""
    d, P1 = P.shape[-1], np.empty(P.shape)
    kalman_kernels.widen(_rows(P, P.shape), *(_rows(part, P.shape)[:, None] for part in (F, Q)), P1.reshape(-1, d, d))
    return x, P1


def _row_update(x: Array, P: Array, y: Array, H: Array, R: Array, gate: float) -> tuple[Array, Array]:
    """`kalman`, compiled, equal to 1e-12."""
    d, k = H.shape[-1], H.shape[-2]
    x, P = x.copy(), P.copy()
    rows = readable(y).reshape(-1, k), _rows(H, H.shape), _rows(R, (*y.shape, k))
    kalman_kernels.update(x.reshape(-1, d), P.reshape(-1, d, d), *rows, gate)
    return x, P


def _rows(part: Array, shape: tuple[int, ...]) -> Array:
    """An array that broadcasts to (..., a, b) as rows (r, a, b)."""
    return spread_out(part, shape).reshape(-1, *shape[-2:])


def _filterpy_predict(x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]:
    from filterpy.kalman import ExtendedKalmanFilter

    P = P.copy()
    for i in np.ndindex(x.shape[:-1]):
        ekf = ExtendedKalmanFilter(x.shape[-1], 1)
        ekf.x, ekf.P, ekf.F, ekf.Q = np.zeros(x.shape[-1]), P[i], F[i], Q[i]
        ekf.predict()
        P[i] = ekf.P
    return x, P


def _filterpy_update(x: Array, P: Array, y: Array, H: Array, R: Array, gate: float) -> tuple[Array, Array]:
    from filterpy.kalman import ExtendedKalmanFilter

    x, P = x.copy(), P.copy()
    R = np.broadcast_to(R, (*y.shape, y.shape[-1]))
    for i in zip(*np.nonzero(present(y, H, R)), strict=True):
        ekf = ExtendedKalmanFilter(x.shape[-1], y.shape[-1])
        ekf.x, ekf.P = x[i], P[i]
        ekf.update(y[i], HJacobian=lambda _, i=i: H[i], Hx=lambda _, i=i: np.zeros_like(y[i]), R=R[i])
        if float(ekf.y @ ekf.SI @ ekf.y) <= gate:
            x[i], P[i] = ekf.x, ekf.P
    return x, P


ENGINES: dict[EngineName, Engine] = {
    "batched": Engine(_row_predict, _row_update),
    "filterpy": Engine(_filterpy_predict, _filterpy_update),
}


# The models of a world, linearised at a state: in a compiled loop over rows where they are built in.
#
# Another motion or sensor linearises itself, by its `move` or its `innovation`: the same equations, in numpy.

KINDS: dict[type, int] = {
    Range: kalman_kernels.RANGE,
    LogDistance: kalman_kernels.RSSI,
    Sighting: kalman_kernels.SIGHTING,
}


def move(motion: Motion, x: Array, z: Senses) -> tuple[Array, Array, Array]:
    """x', F, Q of states x (..., d) after a tick's odometry."""
    if type(motion) is not Unicycle:
        return motion.move(x, z.odometry, z.dt)
    out, F, Q = np.empty(x.shape), np.empty((*x.shape, 3)), np.empty((*x.shape, 3))
    kalman_kernels.drive(*_driving(motion, x, z), out.reshape(-1, 3), F.reshape(-1, 3, 3), Q.reshape(-1, 3, 3))
    return out, F, Q


def drive_wheels(motion: Unicycle, x: Array, P: Array, z: Senses) -> tuple[Array, Array, Array]:
    """x', F P F' + Q, and F, in one loop."""
    out, P1, F = np.empty(x.shape), np.empty(P.shape), np.empty(P.shape)
    rows = readable(P).reshape(-1, 3, 3), out.reshape(-1, 3), P1.reshape(-1, 3, 3), F.reshape(-1, 3, 3)
    kalman_kernels.drive_and_widen(*_driving(motion, x, z), *rows)
    return out, P1, F


def _driving(motion: Unicycle, x: Array, z: Senses) -> tuple[Array, Array, Array, tuple[float, float]]:
    """States, odometry and its variances as `row_kernels.drive` takes them."""
    variances = motion.sigma_v**2 * motion.tick, motion.sigma_omega**2 * motion.tick
    return readable(x).reshape(-1, 3), readable(z.odometry).reshape(-1, 2), readable(z.dt).reshape(-1), variances


def innovation(sensor: Sensor, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
    """y (..., k), H (..., k, d), Hq (..., k, 2) of readings z (..., k) of places q (..., 2) at states x (..., d)."""
    if type(sensor) not in KINDS:
        return sensor.innovation(x, q, z)
    lead, d, k = x.shape[:-1], x.shape[-1], z.shape[-1]
    if q.ndim > 1 and q.shape[:-1] != lead:
        lead = np.broadcast_shapes(lead, q.shape[:-1])
    A, slope = (sensor.A, 10 * sensor.eta / np.log(10)) if isinstance(sensor, LogDistance) else (0.0, 0.0)
    one_place = readable(q).reshape(-1, q.shape[-1]) if q.ndim == 1 else _contiguous_rows(q, lead)
    y, H = np.empty((*lead, k)), np.empty((*lead, k, d))
    kalman_kernels.relate(
        KINDS[type(sensor)],
        A,
        slope,
        _contiguous_rows(x, lead),
        one_place,
        _contiguous_rows(z, lead),
        y.reshape(-1, k),
        H.reshape(-1, k, d),
    )
    return y, H, -H[..., :2]


def _contiguous_rows(part: Array, lead: tuple[int, ...]) -> Array:
    """An array (..., m) as rows (r, m), one for each of `lead`."""
    return spread_out(part, (*lead, part.shape[-1])).reshape(-1, part.shape[-1])


# The two steps of an EKF that need no teammate: a move by odometry, an update by readings of fixed things.


def predict_row(p: Parameters, world: World, x: Array, P: Array, z: Senses) -> tuple[Array, Array, Array]:
    """x' = f(x, u),  P' = F P F' + Q,  and F itself; x (..., d), P (..., d, d)."""
    if p.engine == "batched" and type(world.motion) is Unicycle:
        return drive_wheels(world.motion, x, P, z)
    x, F, Q = move(world.motion, x, z)
    return *ENGINES[p.engine].predict(x, P, F, Q), F


def correct_row(p: Parameters, world: World, x: Array, P: Array, z: Senses) -> tuple[Array, Array]:
    """x' = x + K y,  P' = (I - K H) P (I - K H)' + K R K', one reading of an anchor or a landmark after the other."""
    camera = camera_alone(p, world)
    if camera is not None:
        return _update_by_sightings(x, P, world.landmarks, z.landmark, camera, p.gate)
    for sensor, place, reading in fixed(world, z, p.anchor_reading):
        y, H, _ = innovation(sensor, x, place, reading)
        x, P = ENGINES[p.engine].update(x, P, y, H, sensor.R, p.gate)
    return x, P


def camera_alone(p: Parameters, world: World) -> Sighting | None:
    """The camera whose sightings of landmarks are all that is used of fixed things, for those who compile them."""
    camera = world.sensors.get("landmark")
    if p.engine != "batched" or p.anchor_reading == "none" or type(camera) is not Sighting:
        return None
    return None if "anchor_rssi" in world.sensors or "anchor_range" in world.sensors else camera


def sightings(world: World, z: Array, camera: Sighting, gate: float) -> Sightings:
    """Those of landmarks z (t, n, l, 2), as compiled loops take them."""
    return Sightings(world.landmarks, readable(z), camera.R, gate)


def _update_by_sightings(
    x: Array, P: Array, places: Array, z: Array, camera: Sighting, gate: float
) -> tuple[Array, Array]:
    """The same by all sightings (..., l, 2) of landmarks, in one compiled loop."""
    d, x, P = x.shape[-1], x.copy(), P.copy()
    rows = x.reshape(-1, d), P.reshape(-1, d, d)
    kalman_kernels.sight(*rows, places, readable(z).reshape(-1, *z.shape[-2:]), camera.R, gate)
    return x, P


class Own(Protocol):
    """The state of a filter whose robots keep one belief each: a NamedTuple with these among its fields."""

    @property
    def x(self) -> Array: ...  # (r, d)

    @property
    def P(self) -> Array: ...  # (r, d, d)

    @property
    def world(self) -> World: ...

    def _replace(self, *_: Any, **fields: Any) -> Self: ...


S = TypeVar("S", bound=Own)


def predict_own(p: Parameters, s: S, z: Senses) -> S:
    """x' = f(x, u),  P' = F P F' + Q."""
    x, P, _ = predict_row(p, s.world, s.x, s.P, z)
    return s._replace(x=x, P=P)


def correct_own(p: Parameters, s: S, z: Senses) -> S:
    """x' = x + K y,  P' = (I - K H) P (I - K H)' + K R K', one reading after the other."""
    x, P = correct_row(p, s.world, s.x, s.P, z)
    return s._replace(x=x, P=P)


def own_belief(p: Parameters, s: Own) -> Belief:
    """x with its heading in (-pi, pi], and P."""
    return Belief(wrap_heading(s.x), s.P)


# What Kalman filters put on the air: a belief and its sightings in one packet, and the count of what was sent.


class Message(NamedTuple):
    """A broadcast belief; a whole row of them where the leading axes are (receiver, sender)."""

    x: Array  # (..., d)
    P: tuple[Array, ...]  # (..., d, d) each: the covariance, or the parts that add up to it
    sightings: Array  # (..., n, 2)  range [m] and bearing [rad] of each teammate; n = 0 where none are sent

    def pack(self) -> Array:
        """The packet (..., m): x, the upper triangle of each covariance, the sightings."""
        lead, d = self.x.shape[:-1], self.x.shape[-1]
        upper = (P.reshape(*lead, d * d).take(_triangle(d), -1) for P in self.P)
        return np.concatenate([self.x, *upper, self.sightings.reshape(*lead, 2 * self.sightings.shape[-2])], -1)

    @classmethod
    def unpack(cls, packets: Array, d: int, parts: int = 1) -> Self:
        """The messages in packets (..., m) of a state of d numbers and a covariance in `parts`."""
        where, size = _square(d), d * (d + 1) // 2
        covariances = [packets.take(where + d + part * size, -1) for part in range(parts)]
        x, sightings = packets[..., :d], packets[..., d + parts * size :]
        pairs = sightings.reshape(*packets.shape[:-1], sightings.shape[-1] // 2, 2)
        return cls(x, tuple(covariances), pairs)


@lru_cache
def _triangle(d: int) -> Indices:
    """Where the upper triangle of a (d, d) matrix is among its d^2 numbers."""
    i, j = np.triu_indices(d)
    return i * d + j


@lru_cache
def _square(d: int) -> Indices:
    """Which of the triangle's numbers is each entry of a (d, d) matrix."""
    which, triangle = np.empty((d, d), np.int64), np.triu_indices(d)
    which[triangle] = which.T[triangle] = np.arange(len(triangle[0]))
    return which


def no_traffic(x: Array) -> Traffic:
    """Nothing sent by robots with states x (t, n, d)."""
    return Traffic(np.zeros(x.shape[:2]), np.zeros(x.shape[:2]))


def count(sent: Traffic, robot: int, when: Mask, numbers: int) -> None:
    """Add, in place, a robot's message of so many numbers, 8 bytes each, in the trials `when` (t,) it was sent."""
    sent.messages[:, robot] += when
    sent.bytes[:, robot] += when * (8.0 * numbers + HEADER)


# Readings between robots as the Kalman filters use them: which there are, and how they linearise.


class PairReading(NamedTuple):
    """A reading between a robot and one whose packet it received."""

    sensor: Sensor
    sender: int
    z: Array  # (r, k)
    by_sender: bool  # whether the sender made it, of the robot; else the robot made it, of the sender

    def linearise(self, x: Array, x_j: Array) -> tuple[Array, Array, Array]:
        """y (r, k), H (r, k, d) of the robot itself, H_j (r, k, d) of the sender."""
        if self.by_sender:
            y, H_j, H = linearise(self.sensor, x_j, x, self.z)
            return y, H, H_j
        return linearise(self.sensor, x, x_j, self.z)


def receive(world: World, z: Senses, mail: Mail, sightings: Array, robot: Indices) -> Iterator[PairReading]:
    """A robot's readings of its senders, then the `sightings` (r, sender, n, 2) of it that they sent."""
    for sensor, j, reading in world.relative(z, mail):
        yield PairReading(sensor, j, reading, by_sender=False)
    camera = world.sensors.get("sighting")
    if camera is not None and sightings.shape[2]:
        of_it = sightings[np.arange(len(robot)), :, robot]  # (r, sender, 2)
        for j in (~np.logical_and.reduce(np.isnan(of_it), (0, 2))).nonzero()[0].tolist():
            yield PairReading(camera, j, of_it[:, j], by_sender=True)


def pairs(world: World, z: Senses, air: Mail) -> Iterator[tuple[Sensor, int, int, Array]]:
    """Readings (t, k) of a team as (sensor, receiver, sender, reading), sender by sender; absent ones are left out."""
    for sensor, j, reading in world.relative(z, air):
        there = np.asarray(~np.isnan(reading).all((0, 2)))
        there[j] = False
        yield from ((sensor, i, j, reading[:, i]) for i in np.flatnonzero(there).tolist())


def table(world: World, z: Senses, air: Mail) -> Iterator[tuple[Sensor, Array]]:
    """The same readings at once, (t, receiver, sender, k) by sensor; nan on the diagonal, where both are one robot."""
    for channel, readings in (
        ("sighting", z.sighting),
        ("radio_rssi", air.rssi[..., None]),
        ("radio_range", air.range[..., None]),
    ):
        sensor = world.sensors.get(channel)
        if sensor is not None and not np.isnan(readings).all():
            yield sensor, np.where(np.eye(world.robots, dtype=bool)[..., None], np.nan, readings)


def linearise(sensor: Sensor, x_i: Array, x_j: Array, reading: Array) -> tuple[Array, Array, Array]:
    """y (..., k), H_i (..., k, d), H_j (..., k, d) of a reading of j by i."""
    if isinstance(sensor, Orientation):
        return sensor.between(x_i, x_j, reading)
    y, H, Hq = innovation(sensor, x_i, x_j[..., :2], reading)
    H_j = np.zeros(H.shape)
    H_j[..., :2] = Hq
    return y, H, H_j


def curvature(sensor: Sensor, x_i: Array, x_j: Array, D: Array) -> tuple[Array, Array]:
    """Mean shift (..., k), extra variance (..., k, k) of a range by its second order; x_i - x_j has D (..., 2, 2)."""
    if isinstance(sensor, Range):
        return sensor.curvature(x_i, x_j[..., :2], D)
    return np.zeros(1), np.zeros((1, 1))


# The steps of the filters that broadcast one belief a tick: they differ in how they combine it with a reading.
#
# Sent, in one broadcast a tick: x and the triangle of P (5 numbers, with a heading 9) and, with a camera, range and
# bearing of every teammate in sight; 8 bytes each. A robot that was sighted uses that reading, too (`both`).


class BroadcastState(NamedTuple):
    """The memory of one robot."""

    x: Array  # (r, d)
    P: Array  # (r, d, d)
    robot: Indices  # (r,)
    world: World


class Broadcaster(Parameters, Protocol):
    """A filter that broadcasts its belief."""

    @property
    def both(self) -> bool: ...

    def combine(self, x: Array, P: Array, y: Array, H: Array, N: Array) -> tuple[Array, Array]:
        """x', P' by a reading with innovation y (r, k), own Jacobian H (r, k, d), noise N = H_j P_j H_j' + R (r, k, k).

        Rows in which anything is nan must come back as they are, bit for bit.
        """
        ...


def start_broadcasting(p: Broadcaster, prior: Belief, world: World, rows: Rows) -> BroadcastState:
    """The prior is the first belief."""
    return BroadcastState(prior.x, prior.P, rows.robot, assumed_world(p, world))


def broadcast(p: Broadcaster, s: BroadcastState, z: Senses) -> Array:
    """The belief before this tick's fusion, and the sightings."""
    return Message(s.x, (s.P,), z.sighting if p.both else z.sighting[:, :0]).pack()


def fuse_broadcasts(p: Broadcaster, s: BroadcastState, z: Senses, mail: Mail) -> BroadcastState:
    """One reading after the other, each linearised at the belief that the last one left."""
    x, P = s.x, s.P
    sent = Message.unpack(mail.packets, x.shape[-1])
    for pair in receive(s.world, z, mail, sent.sightings, s.robot):
        y, H, H_j = pair.linearise(x, sent.x[:, pair.sender])
        x, P = p.combine(x, P, y, H, H_j @ sent.P[0][:, pair.sender] @ H_j.mT + pair.sensor.R)
    return s._replace(x=x, P=P)
