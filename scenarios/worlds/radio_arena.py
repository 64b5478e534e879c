"""The simulated world of Latif & Parasuraman: robots on random walks in a square with radio nodes on its rim.

The defaults are those of the paper or of its authors' code; comments give the reasons. Every random number of a trial
comes from that trial's own generators, so a trial is the same whatever else is simulated with it, and robots walk the
same paths with or without walls, drops or sleep.

Source: E. Latif, R. Parasuraman, "Multi-Robot Synergistic Localization in Dynamic Environments", 2022.
"""

from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from cooploc.estimators.interface import Array, Belief, Mask, Senses, World
from cooploc.estimators.models.motion import Displacement
from cooploc.estimators.models.sensors import NEAR, LogDistance, Range
from cooploc.scenarios.seeds import Purpose, generator
from cooploc.scenarios.stream import Air, Stream, Truth
from cooploc.scenarios.worlds import blocks, duty_cycle, radio_channel, random_walk

Finite: dict[str, Any] = {"allow_inf_nan": False}
LARGEST = 1e6  # of any number below, in its unit
Positive = Annotated[float, Field(gt=0, le=LARGEST, **Finite)]
Sigma = Annotated[float, Field(ge=0, le=LARGEST, **Finite)]
Signed = Annotated[float, Field(ge=-LARGEST, le=LARGEST, **Finite)]
Robots = Annotated[int, Field(ge=1, le=10_000)]
Ticks = Annotated[int, Field(ge=1, le=10_000_000)]
AtLeastOne = Annotated[int, Field(ge=1, le=10_000)]
Number = Annotated[int, Field(ge=0, le=10_000)]
Share = Annotated[float, Field(ge=0, le=1)]


