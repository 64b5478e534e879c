"""The simulated world of Latif & Parasuraman: robots on random walks in a square with radio nodes on its rim.

The defaults are those of the paper or of its authors' code; comments give the reasons. Every random number of a trial
comes from that trial's own generators, so a trial is the same whatever else is simulated with it, and robots walk the
same paths with or without walls, drops or sleep.

Source: E. Latif, R. Parasuraman, "Multi-Robot Synergistic Localization in Dynamic Environments", 2022.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from cooploc.estimators.interface import Array, Belief, Indices, Mask, Senses, World
from cooploc.estimators.models import NEAR, Displacement, LogDistance, Range
from cooploc.scenarios.seeds import Purpose, generator
from cooploc.scenarios.stream import Air, Stream, Truth

# Lines of sight: walls are segments, bodies are discs.


def walls_between(a: Array, b: Array, walls: Array) -> Indices:
    """Count the walls (w, 2, 2) that each line of sight a (..., 2) to b (..., 2) crosses; touching counts.

    Two segments cross where each one's ends lie on different sides of the other, or on it.
    """
    count = np.zeros(np.broadcast_shapes(a.shape, b.shape)[:-1], np.int64)
    for p, q in walls:
        across = (turn_sign(p, q, a) * turn_sign(p, q, b) <= 0) & (turn_sign(a, b, p) * turn_sign(a, b, q) <= 0)
        boxes_meet = (np.minimum(a, b) <= np.maximum(p, q)) & (np.maximum(a, b) >= np.minimum(p, q))
        count += across & boxes_meet.all(-1)  # collinear segments may lie apart
    return count


def bodies_between(a: Array, b: Array, centre: Array, radius: float) -> Mask:
    """Return a mask (..., m): the bodies (..., m, 2) that each line of sight a (..., 2) to b (..., 2) touches."""
    a, b = a[..., None, :], b[..., None, :]
    along = b - a
    length2 = np.maximum((along**2).sum(-1), np.finfo(float).tiny)
    share = np.clip(((centre - a) * along).sum(-1) / length2, 0.0, 1.0)
    nearest = a + share[..., None] * along
    return np.asarray(((centre - nearest) ** 2).sum(-1) <= radius**2)


def turn_sign(p: Array, q: Array, x: Array) -> Array:
    """Return the sign of the turn p, q, x: which side of the line through p and q the point x lies on."""
    u, v = q - p, x - p
    return np.asarray(np.sign(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]))


# Radio: path loss, shadowing with memory, and what blocks a link.


class Scene(NamedTuple):
    """The true surroundings of a trial, which block links. Estimators never see it."""

    walls: Array  # (w, 2, 2) [m]
    obstacles: Array  # (T, m, 2) [m]
    radius: float  # of obstacles, and of robots that block [m]
    anchor_blockers: Indices  # (T, n, a) things between a robot and an anchor
    robot_blockers: Indices  # (T, n, n) things between two robots


def find_blockers(
    path: Array, anchors: Array, walls: Array, obstacles: Array, radius: float, robots_block: bool
) -> Scene:
    """Count what stands between robots (T, n, 2), anchors (a, 2) and each other."""
    here, teammate = path[:, :, None], path[:, None]
    to_anchors, to_robots = walls_between(here, anchors, walls), walls_between(here, teammate, walls)
    if obstacles.shape[1]:
        bodies = obstacles[:, None, None]
        to_anchors = to_anchors + bodies_between(here, anchors, bodies, radius).sum(-1)
        to_robots = to_robots + bodies_between(here, teammate, bodies, radius).sum(-1)
    if robots_block:
        n = path.shape[1]
        own = np.eye(n, dtype=bool)
        third = ~(own[:, None] | own[None])  # (n, n, n): neither the one nor the other
        bodies = path[:, None, None]
        to_anchors = to_anchors + (bodies_between(here, anchors, bodies, radius) & ~own[:, None]).sum(-1)
        to_robots = to_robots + (bodies_between(here, teammate, bodies, radius) & third).sum(-1)
    return Scene(walls, obstacles, radius, to_anchors, to_robots)


def add_memory(white: Array, correlation: float) -> Array:
    """Turn white noise (T, ...) into a stationary AR(1) process of the same variance and this lag-1 correlation."""
    if correlation == 0:
        return white
    out, fresh = white.copy(), np.sqrt(1 - correlation**2)
    for k in range(1, len(white)):
        out[k] = correlation * out[k - 1] + fresh * white[k]
    return out


def distance(a: Array, b: Array) -> Array:
    """Return the distance of places (..., 2): by components, as numpy is slow at a sum over two."""
    return np.asarray(np.sqrt((a[..., 0] - b[..., 0]) ** 2 + (a[..., 1] - b[..., 1]) ** 2))


# Random walks in a square, reflected at its sides.


class WalkSteps(NamedTuple):
    """The steps of n bodies over T ticks."""

    start: Array  # (n, 2) [m]
    heading: Array  # (n,) [rad] before the first tick
    length: Array  # (T, n) [m]
    turn: Array  # (T, n) [rad]


def draw_steps(rng: np.random.Generator, ticks: int, n: int, side: float, step: float, turn: float) -> WalkSteps:
    """Draw uniform starts and headings, lengths of 0.5 to 1.5 `step`, normal turns of sd `turn`."""
    return WalkSteps(
        rng.uniform(0, side, (n, 2)),
        rng.uniform(-np.pi, np.pi, n),
        step * rng.uniform(0.5, 1.5, (ticks, n)),
        rng.normal(0, turn, (ticks, n)),
    )


def walk(draws: list[WalkSteps], side: float) -> tuple[Array, Array]:
    """Return starts (t, n, 2) and positions (t, T, n, 2) of several trials' walks."""
    start, heading, length, turn = (np.stack(part) for part in zip(*draws, strict=True))
    x, path = start, np.empty((*length.shape, 2))
    for k in range(length.shape[1] if path.size else 0):  # most worlds have no obstacles
        heading = heading + turn[:, k]
        x = x + length[:, k, :, None] * np.stack([np.cos(heading), np.sin(heading)], -1)
        out = (x < 0) | (x > side)
        x = side - np.abs(side - np.abs(x))
        heading = np.where(out[..., 0], np.pi - heading, heading)
        heading = np.where(out[..., 1], -heading, heading)
        path[:, k] = x
    return start, path


