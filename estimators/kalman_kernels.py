"""The compiled loops of the Kalman filters over rows: small matrices, one reading a row, scalar readings in turn.

Each kernel does for a row what a function in `kalman.py` or `models.py` does in numpy for all rows at once: where rows
are few, as in a recording, numpy's calls cost more than their work. A row's bits depend on nothing but the row.
"""

import numpy as np

from cooploc.estimators.compiled import strict_inlined, strict_kernel
from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.models import NEAR, TOO_NEAR_TO_RANGE, wrap_angle


@strict_kernel
def whiten(C: Array, B: Array) -> None:
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


@strict_kernel
def fill_definite(P: Array, out: Mask) -> None:
    """Write which P (r, d, d) are definite: the last pivot is above 0 if all are, and nan if one before was not."""
    d = P.shape[1]
    C, nothing = np.empty((d, d)), np.empty((d, 0))
    for s in range(len(P)):
        for a in range(d):
            for b in range(d):
                C[a, b] = P[s, a, b]
        whiten(C, nothing)
        out[s] = C[d - 1, d - 1] > 0


@strict_kernel
def solve(S, B):
    """Turn B (k, m) into S^-1 B by elimination with row pivots; S (k, k) is destroyed."""
    for c in range(len(S)):
        pivot = c
        for r in range(c + 1, len(S)):
            pivot = r if abs(S[r, c]) > abs(S[pivot, c]) else pivot
        if pivot != c:
            for m in range(c, len(S)):
                S[c, m], S[pivot, m] = S[pivot, m], S[c, m]
            for m in range(B.shape[1]):
                B[c, m], B[pivot, m] = B[pivot, m], B[c, m]
        for r in range(c + 1, len(S)):
            factor = S[r, c] / S[c, c]
            for m in range(c + 1, len(S)):
                S[r, m] -= factor * S[c, m]
            for m in range(B.shape[1]):
                B[r, m] -= factor * B[c, m]
    for c in range(len(S) - 1, -1, -1):
        for m in range(B.shape[1]):
            for r in range(c + 1, len(S)):
                B[c, m] -= S[c, r] * B[r, m]
            B[c, m] /= S[c, c]


@strict_kernel
def joseph(P, H, K, R, A, out):
    """Write (I - K H) P (I - K H)' + K R K', symmetric, for K' (k, d); A (d, d) is scratch, out may be P."""
    d, k = P.shape[0], H.shape[0]
    for a in range(d):
        for b in range(d):
            v = P[a, b]
            for i in range(k):
                HP = 0.0
                for c in range(d):
                    HP += H[i, c] * P[c, b]
                v -= K[i, a] * HP
            A[a, b] = v
    for a in range(d):
        for b in range(d):
            v = A[a, b]
            for i in range(k):
                AH, RK = 0.0, 0.0
                for c in range(d):
                    AH += A[a, c] * H[i, c]
                for j in range(k):
                    RK += K[j, a] * R[j, i]
                v += (RK - AH) * K[i, b]
            out[a, b] = v
    for a in range(d):
        for b in range(a):
            out[a, b] = out[b, a] = (out[a, b] + out[b, a]) / 2


@strict_kernel
def fill_product(A, B, out):
    """Write A B."""
    for a in range(len(A)):
        for b in range(B.shape[1]):
            out[a, b] = 0.0
            for c in range(len(B)):
                out[a, b] += A[a, c] * B[c, b]


@strict_kernel
def fill_sum(u, A, v, B, out):
    """u A + v B into out; a loop, because each line of array arithmetic takes a second to compile."""
    for a in range(len(A)):
        for b in range(A.shape[1]):
            out[a, b] = u * A[a, b] + v * B[a, b]


RANGE, RSSI, SIGHTING = range(3)  # kinds of readings between a pose and a place


