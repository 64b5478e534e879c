"""Gaussian belief propagation: every robot holds its own part of the team's factor graph, and messages do the rest.

A robot holds its last `window` poses, a chain tied by odometry and by readings of fixed things, solved at once, and one
factor for each of its readings of teammates. Once a tick robots tell each other what they know of such a pose, and what
a factor says of it; no message repeats what its receiver said. Where the graph is a tree the beliefs become exact;
where it has loops covariances become too small. What leaves the window each robot keeps as one Gaussian.

Sent to each teammate, in numbers of 8 bytes: 5 for the newest position, mean and covariance; and 5 from each for every
reading between the two in the window. The window, and what it keeps, are our reading of the source (its abstract).

Sources: R. Murai, J. Ortiz, S. Saeedi, P. Kelly, A. Davison, "A robot web for distributed many-device localisation",
IEEE T-RO 40, 2024, arXiv 2202.03314; A. Davison, J. Ortiz, "FutureMapping 2: Belief belief propagation for spatial
AI", arXiv 1910.14139 (Huber's weights); Y. Weiss, W. Freeman, "Correctness of belief propagation in Gaussian
graphical models of arbitrary topology", Neural Computation 13, 2001 (means exact, covariances not).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np

from cooploc.estimators.errors import require
from cooploc.estimators.interface import Array, Belief, Indices, Mail, Mask, Rows, Senses, Sensor, World
from cooploc.estimators.kalman import linearise, symmetric
from cooploc.estimators.kalman_window import Window, append_tick, drop_oldest, empty, map_senses, smooth, times
from cooploc.estimators.models import RAW, AnchorReading, fixed_channels, fixed_readings, gradient_doa, wrap_heading
from cooploc.estimators.particle_likelihood import pack, unpack
from cooploc.estimators.robust import Loss, weights

# Factors of readings between two robots, and the four messages that pass between such a factor and its two poses.
#
# z = h(x_i, x_j) + noise is linear about (x_i^0, x_j^0):  y = H dx_i + H_j dx_j + noise of covariance R.


class Information(NamedTuple):
    """eta = H'R^-1 z and Lambda = H'R^-1 H, which add up; nan where there is none."""

    eta: Array  # (..., d)
    Lambda: Array  # (..., d, d)

    def about(self, at: Array) -> "Information":
        """Return a position's (r, l, n, 2) as that of deviations from poses `at` (r, l, d); 0 where there is none."""
        eta, Lambda = map(np.nan_to_num, self)
        one = np.eye(at.shape[-1], 2)
        return Information(times(one, eta - times(Lambda, at[:, :, None, :2])), one @ Lambda @ one.T)

    def subtract_from(self, belief: Belief) -> Belief:
        """Return the belief without this information: (I - P Lambda)^-1 (x - P eta), (I - P Lambda)^-1 P."""
        x, P = belief
        keep = np.asarray(np.linalg.inv(np.eye(P.shape[-1]) - P @ self.Lambda), float)
        return Belief(times(keep, x - times(P, self.eta)), symmetric(keep @ P))


class PairFactors(NamedTuple):
    """A robot's readings of teammates, linearised; H = 0 where there is none."""

    y: Array  # (r, l, n, k)
    H: Array  # (r, l, n, k, d)
    H_j: Array  # (r, l, n, k, 2)
    R: Array  # (r, l, n, k, k)
    seen_at: Array  # (r, l, n, 2)  x_j^0

    def onto_self(self, theirs: Belief) -> Information:
        """Return the message to x_i: H' S^-1 v, H' S^-1 H with v = y - H_j (m - x_j^0), S = R + H_j C H_j'."""
        v, S = self._whiten_by(theirs)
        W = self.H.mT @ np.linalg.inv(S)
        return Information(times(W, v), W @ self.H)

    def onto_teammate(self, own: Belief) -> Information:
        """Return the message to x_j: H_j' S^-1 v, H_j' S^-1 H_j, v = y - H own.x + H_j x_j^0, S = R + H P H'."""
        v = self.y - times(self.H, own.x) + times(self.H_j, self.seen_at)
        W = self.H_j.mT @ np.linalg.inv(self.R + self.H @ own.P @ self.H.mT)
        return Information(times(W, v), symmetric(W @ self.H_j))

    def follow(self, theirs: Belief, dx: Array) -> Array:
        """Return x_j (r, l, n, 2) given x_i = x_i^0 + dx: m + C H_j' S^-1 (v - H dx)."""
        v, S = self._whiten_by(theirs)
        off = v - times(self.H, dx[:, :, None])
        return theirs.x + times(theirs.P @ self.H_j.mT @ np.linalg.inv(S), off)

    def _whiten_by(self, theirs: Belief) -> tuple[Array, Array]:
        m, C = np.where(np.isnan(theirs.x), self.seen_at, theirs.x), np.nan_to_num(theirs.P)
        return self.y - times(self.H_j, m - self.seen_at), self.R + self.H_j @ C @ self.H_j.mT


