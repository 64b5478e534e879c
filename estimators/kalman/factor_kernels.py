"""Compiled loops of the filter that keeps cross terms as factors, `ekf_luft.py`."""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.compiled.jit import strict_kernel
from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.kalman.matrix_kernels import whiten

LIMIT = 1 - 1e-9  # largest correlation of any two combinations of two robots' states


class Factored(NamedTuple):
    """A team's beliefs with P_ij = sigma_ij sigma_ji'."""

    x: Array  # (t, n, d)
    P: Array  # (t, n, d, d)
    sigma: Array  # (t, n, n, d, d)  axis 1 is the robot that keeps it; the diagonal is not used


class PairUpdate(NamedTuple):
    """A linearised reading between two robots."""

    y: Array  # (t, k)  nan where absent
    H: Array  # (t, k, 2 d)
    R: Array  # (k, k)


@strict_kernel
def possible(A: Array, B: Array, C: Array) -> Array:
    """The cross term C (d, d) of covariances A and B, its canonical correlations cut to `LIMIT`.

    They are the singular values of M = B^-1/2 C' A^-1/2', needed only where LIMIT^2 I - M' M is not definite.
    """
    half, M = C.copy(), np.empty_like(C)
    whiten(A.copy(), half)
    M[:] = half.T
    whiten(B.copy(), M)
    room = LIMIT**2 * np.eye(len(C)) - M.T @ M
    whiten(room, np.empty((len(C), 0)))
    if room[-1, -1] > 0:  # nan if an earlier pivot was not
        return C
    u, correlation, v = np.linalg.svd(M)
    cut = np.linalg.cholesky(B) @ (u * np.minimum(correlation, LIMIT)) @ v @ np.linalg.cholesky(A).T
    return np.ascontiguousarray(cut.T)


@strict_kernel
def carry(x: Array, P: Array, sigma: Array, step: Array, P1: Array) -> None:
    """x += step,  sigma_k = P' P^-1 sigma_k for the cross terms with all others,  P = P'."""
    factor = np.linalg.solve(P, np.ascontiguousarray(P1)).T
    x += step
    P[:] = P1
    for k in range(len(sigma)):
        sigma[k] = factor @ sigma[k]


@strict_kernel
def meet(team: Factored, pair: tuple[int, int], reading: PairUpdate, gate: float) -> Mask:
    """Joint update of a pair of robots in place; says which trials used the reading (t,)."""
    (t, _, d), (i, j), (x, P, sigma) = team.x.shape, pair, team
    used = np.zeros(t, np.bool_)
    J, one = np.empty((2 * d, 2 * d)), np.eye(2 * d)
    for s in range(t):
        y, H, R = reading.y[s], reading.H[s], reading.R
        if np.isnan(y).any() or np.isnan(H).any():
            continue
        J[:d, :d], J[d:, d:] = P[s, i], P[s, j]
        J[:d, d:] = possible(P[s, i], P[s, j], sigma[s, i, j] @ sigma[s, j, i].T)
        J[d:, :d] = J[:d, d:].T
        S = H @ J @ H.T + R
        if y @ np.linalg.solve(S, y) <= gate:
            used[s] = True
            K = np.linalg.solve(S, H @ J).T
            rest, step = one - K @ H, K @ y
            J1 = rest @ J @ rest.T + K @ R @ K.T
            J1 = (J1 + J1.T) / 2
            carry(x[s, i], P[s, i], sigma[s, i], step[:d], J1[:d, :d])
            carry(x[s, j], P[s, j], sigma[s, j], step[d:], J1[d:, d:])
            sigma[s, i, j], sigma[s, j, i] = J1[:d, d:], np.eye(d)
    return used