@strict_kernel
def absorb_row(x, P, y, H, R, gate, S, B, A):
    """Update x (d,), P (d, d) in place by y (k,), H (k, d), R (k, k), and return True, unless the gate refuses it.

    Scratch: S (k, k), B (k, d + 1), A (d, d).
    """
    d, k = P.shape[0], H.shape[0]
    for i in range(k):
        for a in range(d):
            B[i, a] = 0.0
            for c in range(d):
                B[i, a] += H[i, c] * P[c, a]
        B[i, d] = y[i]
    for i in range(k):
        for j in range(k):
            S[i, j] = R[i, j]
            for c in range(d):
                S[i, j] += B[i, c] * H[j, c]
    solve(S, B)
    far = 0.0
    for i in range(k):
        far += y[i] * B[i, d]
    if not far <= gate:
        return False
    for i in range(k):
        for a in range(d):
            x[a] += B[i, a] * y[i]
    joseph(P, H, B, R, A, P)
    return True


@strict_kernel
def is_known(y, H, R):
    """Return whether nothing of a reading is nan."""
    for i in range(len(y)):
        if np.isnan(y[i]):
            return False
        for j in range(len(y)):
            if np.isnan(R[i, j]):
                return False
        for c in range(H.shape[1]):
            if np.isnan(H[i, c]):
                return False
    return True


@strict_kernel
def update(x, P, y, H, R, gate):
    """Update x (r, d), P (r, d, d) in place by y (r, k), H (r, k, d), R (r, k, k), as `kalman` does."""
    d, k = H.shape[2], H.shape[1]
    S, B, A = np.empty((k, k)), np.empty((k, d + 1)), np.empty((d, d))
    for r in range(len(x)):
        if is_known(y[r], H[r], R[r]):
            absorb_row(x[r], P[r], y[r], H[r], R[r], gate, S, B, A)


@strict_kernel
def widen(P, F, Q, out):
    """Write F P F' + Q, for a team's P (t, n d, n d) and F, Q (t, n, d, d); of one robot, n = 1."""
    t, n, d, _ = F.shape
    A = np.empty((d, d))
    for s in range(t):
        for i in range(n):
            for j in range(i + 1):
                for a in range(d):
                    for b in range(d):
                        A[a, b] = 0.0
                        for c in range(d):
                            A[a, b] += F[s, i, a, c] * P[s, i * d + c, j * d + b]
                for a in range(d):
                    for b in range(d):
                        v = Q[s, i, a, b] if i == j else 0.0
                        for c in range(d):
                            v += A[a, c] * F[s, j, b, c]
                        out[s, i * d + a, j * d + b] = v
            for a in range(d):
                for b in range(i * d + a):
                    v = out[s, i * d + a, b]
                    if b >= i * d:
                        v = (v + out[s, b, i * d + a]) / 2
                    out[s, i * d + a, b] = out[s, b, i * d + a] = v


@strict_kernel
def drive(x, u, dt, variances, out, F, Q):
    """Write `Unicycle.move` of x (r, 3), u (r, 2), dt (r,), given the variances of speed and turn rate."""
    for r in range(len(x)):
        arc = 0.0 if np.isnan(u[r, 0]) else u[r, 0] * dt[r]
        turn = 0.0 if np.isnan(u[r, 1]) else u[r, 1] * dt[r]
        c, s = np.cos(x[r, 2] + turn / 2), np.sin(x[r, 2] + turn / 2)
        out[r, 0], out[r, 1], out[r, 2] = x[r, 0] + arc * c, x[r, 1] + arc * s, wrap_angle(x[r, 2] + turn)
        along, across = variances[0] * dt[r], variances[1] * dt[r]
        G = ((c, -arc * s / 2), (s, arc * c / 2), (0.0, 1.0))
        for a in range(3):
            for b in range(3):
                F[r, a, b] = 1.0 if a == b else 0.0
                Q[r, a, b] = G[a][0] * along * G[b][0] + G[a][1] * across * G[b][1]
        F[r, 0, 2], F[r, 1, 2] = -arc * s, arc * c


@strict_kernel
def drive_and_widen(x, u, dt, variances, P, out, P1, F):
    """Move x by `drive`, and widen P (r, 3, 3) into P1."""
    Q = np.empty(F.shape)
    drive(x, u, dt, variances, out, F, Q)
    widen(P, F.reshape(-1, 1, 3, 3), Q.reshape(-1, 1, 3, 3), P1)