# Robots that sleep sense and send nothing; the next odometry and `dt` cover the time since the last waking.


def wake_mask(ticks: int, rate: Array, phase: Array) -> Mask:
    """Return the ticks in which each robot is awake (T, n).

    A robot of rate f wakes f times a tick on average, evenly, shifted by its phase.
    """
    count = np.floor(np.arange(ticks + 1)[:, None] * rate + phase + 1e-9)
    return np.asarray(count[1:] > count[:-1])


def ticks_since_waking(wake: Mask) -> Array:
    """Return the ticks covered (T, n) by a waking robot's odometry, 0 for one that sleeps."""
    k = np.arange(1, len(wake) + 1)[:, None]
    last = np.maximum.accumulate(np.where(wake, k, 0), axis=0)
    before = np.vstack([np.zeros_like(last[:1]), last[:-1]])
    return np.where(wake, k - before, 0).astype(float)


def sum_between_wakings(odometry: Array, wake: Mask) -> Array:
    """Sum per-tick displacements (T, n, 2) over what each waking covers; nan while asleep."""
    if wake.all():
        return odometry
    total = np.cumsum(odometry, axis=0)
    covered = ticks_since_waking(wake).astype(int)
    k = np.arange(len(wake))[:, None]
    start = k - covered  # the last waking, -1 before the first
    before = np.where((start >= 0)[..., None], total[np.maximum(start, 0), np.arange(wake.shape[1])], 0.0)
    return np.where(wake[..., None], total - before, np.nan)


class TrialReadings(NamedTuple):
    """True path and readings of one trial, with the tick first; width 0 where a channel does not exist."""

    path: Array  # (T, n, 2 or 3)
    prior: Array  # (n, 2 or 3)
    odometry: Array  # (T, n, 2)
    link: Mask  # (T, n, n)
    anchor_rssi: Array  # (T, n, a)
    rssi: Array  # (T, n, n)
    range: Array  # (T, n, n)
    landmark: Array  # (T, n, l, 2)
    sighting: Array  # (T, n, n, 2)


