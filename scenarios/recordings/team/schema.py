"""The description of a team's recordings: `log.toml`, which says what the files, columns and topics mean.

It begins with `format` (a description without one is of one robot: `logs.schema`) and has a table for each thing that
was recorded. In CSV files a column is its name where the file is in SI units, else `{column = "x", unit = "mm"}`:

    format = "csv"
    robots = ["red", "blue"]
    arena = [[0, 0], [6, 4]]          # lower left and upper right corner [m]

    [odometry]
    kind = "velocity"
    file = "odom_{robot}.csv"         # a file for each robot; or one file for all with robot = "column of names"
    time = ["sec", { column = "nsec", unit = "ns" }]
    speed = "v"
    turn_rate = { column = "w", unit = "deg/s" }

    [truth]                           # files of its own, with its own clock
    file = "mocap_{robot}.csv"
    clock_offset = 0.0                # [s] added to its stamps
    x = "x"
    y = "y"
    heading = "yaw"

    [ranges]                          # or several tables [[ranges]]
    file = "uwb.csv"
    robot = "from"
    other = "to"                      # a robot, or an anchor
    range = { column = "distance", unit = "mm" }

    [fit]
    on = "first part"                 # which is then not judged
    seconds = 60.0

In a bag there are topics instead: `topic = "/{robot}/odom"`, `topic = "/uwb/{robot}/{other}/distance"`.
"""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.logs.columns import Strict
from cooploc.scenarios.recordings.logs.toml_errors import parse
from cooploc.scenarios.recordings.team.schema_tables import COLUMNS as COLUMNS
from cooploc.scenarios.recordings.team.schema_tables import GroundTruth as GroundTruth
from cooploc.scenarios.recordings.team.schema_tables import Name as Name
from cooploc.scenarios.recordings.team.schema_tables import Odometry as Odometry
from cooploc.scenarios.recordings.team.schema_tables import Place as Place
from cooploc.scenarios.recordings.team.schema_tables import Places as Places
from cooploc.scenarios.recordings.team.schema_tables import Ranges as Ranges
from cooploc.scenarios.recordings.team.schema_tables import Readings as Readings
from cooploc.scenarios.recordings.team.schema_tables import Rssi as Rssi
from cooploc.scenarios.recordings.team.schema_tables import Several as Several
from cooploc.scenarios.recordings.team.schema_tables import Sightings as Sightings
from cooploc.scenarios.recordings.team.schema_tables import Source as Source
from cooploc.scenarios.worlds.radio import Positive

NAME = "log.toml"
EXAMPLE = "cooploc inspect DIR writes such a file"

Format = Literal["csv", "bag", "pyfg", "mrclam"]


class Sample(Strict):
    """The ticks that the recording is divided into."""

    tick: Annotated[float, Field(ge=0.01, le=60)] = 0.1  # [s]
    max_gap: Positive = 0.5  # [s] truth is not interpolated across longer gaps
    max_hold: Positive = 2.0  # [s] a speed or a turn rate holds until the next line, at most so long
    start: Annotated[float, Field(ge=0)] = 0.0  # [s] left out at the beginning
    ranges_go_to: Literal["both", "measurer"] = "both"  # both: a pair's ranges go to its robots in turn, each once
    duration: Positive | None = None  # [s] at most


class Prior(Strict):
    """What each robot knows of its start, and from which source."""

    position: Literal["first truth", "arena"] | dict[Name, Place] = "first truth"  # or its place [m] by robot
    position_sd: Positive = 0.05  # [m] per axis; "arena": uniform
    heading: Literal["first truth", "first motion", "unknown"] | dict[Name, float] = "first truth"  # or [rad] by robot
    heading_sd: Positive = 0.05  # [rad]


class Fit(Strict):
    """What the models are fitted on; never on what is judged."""

    on: Literal["other runs", "first part", "nothing"] = "other runs"  # nothing: [model] states all
    seconds: Positive | None = None  # [s] how long the first part is

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
    """What the recordings of a team mean."""

    format: Format
    about: str = ""
    robots: tuple[Name, ...] = ()  # their names, in the order of the results; PyFG and MRCLAM name their own
    delimiter: Literal[",", ";", "\t", "|", " "] = ","  # of CSV files
    arena: tuple[Place, Place] | None = None  # lower left and upper right corner [m]; else 2 m around all fixed things
    set_ups: tuple[str, ...] = ("*",)  # runs whose names match one pattern had the same hardware and site
    odometry: Odometry | None = None
    truth: GroundTruth | None = None
    ranges: Annotated[tuple[Ranges, ...], Several] = ()
    rssi: Annotated[tuple[Rssi, ...], Several] = ()
    sightings: Annotated[tuple[Sightings, ...], Several] = ()
    anchors: Places | None = None
    landmarks: Places | None = None
    sample: Sample = Sample()
    prior: Prior = Prior()
    fit: Fit = Fit()
    model: Model = Model()

    @model_validator(mode="after")
    def _has_sources(self) -> Self:
        sources = [s for s in (self.odometry, self.truth, *self.ranges, *self.rssi, *self.sightings) if s]
        if self.format in ("pyfg", "mrclam"):
            if sources:
                raise ValueError(
                    f'format = "{self.format}" says itself where everything is; remove [odometry], [truth] ...'
                )
            return self
        if not self.robots:
            raise ValueError('robots is missing; name them: robots = ["red", "blue"]')
        if self.odometry is None or self.truth is None:
            raise ValueError(f"[{'odometry' if self.odometry is None else 'truth'}] is missing; {EXAMPLE}")
        for source in sources:
            if source.in_files != (self.format == "csv"):
                raise ValueError(
                    f'format = "{self.format}" takes {"file" if self.format == "csv" else "topic"} = "..."'
                )
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
        for table, of in (("position", self.prior.position), ("heading", self.prior.heading)):
            if isinstance(of, dict) and self.robots and set(of) != set(self.robots):
                raise ValueError(
                    f"[prior] {table} names {', '.join(of) or 'none'}; name each of {', '.join(self.robots)}"
                )
        if self.arena and not all(low < high for low, high in zip(*self.arena, strict=True)):
            raise ValueError("arena is the lower left and the upper right corner [m]: arena = [[0, 0], [6, 4]]")
        return self


TABLES: dict[str, type[Strict]] = {
    "odometry": Odometry,
    "truth": GroundTruth,
    "ranges": Ranges,
    "rssi": Rssi,
    "sightings": Sightings,
    "anchors": Places,
    "landmarks": Places,
    "sample": Sample,
    "prior": Prior,
    "fit": Fit,
    "model": Model,
}


def load(path: Path) -> TeamDescription:
    """The description in a file.

    Raises:
        BadInput: the file is missing or not TOML, or a key or value is wrong; names the line and the key.

    """
    return parse(path, text_of(path), TeamDescription, TABLES, EXAMPLE)


def text_of(path: Path) -> str:
    """The text of a description.

    Raises:
        BadInput: the file is missing or cannot be read.

    """
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise BadInput(f"{path}: there is no such file; {EXAMPLE}") from None
    except (OSError, UnicodeDecodeError) as e:
        raise BadInput(f"{path}: cannot be read as TOML ({e}); correct it") from None
