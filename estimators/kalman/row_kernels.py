"""Compiled steps of the EKFs, one row after the other: a move by odometry, a reading of something, an update.

numpy pays for every operation once per call, which rules where rows are few: a recording of five robots is one trial,
and has thousands of ticks. Each kernel does for a row what its `*_reference` in numpy does for all rows at once, in
`update.py` for `update` and `widen`, in `models/` for the rest; a row's bits depend on nothing but the row.
"""

import numpy as np

from cooploc.estimators.compiled.jit import strict_kernel
from cooploc.estimators.kalman.matrix_kernels import joseph, solve
from cooploc.estimators.models.angles import wrapped
from cooploc.estimators.models.sensors import NEAR, TOO_NEAR_TO_RANGE

RANGE, RSSI, SIGHTING = range(3)  # kinds of readings between a pose and a place


@strict_kernel
def absorb_row(x, P, y, H, R, gate, S, B, A):
    """Update x (d,), P (d, d) in place by y (k,), H (k, d), R (k, k), unless the gate refuses it.

    Scratch: S (k, k), B (k, d + 1) for S^-1 [H P, y], A (d, d).
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
        return
    for i in range(k):
        for a in range(d):
            x[a] += B[i, a] * y[i]
    joseph(P, H, B, R, A, P)


@strict_kernel
def is_known(y, H, R):
    """Whether nothing of a reading is nan."""
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
    """`kalman_reference` in place: x (r, d), P (r, d, d) by y (r, k), H (r, k, d), R (r, k, k)."""
    d, k = H.shape[2], H.shape[1]
    S, B, A = np.empty((k, k)), np.empty((k, d + 1)), np.empty((d, d))
    for r in range(len(x)):
        if is_known(y[r], H[r], R[r]):
            absorb_row(x[r], P[r], y[r], H[r], R[r], gate, S, B, A)


@strict_kernel
def widen(P, F, Q, out):
    """F P F' + Q, symmetric, for a team's P (t, n d, n d) and F, Q (t, n, d, d); of one robot, n = 1."""
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
    """`Unicycle.move`: x (r, 3), u (r, 2), dt (r,), with the variances of speed and turn per second of odometry."""
    for r in range(len(x)):
        arc = 0.0 if np.isnan(u[r, 0]) else u[r, 0] * dt[r]
        turn = 0.0 if np.isnan(u[r, 1]) else u[r, 1] * dt[r]
        c, s = np.cos(x[r, 2] + turn / 2), np.sin(x[r, 2] + turn / 2)
        out[r, 0], out[r, 1], out[r, 2] = x[r, 0] + arc * c, x[r, 1] + arc * s, wrapped(x[r, 2] + turn)
        along, across = variances[0] * dt[r], variances[1] * dt[r]
        G = ((c, -arc * s / 2), (s, arc * c / 2), (0.0, 1.0))
        for a in range(3):
            for b in range(3):
                F[r, a, b] = 1.0 if a == b else 0.0
                Q[r, a, b] = G[a][0] * along * G[b][0] + G[a][1] * across * G[b][1]
        F[r, 0, 2], F[r, 1, 2] = -arc * s, arc * c


@strict_kernel
def drive_and_widen(x, u, dt, variances, P, out, P1, F):
    """`drive`, then `widen` P (r, 3, 3) into P1."""
    Q = np.empty(F.shape)
    drive(x, u, dt, variances, out, F, Q)
    widen(P, F.reshape(-1, 1, 3, 3), Q.reshape(-1, 1, 3, 3), P1)


@strict_kernel
def linearise_row(kind, A, slope, x, q, z, y, H):
    """`innovation` of Range, LogDistance (A, slope = 10 eta / ln 10) and Sighting: y (k,), and H (k, d) by the pose x.

    By the place q the Jacobian is -H of the position.
    """
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
        y[1] = wrapped(z[1] - (np.arctan2(-north, -east) - heading))
        H[1, 0], H[1, 1] = -north / near**2, east / near**2
        if len(x) > 2:
            H[1, 2] = -1.0


@strict_kernel
def relate(kind, A, slope, x, q, z, y, H):
    """`innovation` of rows: poses x (r, d), places q (r, 2) or one for all (1, 2), readings z (r, k)."""
    for r in range(len(x)):
        linearise_row(kind, A, slope, x[r], q[r if len(q) > 1 else 0], z[r], y[r], H[r])


@strict_kernel
def sight(x, P, places, z, R, gate):
    """Updates in place by sightings z (r, l, 2) of the places (l, 2), one after the other, each where the last left."""
    d, k = x.shape[1], 2
    S, B, A = np.empty((k, k)), np.empty((k, d + 1)), np.empty((d, d))
    y, H = np.empty(k), np.empty((k, d))
    for r in range(len(x)):
        for m in range(len(places)):
            if not (np.isnan(z[r, m, 0]) or np.isnan(z[r, m, 1]) or z[r, m, 0] < TOO_NEAR_TO_RANGE):
                linearise_row(SIGHTING, 0.0, 0.0, x[r], places[m], z[r, m], y, H)
                if is_known(y, H, R):
                    absorb_row(x[r], P[r], y, H, R, gate, S, B, A)
