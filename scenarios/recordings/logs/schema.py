"""The description of a user's log: a small TOML file beside the CSV files that states what their columns mean.

`[time]`, `[odometry]`, `[truth]` and `[prior]` are required. A column is its name where the file is in SI units, else
`{column = "name", unit = "cm"}`. `wifi.log.toml` is a commented example.
"""

from importlib.resources import files
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.logs.columns import Angle, Metres, Number, Power, Seconds, Speed, Strict, TurnRate
from cooploc.scenarios.recordings.logs.toml_errors import parse
from cooploc.scenarios.worlds.radio import Positive

NAME = "log.toml"  # of the description in a directory of logs
Place = tuple[float, float]  # [m]


class Time(Strict):
    """The stamps of the lines. Each line after the first ends a tick."""

    columns: Annotated[tuple[Seconds, ...], Field(min_length=1)]  # summed: seconds and nanoseconds
    max_gap: Positive | None = None  # [s] across a longer interval commands are unknown; None: 5 median intervals


class Odometry(Strict):
    """What the robot measures of its own motion.

    path: `length` driven so far (a counter) and `turn_rate`. velocity: `speed` and `turn_rate`.
    displacement: `dx`, `dy` since the line before, in a compass frame.
    """

    kind: Literal["path", "velocity", "displacement"]
    length: Metres | None = None
    speed: Speed | None = None
    turn_rate: TurnRate | None = None
    dx: Metres | None = None
    dy: Metres | None = None
    holds: Literal["until the next line", "since the line before"] | None = None  # a speed, a turn rate

    @model_validator(mode="after")
    def _has_its_columns(self) -> Self:
        needed = {
            "path": {"length", "turn_rate", "holds"},
            "velocity": {"speed", "turn_rate", "holds"},
            "displacement": {"dx", "dy"},
        }[self.kind]
        given = {name for name in type(self).model_fields if name != "kind" and getattr(self, name) is not None}
        if given != needed:
            raise ValueError(f"kind {self.kind!r} takes {', '.join(sorted(needed))}, not {', '.join(sorted(given))}")
        return self


class GroundTruth(Strict):
    """The true poses; an empty field where they are unknown."""

    x: Metres
    y: Metres
    heading: Angle | None = None  # counter-clockwise from x
    repeats: Literal["stale", "still"] = "still"  # meaning of a position that equals the previous one exactly
    max_speed: Positive | None = None  # [m/s] a position that cannot be reached from the last valid one is invalid


class Anchors(Strict):
    """Radio nodes at known positions. A reading is missing where its field is empty, or as the other keys state."""

    positions: Annotated[tuple[Place, ...], Field(min_length=1)]
    rssi: tuple[Power, ...]  # one column for each position
    status: tuple[Number, ...] = ()  # one for each, or none: where it is 0, the reading is missing
    missing_from: float = 0.0  # [dBm] a reading of this or more is missing

    @model_validator(mode="after")
    def _one_column_each(self) -> Self:
        for name in ("rssi", "status"):
            count = len(getattr(self, name))
            if count != len(self.positions) and not (name == "status" and count == 0):
                raise ValueError(f"{len(self.positions)} positions have {count} {name} columns; give one for each")
        return self


class Prior(Strict):
    """What the robot knows of its start, and from which source."""

    position: Literal["first truth", "arena"] | Place = "first truth"
    position_sd: Positive | None = None  # [m] per axis; not needed for "arena": uniform
    heading: Literal["first motion", "first truth", "unknown"] | float = "first motion"
    heading_sd: Positive = 0.2  # [rad]

    @model_validator(mode="after")
    def _has_position_sd(self) -> Self:
        if self.position != "arena" and self.position_sd is None:
            raise ValueError("position_sd [m] is missing; state it")
        return self


class Model(Strict):
    """Parameters of the assumed models. Those that are not stated are fitted on the other runs."""

    A: float | None = None  # [dBm] at 1 m
    eta: Positive | None = None  # path-loss exponent
    sigma: Positive | None = None  # [dB] as assumed by the filters
    length_scale: Positive | None = None  # true length by odometry's
    turn_scale: Positive | None = None  # true turn by odometry's
    sigma_v: Positive | None = None  # [m/s] at the median interval
    sigma_omega: Positive | None = None  # [rad/s] at the median interval
    sigma_move: Positive | None = None  # [m] per axis in the median interval, of displacements


class Description(Strict):
    """What a log's columns mean."""

    about: str = ""
    files: str = "*.csv"  # the runs
    delimiter: Literal[",", ";", "\t", "|", " "] = ","
    arena: tuple[Place, Place] | None = None  # lower left and upper right corner [m]; of the anchors where not stated
    set_ups: tuple[str, ...] = ("*",)  # runs whose names match one pattern had the same hardware and site
    time: Time
    odometry: Odometry
    truth: GroundTruth
    anchors: Anchors | None = None
    prior: Prior
    model: Model = Model()

    @model_validator(mode="after")
    def _spans_an_arena(self) -> Self:
        places = self.arena or (self.anchors.positions if self.anchors else ())
        if len({x for x, _ in places}) < 2 or len({y for _, y in places}) < 2:
            raise ValueError("the anchors do not span an arena; state its corners [m]: arena = [[0, 0], [6, 4]]")
        if self.prior.heading == "first truth" and self.truth.heading is None:
            raise ValueError('prior heading = "first truth" needs a heading column in [truth]')
        return self


TABLES: dict[str, type[Strict]] = {
    "time": Time,
    "odometry": Odometry,
    "truth": GroundTruth,
    "anchors": Anchors,
    "prior": Prior,
    "model": Model,
}


def load(path: Any) -> Description:
    """The description in a TOML file, a path or a shipped resource.

    Raises:
        BadInput: the file is missing or not TOML, or a key or value is wrong; names the line and the key.

    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise BadInput(
            f"{path}: there is no such file; describe the columns of the log there, as the shipped wifi.log.toml does"
        ) from None
    except (OSError, UnicodeDecodeError) as e:
        raise BadInput(f"{path}: cannot be read as TOML ({e}); correct it") from None
    return parse(path, text, Description, TABLES, "the shipped wifi.log.toml is an example")


def shipped(name: str) -> Any:
    """The path of a description that comes with cooploc."""
    return files(__package__) / f"{name}.{NAME}"
