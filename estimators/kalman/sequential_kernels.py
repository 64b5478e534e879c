"""Compiled Kalman updates of a team's joint Gaussian by one scalar reading after the other, trial by trial.

Only the lower triangle of P is written, and copied to the upper one at the end of a trial.
"""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.compiled.jit import strict_kernel
from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.models.sensors import NEAR, TOO_NEAR_TO_RANGE


class Nodes(NamedTuple):
    """What a direction of arrival is made of."""

    places: Array  # (q, 2) [m]
    W: Array  # (q, 2)  weight of each node's reading in the gradient [1/m]
    c: float  # dB per ln d^2
    variance: float  # [rad^2]


@strict_kernel
def entry(P: Array, a: int, b: int) -> float:
    """P_ab of a symmetric matrix given by its lower triangle, which is half as much to write as the whole."""
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


@strict_kernel
def add_directions(x: Array, P: Array, z: Array, nodes: Nodes, gate: float) -> None:
    """Of each direction in turn y = z - angle of g,  H = (g_x dg_y - g_y dg_x) / |g|^2,  g = W' (-c ln |x_i - q|^2)."""
    places, W, c, variance = nodes
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
    """y - H (x^ - x) where x^ has moved by the scalars before: the same result as all readings at once."""
    t, n, d = x.shape
    PH, before = np.empty(n * d), np.empty((n, d))
    for s in range(t):
        before[:] = x[s]
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