HUBER = 3.0  # [standard deviations of the reading] beyond which Huber's loss is linear


def weigh(y: Array, R: Array, loss: Loss, *Hs: Array) -> tuple[Array, Array, list[Array]]:
    """Return y, R / w and H, 0 where there is no reading; w = 2 h/M - h^2/M^2 where M = |y|_R exceeds h (Huber).

    So half of y' (R/w)^-1 y is Huber's loss (Davison & Ortiz 2019, sec. 3.6); Student's w is that of `robust.weights`.
    """
    there: Mask = np.asarray(~np.isnan(y).any(-1))
    y, R = np.where(there[..., None], y, 0.0), np.broadcast_to(R, (*y.shape, y.shape[-1]))
    M = np.sqrt((y * np.linalg.solve(R, y[..., None])[..., 0]).sum(-1))
    share = HUBER / np.maximum(M, HUBER)
    w = 2 * share - share**2 if loss == "huber" else weights(loss, M**2, y.shape[-1])
    return y, R / w[..., None, None], [np.where(there[..., None, None], H, 0.0) for H in Hs]


# What a robot holds: a chain of poses, factors to teammates, and the messages that came; solved by one smoother.


class State(NamedTuple):
    """A robot's part of the graph: n teammates, l poses, oldest first; nan where there is no factor or message."""

    own: Window  # poses as a team of one, x (r, l, 1, d)
    P: Array  # (r, l, d, d)  their covariances
    at: Array  # (r, l, d)  where the last solution was linearised
    reading: Array  # (r, l, n, k)  this robot's readings of teammates
    theirs: Belief  # (r, l, n, 2)  each teammate's position without the robot's reading: the message to its factor
    seen: Array  # (r, l, n, 2)  each teammate's position with the reading
    seen_at: Array  # (r, l, n, 2)  where the last solution was linearised
    heard: Information  # (r, l, n, 2)  on the robot's position, from the factors of teammates
    newest: Belief  # (r, d)
    oldest: Belief  # (r, d)  of the oldest pose from what is before and at it
    robot: Indices  # (r,)
    world: World

    @property
    def x(self) -> Array:
        """The poses (r, l, d)."""
        return self.own.x[:, :, 0]

    def factors(self, loss: Loss) -> PairFactors:
        """Return the robot's readings of teammates, as they stand in the last solution."""
        sensor, seen_at = _of_teammates(self.world), np.nan_to_num(self.seen_at)
        y, H, H_j = linearise(sensor, self.at[:, :, None], seen_at, self.reading)
        y = np.where(np.isnan(self.seen_at[..., :1]), np.nan, y)
        y, R, (H, H_j) = weigh(y, sensor.R, loss, H, H_j[..., :2])
        return PairFactors(y, H, H_j, R, seen_at)


def _of_teammates(world: World) -> Sensor:
    """Return the sensor of readings of teammates: the runner leaves one."""
    return next(world.sensors[c] for c in ("sighting", "radio_range", "radio_rssi") if c in world.sensors)


def _map_fields(f: Callable[[Any], Any], s: State, *names: str) -> State:
    """Return the state with f of each array in these fields."""
    old: list[Any] = [getattr(s, name) for name in names]
    new: list[Any] = [type(a)(*map(f, a)) if isinstance(a, tuple) else f(a) for a in old]
    return s._replace(**dict(zip(names, new, strict=True)))


