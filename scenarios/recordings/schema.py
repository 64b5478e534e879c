"""The description of recordings, `log.toml`: what their files, columns and topics mean.

It begins with `format` and has a table for each thing that was recorded. In CSV files a column is its name where the
file is in SI units, else `{column = "x", unit = "mm"}`:

    format = "csv"
    robots = ["red", "blue"]
    arena = [[0, 0], [6, 4]]          # lower left and upper right corner [m]

    [odometry]
    kind = "velocity"
    file = "odom_{robot}.csv"         # a file for each robot; or one file for all with robot = "column of names"
    time = ["sec", { column = "nsec", unit = "ns" }]
    speed = "v"
    turn_rate = { column = "w", unit = "-deg/s" }  # with a minus where it is positive to the right

    [turns]                           # instead of turn_rate above, where another sensor has files of its own
    file = "imu_{robot}.csv"
    time = "t"
    turn_rate = "gz"                  # or heading = "yaw"

    [truth]                           # files of its own, with its own clock
    file = "mocap_{robot}.csv"
    clock_offset = 0.0                # [s] added to its stamps; in any table, or { red = -2.5 } by robots' own clocks
    x = "x"
    y = "y"
    heading = "yaw"

One file may hold all robots, with columns of each: `x = "{robot}_x"`. A heading may be a quaternion, of x, y, z and w
or of z and w: `heading = { quaternion = ["qx", "qy", "qz", "qw"] }`; a speed the norm of a velocity along fixed axes:
`speed = { norm = ["vx", "vy"] }`. Dates are seconds since 1970.

In a bag there are topics instead: `topic = "/{robot}/odom"`, `topic = "/uwb/{robot}/{other}/distance"`. Beside it a
table may still name CSV files, such as those of the truth. Of bags that robots recorded at the same time, in one
directory, /odom in red.bag is /red/odom.

Runs are folders, or words in the names of files: `file = "{run}_odom_{robot}.csv"`, of one robot `file = "{run}.csv"`;
`wifi.log.toml` is a commented example.
"""

import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput, plain_words
from cooploc.estimators.interface import Array
from cooploc.estimators.robust import Loss
from cooploc.scenarios.worlds.radio import Positive

UNITS: dict[str, dict[str, float]] = {  # SI unit -> unit -> one of it in SI
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048, "in": 0.0254},
    "rad": {"rad": 1.0, "deg": math.pi / 180, "mrad": 1e-3},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1 / 3.6, "ft/s": 0.3048, "in/s": 0.0254, "mph": 0.44704},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180, "mrad/s": 1e-3},
    "dBm": {"dBm": 1.0},
    "": {"": 1.0},
}