@strict_kernel
def linearise_row(kind, A, slope, x, q, z, y, H):
    """Write y (k,), and H (k, d) by the pose x, of Range, LogDistance (A, slope = 10 eta / ln 10) or Sighting."""
    east, north = x[0] - q[0], x[1] - q[1]
    d2 = east * east + north * north
    away, near = np.sqrt(d2), max(np.sqrt(d2), NEAR)
    for i in range(len(H)):
        for a in range(len(x)):
            H[i, a] = 0.0
    if kind == RSSI:
        fall = -slope / d2 if d2 > NEAR**2 else 0.0
        y[0] = z[0] - A + 0.5 * slope * np.log(max(d2, NEAR**2))
        H[0, 0], H[0, 1] = fall * east, fall * north
        return
    y[0] = np.nan if z[0] < TOO_NEAR_TO_RANGE else z[0] - away
    H[0, 0], H[0, 1] = east / near, north / near
    if kind == SIGHTING:
        heading = x[2] if len(x) > 2 else 0.0
        y[1] = wrap_angle(z[1] - (np.arctan2(-north, -east) - heading))
        H[1, 0], H[1, 1] = -north / near**2, east / near**2
        if len(x) > 2:
            H[1, 2] = -1.0


@strict_kernel
def linearise_sighting(x, q, z, y, H):
    """Write y (2,) and H (2, d) of a Sighting."""
    linearise_row(SIGHTING, 0.0, 0.0, x, q, z, y, H)


@strict_kernel
def relate(kind, A, slope, x, q, z, y, H):
    """Write the innovations of poses x (r, d), places q (r, 2) or one for all (1, 2), readings z (r, k)."""
    for r in range(len(x)):
        linearise_row(kind, A, slope, x[r], q[r if len(q) > 1 else 0], z[r], y[r], H[r])


# A sender's belief in its packet, and the Jacobian by it.


@strict_inlined
def read_belief(packet, at, x, P):
    """Write x (d,) at the beginning of a packet, and the P (d, d) whose upper triangle begins `at` its place."""
    for a in range(len(x)):
        x[a] = packet[a]
        for b in range(a, len(x)):
            P[a, b] = P[b, a] = packet[at]
            at += 1


@strict_inlined
def mirror_place(H, out):
    """Write the Jacobian (k, d) by the place that was read, given that by the pose of who read it."""
    for a in range(H.shape[0]):
        for c in range(H.shape[1]):
            out[a, c] = -H[a, c] if c < 2 else 0.0


@strict_inlined
def linearise_between(sensor, x, x_j, z, by_sender, y, H, H_j):
    """Write y (k,), and H and H_j (k, d) by the poses of a robot and a sender, of its reading of the sender.

    With `by_sender` of the sender's reading of the robot; `sensor` is kind, A and slope of `linearise_row`.
    """
    kind, A, slope = sensor
    if by_sender:
        linearise_row(kind, A, slope, x_j, x, z, y, H_j)
        mirror_place(H_j, H)
    else:
        linearise_row(kind, A, slope, x, x_j, z, y, H)
        mirror_place(H, H_j)


@strict_inlined
def fill_form(H, P, out):
    """Write H P H', symmetric."""
    for a in range(len(H)):
        for b in range(a + 1):
            v = 0.0
            for c in range(len(P)):
                for e in range(len(P)):
                    v += H[a, c] * P[c, e] * H[b, e]
            out[a, b] = out[b, a] = v


# A tick's sightings of landmarks by rows of robots: places (l, 2) [m]; ranges [m] and bearings [rad] (r, l, 2), nan
# where absent; R (2, 2); the gate, a squared Mahalanobis distance.
LandmarkSightings = tuple[Array, Array, Array, float]


@strict_kernel
def is_seen(z, r, m):
    """Return whether row r has any number of landmark m."""
    return not (np.isnan(z[r, m, 0]) and np.isnan(z[r, m, 1]))


@strict_kernel
def sight(x, P, places, z, R, gate):
    """Update in place by sightings z (r, l, 2) of the places (l, 2), each linearised where the last one left."""
    d, k = x.shape[1], 2
    S, B, A = np.empty((k, k)), np.empty((k, d + 1)), np.empty((d, d))
    y, H = np.empty(k), np.empty((k, d))
    for r in range(len(x)):
        for m in range(len(places)):
            if is_seen(z, r, m):
                linearise_sighting(x[r], places[m], z[r, m], y, H)
                if is_known(y, H, R):
                    absorb_row(x[r], P[r], y, H, R, gate, S, B, A)


