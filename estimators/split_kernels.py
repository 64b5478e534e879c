"""The compiled loops of split covariance intersection: the weight of least trace, and updates of both parts."""

import numpy as np

from cooploc.estimators.compiled import strict_kernel
from cooploc.estimators.kalman_kernels import (
    absorb_row,
    fill_form,
    fill_product,
    fill_sum,
    is_known,
    is_seen,
    joseph,
    linearise_between,
    linearise_sighting,
    read_belief,
    solve,
    whiten,
)

ROUNDS, POINTS = 4, 11  # of the search for w, each round ten times finer
REACH = 8.0  # largest |logit w| that is tried


@strict_kernel
def _log_det(u, A, v, B):
    """Return ln det (u A + v B), nan where that is not positive definite."""
    C, total = np.empty(A.shape), 0.0
    fill_sum(u, A, v, B, C)
    whiten(C, np.empty((len(C), 0)))
    for a in range(len(C)):
        total += 2 * np.log(C[a, a])
    return total


@strict_kernel
def _trace(U, S, Rd, td, ti, w, C, B):
    """Return tr P'_xy = tr P1 - tr(M S^-1 M'), by S = C C' and C^-1 M' in B (k, 2); U and S have the parts d and i."""
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
def least_trace(Pd, Pi, H, Rd, Ri):
    """Return one row's weight w of least tr P'_xy, searched on a grid of logit w, and whether it helps.

    tr P' = tr P1 - tr(M S^-1 M') with P1 = Pd / w + Pi, M = (P1 H')_xy and S = H P1 H' + Rd / (1 - w) + Ri.
    """
    k, d = H.shape
    U, S, C, B = np.empty((2, d, k)), np.empty((2, k, k)), np.empty((k, k)), np.empty((k, 2))
    for part, P in enumerate((Pd, Pi)):
        fill_product(P, H.T, U[part])
        fill_product(H, U[part], S[part])
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
    gained = _log_det(1 / (1 - w), Rd, 1.0, Ri)  # det P' = det P1 det R / det S
    fill_sum(1.0, S[1], 1 / (1 - w), Rd, S[1])
    gained -= _log_det(1 / w, S[0], 1.0, S[1])
    gained += _log_det(1 / w, Pd, 1.0, Pi) - _log_det(1.0, Pd, 1.0, Pi)
    return w, least < td + ti and gained < 0


@strict_kernel
def split_row(x, Pd, Pi, y, H, Rd, Ri, w, gate, keep):
    """Update one row as `EkfSplitCi._update`, in place; return whether it used its reading."""
    k, d = H.shape
    P, wide_d, A = np.empty((d, d)), np.empty((d, d)), np.empty((d, d))
    R, wide_R, S, B, K = np.empty((k, k)), np.empty((k, k)), np.empty((k, k)), np.empty((k, d + 1)), np.empty((k, d))
    for a in range(len(P)):
        for b in range(len(P)):
            wide_d[a, b] = Pd[a, b] / w
            P[a, b] = wide_d[a, b] + Pi[a, b]
    for a in range(len(R)):
        for b in range(len(R)):
            wide_R[a, b] = Rd[a, b] / (1 - w) if w < 1 else 0.0
            R[a, b] = wide_R[a, b] + Ri[a, b]
    used = absorb_row(x, P, y, H, R, gate, S, B, A)
    if used:
        fill_product(H, P, K)
        solve(R, K)
        fill_sum(1.0, wide_R, 0.0 if keep else 1.0, Ri, R)
        joseph(wide_d, H, K, R, A, Pd)
        fill_sum(0.0, wide_R, 1.0 if keep else 0.0, Ri, R)
        joseph(Pi, H, K, R, A, Pi)
    return used


@strict_kernel
def update_split(x, Pd, Pi, reading, own, gate, keep, used):
    """Update as `EkfSplitCi._update`, in place: x (r, d), Pd and Pi (r, d, d); write which rows `used` their reading.

    `reading` is y (r, k), H (r, k, d), and of its noise Rd and Ri (r, k, k); absent where anything is nan. An `own`
    reading has the weight 1.
    """
    y, H, Rd, Ri = reading
    for r in range(len(x)):
        used[r] = False
        if is_known(y[r], H[r], Rd[r]) and is_known(y[r], H[r], Ri[r]):
            w, helps = (1.0, True) if own else least_trace(Pd[r], Pi[r], H[r], Rd[r], Ri[r])
            if helps:
                used[r] = split_row(x[r], Pd[r], Pi[r], y[r], H[r], Rd[r], Ri[r], w, gate, keep)


@strict_kernel
def fuse_split(x, Pd, Pi, robot, packets, z, model, by_sender, how, known):
    """Update as `EkfSplitCi.fuse`, in place, by readings z (r, n, k) of senders, one after the other.

    Or by those that the senders made of the `robot` (r,), in their packets (r, n, m) behind x, Pd and Pi. `known`
    (r, n), written: senders whose independent part a robot has used; where it is `spent` once used, it is dependent.
    """
    (kind, A, slope, R), (gate, keep, spent) = model, how
    d, n, k = x.shape[1], z.shape[1], z.shape[2]
    x_j, Pd_j, Pi_j, size = np.empty(d), np.empty((d, d)), np.empty((d, d)), d * (d + 1) // 2
    y, H, H_j, Rd, Ri = np.empty(k), np.empty((k, d)), np.empty((k, d)), np.empty((k, k)), np.empty((k, k))
    for r in range(len(x)):
        for j in range(n):
            at = d + 2 * size + k * robot[r]
            reading = packets[r, j, at : at + k] if by_sender else z[r, j]
            if np.isnan(reading[0]):
                continue
            read_belief(packets[r, j], d, x_j, Pd_j)
            read_belief(packets[r, j], d + size, x_j, Pi_j)
            if spent and known[r, j]:
                fill_sum(1.0, Pd_j, 1.0, Pi_j, Pd_j)
                fill_sum(0.0, Pd_j, 0.0, Pd_j, Pi_j)
            linearise_between((kind, A, slope), x[r], x_j, reading, by_sender, y, H, H_j)
            fill_form(H_j, Pd_j, Rd)
            fill_form(H_j, Pi_j, Ri)
            fill_sum(1.0, Ri, 1.0, R, Ri)
            if is_known(y, H, Rd) and is_known(y, H, Ri):
                w, helps = least_trace(Pd[r], Pi[r], H, Rd, Ri)
                if helps and split_row(x[r], Pd[r], Pi[r], y, H, Rd, Ri, w, gate, keep):
                    known[r, j] = True


@strict_kernel
def sight_split(x, Pd, Pi, seen, keep):
    """Update as `EkfSplitCi.correct`, in place by sightings: x (r, d), Pd and Pi (r, d, d); `keep` is true.

    It is a parameter, because numba would compile `split_row` once more for a constant.
    """
    places, z, R, gate = seen
    k, d = 2, x.shape[1]
    y, H, nothing = np.empty(k), np.empty((k, d)), np.zeros((k, k))
    for r in range(len(x)):
        for m in range(len(places)):
            if is_seen(z, r, m):
                linearise_sighting(x[r], places[m], z[r, m], y, H)
                if is_known(y, H, R):
                    split_row(x[r], Pd[r], Pi[r], y, H, nothing, R, 1.0, gate, keep)
