"""Channel filters: each link remembers the information it has carried, so that it is not counted again.

Each robot runs a particle filter on its own readings. It broadcasts the mean and covariance of its particles, and how
far odometry has carried it so far. For each teammate it keeps a Gaussian of both their positions, the channel: the
information C that both have, moved by the odometry that each reports. When beliefs are exchanged only their news beyond
C counts. With C_i the marginal of C and z a reading between the two,

    C+ = C  (Bel_i / C_i)  (Bel_j / C_j)  p(z | x_i, x_j),    Bel_i+ = Bel_i  C+_i / (C Bel_i / C_i)_i.

Two robots that hear each other in every tick, in a linear-Gaussian world with the same reading at both ends, are the
centralised filter. Otherwise information is counted twice: what comes around a loop of links, and, after a lost packet
that its sender does not know of, what that carried.

Source: S. Grime, H. Durrant-Whyte, "Data fusion in decentralized sensor networks", Control Engineering Practice 2(5),
1994. Gaussians of particles as beliefs, and the pair of positions as the common state, are our reading.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from cooploc.estimators import particles as shared
from cooploc.estimators.interface import Array, Belief, Indices, Mail, Mask, Rows, Senses, Sensor, World
from cooploc.estimators.kalman import curvature, kalman, symmetric
from cooploc.estimators.particle_likelihood import pack, unpack
from cooploc.estimators.robust import AssumedLoss, loss_of, rescale
from cooploc.estimators.tunable import tunable

VAGUE = 1e3  # sides of the arena: the standard deviation of a channel over which nothing was said


class LinkInformation(NamedTuple):
    """log of a Gaussian factor: eta' e - e' Y e / 2, with e the offset from a stated point."""

    eta: Array  # (k, 2) [1/m]
    Y: Array  # (k, 2, 2) [1/m^2], not negative


class State(NamedTuple):
    """The memory of one robot."""

    own: shared.FilterState
    channel: Belief  # x (r, n, 4), P (r, n, 4, 4)  of its own position and each teammate's
    moved: Belief  # x (r, 2), P (r, 2, 2)  by odometry so far, and the noise of that
    heard: Array  # (r, n, 5)  `moved` of each teammate, in its last packet


@dataclass(frozen=True)
@shared.explain
class ChannelPf:
    """Particle filter on own readings; Gaussians are exchanged, less what each link has carried before.

    Args:
        reading: of a packet, where no camera sees teammates: "rssi" [dBm] or "range" [m].
    """

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "mean, covariance, odometry"
    consistency: ClassVar[str] = "over-confident: a link does not see what comes around others"
    particles: int = 200
    anchor_reading: shared.AnchorReading = "doa"
    density: Literal["constant", "exact"] = tunable("constant", choices=("constant", "exact"), where=shared.DOA)
    residual: Literal["wrapped", "sum", "corners", "code"] = "wrapped"
    M: int = tunable(5, 1, 10, where=shared.DOA)
    K: int = tunable(5, 1, 10, where=shared.DOA)
    decay: float = tunable(0.99, 0.5, 1.0, where=shared.DOA)
    temper: bool = tunable(True, choices=(True, False), where=shared.DOA)
    point: Literal["mean", "max"] = "mean"
    proposal: Literal["walk", "box", "best"] = "walk"
    box: float = 0.5  # [m]
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    precision: Literal["double", "single"] = "double"
    reading: shared.RadioReading = "range"
    loss: AssumedLoss = "world"

    uses = property(shared.team_channels)

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        r, n, own = len(prior.x), world.robots, shared.init(self, prior, world, rows)
        vague = (VAGUE * np.max(world.arena[1] - world.arena[0])) ** 2 * np.eye(4)
        x = np.tile(prior.x[:, None, :2], (1, n, 2))
        channel = Belief(x, np.tile(vague, (r, n, 1, 1)))
        return State(own, channel, Belief(np.zeros((r, 2)), np.zeros((r, 2, 2))), np.zeros((r, n, 5)))

    def predict(self, s: State, z: Senses) -> State:
        """Move the particles; x' = x + u, P' = P + Q for the own half of each channel."""
        x, P = s.own.belief
        after, F, Q = s.own.world.motion.move(x, z.odometry, z.dt)
        step, Q = (after - x)[:, :2], Q[:, :2, :2]
        if x.shape[-1] > 2:
            Q = Q + F[:, :2, 2:] @ P[:, 2:, 2:] @ F[:, :2, 2:].mT
        channel = Belief(s.channel.x.copy(), s.channel.P.copy())
        channel.x[..., :2] += step[:, None]
        channel.P[..., :2, :2] += Q[:, None]
        moved = Belief(s.moved.x + step, s.moved.P + Q)
        return s._replace(own=shared.predict(self, s.own, z), channel=channel, moved=moved)

    def correct(self, s: State, z: Senses) -> State:
        return s._replace(own=shared.correct(self, s.own, z))

    def send(self, s: State, z: Senses) -> Array:
        """x, y, P_xx, P_xy, P_yy of the belief, then of its odometry: ten numbers. Silence without a covariance."""
        packet = np.concatenate([pack(shared.belief_to_send(s.own)), pack(s.moved)], -1)
        regular = definite(shared.belief_to_send(s.own).P[:, :2, :2])
        return np.where(regular[:, None], packet, np.nan)

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        """Every link by itself, from the belief before this tick's packets; the particles by what all have gained."""
        sensor, readings = shared.team_readings(s.own.world, z, mail)
        belief = shared.belief_to_send(s.own)
        present = ~np.isnan(mail.packets[..., 0]) & ~np.isnan(readings).any(-1)
        i, j = np.argwhere(present & definite(belief.P[:, :2, :2])[:, None]).astype(np.int64).T
        if not len(i):
            return s._replace(own=shared.resample_and_estimate(self, s.own))
        packets = mail.packets[i, j]
        before, mine = Belief(s.channel.x[i, j], s.channel.P[i, j]), Belief(belief.x[i], belief.P[i])
        now, then = unpack(packets[:, 5:]), unpack(s.heard[i, j])
        before.x[:, 2:] += now[0] - then[0]  # the sender has moved since its last packet
        before.P[:, 2:, 2:] += now[1] - then[1]
        after, gain = _exchange_packets(sensor, before, mine, unpack(packets[:, :5]), readings[i, j])
        own = shared.resample_and_estimate(self, s.own._replace(logw=_weigh(s.own, belief.x, gain, i)))
        x, P, heard = s.channel.x.copy(), s.channel.P.copy(), s.heard.copy()
        x[i, j], P[i, j], heard[i, j] = after.x, after.P, packets[:, 5:]
        return s._replace(own=own, channel=Belief(x, P), heard=heard)

    def estimate(self, s: State) -> Belief:
        return s.own.belief


