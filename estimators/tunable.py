"""Parameters that a user may tune, and the values between which.

    @dataclass(frozen=True)
    class Mine:
        gate: float = tunable(13.8, 2, 200, log=True)    # a number; log: ratios matter, not differences
        window: int = tunable(5, 1, 20)                  # a whole number, as the default is one
        form: Literal["a", "b"] = tunable("a", choices=("a", "b"))

A plain class that `PerRobot` or `PerTeam` adapts declares in its signature:
`def __init__(self, prior, world, robot, key, alpha=tunable(0.5, 0.01, 1))`.

Declare what the method leaves to its user: not which readings it uses, nor what buys accuracy with computing time.
"""

from collections.abc import Mapping
from dataclasses import field, fields, is_dataclass
from math import inf
from typing import Any, NamedTuple

from cooploc.estimators.adapters import Adapter

KEY = "cooploc.tunable"  # of a field's metadata
Value = float | int | str | bool


class Tunable(NamedTuple):
    """The values of one parameter: from `low` to `high`, both included, or one of `choices`."""

    default: Any
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    choices: tuple[Value, ...] = ()
    where: tuple[str, Value] | None = None  # the other parameter, and its value, without which this one does nothing

    @property
    def whole(self) -> bool:
        """Return whether the values are whole numbers."""
        return not self.choices and isinstance(self.default, int)


def tunable(
    default: Any,
    low: float | None = None,
    high: float | None = None,
    *,
    log: bool = False,
    choices: tuple[Value, ...] = (),
    where: tuple[str, Value] | None = None,
) -> Any:
    """Return a dataclass field with this default that `cooploc tune` may change.

    Args:
        default: as of any field; it may lie outside the bounds, where it is what was published.
        low, high: the smallest and the largest value, in the parameter's unit.
        log: whether it is searched by its logarithm; then `low` must lie above 0.
        choices: the values of a parameter that is not a number, instead of bounds.
        where: another parameter and its value, ("anchor_reading", "doa"), without which this one does nothing.

    Raises:
        ValueError: bounds that hold nothing, or both bounds and choices.
    """
    if bool(choices) != (low is None) or (low is None) != (high is None):
        raise ValueError("give tunable(default, low, high), or tunable(default, choices=(...))")
    if low is None or high is None:
        return field(default=default, metadata={KEY: Tunable(default, choices=tuple(choices), where=where)})
    if not -inf < low < high < inf or (log and low <= 0):
        above = " and above 0, as log=True" if log else ""
        raise ValueError(f"tunable bounds are {low} and {high}; they must be finite, low below high{above}")
    return field(default=default, metadata={KEY: Tunable(default, low, high, log, where=where)})


def declarations(estimator: Any) -> Mapping[str, Tunable]:
    """Return what an estimator declares tunable, by parameter, with the present value as the default.

    A parameter that does nothing with the other values is left out.
    """
    if isinstance(estimator, Adapter):
        found, values = estimator.tunable_fields, estimator.parameters
    elif is_dataclass(estimator):
        found = {one.name: one for one in fields(estimator) if one.init}
        values = {name: getattr(estimator, name, one.default) for name, one in found.items()}
    else:
        return {}
    declared = {name: one.metadata[KEY] for name, one in found.items() if KEY in one.metadata}
    used = {name: one for name, one in declared.items() if one.where is None or values[one.where[0]] == one.where[1]}
    return {name: one._replace(default=values[name]) for name, one in used.items()}
