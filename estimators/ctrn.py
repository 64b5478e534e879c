"""Collaborative terrain-relative navigation (CTRN): particle filters whose beliefs meet by covariance intersection.

Each robot runs its own particle filter and broadcasts mean and covariance; a robot that hears it fuses by the weight
that is safe whatever the correlation. Of the original we have only the abstract: the kinds of `fusion` are our reading.

Sources: A. Wiktor, S. Rock, "Collaborative multi-robot localization in natural terrain", ICRA 2020; for the relative
form of covariance intersection, L. C. Carrillo-Arce et al., "Decentralized multi-robot cooperative localization using
covariance intersection", IROS 2013.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from cooploc.estimators import particles as shared
from cooploc.estimators.compiled import inlined, kernel, readable, wide
from cooploc.estimators.covariance_intersection import PIVOT, solve_relative, weight_equation, weight_root
from cooploc.estimators.interface import Array, Belief, Mail, Mask, Rows, Senses, Sensor, World
from cooploc.estimators.kalman import inflated_update, soften_pair, symmetric
from cooploc.estimators.models import NEAR, TOO_NEAR_TO_RANGE, LogDistance, Range, wrap_heading
from cooploc.estimators.particle_likelihood import log_density, pack, unpack
from cooploc.estimators.particles import offset, summary
from cooploc.estimators.robust import AssumedLoss, loss_of
from cooploc.estimators.tunable import tunable


class State(NamedTuple):
    """The memory of one robot."""

    own: shared.FilterState
    received: Belief  # x (r, n, 2), P (r, n, 2, 2)  own position by each sender's packets alone, nan before the first
    belief: Belief
    fusions: Array  # (r,)  how many there were
    fallbacks: Array  # (r,)  of them, how often cvxpy failed and the exact weight was used


# The compiled loop of `fusion="moments"`, each row by itself, as `step_by_step` states it: linearise at the belief so
# far, weigh, update in Joseph's form.

COLLAPSED = 1e-12  # smallest eigenvalue over the trace of a covariance that is not inverted any more


def chain(
    belief: Belief, sensor: Sensor, packets: Array, readings: Array, criterion: str
) -> tuple[Belief, Array] | None:
    """Intersect beliefs with one sender after the other; return them, and the number of fusions (r,).

    Packets are x, y, P_xx, P_xy, P_yy of each sender (r, n, 5); readings (r, n) are in m or dBm, nan where nothing was
    heard. None where a packet is not a covariance.
    """
    after, fusions = Belief(belief.x.copy(), belief.P.copy()), np.zeros(len(belief.x))
    A, slope = (sensor.A, 10 * sensor.eta / np.log(10)) if isinstance(sensor, LogDistance) else (0.0, 0.0)
    model = isinstance(sensor, Range), A, slope, float(sensor.R[0, 0])  # of an RSSI: at 1 m, and per unit of ln d
    links, axes = (readable(packets), readable(readings)), (0,) * belief.x.shape[-1]
    return (after, fusions) if _chain(links, model, criterion == "trace", tuple(after), fusions, axes) else None


@inlined
def _invertible(P, axes):
    """Return whether P's smallest eigenvalue is above COLLAPSED times its trace: P less that has positive pivots."""
    trace = P[0, 0] + P[1, 1] + (P[2, 2] if len(axes) == 3 else 0.0)
    least = COLLAPSED * max(trace, np.finfo(np.float64).tiny)
    first, ratio = P[0, 0] - least, P[1, 0] / (P[0, 0] - least)
    second = P[1, 1] - least - ratio * P[1, 0]
    invertible = first > 0.0 and second > 0.0
    if len(axes) == 3 and invertible:
        rest = P[2, 1] - ratio * P[2, 0]
        invertible = P[2, 2] - least - P[2, 0] * P[2, 0] / first - rest * rest / second > 0.0
    return invertible


@inlined
def _linearise(model, dx, dy, z):
    """Return the innovation of a range or an RSSI and its Jacobian at the offset (dx, dy); nan where refused."""
    ranged, A, slope, _ = model
    D = dx * dx + dy * dy
    if ranged:
        d = np.sqrt(D)
        y = np.nan if z < TOO_NEAR_TO_RANGE else z - d
        return y, dx / max(d, NEAR), dy / max(d, NEAR)
    y, steep = z - A + 0.5 * slope * np.log(max(D, NEAR**2)), -slope / max(D, NEAR**2) if D > NEAR**2 else 0.0
    return (y if D >= 0.0 else np.nan), steep * dx, steep * dy


