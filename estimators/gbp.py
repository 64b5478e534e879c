"""Gaussian belief propagation: every robot holds its own part of the team's factor graph, and messages do the rest.

A robot holds its last `window` poses, a chain tied by odometry and by readings of fixed things, and one factor for
each of its readings of teammates. Such a factor also depends on a pose that the teammate holds. What the one knows of
that pose, and what the other's factor says of it, go over the air in every tick as long as the pose is in the window;
no message repeats what its receiver said. A lost packet loses this tick's messages, and the next one brings newer
ones. Where the graph is a tree the beliefs become exact, means and covariances. Where it has loops, and two robots
that meet twice make one, the means converge to the most probable poses of `map-joint`, and covariances become too
small: what came around a loop counts as new. What leaves the window each robot keeps for itself, as one Gaussian.
That two robots have it from each other is forgotten then, and where they meet again it counts twice, as in
`ekf_naive.py`.

Within a robot the chain is solved at once, which costs no message, `iterations` times a tick. Between robots messages
go once a tick, as the mail of this world does; in the source any number of times. Whether the source lets poses leave
a window is not said in what we have of it (the abstract and talks): the window, and what it keeps, are our reading.

Sent to each teammate, in numbers of 8 bytes: 5 for the newest position, mean and covariance; and for every reading
between the two in the window 5 from each: who was read says where it was then, who read says what this tells of it.

Sources: R. Murai, J. Ortiz, S. Saeedi, P. Kelly, A. Davison, "A robot web for distributed many-device localisation",
IEEE T-RO 40, 2024, arXiv 2202.03314; A. Davison, J. Ortiz, "FutureMapping 2: Gaussian belief propagation for spatial
AI", arXiv 1910.14139 (Huber's weights); Y. Weiss, W. Freeman, "Correctness of belief propagation in Gaussian
graphical models of arbitrary topology", Neural Computation 13, 2001 (means exact, covariances not).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np

from cooploc.estimators.errors import require
from cooploc.estimators.interface import Array, Belief, Indices, Mail, Mask, Rows, Senses, Sensor, World
from cooploc.estimators.kalman import linearise, symmetric
from cooploc.estimators.kalman_window import READINGS, Window, append_tick, drop_oldest, empty, smooth
from cooploc.estimators.models import RAW, AnchorReading, fixed, gradient_doa, wrap_heading

# Factors of readings between two robots, and the four messages that pass between such a factor and its two poses.
#
# z = h(x_i, x_j) + noise is linear about (x_i^0, x_j^0):  y = H dx_i + H_j dx_j + noise of covariance R.


class Gaussian(NamedTuple):
    """Mean and covariance; nan where there is none."""

    x: Array  # (..., d)
    P: Array  # (..., d, d)


class Information(NamedTuple):
    """eta = H'R^-1 z and Lambda = H'R^-1 H, which add up; nan where there is none."""

    eta: Array  # (..., d)
    Lambda: Array  # (..., d, d)

    def about(self, at: Array) -> "Information":
        """Of a position (r, l, n, 2), as that of deviations from poses `at` (r, l, d); 0 where there is none."""
        eta, Lambda = (np.nan_to_num(a) for a in self)
        d = at.shape[-1]
        eta = eta - times(Lambda, at[:, :, None, :2])
        return Information(_pad(eta, d, 1), _pad(Lambda, d, 2))

    def taken_from(self, belief: Gaussian) -> Gaussian:
        """The belief without this information: (I - P Lambda)^-1 (x - P eta), (I - P Lambda)^-1 P."""
        x, P = belief
        keep = np.asarray(np.linalg.inv(np.eye(P.shape[-1]) - P @ self.Lambda), float)
        return Gaussian(times(keep, x - times(P, self.eta)), symmetric(keep @ P))


class PairFactors(NamedTuple):
    """A robot's readings of teammates, linearised; H = 0 where there is none."""

    y: Array  # (r, l, n, k)
    H: Array  # (r, l, n, k, d)
    H_j: Array  # (r, l, n, k, 2)
    R: Array  # (r, l, n, k, k)
    seen_at: Array  # (r, l, n, 2)  x_j^0

    def onto_self(self, theirs: Gaussian) -> Information:
        """To x_i, about x_i^0: H' S^-1 v, H' S^-1 H with v = y - H_j (m - x_j^0), S = R + H_j C H_j'."""
        v, S = self._without_teammate(theirs)
        W = self.H.mT @ np.linalg.inv(S)
        return Information(times(W, v), W @ self.H)

    def onto_teammate(self, own: Gaussian) -> Information:
        """To x_j, from x_i^0 + own.x: H_j' S^-1 v, H_j' S^-1 H_j with v = y - H own.x + H_j x_j^0, S = R + H P H'."""
        v = self.y - times(self.H, own.x) + times(self.H_j, self.seen_at)
        W = self.H_j.mT @ np.linalg.inv(self.R + self.H @ own.P @ self.H.mT)
        return Information(times(W, v), symmetric(W @ self.H_j))

    def follow(self, theirs: Gaussian, dx: Array) -> Array:
        """x_j (r, l, n, 2) given x_i = x_i^0 + dx: m + C H_j' S^-1 (v - H dx)."""
        v, S = self._without_teammate(theirs)
        off = v - times(self.H, dx[:, :, None])
        return theirs.x + times(theirs.P @ self.H_j.mT @ np.linalg.inv(S), off)

    def _without_teammate(self, theirs: Gaussian) -> tuple[Array, Array]:
        m, C = np.where(np.isnan(theirs.x), self.seen_at, theirs.x), np.nan_to_num(theirs.P)
        return self.y - times(self.H_j, m - self.seen_at), self.R + self.H_j @ C @ self.H_j.mT


