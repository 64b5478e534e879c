"""The compiled loops over a whole team: joint covariances, decoupled cross terms, factors."""

import numpy as np

from cooploc.estimators import kalman_kernels
from cooploc.estimators.compiled import strict_kernel
from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.kalman_kernels import (
    absorb_row,
    fill_product,
    fill_sum,
    is_known,
    is_seen,
    linearise_row,
    mirror_place,
    solve,
    whiten,
)
from cooploc.estimators.models import NEAR, TOO_NEAR_TO_RANGE

# Linearised readings of robot j by robot i; for fixed things m is 1 instead of n, and H_j is 0:
# y (t, n, m, k), nan where absent; H_i and H_j (t, n, m, k, d); R (t, n, m, k, k).
LinearReadings = tuple[Array, Array, Array, Array]


@strict_kernel
def two_block_row(H_i: Array, H_j: Array, s: int, i: int, j: int, out: Array) -> None:
    """Write (H_i, H_j) of one reading, element by element: a slice would cost more than the numbers in it."""
    d = H_i.shape[4]
    for c in range(H_i.shape[3]):
        for a in range(d):
            out[c, a], out[c, d + a] = H_i[s, i, j, c, a], H_j[s, i, j, c, a]


@strict_kernel
def distances(P: Array, readings: LinearReadings) -> Array:
    """Return y' S^-1 y (t, n, m), nan where absent; S = R + (H_i, H_j) (P_ii, P_ij; P_ji, P_jj) (H_i, H_j)'."""
    y, H_i, H_j, R = readings  # once: in a loop, each look into a tuple of arrays counts a reference
    t, n, others, k, d = H_i.shape
    H, PH, S, e = np.empty((k, 2 * d)), np.empty((2 * d, k)), np.empty((k, k)), np.empty((k, 1))
    out = np.full((t, n, others), np.nan)
    for s in range(t):
        for i in range(n):
            for j in range(others):
                if np.isnan(y[s, i, j, 0]):
                    continue
                two_block_row(H_i, H_j, s, i, j, H)
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
    return out


@strict_kernel
def information(use: Mask, readings: LinearReadings) -> tuple[Array, Array]:
    """Return H'R^-1 y (t, n d) and H'R^-1 H (t, n d, n d) summed over the readings that `use` (t, n, m) allows.

    By outer products of C^-1 (H_i, H_j, y), R = C C', in the blocks of i and j.
    """
    y, H_i, H_j, R = readings
    t, n, others, k, d = H_i.shape
    B, C, at = np.empty((k, 2 * d + 1)), np.empty((k, k)), np.empty(2 * d, np.int64)
    eta, Lambda = np.zeros((t, n * d)), np.zeros((t, n * d, n * d))
    for s in range(t):
        for i in range(n):
            for j in range(others):
                if use[s, i, j]:
                    two_block_row(H_i, H_j, s, i, j, B)
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
    return eta, Lambda


@strict_kernel
def linearise_pairs(model, x, at, z):
    """Return y + H (x^ - x), H_i and H_j of each robot's readings z (t, n, n, k) of the others.

    Linearised `at` x^ (t, n, d), of robots at x; `model` is `kalman.sensor_model`.
    """
    (kind, A, slope, _), (t, n, _, k), d = model, z.shape, x.shape[2]
    y, H_i, H_j = np.full((t, n, n, k), np.nan), np.zeros((t, n, n, k, d)), np.zeros((t, n, n, k, d))
    for s in range(t):
        for i in range(n):
            for j in range(n):
                if np.isnan(z[s, i, j, 0]):
                    continue
                linearise_row(kind, A, slope, at[s, i], at[s, j], z[s, i, j], y[s, i, j], H_i[s, i, j])
                mirror_place(H_i[s, i, j], H_j[s, i, j])
                for c in range(k):
                    for a in range(d):
                        y[s, i, j, c] += H_i[s, i, j, c, a] * (at[s, i, a] - x[s, i, a])
                        y[s, i, j, c] += H_j[s, i, j, c, a] * (at[s, j, a] - x[s, j, a])
    return y, H_i, H_j


@strict_kernel
def range_of(at: Array, i: int, j: int) -> tuple[float, float, float]:
    """Return |x_i - x_j| and its derivative by x_i."""
    away = np.sqrt((at[i] - at[j]) ** 2 + (at[i + 1] - at[j + 1]) ** 2)
    return away, (at[i] - at[j]) / max(away, NEAR), (at[i + 1] - at[j + 1]) / max(away, NEAR)


