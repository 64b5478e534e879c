"""Updates of a team's joint Gaussian by a few of its blocks.

A team's mean is x (t, n, d), its covariance P (t, n d, n d). The Jacobian of a reading of robot j by robot i is 0
for all others, so that P H' needs two block columns and not the whole matrix.

Sources: S. Roumeliotis, G. Bekey, "Distributed multirobot localization", IEEE T-RA 18(5), 2002 (the sparse update);
S. Thrun et al., "Simultaneous localization and mapping with sparse extended information filters", IJRR 23, 2004, sec. 2
(readings add in information form).
"""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from cooploc.estimators.compiled import readable
from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.joint_kernels import Ranging, Readings, add_information, fill_distances, join_ranges
from cooploc.estimators.kalman import distance, present, symmetric
from cooploc.estimators.kalman_kernels import (
    Nodes,
    add_directions,
    add_ranges,
    add_scalars,
    fill_definite,
    fill_widened,
    widen,
)
from cooploc.estimators.models import GradientDoa


def flat(x: Array) -> Array:
    """(t, n, d) as (t, n d)."""
    return x.reshape(len(x), -1)


def square(P: Array) -> Array:
    """(t, n, d, n, d) as (t, n d, n d)."""
    t, n, d = P.shape[:3]
    return P.reshape(t, n * d, n * d)


def block_diagonal(blocks: Array) -> Array:
    """(t, n, d, d) on the diagonal of (t, n, d, n, d)."""
    t, n, d, _ = blocks.shape
    P = np.zeros((t, n, d, n, d))
    for i in range(n):
        P[:, i, :, i] = blocks[:, i]
    return P


def add_process_noise(P: Array, Q: Array) -> Array:
    """P (t, n d, n d) after a move with F = I: Q (t, n, d, d) on its diagonal blocks, and symmetric."""
    out = np.empty(P.shape)
    fill_widened(P, np.ascontiguousarray(Q), out)
    return out


def drive(P: Array, F: Array, Q: Array) -> Array:
    """F_i P_ij F_j', and Q_i on the diagonal, of P (t, n d, n d) and blocks F and Q (t, n, d, d)."""
    out = np.empty(P.shape)
    widen(readable(P), readable(F), readable(Q), out)
    return out


def anywhere(x: Array, P: Array, lost: Mask, arena: Array) -> tuple[Array, Array]:
    """x (t, n, d) in the arena's middle, P_ii of a uniform density, P_ij = 0 of (t, n, d, n, d) for robots `lost`."""
    (low, high), d = arena, x.shape[-1]
    x = np.where(lost[..., None] & (np.arange(d) < 2), np.append((low + high) / 2, 0.0)[:d], x)
    uniform = np.diag(np.append((high - low) ** 2 / 12, np.pi**2 / 3)[:d])
    P = np.where(lost[:, :, None, None, None] | lost[:, None, None, :, None], 0.0, P)
    return x, P + block_diagonal(np.where(lost[..., None, None], uniform, 0.0))


