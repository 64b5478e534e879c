"""Collaborative Monte Carlo localization: when one robot detects another, its belief is multiplied with the other's.

A robot broadcasts a small sample of its particles with a kernel, which together are a density of its position. A robot
that has a reading of the sender moves that density through the detection model,

    P(x_l | z) ~ integral p(z | x_l, x_j) Bel(x_j) dx_j,

and multiplies its weights with it. The product takes beliefs to be independent. Hence the source's safeguard: once a
pair's detection was used, the next is used only after the robot has travelled some distance.

Our reading: a sum of Gaussian kernels (Liu & West's) instead of a tree of samples; the receiver of a packet makes the
detection, and counts its distance for each teammate. The source's 2.5 m are as we remember them.

Source: D. Fox, W. Burgard, H. Kruppa, S. Thrun, "A probabilistic approach to collaborative multi-robot localization",
Autonomous Robots 8(3), 2000.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from cooploc.estimators import mixtures, random_numbers
from cooploc.estimators import particles as shared
from cooploc.estimators.errors import Limits
from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World
from cooploc.estimators.mixtures import density, sample
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


class State(NamedTuple):
    """The memory of one robot."""

    own: shared.FilterState
    travelled: Array  # (r, n)  since a detection of each teammate was used [m]; inf before the first


@dataclass(frozen=True)
@shared.explain
class Cmrl:
    """Particle filter on own readings, multiplied with a density of each teammate once per meeting.

    Args:
        reading: of a packet, where no camera sees teammates: "rssi" [dBm] or "range" [m].
        samples: particles in a packet, 2 to 10 000.
        apart: distance [m] that the robot travels before it uses a detection of the same teammate again; 0 uses all.
    """

    api: ClassVar[int] = 1
    limits: ClassVar[Limits] = {"samples": (2, 10_000), "apart": (0, 1e9)}
    sends: ClassVar[str] = "a sample of particles"
    consistency: ClassVar[str] = "over-confident, less so than `mrsl-*`: a detection counts once per 2.5 m"
    particles: int = 200
    anchor_reading: shared.AnchorReading = "doa"
    density: Literal["constant", "exact"] = tunable("constant", choices=("constant", "exact"), where=shared.DOA)
    residual: Literal["wrapped", "sum", "corners", "code"] = "wrapped"
    M: int = tunable(5, 1, 10, where=shared.DOA)
    K: int = tunable(5, 1, 10, where=shared.DOA)
    decay: float = tunable(0.99, 0.5, 1.0, where=shared.DOA)
    temper: bool = tunable(True, choices=(True, False), where=shared.DOA)
    point: Literal["mean", "max"] = "mean"
    proposal: Literal["walk", "box", "best"] = "walk"
    box: float = 0.5  # [m]
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    precision: Literal["double", "single"] = "double"
    reading: shared.RadioReading = "range"
    samples: int = 16
    apart: float = 2.5  # [m]
    loss: AssumedLoss = "world"

    uses = property(shared.team_channels)

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        return State(shared.init(self, prior, world, rows), np.full((len(prior.x), world.robots), np.inf))

    def predict(self, s: State, z: Senses) -> State:
        """Move the particles, and count the distance."""
        x = s.own.belief.x
        after, _, _ = s.own.world.motion.move(x, z.odometry, z.dt)
        step = np.hypot(after[:, 0] - x[:, 0], after[:, 1] - x[:, 1])
        return State(shared.predict(self, s.own, z), s.travelled + step[:, None])

    def correct(self, s: State, z: Senses) -> State:
        return s._replace(own=shared.correct(self, s.own, z))

    def send(self, s: State, z: Senses) -> Array:
        """Send the kernel's P_xx, P_xy, P_yy, then x, y of each sample: 3 + 2 S numbers."""
        key = s.own.key ^ random_numbers.FURTHER
        u = random_numbers.uniforms(key, s.own.tick, random_numbers.SAMPLE, 1)[:, 0, 0]
        return sample(s.own.x, s.own.logw, u, self.samples)

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        """w_i *= sum_s N(z - h(x_i, x_s); 0, R + J H J') / S, for each teammate that is due."""
        sensor, readings = shared.team_readings(s.own.world, z, mail)
        due = s.travelled >= self.apart
        readings = np.where(due[..., None], readings, np.nan)
        sent = density(mail.packets)
        used = ~np.isnan(readings).any(-1) & ~np.isnan(sent.w).all(-1)
        logw = mixtures.weigh(sensor, sent, readings, s.own.x, s.own.logw)
        return State(shared.resample_and_estimate(self, s.own._replace(logw=logw)), np.where(used, 0.0, s.travelled))

    def estimate(self, s: State) -> Belief:
        return s.own.belief
