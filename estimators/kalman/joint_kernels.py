"""Compiled loops of `blocks.py`: readings absorbed one by one, sums over pairs, outer products, trial by trial."""

import numba
import numpy as np

from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.models.sensors import NEAR, TOO_NEAR_TO_RANGE


def _whitened(C: Array, B: Array) -> None:
    """Turn S (k, k) into its Cholesky factor C, and B (k, m) into C^-1 B, in place."""
    for c in range(len(C)):
        for b in range(c + 1):
            for a in range(b):
                C[c, b] -= C[c, a] * C[b, a]
            if b < c:
                C[c, b] /= C[b, b]
        C[c, c] = np.sqrt(C[c, c])
        for m in range(B.shape[1]):
            for a in range(c):
                B[c, m] -= C[c, a] * B[a, m]
            B[c, m] /= C[c, c]


def _both(H_i: Array, H_j: Array, s: int, i: int, j: int, out: Array) -> None:
    """(H_i, H_j) of one reading, element by element: in compiled code a slice costs more than the numbers in it."""
    d = H_i.shape[4]
    for c in range(H_i.shape[3]):
        for a in range(d):
            out[c, a], out[c, d + a] = H_i[s, i, j, c, a], H_j[s, i, j, c, a]


def _widened(P: Array, Q: Array, out: Array) -> None:
    """(P + P')/2 with Q_i added to P_ii."""
    t, n, d, _ = Q.shape
    for s in range(t):
        out[s] = P[s] + 0.0
        for i in range(n):
            for a in range(d):
                for b in range(d):
                    out[s, i * d + a, i * d + b] += Q[s, i, a, b]
        for a in range(n * d):
            for b in range(a):
                out[s, a, b] = out[s, b, a] = (out[s, a, b] + out[s, b, a]) / 2


def _distances(P: Array, y: Array, H_i: Array, H_j: Array, R: Array, out: Array) -> None:
    """S = H_i P_ii H_i' + H_i P_ij H_j' + H_j P_ji H_i' + H_j P_jj H_j' + R, then y' S^-1 y."""
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


def _information(use: Mask, y: Array, H_i: Array, H_j: Array, R: Array, eta: Array, Lambda: Array) -> None:
    """With R = C C', add the outer products of C^-1 (H_i, H_j, y) to the blocks of i and j."""
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


def _absorbed(x: Array, P: Array, PH: Array, y: float, S: float, gate: float) -> None:
    """x += P H' S^-1 y,  P -= P H' S^-1 H P  for a scalar reading, where the gate lets it in; P's lower triangle."""
    if y * y <= gate * S:
        PH /= np.sqrt(S)
        step = y / np.sqrt(S)
        for a in range(len(x)):
            gain = PH[a]
            x[a] += gain * step
            for b in range(a + 1):
                P[a, b] -= gain * PH[b]


def _entry(P: Array, a: int, b: int) -> float:
    """Of a symmetric matrix given by its lower triangle, which is half as much to write as the whole."""
    return float(P[a, b] if b <= a else P[b, a])


def _mirrored(P: Array) -> None:
    """Copy the lower triangle to the upper one."""
    for a in range(len(P)):
        for b in range(a):
            P[b, a] = P[a, b]


