"""What the Kalman filters of a team share: readings between robots, and updates of a joint Gaussian by a few blocks.

A team's mean is x (t, n, d), its covariance P (t, n d, n d). A reading of robot j by robot i has a Jacobian at these
two only, so that P H' needs two block columns and not the whole matrix.

Sources: S. Roumeliotis, G. Bekey, "Distributed multirobot localization", IEEE T-RA 18(5), 2002 (the sparse update);
S. Thrun et al., "Simultaneous localization and mapping with sparse extended information filters", IJRR 23, 2004, sec. 2
(readings add in information form).
"""

from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np

from cooploc.estimators.doa import GradientDoa
from cooploc.estimators.gaussian import distance, present, symmetric
from cooploc.estimators.interface import Array, Indices, Mail, Mask, Senses, Sensor, World
from cooploc.estimators.models import NEAR, TOO_NEAR_TO_RANGE, Range

HEADER = 8  # bytes a message costs beside its numbers, as the runner counts


class Heard(NamedTuple):
    """A reading between a robot and one whose packet it heard."""

    sensor: Sensor
    sender: int
    reading: Array  # (r, k)
    theirs: bool  # made by the sender, of the robot itself

    def linearise(self, x: Array, x_j: Array) -> tuple[Array, Array, Array]:
        """y (r, k), H (r, k, d) of the robot itself, H_j (r, k, d) of the sender."""
        if self.theirs:
            y, H_j, H = linearise(self.sensor, x_j, x, self.reading)
            return y, H, H_j
        return linearise(self.sensor, x, x_j, self.reading)


def pairs(world: World, z: Senses, air: Mail) -> Iterator[tuple[Sensor, int, int, Array]]:
    """Readings (t, k) of a team as (sensor, receiver, sender, reading), sender by sender; absent ones are left out."""
    for sensor, j, reading in world.relative(z, air):
        for i in range(world.robots):
            if i != j and not np.isnan(reading[:, i]).all():
                yield sensor, i, j, reading[:, i]


def table(world: World, z: Senses, air: Mail) -> Iterator[tuple[Sensor, Array]]:
    """The same readings at once, (t, receiver, sender, k) by sensor, nobody's reading of himself among them."""
    for channel, readings in (
        ("sighting", z.sighting),
        ("radio_rssi", air.rssi[..., None]),
        ("radio_range", air.range[..., None]),
    ):
        sensor = world.sensors.get(channel)
        if sensor is not None and not np.isnan(readings).all():
            yield sensor, np.where(np.eye(world.robots, dtype=bool)[..., None], np.nan, readings)


def linearise(sensor: Sensor, x_i: Array, x_j: Array, reading: Array) -> tuple[Array, Array, Array]:
    """y (..., k), H_i (..., k, d), H_j (..., k, d) of a reading of j by i."""
    y, H, Hq = sensor.innovation(x_i, x_j[..., :2], reading)
    H_j = np.zeros_like(H)
    H_j[..., :2] = Hq
    return y, H, H_j


def curvature(sensor: Sensor, x_i: Array, x_j: Array, D: Array) -> tuple[Array, Array]:
    """Mean shift (..., k), extra variance (..., k, k) of a range by its second order; x_i - x_j has D (..., 2, 2)."""
    if isinstance(sensor, Range):
        return sensor.curvature(x_i, x_j[..., :2], D)
    return np.zeros(1), np.zeros((1, 1))


def packed(x: Array, *Ps: Array) -> Array:
    """A message (r, m): x (r, d) and the upper triangle of each covariance (r, d, d)."""
    i, j = np.triu_indices(x.shape[-1])
    return np.concatenate([x, *(P[:, i, j] for P in Ps)], -1)


def unpacked(message: Array, d: int, count: int = 1) -> tuple[Array, ...]:
    """x (..., d) and `count` covariances (..., d, d) from the front of a message."""
    i, j = np.triu_indices(d)
    parts = [message[..., :d]]
    for k in range(count):
        P = np.empty((*message.shape[:-1], d, d))
        P[..., i, j] = P[..., j, i] = message[..., d + k * len(i) : d + (k + 1) * len(i)]
        parts.append(P)
    return tuple(parts)