class Strict(BaseModel):
    """A table of a description: finite numbers, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class LogColumn(Strict):
    """A column of the CSV files and its unit; or the columns of a quaternion, which is a heading, or of a velocity."""

    column: str = ""
    quaternion: Annotated[tuple[str, ...], Field(max_length=4)] = ()  # x, y, z, w; or z, w
    norm: Annotated[tuple[str, ...], Field(max_length=2)] = ()  # of a velocity along two fixed axes: the speed
    unit: str | None = None  # SI where it is not stated
    factor: Annotated[float, Field(exclude=True)] = 1.0  # follows from the unit

    @model_validator(mode="before")
    @classmethod
    def _parse_name(cls, given: Any) -> Any:
        """A column's name alone, or `column` and `unit`."""
        if isinstance(given, str):
            return {"column": given}
        if isinstance(given, Mapping) and set(given) <= {"column", "unit"} and "column" in given:
            return given
        if isinstance(given, Mapping) and set(given) == {"quaternion"} and len(given["quaternion"]) in (2, 4):
            return given
        if isinstance(given, Mapping) and set(given) - {"unit"} == {"norm"} and len(given["norm"]) == 2:
            return given
        raise ValueError('write a column as "name" or {column = "name", unit = "cm"}')

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns: one, or those of a quaternion or of a velocity."""
        return self.quaternion or self.norm or (self.column,)


def _unit_of(si: str) -> AfterValidator:
    """Accepts a column in any unit of the same quantity."""

    def check_unit(column: LogColumn) -> LogColumn:
        unit = si if column.unit is None else column.unit
        plain = unit.removeprefix("-") if si not in ("s", "") else unit
        if column.quaternion and si != "rad":
            raise ValueError("only a heading can be a quaternion; name a column")
        if column.norm and si != "m/s":
            raise ValueError("only a speed can be the norm of two columns; name one")
        if plain not in UNITS[si]:
            raise ValueError(f"unit {unit!r} is not one of {', '.join(UNITS[si])}")
        return column.model_copy(update={"factor": UNITS[si][plain] * (1.0 if plain == unit else -1.0)})

    return AfterValidator(check_unit)


Seconds = Annotated[LogColumn, _unit_of("s")]
Metres = Annotated[LogColumn, _unit_of("m")]
Angle = Annotated[LogColumn, _unit_of("rad")]
Speed = Annotated[LogColumn, _unit_of("m/s")]
TurnRate = Annotated[LogColumn, _unit_of("rad/s")]
Power = Annotated[LogColumn, _unit_of("dBm")]
Number = Annotated[LogColumn, _unit_of("")]


# ---- Tables that say where something was recorded, and in which columns or topics

Place = tuple[float, float]  # [m]


def check_name(name: str) -> str:
    """Return a name that can stand in labels and names of files; refuse any other."""
    if not re.fullmatch(r"[^\s,/{}\[\]]{1,60}", name):
        raise ValueError(
            f"{name!r} cannot be a name here: it has a blank or one of , / {{ }} [ ], or no or over 60 letters;"
            f' in `nodes = {{ "{name}" = "another" }}` the files may keep it'
        )
    return name


Name = Annotated[str, AfterValidator(check_name)]
PerRobot = float | Mapping[Name, float]  # the same for all, or of each by name, 0 where one is not named


def values_of(setting: PerRobot, names: Sequence[str]) -> Array:
    """Return what a setting is for robots, or anchors (m,)."""
    if isinstance(setting, Mapping):
        return np.array([setting.get(name, 0.0) for name in names], float)
    return np.full(len(names), setting)


Several = BeforeValidator(lambda given: given if isinstance(given, list | tuple) else [given])  # or one by itself
TimeColumns = Annotated[tuple[Seconds, ...], Field(min_length=1), Several]


class Source(Strict):
    """A source of numbers: CSV files, or topics of a bag. `{robot}` and `{other}` in them stand for names.

    `*` in the name of a file stands for what one file alone has there, such as when it was written.

    Of a topic whose messages are of another type than the usual ones, columns are fields: `range = "nodes.dis"`.
    """

    columns: ClassVar[tuple[str, ...]] = ()  # that CSV files have, unless there is one for `each`
    file: str | None = None  # CSV, relative to the run, such as "odom_{robot}.csv"; of all runs, "{run}_{robot}.csv"
    topic: str | None = None  # of a bag: "/{robot}/odom"
    topics: Mapping[Name, str] = {}  # of a bag: robots whose topic has another name
    time: TimeColumns = Field(default=("time",), validate_default=True)  # of CSV files; summed: seconds and nanoseconds
    robot: Number | None = None  # the column with the robot's name, where a file holds several
    nodes: Mapping[str, Name] = {}  # what the files or topics call a robot, an anchor or a landmark -> its name here
    clock_offset: PerRobot = 0.0  # [s] added to the stamps: of all robots, or of each by its own clock

    @model_validator(mode="after")
    def _is_somewhere(self) -> Self:
        if (self.file is None) == (self.topic is None and not self.topics):
            raise ValueError('state where it is: file = "..." (CSV), or topic = "..." (a bag)')
        if self.file is None and "time" in self.model_fields_set:
            raise ValueError("time is a column of CSV files; messages of a bag have their own stamps, remove it")
        if self.file is not None and (Path(self.file).is_absolute() or ".." in Path(self.file).parts):
            raise ValueError(f"file is {self.file!r}; name one inside the directory")
        if self.file is not None and self.names_robot and self.robot is not None:
            raise ValueError('whose lines are they: file = "..._{robot}.csv", or robot = "the column of names"')
        each, stated = getattr(self, "each", {}), [name for name in self.columns if getattr(self, name) is not None]
        lacking = 0 < len(stated) < len(self.columns) or (self.file is not None and not stated and bool(self.columns))
        if (self.file is not None and stated) if each else lacking:
            or_each = ', or one for each robot or anchor: each = { name = "..." }' if hasattr(self, "each") else ""
            raise ValueError(f"name the columns {' and '.join(self.columns)}{or_each}")
        names = {"robot", "other"} & {key for key, value in self if isinstance(value, LogColumn)}
        numbers = [value for key, value in self if isinstance(value, LogColumn) and key not in names]
        if self.file is None and names and not numbers:
            raise ValueError(
                f'names by {" and ".join(sorted(names))} need numbers: name their fields, too, as in range = "..."'
            )
        return self

    @property
    def names_robot(self) -> bool:
        """Whether the file's name, or those of the columns, say whose lines they are."""
        columns = [*dict(self).values(), *getattr(self, "each", {}).values()]
        wide = any("{robot}" in name for column in columns if isinstance(column, LogColumn) for name in column.columns)
        return wide or "{robot}" in (self.file or "") or ("{run}" in (self.file or "") and self.robot is None)

    @property
    def in_files(self) -> bool:
        """True for CSV files, False for topics."""
        return self.file is not None


