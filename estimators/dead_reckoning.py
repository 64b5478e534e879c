"""Dead reckoning: the prior moved by odometry, and nothing else: every other estimator must beat it."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World
from cooploc.estimators.kalman import symmetric
from cooploc.estimators.models import wrap_heading


class State(NamedTuple):
    """The memory of one robot."""

    x: Array  # (r, d)
    P: Array  # (r, d, d)
    world: World


@dataclass(frozen=True)
class DeadReckoning:
    """Odometry only; sends nothing."""

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "nothing"
    consistency: ClassVar[str] = "consistent"
    uses: tuple[str, ...] = ("odometry",)

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        return State(prior.x, prior.P, world)

    def predict(self, s: State, z: Senses) -> State:
        """x' = f(x, u),  P' = F P F' + Q."""
        x, F, Q = s.world.motion.move(s.x, z.odometry, z.dt)
        return s._replace(x=x, P=symmetric(F @ s.P @ F.mT + Q))

    def correct(self, s: State, z: Senses) -> State:
        return s

    def send(self, s: State, z: Senses) -> Array:
        return np.empty((len(s.x), 0))

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        return s

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.x), s.P)
