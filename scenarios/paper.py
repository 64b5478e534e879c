"""The simulated world of Latif & Parasuraman: robots on random walks in a square with radio nodes on its corners.

The defaults are the `paper` preset; each number's reason is beside it. Every random number of a trial comes from that
trial's own generators, so a trial is the same whatever else is simulated with it.
"""

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from cooploc.estimators.interface import Array, Belief, Mask, Senses, World
from cooploc.estimators.models import NEAR, Displacement, LogDistance, Range
from cooploc.scenarios.seeds import Purpose, generator
from cooploc.scenarios.stream import Air, Stream, Truth

Positive = Annotated[float, Field(gt=0)]
Sigma = Annotated[float, Field(ge=0)]


class Paper(BaseModel):
    """Parameters of the world. All lengths in m, times in s, powers in dB."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robots: Annotated[int, Field(ge=1)] = 3
    ticks: Annotated[int, Field(ge=1)] = 200
    tick: Positive = 1.0  # 1 Hz, as the authors' robot reports
    side: Positive = 6.0
    step: Positive = 0.1  # mean path per tick; their robot moves at 0.05 to 0.15 m/s
    turn: Sigma = 0.5  # [rad] sd of the change of direction per tick
    odometry_sigma: Sigma = 0.02  # per axis and tick
    prior_sigma: Sigma = 0.5  # per axis, of the initial position
    A: float = -40.0  # [dBm] at 1 m, the authors' code
    eta: Positive = 3.0  # path-loss exponent, the authors' code
    shadowing: Sigma = 2.0  # their value; here independent per anchor link and reciprocal per pair of robots
    fast: Sigma = 1.0  # fast noise, independent per reading
    range_sigma: Positive = 0.1  # ultra-wide-band class
    drop: Annotated[float, Field(ge=0, le=1)] = 0.0  # share of robot-to-robot packets that are lost

    def world(self) -> World:
        """What the team is told of this world."""
        L = self.side
        rssi = LogDistance(self.A, self.eta, float(np.hypot(self.shadowing, self.fast)))
        return World(
            robots=self.robots,
            tick=self.tick,
            arena=np.array([[0, 0], [L, L]], float),
            motion=Displacement(self.odometry_sigma, self.tick),
            sensors={"anchor_rssi": rssi, "radio_rssi": rssi, "radio_range": Range(self.range_sigma)},
            anchors=self.anchors(),
        )

    def anchors(self) -> Array:
        """N1 .. N4 (4, 2): the only order of corners that fits both gradient equations of the paper."""
        return np.array([[0, 0], [0, 1], [1, 1], [1, 0]]) * self.side

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Truth and stream of these trials. `world` is what the team is told, true or not."""
        start, path = self._walk(seed, trials)
        trial = np.array(trials, np.int64)
        readings = [self._sense(generator(seed, k, Purpose.SENSORS), start[i], path[i]) for i, k in enumerate(trials)]
        links = [self._links(generator(seed, k, Purpose.NETWORK)) for k in trials]
        odometry, anchor, pair, distance, prior = (np.stack(part) for part in zip(*readings, strict=True))
        t, T, n, _ = path.shape
        nothing = np.empty((t, T, n, 0, 2))
        stream = Stream(
            scenario=label,
            seed=seed,
            trial=trial,
            time=self.tick * np.arange(1, T + 1),
            world=world,
            prior=Belief(prior, np.broadcast_to(self.prior_sigma**2 * np.eye(2), (t, n, 2, 2)).copy()),
            senses=Senses(odometry, np.full((t, T, n), self.tick), anchor, nothing, nothing, {}),
            air=Air(np.stack(links), pair, distance),
            notes={
                "world": type(self).__name__,
                "parameters": self.model_dump(),
                "prior": "true start + noise of prior_sigma per axis",
            },
        )
        truth = Truth(label, trial, path, np.ones(path.shape[:3], bool), self.world().arena, stream.hashes)
        return truth, stream

    def _walk(self, seed: int, trials: Sequence[int]) -> tuple[Array, Array]:
        """Starts (t, n, 2) and positions (t, T, n, 2): random walks reflected at the walls."""
        draws = [self._steps(generator(seed, k, Purpose.TRUTH)) for k in trials]
        start, heading, length, turn = (np.stack(part) for part in zip(*draws, strict=True))
        x, path = start, np.empty((len(trials), self.ticks, self.robots, 2))
        for k in range(self.ticks):
            heading = heading + turn[:, k]
            x = x + length[:, k, :, None] * np.stack([np.cos(heading), np.sin(heading)], -1)
            out = (x < 0) | (x > self.side)
            x = self.side - np.abs(self.side - np.abs(x))
            heading = np.where(out[..., 0], np.pi - heading, heading)
            heading = np.where(out[..., 1], -heading, heading)
            path[:, k] = x
        return start, path

    def _steps(self, rng: np.random.Generator) -> tuple[Array, Array, Array, Array]:
        T, n = self.ticks, self.robots
        return (
            rng.uniform(0, self.side, (n, 2)),
            rng.uniform(-np.pi, np.pi, n),
            self.step * rng.uniform(0.5, 1.5, (T, n)),
            rng.normal(0, self.turn, (T, n)),
        )

    def _sense(self, rng: np.random.Generator, start: Array, path: Array) -> "Readings":
        """One trial's readings of its true path (T, n, 2)."""
        T, n, _ = path.shape
        prior = start + rng.normal(0, self.prior_sigma, (n, 2))
        moves = np.diff(path, axis=0, prepend=start[None])
        odometry = moves + rng.normal(0, self.odometry_sigma, moves.shape)
        anchor = self._rssi(_distance(path[:, :, None], self.anchors()))
        anchor = anchor + rng.normal(0, self.shadowing, anchor.shape) + rng.normal(0, self.fast, anchor.shape)
        d = _distance(path[:, :, None], path[:, None])
        own = np.eye(n, dtype=bool)
        shadow = np.triu(rng.normal(0, self.shadowing, d.shape), 1)
        rssi = self._rssi(d) + shadow + shadow.transpose(0, 2, 1) + rng.normal(0, self.fast, d.shape)
        distance = d + rng.normal(0, self.range_sigma, d.shape)
        return Readings(odometry, anchor, np.where(own, np.nan, rssi), np.where(own, np.nan, distance), prior)

    def _rssi(self, d: Array) -> Array:
        return self.A - 10 * self.eta * np.log10(np.maximum(d, NEAR))

    def _links(self, rng: np.random.Generator) -> Mask:
        """(T, receiver, sender), True where a packet gets through."""
        n = self.robots
        link: Mask = rng.uniform(size=(self.ticks, n, n)) >= self.drop
        return link & ~np.eye(n, dtype=bool)


class Readings(NamedTuple):
    """What one trial's robots sensed, with the tick first."""

    odometry: Array  # (T, n, 2)
    anchor_rssi: Array  # (T, n, 4)
    rssi: Array  # (T, n, n)
    range: Array  # (T, n, n)
    prior: Array  # (n, 2)


def _distance(a: Array, b: Array) -> Array:
    d: Array = np.sqrt(((a - b) ** 2).sum(-1))
    return d