class Odometry(Source):
    """Odometry: the measurements of each robot of its own motion.

    velocity: `speed` and `turn_rate`, which hold until the next line. pose: `x`, `y`, `heading` in a frame of its own.
    path: `length` driven so far (a counter) and `turn_rate`. increment: `dx` ahead, `turn`, perhaps `dy` to the left,
    since the line before. displacement: `dx`, `dy` since the line before, in a compass frame.
    """

    kind: Literal["velocity", "pose", "displacement", "path", "increment"]
    speed: Speed | None = None
    turn_rate: TurnRate | None = None
    x: Metres | None = None
    y: Metres | None = None
    heading: Angle | None = None
    length: Metres | None = None
    dx: Metres | None = None
    dy: Metres | None = None
    turn: Angle | None = None
    turn_bias: PerRobot = 0.0  # [rad/s] subtracted from turn rates: what a gyroscope says of a robot that stands

    @model_validator(mode="after")
    def _has_its_columns(self) -> Self:
        every = sorted({name for names in COLUMNS.values() for name in names})
        given = {name for name in every if getattr(self, name) is not None}
        needed = COLUMNS[self.kind] if self.in_files or given else ()
        may_lack = {"increment": {"dy"}, "velocity": {"turn_rate"}, "path": {"turn_rate"}}.get(self.kind, set[str]())
        if not {*needed} - may_lack <= given <= {*needed}:
            takes, has = (", ".join(names) or "no columns" for names in (needed, sorted(given)))
            raise ValueError(f"kind {self.kind!r} takes {takes}, not {has}")
        if self.turn_bias and self.kind not in ("velocity", "path"):
            raise ValueError(f"turn_bias is of turn rates, which kind {self.kind!r} has not")
        return self


COLUMNS: Mapping[str, tuple[str, ...]] = {  # of each kind of odometry
    "velocity": ("speed", "turn_rate"),
    "pose": ("x", "y", "heading"),
    "displacement": ("dx", "dy"),
    "increment": ("dx", "dy", "turn"),
    "path": ("length", "turn_rate"),
}


class Turns(Source):
    """Turn rates, or headings, of another sensor than the speeds', such as a gyroscope: with stamps of their own.

    `turn_bias` of [odometry] holds for them.
    """

    turn_rate: TurnRate | None = None
    heading: Angle | None = None

    @model_validator(mode="after")
    def _has_one_column(self) -> Self:
        if (self.turn_rate is None) == (self.heading is None):
            raise ValueError("state either turn_rate or heading")
        return self


class GroundTruth(Source):
    """The true poses, on a clock of their own."""

    columns = ("x", "y")
    x: Metres | None = None
    y: Metres | None = None
    heading: Angle | None = None  # counter-clockwise from x
    origin: Place | None = None  # latitude, longitude [deg] of x = y = 0, where y and x are such degrees
    heading_offset: PerRobot = 0.0  # [rad] added to headings
    frame: Literal["as recorded", "mirrored", "swapped"] = "as recorded"  # mirrored: y downwards; swapped: x is y
    repeats: Literal["stale", "still"] = "still"  # meaning of a position that equals the one before exactly
    max_speed: Positive | None = None  # [m/s] a position that cannot be reached from the last valid one is left out