def linearise_pair(sensor: Sensor, x: Array, seen: Array, reading: Array, huber: float) -> PairFactors:
    """Factors about own poses x (r, l, d) and teammates' positions `seen` (r, l, n, 2)."""
    seen_at = np.nan_to_num(seen)
    y, H, H_j = linearise(sensor, x[:, :, None], seen_at, reading)
    y, R, (H, H_j) = weigh(np.where(np.isnan(seen[..., :1]), np.nan, y), sensor.R, huber, H, H_j[..., :2])
    return PairFactors(y, H, H_j, R, seen_at)


def weigh(y: Array, R: Array, huber: float, *Hs: Array) -> tuple[Array, Array, list[Array]]:
    """y, R / w and H with 0 where there is no reading; w = 2 h/M - h^2/M^2 where M = |y|_R exceeds h = `huber`.

    So half of y' (R/w)^-1 y is Huber's loss (Davison & Ortiz 2019, sec. 3.6).
    """
    there: Mask = np.asarray(~np.isnan(y).any(-1))
    y, R = np.where(there[..., None], y, 0.0), np.broadcast_to(R, (*y.shape, y.shape[-1]))
    M = np.sqrt((y * np.linalg.solve(R, y[..., None])[..., 0]).sum(-1))
    share = huber / np.maximum(M, huber) if np.isfinite(huber) else np.ones_like(M)
    return y, R / (2 * share - share**2)[..., None, None], [np.where(there[..., None, None], H, 0.0) for H in Hs]


def times(A: Array, x: Array) -> Array:
    """A x of matrices (..., m, k) and vectors (..., k)."""
    product: Array = (A @ x[..., None])[..., 0]
    return product


def _pad(a: Array, d: int, axes: int) -> Array:
    """With zeros for the numbers of a pose (d) beyond its position, in the last `axes`."""
    return np.pad(a, [(0, 0)] * (a.ndim - axes) + [(0, d - 2)] * axes)


# What a robot holds: a chain of poses, factors to teammates, and the messages that came; solved by one smoother.


