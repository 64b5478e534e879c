"""Collaborative terrain-relative navigation (CTRN): particle filters whose beliefs meet by covariance intersection.

Each robot runs its own particle filter and broadcasts mean and covariance. Whoever hears a packet has a reading of the
sender (range or RSSI), and does not know how far the sender's belief depends on its own: covariance intersection finds
the weight w that is safe whatever the correlation. The original is known to us by its abstract; these are our readings:

- `fusion="moments"`: the particles' Gaussian and the sender's are inflated to P_i/w and P_j/(1-w), the reading updates
  the joint, and the particles follow by the affine map that gives them the new mean and covariance.
- `fusion="message"`: the particles' density is flattened to the power w, then weighed by the reading with P_j/(1-w).
- `fusion="received"`: what each sender's packets say is kept in a Gaussian of its own, where covariance intersection
  guards against packets that repeat each other; their sum with the robot's own belief is the estimate, never fed back
  and never sent on.

Sources: B. Wiktor, S. Rock, "Collaborative terrain relative navigation", ICRA 2020; for the relative form of covariance
intersection, L. C. Carrillo-Arce et al., "Decentralized multi-robot cooperative localization using covariance
intersection", IROS 2013.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from cooploc.estimators.compiled import random_numbers
from cooploc.estimators.compiled.elementary_functions import kernel, readable, wide
from cooploc.estimators.covariance_intersection import scalar_readings
from cooploc.estimators.covariance_intersection.scalar_readings import Lot, Sample
from cooploc.estimators.covariance_intersection.weights import solve_relative
from cooploc.estimators.interface import Array, Belief, Indices, Mail, Mask, Rows, Senses, Sensor, World
from cooploc.estimators.kalman.update import inflated_update, symmetric
from cooploc.estimators.models.angles import wrap_heading
from cooploc.estimators.models.sensors import LogDistance, Range
from cooploc.estimators.mrsl import pack
from cooploc.estimators.particle import own_filter
from cooploc.estimators.particle.likelihood import log_normal, unpack
from cooploc.estimators.particle.steps import offset, summary

VAGUE = 10.0  # sides of the arena: the spread of a belief that knows nothing yet


class Counts(NamedTuple):
    """What the fusions of each robot came to (r,)."""

    fusions: Array
    fallbacks: Array  # cvxpy failed, the exact method stood in


class State(NamedTuple):
    """What one robot remembers."""

    own: own_filter.Own
    who: Indices  # (r,)  one number per robot and trial: nobody shares a program, whose last bits would tell of others
    received: Belief  # x (r, n, 2), P (r, n, 2, 2)  its own position as each sender alone tells it, nan before it did
    belief: Belief
    counts: Counts
    sample: Sample  # exact fusions that cvxpy is to solve again when notes are taken


@dataclass(frozen=True)
class Ctrn(own_filter.Settings):
    """Particle filter on own readings, covariance intersection with received beliefs."""

    api: ClassVar[int] = 1
    reading: Literal["rssi", "range"] = "range"  # what is measured of a packet
    fusion: Literal["moments", "message", "received"] = "moments"
    weights: Literal["cvxpy", "exact"] = "cvxpy"
    criterion: Literal["trace", "det"] = "trace"
    audit: float = 1e-3  # with weights="exact": share of fusions that cvxpy solves again

    @property
    def uses(self) -> tuple[str, ...]:
        return ("odometry", "anchor_rssi", f"radio_{self.reading}")

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        r, n, d = len(prior.x), world.robots, prior.x.shape[-1]
        kept, d = (n, 2) if self.fusion == "received" else (0, d)
        received = Belief(np.full((r, kept, 2), np.nan), np.full((r, kept, 2, 2), np.nan))
        who, counts = rows.trial * n + rows.robot, Counts(*np.zeros((2, r)))
        mine = own_filter.init(self, prior, world, rows)
        return State(mine, who, received, prior, counts, scalar_readings.blank(0, d))

    def predict(self, s: State, z: Senses) -> State:
        s, before = s._replace(own=own_filter.predict(self, s.own, z)), s.own.belief.x
        if self.fusion != "received":
            return s
        after, _, Q = s.own.world.motion.move(before, z.odometry, z.dt)
        step = (after - before)[:, None, :2]
        received = Belief(s.received.x + step, s.received.P + Q[:, None, :2, :2])
        return s._replace(received=received)

    def correct(self, s: State, z: Senses) -> State:
        return s._replace(own=own_filter.correct(self, s.own, z))

    def send(self, s: State, z: Senses) -> Array:
        """x, y, and the position covariance's P_xx, P_xy, P_yy: five numbers. Nothing received is sent on."""
        return pack(own_filter.tell(s.own))

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        s = {"moments": self._moments, "message": self._message, "received": self._received}[self.fusion](s, z, mail)
        mine = own_filter.finish(self, s.own)
        belief = _sum(mine.belief, s.received) if self.fusion == "received" else mine.belief
        return s._replace(own=mine, belief=belief)

    def estimate(self, s: State) -> Belief:
        return s.belief

    def notes(self, s: State) -> dict[str, Array]:
        """How many fusions there were, and how far the exact weights lie from cvxpy's where both were asked."""
        told = {"fusions": s.counts.fusions, "fallbacks": s.counts.fallbacks}
        if self.weights == "exact":
            audited, largest = self._audit(s)
            told |= {"solved again by cvxpy": audited, "largest difference of a weight": largest}
        return told

    def _audit(self, s: State) -> tuple[Array, Array]:
        """How many fusions of each row cvxpy solves again, those of a trial together, and the largest difference."""
        row, w, P, P_j, H, H_j, R = s.sample
        trial = s.who[row] // s.own.world.robots
        again = solve_relative(P, P_j, H, H_j, R, self.criterion, "cvxpy", groups=trial).w
        largest = np.zeros(len(s.who))
        np.maximum.at(largest, row, np.abs(again - w))
        return np.bincount(row, minlength=len(s.who)).astype(float), largest

    def _moments(self, s: State, z: Senses, mail: Mail) -> State:
        """Fuse with one sender after the other, then move the particles to the mean and covariance that result."""
        before = own_filter.tell(s.own)
        after, s = self._chain(s, before, z, mail)
        return s._replace(own=s.own._replace(x=follow(s.own.x, before, after)))

    def _chain(self, s: State, before: Belief, z: Senses, mail: Mail) -> tuple[Belief, State]:
        """The belief after all senders: in one compiled loop where there is one, else step by step."""
        sensor = s.own.world.sensors[f"radio_{self.reading}"]
        if self.weights == "exact" and type(sensor) in (LogDistance, Range):
            readings = getattr(mail, self.reading)
            done = scalar_readings.chain(before, sensor, mail.packets, readings, self.criterion, self._lot(s))
            if done is not None:
                after, fusions, sample = done
                return after, _noted(_counted(s, fusions, np.zeros_like(fusions)), sample)
        return self._step_by_step(s, before, z, mail)

    def _step_by_step(self, s: State, before: Belief, z: Senses, mail: Mail) -> tuple[Belief, State]:
        after = before
        for sensor, sender, reading in s.own.world.relative(z, mail):
            after, _, s = self._intersect(s, after, sensor, reading, mail, sender, after.x)
        return after, s

    def _message(self, s: State, z: Senses, mail: Mail) -> State:
        """log p^w for the particles' own Gaussian p, plus the log-likelihood of the reading with P_j/(1-w)."""
        x, logw = s.own.x, s.own.logw
        for sensor, sender, reading in s.own.world.relative(z, mail):
            belief = summary(x, logw)
            _, w, s = self._intersect(s, belief, sensor, reading, mail, sender, belief.x)
            x_j, P_j = unpack(mail.packets[:, sender])
            y, _, J = sensor.innovation(x, x_j[:, None], reading[:, None])
            J, rest = J[..., 0, :], np.where(w < 1, 1 - w, np.nan)[:, None]
            v = sensor.R[0, 0] + ((J @ P_j) * J).sum(-1) / rest
            flat = (w - 1)[:, None] * log_density(x, belief)
            logw = np.where(w[:, None] < 1, logw + flat + log_normal(y[..., 0], v), logw)
        return s._replace(own=s.own._replace(logw=logw))

    def _received(self, s: State, z: Senses, mail: Mail) -> State:
        """Intersect what a sender's packets said before with what this one says, linearised at the own belief."""
        at = summary(s.own.x, s.own.logw).x[:, :2]
        x, P = s.received.x.copy(), s.received.P.copy()
        world = s.own.world
        nothing = (VAGUE * np.max(world.arena[1] - world.arena[0])) ** 2 * np.eye(2)
        for sensor, sender, reading in world.relative(z, mail):
            new = np.isnan(x[:, sender])
            said = Belief(np.where(new, at, x[:, sender]), np.where(new[..., None], nothing, P[:, sender]))
            fused, w, s = self._intersect(s, said, sensor, reading, mail, sender, at)
            still = new & (w == 1)[:, None]  # nothing
            x[:, sender] = np.where(still, np.nan, fused.x)
            P[:, sender] = np.where(still[..., None], np.nan, fused.P)
        return s._replace(received=Belief(x, P))

    def _intersect(
        self, s: State, belief: Belief, sensor: Sensor, reading: Array, mail: Mail, sender: int, at: Array
    ) -> tuple[Belief, Array, State]:
        """The belief after one reading of one sender, linearised at `at`, the weight w (r,), and the counts kept.

        x' = x + K y,  P' = (I - K H) P/w  with  K = P/w H' (H P/w H' + H_j P_j/(1-w) H_j' + R)^-1;  w = 1: it stays.
        """
        x_j, P_j = unpack(mail.packets[:, sender])
        y, H, H_j = sensor.innovation(at, x_j, reading)
        y = y + (H @ (at - belief.x)[..., None])[..., 0]
        use = np.flatnonzero(~np.isnan(y).any(-1) & ~np.isnan(P_j).any((-2, -1)) & sound(belief.P))
        w = np.ones(len(y))
        if use.size:
            R = np.broadcast_to(sensor.R, (use.size, *sensor.R.shape))
            parts = belief.P[use], P_j[use], H[use], H_j[use], R
            found = solve_relative(*parts, self.criterion, self.weights, groups=s.who[use])
            w[use] = found.w
            taken, failed = np.zeros((2, len(w)))
            taken[use], failed[use] = 1.0, found.fallback
            s = _counted(s, taken, failed)
            if self.weights == "exact":
                s = self._sampled(s, sender, Sample(use, found.w, *parts))
        return inflated_update(belief, y, H, H_j, P_j, sensor.R, w), w, s

    def _sampled(self, s: State, sender: int, fusions: Sample) -> State:
        """Write down a random part of the fusions with one sender."""
        chosen = scalar_readings.sampled(self._lot(s), sender + 1)[fusions.row, sender]
        return _noted(s, fusions.take(chosen))

    def _lot(self, s: State) -> Lot:
        return Lot(s.own.key, s.own.tick * random_numbers.PURPOSES + random_numbers.AUDIT, self.audit)