class ReadingColumns(Source):
    """Measurements of something else, whose name is in the column `other` or, as `{other}`, in the file or topic.

    Where none is, and the team has two robots, they measured each other.
    """

    other: Number | None = None
    others: Mapping[str, Name] = {}  # as `nodes`, of what was measured alone, where robots have the same names

    @property
    def names_other(self) -> bool:
        """Whether it says what was measured."""
        wide = any("{other}" in value.column for _, value in self if isinstance(value, LogColumn))
        named = wide or "{other}" in f"{self.file} {self.topic}"
        return self.other is not None or named or bool(getattr(self, "each", None))

    @model_validator(mode="after")
    def _says_it_once(self) -> Self:
        both = [name for name in ("other", "others") if getattr(self, name)]
        if both and getattr(self, "each", None):
            raise ValueError(f"each and {both[0]} exclude each other; remove one")
        return self


class RangesTable(ReadingColumns):
    """Ranges by radio, to teammates or anchors."""

    columns = ("range",)
    range: Metres | None = None
    each: Mapping[Name, Metres] = {}  # instead of `other` and `range`: the column of each robot or anchor
    unit: Literal["m", "cm", "mm"] = "m"  # of a bag's values
    missing_from: Positive | None = None  # [m] a range of this or more is missing: some radios write 65.535

    @model_validator(mode="after")
    def _has_its_unit_once(self) -> Self:
        if self.unit != "m" and (self.range or self.each):
            raise ValueError(f'of a column it is range = {{ column = "...", unit = "{self.unit}" }}, and no other unit')
        return self


class RssiTable(ReadingColumns):
    """Received signal strength, of teammates or anchors."""

    columns = ("rssi",)
    rssi: Power | None = None
    each: Mapping[Name, Power] = {}  # instead of `other` and `rssi`: the column of each robot or anchor
    missing_from: float = 0.0  # [dBm] a reading of this or more is missing
    missing_below: float = -1000.0  # [dBm] a reading below this is missing: some radios write -127


class SightingsTable(ReadingColumns):
    """Range and bearing (from straight ahead, counter-clockwise) of teammates or landmarks, as a camera sees them.

    Or their places in the robot's frame: `x` ahead, `y` to the left. Of a camera that looks ahead these are z and -x.
    """

    range: Metres | None = None
    bearing: Angle | None = None
    x: Metres | None = None
    y: Metres | None = None
    bearing_offset: PerRobot = 0.0  # [rad] added to bearings, as of a camera that looks aside

    @property
    def columns(self) -> tuple[str, ...]:  # type: ignore[override]
        """The two that are stated."""
        return ("x", "y") if self.x or self.y else ("range", "bearing")


class PlacesTable(Strict):
    """Fixed things, by name."""

    places: Annotated[Mapping[Name, Place], Field(min_length=1)]  # [m]


class AnchorsTable(PlacesTable):
    """Radio nodes at fixed places, by name."""

    height: PerRobot = 0.0  # [m] above the robots' radios, of all anchors or of each by name: ranges are slant by it

    @model_validator(mode="after")
    def _heights_are_of_anchors(self) -> Self:
        named = self.height if isinstance(self.height, Mapping) else ()
        if stranger := next((name for name in named if name not in self.places), ""):
            raise ValueError(f"height names {stranger!r}; {nearest(stranger, list(self.places))}")
        return self


# ---- The description of a team's recordings

NAME = "log.toml"
EXAMPLE = "cooploc inspect DIR writes such a file"

FORMATS = {  # by name, the module beside this one that reads it
    "csv": "csv_files",
    "bag": "bags",
    "pyfg": "pyfg",
    "mrclam": "mrclam",
}
Format = Literal[*FORMATS]  # type: ignore[valid-type]


class Sample(Strict):
    """The ticks that the recording is divided into."""

    tick: Annotated[float, Field(ge=0.01, le=60)] | Literal["lines"] = 0.1  # [s], or each line of a robot ends one
    max_gap: Positive = 0.5  # [s] truth is not interpolated across longer gaps
    max_hold: Positive = 2.0  # [s] a speed or a turn rate holds until the next line, at most so long
    start: Annotated[float, Field(ge=0)] = 0.0  # [s] left out at the beginning
    duration: Positive | None = None  # [s] at most


class Prior(Strict):
    """The prior of each robot's start, and its source."""

    position: Literal["first truth", "arena"] = "first truth"
    position_sd: Positive = 0.05  # [m] per axis; "arena": uniform
    heading: Literal["first truth", "first motion", "unknown"] = "first truth"
    heading_sd: Positive = 0.05  # [rad]