def _exchange_packets(
    sensor: Sensor, common: Belief, mine: Belief, theirs: Belief, z: Array
) -> tuple[Belief, LinkInformation]:
    """Return channels after an exchange, and the gain of the robot's marginal by the other's news and the reading."""
    about = mine.x[:, :2]
    i_know = news(Belief(about, mine.P[:, :2, :2]), Belief(common.x[:, :2], common.P[:, :2, :2]))
    they_know = news(theirs, Belief(common.x[:, 2:], common.P[:, 2:, 2:]))
    before = join(common, i_know, LinkInformation(0 * they_know.eta, 0 * they_know.Y))
    both = join(common, i_know, they_know)
    after = Belief(*kalman(*both, *linearise_both(sensor, both, mine, z)))
    Y1, Y0 = np.linalg.inv(after.P[:, :2, :2]), np.linalg.inv(before.P[:, :2, :2])
    eta = Y1 @ (after.x[:, :2] - about)[..., None] - Y0 @ (before.x[:, :2] - about)[..., None]
    return after, LinkInformation(eta[..., 0], symmetric(Y1 - Y0))


def linearise_both(sensor: Sensor, both: Belief, mine: Belief, z: Array) -> tuple[Array, Array, Array]:
    """Linearise a reading at both mean positions: y (k, m), H (k, m, 4), R (k, m, m); heading errors count as noise."""
    d = mine.x.shape[-1]
    pose = np.concatenate([both.x[:, :2], mine.x[:, 2:]], -1)
    y, H, Hq = sensor.innovation(pose, both.x[:, 2:], z)
    apart = np.concatenate([np.eye(2), -np.eye(2)], -1)
    shift, extra = curvature(sensor, pose, both.x[:, 2:], apart @ both.P @ apart.T)
    R = sensor.R + extra
    if d > 2:
        R = R + H[..., 2:] @ mine.P[:, 2:, 2:] @ H[..., 2:].mT
    y, H = y - shift, np.concatenate([H[..., :2], Hq], -1)
    if (loss := loss_of(sensor)) != "none":
        y, H = rescale(loss, R, H @ both.P @ H.mT + R, y, H)
    return y, H, np.broadcast_to(R, (*y.shape, y.shape[-1]))


