"""A simulated camera world in the manner of MRCLAM: wheeled robots that see landmarks and each other.

The true models are known here, so it shows whether an estimator is consistent, and it gives the conformance checks a
world with headings. A robot that faces the rim turns on the spot.
"""

from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict

from cooploc.estimators.interface import Array, World
from cooploc.estimators.models import Orientation, Sighting, Unicycle, wrap, wrap_heading
from cooploc.scenarios.seeds import Purpose, generator
from cooploc.scenarios.stream import Stream, Truth
from cooploc.scenarios.worlds.radio import Number, Positive, Robots, Share, Sigma, Ticks, TrialReadings, make_stream


class Camera(BaseModel):
    """Parameters of the world. All lengths in m, times in s, angles in rad."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robots: Robots = 3
    without_odometry: Number = 0  # so many robots, the last ones, have no odometry
    ticks: Ticks = 200
    tick: Positive = 0.1
    side: Positive = 8.0
    landmarks: Number = 6
    speed: Positive = 0.5  # [m/s]
    turn: Sigma = 0.3  # [rad/s] sd of the turn rate
    sigma_v: Positive = 0.04  # [m/s]
    sigma_omega: Positive = 0.15  # [rad/s]
    sigma_range: Positive = 0.15
    sigma_bearing: Positive = 0.02
    sigma_orientation: Positive | None = None  # of a teammate's heading, seen with the teammate; None: it is not seen
    sight: Positive = 4.0  # [m] how far a camera sees
    view: Positive = 0.6  # [rad] half its field of view
    prior_position: Positive = 0.1  # sd per axis
    prior_heading: Positive = 0.05  # sd
    drop: Share = 0.0

    def world(self) -> World:
        """Return this world as the team knows it in advance."""
        L, seen = self.side, Sighting(self.sigma_range, self.sigma_bearing)
        headings = {"orientation": Orientation(self.sigma_orientation)} if self.sigma_orientation else {}
        return World(
            robots=self.robots,
            tick=self.tick,
            arena=np.array([[0, 0], [L, L]], float),
            motion=Unicycle(self.sigma_v, self.sigma_omega, self.tick),
            sensors={"landmark": seen, "sighting": seen, **headings},
            landmarks=self._places(),
        )

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Simulate these trials; `world` is what the team assumes, which may differ from `world()`."""
        prior_sd = [self.prior_position, self.prior_position, self.prior_heading]
        readings, facing = zip(*(self._trial(seed, k, prior_sd) for k in trials), strict=True)
        extra = {"orientation": np.stack(facing)} if self.sigma_orientation else {}
        return make_stream(self, label, seed, trials, world, readings, prior_sd, extra=extra)

    def _trial(self, seed: int, k: int, prior_sd: list[float]) -> tuple[TrialReadings, Array]:
        start, path, u = self._drive(generator(seed, k, Purpose.TRUTH))
        rng = generator(seed, k, Purpose.SENSORS)
        n, nothing = self.robots, np.empty((self.ticks, self.robots, 0))
        prior = wrap_heading(start + rng.normal(0, 1, (n, 3)) * prior_sd)
        odometry = u + rng.normal(0, 1, u.shape) * [self.sigma_v, self.sigma_omega]
        odometry[:, n - min(n, self.without_odometry) :] = np.nan
        landmark = self._see(rng, path, np.broadcast_to(self._places(), (self.ticks, self.landmarks, 2)))
        sighting = self._see(rng, path, path[..., :2])
        sighting[:, np.arange(n), np.arange(n)] = np.nan
        link = generator(seed, k, Purpose.NETWORK).uniform(size=(self.ticks, n, n)) >= self.drop
        link &= ~np.eye(n, dtype=bool)
        readings = TrialReadings(path, prior, odometry, link, nothing, nothing, nothing, landmark, sighting)
        return readings, self._face(rng, path, sighting)

    def _drive(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Return the start (n, 3), poses (T, n, 3) and the true (v, omega) (T, n, 2)."""
        T, n = self.ticks, self.robots
        exact = Unicycle(0.0, 0.0, self.tick)
        middle = rng.uniform(0.2 * self.side, 0.8 * self.side, (n, 2))
        x = np.concatenate([middle, rng.uniform(-np.pi, np.pi, (n, 1))], -1)
        start, path, u = x, np.empty((T, n, 3)), np.empty((T, n, 2))
        u[..., 0] = self.speed
        u[..., 1] = rng.normal(0, self.turn, (T, n))
        dt = np.full(n, self.tick)
        for k in range(T):
            ahead = x[:, :2] + 0.1 * self.side * np.stack([np.cos(x[:, 2]), np.sin(x[:, 2])], -1)
            out = np.any((ahead < 0) | (ahead > self.side), axis=-1)
            u[k, out] = 0.0, 1.0
            x, _, _ = exact.move(x, u[k], dt)
            path[k] = x
        return start, path, u

    def _see(self, rng: np.random.Generator, path: Array, places: Array) -> Array:
        """Return range and bearing (T, n, m, 2) of places (T, m, 2), nan outside the field of view."""
        delta = places[:, None] - path[:, :, None, :2]
        bearing = wrap(np.arctan2(delta[..., 1], delta[..., 0]) - path[:, :, None, 2])
        reading = np.stack([np.hypot(delta[..., 0], delta[..., 1]), bearing], -1)
        seen = (reading[..., 0] < self.sight) & (np.abs(reading[..., 1]) < self.view)
        noisy = reading + rng.normal(0, 1, reading.shape) * [self.sigma_range, self.sigma_bearing]
        noisy[..., 1] = wrap(noisy[..., 1])
        return np.where(seen[..., None], noisy, np.nan)

    def _face(self, rng: np.random.Generator, path: Array, sighting: Array) -> Array:
        """Return heading (T, n, n, 1) of each teammate in sight, relative to the robot's own."""
        turn = path[:, None, :, 2] - path[:, :, None, 2]
        noisy = wrap(turn + rng.normal(0, self.sigma_orientation or 0.0, turn.shape))
        return np.where(np.isnan(sighting[..., 0]), np.nan, noisy)[..., None]

    def _places(self) -> Array:
        """Return landmarks (l, 2) evenly on a circle around the middle."""
        angle = 2 * np.pi * np.arange(self.landmarks) / max(self.landmarks, 1)
        return self.side * (0.5 + 0.35 * np.stack([np.cos(angle), np.sin(angle)], -1))