# Updates of a team's joint Gaussian by one scalar reading after the other, trial by trial. Only the lower triangle of P
# is written, and copied to the upper one at the end of a trial.


@strict_kernel
def entry(P: Array, a: int, b: int) -> float:
    """Return P_ab of a symmetric matrix given by its lower triangle."""
    return float(P[a, b] if b <= a else P[b, a])


@strict_kernel
def mirror(P: Array) -> None:
    """Copy the lower triangle to the upper one."""
    for a in range(len(P)):
        for b in range(a):
            P[b, a] = P[a, b]


@strict_kernel
def absorb(x: Array, P: Array, PH: Array, y: float, S: float, gate: float) -> None:
    """x += P H' S^-1 y,  P -= P H' S^-1 H P  for a scalar reading, unless the gate refuses it; P's lower triangle."""
    if y * y <= gate * S:
        PH /= np.sqrt(S)
        step = y / np.sqrt(S)
        for a in range(len(x)):
            gain = PH[a]
            x[a] += gain * step
            for b in range(a + 1):
                P[a, b] -= gain * PH[b]


@strict_kernel
def add_ranges(x: Array, P: Array, z: Array, variance: float, gate: float) -> None:
    """Absorb each range in turn: y = z - |x_i - x_j|,  H_i = (x_i - x_j)' / |x_i - x_j| = -H_j."""
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


@strict_kernel
def add_directions(x, P, z, places, W, c, variance, gate):
    """Absorb each direction in turn: y = z - angle of g = -c W' ln |x_i - q|^2,  H = (g_x dg_y - g_y dg_x) / |g|^2.

    Of anchors at places (q, 2) [m], whose readings weigh W (q, 2) [1/m] in the gradient g; c in dB per ln d^2.
    """
    t, n, d = x.shape
    PH, g, dg = np.empty(n * d), np.empty(2), np.empty((2, 2))  # dg: axis 1 is the position
    for s in range(t):
        at, C = x[s].reshape(-1), P[s]
        for i in range(0, n * d, d):
            if np.isnan(z[s, i // d]):
                continue
            g[:], dg[:] = 0.0, 0.0
            for q in range(len(places)):
                d2 = (at[i] - places[q, 0]) ** 2 + (at[i + 1] - places[q, 1]) ** 2
                level, fall = c * np.log(max(d2, NEAR**2)), 2 * c / d2 if d2 > NEAR**2 else 0.0
                for k in range(2):
                    g[k] -= W[q, k] * level
                    for m in range(2):
                        dg[k, m] -= W[q, k] * fall * (at[i + m] - places[q, m])
            strength = max(g[0] ** 2 + g[1] ** 2, NEAR**2)
            u = (g[0] * dg[1, 0] - g[1] * dg[0, 0]) / strength
            v = (g[0] * dg[1, 1] - g[1] * dg[0, 1]) / strength
            for a in range(n * d):
                PH[a] = u * entry(C, i, a) + v * entry(C, i + 1, a)
            y = np.pi - (np.pi - (z[s, i // d] - np.arctan2(g[1], g[0]))) % (2 * np.pi)
            absorb(at, C, PH, y, variance + u * PH[i] + v * PH[i + 1], gate)
        mirror(C)


@strict_kernel
def add_scalars(x: Array, P: Array, use: Mask, y: Array, H: Array, variances: Array) -> None:
    """Absorb each scalar, y - H (x^ - x) where x^ has moved by those before: the result of all readings at once."""
    t, n, d = x.shape
    PH = np.empty(n * d)
    for s in range(t):
        before = x[s].copy()
        for i in range(n):
            for c in range(len(variances) if use[s, i] else 0):
                PH[:], S, e = 0.0, variances[c], y[s, i, c]
                for m in range(d):
                    e -= H[s, i, c, m] * (x[s, i, m] - before[i, m])
                    for a in range(n * d):
                        PH[a] += H[s, i, c, m] * entry(P[s], i * d + m, a)
                for m in range(d):
                    S += H[s, i, c, m] * PH[i * d + m]
                absorb(x[s].reshape(-1), P[s], PH, e, S, np.inf)
        mirror(P[s])
