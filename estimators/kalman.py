"""The steps that the Kalman filters share: parameters, moves and updates of a belief, messages, readings of teammates.

Two engines compute the same: `batched` is a compiled loop over rows (`kalman_kernels.py`), which `kalman` states in
numpy; `filterpy` runs filterpy's ExtendedKalmanFilter row by row, as a filterpy user would.
"""

import inspect
from collections.abc import Callable, Iterator
from functools import lru_cache, partialmethod, reduce
from typing import Any, Literal, NamedTuple, Self, TypeVar, cast

import numpy as np

from cooploc.estimators import interface, kalman_kernels, models
from cooploc.estimators.compiled import readable, spread_out
from cooploc.estimators.errors import require
from cooploc.estimators.interface import Array, Belief, Indices, Mail, Mask, Senses, Sensor, Traffic, World
from cooploc.estimators.kalman_kernels import LandmarkSightings
from cooploc.estimators.models import LogDistance, Orientation, Range, Sighting, Unicycle, fixed_readings, wrap_heading
from cooploc.estimators.robust import loss_of, rescale

EngineName = Literal["batched", "filterpy"]
RadioReading = Literal["rssi", "range", "any"]
C = TypeVar("C", bound=type)

# Squared Mahalanobis distance beyond which a reading is refused: chi-square, two degrees of freedom, 0.999.
GATE = 13.8

# What the parameters that filters share mean.
MEANINGS = {
    "anchor_reading": """what is used of the anchors: "doa", the direction of arrival [rad] made of the readings of four
        corner anchors, with the variance that it has where the robot is; "doa-constant", the same with one variance
        everywhere, as published; "gradient", the gradient [dB/m] that the direction is taken from; "rssi", each raw
        reading; "any", each reading of whatever fixed things there are: RSSI [dBm] and ranges [m] of anchors,
        sightings of landmarks; or "none": odometry and teammates alone. Without RSSI all of these but "any" and "none"
        are the first that there is of landmarks and ranges.""",
    "gate": """squared Mahalanobis distance (no unit) beyond which a reading is refused; inf refuses none. The default
        refuses one in a thousand true readings of two numbers.""",
    "inflation": "factor, 0.01 to 100, on the standard deviation that is assumed of every reading; 1: the world's own.",
    "engine": '"batched" computes all rows at once; "filterpy" runs filterpy\'s filter row by row, to compare with.',
    "reading": """the radio reading that is used where no camera sees teammates: "range" [m], "rssi" [dBm], or "any",
        the first of these that there is.""",
    "loss": """how a reading counts that is far from what is expected: less and less, as in Huber's loss ("huber") or
        for the noise of Student's t ("student"); fully, up to the gate ("none"); or as the world's sensors state
        ("world"), in simulated worlds "none".""",
    "both": "whether a sighting corrects the robot that was seen, too.",
}


LIMITS = {"gate": (0, np.inf), "inflation": (models.LEAST, models.MOST)}


def explain(cls: C) -> C:
    """Add `MEANINGS` of a filter's parameters to its docstring; let it refuse values outside `LIMITS` and its own."""
    checked, doc = cast(Any, cls), inspect.cleandoc(cls.__doc__ or "")
    heading = "" if "\n\nParameters:\n" in doc else "\n\nParameters:"
    cls.__doc__ = (
        doc + heading + "".join(f"\n    {name}: {MEANINGS[name]}" for name in cls.__annotations__ if name in MEANINGS)
    )
    checked.__post_init__ = partialmethod(require, LIMITS | getattr(cls, "limits", {}))
    return cls


def own_channels(p: Any) -> tuple[str, ...]:
    """Return the channels of a robot's own readings, in order of preference."""
    return ("odometry", *models.fixed_channels(p.anchor_reading))


def team_channels(p: Any) -> tuple[str, ...]:
    """Return `own_channels` and the channel of readings of teammates."""
    radio = "radio_range|radio_rssi" if p.reading == "any" else f"radio_{p.reading}"
    return (*own_channels(p), f"sighting|{radio}")


def assume(p: Any, world: World) -> World:
    """Return the world with a filter's inflation; BadInput where directions of arrival lack four corner anchors."""
    if p.anchor_reading not in (*models.RAW, "none") and "anchor_rssi" in world.sensors:
        models.gradient_doa(world)
    return models.inflate(world, p.inflation, p.loss)


# The Kalman predict and update of many rows at once.

Update = Callable[[Array, Array, Array, Array, Array, float], tuple[Array, Array]]