class State(NamedTuple):
    """One robot's part of the graph; n teammates, l poses, oldest first. nan where there is no factor or message."""

    own: Window  # poses as a team of one, x (r, l, 1, d)
    P: Array  # (r, l, d, d)  their covariances
    at: Array  # (r, l, d)  where the last solution was linearised
    reading: Array  # (r, l, n, k)  this robot's readings of teammates
    theirs: Gaussian  # (r, l, n, 2)  each teammate's position without the robot's reading: the message to its factor
    seen: Array  # (r, l, n, 2)  each teammate's position with the reading
    seen_at: Array  # (r, l, n, 2)  where the last solution was linearised
    told: Information  # (r, l, n, 2)  of the robot's position, from the factors of teammates
    newest: Belief  # (r, d)
    oldest: Belief  # (r, d)  of the oldest pose from what is before and at it
    robot: Indices  # (r,)
    world: World

    @property
    def x(self) -> Array:
        """The poses (r, l, d)."""
        return self.own.x[:, :, 0]

    def factors(self, huber: float) -> PairFactors:
        """The robot's readings of teammates, as they stand in the last solution."""
        channel = next(c for c in ("sighting", "radio_range", "radio_rssi") if c in self.world.sensors)
        return linearise_pair(self.world.sensors[channel], self.at, self.seen_at, self.reading, huber)

    def append_pose(self, own: Window) -> Self:
        """With a new pose, of which no teammate has said anything."""
        r, n = len(self.robot), self.world.robots
        k = 2 if "sighting" in self.world.sensors else 1

        def longer(past: Array, *shape: int) -> Array:
            return np.concatenate([past, np.full((r, 1, n, *shape), np.nan)], 1)

        return self._replace(
            own=own,
            reading=longer(self.reading, k),
            theirs=Gaussian(longer(self.theirs.x, 2), longer(self.theirs.P, 2, 2)),
            seen=longer(self.seen, 2),
            told=Information(longer(self.told.eta, 2), longer(self.told.Lambda, 2, 2)),
        )

    def drop_oldest_pose(self, own: Window) -> Self:
        """Without the oldest pose, and what was said of it."""
        cut = {name: getattr(self, name)[:, 1:] for name in ("P", "at", "reading", "seen", "seen_at")}
        theirs, told = Gaussian(*(a[:, 1:] for a in self.theirs)), Information(*(a[:, 1:] for a in self.told))
        return self._replace(own=own, theirs=theirs, told=told, **cut)


def start(prior: Belief, world: World, robot: Indices) -> State:
    """Before the first tick: no poses."""
    r, n, d = len(robot), world.robots, prior.x.shape[-1]
    k = 2 if "sighting" in world.sensors else 1
    vectors, matrices = np.empty((r, 0, n, 2)), np.empty((r, 0, n, 2, 2))
    none = Gaussian(vectors, matrices), Information(vectors, matrices)
    own = empty(Belief(prior.x[:, None], prior.P[:, None]), world)
    P, at, reading = np.empty((r, 0, d, d)), np.empty((r, 0, d)), np.empty((r, 0, n, k))
    return State(own, P, at, reading, none[0], vectors, vectors, none[1], prior, prior, robot, world)


def relax(s: State, iterations: int, anchor_reading: AnchorReading, huber: float) -> State:
    """The chain solved so many times, linearised at what the last solution found: Gauss-Newton with messages as data.

    A teammate's position follows the solution: x_j = m + C H_j' S^-1 (v - H dx), S = R + H_j C H_j'.
    """
    for _ in range(iterations):
        s = s._replace(at=s.x, seen_at=s.seen)
        pairs = s.factors(huber)
        eta, Lambda = _fixed(s, anchor_reading, huber)
        for message in (pairs.onto_self(s.theirs), s.told.about(s.at)):
            eta, Lambda = eta + message.eta.sum(2), Lambda + message.Lambda.sum(2)
        solution = smooth(s.own, eta, Lambda)
        dx = wrap_heading(solution.x[:, :, 0] - s.at)
        newest, oldest = solution.filtered[-1], solution.filtered[0]
        own = s.own._replace(x=solution.x, P=newest.P)
        s = s._replace(own=own, P=solution.P, seen=pairs.follow(s.theirs, dx), newest=newest, oldest=oldest)
    return s


