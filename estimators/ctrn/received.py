"""CTRN, fusion="received": one Gaussian per sender, added to the robot's own belief and never fed back.

What a sender's packets say of the robot's position is held in a Gaussian of its own. A new packet is fused with it by
covariance intersection, because packets of one sender repeat each other. The estimate is the product of the robot's own
belief with these Gaussians; neither the particles nor the packets that the robot sends ever contain them.
"""

import numpy as np

from cooploc.estimators.ctrn.intersection import intersect, invertible
from cooploc.estimators.ctrn.state import Settings, State, readings
from cooploc.estimators.interface import Array, Belief, Mail, Senses
from cooploc.estimators.kalman.update import symmetric
from cooploc.estimators.particle.steps import summary

VAGUE = 10.0  # sides of the arena: the standard deviation of a belief that knows nothing yet


def nothing(rows: int, senders: int) -> Belief:
    """Nothing received from any sender yet: x (r, n, 2), P (r, n, 2, 2) of nan."""
    return Belief(np.full((rows, senders, 2), np.nan), np.full((rows, senders, 2, 2), np.nan))


def predict(s: State, z: Senses, before: Array) -> State:
    """x' = x + (f(m, u) - m), P' = P + Q for every sender, with m (r, d) the robot's estimate before it moved."""
    after, _, Q = s.own.world.motion.move(before, z.odometry, z.dt)
    step = (after - before)[:, None, :2]
    return s._replace(received=Belief(s.received.x + step, s.received.P + Q[:, None, :2, :2]))


def fuse(p: Settings, s: State, z: Senses, mail: Mail) -> State:
    """Intersect the Gaussian of a sender's earlier packets with its new one, linearised at the robot's own belief."""
    at = summary(s.own.x, s.own.logw).x[:, :2]
    x, P = s.received.x.copy(), s.received.P.copy()
    arena = s.own.world.arena
    vague = (VAGUE * np.max(arena[1] - arena[0])) ** 2 * np.eye(2)
    for reading in readings(s, z, mail):
        j = reading.sender
        first = np.isnan(x[:, j])
        before = Belief(np.where(first, at, x[:, j]), np.where(first[..., None], vague, P[:, j]))
        after, w, s = intersect(p, s, before, reading, at)
        unused = first & (w == 1)[:, None]
        x[:, j] = np.where(unused, np.nan, after.x)
        P[:, j] = np.where(unused[..., None], np.nan, after.P)
    return s._replace(received=Belief(x, P))


def combined(own: Belief, received: Belief) -> Belief:
    """The product of independent Gaussians: the own belief, and the position by each sender's packets."""
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