def _weigh(own: shared.FilterState, about: Array, gain: LinkInformation, i: Indices) -> Array:
    """Return logw + sum over links of eta' e - e' Y e / 2, with e (r, N, 2) the particles about the robot's mean."""
    eta, Y = np.zeros((len(own.x), 2)), np.zeros((len(own.x), 2, 2))
    np.add.at(eta, i, gain.eta)
    np.add.at(Y, i, gain.Y)
    e = own.x[..., :2] - about[:, None, :2]
    east, north = e[..., 0], e[..., 1]
    linear = eta[:, None, 0] * east + eta[:, None, 1] * north
    square = Y[:, None, 0, 0] * east**2 + 2 * Y[:, None, 0, 1] * east * north + Y[:, None, 1, 1] * north**2
    return np.asarray(own.logw + linear - square / 2)


def definite(P: Array) -> Mask:
    """Return which covariances (..., 2, 2) can be inverted; nan ones cannot."""
    a, b, c = P[..., 0, 0], P[..., 0, 1], P[..., 1, 1]
    return np.asarray((a > 0) & (c > 0) & (a * c - b * b > 1e-12 * a * c))


def news(belief: Belief, common: Belief) -> LinkInformation:
    """Return Bel / C_i, about the mean of C_i, in the directions in which the belief knows more; zero in the others."""
    a = np.sqrt(common.P[:, 0, 0])
    b = common.P[:, 1, 0] / a
    c = np.sqrt(np.maximum(common.P[:, 1, 1] - b * b, 1e-12 * common.P[:, 1, 1]))  # also where rounding made P singular
    L = np.stack([np.stack([a, 0 * a], -1), np.stack([b, c], -1)], -2)  # L L' = P
    whitened = np.asarray(L.mT @ np.linalg.solve(belief.P, L), float)
    gain, V = np.linalg.eigh(symmetric(whitened))  # 1 where nothing is new
    T = np.linalg.solve(L.mT, V)
    eta = (L @ V).mT @ np.linalg.solve(belief.P, (belief.x - common.x)[..., None])
    more = gain > 1
    eta, Y = np.where(more, eta[..., 0], 0.0), np.where(more, gain - 1, 0.0)
    return LinkInformation((T @ eta[..., None])[..., 0], symmetric((T * Y[:, None]) @ T.mT))


def join(common: Belief, mine: LinkInformation, theirs: LinkInformation) -> Belief:
    """Return C (Bel_i / C_i) (Bel_j / C_j)."""
    Y = np.asarray(np.linalg.inv(common.P), float)
    Y[:, :2, :2] += mine.Y
    Y[:, 2:, 2:] += theirs.Y
    P = symmetric(np.asarray(np.linalg.inv(symmetric(Y)), float))
    eta = np.concatenate([mine.eta, theirs.eta], -1)
    return Belief(common.x + (P @ eta[..., None])[..., 0], P)
