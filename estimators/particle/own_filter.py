"""A robot's own particle filter on odometry and anchor RSSI: what ARL is, and what MRSL and CTRN build on.

Source: Latif & Parasuraman, "Individual localization", eqs. (1)-(5); R. Parashar, R. Parasuraman, "Particle filter
based localization of access points using direction of arrival on mobile robots", VTC-Fall 2020.
"""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from cooploc.estimators.compiled import random_numbers
from cooploc.estimators.interface import Array, Belief, Keys, Mask, Rows, Senses, World
from cooploc.estimators.models.angles import circular_mean
from cooploc.estimators.models.gradient_doa import GradientDoa, gradient_doa
from cooploc.estimators.models.inflation import LEAST, MOST, inflated
from cooploc.estimators.particle import likelihood, past_packets
from cooploc.estimators.particle.past_packets import PastPackets
from cooploc.estimators.particle.steps import advance, conclude, mean, renew, spread, summary, weights
from cooploc.estimators.plugins.bounds import require
from cooploc.estimators.plugins.errors import BadInput
from cooploc.estimators.plugins.tunable import tunable

PARAMETERS = """
    Parameters of the robot's own particle filter:
        particles: their number, at least 2.
        anchor_reading: "doa", the direction of arrival made of the four anchor readings; "gradient", the gradient
            [dB/m] that the direction is taken from, of this tick alone; "rssi", their raw likelihoods; or "none", no
            reading of anchors: odometry and teammates alone.
        density: of the direction: "constant" is a Gaussian error of the angle, "exact" the projected normal.
        residual: the error in the constant density: "wrapped", the particle's angle less the measured one in
            (-pi, pi]; "sum", eq. (4) to the letter: that difference not wrapped, once for each of the four nodes; or
            "corners", the same with the particle's direction from each node, which says little inside the arena.
        M: path samples in the product of eq. (5), at least 1.
        K: directions in the moving average, at least 1.
        decay: weight of a direction per sample of age, in (0, 1].
        temper: exponent 1/M on that product; without it a recursive filter counts every direction M times.
        point: "mean" of the particles, or "max", the paper's: the particle of largest weight.
        proposal: "walk" by the motion model, or "box", the paper's: uniform around the present estimate, every tick.
        box: half-width of that box [m], above 0.
        inflation: factor, 0.01 to 100, on the standard deviation that is assumed of every reading; 1: as told.
        precision: of particles and their weights, "double" or "single": half the memory and about half the time, with
            errors of rounding of a millionth of the distance from the origin; in an arena of at most 10 km.
"""
DOA = "anchor_reading", "doa"  # what most parameters are about
FARTHEST = 1e4  # [m] from the origin: there single numbers are a millimetre apart


@dataclass(frozen=True)
class Settings:
    """Parameters that all particle filters share. The defaults are the readings of the `paper` preset."""

    particles: int = 200
    anchor_reading: Literal["doa", "gradient", "rssi", "none"] = "doa"
    density: Literal["constant", "exact"] = tunable("constant", choices=("constant", "exact"), where=DOA)
    residual: Literal["wrapped", "sum", "corners"] = "wrapped"
    M: int = tunable(5, 1, 10, where=DOA)
    K: int = tunable(5, 1, 10, where=DOA)
    decay: float = tunable(0.99, 0.5, 1.0, where=DOA)
    temper: bool = tunable(True, choices=(True, False), where=DOA)
    point: Literal["mean", "max"] = "mean"
    proposal: Literal["walk", "box"] = "walk"
    box: float = 0.5  # [m]
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    precision: Literal["double", "single"] = "double"

    def __init_subclass__(cls) -> None:
        """Every particle filter's help explains these parameters too."""
        cls.__doc__ = f"{cls.__dict__.get('__doc__') or cls.__name__}\n{PARAMETERS}"

    def __post_init__(self) -> None:
        require(self, particles=(2, 1_000_000), M=(1, 10_000), K=(1, 10_000), box=(1e-9, 1e6), decay=(1e-9, 1))
        require(self, inflation=(LEAST, MOST))

    @property
    def uses(self) -> tuple[str, ...]:
        """The channels of the robot's own filter."""
        return ("odometry",) if self.anchor_reading == "none" else ("odometry", "anchor_rssi")

    @property
    def power(self) -> float:
        """The exponent of every density in a product over M samples."""
        return 1 / self.M if self.temper else 1.0

    @property
    def one_pass(self) -> bool:
        """Whether particles are drawn and weighed in one pass, in `correct`."""
        return self.anchor_reading in ("rssi", "none") and self.proposal == "walk"


class FilterState(NamedTuple):
    """What a robot remembers. The newest entry of each memory comes first."""

    x: Array  # (r, N, d)  particles
    logw: Array  # (r, N)     log-weights, unnormalised
    due: Mask  # (r,)       rows to be renewed when the next tick begins
    sent: Belief | None  # the belief to be sent, where it is computed already
    belief: Belief  # x (r, d), P (r, d, d)  at the end of the last tick
    key: Keys  # (r, 2)
    tick: int
    doa: Array  # (r, K)     raw angles [rad]
    smooth: Array  # (r, M)     averaged angles [rad]
    trail: Array  # (r, M, 2)  where the robot was then, seen from where it is now [m]
    past: PastPackets  # of a robot that uses more than the newest packet of each sender
    world: World


