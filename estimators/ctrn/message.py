"""CTRN, fusion="message": the particles' own density is flattened to the power w, then weighed by the reading.

With p the Gaussian of the particles, covariance intersection multiplies their weights by

    p(x)^(w - 1)  N(y(x); 0, R + J P_j J' / (1 - w)),

the reading's likelihood with the sender's covariance inflated. The weights change; the particles stay where they are.
"""

import numpy as np

from cooploc.estimators.ctrn.intersection import intersect
from cooploc.estimators.ctrn.state import Settings, State, readings
from cooploc.estimators.interface import Array, Belief, Mail, Senses
from cooploc.estimators.particle.likelihood import log_normal
from cooploc.estimators.particle.steps import offset, summary


def fuse(p: Settings, s: State, z: Senses, mail: Mail) -> State:
    """log w_i += (w - 1) log p(x_i) + log N(y(x_i); 0, R + J P_j J' / (1 - w)), one sender after the other."""
    x, logw = s.own.x, s.own.logw
    for reading in readings(s, z, mail):
        belief = summary(x, logw)
        _, w, s = intersect(p, s, belief, reading, belief.x)
        y, _, J = reading.sensor.innovation(x, reading.x_j[:, None], reading.z[:, None])
        J, rest = J[..., 0, :], np.where(w < 1, 1 - w, np.nan)[:, None]
        v = reading.sensor.R[0, 0] + ((J @ reading.P_j) * J).sum(-1) / rest
        P = np.where((w < 1)[:, None, None], belief.P, np.eye(x.shape[-1]))  # a collapsed one is not inverted
        flat = (w - 1)[:, None] * log_density(x, belief._replace(P=P))
        logw = np.where(w[:, None] < 1, logw + flat + log_normal(y[..., 0], v), logw)
    return s._replace(own=s.own._replace(logw=logw))


def log_density(x: Array, belief: Belief) -> Array:
    """log N(x; belief) of particles (r, N, d) up to a constant."""
    e = offset(x, belief.x)
    d2: Array = (e * np.linalg.solve(belief.P[:, None], e[..., None])[..., 0]).sum(-1)
    return -0.5 * d2
