"""Compiled sums over all of a tick's readings between robots, in information form, trial by trial."""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.compiled.jit import strict_kernel
from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.kalman.matrix_kernels import whiten
from cooploc.estimators.models.sensors import NEAR, TOO_NEAR_TO_RANGE


class Readings(NamedTuple):
    """Linearised readings of robot j by robot i; of fixed things m is 1 instead of n, and H_j is 0."""

    y: Array  # (t, n, m, k)  nan where absent
    H_i: Array  # (t, n, m, k, d)
    H_j: Array  # (t, n, m, k, d)
    R: Array  # (t, n, m, k, k)


class Ranging(NamedTuple):
    """How ranges are used together."""

    variance: float  # [m^2]
    gate: float  # squared Mahalanobis distance beyond which a range is refused
    second_order: bool
    iterations: int


class Gated(NamedTuple):
    """Of each range (n, n) the gate's distance, and what the second order adds to its mean and to its variance."""

    d2: Array
    shift: Array  # [m]
    noise: Array  # [m^2]  with the range's own variance


@strict_kernel
def beside(H_i: Array, H_j: Array, s: int, i: int, j: int, out: Array) -> None:
    """(H_i, H_j) of one reading, element by element: in compiled code a slice costs more than the numbers in it."""
    d = H_i.shape[4]
    for c in range(H_i.shape[3]):
        for a in range(d):
            out[c, a], out[c, d + a] = H_i[s, i, j, c, a], H_j[s, i, j, c, a]


@strict_kernel
def fill_distances(P: Array, readings: Readings, out: Array) -> None:
    """S = H_i P_ii H_i' + H_i P_ij H_j' + H_j P_ji H_i' + H_j P_jj H_j' + R, then y' S^-1 y."""
    y, H_i, H_j, R = readings  # once: in a loop, each look into a tuple of arrays counts a reference
    t, n, others, k, d = H_i.shape
    H, PH, S, e = np.empty((k, 2 * d)), np.empty((2 * d, k)), np.empty((k, k)), np.empty((k, 1))
    for s in range(t):
        for i in range(n):
            for j in range(others):
                if np.isnan(y[s, i, j, 0]):
                    continue
                beside(H_i, H_j, s, i, j, H)
                for a in range(2 * d):
                    row = i * d + a if a < d else (j - 1) * d + a
                    for c in range(k):
                        PH[a, c] = 0.0
                        for m in range(d):
                            PH[a, c] += P[s, row, i * d + m] * H[c, m] + P[s, row, j * d + m] * H[c, d + m]
                for c in range(k):
                    e[c, 0] = y[s, i, j, c]
                    for b in range(k):
                        S[c, b] = R[s, i, j, c, b]
                        for a in range(2 * d):
                            S[c, b] += H[c, a] * PH[a, b]
                whiten(S, e)
                out[s, i, j] = 0.0
                for c in range(k):
                    out[s, i, j] += e[c, 0] ** 2


@strict_kernel
def add_information(use: Mask, readings: Readings, eta: Array, Lambda: Array) -> None:
    """With R = C C', add the outer products of C^-1 (H_i, H_j, y) to the blocks of i and j."""
    y, H_i, H_j, R = readings
    t, n, others, k, d = H_i.shape
    B, C, at = np.empty((k, 2 * d + 1)), np.empty((k, k)), np.empty(2 * d, np.int64)
    for s in range(t):
        for i in range(n):
            for j in range(others):
                if use[s, i, j]:
                    beside(H_i, H_j, s, i, j, B)
                    for c in range(k):
                        B[c, 2 * d] = y[s, i, j, c]
                        for b in range(k):
                            C[c, b] = R[s, i, j, c, b]
                    whiten(C, B)
                    for a in range(d):
                        at[a], at[d + a] = i * d + a, j * d + a
                    for c in range(k):
                        for a in range(2 * d):
                            eta[s, at[a]] += B[c, a] * B[c, 2 * d]
                            for m in range(2 * d):
                                Lambda[s, at[a], at[m]] += B[c, a] * B[c, m]