@strict_kernel
def gate_ranges(x, P, z, variance, second_order):
    """Return squared Mahalanobis distances of ranges, mean shifts [m] and variances [m^2] by the second order.

    Of a team's x (t, n d), P (t, n d, n d) and ranges z; all (t, n, n), nan where a range is absent.
    """
    t, n, _ = z.shape
    d = x.shape[1] // n
    d2, shift, noise = np.full((t, n, n), np.nan), np.full((t, n, n), np.nan), np.full((t, n, n), np.nan)
    for s in range(t):
        at, C = x[s], P[s]
        for p in range(n):
            for q in range(n):
                if p != q and z[s, p, q] >= TOO_NEAR_TO_RANGE:
                    i, j = p * d, q * d
                    away, u, v = range_of(at, i, j)
                    xx = C[i, i] + C[j, j] - 2 * C[i, j]
                    xy = C[i, i + 1] + C[j, j + 1] - C[i, j + 1] - C[j, i + 1]
                    yy = C[i + 1, i + 1] + C[j + 1, j + 1] - 2 * C[i + 1, j + 1]
                    shift[s, p, q], noise[s, p, q] = 0.0, variance
                    if second_order:
                        far = max(away, TOO_NEAR_TO_RANGE)
                        a, b = (at[j + 1] - at[i + 1]) / far, (at[i] - at[j]) / far
                        across = (a * a * xx + 2 * a * b * xy + b * b * yy) / far
                        shift[s, p, q], noise[s, p, q] = across / 2, variance + across**2 / 2
                    y = z[s, p, q] - away - shift[s, p, q]
                    d2[s, p, q] = y * y / (noise[s, p, q] + u * u * xx + 2 * u * v * xy + v * v * yy)
    return d2, shift, noise


@strict_kernel
def range_information(x, at, z, use, shift, noise):
    """Return what `information` does, by ranges z (t, n, n) of x (t, n d), linearised `at` (t, n d)."""
    t, n, _ = z.shape
    d = x.shape[1] // n
    eta, Lambda = np.zeros((t, n * d)), np.zeros((t, n * d, n * d))
    for s in range(t):
        for p in range(n):
            for q in range(n):
                if use[s, p, q]:
                    i, j = p * d, q * d
                    away, u, v = range_of(at[s], i, j)
                    y = z[s, p, q] - away - shift[s, p, q] + u * (at[s, i] - x[s, i] - at[s, j] + x[s, j])
                    y += v * (at[s, i + 1] - x[s, i + 1] - at[s, j + 1] + x[s, j + 1])
                    for c, h in ((0, u), (1, v)):
                        g = h / noise[s, p, q]
                        eta[s, i + c] += g * y
                        eta[s, j + c] -= g * y
                        for b, f in ((0, u), (1, v)):
                            Lambda[s, i + c, i + b] += g * f
                            Lambda[s, j + c, j + b] += g * f
                            Lambda[s, i + c, j + b] -= g * f
                            Lambda[s, j + c, i + b] -= g * f
    return eta, Lambda


@strict_kernel
def count_refused(d2, gate, between, forget, share):
    """Move each robot's average `share` (t, n) of refused readings; `between` robots, a reading counts for both."""
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


RUNAWAY = 1e6  # a larger factor Gamma cannot come from covariances in metres; refusing it keeps stale copies finite


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
def _whiten(Phi, at, y, H, R, cross, S, A, B):
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
def _fill_gain(Pi, at, B, Gamma):
    """Write Gamma (k, n d), transposed, of a robot with the copy Pi (n d, n d); return whether it has run away."""
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
def _subtract(Pi, Gamma):
    """Pi (n d, n d) -= Gamma' Gamma, row by row: the copy of a large team fills a cache."""
    for b in range(len(Pi)):
        row = Pi[b]
        for q in range(len(Gamma)):
            g, other = Gamma[q, b], Gamma[q]
            for c in range(len(Pi)):
                row[c] -= g * other[c]


@strict_kernel
def _part(Pi, copy, before, takes):
    """Give robots that part from the others with their copy `before`, by whether each takes an update, a new one."""
    for i in range(len(copy)):
        if takes[i] != takes[before[i]]:
            copy[i] = 0
            while before[copy[i]] != before[i] or takes[copy[i]] != takes[i]:
                copy[i] += 1
            if copy[i] == i:
                new, old = Pi[i].reshape(-1), Pi[before[i]].reshape(-1)
                for c in range(len(new)):  # one by one: numba takes seconds to compile a copy of an array
                    new[c] = old[c]