def relax(s: State, iterations: int, anchor_reading: AnchorReading, loss: Loss) -> State:
    """Solve the chain so many times, linearised at what the last solution found: Gauss-Newton with messages as data.

    A teammate's position follows the solution: x_j = m + C H_j' S^-1 (v - H dx), S = R + H_j C H_j'.
    """
    for _ in range(iterations):
        s = s._replace(at=s.x, seen_at=s.seen)
        pairs = s.factors(loss)
        eta, Lambda = _fixed_information(s, anchor_reading, loss)
        for message in (pairs.onto_self(s.theirs), s.heard.about(s.at)):
            eta, Lambda = eta + message.eta.sum(2), Lambda + message.Lambda.sum(2)
        solution = smooth(s.own, eta, Lambda)
        dx = wrap_heading(solution.x[:, :, 0] - s.at)
        newest, oldest = solution.filtered[-1], solution.filtered[0]
        own = s.own._replace(x=solution.x, P=newest.P)
        s = s._replace(own=own, P=solution.P, seen=pairs.follow(s.theirs, dx), newest=newest, oldest=oldest)
    return s


def _fixed_information(s: State, anchor_reading: AnchorReading, loss: Loss) -> tuple[Array, Array]:
    """Return eta (r, l, d), Lambda (r, l, d, d) of readings of anchors and landmarks, about `at`."""
    eta, Lambda = np.zeros(s.at.shape), np.zeros((*s.at.shape, s.at.shape[-1]))
    for sensor, place, reading in fixed_readings(s.world, s.own.z, anchor_reading):
        y, H, _ = sensor.innovation(s.at, place, reading[:, :, 0])
        y, R, (H,) = weigh(y, sensor.R, loss, H)
        W = H.mT @ np.linalg.inv(R)
        eta += times(W, y)
        Lambda += W @ H
    return eta, Lambda


# What robots send each other: of own positions to the teammate's factors, and from own factors to its positions.

NUMBERS = 5  # of a position's mean and covariance, or of its information


class Packet(NamedTuple):
    """Messages of one robot to each teammate, or to one robot from each; nan where there is none."""

    mine: Belief  # (r, l, n, 2)  the sender's positions, without what the receiver's factors say of them
    yours: Information  # (r, l, n, 2)  of the receiver's positions, from the sender's factors

    def pack(self, window: int) -> Array:
        """Return (r, n, 10 window) numbers; nan before the first tick."""
        numbers = np.concatenate([pack(self.mine), pack(Belief(*self.yours))], -1)  # (r, l, n, 10)
        r, length, n, m = numbers.shape
        before = np.full((r, window - length, n, m), np.nan)
        return np.concatenate([before, numbers], 1).swapaxes(1, 2).reshape(r, n, -1)

    @classmethod
    def unpack(cls, packets: Array, length: int) -> Self:
        """Return the messages about the last `length` ticks in packets (r, n, m)."""
        numbers = packets.reshape(*packets.shape[:2], -1, 2 * NUMBERS)[:, :, -length:].swapaxes(1, 2)
        mine, yours = np.split(numbers, 2, -1)
        return cls(unpack(mine), Information(*unpack(yours)))


def _update_known(old: Array, new: Array) -> Array:
    return np.where(np.isnan(new), old, new)


def _mask(use: Mask, part: Belief | Information) -> Belief:
    vector, matrix = part
    return Belief(np.where(use[..., None], vector, np.nan), np.where(use[..., None, None], matrix, np.nan))


