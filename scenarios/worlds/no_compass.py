"""The radio arena without a compass: wheeled robots whose heading is part of what they must estimate.

The radio is that of `radio.py`, and so are speed, turns and the noise of a step. Odometry is speed and turn rate,
so the heading drifts. A robot that would leave the arena turns on the spot.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pydantic import BaseModel, ConfigDict

from cooploc.estimators.interface import Array, World
from cooploc.estimators.models import Unicycle, wrap_heading
from cooploc.scenarios.seeds import Purpose, generator
from cooploc.scenarios.stream import Stream, Truth
from cooploc.scenarios.worlds.radio import Paper, Positive, Robots, Share, Sigma, Ticks, TrialReadings, make_stream


class NoCompass(BaseModel):
    """Parameters of the world. All lengths in m, times in s, angles in rad, powers in dB."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robots: Robots = 3
    ticks: Ticks = 200
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
        """Return the same arena, whose robots have a compass."""
        shared = set(NoCompass.model_fields) & set(Paper.model_fields)
        unused = self.side / 2  # a step that fits the arena; only obstacles would take it
        return Paper(**{name: getattr(self, name) for name in shared - {"turn"}}, step=unused)

    def world(self) -> World:
        """Return this world as the team knows it in advance."""
        return replace(self.radio.world(), motion=Unicycle(self.sigma_v, self.sigma_omega, self.tick))

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Simulate these trials; `world` is what the team assumes, which may differ from `world()`."""
        prior_sd = [self.prior_sigma, self.prior_sigma, self.prior_heading]
        return make_stream(self, label, seed, trials, world, [self._trial(seed, k) for k in trials], prior_sd)

    def _trial(self, seed: int, k: int) -> TrialReadings:
        start, path, u = self._drive(generator(seed, k, Purpose.TRUTH))
        sensed = self.radio.sense(seed, k, start[:, :2], path[..., :2], np.ones(path.shape[:2], bool))
        rng = generator(seed, k, Purpose.WHEELS)
        heading = start[:, 2:] + rng.normal(0, self.prior_heading, (self.robots, 1))
        prior = wrap_heading(np.concatenate([sensed.prior, heading], -1))
        odometry = u + rng.normal(0, 1, u.shape) * [self.sigma_v, self.sigma_omega]
        return sensed._replace(path=path, prior=prior, odometry=odometry)

    def _drive(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Return the start (n, 3), poses (T, n, 3) and the true (v, omega) (T, n, 2)."""
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
