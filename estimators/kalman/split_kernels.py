"""The compiled loops of `ekf_split_ci.py`: the weight of a reading, and the update of both parts of a covariance."""

import numpy as np

from cooploc.estimators.compiled.jit import strict_kernel
from cooploc.estimators.kalman.matrix_kernels import fill_product, fill_sum, joseph, solve, whiten
from cooploc.estimators.kalman.row_kernels import absorb_row, is_known

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
def _scratch(k, d):
    """Scratch of `_least`, allocated once for all rows."""
    of_reading = np.empty((2, d, k)), np.empty((2, k, k)), np.empty((k, k)), np.empty((k, 2))
    return *of_reading, np.empty((d, d)), np.empty((d, 0)), np.empty((k, 0))


@strict_kernel
def _least(Pd, Pi, H, Rd, Ri, scratch):
    """`least_trace` of one row: the weight, and whether it helps."""
    U, S, C, B, A, nothing, no_columns = scratch
    _spread(Pd, H, U[0], S[0])
    _spread(Pi, H, U[1], S[1])
    fill_sum(1.0, S[1], 1.0, Ri, S[1])
    td, ti = Pd[0, 0] + Pd[1, 1], Pi[0, 0] + Pi[1, 1]
    middle, reach, least, w = 0.0, REACH, np.inf, 0.5
    for _ in range(ROUNDS):
        least, best = np.inf, middle
        for p in range(POINTS):
            v = middle + (p * (2 * reach / (POINTS - 1)) - reach)
            u = 1 / (1 + np.exp(-v))
            trace = _trace(U, S, Rd, td, ti, u, C, B)
            if trace < least:
                least, best, w = trace, v, u
        middle, reach = best, reach / ((POINTS - 1) / 2)
    gained = _log_det(1 / (1 - w), Rd, 1.0, Ri, C, no_columns)  # det P' = det P1 det R / det S
    fill_sum(1.0, S[1], 1 / (1 - w), Rd, S[1])
    gained -= _log_det(1 / w, S[0], 1.0, S[1], C, no_columns)
    gained += _log_det(1 / w, Pd, 1.0, Pi, A, nothing) - _log_det(1.0, Pd, 1.0, Pi, A, nothing)
    return w, least < td + ti and gained < 0


@strict_kernel
def least_trace(Pd, Pi, H, Rd, Ri, there, weights, helps):
    """The weight w (r,) of least tr P'_xy of rows that are `there`, searched on a grid of logit w; whether it helps.

    tr P' = tr P1 - tr(M S^-1 M') with P1 = Pd / w + Pi, M = (P1 H')_xy and S = H P1 H' + Rd / (1 - w) + Ri.
    """
    scratch = _scratch(H.shape[1], H.shape[2])
    for r in range(len(Pd)):
        weights[r], helps[r] = 0.5, False
        if there[r]:
            weights[r], helps[r] = _least(Pd[r], Pi[r], H[r], Rd[r], Ri[r], scratch)


@strict_kernel
def split_row(P, Pd, Pi, H, Rd, Ri, keep, new_d, new_i, A, K, R):
    """`split` of one row, and whether it used its reading; new_d may be Pd, new_i Pi.

    Scratch: A (d, d), K (k, d), R (k, k).
    """
    d, used = len(P), False
    for a in range(d):
        for b in range(d):
            used = used or Pd[a, b] + Pi[a, b] != P[a, b]
    if used:
        fill_product(H, P, K)
        fill_sum(1.0, Rd, 1.0, Ri, R)
        solve(R, K)
        fill_sum(1.0, Rd, 0.0 if keep else 1.0, Ri, R)
        joseph(Pd, H, K, R, A, new_d)
        fill_sum(0.0, Rd, 1.0 if keep else 0.0, Ri, R)
        joseph(Pi, H, K, R, A, new_i)
    return used


@strict_kernel
def split(P, Pd, Pi, H, Rd, Ri, keep, new_d, new_i, used):
    """The parts of P' into new_d and new_i (r, d, d) of the rows that used their reading: those with P' other than P1.

    With K = P' H' R^-1 and the inflated Pd and Rd: Pd' = (I - K H) Pd (I - K H)' + K Rd K',  Pi' = (I - K H) Pi
    (I - K H)' + K Ri K'; K Ri K' goes to Pd' unless Pi is to `keep` it.
    """
    k, d = H.shape[1], H.shape[2]
    A, K, R = np.empty((d, d)), np.empty((k, d)), np.empty((k, k))
    for r in range(len(P)):
        used[r] = split_row(P[r], Pd[r], Pi[r], H[r], Rd[r], Ri[r], keep, new_d[r], new_i[r], A, K, R)


@strict_kernel
def cooperate(x, Pd, Pi, reading, gate, keep, used):
    """`EkfSplitCi._cooperate` in place, x (r, d), Pd and Pi (r, d, d), and which rows `used` (r,) their reading.

    `reading` is y (r, k), H (r, k, d), and of its noise Rd and Ri (r, k, k); absent where anything is nan.
    """
    y, H, Rd, Ri = reading
    k, d = H.shape[1], H.shape[2]
    scratch, K, T = _scratch(k, d), np.empty((k, d)), np.empty((k, k))
    S, B, A, P = np.empty((k, k)), np.empty((k, d + 1)), np.empty((d, d)), np.empty((d, d))
    wide_d, wide_R, N = np.empty((d, d)), np.empty((k, k)), np.empty((k, k))
    for r in range(len(x)):
        used[r] = False
        if not (is_known(y[r], H[r], Rd[r]) and is_known(y[r], H[r], Ri[r])):
            continue
        w, helps = _least(Pd[r], Pi[r], H[r], Rd[r], Ri[r], scratch)
        if helps:
            for a in range(d):
                for b in range(d):
                    wide_d[a, b] = Pd[r, a, b] / w
                    P[a, b] = wide_d[a, b] + Pi[r, a, b]
            for a in range(k):
                for b in range(k):
                    wide_R[a, b] = Rd[r, a, b] / (1 - w)
                    N[a, b] = wide_R[a, b] + Ri[r, a, b]
            absorb_row(x[r], P, y[r], H[r], N, gate, S, B, A)
            used[r] = split_row(P, wide_d, Pi[r], H[r], wide_R, Ri[r], keep, Pd[r], Pi[r], A, K, T)
