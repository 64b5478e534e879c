"""CTRN, fusion="moments": the particles' Gaussian is fused with the sender's, and the particles follow.

The two Gaussians are inflated to P_i/w and P_j/(1-w), the reading updates the joint, and the particles move by the
affine map that gives them the new mean and covariance.
"""

import numpy as np

from cooploc.estimators.compiled.jit import kernel, readable, wide
from cooploc.estimators.ctrn import audit
from cooploc.estimators.ctrn.chain import chain
from cooploc.estimators.ctrn.intersection import counted, intersect
from cooploc.estimators.ctrn.state import Settings, State, readings
from cooploc.estimators.interface import Array, Belief, Mail, Senses
from cooploc.estimators.models.angles import wrap_heading
from cooploc.estimators.models.sensors import LogDistance, Range
from cooploc.estimators.particle import own_filter
from cooploc.estimators.particle.steps import offset


def fuse(p: Settings, s: State, z: Senses, mail: Mail) -> State:
    """Fuse with one sender after the other, then move the particles to the mean and covariance that result."""
    before = own_filter.to_send(s.own)
    after, s = all_senders(p, s, before, z, mail)
    return s._replace(own=s.own._replace(x=follow(s.own.x, before, after)))


def all_senders(p: Settings, s: State, before: Belief, z: Senses, mail: Mail) -> tuple[Belief, State]:
    """The belief after all senders: by the compiled loop where there is one for the sensor, else step by step."""
    sensor = s.own.world.sensors[f"radio_{p.reading}"]
    if p.weights == "exact" and type(sensor) in (LogDistance, Range):
        z_j = getattr(mail, p.reading)
        done = chain(before, sensor, mail.packets, z_j, p.criterion, audit.drawn(p, s, z_j))
        if done is not None:
            after, fusions, sample = done
            return after, counted(s._replace(sample=s.sample.joined(sample)), fusions, np.zeros_like(fusions))
    return step_by_step(p, s, before, z, mail)


def step_by_step(p: Settings, s: State, before: Belief, z: Senses, mail: Mail) -> tuple[Belief, State]:
    """The belief after all senders, each linearised at the belief that the last one left."""
    after = before
    for reading in readings(s, z, mail):
        after, _, s = intersect(p, s, after, reading, after.x)
    return after, s


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
def _follow(x, moved, m0, P0, m1, P1, out):
    """m1 + L1 L0^-1 (x - m0), with L0 and L1 the lower triangular roots of P0 and P1."""
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