def _counted(s: State, fusions: Array, fallbacks: Array) -> State:
    return s._replace(counts=Counts(s.counts.fusions + fusions, s.counts.fallbacks + fallbacks))


def _noted(s: State, sample: Sample) -> State:
    if len(sample.row) == 0:
        return s
    row = np.concatenate([s.sample.row, sample.row])
    rest = (np.concatenate(both) for both in zip(s.sample[1:], sample[1:], strict=True))
    return s._replace(sample=Sample(row, *rest))


def sound(P: Array) -> Mask:
    """Rows whose covariance can be inverted (r,): particles may have collapsed into one point."""
    largest = np.trace(P, axis1=-2, axis2=-1)
    ok: Mask = np.linalg.eigvalsh(P)[:, 0] > 1e-12 * np.maximum(largest, np.finfo(float).tiny)
    return ok


def follow(x: Array, before: Belief, after: Belief) -> Array:
    """Particles x (r, N, d) under the affine map that takes the moments `before` to `after`; unmoved where equal."""
    moved = (before.x != after.x).any(-1) | (before.P != after.P).any((-2, -1))
    if not moved.any():
        return x
    if x.shape[-1] == 2:
        out = np.empty_like(x, order="C")
        _follow(readable(x.reshape(len(x), -1)), moved, *before, *after, out.reshape(len(x), -1))
        return out
    L0, L1 = np.linalg.cholesky(before.P[moved]), np.linalg.cholesky(after.P[moved])
    A = np.linalg.solve(L0.mT, L1.mT)  # row vectors: e' = e A
    out = x.copy()
    out[moved] = wrap_heading(after.x[moved, None] + offset(x[moved], before.x[moved]) @ A)
    return out


