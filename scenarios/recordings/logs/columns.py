"""A column of a log and its unit, as a description names them, converted to SI."""

import math
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

UNITS: dict[str, dict[str, float]] = {  # SI unit -> unit -> one of it in SI
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "rad": {"rad": 1.0, "deg": math.pi / 180},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1 / 3.6},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180},
    "dBm": {"dBm": 1.0},
    "": {"": 1.0},
}


class Strict(BaseModel):
    """A table of a description: finite numbers, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class LogColumn(Strict):
    """A column of the CSV files and its unit."""

    column: str
    unit: str | None = None  # SI where it is not stated
    factor: Annotated[float, Field(exclude=True)] = 1.0  # follows from the unit

    @model_validator(mode="before")
    @classmethod
    def _from_name(cls, given: Any) -> Any:
        """A column's name alone, or `column` and `unit`."""
        if isinstance(given, str):
            return {"column": given}
        if isinstance(given, Mapping) and set(given) <= {"column", "unit"}:
            return given
        raise ValueError('write a column as "name" or {column = "name", unit = "cm"}')


def _unit_of(si: str) -> AfterValidator:
    """Accepts a column in any unit of the same quantity."""

    def checked(column: LogColumn) -> LogColumn:
        unit = si if column.unit is None else column.unit
        if unit not in UNITS[si]:
            raise ValueError(f"unit {unit!r} is not one of {', '.join(UNITS[si])}")
        return column.model_copy(update={"factor": UNITS[si][unit]})

    return AfterValidator(checked)


Seconds = Annotated[LogColumn, _unit_of("s")]
Metres = Annotated[LogColumn, _unit_of("m")]
Angle = Annotated[LogColumn, _unit_of("rad")]
Speed = Annotated[LogColumn, _unit_of("m/s")]
TurnRate = Annotated[LogColumn, _unit_of("rad/s")]
Power = Annotated[LogColumn, _unit_of("dBm")]
Number = Annotated[LogColumn, _unit_of("")]
