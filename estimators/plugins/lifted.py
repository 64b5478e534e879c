"""A plain class that is named where an estimator is wanted: lifted if it says what it reads, else told how."""

from typing import Any

from cooploc.estimators.per_robot import PerRobot
from cooploc.estimators.plugins.errors import BadInput

SINGLE = ("predict", "correct", "estimate")  # what a plain class has at least


def is_plain(found: Any) -> bool:
    """Whether it is a class for one robot or one team, to be lifted."""
    return isinstance(found, type) and not hasattr(found, "init") and all(hasattr(found, one) for one in SINGLE)


def lifted(name: str, plain: Any) -> PerRobot:
    """The plain class as an estimator.

    Raises:
        BadInput: it does not say what it reads, or cannot be called as `PerRobot` calls it.

    """
    lift = "PerRobot"
    if not hasattr(plain, "uses"):
        raise BadInput(
            f'{name} is a plain class and does not say what it reads: write uses = ("odometry", ...) in it, or name '
            f"what cl.{lift}({plain.__name__}, uses=(...)) makes"
        )
    try:
        return PerRobot(plain)
    except TypeError as e:
        raise BadInput(f"{name} cannot be lifted by cl.{lift}: {e}") from None
