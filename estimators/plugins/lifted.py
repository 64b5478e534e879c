"""A plain class that is named where an estimator is wanted: lifted if it says what it reads, else told how."""

from typing import Any

from cooploc.estimators.per_robot import PerRobot
from cooploc.estimators.per_team import PerTeam
from cooploc.estimators.plugins.errors import BadInput

SINGLE = ("predict", "correct")  # what a plain class has at least


def is_plain(found: Any) -> bool:
    """Whether it is a class for one robot or one team, to be lifted."""
    return isinstance(found, type) and not hasattr(found, "init") and all(hasattr(found, one) for one in SINGLE)


def lifted(name: str, plain: Any) -> PerRobot | PerTeam:
    """The plain class as an estimator: of a team where it has `exchange`, else of one robot.

    Raises:
        BadInput: it does not say what it reads, or cannot be called as `PerRobot` or `PerTeam` calls it.

    """
    lift: type[PerRobot | PerTeam] = PerTeam if hasattr(plain, "exchange") else PerRobot
    if not hasattr(plain, "uses"):
        raise BadInput(
            f'{name} is a plain class and does not say what it reads: write uses = ("odometry", ...) in it, or name '
            f"what cl.{lift.__name__}({plain.__name__}, uses=(...)) makes"
        )
    try:
        return lift(plain)
    except TypeError as e:
        raise BadInput(f"{name} cannot be lifted by cl.{lift.__name__}: {e}") from None