@inlined
def _update(x, P, y, ux, uy, N, w, M, K, axes):
    """Write x + K y and (I - K H) P/w (I - K H)' + K N K', symmetric; M (3, 3) and K (3,) are scratch."""
    for i in range(len(axes)):
        K[i] = (P[i, 0] * ux + P[i, 1] * uy) / w
    S = K[0] * ux + K[1] * uy + N
    for i in range(len(axes)):
        for j in range(len(axes)):
            M[i, j] = P[i, j] / w - K[i] / S * K[j]
    for i in range(len(axes)):
        K[i] /= S
        x[i] += K[i] * y
    for i in range(len(axes)):
        for j in range(i + 1):
            ij = M[i, j] - (M[i, 0] * ux + M[i, 1] * uy) * K[j]
            ji = M[j, i] - (M[j, 0] * ux + M[j, 1] * uy) * K[i]
            P[i, j] = P[j, i] = 0.5 * (ij + ji) + N * K[i] * K[j]


@kernel
def _chain(links, model, trace, belief, fusions, axes):
    """Update the belief by all readings; return whether every packet has a covariance."""
    (x, P), (packets, readings) = belief, links
    M, K, R = np.empty((3, 3)), np.empty(3), model[3]
    for r in range(len(x)):
        invertible = _invertible(P[r], axes)
        for j in range(readings.shape[1]):
            packet = packets[r, j]
            y, ux, uy = _linearise(model, x[r, 0] - packet[0], x[r, 1] - packet[1], readings[r, j])
            xx, xy, yy = packet[2], packet[3], packet[4]
            if not invertible or np.isnan(y) or np.isnan(xx) or np.isnan(xy) or np.isnan(yy):
                continue
            fusions[r] += 1
            v = 0.0
            if not (xx == np.inf and yy == np.inf):  # else the sender knows nothing
                q = ux * (ux * xx + uy * xy) + uy * (ux * xy + uy * yy)
                definite = np.isfinite(xx) and yy > 0.0 and np.isfinite(yy) and xx - xy / yy * xy > PIVOT * xx
                if not (definite and q + R > 0.0):  # by more than rounding
                    return False
                v = weight_root(*weight_equation(P[r, 0, 0], P[r, 0, 1], P[r, 1, 1], ux, uy, q, R, trace))
            if v > 0.0:
                _update(x[r], P[r], y, ux, uy, q / v + R, 1 - v, M, K, axes)
                invertible = _invertible(P[r], axes)
    return True


Reading = tuple[Sensor, int, Array]  # sensor, sender and reading (r, 1), as of `World.relative`


def intersect(
    p: "Ctrn", s: State, belief: Belief, reading: Reading, packets: Array, at: Array
) -> tuple[Belief, Array, State]:
    """Return the belief after one reading, linearised at `at`, the weight w (r,), and the state with fusions counted.

    x' = x + K y,  P' = (I - K H) P/w  with  K = P/w H' (H P/w H' + H_j P_j/(1-w) H_j' + R)^-1;  w = 1: unchanged.
    """
    sensor, sender, z = reading
    x_j, P_j = unpack(packets[:, sender])
    y, H, H_j = sensor.innovation(at, x_j, z)
    y, H, H_j = soften_pair(sensor, y + (H @ (at - belief.x)[..., None])[..., 0], H, H_j, belief.P, P_j)
    use = np.flatnonzero(~np.isnan(y).any(-1) & ~np.isnan(P_j).any((-2, -1)) & invertible(belief.P))
    w = np.ones(len(y))
    if use.size:
        R = np.broadcast_to(sensor.R, (use.size, *sensor.R.shape))
        parts = belief.P[use, :2, :2], P_j[use], H[use][..., :2], H_j[use], R  # a radio reads no heading
        found = solve_relative(*parts, p.criterion, p.weights)
        w[use] = found.w
        fused, failed = np.zeros((2, len(w)))
        fused[use], failed[use] = 1.0, found.fallback
        s = s._replace(fusions=s.fusions + fused, fallbacks=s.fallbacks + failed)
    return inflated_update(belief, y, H, H_j, P_j, sensor.R, w), w, s


def invertible(P: Array) -> Mask:
    """Return rows whose covariance can be inverted (r,): particles may have collapsed into one point."""
    trace = np.trace(P, axis1=-2, axis2=-1)
    return np.asarray(np.linalg.eigvalsh(P)[:, 0] > COLLAPSED * np.maximum(trace, np.finfo(float).tiny))