def _fixed(s: State, anchor_reading: AnchorReading, huber: float) -> tuple[Array, Array]:
    """eta (r, l, d) and Lambda (r, l, d, d) of readings of anchors and landmarks, relative to `at`."""
    eta, Lambda = np.zeros(s.at.shape), np.zeros((*s.at.shape, s.at.shape[-1]))
    for sensor, place, reading in fixed(s.world, s.own.z, anchor_reading):
        y, H, _ = sensor.innovation(s.at, place, reading[:, :, 0])
        y, R, (H,) = weigh(y, sensor.R, huber, H)
        W = H.mT @ np.linalg.inv(R)
        eta += (W @ y[..., None])[..., 0]
        Lambda += W @ H
    return eta, Lambda


# What robots send each other: of own positions to the teammate's factors, and from own factors to its positions.

NUMBERS = 5  # of a position's mean and covariance, or of its information


class Packet(NamedTuple):
    """Messages of one robot to each teammate, or to one robot from each; nan where there is none."""

    mine: Gaussian  # (r, l, n, 2)  the sender's positions, without what the receiver's factors say of them
    yours: Information  # (r, l, n, 2)  of the receiver's positions, from the sender's factors

    def pack(self, window: int) -> Array:
        """(r, n, 10 window) numbers; nan before the first tick."""
        numbers = np.concatenate([_to_numbers(*self.mine), _to_numbers(*self.yours)], -1)  # (r, l, n, 10)
        r, length, n, m = numbers.shape
        before = np.full((r, window - length, n, m), np.nan)
        return np.concatenate([before, numbers], 1).swapaxes(1, 2).reshape(r, n, -1)

    @classmethod
    def unpack(cls, packets: Array, length: int) -> Self:
        """The messages about the last `length` ticks in packets (r, n, m)."""
        numbers = packets.reshape(*packets.shape[:2], -1, 2 * NUMBERS)[:, :, -length:].swapaxes(1, 2)
        mine, yours = np.split(numbers, 2, -1)
        return cls(Gaussian(*_parts(mine)), Information(*_parts(yours)))


def outgoing(s: State, huber: float) -> Packet:
    """What to send to each teammate.

    Of an own position: the belief without the information that came from the teammate's factor; of the newest to all,
    of older ones to those that are known to have read it. Of a teammate's position: what the own factor says of it,
    given the own pose without that factor.
    """
    x, P = s.x, s.P
    n, newest = s.world.robots, np.arange(x.shape[1]) == x.shape[1] - 1
    told = Information(*(np.nan_to_num(a) for a in s.told))
    position = Gaussian(*(np.repeat(a[:, :, None], n, 2) for a in (x[..., :2], P[..., :2, :2])))
    mine = told.taken_from(position)
    asked = ~np.isnan(s.told.eta[..., 0]) | newest[:, None]
    factors = s.factors(huber)
    message = factors.onto_self(s.theirs)
    off = Gaussian(np.repeat(wrap_heading(x - s.at)[:, :, None], n, 2), np.repeat(P[:, :, None], n, 2))
    yours = factors.onto_teammate(message.taken_from(off))
    made = factors.H_j.any((-2, -1))
    other = np.arange(n) != s.robot[:, None, None]
    return Packet(
        Gaussian(*_select_where(np.asarray(asked & other), *mine)), Information(*_select_where(made & other, *yours))
    )


def receive(s: State, reading: Array, packet: Packet) -> State:
    """Messages that came replace those before them; a reading (r, n, k) of who was heard becomes a factor."""
    readings = s.reading.copy()
    readings[:, -1] = np.where(np.isnan(packet.mine.x[:, -1, :, :1]), np.nan, reading)
    wanted = np.asarray(~np.isnan(readings).any(-1))
    theirs = Gaussian(*_newer(s.theirs, _select_where(wanted, *packet.mine)))
    told = Information(*_newer(s.told, packet.yours))
    seen = np.where(np.isnan(s.seen), theirs.x, s.seen)
    return s._replace(reading=readings, theirs=theirs, told=told, seen=seen)