def sightings(world: World, z: Senses) -> Array:
    """Range and bearing of each teammate (r, 2 n), to be told; width 0 without a camera."""
    return z.sighting.reshape(len(z.sighting), -1) if "sighting" in world.sensors else z.sighting[:, :0, 0]


def received(world: World, z: Senses, mail: Mail, robot: Indices, begin: int) -> Iterator[Heard]:
    """A robot's readings of those it heard, then the sightings of it that they sent from column `begin` on."""
    for sensor, j, reading in world.relative(z, mail):
        yield Heard(sensor, j, reading, False)
    seen, rows = world.sensors.get("sighting"), np.arange(len(robot))
    if seen is not None and mail.packets.shape[-1] > begin:
        told = mail.packets[..., begin:].reshape(len(robot), world.robots, world.robots, 2)[rows, :, robot]
        for j in range(world.robots):
            if not np.isnan(told[:, j]).all():
                yield Heard(seen, j, told[:, j], True)


def flat(x: Array) -> Array:
    """(t, n, d) as (t, n d)."""
    return x.reshape(len(x), -1)


def square(P: Array) -> Array:
    """(t, n, d, n, d) as (t, n d, n d)."""
    t, n, d = P.shape[:3]
    return P.reshape(t, n * d, n * d)


def block_diagonal(blocks: Array) -> Array:
    """(t, n, d, d) on the diagonal of (t, n, d, n, d)."""
    t, n, d, _ = blocks.shape
    P = np.zeros((t, n, d, n, d))
    for i in range(n):
        P[:, i, :, i] = blocks[:, i]
    return P