def _ranges(x: Array, P: Array, z: Array, variance: float, gate: float) -> None:
    """Of each range in turn y = z - |x_i - x_j|,  H_i = (x_i - x_j)' / |x_i - x_j| = -H_j."""
    t, n, d = x.shape
    PH = np.empty(n * d)
    for s in range(t):
        at, C = x[s].reshape(-1), P[s]
        for j in range(0, n * d, d):
            for i in range(0, n * d, d):
                reading = z[s, i // d, j // d]
                if i != j and reading >= TOO_NEAR_TO_RANGE:
                    away = np.sqrt((at[i] - at[j]) ** 2 + (at[i + 1] - at[j + 1]) ** 2)
                    u, v = (at[i] - at[j]) / max(away, NEAR), (at[i + 1] - at[j + 1]) / max(away, NEAR)
                    for a in range(n * d):
                        PH[a] = u * (entry(C, i, a) - entry(C, j, a)) + v * (entry(C, i + 1, a) - entry(C, j + 1, a))
                    S = variance + u * (PH[i] - PH[j]) + v * (PH[i + 1] - PH[j + 1])
                    absorb(at, C, PH, reading - away, S, gate)
        mirror(C)


def _directions(x: Array, P: Array, z: Array, nodes: Array, W: Array, c: float, variance: float, gate: float) -> None:
    """Of each direction in turn y = z - angle of g,  H = (g_x dg_y - g_y dg_x) / |g|^2,  g = W' (-c ln |x_i - q|^2)."""
    t, n, d = x.shape
    PH, g, dg = np.empty(n * d), np.empty(2), np.empty((2, 2))  # dg: axis 1 is the position
    for s in range(t):
        at, C = x[s].reshape(-1), P[s]
        for i in range(0, n * d, d):
            if np.isnan(z[s, i // d]):
                continue
            g[:], dg[:] = 0.0, 0.0
            for q in range(len(nodes)):
                d2 = (at[i] - nodes[q, 0]) ** 2 + (at[i + 1] - nodes[q, 1]) ** 2
                level, fall = c * np.log(max(d2, NEAR**2)), 2 * c / d2 if d2 > NEAR**2 else 0.0
                for k in range(2):
                    g[k] -= W[q, k] * level
                    for m in range(2):
                        dg[k, m] -= W[q, k] * fall * (at[i + m] - nodes[q, m])
            strength = max(g[0] ** 2 + g[1] ** 2, NEAR**2)
            u = (g[0] * dg[1, 0] - g[1] * dg[0, 0]) / strength
            v = (g[0] * dg[1, 1] - g[1] * dg[0, 1]) / strength
            for a in range(n * d):
                PH[a] = u * entry(C, i, a) + v * entry(C, i + 1, a)
            y = np.pi - (np.pi - (z[s, i // d] - np.arctan2(g[1], g[0]))) % (2 * np.pi)
            absorb(at, C, PH, y, variance + u * PH[i] + v * PH[i + 1], gate)
        mirror(C)


def _scalars(x: Array, P: Array, use: Mask, y: Array, H: Array, variance: float) -> None:
    """y - H (x^ - x) where x^ has moved by the readings before; nothing else tells them from readings at once."""
    t, n, d = x.shape
    PH, before = np.empty(n * d), np.empty((n, d))
    for s in range(t):
        before[:] = x[s]
        for i in range(n):
            if use[s, i]:
                PH[:], S, e = 0.0, variance, y[s, i]
                for m in range(d):
                    e -= H[s, i, m] * (x[s, i, m] - before[i, m])
                    for a in range(n * d):
                        PH[a] += H[s, i, m] * entry(P[s], i * d + m, a)
                for m in range(d):
                    S += H[s, i, m] * PH[i * d + m]
                absorb(x[s].reshape(-1), P[s], PH, e, S, np.inf)
        mirror(P[s])


def _range_terms(at: Array, i: int, j: int) -> tuple[float, float, float]:
    """|x_i - x_j| and its derivative by x_i."""
    away = np.sqrt((at[i] - at[j]) ** 2 + (at[i + 1] - at[j + 1]) ** 2)
    return away, (at[i] - at[j]) / max(away, NEAR), (at[i + 1] - at[j + 1]) / max(away, NEAR)


def _gated(
    x: Array, C: Array, z: Array, variance: float, second_order: bool, d2: Array, shift: Array, noise: Array
) -> None:
    """d2 of every range, and what the second order adds to its mean (shift) and to its variance (noise)."""
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
                shift[p, q], noise[p, q] = 0.0, variance
                if second_order:
                    far = max(away, TOO_NEAR_TO_RANGE)
                    a, b = (x[j + 1] - x[i + 1]) / far, (x[i] - x[j]) / far
                    across = (a * a * xx + 2 * a * b * xy + b * b * yy) / far
                    shift[p, q], noise[p, q] = across / 2, variance + across**2 / 2
                y = z[p, q] - away - shift[p, q]
                d2[p, q] = y * y / (noise[p, q] + u * u * xx + 2 * u * v * xy + v * v * yy)


def _joined_ranges(
    x: Array, P: Array, z: Array, variance: float, gate: float, second_order: bool, iterations: int, d2: Array
) -> None:
    """x' = x + (P^-1 + H'R^-1 H)^-1 H'R^-1 (y + H (x^ - x)),  P' = (P^-1 + H'R^-1 H)^-1."""
    t, n, d = x.shape
    shift, noise, one = np.empty((n, n)), np.empty((n, n)), np.eye(n * d)
    for s in range(t):
        before, at = x[s].copy().reshape(-1), x[s].copy().reshape(-1)
        gate_ranges(before, P[s], z[s], variance, second_order, d2[s], shift, noise)
        for k in range(iterations):
            eta, Lambda = np.zeros(n * d), np.zeros((n * d, n * d))
            for p in range(n):
                for q in range(n):
                    if d2[s, p, q] <= gate:
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
            if k + 1 < iterations:
                at = before + np.linalg.solve(A, P[s] @ eta)
            else:
                C = np.linalg.solve(A, P[s])
                P[s] = (C + C.T) / 2
                x[s] = (before + P[s] @ eta).reshape(n, d)


def _definite(P: Array, out: Mask) -> None:
    """The last pivot of a Cholesky factor is above 0 if all are, and nan if one before it was not."""
    d = P.shape[1]
    C, nothing = np.empty((d, d)), np.empty((d, 0))
    for s in range(len(P)):
        C[:] = P[s]
        whiten(C, nothing)
        out[s] = C[d - 1, d - 1] > 0


def _rows_gathered(Gamma: Array, Pi: Array, first: int, W: Array) -> None:
    """Gamma (t, o, k, m) += W (t, k, d) times the d rows of Pi (t, o, m, m) from the first on."""
    t, o, k, m = Gamma.shape
    for s in range(t):
        for i in range(o):
            for q in range(k):
                total = Gamma[s, i, q]
                for a in range(W.shape[2]):
                    row, w = Pi[s, i, first + a], W[s, q, a]
                    for b in range(m):
                        total[b] += w * row[b]


def _outer_subtracted(Pi: Array, Gamma: Array, takes: Mask) -> None:
    """Pi (t, o, m, m) -= Gamma' Gamma, where `takes` (t, o), row by row: the copy of a large team fills a cache."""
    t, o, k, m = Gamma.shape
    for s in range(t):
        for i in range(o):
            if takes[s, i]:
                for a in range(m):
                    row = Pi[s, i, a]
                    for q in range(k):
                        other, g = Gamma[s, i, q], Gamma[s, i, q, a]
                        for b in range(m):
                            row[b] -= g * other[b]


_compiled = numba.njit(cache=True, error_model="numpy")
whiten = _compiled(_whitened)
beside = _compiled(_both)
fill_widened = _compiled(_widened)
fill_distances = _compiled(_distances)
add_information = _compiled(_information)
absorb = _compiled(_absorbed)
entry = _compiled(_entry)
mirror = _compiled(_mirrored)
add_scalars = _compiled(_scalars)
range_of = _compiled(_range_terms)
gate_ranges = _compiled(_gated)
join_ranges = _compiled(_joined_ranges)
add_ranges = _compiled(_ranges)
add_directions = _compiled(_directions)
fill_definite = _compiled(_definite)
gather_rows = _compiled(_rows_gathered)
subtract_outer = _compiled(_outer_subtracted)