def _newer(old: tuple[Array, Array], new: tuple[Array, Array]) -> Iterator[Array]:
    return (np.where(np.isnan(b), a, b) for a, b in zip(old, new, strict=True))


def _select_where(use: Mask, vector: Array, matrix: Array) -> tuple[Array, Array]:
    return np.where(use[..., None], vector, np.nan), np.where(use[..., None, None], matrix, np.nan)


def _to_numbers(vector: Array, matrix: Array) -> Array:
    return np.concatenate([vector, matrix[..., [0, 0, 1], [0, 1, 1]]], -1)


def _parts(numbers: Array) -> tuple[Array, Array]:
    a, b, c = np.moveaxis(numbers[..., 2:], -1, 0)
    return numbers[..., :2], np.stack([np.stack([a, b], -1), np.stack([b, c], -1)], -2)


@dataclass(frozen=True)
class Gbp:
    """Gaussian belief propagation over a sliding window of every robot's poses.

    Parameters:
        window: poses that a robot holds [ticks, at least 1].
        iterations: how often a robot linearises and solves its own window after the mail of a tick [count, at least 1].
        anchor_reading: "rssi", each raw reading of an anchor [dBm]; "doa", the direction of arrival [rad] made of four
            corners, with the variance that it has where the robot is; "doa-constant", with one variance everywhere;
            "gradient", the gradient [dB/m] it is taken from; "any", as "rssi", and nothing where there are neither
            anchors nor landmarks; or "none", no reading of anchors, nor of landmarks.
        reading: the radio reading that is used where no camera sees teammates: "range" [m] or "rssi" [dBm].
        huber: errors beyond so many standard deviations (no unit) count less, as in Huber's loss; inf: all count fully.
    """

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "messages of both ends of each reading"
    consistency: ClassVar[str] = "over-confident: what comes around a loop counts as new"
    window: int = 10
    iterations: int = 1
    anchor_reading: AnchorReading = "rssi"
    reading: Literal["range", "rssi"] = "range"
    huber: float = 3.0

    def __post_init__(self) -> None:
        require(self, window=(1, 1000), iterations=(1, 1000), huber=(0.1, np.inf))

    @property
    def uses(self) -> tuple[str, ...]:
        """The channels, in order of preference."""
        optional = "?" * (self.anchor_reading == "any")
        fixed = () if self.anchor_reading == "none" else ("anchor_rssi|landmark" + optional,)
        return ("odometry", *fixed, f"sighting|radio_{self.reading}")

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        if self.anchor_reading not in (*RAW, "none") and "anchor_rssi" in world.sensors:
            gradient_doa(world)
        return start(prior, world, rows.robot)

    def predict(self, s: State, z: Senses) -> State:
        """A new pose x' = f(x, u) at the end of the window, which nobody has yet said anything about."""
        alone = z._replace(**{name: getattr(z, name)[:, None] for name in READINGS})
        return s.append_pose(append_tick(s.own, alone))

    def correct(self, s: State, z: Senses) -> State:
        """The window solved with this tick's readings of fixed things, so that what is sent has them."""
        return relax(s, 1, self.anchor_reading, self.huber)

    def send(self, s: State, z: Senses) -> Array:
        """One packet (r, n, m) for each teammate: what is known of own positions, and of the teammate's."""
        return outgoing(s, self.huber).pack(self.window)

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        """Newest messages replace older ones; readings of who was heard become factors. The oldest pose may leave."""
        reading = z.sighting if "sighting" in s.world.sensors else getattr(mail, self.reading)[..., None]
        packet = Packet.unpack(mail.packets, s.own.x.shape[1])
        s = receive(s, np.where(mail.heard[..., None], reading, np.nan), packet)
        s = relax(s, self.iterations, self.anchor_reading, self.huber)
        return s.drop_oldest_pose(drop_oldest(s.own, s.oldest)) if s.own.x.shape[1] == self.window else s

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.newest.x), s.newest.P)