class Engine(NamedTuple):
    """A Kalman filter's predict and update."""

    predict: Callable[[Array, Array, Array], Array]  # P, F, Q -> F P F' + Q
    update: Update  # x, P, y, H, R, gate -> x', P'; rows whose reading is absent (nan) or gated come back bit-identical


def symmetric(P: Array) -> Array:
    """Return (P + P') / 2."""
    return (P + P.mT) / 2


def root(P: Array) -> Array:
    """Return A with A A' = P, for covariances P (..., d, d) that may be singular."""
    values, vectors = np.linalg.eigh(P)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :], float)


def is_present(y: Array, H: Array, R: Array) -> Mask:
    """Return which rows (...) have no nan in their reading, Jacobian and noise."""
    return np.asarray(~(np.isnan(y).any(-1) | np.isnan(H).any((-2, -1)) | np.isnan(R).any((-2, -1))))


def distance(y: Array, S: Array) -> Array:
    """Return the squared Mahalanobis distance y' S^-1 y (...)."""
    return np.asarray(np.einsum("...i,...i->...", y, np.linalg.solve(S, y[..., None])[..., 0]))


def kalman(x: Array, P: Array, y: Array, H: Array, R: Array, gate: float = np.inf) -> tuple[Array, Array]:
    """Return x + K y, (I - K H) P (I - K H)' + K R K' of rows x (..., d), P (..., d, d).

    By innovations y (..., k) with H (..., k, d) and R (..., k, k). Rows whose reading is absent (nan), or beyond the
    gate, come back bit-identical.
    """
    R = np.broadcast_to(R, (*y.shape, y.shape[-1]))
    use = is_present(y, H, R)
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
    """Return the update by a reading of a sender, with P/w and P_j/(1-w); rows with w = 1 come back bit-identical."""
    use = w < 1
    v = np.where(use, w, 0.5)[:, None, None]
    N = H_j @ P_j @ H_j.mT / (1 - v) + R
    y = np.where(use[:, None], y, np.nan)
    x, P = update(belief.x, belief.P / v, y, H, N, np.inf)
    return Belief(x, np.where(use[:, None, None], P, belief.P))


def condition(x: Array, P: Array, H: Array, y: Array, C: Array) -> tuple[Array, Array]:
    """Return x', P' when H x becomes N(H x + y, C): the rest follows by its covariance with H x.

    L = P H' (H P H')^-1,  x' = x + L y,  P' = (I - L H) P (I - L H)' + L C L'.
    """
    L = np.linalg.solve(H @ P @ H.mT, H @ P).mT
    rest = np.eye(x.shape[-1]) - L @ H
    return x + (L @ y[..., None])[..., 0], symmetric(rest @ P @ rest.mT + L @ C @ L.mT)


def _batched_predict(P: Array, F: Array, Q: Array) -> Array:
    d, P1 = P.shape[-1], np.empty(P.shape)
    kalman_kernels.widen(_rows(P, P.shape), *(_rows(part, P.shape)[:, None] for part in (F, Q)), P1.reshape(-1, d, d))
    return P1


def _batched_update(x: Array, P: Array, y: Array, H: Array, R: Array, gate: float) -> tuple[Array, Array]:
    d, k = H.shape[-1], H.shape[-2]
    x, P, y, H = (np.array(part, order="C") for part in (x, P, y, H))  # absorb_row is compiled once, for own arrays
    noise = np.empty((*y.shape, k))
    noise[...] = R
    rows = x.reshape(-1, d), P.reshape(-1, d, d), y.reshape(-1, k), H.reshape(-1, k, d), noise.reshape(-1, k, k)
    kalman_kernels.update(*rows, gate)
    return x, P


def _rows(part: Array, shape: tuple[int, ...]) -> Array:
    """Return an array that broadcasts to (..., a, b) as rows (r, a, b)."""
    return spread_out(part, shape).reshape(-1, *shape[-2:])


def _filterpy_predict(P: Array, F: Array, Q: Array) -> Array:
    from filterpy.kalman import ExtendedKalmanFilter

    P = P.copy()
    for i in np.ndindex(P.shape[:-2]):
        ekf = ExtendedKalmanFilter(P.shape[-1], 1)
        ekf.x, ekf.P, ekf.F, ekf.Q = np.zeros(P.shape[-1]), P[i], F[i], Q[i]
        ekf.predict()
        P[i] = ekf.P
    return P