@kernel
def _follow(x, moved, m0, P0, m1, P1, out):  # type: ignore[no-untyped-def]
    """m1 + L1 L0^-1 (x - m0), the L lower triangular roots of the P."""
    wide()
    for r in range(len(x)):
        if not moved[r]:
            out[r] = x[r]
            continue
        a0, a1 = np.sqrt(P0[r, 0, 0]), np.sqrt(P1[r, 0, 0])
        b0, b1 = P0[r, 1, 0] / a0, P1[r, 1, 0] / a1
        c0, c1 = np.sqrt(P0[r, 1, 1] - b0 * b0), np.sqrt(P1[r, 1, 1] - b1 * b1)
        a, c = a1 / a0, c1 / c0
        b = (b1 - c * b0) / a0
        east, north = m1[r, 0] - a * m0[r, 0], m1[r, 1] - b * m0[r, 0] - c * m0[r, 1]
        for i in range(x.shape[1] // 2):
            dx, dy = x[r, 2 * i], x[r, 2 * i + 1]
            out[r, 2 * i] = east + a * dx
            out[r, 2 * i + 1] = north + (b * dx + c * dy)


def log_density(x: Array, belief: Belief) -> Array:
    """log N(x; belief) of particles (r, N, d) up to a constant."""
    e = offset(x, belief.x)
    d2: Array = (e * np.linalg.solve(belief.P[:, None], e[..., None])[..., 0]).sum(-1)
    return -0.5 * d2


def _sum(mine: Belief, received: Belief) -> Belief:
    """The product of independent Gaussians: the own belief and what each sender's packets say of the position."""
    told = ~np.isnan(received.x[..., 0])
    use = told.any(-1) & sound(mine.P)
    if not use.any():
        return mine
    x, P = mine.x.copy(), mine.P.copy()
    lift = np.eye(x.shape[-1])[:, :2]
    told, at, spread = (a[use] for a in (told, *received))
    said = np.where(told[..., None, None], np.linalg.inv(np.where(told[..., None, None], spread, np.eye(2))), 0.0)
    gap = np.where(told[..., None], at - x[use, None, :2], 0.0)
    P[use] = symmetric(np.linalg.inv(np.linalg.inv(P[use]) + lift @ said.sum(1) @ lift.T))
    pull = lift @ (said @ gap[..., None]).sum(1)
    x[use] = x[use] + (P[use] @ pull)[..., 0]
    return Belief(x, P)