def make_stream(
    model: Any,
    label: str,
    seed: int,
    trials: Sequence[int],
    world: World,
    readings: Sequence[TrialReadings],
    prior_sd: Sequence[float],
    ticks: Array | None = None,  # (T, n) that odometry covers, 0 while a robot sleeps; one unless given
    extra: Mapping[str, Array] | None = None,  # channels (t, T, n, ...) of this world alone
) -> tuple[Truth, Stream]:
    """Return truth and stream of simulated trials."""
    parts = zip(*readings, strict=True)
    z = TrialReadings(*(np.stack(part) if len(part) > 1 else part[0][None] for part in parts))  # of one no copy
    t, T, n, d = z.path.shape
    ticks = np.ones((T, n)) if ticks is None else ticks
    dt = np.broadcast_to(model.tick * ticks, (t, T, n)).copy()
    stream = Stream(
        scenario=label,
        seed=seed,
        trial=np.array(trials, np.int64),
        time=model.tick * np.arange(1, T + 1),
        world=world,
        prior=Belief(z.prior, np.broadcast_to(np.diag([sd**2 for sd in prior_sd]), (t, n, d, d)).copy()),
        senses=Senses(z.odometry, dt, z.anchor_rssi, z.landmark, z.sighting, dict(extra or {})),
        air=Air(z.link, z.rssi, z.range),
        notes={
            "world": type(model).__name__,
            "parameters": model.model_dump(mode="json"),
            "prior": "true start + noise",
        },
    )
    valid = np.broadcast_to(ticks > 0, (t, T, n)).copy()
    return Truth(label, stream.trial, z.path, valid, model.world().arena, stream.hashes), stream