class Paper(BaseModel):
    """Parameters of the world. All lengths in m, times in s, powers in dB."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robots: Robots = 3
    ticks: Ticks = 200
    tick: Positive = 1.0  # 1 Hz, as the authors' robot reports
    side: Positive = 6.0
    anchors: AtLeastOne = 4  # evenly along the rim from (0, 0); four stand on the corners
    step: Positive = 0.1  # mean path per tick; their robot moves at 0.05 to 0.15 m/s
    turn: Sigma = 0.5  # [rad] sd of the change of direction per tick
    odometry_sigma: Sigma = 0.02  # per axis and tick
    prior_sigma: Sigma = 0.5  # per axis, of the initial position

    A: Signed = -40.0  # [dBm] at 1 m, the authors' code
    eta: Positive = 3.0  # path-loss exponent, the authors' code
    shadowing: Sigma = 2.0  # their value; here independent per anchor link and reciprocal per pair of robots
    shadow_correlation: Annotated[float, Field(ge=0, lt=1)] = 0.0  # of shadowing, from tick to tick
    fast: Sigma = 1.0  # fast noise, independent per reading
    rounding: Sigma = 0.0  # readings are whole multiples of this
    range_sigma: Positive = 0.1  # ultra-wide-band class
    samples: AtLeastOne = 1  # readings of each anchor in a tick that are averaged (their Algorithm 1)

    walls: tuple[tuple[Signed, Signed, Signed, Signed], ...] = ()  # x1, y1, x2, y2
    obstacles: Number = 0  # wandering bodies, not robots of the team
    body_radius: Positive = 0.2
    body_blocking: bool = False  # robots of the team stand in the way too
    attenuation: Sigma = 10.0  # per thing in the way, their value
    nlos_range_bias: Sigma = 0.0  # added to ranges with something in the way

    drop: Share = 0.0  # share of robot-to-robot packets that are lost
    radio_range: Annotated[float, Field(gt=0)] = np.inf  # nothing is heard beyond
    rate: tuple[Annotated[float, Field(gt=0, le=1)], ...] = (1.0,)  # wakings per tick of each robot, repeated
    phase: tuple[Annotated[float, Field(ge=0, lt=1)], ...] = (0.0,)  # of each robot, repeated

    @property
    def at_once(self) -> int:
        """How many ticks are drawn together of what robots hear of each other: all where something remembers a tick."""
        return self.ticks if self.shadow_correlation else blocks.ticks(self.ticks, self.robots)

    @model_validator(mode="after")
    def _steps_fit(self) -> "Paper":
        if 1.5 * self.step > self.side:
            raise ValueError(f"a step of {self.step} m leaves an arena of {self.side} m: make step at most side / 1.5")
        return self

    def world(self) -> World:
        """What the team knows of this world in advance."""
        L, quantum = self.side, self.rounding**2 / 12
        heard = LogDistance(self.A, self.eta, float(np.sqrt(self.shadowing**2 + self.fast**2 + quantum)))
        averaged = float(np.sqrt(self.shadowing**2 + self.fast**2 / self.samples + quantum))
        return World(
            robots=self.robots,
            tick=self.tick,
            arena=np.array([[0, 0], [L, L]], float),
            motion=Displacement(self.odometry_sigma, self.tick),
            sensors={
                "anchor_rssi": LogDistance(self.A, self.eta, averaged),
                "radio_rssi": heard,
                "radio_range": Range(self.range_sigma),
            },
            anchors=self.places(),
        )

    def places(self) -> Array:
        """Anchors (a, 2): N1 .. N4 are (0,0) (0,L) (L,L) (L,0), the order that fits both gradient equations."""
        along = 4 * np.arange(self.anchors) / self.anchors
        corner = np.array([[0, 0], [0, 1], [1, 1], [1, 0], [0, 0]])
        k = along.astype(int)
        places: Array = self.side * (corner[k] + (along - k)[:, None] * (corner[k + 1] - corner[k]))
        return places

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Truth and stream of these trials; `world` is what the team assumes, which may differ from `world()`."""
        start, path = self._walk(seed, trials)
        wake = self._awake()
        trial = np.array(trials, np.int64)
        sensed = [self.sense(seed, k, start[i], path[i], wake) for i, k in enumerate(trials)]
        odometry, anchor, link, rssi, ranged, prior = (blocks.stack(part) for part in zip(*sensed, strict=True))
        t, T, n, _ = path.shape
        nothing = np.empty((t, T, n, 0, 2))
        dt = np.broadcast_to(self.tick * duty_cycle.since(wake), (t, T, n)).copy()
        stream = Stream(
            scenario=label,
            seed=seed,
            trial=trial,
            time=self.tick * np.arange(1, T + 1),
            world=world,
            prior=Belief(prior, np.broadcast_to(self.prior_sigma**2 * np.eye(2), (t, n, 2, 2)).copy()),
            senses=Senses(odometry, dt, anchor, nothing, nothing, {}),
            air=Air(link, rssi, ranged),
            notes={
                "world": type(self).__name__,
                "parameters": self.model_dump(mode="json"),
                "prior": "true start + noise of prior_sigma per axis",
            },
        )
        valid = np.broadcast_to(wake, (t, T, n)).copy()
        return Truth(label, trial, path, valid, self.world().arena, stream.hashes), stream

    def scene(self, seed: int, trial: int, path: Array) -> radio_channel.Scene:
        """What stands in the way in one trial whose robots take this path (T, n, 2)."""
        rng = generator(seed, trial, Purpose.OBSTACLES)
        steps = random_walk.draw(rng, self.ticks, self.obstacles, self.side, self.step, self.turn)
        _, bodies = random_walk.walk([steps], self.side)
        walls = np.array(self.walls, float).reshape(-1, 2, 2)
        return radio_channel.scene(path, self.places(), walls, bodies[0], self.body_radius, self.body_blocking)

    def _walk(self, seed: int, trials: Sequence[int]) -> tuple[Array, Array]:
        draw = (self.ticks, self.robots, self.side, self.step, self.turn)
        return random_walk.walk([random_walk.draw(generator(seed, k, Purpose.TRUTH), *draw) for k in trials], self.side)

    def _awake(self) -> Mask:
        rate, phase = (np.resize(np.array(each), self.robots) for each in (self.rate, self.phase))
        return duty_cycle.awake(self.ticks, rate, phase)

    def sense(self, seed: int, trial: int, start: Array, path: Array, wake: Mask) -> "Readings":
        """One trial's readings of its true path (T, n, 2), which begins at `start` (n, 2)."""
        rng = generator(seed, trial, Purpose.SENSORS)
        scene = self.scene(seed, trial, path)
        prior = start + rng.normal(0, self.prior_sigma, start.shape)
        moves = np.diff(path, axis=0, prepend=start[None])
        odometry = duty_cycle.gathered(moves + rng.normal(0, self.odometry_sigma, moves.shape), wake)
        anchor = self._anchor_rssi(rng, path, moves, scene)
        link, rssi, ranged = self._between_robots(rng, path, wake, scene, seed, trial)
        sensed = wake[..., None] & (radio_channel.distance(path[:, :, None], self.places()) <= self.radio_range)
        return Readings(odometry, np.where(sensed, anchor, np.nan), link, rssi, ranged, prior)

    def _between_robots(
        self, rng: np.random.Generator, path: Array, wake: Mask, scene: radio_channel.Scene, seed: int, trial: int
    ) -> tuple[Mask, Array, Array]:
        """What robots hear of each other: link, RSSI and range (T, receiver, sender), some ticks at a time.

        Of a large team all ticks at once would not fit into memory. The numbers drawn are the same: shadowing of all
        ticks comes first, then fast noise, then ranges, each from where the generator stands by then.
        """
        T, n = path.shape[:2]
        block = min(T, self.at_once)
        rngs = (rng, rng, rng) if block == T else blocks.apart(rng, T * n * n, 3)
        network, others = generator(seed, trial, Purpose.NETWORK), ~np.eye(n, dtype=bool)
        link, rssi, ranged = np.empty((T, n, n), bool), np.empty((T, n, n)), np.empty((T, n, n))
        for k in range(0, T, block):
            now = slice(k, k + block)
            d = radio_channel.distance(path[now, :, None], path[now, None])
            seen, near = scene._replace(robot_blockers=scene.robot_blockers[now]), d <= self.radio_range
            rssi[now] = np.where(near & others, self._robot_rssi(rngs[0], rngs[1], d, seen), np.nan)
            ranged[now] = np.where(near & others, self._ranges(rngs[2], d, seen, seed, trial), np.nan)
            link[now] = self._links(network, len(d)) & near & wake[now, :, None] & wake[now, None]
        return link, rssi, ranged

    def _anchor_rssi(self, rng: np.random.Generator, path: Array, moves: Array, scene: radio_channel.Scene) -> Array:
        """(T, n, a), each the mean of `samples` readings spread over the tick's path."""
        shape = scene.anchor_blockers.shape
        back = 1 - (np.arange(self.samples) + 1) / self.samples
        where = path - back[:, None, None, None] * moves
        clear = self._rssi(radio_channel.distance(where[:, :, :, None], self.places())).mean(0)
        shadow = radio_channel.correlated(rng.normal(0, self.shadowing, shape), self.shadow_correlation)
        fast = rng.normal(0, self.fast, (self.samples, *shape)).mean(0)
        return radio_channel.rounded(clear + shadow + fast - self.attenuation * scene.anchor_blockers, self.rounding)

    def _robot_rssi(
        self, slow: np.random.Generator, fast: np.random.Generator, d: Array, scene: radio_channel.Scene
    ) -> Array:
        """(T, receiver, sender); shadowing, drawn by `slow`, is the same in both directions."""
        shadow = radio_channel.correlated(np.triu(slow.normal(0, self.shadowing, d.shape), 1), self.shadow_correlation)
        both = self._rssi(d) + shadow + shadow.transpose(0, 2, 1) - self.attenuation * scene.robot_blockers
        return radio_channel.rounded(both + fast.normal(0, self.fast, d.shape), self.rounding)

    def _ranges(self, rng: np.random.Generator, d: Array, scene: radio_channel.Scene, seed: int, trial: int) -> Array:
        """(T, receiver, sender), at true distances d; other worlds draw from generators of `seed` and `trial`."""
        return d + rng.normal(0, self.range_sigma, d.shape) + self.nlos_range_bias * (scene.robot_blockers > 0)

    def _rssi(self, d: Array) -> Array:
        return self.A - 10 * self.eta * np.log10(np.maximum(d, NEAR))

    def _links(self, rng: np.random.Generator, ticks: int) -> Mask:
        """(T, receiver, sender), True where a packet gets through, in so many more ticks."""
        n = self.robots
        link: Mask = rng.uniform(size=(ticks, n, n)) >= self.drop
        return link & ~np.eye(n, dtype=bool)


class Readings(NamedTuple):
    """What one trial's robots sensed, with the tick first."""

    odometry: Array  # (T, n, 2)
    anchor_rssi: Array  # (T, n, a)
    link: Mask  # (T, n, n)
    rssi: Array  # (T, n, n)
    range: Array  # (T, n, n)
    prior: Array  # (n, 2)
