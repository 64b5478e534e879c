"""The tables of a team's log.toml that say where something was recorded, and in which columns or topics."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from cooploc.scenarios.recordings.logs.columns import (
    UNITS,
    Angle,
    Metres,
    Number,
    Power,
    Seconds,
    Speed,
    Strict,
    TurnRate,
)
from cooploc.scenarios.worlds.radio import Positive

Place = tuple[float, float]  # [m]
Name = Annotated[str, Field(pattern=r"^[^\s,/{}\[\]]+$", max_length=60)]


def _several(given: Any) -> Any:
    """One table or column, where there may be several."""
    return given if isinstance(given, list | tuple) else [given]


Several = BeforeValidator(_several)
TimeColumns = Annotated[tuple[Seconds, ...], Field(min_length=1), Several]


class Source(Strict):
    """Where something is: CSV files, or topics of a bag. `{robot}` and `{other}` in them stand for names."""

    file: str | None = None  # CSV, relative to the run: "odom_{robot}.csv", or one for all
    topic: str | None = None  # of a bag: "/{robot}/odom"
    topics: Mapping[Name, str] = {}  # of a bag: robots whose topic has another name
    time: TimeColumns = Field(default=("time",), validate_default=True)  # of CSV files; summed: seconds and nanoseconds
    robot: Number | None = None  # the column with the robot's name, where a file holds several
    nodes: Mapping[str, Name] = {}  # what the files or topics call a robot, an anchor or a landmark -> its name here
    clock_offset: float = 0.0  # [s] added to the stamps

    @model_validator(mode="after")
    def _is_somewhere(self) -> Self:
        if (self.file is None) == (self.topic is None and not self.topics):
            raise ValueError('state where it is: file = "..." (CSV), or topic = "..." (a bag)')
        if self.file is not None and (Path(self.file).is_absolute() or ".." in Path(self.file).parts):
            raise ValueError(f"file is {self.file!r}; name one inside the directory")
        if self.file is not None and ("{robot}" in self.file) == (self.robot is not None):
            raise ValueError('whose lines are they: file = "..._{robot}.csv", or robot = "the column of names"')
        return self

    @property
    def in_files(self) -> bool:
        """Whether it is in CSV files."""
        return self.file is not None


class Odometry(Source):
    """What each robot measures of its own motion.

    velocity: `speed` and `turn_rate`, which hold until the next line. pose: `x`, `y`, `heading` in a frame of its own.
    path: `length` driven so far (a counter) and `turn_rate`. displacement: `dx`, `dy` since the line before, in a
    compass frame.
    """

    kind: Literal["velocity", "pose", "displacement", "path"]
    speed: Speed | None = None
    turn_rate: TurnRate | None = None
    x: Metres | None = None
    y: Metres | None = None
    heading: Angle | None = None
    length: Metres | None = None
    dx: Metres | None = None
    dy: Metres | None = None

    @model_validator(mode="after")
    def _has_its_columns(self) -> Self:
        needed = COLUMNS[self.kind] if self.in_files else ()
        every = sorted({name for names in COLUMNS.values() for name in names})
        given = {name for name in every if getattr(self, name) is not None}
        if given != set(needed):
            takes, has = (", ".join(names) or "no columns" for names in (needed, sorted(given)))
            raise ValueError(f"kind {self.kind!r} takes {takes}, not {has}")
        return self


COLUMNS: Mapping[str, tuple[str, ...]] = {  # of odometry, in the order of `team_log.ODOMETRY_COLUMNS`
    "velocity": ("speed", "turn_rate"),
    "pose": ("x", "y", "heading"),
    "displacement": ("dx", "dy"),
    "path": ("length", "turn_rate"),
}


class GroundTruth(Source):
    """The true poses, on a clock of their own."""

    x: Metres | None = None
    y: Metres | None = None
    heading: Angle | None = None  # counter-clockwise from x
    frame: Literal["as recorded", "mirrored", "swapped"] = "as recorded"  # mirrored: y downwards; swapped: x is y
    max_speed: Positive | None = None  # [m/s] a position that cannot be reached from the last valid one is left out

    @model_validator(mode="after")
    def _has_its_columns(self) -> Self:
        if self.in_files and (self.x is None or self.y is None):
            raise ValueError("x and y are missing; name their columns")
        return self


class Readings(Source):
    """Measurements of something else, whose name is in the column `other` or, as `{other}`, in the file or topic."""

    other: Number | None = None

    @model_validator(mode="after")
    def _of_something(self) -> Self:
        named = self.other is not None or "{other}" in (self.file or "") or bool(getattr(self, "each", None))
        if self.in_files and not named:
            raise ValueError('what was measured: other = "the column of names", or {other} in the name of the file')
        return self


class Ranges(Readings):
    """Ranges by radio, to teammates or anchors."""

    range: Metres | None = None
    each: Mapping[Name, Metres] = {}  # instead of `other` and `range`: the column of each robot or anchor
    unit: str = "m"  # of a bag's values

    @model_validator(mode="after")
    def _has_its_columns(self) -> Self:
        _one_of(self, "range")
        if self.unit not in UNITS["m"]:
            raise ValueError(f"unit {self.unit!r} is not one of {', '.join(UNITS['m'])}")
        return self


class Rssi(Readings):
    """Received signal strength, of teammates or anchors."""

    rssi: Power | None = None
    each: Mapping[Name, Power] = {}  # instead of `other` and `rssi`: the column of each robot or anchor
    missing_from: float = 0.0  # [dBm] a reading of this or more is missing

    @model_validator(mode="after")
    def _has_its_columns(self) -> Self:
        _one_of(self, "rssi")
        return self


class Sightings(Readings):
    """Range and bearing (from straight ahead, counter-clockwise) of teammates or landmarks, as a camera sees them."""

    range: Metres | None = None
    bearing: Angle | None = None

    @model_validator(mode="after")
    def _has_its_columns(self) -> Self:
        if self.in_files and (self.range is None or self.bearing is None):
            raise ValueError("range and bearing are missing; name their columns")
        return self


class Places(Strict):
    """Fixed things, by name: `places` here, or a CSV file of them (one for all runs, beside log.toml)."""

    places: Mapping[Name, Place] = {}  # [m]
    file: str | None = None
    name: Number | None = None  # columns of the file
    x: Metres | None = None
    y: Metres | None = None

    @model_validator(mode="after")
    def _are_somewhere(self) -> Self:
        columns = [self.name, self.x, self.y]
        if (self.file is None) != (None in columns) or (self.file is None and any(columns)):
            raise ValueError("a file of places needs the columns name, x and y")
        if self.file is not None and (Path(self.file).is_absolute() or ".." in Path(self.file).parts):
            raise ValueError(f"file is {self.file!r}; name one inside the directory")
        if not self.places and self.file is None:
            raise ValueError("there are no places; give places = { name = [x, y] }, or a file")
        return self


def _one_of(table: Ranges | Rssi, value: str) -> None:
    """Either `other` and the value's column, or `each`."""
    each, named = bool(table.each), getattr(table, value) is not None
    if table.in_files and each == named:
        raise ValueError(
            f'name the column: {value} = "...", or one for each robot or anchor: each = {{ name = "..." }}'
        )
    if each and table.other is not None:
        raise ValueError("each and other exclude each other; remove one")