def silence_singular(packets: Array) -> Array:
    """Replace packets (r, 5) by nan where the covariance is singular up to rounding."""
    xx, xy, yy = packets[:, 2:].T
    with np.errstate(divide="ignore", invalid="ignore"):
        definite = (yy > 0) & (xx - xy / yy * xy > PIVOT * xx)
    return np.where(definite[:, None], packets, np.nan)


# fusion="message": the particles' own density p is flattened to the power w, then weighed by the reading's likelihood
# with the sender's covariance inflated. The weights change; the particles stay where they are.


def fuse_by_message(p: "Ctrn", s: State, z: Senses, mail: Mail) -> State:
    """Add (w - 1) log p(x_i) + log N(y(x_i); 0, R + J P_j J' / (1 - w)) to log w_i, one sender after the other."""
    x, logw = s.own.x, s.own.logw
    for sensor, sender, reading in s.own.world.relative(z, mail):
        belief, (x_j, P_j) = summary(x, logw), unpack(mail.packets[:, sender])
        _, w, s = intersect(p, s, belief, (sensor, sender, reading), mail.packets, belief.x)
        y, _, J = sensor.innovation(x, x_j[:, None], reading[:, None])
        J, rest = J[..., 0, :], np.where(w < 1, 1 - w, np.nan)[:, None]
        v = sensor.R[0, 0] + ((J @ P_j) * J).sum(-1) / rest
        P = np.where((w < 1)[:, None, None], belief.P, np.eye(x.shape[-1]))  # a collapsed one is not inverted
        e = offset(x, belief.x)
        flat = (w - 1)[:, None] * (-0.5 * (e * np.linalg.solve(P[:, None], e[..., None])[..., 0]).sum(-1))
        logw = np.where(w[:, None] < 1, logw + flat + log_density(y, v[..., None, None], loss_of(sensor)), logw)
    return s._replace(own=s.own._replace(logw=logw))


# fusion="moments": the particles' Gaussian and the sender's are inflated to P_i/w and P_j/(1-w), the reading updates
# the joint, and the particles move by the affine map that gives them the new mean and covariance.


def fuse_by_moments(p: "Ctrn", s: State, z: Senses, mail: Mail) -> State:
    """Fuse with one sender after the other, then move the particles to the mean and covariance that result.

    This is the compiled loop's where there is one for the sensor, else step by step.
    """
    before, sensor, chained = shared.belief_to_send(s.own), s.own.world.sensors[f"radio_{p.reading}"], None
    if p.weights == "exact" and type(sensor) in (LogDistance, Range) and loss_of(sensor) == "none":
        chained = chain(before, sensor, mail.packets, getattr(mail, p.reading), p.criterion)
    if chained is None:
        after, s = step_by_step(p, s, before, z, mail)
    else:
        after, s = chained[0], s._replace(fusions=s.fusions + chained[1])
    return s._replace(own=s.own._replace(x=follow(s.own.x, before, after)))


def step_by_step(p: "Ctrn", s: State, before: Belief, z: Senses, mail: Mail) -> tuple[Belief, State]:
    """Fuse with one sender after the other, each linearised at the belief that the last one left."""
    after = before
    for reading in s.own.world.relative(z, mail):
        after, _, s = intersect(p, s, after, reading, mail.packets, after.x)
    return after, s


def follow(x: Array, before: Belief, after: Belief) -> Array:
    """Move particles x (r, N, d) by the affine map that takes the moments `before` to `after`, where these differ."""
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
def _follow(x, moved, m0, P0, m1, P1, out):
    """Write m1 + L1 L0^-1 (x - m0), with L0 and L1 the lower triangular roots of P0 and P1."""
    wide()
    for r in range(len(x)):
        if not moved[r]:
            for k in range(x.shape[1]):  # a copy of slices takes seconds to compile
                out[r, k] = x[r, k]
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


# fusion="received": one Gaussian of the robot's position for each sender's packets, which covariance intersection fuses
# with the next packet. The estimate is the product of the robot's own belief with these, which are never sent on.

VAGUE = 10.0  # sides of the arena: the standard deviation of a belief that knows nothing yet