@dataclass(frozen=True)
class Gbp:
    """Gaussian belief propagation over a sliding window of every robot's poses.

    Parameters:
        window: poses that a robot holds [ticks, at least 1].
        iterations: how often a robot linearises and solves its own window after the mail of a tick [count, at least 1].
        anchor_reading: "rssi", each raw reading of an anchor [dBm]; "doa", the direction of arrival [rad] made of four
            corners, with the variance that it has where the robot is; "doa-constant", with one variance everywhere;
            "gradient", the gradient [dB/m] it is taken from; "any", each reading of whatever fixed things there are:
            RSSI [dBm] and ranges [m] of anchors, sightings of landmarks; or "none".
        reading: the radio reading that is used where no camera sees teammates: "range" [m] or "rssi" [dBm].
        loss: how errors of many standard deviations count: less, as in Huber's loss ("huber", beyond 3) or for the
            noise of Student's t ("student"); or fully ("none").
    """

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "messages of both ends of each reading"
    consistency: ClassVar[str] = "over-confident: what comes around a loop counts as new"
    window: int = 10
    iterations: int = 1
    anchor_reading: AnchorReading = "rssi"
    reading: Literal["range", "rssi"] = "range"
    loss: Loss = "huber"

    def __post_init__(self) -> None:
        require(self, {"window": (1, 1000), "iterations": (1, 1000)})

    @property
    def uses(self) -> tuple[str, ...]:
        """Return the channels, in order of preference."""
        return ("odometry", *fixed_channels(self.anchor_reading), f"sighting|radio_{self.reading}")

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        if self.anchor_reading not in (*RAW, "none") and "anchor_rssi" in world.sensors:
            gradient_doa(world)
        r, n, d = len(rows.robot), world.robots, prior.x.shape[-1]
        vectors, matrices = np.empty((r, 0, n, 2)), np.empty((r, 0, n, 2, 2))
        none = Belief(vectors, matrices), vectors, vectors, Information(vectors, matrices)
        own = empty(Belief(prior.x[:, None], prior.P[:, None]), world)
        reading = np.empty((r, 0, n, len(_of_teammates(world).R)))
        return State(own, np.empty((r, 0, d, d)), np.empty((r, 0, d)), reading, *none, prior, prior, rows.robot, world)

    def predict(self, s: State, z: Senses) -> State:
        """Add a new pose x' = f(x, u) at the end of the window, without readings or messages of teammates."""
        alone = map_senses(lambda reading: reading[:, None], z)

        def append(past: Array) -> Array:
            return np.concatenate([past, np.full((len(past), 1, *past.shape[2:]), np.nan)], 1)

        return _map_fields(append, s._replace(own=append_tick(s.own, alone)), "reading", "theirs", "seen", "heard")

    def correct(self, s: State, z: Senses) -> State:
        """Solve the window with this tick's readings of fixed things, so that messages have them."""
        return relax(s, 1, self.anchor_reading, self.loss)

    def send(self, s: State, z: Senses) -> Array:
        """Return a packet (r, n, m) for each teammate.

        Of an own position: the belief without the information that came from the teammate's factor; of the newest to
        all, of older ones to those that are known to have read it. Of a teammate's position: what the own factor says
        of it, given the own pose without that factor.
        """
        x, P = s.x, s.P
        n, newest = s.world.robots, np.arange(x.shape[1]) == x.shape[1] - 1
        other = np.arange(n) != s.robot[:, None, None]
        position = Belief(*(np.repeat(a[:, :, None], n, 2) for a in (x[..., :2], P[..., :2, :2])))
        mine = Information(*map(np.nan_to_num, s.heard)).subtract_from(position)
        asked = ~np.isnan(s.heard.eta[..., 0]) | newest[:, None]
        factors = s.factors(self.loss)
        off = Belief(np.repeat(wrap_heading(x - s.at)[:, :, None], n, 2), np.repeat(P[:, :, None], n, 2))
        yours = factors.onto_teammate(factors.onto_self(s.theirs).subtract_from(off))
        made = factors.H_j.any((-2, -1))
        return Packet(_mask(asked & other, mine), Information(*_mask(made & other, yours))).pack(self.window)

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        """Take newer messages, and readings of robots that were heard as factors. The oldest pose may leave."""
        packet = Packet.unpack(mail.packets, s.own.x.shape[1])
        reading = z.sighting if "sighting" in s.world.sensors else getattr(mail, self.reading)[..., None]
        heard = mail.heard[..., None] & ~np.isnan(packet.mine.x[:, -1, :, :1])
        readings = s.reading.copy()
        readings[:, -1] = np.where(heard, reading, np.nan)
        mine = _mask(np.asarray(~np.isnan(readings).any(-1)), packet.mine)
        theirs = Belief(*map(_update_known, s.theirs, mine))
        known = Information(*map(_update_known, s.heard, packet.yours))
        s = s._replace(reading=readings, theirs=theirs, heard=known, seen=_update_known(theirs.x, s.seen))
        s = relax(s, self.iterations, self.anchor_reading, self.loss)
        if s.own.x.shape[1] < self.window:
            return s
        dated = "P", "at", "reading", "theirs", "seen", "seen_at", "heard"
        return _map_fields(lambda a: a[:, 1:], s._replace(own=drop_oldest(s.own, s.oldest)), *dated)

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.newest.x), s.newest.P)
