"""Which parameters of an estimator a user would tune, and between which values.

    @dataclass(frozen=True)
    class Mine:
        gate: float = tunable(13.8, 2, 200, log=True)    # a number; log: ratios matter, not differences
        window: int = tunable(5, 1, 20)                  # a whole number, as the default is one
        form: Literal["a", "b"] = tunable("a", choices=("a", "b"))

A plain class that `PerRobot` or `PerTeam` lifts declares in its signature:
`def __init__(self, prior, world, robot, key, alpha=tunable(0.5, 0.01, 1))`.

Declared is what the method leaves to its user. Not declared is what is told to all alike (noise of sensors, path loss),
what names the readings that a method uses, and what buys accuracy with computing time, such as a number of particles.
"""

from collections.abc import Mapping
from dataclasses import field, fields, is_dataclass
from math import isfinite
from typing import Any, NamedTuple

from cooploc.estimators.adapters import Adapter, tunable_fields

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
    """A dataclass field with this default that `cooploc tune` may change.

    Args:
        default: as of any field; it may lie outside the bounds, where it is what was published.
        low, high: the smallest and the largest value, in the parameter's unit.
        log: whether it is searched by its logarithm; then `low` must lie above 0.
        choices: the values of a parameter that is not a number, instead of bounds.
        where: another parameter and its value, ("anchor_reading", "doa"), without which this one does nothing.

    Raises:
        ValueError: bounds that hold nothing, or both bounds and choices.

    """
    if bool(choices) == (low is not None or high is not None):
        raise ValueError("give tunable(default, low, high), or tunable(default, choices=(...))")
    if choices:
        return field(default=default, metadata={KEY: Tunable(default, choices=tuple(choices), where=where)})
    if low is None or high is None or not (isfinite(low) and isfinite(high) and low < high) or (log and low <= 0):
        above = " and above 0, as log=True" if log else ""
        raise ValueError(f"tunable bounds are {low} and {high}; they must be finite, low below high{above}")
    return field(default=default, metadata={KEY: Tunable(default, low, high, log, where=where)})


def declarations(estimator: Any) -> Mapping[str, Tunable]:
    """Return the declarations of an estimator, or of its class, by parameter; nothing where it is not a dataclass.

    The default of an instance is its present value; what does nothing with its other values is left out. Of a lifted
    class it is what its signature declares.
    """
    if isinstance(estimator, Adapter):
        made = {name: one.metadata[KEY] for name, one in tunable_fields(estimator).items() if KEY in one.metadata}
        return _in_use(made, estimator.parameters)
    if not is_dataclass(estimator):
        return {}
    found = {one.name: one.metadata[KEY] for one in fields(estimator) if one.init and KEY in one.metadata}
    if isinstance(estimator, type):
        return found
    return _in_use(found, {one.name: getattr(estimator, one.name) for one in fields(estimator) if one.init})


def _in_use(found: Mapping[str, Tunable], values: Mapping[str, Any]) -> dict[str, Tunable]:
    """Those that do something with an instance's other values; its present value is the default."""
    used = {name: one for name, one in found.items() if one.where is None or values[one.where[0]] == one.where[1]}
    return {name: one._replace(default=values[name]) for name, one in used.items()}