def _filterpy_update(x: Array, P: Array, y: Array, H: Array, R: Array, gate: float) -> tuple[Array, Array]:
    from filterpy.kalman import ExtendedKalmanFilter

    x, P = x.copy(), P.copy()
    R = np.broadcast_to(R, (*y.shape, y.shape[-1]))
    for i in zip(*np.nonzero(is_present(y, H, R)), strict=True):
        ekf = ExtendedKalmanFilter(x.shape[-1], y.shape[-1])
        ekf.x, ekf.P = x[i], P[i]
        ekf.update(y[i], HJacobian=lambda _, i=i: H[i], Hx=lambda _, i=i: np.zeros_like(y[i]), R=R[i])
        if float(ekf.y @ ekf.SI @ ekf.y) <= gate:
            x[i], P[i] = ekf.x, ekf.P
    return x, P


ENGINES: dict[EngineName, Engine] = {
    "batched": Engine(_batched_predict, _batched_update),
    "filterpy": Engine(_filterpy_predict, _filterpy_update),
}


# The models of a world, linearised at a state: those that are built in by a compiled loop over rows, others by their
# own `move` or `innovation`.

KINDS: dict[type, int] = {
    Range: kalman_kernels.RANGE,
    LogDistance: kalman_kernels.RSSI,
    Sighting: kalman_kernels.SIGHTING,
}


def move(motion: interface.Motion, x: Array, z: Senses) -> tuple[Array, Array, Array]:
    """Return x', F, Q of states x (..., d) after a tick's odometry."""
    if type(motion) is not Unicycle:
        return motion.move(x, z.odometry, z.dt)
    out, F, Q = np.empty(x.shape), np.empty((*x.shape, 3)), np.empty((*x.shape, 3))
    kalman_kernels.drive(*_wheels(motion, x, z), out.reshape(-1, 3), F.reshape(-1, 3, 3), Q.reshape(-1, 3, 3))
    return out, F, Q


def _wheels(motion: Unicycle, x: Array, z: Senses) -> tuple[Array, Array, Array, tuple[float, float]]:
    """Return states, odometry, its times and variances as compiled loops take them."""
    variances = motion.sigma_v**2 * motion.tick, motion.sigma_omega**2 * motion.tick
    return readable(x).reshape(-1, 3), readable(z.odometry).reshape(-1, 2), readable(z.dt).reshape(-1), variances


SensorModel = tuple[int, float, float, Array]


@lru_cache
def sensor_model(sensor: Any) -> SensorModel:
    """Return a sensor of `KINDS` as compiled loops take it: its kind, A and slope 10 eta / ln 10 of an RSSI, and R."""
    A, slope = (sensor.A, 10 * sensor.eta / np.log(10)) if isinstance(sensor, LogDistance) else (0.0, 0.0)
    return KINDS[type(sensor)], A, slope, readable(sensor.R)


def loop_model(sensor: Any) -> SensorModel | None:
    """Return a sensor as compiled loops take it; None where they do not know it, or its loss is robust."""
    return sensor_model(sensor) if type(sensor) in KINDS and loss_of(sensor) == "none" else None


