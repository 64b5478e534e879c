"""The compiled loops of `ekf_split_ci.py`: the weight of a reading, and the update of both parts of a covariance."""

import numpy as np

from cooploc.estimators.compiled.jit import strict_kernel
from cooploc.estimators.kalman.matrix_kernels import fill_product, fill_sum, joseph, solve, whiten

REACH = 8.0  # largest |logit w| that is tried
ROUNDS, POINTS = 4, 11  # of the search for w, each round ten times finer


@strict_kernel
def _log_det(u, A, v, B, C, nothing):
    """ln det (u A + v B) of a positive definite matrix, else nan; C is scratch."""
    fill_sum(u, A, v, B, C)
    whiten(C, nothing)
    total = 0.0
    for a in range(len(C)):
        total += 2 * np.log(C[a, a])
    return total


@strict_kernel
def _spread(P, H, U, S):
    """P H' into U (d, k), H P H' into S (k, k)."""
    for a in range(len(P)):
        for i in range(len(H)):
            U[a, i] = 0.0
            for c in range(len(P)):
                U[a, i] += P[a, c] * H[i, c]
    fill_product(H, U, S)


@strict_kernel
def _trace(U, S, Rd, td, ti, w, C, B):
    """tr P'_xy = tr P1 - tr(M S^-1 M'), by S = C C' and C^-1 M' in B (k, 2); U and S have the parts d and i."""
    for i in range(len(C)):
        for j in range(len(C)):
            C[i, j] = S[0, i, j] / w + S[1, i, j] + Rd[i, j] / (1 - w)
        for a in range(2):
            B[i, a] = U[0, a, i] / w + U[1, a, i]
    whiten(C, B)
    total = td / w + ti
    for i in range(len(C)):
        total -= B[i, 0] * B[i, 0] + B[i, 1] * B[i, 1]
    return total


@strict_kernel
def least_trace(Pd, Pi, H, Rd, Ri, there, weights, helps):
    """The weight w (r,) of least tr P'_xy of rows that are `there`, searched on a grid of logit w; whether it helps.

    tr P' = tr P1 - tr(M S^-1 M') with P1 = Pd / w + Pi, M = (P1 H')_xy and S = H P1 H' + Rd / (1 - w) + Ri.
    """
    k, d = H.shape[1], H.shape[2]
    U, S, C, B = np.empty((2, d, k)), np.empty((2, k, k)), np.empty((k, k)), np.empty((k, 2))
    A, nothing, no_columns = np.empty((d, d)), np.empty((d, 0)), np.empty((k, 0))
    for r in range(len(Pd)):
        weights[r], helps[r] = 0.5, False
        if not there[r]:
            continue
        _spread(Pd[r], H[r], U[0], S[0])
        _spread(Pi[r], H[r], U[1], S[1])
        fill_sum(1.0, S[1], 1.0, Ri[r], S[1])
        td, ti = Pd[r, 0, 0] + Pd[r, 1, 1], Pi[r, 0, 0] + Pi[r, 1, 1]
        middle, reach, least, w = 0.0, REACH, np.inf, 0.5
        for _ in range(ROUNDS):
            least, best = np.inf, middle
            for p in range(POINTS):
                v = middle + (p * (2 * reach / (POINTS - 1)) - reach)
                u = 1 / (1 + np.exp(-v))
                trace = _trace(U, S, Rd[r], td, ti, u, C, B)
                if trace < least:
                    least, best, w = trace, v, u
            middle, reach = best, reach / ((POINTS - 1) / 2)
        gained = _log_det(1 / (1 - w), Rd[r], 1.0, Ri[r], C, no_columns)  # det P' = det P1 det R / det S
        fill_sum(1.0, S[1], 1 / (1 - w), Rd[r], S[1])
        gained -= _log_det(1 / w, S[0], 1.0, S[1], C, no_columns)
        gained += _log_det(1 / w, Pd[r], 1.0, Pi[r], A, nothing) - _log_det(1.0, Pd[r], 1.0, Pi[r], A, nothing)
        weights[r], helps[r] = w, least < td + ti and gained < 0


@strict_kernel
def split(P, Pd, Pi, H, Rd, Ri, keep, new_d, new_i, used):
    """The parts of P' into new_d and new_i (r, d, d) of the rows that used their reading: those with P' other than P1.

    With K = P' H' R^-1 and the inflated Pd and Rd: Pd' = (I - K H) Pd (I - K H)' + K Rd K',  Pi' = (I - K H) Pi
    (I - K H)' + K Ri K'; K Ri K' goes to Pd' unless Pi is to `keep` it.
    """
    k, d = H.shape[1], H.shape[2]
    A, K, R = np.empty((d, d)), np.empty((k, d)), np.empty((k, k))
    for r in range(len(P)):
        used[r] = False
        for a in range(d):
            for b in range(d):
                used[r] = used[r] or Pd[r, a, b] + Pi[r, a, b] != P[r, a, b]
        if used[r]:
            fill_product(H[r], P[r], K)
            fill_sum(1.0, Rd[r], 1.0, Ri[r], R)
            solve(R, K)
            fill_sum(1.0, Rd[r], 0.0 if keep else 1.0, Ri[r], R)
            joseph(Pd[r], H[r], K, R, A, new_d[r])
            fill_sum(0.0, Rd[r], 1.0 if keep else 0.0, Ri[r], R)
            joseph(Pi[r], H[r], K, R, A, new_i[r])
