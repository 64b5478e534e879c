"""Covariance intersection of a belief with one reading of one sender."""

import numpy as np

from cooploc.estimators.covariance_intersection.small_matrices import PIVOT
from cooploc.estimators.covariance_intersection.weights import solve_relative
from cooploc.estimators.ctrn import audit
from cooploc.estimators.ctrn.chain import COLLAPSED
from cooploc.estimators.ctrn.state import Counts, Reading, Sample, Settings, State
from cooploc.estimators.interface import Array, Belief, Mask
from cooploc.estimators.kalman.update import inflated_update


def intersect(p: Settings, s: State, belief: Belief, reading: Reading, at: Array) -> tuple[Belief, Array, State]:
    """The belief after one reading, linearised at `at`, the weight w (r,), and the state with the fusions counted.

    x' = x + K y,  P' = (I - K H) P/w  with  K = P/w H' (H P/w H' + H_j P_j/(1-w) H_j' + R)^-1;  w = 1: unchanged.
    """
    sensor, sender, z, x_j, P_j = reading
    y, H, H_j = sensor.innovation(at, x_j, z)
    y = y + (H @ (at - belief.x)[..., None])[..., 0]
    use = np.flatnonzero(~np.isnan(y).any(-1) & ~np.isnan(P_j).any((-2, -1)) & invertible(belief.P))
    w = np.ones(len(y))
    if use.size:
        R = np.broadcast_to(sensor.R, (use.size, *sensor.R.shape))
        parts = belief.P[use], P_j[use], H[use], H_j[use], R
        found = solve_relative(*parts, p.criterion, p.weights, groups=s.solver_group[use])
        w[use] = found.w
        fused, failed = np.zeros((2, len(w)))
        fused[use], failed[use] = 1.0, found.fallback
        s = counted(s, fused, failed)
        if p.weights == "exact":
            chosen = audit.drawn(p, s, np.zeros((len(w), sender + 1)))[use, sender]
            s = s._replace(sample=s.sample.joined(Sample(use, found.w, *parts).take(chosen)))
    return inflated_update(belief, y, H, H_j, P_j, sensor.R, w), w, s


def counted(s: State, fusions: Array, fallbacks: Array) -> State:
    """The state with so many more fusions and fallbacks (r,)."""
    return s._replace(counts=Counts(s.counts.fusions + fusions, s.counts.fallbacks + fallbacks))


def invertible(P: Array) -> Mask:
    """Rows whose covariance can be inverted (r,): particles may have collapsed into one point."""
    trace = np.trace(P, axis1=-2, axis2=-1)
    ok: Mask = np.linalg.eigvalsh(P)[:, 0] > COLLAPSED * np.maximum(trace, np.finfo(float).tiny)
    return ok


def where_definite(packets: Array) -> Array:
    """Packets (r, 5), nan where the covariance is singular by more than rounding."""
    xx, xy, yy = packets[:, 2:].T
    with np.errstate(divide="ignore", invalid="ignore"):
        definite = (yy > 0) & (xx - xy / yy * xy > PIVOT * xx)
    return np.where(definite[:, None], packets, np.nan)