def spread(P: Array, d: int) -> Array:
    """Covariance (t, n, n, 2, 2) of every difference of two positions, from P (t, n d, n d)."""
    blocks = P.reshape(len(P), P.shape[1] // d, d, -1, d)[:, :, :2, :, :2].swapaxes(2, 3)  # (t, n, n, 2, 2)
    own = np.einsum("tiiab->tiab", blocks)
    D: Array = own[:, :, None] + own[:, None] - blocks - blocks.swapaxes(1, 2)
    return D


def sparse_update(
    x: Array, P: Array, y: Array, at: Mapping[int, Array], R: Array, gate: float
) -> tuple[Array, Array, Mask]:
    """K = P H' S^-1,  x' = x + K y,  P' = P - K S K' by a Jacobian that is `at` those robots and 0 elsewhere.

    With S = C C' and L = P H' C'^-1, K S K' = L L', symmetric to the last bit. Also says which trials used it (t,).
    """
    t, n, d = x.shape
    R = np.broadcast_to(R, (*y.shape, y.shape[-1]))
    use = np.asarray(np.stack([present(y, H, R) for H in at.values()]).all(0))
    y, R = np.where(use[:, None], y, 0.0), np.where(use[:, None, None], R, np.eye(y.shape[-1]))
    at = {i: np.where(use[:, None, None], H, 0.0) for i, H in at.items()}
    PH = np.zeros((t, n * d, y.shape[-1]))
    for i, H in at.items():
        PH = PH + P[:, :, i * d : i * d + d] @ H.mT
    S = symmetric(R + np.asarray(sum(H @ PH[:, i * d : i * d + d] for i, H in at.items())))
    use &= distance(y, S) <= gate
    half: Array = np.linalg.inv(np.linalg.cholesky(S))
    L = np.where(use[:, None, None], PH @ half.mT, 0.0)
    x = x + (L @ (half @ y[..., None])).reshape(t, n, d)
    for column in range(y.shape[-1]):
        P = P - L[:, :, None, column] * L[:, None, :, column]
    return x, P, use


def range_by_range(x: Array, P: Array, z: Array, R: Array, gate: float) -> tuple[Array, Array]:
    """Plain Kalman updates of x (t, n, d), P (t, n d, n d) by ranges z (t, n, n), in the order of `pairs`."""
    x, P = x.copy(), P.copy()
    _add_ranges(x, P, z, R.item(), gate)
    return x, P


def direction_by_direction(x: Array, P: Array, z: Array, doa: GradientDoa, gate: float) -> tuple[Array, Array]:
    """The same by directions of arrival z (t, n), robot by robot."""
    x, P = x.copy(), P.copy()
    _add_directions(x, P, z, *_of_nodes(doa), gate)
    return x, P


@lru_cache(maxsize=64)
def _of_nodes(doa: GradientDoa) -> tuple[Array, Array, float, float]:
    """Where the nodes are (4, 2), their readings' weights in the gradient (4, 2), dB per ln d^2, the variance."""
    return doa.anchors, doa.gradient(np.eye(4)), 5 * doa.rssi.eta / np.log(10), doa.R.item()


def ranges_together(
    x: Array, P: Array, z: Array, R: Array, gate: float, second_order: bool, iterations: int
) -> tuple[Array, Array, Array]:
    """Gauss-Newton on all ranges z (t, n, n) at once; also their squared Mahalanobis distances (t, n, n)."""
    x, P, d2 = x.copy(), P.copy(), np.full(z.shape, np.nan)
    _join_ranges(x, P, z, R.item(), gate, second_order, iterations, d2)
    return x, P, d2


def scalars_of_own(x: Array, P: Array, use: Mask, y: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Kalman updates by one scalar per robot y (t, n), H (t, n, d), linearised together, where `use` (t, n) allows."""
    x, P = x.copy(), P.copy()
    _add_scalars(x, P, use, y, H, R.item())
    return x, P


def dense(at: Mapping[int, Array], robots: int) -> Array:
    """The Jacobian (t, k, n d) that is `at` those robots and 0 elsewhere."""
    first = next(iter(at.values()))
    H = np.zeros((*first.shape[:2], robots, first.shape[2]))
    for i, block in at.items():
        H[:, :, i] = block
    return H.reshape(*first.shape[:2], -1)


def stacked(use: Mask, y: Array, H_i: Array, H_j: Array, R: Array) -> tuple[Array, Array, Array]:
    """All readings as one vector: y (t, m), H (t, m, n d), R (t, m, m); what `use` forbids says nothing."""
    t, n, others, k, d = H_i.shape
    H, noise = np.zeros((t, n, others, k, n, d)), np.zeros((t, n * others, k, n * others, k))
    for i in range(n):
        H[:, i, :, :, i] += H_i[:, i]
    for j in range(others):
        H[:, :, j, :, j] += H_j[:, :, j]
    H = np.where(use[..., None, None, None], H, 0.0)
    R = np.where(use[..., None, None], R, np.eye(k)).reshape(t, -1, k, k)
    for m in range(n * others):
        noise[:, m, :, m] = R[:, m]
    size = n * others * k
    y = np.where(use[..., None], y, 0.0).reshape(t, size)
    return y, H.reshape(t, size, n * d), noise.reshape(t, size, size)


def distances(P: Array, y: Array, H_i: Array, H_j: Array, R: Array) -> Array:
    """Squared Mahalanobis distance (t, n, m) of the readings y (t, n, m, k) under P (t, n d, n d); nan where absent.

    m is n for readings of teammates; for readings of fixed things it is 1, and H_j is 0.
    """
    d2 = np.full(y.shape[:-1], np.nan)
    _fill_distances(P, y, H_i, H_j, np.ascontiguousarray(np.broadcast_to(R, (*y.shape, y.shape[-1]))), d2)
    return d2


def information(use: Mask, y: Array, H_i: Array, H_j: Array, R: Array) -> tuple[Array, Array]:
    """H'R^-1 y (t, n d) and H'R^-1 H (t, n d, n d) summed over the readings that `use` (t, n, m) allows."""
    t, n, _, _, d = H_i.shape
    eta, Lambda = np.zeros((t, n * d)), np.zeros((t, n * d, n * d))
    R = np.ascontiguousarray(np.broadcast_to(R, (*y.shape, y.shape[-1])))
    _add_information(use, y, H_i, H_j, R, eta, Lambda)
    return eta, Lambda


def information_mean(x: Array, P: Array, eta: Array, Lambda: Array) -> Array:
    """x + (P^-1 + Lambda)^-1 eta (t, n d): the mean alone, by one right-hand side."""
    step = np.asarray(np.linalg.solve(np.eye(P.shape[-1]) + P @ Lambda, P @ eta[..., None]), float)
    return np.asarray(x + step[..., 0])


def information_update(P: Array, Lambda: Array) -> Array:
    """(P^-1 + Lambda)^-1 as (I + P Lambda)^-1 P, which needs no inverse of P; where Lambda is 0 it is P."""
    return symmetric(np.asarray(np.linalg.solve(np.eye(P.shape[-1]) + P @ Lambda, P), float))


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


def _distances(P: Array, y: Array, H_i: Array, H_j: Array, R: Array, out: Array) -> None:
    """S = H_i P_ii H_i' + H_i P_ij H_j' + H_j P_ji H_i' + H_j P_jj H_j' + R, then y' S^-1 y."""
    t, n, others, k, d = H_i.shape
    H, PH, S, e = np.empty((k, 2 * d)), np.empty((2 * d, k)), np.empty((k, k)), np.empty((k, 1))
    for s in range(t):
        for i in range(n):
            for j in range(others):
                if np.isnan(y[s, i, j, 0]):
                    continue
                _beside(H_i, H_j, s, i, j, H)
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
                _whiten(S, e)
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
                    _beside(H_i, H_j, s, i, j, B)
                    for c in range(k):
                        B[c, 2 * d] = y[s, i, j, c]
                        for b in range(k):
                            C[c, b] = R[s, i, j, c, b]
                    _whiten(C, B)
                    for a in range(d):
                        at[a], at[d + a] = i * d + a, j * d + a
                    for c in range(k):
                        for a in range(2 * d):
                            eta[s, at[a]] += B[c, a] * B[c, 2 * d]
                            for m in range(2 * d):
                                Lambda[s, at[a], at[m]] += B[c, a] * B[c, m]


def _absorbed(x: Array, P: Array, PH: Array, y: float, S: float, gate: float) -> None:
    """x += P H' S^-1 y,  P -= P H' S^-1 H P  for a scalar reading, where the gate lets it in; P stays symmetric."""
    if y * y <= gate * S:
        PH /= np.sqrt(S)
        step = y / np.sqrt(S)
        for a in range(len(x)):
            gain = PH[a]
            x[a] += gain * step
            for b in range(len(x)):
                P[a, b] -= gain * PH[b]


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
                        PH[a] = u * (C[i, a] - C[j, a]) + v * (C[i + 1, a] - C[j + 1, a])
                    S = variance + u * (PH[i] - PH[j]) + v * (PH[i + 1] - PH[j + 1])
                    _absorb(at, C, PH, reading - away, S, gate)


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
                PH[a] = u * C[i, a] + v * C[i + 1, a]
            y = np.pi - (np.pi - (z[s, i // d] - np.arctan2(g[1], g[0]))) % (2 * np.pi)
            _absorb(at, C, PH, y, variance + u * PH[i] + v * PH[i + 1], gate)


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
                        PH[a] += H[s, i, m] * P[s, i * d + m, a]
                for m in range(d):
                    S += H[s, i, m] * PH[i * d + m]
                _absorb(x[s].reshape(-1), P[s], PH, e, S, np.inf)


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
                away, u, v = _range_of(x, i, j)
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
        _gate_ranges(before, P[s], z[s], variance, second_order, d2[s], shift, noise)
        for k in range(iterations):
            eta, Lambda = np.zeros(n * d), np.zeros((n * d, n * d))
            for p in range(n):
                for q in range(n):
                    if d2[s, p, q] <= gate:
                        i, j = p * d, q * d
                        away, u, v = _range_of(at, i, j)
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


_compiled = numba.njit(cache=True, error_model="numpy")
_whiten = _compiled(_whitened)
_beside = _compiled(_both)
_fill_distances = _compiled(_distances)
_add_information = _compiled(_information)
_absorb = _compiled(_absorbed)
_add_scalars = _compiled(_scalars)
_range_of = _compiled(_range_terms)
_gate_ranges = _compiled(_gated)
_join_ranges = _compiled(_joined_ranges)
_add_ranges = _compiled(_ranges)
_add_directions = _compiled(_directions)
