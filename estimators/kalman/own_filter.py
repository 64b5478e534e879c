"""What team filters have in common whose robots keep one belief each: the steps that need no teammate."""

from dataclasses import dataclass
from typing import Any, Protocol, Self, TypeVar

from cooploc.estimators.interface import Array, Belief, Senses, World
from cooploc.estimators.kalman.own_steps import corrected, moved
from cooploc.estimators.kalman.settings import TeamSettings
from cooploc.estimators.models.angles import wrap_heading


class Own(Protocol):
    """A state, a NamedTuple, with these among its fields."""

    @property
    def x(self) -> Array: ...  # (r, d)

    @property
    def P(self) -> Array: ...  # (r, d, d)

    @property
    def world(self) -> World: ...

    def _replace(self, *_: Any, **fields: Any) -> Self: ...


S = TypeVar("S", bound=Own)


@dataclass(frozen=True)
class OwnFilter(TeamSettings):
    """EKF on own readings."""

    def predict(self, s: S, z: Senses) -> S:
        """x' = f(x, u),  P' = F P F' + Q."""
        x, P, _ = moved(self, s.world, s.x, s.P, z)
        return s._replace(x=x, P=P)

    def correct(self, s: S, z: Senses) -> S:
        """x' = x + K y,  P' = (I - K H) P (I - K H)' + K R K', one reading after the other."""
        x, P = corrected(self, s.world, s.x, s.P, z)
        return s._replace(x=x, P=P)

    def estimate(self, s: Own) -> Belief:
        return Belief(wrap_heading(s.x), s.P)
