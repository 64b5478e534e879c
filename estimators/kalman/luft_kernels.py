"""The compiled loop of `ekf_luft.py`: two robots meet, trial by trial."""

import numba
import numpy as np

from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.kalman.joint_kernels import whiten


def _possible(A: Array, B: Array, C: Array, limit: float) -> Array:
    """The cross term C (d, d) of covariances A and B, its canonical correlations cut to the limit.

    They are the singular values of M = B^-1/2 C' A^-1/2', needed only where limit^2 I - M' M is not definite.
    """
    half, M = C.copy(), np.empty_like(C)
    whiten(A.copy(), half)
    M[:] = half.T
    whiten(B.copy(), M)
    room = limit**2 * np.eye(len(C)) - M.T @ M
    whiten(room, np.empty((len(C), 0)))
    if room[-1, -1] > 0:  # nan if an earlier pivot was not
        return C
    u, correlation, v = np.linalg.svd(M)
    cut: Array = np.linalg.cholesky(B) @ (u * np.minimum(correlation, limit)) @ v @ np.linalg.cholesky(A).T
    return np.ascontiguousarray(cut.T)


def _met(
    x: Array, P: Array, sigma: Array, pair: tuple[int, int], y: Array, H: Array, R: Array, gate: float, limit: float
) -> Mask:
    """Joint update of a pair of robots in place, by y (t, k) with H (t, k, 2 d); says which trials used it (t,)."""
    (t, _, d), (i, j) = x.shape, pair
    used = np.zeros(t, np.bool_)
    J, one = np.empty((2 * d, 2 * d)), np.eye(2 * d)
    for s in range(t):
        if np.isnan(y[s]).any() or np.isnan(H[s]).any():
            continue
        J[:d, :d], J[d:, d:] = P[s, i], P[s, j]
        J[:d, d:] = possible(P[s, i], P[s, j], sigma[s, i, j] @ sigma[s, j, i].T, limit)
        J[d:, :d] = J[:d, d:].T
        S = H[s] @ J @ H[s].T + R
        if y[s] @ np.linalg.solve(S, y[s]) <= gate:
            used[s] = True
            K = np.linalg.solve(S, H[s] @ J).T
            rest, step = one - K @ H[s], K @ y[s]
            J1 = rest @ J @ rest.T + K @ R @ K.T
            J1 = (J1 + J1.T) / 2
            carry(x[s, i], P[s, i], sigma[s, i], step[:d], J1[:d, :d])
            carry(x[s, j], P[s, j], sigma[s, j], step[d:], J1[d:, d:])
            sigma[s, i, j], sigma[s, j, i] = J1[:d, d:], np.eye(d)
    return used


def _carried(x: Array, P: Array, sigma: Array, step: Array, P1: Array) -> None:
    """x += step,  sigma_k = P' P^-1 sigma_k for the cross terms with everybody,  P = P'."""
    factor = np.linalg.solve(P, np.ascontiguousarray(P1)).T
    x += step
    P[:] = P1
    for k in range(len(sigma)):
        sigma[k] = factor @ sigma[k]


_compiled = numba.njit(cache=True, error_model="numpy")
possible = _compiled(_possible)
carry = _compiled(_carried)
meet = _compiled(_met)