def innovation(sensor: Sensor, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
    """Return y (..., k), H (..., k, d), Hq (..., k, 2) of readings z (..., k) of places q (..., 2) at x (..., d)."""
    if type(sensor) not in KINDS:
        return sensor.innovation(x, q, z)
    lead, d, k = x.shape[:-1], x.shape[-1], z.shape[-1]
    if q.ndim > 1 and q.shape[:-1] != lead:
        lead = np.broadcast_shapes(lead, q.shape[:-1])
    places = readable(q).reshape(-1, q.shape[-1]) if q.ndim == 1 else _vectors(q, lead)
    y, H = np.empty((*lead, k)), np.empty((*lead, k, d))
    out = y.reshape(-1, k), H.reshape(-1, k, d)
    model = sensor_model(sensor)[:3]  # type: ignore[arg-type]  # those of KINDS are frozen
    kalman_kernels.relate(*model, _vectors(x, lead), places, _vectors(z, lead), *out)
    return y, H, -H[..., :2]


def _vectors(part: Array, lead: tuple[int, ...]) -> Array:
    """Return an array (..., m) as rows (r, m), one for each of `lead`."""
    return spread_out(part, (*lead, part.shape[-1])).reshape(-1, part.shape[-1])


# The two steps of an EKF that need no teammate: a move by odometry, an update by readings of fixed things.


def predict_ekf(p: Any, world: World, x: Array, P: Array, z: Senses) -> tuple[Array, Array, Array]:
    """Return x' = f(x, u),  P' = F P F' + Q,  and F; x (..., d), P (..., d, d)."""
    if p.engine == "batched" and type(world.motion) is Unicycle:
        out, P1, F = np.empty(x.shape), np.empty(P.shape), np.empty(P.shape)
        rows = readable(P).reshape(-1, 3, 3), out.reshape(-1, 3), P1.reshape(-1, 3, 3), F.reshape(-1, 3, 3)
        kalman_kernels.drive_and_widen(*_wheels(world.motion, x, z), *rows)
        return out, P1, F
    x, F, Q = move(world.motion, x, z)
    return x, ENGINES[p.engine].predict(P, F, Q), F


def correct_ekf(p: Any, world: World, x: Array, P: Array, z: Senses) -> tuple[Array, Array]:
    """Return x + K y,  (I - K H) P (I - K H)' + K R K', one reading of an anchor or a landmark after the other."""
    if seen := landmarks_alone(p, world, z):
        d, x, P = x.shape[-1], x.copy(), P.copy()
        kalman_kernels.sight(x.reshape(-1, d), P.reshape(-1, d, d), *seen)
        return x, P
    for sensor, place, reading in fixed_readings(world, z, p.anchor_reading):
        y, H, _ = innovation(sensor, x, place, reading)
        y, H = soften(sensor, P, y, H)
        x, P = ENGINES[p.engine].update(x, P, y, H, sensor.R, p.gate)
    return x, P


def soften(sensor: Sensor, P: Array, y: Array, H: Array) -> tuple[Array, Array]:
    """Return `robust.rescale` of y and H; S = H P H' + R."""
    if (loss := loss_of(sensor)) == "none":
        return y, H
    y, H = rescale(loss, sensor.R, H @ P @ H.mT + sensor.R, y, H)
    return y, H


def landmarks_alone(p: Any, world: World, z: Senses) -> LandmarkSightings | None:
    """Return a tick's sightings of landmarks for a compiled loop, where nothing else is used of fixed things."""
    camera = world.sensors.get("landmark")
    if p.engine != "batched" or p.anchor_reading == "none" or type(camera) is not Sighting or camera.loss != "none":
        return None
    if "anchor_rssi" in world.sensors or "anchor_range" in world.sensors:
        return None
    return world.landmarks, readable(z.landmark).reshape(-1, *z.landmark.shape[-2:]), camera.R, p.gate


# The same two steps, and the estimate, for a state with fields x (..., d), P (..., d, d) and world.


def predict_belief(p: Any, s: Any, z: Senses) -> Any:
    """x' = f(x, u),  P' = F P F' + Q."""
    x, P, _ = predict_ekf(p, s.world, s.x, s.P, z)
    return s._replace(x=x, P=P)


def correct_belief(p: Any, s: Any, z: Senses) -> Any:
    """x' = x + K y,  P' = (I - K H) P (I - K H)' + K R K', one reading after the other."""
    x, P = correct_ekf(p, s.world, s.x, s.P, z)
    return s._replace(x=x, P=P)


def estimate_belief(p: Any, s: Any) -> Belief:
    """Return x with its heading in (-pi, pi], and P."""
    return Belief(wrap_heading(s.x), s.P)


# What Kalman filters put on the air: a belief and its sightings in one packet, and the count of what was sent.


class Message(NamedTuple):
    """A broadcast belief; a whole row of them where the leading axes are (receiver, sender)."""

    x: Array  # (..., d)
    P: tuple[Array, ...]  # (..., d, d) each: the covariance, or the parts that add up to it
    sightings: Array  # (..., n, k)  of each teammate, as range [m] and bearing [rad]; n = 0 where none are sent

    def pack(self) -> Array:
        """Return the packet (..., m): x, the upper triangle of each covariance, the sightings."""
        lead, d = self.x.shape[:-1], self.x.shape[-1]
        upper = (P.reshape(*lead, d * d).take(_triangle(d)[0], -1) for P in self.P)
        n, k = self.sightings.shape[-2:]
        return np.concatenate([self.x, *upper, self.sightings.reshape(*lead, n * k)], -1)

    @classmethod
    def unpack(cls, packets: Array, d: int, parts: int = 1) -> Self:
        """Return the messages in packets (..., n, m) of a state of d numbers and a covariance in `parts`."""
        square, size = _triangle(d)[1], d * (d + 1) // 2
        covariances = [packets.take(square + d + part * size, -1) for part in range(parts)]
        x, sightings = packets[..., :d], packets[..., d + parts * size :]
        n = packets.shape[-2] if sightings.shape[-1] else 0
        return cls(x, tuple(covariances), sightings.reshape(*packets.shape[:-1], n, -1 if n else 2))


@lru_cache
def _triangle(d: int) -> tuple[Indices, Indices]:
    """Return where the upper triangle is among a matrix's d^2 numbers, and each entry (d, d) in the triangle."""
    i, j = np.triu_indices(d)
    square = np.empty((d, d), np.int64)
    square[i, j] = square[j, i] = np.arange(len(i))
    return i * d + j, square


def no_traffic(x: Array) -> Traffic:
    """Return the traffic of robots with states x (t, n, d) that sent nothing."""
    return Traffic(np.zeros(x.shape[:2]), np.zeros(x.shape[:2]))


def count(sent: Traffic, robot: int, when: Mask, numbers: int) -> None:
    """Add, in place, a robot's message of so many numbers, 8 bytes each, in the trials `when` (t,) it was sent."""
    sent.messages[:, robot] += when
    sent.bytes[:, robot] += when * (8.0 * numbers + interface.HEADER)


# Readings between robots.


class PairReading(NamedTuple):
    """A reading between a robot and one whose packet it received."""

    sensor: Sensor
    sender: int
    z: Array  # (r, k)
    by_sender: bool  # whether the sender made it, of the robot; else the robot made it, of the sender

    def linearise(self, x: Array, x_j: Array) -> tuple[Array, Array, Array]:
        """Return y (r, k), H (r, k, d) of the robot itself, H_j (r, k, d) of the sender."""
        if self.by_sender:
            y, H_j, H = linearise(self.sensor, x_j, x, self.z)
            return y, H, H_j
        return linearise(self.sensor, x, x_j, self.z)


def receive(world: World, z: Senses, mail: Mail, sightings: Array, robot: Indices) -> Iterator[PairReading]:
    """Yield a robot's readings of its senders, then the `sightings` (r, sender, n, 2) of it that they sent."""
    for sensor, j, reading in world.relative(z, mail):
        yield PairReading(sensor, j, reading, by_sender=False)
    camera = world.sensors.get("sighting")
    if camera is not None and sightings.shape[2]:
        of_it = sightings[np.arange(len(robot)), :, robot]  # (r, sender, 2)
        for j in (~np.logical_and.reduce(np.isnan(of_it), (0, 2))).nonzero()[0].tolist():
            yield PairReading(camera, j, of_it[:, j], by_sender=True)


def pair_readings(world: World, z: Senses, air: Mail) -> Iterator[tuple[Sensor, int, int, Array]]:
    """Yield a team's readings (t, k) that exist as (sensor, receiver, sender, reading), sender by sender."""
    for sensor, j, reading in world.relative(z, air):
        there = np.asarray(~np.isnan(reading).all((0, 2)))
        there[j] = False
        yield from ((sensor, i, j, reading[:, i]) for i in np.flatnonzero(there).tolist())


def reading_tables(world: World, z: Senses, air: Mail) -> Iterator[tuple[Sensor, Array]]:
    """Yield the same readings as one array (t, receiver, sender, k) a sensor, nan on the diagonal."""
    for sensor, readings in world.of_teammates(z, air):
        if not np.isnan(readings).all():
            yield sensor, np.where(np.eye(world.robots, dtype=bool)[..., None], np.nan, readings)


def linearise(sensor: Sensor, x_i: Array, x_j: Array, reading: Array) -> tuple[Array, Array, Array]:
    """Return y (..., k), H_i (..., k, d), H_j (..., k, d) of a reading of j by i."""
    if isinstance(sensor, Orientation):
        return sensor.between(x_i, x_j, reading)
    y, H, Hq = innovation(sensor, x_i, x_j[..., :2], reading)
    H_j = np.zeros(H.shape)
    H_j[..., :2] = Hq
    return y, H, H_j


def soften_pair(
    sensor: Sensor, y: Array, H: Array, H_j: Array, P: Array, P_j: Array, *P_ij: Array, extra: Array | float = 0.0
) -> tuple[Array, Array, Array]:
    """Return `robust.rescale` of a reading of robot j; S = (H, H_j) (P, P_ij; P_ij', P_j) (H, H_j)' + R.

    P_ij is the product of the matrices given, or 0; `extra` is added to R.
    """
    if (loss := loss_of(sensor)) == "none":
        return y, H, H_j
    R = sensor.R + extra
    S = H @ P @ H.mT + H_j @ P_j @ H_j.mT + R
    if P_ij:
        both = H @ reduce(np.matmul, P_ij) @ H_j.mT
        S = S + both + both.mT
    y, H, H_j = rescale(loss, R, S, y, H, H_j)
    return y, H, H_j


def curvature(sensor: Sensor, x_i: Array, x_j: Array, D: Array) -> tuple[Array, Array]:
    """Return a range's second-order mean shift (..., k) and variance (..., k, k); x_i - x_j has D (..., 2, 2)."""
    return sensor.curvature(x_i, x_j[..., :2], D) if isinstance(sensor, Range) else (np.zeros(1), np.zeros((1, 1)))
