"""Moves and updates of a team's joint Gaussian, mean x (t, n, d) and covariance P (t, n d, n d).

The Jacobian of a reading of robot j by robot i is 0 for all others, so that P H' needs two block columns.

Sources: S. Roumeliotis, G. Bekey, "Distributed multirobot localization", IEEE T-RA 18(5), 2002 (the sparse update);
S. Thrun et al., "Simultaneous localization and mapping with sparse extended information filters", IJRR 23, 2004, sec. 2
(readings add in information form).
"""

from collections.abc import Mapping

import numpy as np

from cooploc.estimators.compiled import readable
from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.joint_kernels import LinearReadings, information
from cooploc.estimators.kalman import ENGINES, EngineName, distance, is_present, symmetric
from cooploc.estimators.kalman_kernels import fill_definite, widen


def flat(x: Array) -> Array:
    """Return (t, n, d) as (t, n d)."""
    return x.reshape(len(x), -1)


def square(P: Array) -> Array:
    """Return (t, n, d, n, d) as (t, n d, n d)."""
    t, n, d = P.shape[:3]
    return P.reshape(t, n * d, n * d)


def block_diagonal(blocks: Array) -> Array:
    """Return (t, n, d, n, d) with (t, n, d, d) on its diagonal."""
    t, n, d, _ = blocks.shape
    P = np.zeros((t, n, d, n, d))
    for i in range(n):
        P[:, i, :, i] = blocks[:, i]
    return P


def own_blocks(P: Array) -> Array:
    """Return P_ii (t, n, d, d) of P (t, n, d, n, d), a view."""
    return np.asarray(np.einsum("tiaib->tiab", P), float)


def pair_blocks(P: Array) -> tuple[Array, Array, Array]:
    """Return P_ii (t, n, 1, d, d), P_jj (t, 1, n, d, d) and P_ij (t, n, n, d, d) of P (t, n, d, n, d), views."""
    own = own_blocks(P)
    return own[:, :, None], own[:, None], P.swapaxes(2, 3)


def move_blocks(engine: EngineName, P: Array, F: Array, Q: Array) -> Array:
    """Return F_i P_ij F_j', and Q_i on the diagonal, of P (t, n d, n d) and blocks F and Q (t, n, d, d)."""
    if engine == "filterpy":
        return ENGINES[engine].predict(P, square(block_diagonal(F)), square(block_diagonal(Q)))
    out = np.empty(P.shape)
    widen(readable(P), readable(F), readable(Q), out)
    return out


def sparse_update(x: Array, P: Array, y: Array, at: Mapping[int, Array], R: Array, gate: float) -> tuple[Array, Array]:
    """Return x' = x + K y,  P' = P - K S K',  K = P H' S^-1 by a Jacobian given `at` some robots and 0 elsewhere.

    With S = C C' and L = P H' C'^-1, K S K' = L L', symmetric to the last bit.
    """
    t, n, d = x.shape
    R = np.broadcast_to(R, (*y.shape, y.shape[-1]))
    use = np.asarray(np.stack([is_present(y, H, R) for H in at.values()]).all(0))
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
    return x, P


def definite(P: Array) -> Mask:
    """Return which symmetric matrices P (..., d, d) are positive definite."""
    out = np.zeros(P.shape[:-2], bool)
    fill_definite(np.ascontiguousarray(P).reshape(-1, *P.shape[-2:]), out.reshape(-1))
    return out


def dense(at: Mapping[int, Array], robots: int) -> Array:
    """Return the Jacobian (t, k, n d) given `at` some robots and 0 elsewhere."""
    first = next(iter(at.values()))
    H = np.zeros((*first.shape[:2], robots, first.shape[2]))
    for i, block in at.items():
        H[:, :, i] = block
    return H.reshape(*first.shape[:2], -1)


def linear_readings(y: Array, H_i: Array, H_j: Array, R: Array) -> LinearReadings:
    """Return linearised readings y (t, n, m, k) with a noise R that broadcasts to (t, n, m, k, k)."""
    whole = np.empty((*y.shape, y.shape[-1]))
    whole[...] = R
    return y, np.ascontiguousarray(H_i), np.ascontiguousarray(H_j), whole  # contiguous: one compiled loop for all


def linear_fixed(y: Array, H: Array, R: Array) -> LinearReadings:
    """Return every robot's reading y (t, n, k) of one fixed thing as linearised readings with m = 1."""
    return linear_readings(y[:, :, None], H[:, :, None], np.zeros_like(H)[:, :, None], R)


def solve_together(
    engine: EngineName, P: Array, use: Mask, readings: LinearReadings, last: bool = True
) -> tuple[Array, Array]:
    """Return P' H'R^-1 y (t, n d) and P' = (P^-1 + H'R^-1 H)^-1 (t, n d, n d) by the readings that `use` allows.

    Before the `last` iteration P' is not needed, and may be P.
    """
    if engine == "filterpy":  # one after the other, as all are linear
        (y, H_i, H_j, R), x = readings, np.zeros(P.shape[:2])
        n, others = y.shape[1:3]
        for i, j in np.argwhere(use.any(0)).tolist():
            H = dense({i: H_i[:, i, j]} if others == 1 else {i: H_i[:, i, j], j: H_j[:, i, j]}, n)
            rest = np.where(use[:, i, j, None], y[:, i, j] - (H @ x[..., None])[..., 0], np.nan)
            x, P = ENGINES[engine].update(x, P, rest, H, R[:, i, j], np.inf)
        return x, P
    eta, Lambda = information(use, readings)
    return add_information(P, eta, Lambda, last)


def add_information(P: Array, eta: Array, Lambda: Array, last: bool = True) -> tuple[Array, Array]:
    """Return P' eta (t, n d) and P' = (P^-1 + Lambda)^-1 (t, n d, n d), which before the `last` iteration is P.

    As (I + P Lambda)^-1 P, which needs no inverse of P; where Lambda is 0 it is P.
    """
    A = np.eye(P.shape[-1]) + P @ Lambda
    if not last:
        return np.asarray(np.linalg.solve(A, P @ eta[..., None])[..., 0], float), P
    P = symmetric(np.asarray(np.linalg.solve(A, P), float))
    return (P @ eta[..., None])[..., 0], P