def fuse_received(p: "Ctrn", s: State, z: Senses, mail: Mail) -> State:
    """Intersect the Gaussian of a sender's earlier packets with its new one, linearised at the robot's own belief."""
    at = summary(s.own.x, s.own.logw).x[:, :2]
    x, P = s.received.x.copy(), s.received.P.copy()
    arena = s.own.world.arena
    vague = (VAGUE * np.max(arena[1] - arena[0])) ** 2 * np.eye(2)
    for reading in s.own.world.relative(z, mail):
        _, j, _ = reading
        first = np.isnan(x[:, j])
        before = Belief(np.where(first, at, x[:, j]), np.where(first[..., None], vague, P[:, j]))
        after, w, s = intersect(p, s, before, reading, mail.packets, at)
        unused = first & (w == 1)[:, None]
        x[:, j] = np.where(unused, np.nan, after.x)
        P[:, j] = np.where(unused[..., None], np.nan, after.P)
    return s._replace(received=Belief(x, P))


def combine(own: Belief, received: Belief) -> Belief:
    """Multiply independent Gaussians: the own belief, and the position by each sender's packets."""
    present = ~np.isnan(received.x[..., 0])
    use = present.any(-1) & invertible(own.P)
    if not use.any():
        return own
    x, P = own.x.copy(), own.P.copy()
    lift = np.eye(x.shape[-1])[:, :2]
    present, x_j, P_j = (a[use] for a in (present, *received))
    there = present[..., None, None]
    information = np.where(there, np.linalg.inv(np.where(there, P_j, np.eye(2))), 0.0)
    gap = np.where(present[..., None], x_j - x[use, None, :2], 0.0)
    P[use] = symmetric(np.linalg.inv(np.linalg.inv(P[use]) + lift @ information.sum(1) @ lift.T))
    pull = lift @ (information @ gap[..., None]).sum(1)
    x[use] = x[use] + (P[use] @ pull)[..., 0]
    return Belief(x, P)


FUSE = {"moments": fuse_by_moments, "message": fuse_by_message, "received": fuse_received}


@dataclass(frozen=True)
@shared.explain
class Ctrn:
    """Particle filter on own readings, covariance intersection with received beliefs.

    Args:
        reading: what is measured of a packet: "rssi" [dBm] or "range" [m], which without a radio is that of a sighting.
        fusion: "moments", the particles follow their Gaussian fused with the sender's; "message", their weights change
            by the reading; or "received", a Gaussian of each sender's packets is kept beside them and never sent on.
        weights: "cvxpy" solves a cone program for the weights, "exact" searches them by their slope.
        criterion: what the weights minimise: "trace" [m^2] or "det" [m^4] of the position's covariance.
    """

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "mean and covariance"
    consistency: ClassVar[str] = "as `arl` alone; the fusion adds no over-confidence"
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
    fusion: Literal["moments", "message", "received"] = "moments"
    weights: Literal["cvxpy", "exact"] = "cvxpy"
    criterion: Literal["trace", "det"] = tunable("trace", choices=("trace", "det"))
    loss: AssumedLoss = "world"

    @property
    def uses(self) -> tuple[str, ...]:
        return (*shared.own_channels(self), shared.radio_channel(self))

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        senders, r = world.robots if self.fusion == "received" else 0, len(prior.x)
        nothing = Belief(np.full((r, senders, 2), np.nan), np.full((r, senders, 2, 2), np.nan))
        own = shared.init(self, prior, shared.take_sightings_for_ranges(world), rows)
        return State(own, nothing, prior, np.zeros(r), np.zeros(r))

    def predict(self, s: State, z: Senses) -> State:
        """Move the particles; of senders' packets x' = x + (f(m, u) - m), P' = P + Q, m (r, d) the last estimate."""
        before, s = s.own.belief.x, s._replace(own=shared.predict(self, s.own, z))
        if self.fusion != "received":
            return s
        after, _, Q = s.own.world.motion.move(before, z.odometry, z.dt)
        step = (after - before)[:, None, :2]
        return s._replace(received=Belief(s.received.x + step, s.received.P + Q[:, None, :2, :2]))

    def correct(self, s: State, z: Senses) -> State:
        return s._replace(own=shared.correct(self, s.own, z))

    def send(self, s: State, z: Senses) -> Array:
        """Send x, y, P_xx, P_xy, P_yy, of own readings alone; silence where particles have collapsed onto a line."""
        return silence_singular(pack(shared.belief_to_send(s.own)))

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        s = FUSE[self.fusion](self, s, z, shared.range_of_sightings(z, mail))
        own = shared.resample_and_estimate(self, s.own)
        belief = combine(own.belief, s.received) if self.fusion == "received" else own.belief
        return s._replace(own=own, belief=belief)

    def estimate(self, s: State) -> Belief:
        return s.belief

    def notes(self, s: State) -> dict[str, Array]:
        """Count the fusions, and those in which cvxpy failed."""
        return {"fusions": s.fusions, "fallbacks": s.fallbacks}