def spread_out(P: Array, d: int) -> Array:
    """Covariance (t, n, n, 2, 2) of every difference of two positions, from P (t, n d, n d)."""
    blocks = P.reshape(len(P), P.shape[1] // d, d, -1, d)[:, :, :2, :, :2].swapaxes(2, 3)  # (t, n, n, 2, 2)
    own = np.einsum("tiiab->tiab", blocks)
    D: Array = own[:, :, None] + own[:, None] - blocks - blocks.swapaxes(1, 2)
    return D


def sparse_update(
    x: Array, P: Array, y: Array, at: Mapping[int, Array], R: Array, gate: float
) -> tuple[Array, Array, Mask]:
    """K = P H' S^-1,  x' = x + K y,  P' = P - K S K' by a Jacobian given `at` some robots and 0 elsewhere.

    With S = C C' and L = P H' C'^-1, K S K' = L L', symmetric to the last bit. Also says which trials used it (t,).
    """
    t, n, d = x.shape
    R = np.broadcast_to(R, (*y.shape, y.shape[-1]))
    use = np.asarray(np.stack([present(y, H, R) for H in at.values()]).all(0))
    y, R = np.where(use[:, None], y, 0.0), np.where(use[:, None, None], R, np.eye(y.shape[-1]))
    at = {i: np.where(use[:, None, None], H, 0.0) for i, H in at.items()}
    PH = np.zeros((t, n * d, y.shape[-1]))
    for i, H in at.items():
        PH = PH + P[:, :, i * d : i * d + d] @ H.mT
    S = symmetric(R + np.asarray(sum(H @ PH[:, i * d : i * d + d] for i, H in at.items())))
    use &= distance(y, S) <= gate
    half: Array = np.linalg.inv(np.linalg.cholesky(S))
    L = np.where(use[:, None, None], PH @ half.mT, 0.0)
    x = x + (L @ (half @ y[..., None])).reshape(t, n, d)
    for column in range(y.shape[-1]):
        P = P - L[:, :, None, column] * L[:, None, :, column]
    return x, P, use


def range_by_range(x: Array, P: Array, z: Array, R: Array, gate: float) -> tuple[Array, Array]:
    """Plain Kalman updates of x (t, n, d), P (t, n d, n d) by ranges z (t, n, n), in the order of `pairs`."""
    x, P = x.copy(), P.copy()
    add_ranges(x, P, z, R.item(), gate)
    return x, P


def direction_by_direction(x: Array, P: Array, z: Array, doa: GradientDoa, gate: float) -> tuple[Array, Array]:
    """The same by directions of arrival z (t, n), robot by robot."""
    x, P = x.copy(), P.copy()
    add_directions(x, P, z, _nodes(doa), gate)
    return x, P


@lru_cache(maxsize=64)
def _nodes(doa: GradientDoa) -> Nodes:
    return Nodes(doa.anchors, doa.gradient(np.eye(4)), float(5 * doa.rssi.eta / np.log(10)), doa.R.item())


def ranges_together(x: Array, P: Array, z: Array, how: Ranging) -> tuple[Array, Array, Array]:
    """Gauss-Newton on all ranges z (t, n, n) at once; also their squared Mahalanobis distances (t, n, n)."""
    x, P, d2 = x.copy(), P.copy(), np.full(z.shape, np.nan)
    join_ranges(x, P, z, how, d2)
    return x, P, d2


def scalar_by_scalar(x: Array, P: Array, use: Mask, y: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Kalman updates by one scalar after the other of y (t, n, k), linearised together, where `use` (t, n) allows.

    H (t, n, k, d) by each robot's own state; R (k, k) is diagonal.
    """
    x, P = x.copy(), P.copy()
    add_scalars(x, P, use, y, H, R.diagonal().copy())
    return x, P


def definite(P: Array) -> Mask:
    """Which of the symmetric matrices P (..., d, d) are positive definite."""
    out = np.zeros(P.shape[:-2], bool)
    fill_definite(np.ascontiguousarray(P).reshape(-1, *P.shape[-2:]), out.reshape(-1))
    return out


def dense(at: Mapping[int, Array], robots: int) -> Array:
    """The Jacobian (t, k, n d) given `at` some robots and 0 elsewhere."""
    first = next(iter(at.values()))
    H = np.zeros((*first.shape[:2], robots, first.shape[2]))
    for i, block in at.items():
        H[:, :, i] = block
    return H.reshape(*first.shape[:2], -1)


def readings_of(y: Array, H_i: Array, H_j: Array, R: Array) -> Readings:
    """Readings y (t, n, m, k) with a noise R that some of them share."""
    return Readings(y, H_i, H_j, np.ascontiguousarray(np.broadcast_to(R, (*y.shape, y.shape[-1]))))


def stack_readings(use: Mask, readings: Readings) -> tuple[Array, Array, Array]:
    """All readings as one vector: y (t, m), H (t, m, n d), R (t, m, m); those that `use` excludes have H = 0."""
    y, H_i, H_j, R = readings
    t, n, others, k, d = H_i.shape
    H, noise = np.zeros((t, n, others, k, n, d)), np.zeros((t, n * others, k, n * others, k))
    for i in range(n):
        H[:, i, :, :, i] += H_i[:, i]
    for j in range(others):
        H[:, :, j, :, j] += H_j[:, :, j]
    H = np.where(use[..., None, None, None], H, 0.0)
    R = np.where(use[..., None, None], R, np.eye(k)).reshape(t, -1, k, k)
    for m in range(n * others):
        noise[:, m, :, m] = R[:, m]
    size = n * others * k
    y = np.where(use[..., None], y, 0.0).reshape(t, size)
    return y, H.reshape(t, size, n * d), noise.reshape(t, size, size)


def distances(P: Array, readings: Readings) -> Array:
    """Squared Mahalanobis distance (t, n, m) of the readings under P (t, n d, n d); nan where absent."""
    d2 = np.full(readings.y.shape[:-1], np.nan)
    fill_distances(P, readings, d2)
    return d2


def information(use: Mask, readings: Readings) -> tuple[Array, Array]:
    """H'R^-1 y (t, n d) and H'R^-1 H (t, n d, n d) summed over the readings that `use` (t, n, m) allows."""
    t, n, _, _, d = readings.H_i.shape
    eta, Lambda = np.zeros((t, n * d)), np.zeros((t, n * d, n * d))
    add_information(use, readings, eta, Lambda)
    return eta, Lambda


def information_mean(x: Array, P: Array, eta: Array, Lambda: Array) -> Array:
    """x + (P^-1 + Lambda)^-1 eta (t, n d): the mean alone, by one right-hand side."""
    step = np.asarray(np.linalg.solve(np.eye(P.shape[-1]) + P @ Lambda, P @ eta[..., None]), float)
    return np.asarray(x + step[..., 0])


def information_update(P: Array, Lambda: Array) -> Array:
    """(P^-1 + Lambda)^-1 as (I + P Lambda)^-1 P, which needs no inverse of P; where Lambda is 0 it is P."""
    return symmetric(np.asarray(np.linalg.solve(np.eye(P.shape[-1]) + P @ Lambda, P), float))
