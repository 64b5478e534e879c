"""What the tests compare with: slow, plain, and sharing no formula with the code that is judged."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hypothesis import HealthCheck, settings

from cooploc.estimators.interface import Belief, Senses, World
from cooploc.estimators.models import Displacement, Range
from cooploc.scenarios.runner.trace import trace
from cooploc.scenarios.stream import Air, Stream

# Random examples that are the same in every run.
repeatable = settings(
    derandomize=True, deadline=None, max_examples=60, database=None, suppress_health_check=list(HealthCheck)
)


def covariances(rng: np.random.Generator, *lead: int, d: int) -> np.ndarray:
    """Random covariances (*lead, d, d), well away from singular."""
    a = rng.normal(size=(*lead, d, d))
    return a @ a.mT + 0.1 * np.eye(d)


def is_covariance(P: np.ndarray, tolerance: float = 1e-9) -> bool:
    """Every (..., d, d) is symmetric and has no negative eigenvalue."""
    scale = np.abs(P).max()
    symmetric = np.abs(P - P.mT).max() <= tolerance * scale
    return bool(symmetric and np.linalg.eigvalsh((P + P.mT) / 2).min() >= -tolerance * scale)


def about(values: np.ndarray, mean: float, sd: float, sds: float = 4.5) -> None:
    """The sample's mean and sd lie within so many standard errors of what they should be."""
    values = np.ravel(values)
    assert abs(values.mean() - mean) < sds * sd / np.sqrt(len(values))
    assert abs(values.std() - sd) < sds * sd / np.sqrt(2 * len(values))