@strict_kernel
def master(team, a, at, reading, heard, gate):
    """Update the memory of robot a and of those who `heard` it (t, n) by its reading of the m robots `at`.

    `team` has x (t, n, d), P and Phi (t, n, d, d), copies of Pi (t, n, n, d, n, d), and which of these each robot has
    (t, n); `reading` has y (t, k), nan where absent, H (t, m, k, d) and R (k, k). Return which trials used it (t,).
    With S = C C',

        Gamma_m = Phi_m^-1 Cov(x_m, reading) C'^-1,  dx_i = Phi_i Gamma_i C^-1 y,  dP_i = Phi_i Gamma_i Gamma_i' Phi_i',
        dPi_jl = Gamma_j Gamma_l'.
    """
    (x, P, Phi, Pi, copy), (y, H, R) = team, reading
    (t, n, d), k, nothing = x.shape, y.shape[1], np.empty((x.shape[2], 0))
    used, sound, new = np.zeros(t, np.bool_), np.empty(n, np.bool_), np.empty((n, d, d))
    runaway, takes, before = np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty(n, np.int64)
    Gamma, mine = np.empty((n, k, n * d)), np.empty((n, d, k))
    A, S, cross = np.empty((2, d, d)), np.empty((k, k)), np.empty((len(at), d, k))
    B = np.empty((k, 1 + 2 * len(at) * d))
    for s in range(t):
        _covariance(P[s], Phi[s], Pi[s, copy[s, a]], at, H[s], A, cross)
        definite, far = _whiten(Phi[s], at, y[s], H[s], R, cross, S, A, B), 0.0
        for q in range(k):
            far += B[q, 0] ** 2
        if not (definite and far <= gate):  # nor where anything is absent: nan
            continue
        for i in range(n):
            before[i] = copy[s, i]
            if before[i] == i:
                runaway[i] = _fill_gain(Pi[s, i].reshape(n * d, n * d), at, B, Gamma[i])
        for i in range(n):
            fill_product(Phi[s, i], Gamma[before[i], :, i * d : i * d + d].T, mine[i])
            fill_product(mine[i], mine[i].T, A[0])
            fill_sum(1.0, P[s, i], -1.0, A[0], new[i])
            fill_sum(1.0, new[i], 0.0, new[i], A[0])
            whiten(A[0], nothing)
            sound[i] = A[0, d - 1, d - 1] > 0 and not runaway[before[i]]  # P less mine mine' is definite
        used[s] = True
        for m in at:
            used[s] = used[s] and sound[m]
        for i in range(n):
            takes[i] = used[s] and sound[i] and (heard[s, i] or i == a)
            if takes[i]:
                fill_sum(1.0, new[i], 0.0, new[i], P[s, i])
                for c in range(d):
                    for q in range(k):
                        x[s, i, c] += mine[i, c, q] * B[q, 0]
        _part(Pi[s], copy[s], before, takes)
        for i in range(n):
            if takes[i] and copy[s, i] == i:
                _subtract(Pi[s, i].reshape(n * d, n * d), Gamma[before[i]])
    return used


LIMIT = 1 - 1e-9  # largest correlation of any two combinations of two robots' states


@strict_kernel
def limit_correlation(A: Array, B: Array, C: Array) -> Array:
    """Return the cross term C (d, d) of covariances A and B, its canonical correlations cut to `LIMIT`.

    They are the singular values of M = B^-1/2 C' A^-1/2', needed only where LIMIT^2 I - M' M is not definite.
    """
    d = len(C)
    half_A, half_B, M, rest = np.empty((d, d)), np.empty((d, d)), np.empty((d, d)), np.empty((d, d))
    for a in range(d):
        for b in range(d):
            half_A[a, b], half_B[a, b], rest[a, b] = A[a, b], B[a, b], C[a, b]
    whiten(half_A, rest)
    for a in range(d):
        for b in range(d):
            M[a, b] = rest[b, a]
    whiten(half_B, M)
    for a in range(d):
        for b in range(d):
            rest[a, b] = LIMIT**2 if a == b else 0.0
            for c in range(d):
                rest[a, b] -= M[c, a] * M[c, b]
    whiten(rest, np.empty((d, 0)))
    if rest[d - 1, d - 1] > 0:  # nan if an earlier pivot was not
        return C
    u, correlation, v = np.linalg.svd(M)
    for a in range(d):
        for b in range(d):
            u[a, b] *= min(correlation[b], LIMIT)
            if b > a:
                half_A[a, b] = half_B[a, b] = 0.0
    fill_product(half_B, u, M)
    fill_product(M, v, rest)
    fill_product(half_A, rest.T, M)
    return M


@strict_kernel
def carry(P, P1, sigma, A, B):
    """sigma_k = P' P^-1 sigma_k for the cross terms (n, d, d) with all others; A and B (d, d) are scratch."""
    fill_sum(1.0, P, 0.0, P, A)
    fill_sum(1.0, P1, 0.0, P1, B)
    solve(A, B)
    for k in range(len(sigma)):
        fill_product(B.T, sigma[k], A)
        fill_sum(1.0, A, 0.0, A, sigma[k])