# The world.

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
    prior_sigma: Positive = 0.5  # per axis, of the initial position

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

    @model_validator(mode="after")
    def _steps_fit(self) -> "Paper":
        if 1.5 * self.step > self.side:
            raise ValueError(f"a step of {self.step} m leaves an arena of {self.side} m: make step at most side / 1.5")
        return self

    def world(self) -> World:
        """Return this world as the team knows it in advance."""
        L, quantum = self.side, self.rounding**2 / 12
        heard = LogDistance(self.A, self.eta, float(np.sqrt(self.shadowing**2 + self.fast**2 + quantum)))
        averaged = float(np.sqrt(self.shadowing**2 + self.fast**2 / self.samples + quantum))
        anchor = LogDistance(self.A, self.eta, averaged)
        return World(
            robots=self.robots,
            tick=self.tick,
            arena=np.array([[0, 0], [L, L]], float),
            motion=Displacement(self.odometry_sigma, self.tick),
            sensors={"anchor_rssi": anchor, "radio_rssi": heard, "radio_range": Range(self.range_sigma)},
            anchors=self.places(),
        )

    def places(self) -> Array:
        """Return anchors (a, 2): N1 .. N4 are (0,0) (0,L) (L,L) (L,0), the order that fits both gradient equations."""
        along = 4 * np.arange(self.anchors) / self.anchors
        corner = np.array([[0, 0], [0, 1], [1, 1], [1, 0], [0, 0]])
        k = along.astype(int)
        places: Array = self.side * (corner[k] + (along - k)[:, None] * (corner[k + 1] - corner[k]))
        return places

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Simulate these trials; `world` is what the team assumes, which may differ from `world()`."""
        walks = (self.ticks, self.robots, self.side, self.step, self.turn)
        draws = [draw_steps(generator(seed, k, Purpose.TRUTH), *walks) for k in trials]
        start, path = walk(draws, self.side)
        rate, phase = (np.resize(np.array(each), self.robots) for each in (self.rate, self.phase))
        wake = wake_mask(self.ticks, rate, phase)
        readings = [self.sense(seed, k, start[i], path[i], wake) for i, k in enumerate(trials)]
        prior_sd = [self.prior_sigma] * 2
        return make_stream(self, label, seed, trials, world, readings, prior_sd, ticks_since_waking(wake))

    def scene(self, seed: int, trial: int, path: Array) -> Scene:
        """Return walls, obstacles and blocked links of one trial whose robots take this path (T, n, 2)."""
        rng = generator(seed, trial, Purpose.OBSTACLES)
        steps = draw_steps(rng, self.ticks, self.obstacles, self.side, self.step, self.turn)
        _, bodies = walk([steps], self.side)
        walls = np.array(self.walls, float).reshape(-1, 2, 2)
        return find_blockers(path, self.places(), walls, bodies[0], self.body_radius, self.body_blocking)

    def sense(self, seed: int, trial: int, start: Array, path: Array, wake: Mask) -> TrialReadings:
        """Draw a trial's readings of its true path (T, n, 2), which begins at `start` (n, 2)."""
        rng = generator(seed, trial, Purpose.SENSORS)
        scene = self.scene(seed, trial, path)
        prior = start + rng.normal(0, self.prior_sigma, start.shape)
        moves = np.diff(path, axis=0, prepend=start[None])
        odometry = sum_between_wakings(moves + rng.normal(0, self.odometry_sigma, moves.shape), wake)
        anchor = self._anchor_rssi(rng, path, moves, scene)
        link, rssi, ranged = self._between_robots(rng, path, wake, scene, seed, trial)
        sensed = wake[..., None] & (distance(path[:, :, None], self.places()) <= self.radio_range)
        nothing = np.empty((*path.shape[:2], 0, 2))
        anchor = np.where(sensed, anchor, np.nan)
        return TrialReadings(path, prior, odometry, link, anchor, rssi, ranged, nothing, nothing)

    def _between_robots(
        self, rng: np.random.Generator, path: Array, wake: Mask, scene: Scene, seed: int, trial: int
    ) -> tuple[Mask, Array, Array]:
        """Draw link, RSSI and range between robots (T, receiver, sender)."""
        d = distance(path[:, :, None], path[:, None])
        others = ~np.eye(path.shape[1], dtype=bool) & (d <= self.radio_range)
        rssi = np.where(others, self._robot_rssi(rng, d, scene), np.nan)
        ranged = np.where(others, self._ranges(rng, d, scene, seed, trial), np.nan)
        arrives = generator(seed, trial, Purpose.NETWORK).uniform(size=d.shape) >= self.drop
        return arrives & others & wake[:, :, None] & wake[:, None], rssi, ranged

    def _anchor_rssi(self, rng: np.random.Generator, path: Array, moves: Array, scene: Scene) -> Array:
        """Return (T, n, a), each the mean of `samples` readings spread over the tick's path."""
        shape = scene.anchor_blockers.shape
        back = 1 - (np.arange(self.samples) + 1) / self.samples
        where = path - back[:, None, None, None] * moves
        clear = self._rssi(distance(where[:, :, :, None], self.places())).mean(0)
        shadow = add_memory(rng.normal(0, self.shadowing, shape), self.shadow_correlation)
        fast = rng.normal(0, self.fast, (self.samples, *shape)).mean(0)
        return self._round(clear + shadow + fast - self.attenuation * scene.anchor_blockers)

    def _robot_rssi(self, rng: np.random.Generator, d: Array, scene: Scene) -> Array:
        """Return (T, receiver, sender); shadowing is the same in both directions."""
        shadow = add_memory(np.triu(rng.normal(0, self.shadowing, d.shape), 1), self.shadow_correlation)
        both = self._rssi(d) + shadow + shadow.transpose(0, 2, 1) - self.attenuation * scene.robot_blockers
        return self._round(both + rng.normal(0, self.fast, d.shape))

    def _ranges(self, rng: np.random.Generator, d: Array, scene: Scene, seed: int, trial: int) -> Array:
        """Return (T, receiver, sender) at true distances d; other worlds draw from generators of `seed` and `trial`."""
        return d + rng.normal(0, self.range_sigma, d.shape) + self.nlos_range_bias * (scene.robot_blockers > 0)

    def _round(self, reading: Array) -> Array:
        return np.round(reading / self.rounding) * self.rounding if self.rounding else reading

    def _rssi(self, d: Array) -> Array:
        return self.A - 10 * self.eta * np.log10(np.maximum(d, NEAR))