@strict_kernel
def range_of(at: Array, i: int, j: int) -> tuple[float, float, float]:
    """|x_i - x_j| and its derivative by x_i."""
    away = np.sqrt((at[i] - at[j]) ** 2 + (at[i + 1] - at[j + 1]) ** 2)
    return away, (at[i] - at[j]) / max(away, NEAR), (at[i + 1] - at[j + 1]) / max(away, NEAR)


@strict_kernel
def gate_ranges(x: Array, C: Array, z: Array, how: Ranging, out: Gated) -> None:
    """The squared Mahalanobis distance of every range, and the terms of its second order."""
    d2, shift, noise = out
    n = len(z)
    d = len(x) // n
    for p in range(n):
        for q in range(n):
            if p != q and z[p, q] >= TOO_NEAR_TO_RANGE:
                i, j = p * d, q * d
                away, u, v = range_of(x, i, j)
                xx = C[i, i] + C[j, j] - 2 * C[i, j]
                xy = C[i, i + 1] + C[j, j + 1] - C[i, j + 1] - C[j, i + 1]
                yy = C[i + 1, i + 1] + C[j + 1, j + 1] - 2 * C[i + 1, j + 1]
                shift[p, q], noise[p, q] = 0.0, how.variance
                if how.second_order:
                    far = max(away, TOO_NEAR_TO_RANGE)
                    a, b = (x[j + 1] - x[i + 1]) / far, (x[i] - x[j]) / far
                    across = (a * a * xx + 2 * a * b * xy + b * b * yy) / far
                    shift[p, q], noise[p, q] = across / 2, how.variance + across**2 / 2
                y = z[p, q] - away - shift[p, q]
                d2[p, q] = y * y / (noise[p, q] + u * u * xx + 2 * u * v * xy + v * v * yy)


@strict_kernel
def join_ranges(x: Array, P: Array, z: Array, how: Ranging, d2: Array) -> None:
    """x' = x + (P^-1 + H'R^-1 H)^-1 H'R^-1 (y + H (x^ - x)),  P' = (P^-1 + H'R^-1 H)^-1."""
    t, n, d = x.shape
    shift, noise, one = np.empty((n, n)), np.empty((n, n)), np.eye(n * d)
    for s in range(t):
        before, at = x[s].copy().reshape(-1), x[s].copy().reshape(-1)
        gate_ranges(before, P[s], z[s], how, Gated(d2[s], shift, noise))
        for k in range(how.iterations):
            eta, Lambda = np.zeros(n * d), np.zeros((n * d, n * d))
            for p in range(n):
                for q in range(n):
                    if d2[s, p, q] <= how.gate:
                        i, j = p * d, q * d
                        away, u, v = range_of(at, i, j)
                        y = z[s, p, q] - away - shift[p, q] + u * (at[i] - before[i] - at[j] + before[j])
                        y += v * (at[i + 1] - before[i + 1] - at[j + 1] + before[j + 1])
                        for c, h in ((0, u), (1, v)):
                            g = h / noise[p, q]
                            eta[i + c] += g * y
                            eta[j + c] -= g * y
                            for b, f in ((0, u), (1, v)):
                                Lambda[i + c, i + b] += g * f
                                Lambda[j + c, j + b] += g * f
                                Lambda[i + c, j + b] -= g * f
                                Lambda[j + c, i + b] -= g * f
            A = one + P[s] @ Lambda
            if k + 1 < how.iterations:
                at = before + np.linalg.solve(A, P[s] @ eta)
            else:
                C = np.linalg.solve(A, P[s])
                P[s] = (C + C.T) / 2
                x[s] = (before + P[s] @ eta).reshape(n, d)


@strict_kernel
def tally(d2, gate, between, forget, share):
    """Move each robot's average `share` (t, n) of refused readings by this tick's, d2 (t, n, m), nan where absent.

    `between` robots, a reading of j by i counts for both.
    """
    t, n, m = d2.shape
    for s in range(t):
        for i in range(n):
            count, refused = 0, 0
            for j in range(m):
                count += not np.isnan(d2[s, i, j])
                refused += d2[s, i, j] > gate
                if between:
                    count += not np.isnan(d2[s, j, i])
                    refused += d2[s, j, i] > gate
            if count:
                share[s, i] += forget * (refused / count - share[s, i])
