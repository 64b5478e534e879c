"""A robot's own particle filter on odometry and anchor RSSI: what ARL is, and what MRSL and CTRN build on.

Source: Latif & Parasuraman, "Individual localization", eqs. (1)-(5); P. Parashar et al., "Particle filter based
localization of access points using direction of arrival on mobile robots", 2020.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from cooploc.estimators.compiled import random_numbers
from cooploc.estimators.interface import Array, Belief, Keys, Mask, Rows, Senses, World
from cooploc.estimators.models.angles import circular_mean
from cooploc.estimators.models.gradient_doa import gradient_doa
from cooploc.estimators.particle import likelihood
from cooploc.estimators.particle.steps import advance, conclude, mean, renew, spread, summary, weights


@dataclass(frozen=True)
class Settings:
    """Parameters of a robot's own particle filter. The defaults are the readings of the `paper` preset."""

    particles: int = 200
    own: Literal["doa", "rssi"] = "doa"  # the DOA made of the four anchor readings, or their raw likelihoods
    density: Literal["constant", "exact"] = "constant"  # Gaussian angle error, or the exact projected normal
    M: int = 5  # path samples in the product of eq. (5)
    K: int = 5  # DOAs in the moving average
    decay: float = 0.99  # weight of a DOA per tick of age
    temper: bool = True  # exponent 1/M: a recursive filter would otherwise count every DOA M times
    point: Literal["mean", "max"] = "mean"  # "max" is the paper's: the particle of largest weight
    proposal: Literal["walk", "box"] = "walk"  # "box" is the paper's: uniform around the present estimate, every tick
    box: float = 0.5  # [m] half-width of that box

    def __post_init__(self) -> None:
        for name, value, least in (("particles", self.particles, 2), ("M", self.M, 1), ("K", self.K, 1)):
            if value < least:
                raise ValueError(f"{name} is {value}; it must be at least {least}")
        if not (0 < self.decay <= 1 and self.box > 0):
            raise ValueError(f"decay is {self.decay} and box is {self.box}; they must lie in (0, 1] and above 0")


class Own(NamedTuple):
    """What a robot remembers. The newest entry of each memory comes first."""

    x: Array  # (r, N, d)  particles
    logw: Array  # (r, N)     log-weights, unnormalised
    due: Mask  # (r,)       rows to be renewed when the next tick begins
    told: Belief | None  # what others are told where it is known already
    belief: Belief  # x (r, d), P (r, d, d)  what was concluded last
    key: Keys  # (r, 2)
    tick: int
    doa: Array  # (r, K)     raw angles [rad]
    smooth: Array  # (r, M)     averaged angles [rad]
    trail: Array  # (r, M, 2)  where the robot was then, seen from where it is now [m]
    world: World


def init(p: Settings, prior: Belief, world: World, rows: Rows) -> Own:
    """Particles drawn from the prior, and empty memories."""
    if p.own == "doa":
        gradient_doa(world)  # refuses a world without four corners before anything runs
    r = len(prior.x)
    x = spread(prior, rows.key, p.particles)
    empty = np.full((r, p.K), np.nan), np.full((r, p.M), np.nan), np.zeros((r, p.M, 2))
    return Own(x, np.zeros(x.shape[:2]), np.zeros(r, bool), None, prior, rows.key, 0, *empty, world)


def predict(p: Settings, s: Own, z: Senses) -> Own:
    """Draw from P(x_t+1 | x_t); "box": uniformly around the moved estimate, forgetting the weights.

    Where raw readings weigh the particles, `correct` draws them too, in one pass.
    """
    motion, tick = s.world.motion, s.tick + 1
    if p.own == "rssi" and p.proposal == "walk":
        return s._replace(tick=tick)
    trail = motion.retrace(s.trail, z.odometry, z.dt)
    if p.proposal == "box":
        x, logw = renew(s.x, s.logw, s.key, s.tick)
        middle, _, _ = motion.move(mean(x, weights(logw)), z.odometry, z.dt)
        x = np.repeat(middle[:, None, :], p.particles, 1)
        x[..., :2] += p.box * (2 * random_numbers.uniforms(s.key, tick, random_numbers.BOX, p.particles) - 1)
        return s._replace(x=x, logw=np.zeros_like(s.logw), tick=tick, trail=trail)
    x, logw, _ = advance(motion, s.x, s.logw, s.due, z, s.key, tick)
    return s._replace(x=x, logw=logw, tick=tick, trail=trail)


def correct(p: Settings, s: Own, z: Senses, tell: bool = True) -> Own:
    """Weigh the particles by the anchors' readings; `tell` unless nothing is told to others."""
    fixed = list(s.world.fixed(z))
    if p.own == "rssi" and p.proposal == "box":
        return s._replace(logw=likelihood.anchors(fixed, s.x, s.logw))
    if p.own == "rssi":
        x, logw, told = advance(s.world.motion, s.x, s.logw, s.due, z, s.key, s.tick, fixed, tell)
        return s._replace(x=x, logw=logw, told=told)
    doa = gradient_doa(s.world)
    angle = doa.measure(z.anchor_rssi)
    s = _remember(p, s, angle)
    heard = np.where(np.isnan(angle)[:, None], np.nan, s.smooth)
    power = 1 / p.M if p.temper else 1.0
    return s._replace(logw=likelihood.window(doa, s.world.motion, s.x, s.logw, heard, s.trail, p.density, power))


def tell(s: Own) -> Belief:
    """What others are told: the belief before anything is heard."""
    return s.told or summary(s.x, s.logw)


def finish(p: Settings, s: Own, heard: likelihood.Heard | None = None) -> Own:
    """Weigh by what was heard, and conclude.

    The belief is the weighted mean and covariance; with point="max" the particle of largest weight instead of the mean.
    """
    belief, logw, due = conclude(s.x, s.logw, heard)
    if p.point == "max":
        belief = belief._replace(x=np.take_along_axis(s.x, logw.argmax(-1)[:, None, None], 1)[:, 0])
    return s._replace(logw=logw, due=due, belief=belief)


def _remember(p: Settings, s: Own, angle: Array) -> Own:
    """The DOA smoothed by a circular moving average over the last K, weights decay^age (the paper's EWMA).

    Memories are of samples, not of ticks: where there is no DOA they stay.
    """
    doa = _pushed(s.doa, angle)
    weight = np.where(np.isnan(doa), 0.0, p.decay ** np.arange(p.K))
    smooth = _pushed(s.smooth, circular_mean(np.where(np.isnan(doa), 0.0, doa), weight))
    new, trail = ~np.isnan(angle)[:, None], _pushed(s.trail, np.zeros_like(s.trail[:, 0]))
    return s._replace(
        doa=np.where(new, doa, s.doa),
        smooth=np.where(new, smooth, s.smooth),
        trail=np.where(new[..., None], trail, s.trail),
    )


def _pushed(memory: Array, newest: Array) -> Array:
    """A memory (r, k, ...) with one more entry in front and the last one forgotten."""
    return np.concatenate([newest[:, None], memory[:, :-1]], 1)
