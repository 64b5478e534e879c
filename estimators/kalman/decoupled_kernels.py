"""The compiled update of `ekf_interim.py`: one reading's change in the memory of every robot."""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.compiled.jit import strict_kernel
from cooploc.estimators.interface import Array
from cooploc.estimators.kalman.matrix_kernels import fill_product, fill_square, fill_sum, solve, whiten

RUNAWAY = 1e6  # a larger factor Gamma cannot come from covariances in metres; refusing it keeps stale copies finite


class Decoupled(NamedTuple):
    """A team's beliefs with P_ij = Phi_i Pi_ij Phi_j'."""

    x: Array  # (t, n, d)
    P: Array  # (t, n, d, d)
    Phi: Array  # (t, n, d, d)
    Pi: Array  # (t, n, n, d, n, d)  axis 1 is the robot that keeps this copy


class TeamReading(NamedTuple):
    """A linearised reading of some robots."""

    y: Array  # (t, k)  nan where absent
    H: Array  # (t, m, k, d)  by each of the m robots
    R: Array  # (k, k)


@strict_kernel
def _covariance(P, Phi, Pi, at, H, A, cross):
    """Cov(x_m, reading) = sum_j P_mj H_j' (m, d, k) of the robots `at`, by the master's copy Pi (n, d, n, d).

    Scratch: A (2, d, d).
    """
    d, k = P.shape[1], H.shape[1]
    for m in range(len(at)):
        fill_product(P[at[m]], H[m].T, cross[m])
        for j in range(len(at)):
            if j != m:
                fill_product(Phi[at[m]], Pi[at[m], :, at[j]], A[0])
                fill_product(A[0], Phi[at[j]].T, A[1])
                for a in range(d):
                    for q in range(k):
                        for c in range(d):
                            cross[m, a, q] += A[1, a, c] * H[j, q, c]


@strict_kernel
def _whitened(Phi, at, y, H, R, cross, S, A, B):
    """C^-1 y, C^-1 H_m Phi_m and C^-1 (Phi_m^-1 cross_m)' into B (k, 1 + 2 m d), S = C C'; whether S is definite."""
    k, d, rest = len(y), Phi.shape[1], 1 + len(at) * Phi.shape[1]
    fill_sum(1.0, R, 0.0, R, S)
    for m in range(len(at)):
        for q in range(k):
            for p in range(k):
                for c in range(d):
                    S[q, p] += H[m, q, c] * cross[m, c, p]
        fill_product(H[m], Phi[at[m]], B[:, 1 + m * d : 1 + (m + 1) * d])
        fill_sum(1.0, Phi[at[m]], 0.0, Phi[at[m]], A[0])
        solve(A[0], cross[m])
        for q in range(k):
            for c in range(d):
                B[q, rest + m * d + c] = cross[m, c, q]
    for q in range(k):
        B[q, 0] = y[q]
        for p in range(q):
            S[q, p] = S[p, q] = (S[q, p] + S[p, q]) / 2
    whiten(S, B)
    return S[k - 1, k - 1] > 0


@strict_kernel
def _gathered(Pi, at, B, Gamma):
    """Gamma (k, n d), transposed, of a robot with the copy Pi (n d, n d); says whether it has run away."""
    k, d, size = len(B), (B.shape[1] - 1) // (2 * len(at)), Pi.shape[1]
    for m in range(len(at)):
        for q in range(k):
            for c in range(d):
                w, row, first = B[q, 1 + m * d + c], Pi[at[m] * d + c], m == 0 and c == 0
                for b in range(size):
                    Gamma[q, b] = w * row[b] + (0.0 if first else Gamma[q, b])
    for m in range(len(at)):  # as the master broadcast them
        for q in range(k):
            for c in range(d):
                Gamma[q, at[m] * d + c] = B[q, 1 + (len(at) + m) * d + c]
    for b in range(size):
        total = 0.0
        for q in range(k):
            total += Gamma[q, b] ** 2
        if not total < RUNAWAY**2:
            return True
    return False


@strict_kernel
def _shrunk(P, mine, A, nothing, out):
    """P - mine mine' into out; whether it is positive definite."""
    fill_square(mine, A)
    for a in range(len(P)):
        for b in range(len(P)):
            out[a, b] = A[a, b] = P[a, b] - A[a, b]
    whiten(A, nothing)
    return A[len(P) - 1, len(P) - 1] > 0


@strict_kernel
def _subtract(Pi, Gamma):
    """Pi (n d, n d) -= Gamma' Gamma, row by row: the copy of a large team fills a cache."""
    for b in range(len(Pi)):
        row = Pi[b]
        for q in range(len(Gamma)):
            g, other = Gamma[q, b], Gamma[q]
            for c in range(len(Pi)):
                row[c] -= g * other[c]


@strict_kernel
def master(team, a, at, reading, heard, gate):
    """Robot a's update by a reading of the robots `at`, in its memory and in that of those who `heard` it (t, n).

    In place; says which trials used it (t,). With S = C C',

        Gamma_m = Phi_m^-1 Cov(x_m, reading) C'^-1,  dx_i = Phi_i Gamma_i C^-1 y,  dP_i = Phi_i Gamma_i Gamma_i' Phi_i',
        dPi_jl = Gamma_j Gamma_l'.
    """
    (x, P, Phi, Pi), (y, H, R) = team, reading
    (t, n, d), k, nothing = x.shape, y.shape[1], np.empty((x.shape[2], 0))
    used, sound, new = np.zeros(t, np.bool_), np.empty(n, np.bool_), np.empty((n, d, d))
    Gamma, mine = np.empty((n, k, n * d)), np.empty((n, d, k))
    A, S, cross = np.empty((2, d, d)), np.empty((k, k)), np.empty((len(at), d, k))
    B = np.empty((k, 1 + 2 * len(at) * d))
    for s in range(t):
        _covariance(P[s], Phi[s], Pi[s, a], at, H[s], A, cross)
        definite, far = _whitened(Phi[s], at, y[s], H[s], R, cross, S, A, B), 0.0
        for q in range(k):
            far += B[q, 0] ** 2
        if not (definite and far <= gate):  # nor where anything is absent: nan
            continue
        for i in range(n):
            runaway = _gathered(Pi[s, i].reshape(n * d, n * d), at, B, Gamma[i])
            fill_product(Phi[s, i], Gamma[i, :, i * d : i * d + d].T, mine[i])
            sound[i] = _shrunk(P[s, i], mine[i], A[0], nothing, new[i]) and not runaway
        used[s] = True
        for m in at:
            used[s] = used[s] and sound[m]
        for i in range(n):
            if used[s] and sound[i] and (heard[s, i] or i == a):
                fill_sum(1.0, new[i], 0.0, new[i], P[s, i])
                for c in range(d):
                    for q in range(k):
                        x[s, i, c] += mine[i, c, q] * B[q, 0]
                _subtract(Pi[s, i].reshape(n * d, n * d), Gamma[i])
    return used