class Fit(Strict):
    """The recordings, or the part, that the models are fitted on, which are never judged."""

    on: Literal["other runs", "first part", "nothing"] = "other runs"  # nothing: [model] states all
    seconds: Positive | None = None  # [s] how long the first part is
    loss: Loss | None = None  # by which filters weigh readings; None: what predicts left-out parts best

    @model_validator(mode="after")
    def _has_a_length(self) -> Self:
        if (self.on == "first part") != (self.seconds is not None):
            raise ValueError('on = "first part" needs seconds = ..., its length, and nothing else does')
        return self


class Model(Strict):
    """Parameters of the assumed models. Those that are not stated are fitted."""

    length_scale: Positive | None = None  # true length by odometry's
    turn_scale: Positive | None = None  # true turn by odometry's
    sigma_v: Positive | None = None  # [m/s] at the tick
    sigma_omega: Positive | None = None  # [rad/s] at the tick
    sigma_move: Positive | None = None  # [m] per axis in a tick, of displacements
    range_bias: float | None = None  # [m] of every pair
    range_sigma: Positive | None = None  # [m]
    anchor_range_bias: float | None = None  # [m] of every anchor
    anchor_range_sigma: Positive | None = None  # [m]
    A: float | None = None  # [dBm] at 1 m, between robots
    eta: Positive | None = None
    rssi_sigma: Positive | None = None  # [dB]
    anchor_A: float | None = None  # [dBm] at 1 m, of anchors
    anchor_eta: Positive | None = None
    anchor_rssi_sigma: Positive | None = None  # [dB]
    sighting_sigma_range: Positive | None = None  # [m]
    sighting_sigma_bearing: Positive | None = None  # [rad]
    landmark_sigma_range: Positive | None = None  # [m]
    landmark_sigma_bearing: Positive | None = None  # [rad]


class TeamDescription(Strict):
    """The meaning of the recordings of a team."""

    format: Format
    recordings: str = ""  # the directory that they are in, where that is not the one of log.toml
    about: str = ""
    run: str = ""  # the column of all CSV files that tells runs, where a file has several
    robots: tuple[Name, ...] = ()  # their names, in the order of the results; of PyFG and MRCLAM all, if none is named
    arena: tuple[Place, Place] | None = None  # lower left and upper right corner [m]; else 2 m around all fixed things
    set_ups: tuple[str, ...] = ("*",)  # runs whose names match one pattern had the same hardware and site
    odometry: Odometry | None = None
    turns: Turns | None = None  # where [odometry] has no turn rates
    truth: GroundTruth | None = None
    ranges: Annotated[tuple[RangesTable, ...], Several] = ()
    rssi: Annotated[tuple[RssiTable, ...], Several] = ()
    sightings: Annotated[tuple[SightingsTable, ...], Several] = ()
    anchors: AnchorsTable | None = None
    landmarks: PlacesTable | None = None
    sample: Sample = Sample()
    prior: Prior = Prior()
    fit: Fit = Fit()
    model: Model = Model()

    @property
    def moves(self) -> Odometry:
        """[odometry], which the formats csv and bag have."""
        if self.odometry is None:
            raise ValueError(f"format {self.format!r} has no table [odometry]")
        return self.odometry

    @property
    def _sources(self) -> list[Source]:
        return [s for s in (self.odometry, self.turns, self.truth, *self.ranges, *self.rssi, *self.sightings) if s]

    @model_validator(mode="after")
    def _has_sources(self) -> Self:
        sources = self._sources
        if self.run and self.format != "csv":
            raise ValueError(f'run is a column of CSV files, and format = "{self.format}"; leave it out')
        if self.format not in ("csv", "bag"):
            if sources or self.anchors or self.landmarks:
                said = "odometry, truth, readings and places"
                raise ValueError(
                    f'format = "{self.format}" has {said} in its files; correct them there, not in a table'
                )
            return self
        if not self.robots:
            raise ValueError('robots is missing; name them: robots = ["red", "blue"]')
        if self.odometry is None:
            raise ValueError(f"[odometry] is missing; {EXAMPLE}")
        stated = self.odometry.in_files or self.odometry.speed or self.odometry.length
        columns = COLUMNS[self.odometry.kind] if stated else ()
        if ("turn_rate" in columns and self.odometry.turn_rate is None) != (self.turns is not None):
            takes = f"kind {self.odometry.kind!r} takes {', '.join(columns) or 'no columns'}"
            raise ValueError(f"{takes}; turn rates stand in [odometry], or in [turns] where they are in other files")
        for source in sources:
            if self.format == "csv" and not source.in_files:
                raise ValueError('format = "csv" takes file = "..."')
            is_mutual = isinstance(source, ReadingColumns) and not source.names_other
            if is_mutual and source.in_files and len(self.robots) != 2:
                raise ValueError('what was measured: other = "the column of names", or {other} in the name of the file')
            named = source.robot or source.names_robot or (is_mutual and isinstance(source, RangesTable))
            if source.in_files and len(self.robots) > 1 and not named:
                raise ValueError('whose lines are they: file = "..._{robot}.csv", or robot = "the column of names"')
        return self

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        names = [
            *self.robots,
            *(self.anchors.places if self.anchors else ()),
            *(self.landmarks.places if self.landmarks else ()),
        ]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"{twice!r} is the name of two things among robots, anchors and landmarks; rename one")
        for table in self._sources:
            for key in ("clock_offset", "heading_offset", "bearing_offset", "turn_bias"):
                offsets = getattr(table, key, 0.0)
                named = offsets if isinstance(offsets, Mapping) else ()
                if stranger := next((name for name in named if name not in self.robots), ""):
                    raise ValueError(f"{key} names {stranger!r}; {nearest(stranger, list(self.robots))}")
        together = self.format == "csv" and len({(t.file, t.time) for t in self._sources}) == 1
        if self.sample.tick == "lines" and not (together and len(self.robots) == 1):
            raise ValueError('tick = "lines" takes one robot, and one CSV file that has everything of a run')
        if self.arena and not all(low < high for low, high in zip(*self.arena, strict=True)):
            raise ValueError("arena is the lower left and the upper right corner [m]: arena = [[0, 0], [6, 4]]")
        return self


