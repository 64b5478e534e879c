"""A simulated camera world in the manner of MRCLAM: wheeled robots that see landmarks and each other.

The true models are known here, so it shows whether an estimator is consistent, and it gives the conformance checks a
world with headings. A robot that faces the rim turns on the spot.
"""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from cooploc.estimators.interface import Array, Belief, Senses, World
from cooploc.estimators.models import Orientation, Sighting, Unicycle, wrap, wrap_heading
from cooploc.scenarios.seeds import Purpose, generator
from cooploc.scenarios.stream import Air, Stream, Truth
from cooploc.scenarios.worlds.radio import Number, Positive, Robots, Sigma, Ticks


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
    drop: Annotated[float, Field(ge=0, le=1)] = 0.0

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
        """Truth and stream of these trials; `world` is what the team assumes, which may differ from `world()`."""
        parts = [self._trial(seed, k) for k in trials]
        path, prior, odometry, landmark, sighting, link, facing = (np.stack(part) for part in zip(*parts, strict=True))
        t, T, n, _ = path.shape
        trial = np.array(trials, np.int64)
        extra = {"orientation": facing} if self.sigma_orientation else {}
        spread = np.diag([self.prior_position**2, self.prior_position**2, self.prior_heading**2])
        stream = Stream(
            scenario=label,
            seed=seed,
            trial=trial,
            time=self.tick * np.arange(1, T + 1),
            world=world,
            prior=Belief(prior, np.broadcast_to(spread, (t, n, 3, 3)).copy()),
            senses=Senses(odometry, np.full((t, T, n), self.tick), np.empty((t, T, n, 0)), landmark, sighting, extra),
            air=Air(link.astype(bool), np.empty((t, T, n, 0)), np.empty((t, T, n, 0))),
            notes={"world": type(self).__name__, "parameters": self.model_dump(), "prior": "true start + noise"},
        )
        return Truth(label, trial, path, np.ones(path.shape[:3], bool), self.world().arena, stream.hashes), stream

    def _trial(self, seed: int, k: int) -> tuple[Array, ...]:
        start, path, u = self._drive(generator(seed, k, Purpose.TRUTH))
        rng = generator(seed, k, Purpose.SENSORS)
        n = self.robots
        spread = [self.prior_position, self.prior_position, self.prior_heading]
        prior = wrap_heading(start + rng.normal(0, 1, (n, 3)) * spread)
        odometry = u + rng.normal(0, 1, u.shape) * [self.sigma_v, self.sigma_omega]
        odometry[:, n - min(n, self.without_odometry) :] = np.nan
        landmark = self._see(rng, path, np.broadcast_to(self._places(), (self.ticks, self.landmarks, 2)))
        sighting = self._see(rng, path, path[..., :2])
        sighting[:, np.arange(n), np.arange(n)] = np.nan
        link = generator(seed, k, Purpose.NETWORK).uniform(size=(self.ticks, n, n)) >= self.drop
        linked = (link & ~np.eye(n, dtype=bool)).astype(float)
        return path, prior, odometry, landmark, sighting, linked, self._face(rng, path, sighting)

    def _drive(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Start (n, 3), poses (T, n, 3) and the true (v, omega) (T, n, 2)."""
        T, n = self.ticks, self.robots
        exact = Unicycle(0.0, 0.0, self.tick)
        x = np.concatenate(
            [rng.uniform(0.2 * self.side, 0.8 * self.side, (n, 2)), rng.uniform(-np.pi, np.pi, (n, 1))], -1
        )
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
        """Range and bearing (T, n, m, 2) of places (T, m, 2), nan outside the field of view."""
        delta = places[:, None] - path[:, :, None, :2]
        reading = np.stack(
            [np.hypot(delta[..., 0], delta[..., 1]), np.arctan2(delta[..., 1], delta[..., 0]) - path[:, :, None, 2]], -1
        )
        reading[..., 1] = wrap(reading[..., 1])
        seen = (reading[..., 0] < self.sight) & (np.abs(reading[..., 1]) < self.view)
        noisy = reading + rng.normal(0, 1, reading.shape) * [self.sigma_range, self.sigma_bearing]
        noisy[..., 1] = wrap(noisy[..., 1])
        return np.where(seen[..., None], noisy, np.nan)

    def _face(self, rng: np.random.Generator, path: Array, sighting: Array) -> Array:
        """Heading (T, n, n, 1) of each teammate in sight, relative to the robot's own."""
        turn = path[:, None, :, 2] - path[:, :, None, 2]
        noisy = wrap(turn + rng.normal(0, self.sigma_orientation or 0.0, turn.shape))
        return np.where(np.isnan(sighting[..., 0]), np.nan, noisy)[..., None]

    def _places(self) -> Array:
        """Landmarks (l, 2) evenly on a circle around the middle."""
        angle = 2 * np.pi * np.arange(self.landmarks) / max(self.landmarks, 1)
        return self.side * (0.5 + 0.35 * np.stack([np.cos(angle), np.sin(angle)], -1))
