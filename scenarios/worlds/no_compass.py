"""The radio arena without a compass: wheeled robots whose heading is part of what they must estimate.

The radio is that of `radio_arena.py`, and so are speed, turns and the noise of a step. Odometry is speed and turn rate,
so the heading drifts. A robot that would leave the arena turns on the spot.
"""

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from cooploc.estimators.interface import Array, Belief, Senses, World
from cooploc.estimators.models import Unicycle, wrap_heading
from cooploc.scenarios.seeds import Purpose, generator
from cooploc.scenarios.stream import Air, Stream, Truth
from cooploc.scenarios.worlds.radio import Paper, Positive, Share, Sigma


class NoCompass(BaseModel):
    """Parameters of the world. All lengths in m, times in s, angles in rad, powers in dB."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robots: Annotated[int, Field(ge=1)] = 3
    ticks: Annotated[int, Field(ge=1)] = 200
    tick: Positive = 1.0
    side: Positive = 6.0
    speed: Positive = 0.1  # [m/s] on average
    turn: Sigma = 0.5  # [rad/s] sd of the turn rate
    sigma_v: Positive = 0.02  # [m/s] of odometry
    sigma_omega: Positive = 0.1  # [rad/s] of odometry
    prior_sigma: Positive = 0.5  # sd per axis, of the initial position
    prior_heading: Positive = 1.8  # sd of the initial heading; that of a uniform one is 1.81
    eta: Positive = 3.0
    shadowing: Sigma = 2.0
    fast: Sigma = 1.0
    range_sigma: Positive = 0.1
    drop: Share = 0.0

    @property
    def radio(self) -> Paper:
        """The same arena, whose robots have a compass."""
        shared = set(NoCompass.model_fields) & set(Paper.model_fields)
        return Paper(**{name: getattr(self, name) for name in shared - {"turn"}}, step=self.speed * self.tick)

    def world(self) -> World:
        """Return this world as the team knows it in advance."""
        arena = self.radio.world()
        return World(
            robots=self.robots,
            tick=self.tick,
            arena=arena.arena,
            motion=Unicycle(self.sigma_v, self.sigma_omega, self.tick),
            sensors=arena.sensors,
            anchors=arena.anchors,
        )

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Truth and stream of these trials; `world` is what the team assumes, which may differ from `world()`."""
        parts = [self._trial(seed, k) for k in trials]
        path, prior, odometry, anchor, link, rssi, ranged = (np.stack(part) for part in zip(*parts, strict=True))
        t, T, n, _ = path.shape
        trial, nothing = np.array(trials, np.int64), np.empty((t, T, n, 0, 2))
        spread = np.diag([self.prior_sigma**2, self.prior_sigma**2, self.prior_heading**2])
        stream = Stream(
            scenario=label,
            seed=seed,
            trial=trial,
            time=self.tick * np.arange(1, T + 1),
            world=world,
            prior=Belief(prior, np.broadcast_to(spread, (t, n, 3, 3)).copy()),
            senses=Senses(odometry, np.full((t, T, n), self.tick), anchor, nothing, nothing, {}),
            air=Air(link, rssi, ranged),
            notes={"world": type(self).__name__, "parameters": self.model_dump(), "prior": "true start + noise"},
        )
        return Truth(label, trial, path, np.ones(path.shape[:3], bool), self.world().arena, stream.hashes), stream

    def _trial(self, seed: int, k: int) -> tuple[Any, ...]:
        start, path, u = self._drive(generator(seed, k, Purpose.TRUTH))
        wake = np.ones(path.shape[:2], bool)
        sensed = self.radio.sense(seed, k, start[:, :2], path[..., :2], wake)
        rng = generator(seed, k, Purpose.WHEELS)
        heading = start[:, 2:] + rng.normal(0, self.prior_heading, (self.robots, 1))
        prior = wrap_heading(np.concatenate([sensed.prior, heading], -1))
        odometry = u + rng.normal(0, 1, u.shape) * [self.sigma_v, self.sigma_omega]
        return path, prior, odometry, sensed.anchor_rssi, sensed.link, sensed.rssi, sensed.range

    def _drive(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Start (n, 3), poses (T, n, 3) and the true (v, omega) (T, n, 2)."""
        T, n, exact = self.ticks, self.robots, Unicycle(0.0, 0.0, self.tick)
        x = np.concatenate([rng.uniform(0, self.side, (n, 2)), rng.uniform(-np.pi, np.pi, (n, 1))], -1)
        start, path, dt = x, np.empty((T, n, 3)), np.full(n, self.tick)
        u = np.stack([self.speed * rng.uniform(0.5, 1.5, (T, n)), rng.normal(0, self.turn, (T, n))], -1)
        for k in range(T):
            there, _, _ = exact.move(x, u[k], dt)
            out = np.any((there[:, :2] < 0) | (there[:, :2] > self.side), axis=-1)
            u[k, out] = 0.0, 1.0 / self.tick
            path[k] = x = exact.move(x, u[k], dt)[0]
        return start, path, u