# ---- Reading a description; an error is one line that names key and remedy

KINDS: tuple[type[Strict], ...] = (Odometry, Turns, GroundTruth, RangesTable, RssiTable, SightingsTable)
NAMES = (
    *("odometry", "turns", "truth", "ranges", "rssi", "sightings"),
    *("anchors", "landmarks", "sample", "prior", "fit", "model"),
)
TABLES: Mapping[str, type[Strict]] = dict(
    zip(NAMES, (*KINDS, PlacesTable, PlacesTable, Sample, Prior, Fit, Model), strict=True)
)


def load(path: Path) -> TeamDescription:
    """Return a team's description."""
    try:
        return parse(path, path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BadInput(f"{path}: there is no such file; {EXAMPLE}") from None
    except (OSError, UnicodeDecodeError) as e:
        raise BadInput(f"{path}: cannot be read as TOML ({e}); correct it") from None


FOUND = "# FOUND (sure): "  # begins a comment of `cooploc inspect`


def open_findings(path: Path) -> list[str]:
    """Return what is odd for sure, by the comments in a description; but for [model], which is fitted in any case."""
    table, found = "", list[str]()
    for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else ():
        table = line.strip() if line.startswith("[") else table
        if line.startswith(FOUND) and table != "[model]":
            found.append(
                f"{path.name} says in {table}: {line.removeprefix('# ')}; remove this comment where it is settled"
            )
    return found[:3] + [f"{path.name} says FOUND of {len(found) - 3} things more"] * (len(found) > 3)


def parse(path: Path, text: str) -> TeamDescription:
    """Return a description from the text of a file at `path`."""
    try:
        return TeamDescription.model_validate(tomllib.loads(text))
    except ValidationError as e:
        raise BadInput(f"{path}: {_reason(e)}") from None
    except (tomllib.TOMLDecodeError, RecursionError) as e:
        raise BadInput(f"{path}: cannot be read as TOML ({e}); correct it") from None


def _reason(e: ValidationError) -> str:
    """Return key and remedy of an error; an unknown key comes first, as it explains one that is missing."""
    first = min(e.errors(), key=lambda error: error["type"] != "extra_forbidden")
    path = [str(part) for part in first["loc"] if str(part).isidentifier() and part != "float"]  # of a union
    if first["type"] == "extra_forbidden":
        table, key = str(first["loc"][0]) if len(first["loc"]) > 1 else "", str(first["loc"][-1])
        known = list(TABLES.get(table, TeamDescription).model_fields)
        return f"there is no key {key!r}{f' in [{table}]' if table else ''}; {nearest(key, known)}"
    hint = f"; {EXAMPLE}" if first["type"] == "missing" else ""
    return f"{'.'.join(path)}{': ' if path else ''}{plain_words(first)}{hint}"