def init(p: Settings, prior: Belief, world: World, rows: Rows) -> FilterState:
    """Particles drawn from the prior, and empty memories."""
    world = inflated(world, p.inflation)
    if p.anchor_reading in ("doa", "gradient"):
        gradient_doa(world)  # refuses a world without four corners before anything runs
    r = len(prior.x)
    demand_digits(p, world)
    x = spread(prior, rows.key, p.particles)
    empty = np.full((r, p.K), np.nan), np.full((r, p.M), np.nan), np.zeros((r, p.M, 2)), past_packets.empty(r, 0, 0)
    s = FilterState(x, np.zeros(x.shape[:2]), np.zeros(r, bool), None, prior, rows.key, 0, *empty, world)
    return rounded(p, s)


def demand_digits(p: Settings, world: World) -> None:
    """Refuse single precision where it cannot tell places that are a millimetre apart.

    Raises:
        BadInput: the arena reaches more than 10 km from the origin.

    """
    reach = float(np.abs(world.arena).max())
    if p.precision == "single" and reach > FARTHEST:
        raise BadInput(
            f"precision='single' has seven digits, and this arena reaches {reach:.0f} m from the origin: set "
            f"precision='double', or put the origin within {FARTHEST:.0f} m"
        )


def rounded(p: Settings, s: FilterState) -> FilterState:
    """The state with particles and log-weights as `precision` keeps them; numpy's steps compute in double."""
    real: Any = np.float32 if p.precision == "single" else np.float64
    return s if s.x.dtype == s.logw.dtype == real else s._replace(x=s.x.astype(real), logw=s.logw.astype(real))


def predict(p: Settings, s: FilterState, z: Senses) -> FilterState:
    """Draw from P(x_t+1 | x_t); "box": uniformly around the moved estimate, forgetting the weights.

    Where `p.one_pass`, `correct` draws them.
    """
    motion, tick = s.world.motion, s.tick + 1
    if p.one_pass:
        return s._replace(tick=tick)
    trail = motion.retrace(s.trail, z.odometry, z.dt)
    if p.proposal == "box":
        x, logw = renew(s.x, s.logw, s.key, s.tick)
        middle, _, _ = motion.move(mean(x, weights(logw)), z.odometry, z.dt)
        x = np.repeat(middle[:, None, :], p.particles, 1)
        x[..., :2] += p.box * (2 * random_numbers.uniforms(s.key, tick, random_numbers.BOX, p.particles) - 1)
        return rounded(p, s._replace(x=x, logw=np.zeros_like(s.logw), tick=tick, trail=trail))
    x, logw, _ = advance(motion, s.x, s.logw, s.due, z, s.key, tick)
    return rounded(p, s._replace(x=x, logw=logw, tick=tick, trail=trail))


def correct(p: Settings, s: FilterState, z: Senses, sends: bool = True) -> FilterState:
    """Weigh the particles by the anchors' readings; `sends` unless this robot transmits nothing."""
    fixed = list(s.world.fixed(z)) if p.anchor_reading == "rssi" else []
    if p.one_pass:
        x, logw, sent = advance(s.world.motion, s.x, s.logw, s.due, z, s.key, s.tick, fixed, sends)
        return rounded(p, s._replace(x=x, logw=logw, sent=sent))
    if p.anchor_reading in ("rssi", "none"):
        return rounded(p, s._replace(logw=likelihood.anchors(fixed, s.x, s.logw)))
    doa = gradient_doa(s.world)
    if p.anchor_reading == "gradient":
        logw = likelihood.gradient(doa, s.x, s.logw, doa.gradient(z.anchor_rssi))
        return rounded(p, s._replace(logw=logw))
    return _by_directions(p, s, doa, doa.measure(z.anchor_rssi))


def _by_directions(p: Settings, s: FilterState, doa: GradientDoa, angle: Array) -> FilterState:
    """Weigh by the last M averaged directions, of which `angle` (r,) is the newest; nothing where that is absent."""
    s = _remember(p, s, angle)
    angles = np.where(np.isnan(angle)[:, None], np.nan, s.smooth)
    form = "exact" if p.density == "exact" else p.residual
    logw = likelihood.window(doa, s.world.motion, s.x, s.logw, angles, s.trail, form, p.power)
    return rounded(p, s._replace(logw=logw))


def to_send(s: FilterState) -> Belief:
    """The belief that a robot sends: before it uses any packet of this tick."""
    return s.sent or summary(s.x, s.logw)


def finish(p: Settings, s: FilterState, heard: likelihood.ReceivedPackets | None = None) -> FilterState:
    """Weigh by the packets heard, and end the tick.

    The belief is the weighted mean and covariance; with point="max" the particle of largest weight instead of the mean.
    """
    s = rounded(p, s)
    belief, logw, due = conclude(s.x, s.logw, heard)
    if p.point == "max":
        belief = belief._replace(x=np.take_along_axis(s.x, logw.argmax(-1)[:, None, None], 1)[:, 0])
    return rounded(p, s._replace(logw=logw, due=due, belief=belief))


def _remember(p: Settings, s: FilterState, angle: Array) -> FilterState:
    """The DOA smoothed by a circular moving average over the last K, weights decay^age (the paper's EWMA).

    Memories count samples, not ticks: a tick without a DOA leaves them as they are.
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
