"""What every other estimator must beat: dead reckoning, the prior moved by odometry, and on a recording a constant."""

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np

from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World
from cooploc.estimators.kalman import symmetric
from cooploc.estimators.models import wrap_heading

S = TypeVar("S")


class State(NamedTuple):
    """The memory of one robot."""

    x: Array  # (r, d)
    P: Array  # (r, d, d)
    world: World


def ignore_senses(p: Any, s: S, z: Senses) -> S:
    """Return the state as it is."""
    return s


def send_nothing(p: Any, s: Any, z: Senses) -> Array:
    """Return packets without numbers (r, 0)."""
    return np.empty((len(s.x), 0))


def ignore_mail(p: Any, s: S, z: Senses, mail: Mail) -> S:
    """Return the state as it is."""
    return s


@dataclass(frozen=True)
class DeadReckoning:
    """Odometry only; sends nothing."""

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "nothing"
    consistency: ClassVar[str] = "consistent"
    uses: ClassVar[tuple[str, ...]] = ("odometry",)

    correct = ignore_senses
    send = send_nothing
    fuse = ignore_mail

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        return State(prior.x, prior.P, world)

    def predict(self, s: State, z: Senses) -> State:
        """x' = f(x, u),  P' = F P F' + Q."""
        x, F, Q = s.world.motion.move(s.x, z.odometry, z.dt)
        return s._replace(x=x, P=symmetric(F @ s.P @ F.mT + Q))

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.x), s.P)


@dataclass(frozen=True)
class Constant:
    """The middle of all anchors and landmarks, or else the start, whatever happens; sends nothing."""

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "nothing"
    consistency: ClassVar[str] = "consistent"
    own_motion: ClassVar[str] = "it does not move"
    uses: ClassVar[tuple[str, ...]] = ()

    predict = ignore_senses
    correct = ignore_senses
    send = send_nothing
    fuse = ignore_mail

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        """x = (lower + upper)/2,  P = (upper - lower)^2/12 of the rectangle around fixed things, or of the arena."""
        fixed = np.concatenate([world.anchors, world.landmarks])
        known = len(fixed) >= 2
        lower, upper = (fixed.min(0), fixed.max(0)) if known else world.arena
        x, P = prior.x.copy(), np.zeros_like(prior.P)
        if known:
            x[:, :2] = (lower + upper) / 2
        d = x.shape[-1]
        variance = np.full(d, np.pi**2 / 3)  # of a heading that may be any
        variance[:2] = np.maximum(upper - lower, 0.1) ** 2 / 12
        P[:, np.arange(d), np.arange(d)] = variance
        return State(x, P, world)

    def estimate(self, s: State) -> Belief:
        return Belief(s.x, s.P)