@strict_kernel
def meet(x, P, sigma, i, j, reading, gate):
    """Update robots i and j together in place; return which trials used the reading (t,).

    x (t, n, d), P (t, n, d, d), sigma (t, n, n, d, d) with P_ij = sigma_ij sigma_ji'; reading y (t, k), H (t, k, 2 d),
    R (k, k).
    """
    (y, H, R), (t, _, d), k = reading, x.shape, reading[0].shape[1]
    used, both, J, J1 = np.zeros(t, np.bool_), np.empty(2 * d), np.empty((2 * d, 2 * d)), np.empty((2, d, d))
    S, B, A, cross = np.empty((k, k)), np.empty((k, 2 * d + 1)), np.empty((2 * d, 2 * d)), np.empty((2, d, d))
    for s in range(t):
        if not is_known(y[s], H[s], R):
            continue
        fill_product(sigma[s, i, j], sigma[s, j, i].T, cross[0])
        limited = limit_correlation(P[s, i], P[s, j], cross[0])
        for a in range(d):
            both[a], both[d + a] = x[s, i, a], x[s, j, a]
            for b in range(d):
                J[a, b], J[d + a, d + b] = P[s, i, a, b], P[s, j, a, b]
                J[a, d + b] = J[d + b, a] = limited[a, b]
        used[s] = absorb_row(both, J, y[s], H[s], R, gate, S, B, A)
        if not used[s]:
            continue
        for a in range(d):
            x[s, i, a], x[s, j, a] = both[a], both[d + a]
            for b in range(d):
                J1[0, a, b], J1[1, a, b] = J[a, b], J[d + a, d + b]
        carry(P[s, i], J1[0], sigma[s, i], cross[0], cross[1])
        carry(P[s, j], J1[1], sigma[s, j], cross[0], cross[1])
        for a in range(d):
            for b in range(d):
                P[s, i, a, b], P[s, j, a, b] = J1[0, a, b], J1[1, a, b]
                sigma[s, i, j, a, b], sigma[s, j, i, a, b] = J[a, d + b], 1.0 if a == b else 0.0
    return used


@strict_kernel
def sight_joint(x, P, refused, seen, forget):
    """Update as `EkfJoint._update_by_fixed`, in place: x (t, n, d), P (t, n d, n d), share of `refused` (t, n)."""
    places, z, R, gate = seen
    t, n, d = x.shape
    k, variances = 2, np.array([R[0, 0], R[1, 1]])
    y, H, nothing = np.empty((t, n, k)), np.empty((t, n, k, d)), np.zeros((t, n, 1, k, d))
    noise, use = np.empty((t, n, 1, k, k)), np.empty((t, n), np.bool_)
    for s in range(t):
        for i in range(n):
            fill_sum(1.0, R, 0.0, R, noise[s, i, 0])
    for m in range(len(places)):
        some = False
        for r in range(t * n):
            some = some or is_seen(z, r, m)
        if not some:
            continue
        for s in range(t):
            for i in range(n):
                kalman_kernels.linearise_sighting(x[s, i], places[m], z[s * n + i, m], y[s, i], H[s, i])
        d2 = distances(P, (y.reshape(t, n, 1, k), H.reshape(t, n, 1, k, d), nothing, noise))
        for s in range(t):
            for i in range(n):
                use[s, i] = d2[s, i, 0] <= gate
        kalman_kernels.add_scalars(x, P, use, y, H, variances)
        count_refused(d2, gate, False, forget, refused)


@strict_kernel
def sight_decoupled(team, seen, heard, used):
    """Make the masters' updates of `EkfInterim.exchange` in place, and count each robot's in `used` (t, n)."""
    places, z, R, gate = seen
    x, k = team[0], 2
    t, n, d = x.shape
    y, H, hears, at = np.empty((t, k)), np.empty((t, 1, k, d)), np.empty((t, n), np.bool_), np.empty(1, np.int64)
    for m in range(len(places)):
        for a in range(n):
            some = False
            for s in range(t):
                some = some or is_seen(z, s * n + a, m)
            if not some:
                continue
            at[0] = a
            for s in range(t):
                kalman_kernels.linearise_sighting(x[s, a], places[m], z[s * n + a, m], y[s], H[s, 0])
                for i in range(n):
                    hears[s, i] = heard[s, i, a]
            took = master(team, a, at, (y, H, R), hears, gate)
            for s in range(t):
                used[s, a] += took[s]