def threefry(key: np.ndarray, counter: int, particle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Threefry-2x32-20 words (r, n), (r, n) for keys (r, 2) and particles (n,), as the paper states it."""
    rotations = 13, 15, 26, 6, 17, 29, 16, 24
    k0, k1 = key[:, :1], key[:, 1:]
    ks = (k0, k1, k0 ^ k1 ^ np.uint32(0x1BD11BDA))
    a = np.uint32(counter) + ks[0] + np.zeros(len(particle), np.uint32)
    b = particle.astype(np.uint32) + ks[1]
    for i in range(20):
        turn = np.uint32(rotations[i % 8])
        a = a + b
        b = ((b << turn) | (b >> np.uint32(32 - turn))) ^ a
        if i % 4 == 3:
            block = i // 4 + 1
            a, b = a + ks[block % 3], b + ks[(block + 1) % 3] + np.uint32(block)
    return a, b


def normals(key: np.ndarray, counter: int, n: int) -> np.ndarray:
    """Standard normal pairs (r, n, 2) by Box-Muller."""
    a, b = threefry(key, counter, np.arange(n))
    radius = np.sqrt(-2 * np.log((a + 0.5) * 2.0**-32))
    angle = 2 * np.pi * (b + 0.5) * 2.0**-32
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)


def nees(x: np.ndarray, got: Any) -> np.ndarray:
    """Normalised squared error / d (t, T, n) of beliefs `got` at true states x (t, T, n, d)."""
    e = got.x - x
    return np.einsum("tkna,tkna->tkn", e, np.linalg.solve(got.P, e[..., None])[..., 0]) / x.shape[-1]


def exchanges(estimator: Any, stream: Stream) -> list[tuple[tuple, Any]]:
    """The arguments (state, senses, air) of every tick's exchange, and the state after it."""
    seen = []

    def watch(name: str, tick: int, arguments: tuple, call: Callable) -> Any:
        result = call(*arguments)
        if name == "exchange":
            seen.append((arguments, result[0]))
        return result

    trace("watched", estimator, stream, watch)
    return seen


def slope(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """df/dx (..., k, d) by central differences along the last axis of x (..., d)."""
    columns = []
    for e in step * np.eye(x.shape[-1]):
        columns.append((f(x + e) - f(x - e)) / (2 * step))
    return np.stack(columns, -1)


# ---------------------------------------------------------------- the paper's world on a grid


def log_distance(d: np.ndarray, A: float = -40.0, eta: float = 3.0) -> np.ndarray:
    """Path loss [dBm] with the distance clamped at 0.1 m."""
    return A - 10 * eta * np.log(np.maximum(d, 0.1)) / np.log(10)


def corners(side: float) -> list[tuple[float, float]]:
    """science.md: N1 .. N4."""
    return [(0, 0), (0, side), (side, side), (side, 0)]


def gradient(S1: np.ndarray, S2: np.ndarray, S3: np.ndarray, S4: np.ndarray, width: float, height: float) -> tuple:
    """The paper's eqs. (1), (2): central differences between the sides of the arena, averaged over the two pairs."""
    east, west = (S3 + S4) / 2, (S1 + S2) / 2
    north, south = (S2 + S3) / 2, (S1 + S4) / 2
    return (east - west) / width, (north - south) / height


def arrival(x: np.ndarray, y: np.ndarray, side: float) -> np.ndarray:
    """The angle of the gradient that the path loss gives at (x, y)."""
    gx, gy = gradient(*(log_distance(np.hypot(x - a, y - b)) for a, b in corners(side)), side, side)
    return np.arctan2(gy, gx)


def arrival_error(side: float, sigma: float, draws: int = 400_000, seed: int = 0) -> np.ndarray:
    """Errors [rad] of measured directions of arrival over a square arena; also the positions, (3, draws)."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, side, (2, draws))
    S = [log_distance(np.hypot(x - a, y - b)) + sigma * rng.normal(size=draws) for a, b in corners(side)]
    gx, gy = gradient(*S, side, side)
    turn = np.exp(1j * (np.arctan2(gy, gx) - arrival(x, y, side)))
    return np.stack([np.angle(turn), x, y])


class Grid:
    """A belief on cells that ride along with the odometry, so that a move only blurs them."""

    def __init__(self, mean: np.ndarray, sd: float, half: float = 5.0, cells: int = 200) -> None:
        edge = (np.arange(cells) + 0.5) / cells * 2 * half - half
        self.x, self.y = np.meshgrid(mean[0] + edge, mean[1] + edge, indexing="ij")
        self.p = np.exp(-((self.x - mean[0]) ** 2 + (self.y - mean[1]) ** 2) / (2 * sd**2))
        wave = 2 * np.pi * np.fft.fftfreq(cells, 2 * half / cells)
        self.k2 = wave[:, None] ** 2 + wave[None, :] ** 2
        self._normalise()

    def move(self, dx: float, dy: float, sd: float) -> None:
        """Shift the cells; convolve with N(0, sd^2 I) by its exact Fourier transform, however small against a cell."""
        self.x, self.y = self.x + dx, self.y + dy
        self.p = np.maximum(np.fft.ifft2(np.fft.fft2(self.p) * np.exp(-(sd**2) * self.k2 / 2)).real, 0)
        self._normalise()

    def weigh(self, log_likelihood: np.ndarray) -> None:
        self.p = self.p * np.exp(log_likelihood - log_likelihood.max())
        self._normalise()

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        m = np.array([(self.p * self.x).sum(), (self.p * self.y).sum()])
        e = np.stack([self.x - m[0], self.y - m[1]])
        return m, np.einsum("iab,jab,ab->ij", e, e, self.p)

    def _normalise(self) -> None:
        self.p = self.p / self.p.sum()


# ---------------------------------------------------------------- a linear-Gaussian team


@dataclass(frozen=True)
class Offset:
    """A sensor that reads its offset from a place, x - q (2,), with noise: linear, so that Kalman filters are exact."""

    sd: tuple[float, float] = (0.3, 0.2)
    correlation: float = 0.4

    @property
    def R(self) -> np.ndarray:
        c = self.correlation * self.sd[0] * self.sd[1]
        return np.array([[self.sd[0] ** 2, c], [c, self.sd[1] ** 2]])

    def innovation(self, x: Any, q: Any, z: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        y = z - (x[..., :2] - q)
        H = np.broadcast_to(np.eye(2, x.shape[-1]), (*y.shape, x.shape[-1]))
        return y, H, np.broadcast_to(-np.eye(2), (*y.shape, 2))


PLACES = np.array([[1.0, 2.0], [-3.0, 0.5]])


def linear_team(
    seed: int, trials: int, robots: int, ticks: int, share: float = 0.6, relative: bool = True
) -> tuple[np.ndarray, Stream]:
    """True positions (t, T, n, 2) and the stream of a linear-Gaussian team; `share` of the readings are there."""
    rng = np.random.default_rng(seed)
    sensor, motion = Offset(), Displacement(sigma=0.3, tick=0.5)
    t, T, n = trials, ticks, robots
    P0 = covariances(rng, n, d=2)
    mean = rng.normal(0, 3, (t, n, 2))
    start = mean + (np.linalg.cholesky(P0) @ rng.normal(size=(t, n, 2, 1)))[..., 0]
    odometry, dt = rng.normal(0, 1, (t, T, n, 2)), rng.uniform(0.2, 2.0, (t, T, n))
    moves = odometry + 0.3 * np.sqrt(dt / 0.5)[..., None] * rng.normal(size=odometry.shape)
    x = start[:, None] + np.cumsum(moves, 1)
    root = np.linalg.cholesky(sensor.R)

    def read(places: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        z = x[:, :, :, None] - places
        z = z + (root @ rng.normal(size=(*z.shape, 1)))[..., 0]
        return np.where((wanted & (rng.uniform(size=z.shape[:-1]) < share))[..., None], z, np.nan)

    landmark = read(PLACES, np.ones(len(PLACES), bool))
    sighting = read(x[:, :, None], ~np.eye(n, dtype=bool) if relative else np.zeros((n, n), bool))
    world = World(
        robots=n,
        tick=0.5,
        arena=np.array([[-9.0, -9.0], [9.0, 9.0]]),
        motion=motion,
        sensors={"landmark": sensor, "sighting": sensor},
        landmarks=PLACES,
    )
    stream = Stream(
        scenario="linear",
        seed=seed,
        trial=np.arange(t),
        time=0.5 * np.arange(1, T + 1),
        world=world,
        prior=Belief(mean, np.broadcast_to(P0, (t, n, 2, 2)).copy()),
        senses=Senses(odometry, dt, np.empty((t, T, n, 0)), landmark, sighting, {}),
        air=Air(np.broadcast_to(~np.eye(n, dtype=bool), (t, T, n, n)).copy(), *np.empty((2, t, T, n, 0))),
    )
    return x, stream


def dense_posterior(stream: Stream, trial: int, last: int, relative: bool) -> tuple[np.ndarray, np.ndarray]:
    """Mean (n, 2) and covariance (n, 2, n, 2) at tick `last`, given all readings up to it."""
    n, (x, P) = stream.robots, dense_path(stream, trial, last, relative)
    return x[-1], P[-2 * n :, -2 * n :].reshape(n, 2, n, 2)


def dense_path(stream: Stream, trial: int, last: int, relative: bool) -> tuple[np.ndarray, np.ndarray]:
    """Means (last + 1, n, 2) at every tick given all readings up to `last`, and the covariance of all, prior first.

    The information matrix of the whole trajectory of the whole team is written down and inverted.
    """
    n, R, size = stream.robots, np.linalg.inv(Offset().R), 2 * stream.robots * (last + 2)
    L, h = np.zeros((size, size)), np.zeros(size)

    def at(k: int, i: int) -> slice:  # k = 0 is the prior
        return slice(2 * (k * n + i), 2 * (k * n + i) + 2)

    def add(blocks: list[tuple[slice, int]], value: np.ndarray, information: np.ndarray) -> None:
        for a, sign_a in blocks:
            h[a] += sign_a * information @ value
            for b, sign_b in blocks:
                L[a, b] += sign_a * sign_b * information

    z = stream.senses
    for i in range(n):
        add([(at(0, i), 1)], stream.prior.x[trial, i], np.linalg.inv(stream.prior.P[trial, i]))
        for k in range(last + 1):
            Q = 0.3**2 * z.dt[trial, k, i] / 0.5 * np.eye(2)
            add([(at(k + 1, i), 1), (at(k, i), -1)], z.odometry[trial, k, i], np.linalg.inv(Q))
            for place, reading in zip(PLACES, z.landmark[trial, k, i], strict=True):
                if np.isfinite(reading).all():
                    add([(at(k + 1, i), 1)], reading + place, R)
            for j, reading in enumerate(z.sighting[trial, k, i]):
                if relative and np.isfinite(reading).all():
                    add([(at(k + 1, i), 1), (at(k + 1, j), -1)], reading, R)
    P = np.linalg.inv(L)
    return (P @ h).reshape(last + 2, n, 2)[1:], P


def measure_anchor_ranges(truth: Any, stream: Stream) -> Stream:
    """The stream of robots that measure ranges to the anchors, nine of ten, in place of RSSI."""
    rng = np.random.default_rng(9)
    ranges = np.linalg.norm(truth.x[..., None, :2] - stream.world.anchors, axis=-1)
    ranges = ranges + 0.1 * rng.normal(size=ranges.shape)
    ranges[(rng.uniform(size=ranges.shape) < 0.1) | (ranges < 0.2)] = np.nan
    sensors = {name: one for name, one in stream.world.sensors.items() if name != "anchor_rssi"}
    senses = stream.senses._replace(anchor_rssi=stream.senses.anchor_rssi[..., :0], extra={"anchor_range": ranges})
    return replace(stream, world=replace(stream.world, sensors=sensors | {"anchor_range": Range(0.1)}), senses=senses)


def path_residuals(stream: Stream, trial: int, x: np.ndarray) -> np.ndarray:
    """Misfits, in standard deviations, of a path (T, n, 2) in the radio arena, the start before it at its best.

    Of odometry, anchors (RSSI, or ranges where there are these), ranges, and each pair's RSSI once: the mean of both
    directions where both were heard.
    """
    z, air, link = stream.senses, stream.air, stream.air.link[trial]
    Q, P, anchors = stream.world.motion.sigma**2, stream.prior.P[trial, 0, 0, 0], stream.world.anchors
    first = (x[0] - stream.prior.x[trial] - z.odometry[trial, 0]) / np.sqrt(P + Q)
    moves = (np.diff(x, axis=0) - z.odometry[trial, 1:]) / np.sqrt(Q)
    away = np.linalg.norm(x[:, :, None] - anchors, axis=-1)
    if "anchor_range" in z.extra:
        own = np.nan_to_num((z.extra["anchor_range"][trial] - away) / 0.1)
    else:
        own = (z.anchor_rssi[trial] - log_distance(away)) / np.sqrt(5)
    between = []
    for k, i, j in np.argwhere(link):
        d, ranged = np.linalg.norm(x[k, i] - x[k, j]), air.range[trial, k, i, j]
        between.append((ranged - d) / 0.1 * (ranged >= 0.2))
        if i < j or not link[k, j, i]:
            heard = [air.rssi[trial, k, i, j], air.rssi[trial, k, j, i]][: 1 + link[k, j, i]]
            between.append((np.mean(heard) - log_distance(d)) / np.sqrt(5))
    return np.concatenate([first.ravel(), moves.ravel(), own.ravel(), between])
