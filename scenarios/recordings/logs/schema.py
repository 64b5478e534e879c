"""What the columns of a user's own log mean: a small TOML file beside the CSV files.

Only `[time]`, `[odometry]`, `[truth]` and `[prior]` must be there. A column is its name where the file is in SI units,
else `{column = "name", unit = "cm"}`. `wifi.log.toml` is a commented example.
"""

import re
import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from cooploc.estimators import nearest
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.recordings.logs.columns import Angle, Metres, Number, Power, Seconds, Speed, Strict, TurnRate
from cooploc.scenarios.worlds.radio_arena import Positive

NAME = "log.toml"  # of the description in a directory of logs
Place = tuple[float, float]  # [m]


class Time(Strict):
    """The stamps of the lines. Each line after the first ends a tick."""

    columns: Annotated[tuple[Seconds, ...], Field(min_length=1)]  # summed: seconds and nanoseconds
    max_gap: Positive | None = None  # [s] between lines; what was commanded is unknown across more [5 median intervals]


class Odometry(Strict):
    """What the robot knows of its motion.

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
    def _complete(self) -> Self:
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
    """Where the robot really was; empty where nobody knows."""

    x: Metres
    y: Metres
    heading: Angle | None = None  # counter-clockwise from x
    repeats: Literal["stale", "still"] = "still"  # what it means when a position equals the one before, digit by digit
    max_speed: Positive | None = None  # [m/s] a position that cannot be reached from the last good one does not count


class Anchors(Strict):
    """Radio nodes at known places. An empty reading is missing, and so is what the other keys say."""

    positions: Annotated[tuple[Place, ...], Field(min_length=1)]
    rssi: tuple[Power, ...]  # one column for each position
    status: tuple[Number, ...] = ()  # one for each, or none: where it is 0, the reading is missing
    missing_from: float = 0.0  # [dBm] a reading of this or more is missing

    @model_validator(mode="after")
    def _paired(self) -> Self:
        for name in ("rssi", "status"):
            count = len(getattr(self, name))
            if count != len(self.positions) and not (name == "status" and count == 0):
                raise ValueError(f"there are {len(self.positions)} positions and {count} {name} columns; pair them")
        return self


class Prior(Strict):
    """What the robot is told of its start, and from where that is known."""

    position: Literal["first truth", "arena"] | Place = "first truth"
    position_sd: Positive | None = None  # [m] per axis; of "arena" that of a uniform distribution over it
    heading: Literal["first motion", "first truth", "unknown"] | float = "first motion"
    heading_sd: Positive = 0.2  # [rad]

    @model_validator(mode="after")
    def _stated(self) -> Self:
        if self.position != "arena" and self.position_sd is None:
            raise ValueError("position_sd [m] must be stated")
        return self


class Model(Strict):
    """Parameters of the assumed models. What is not stated is fitted on the other runs."""

    A: float | None = None  # [dBm] at 1 m
    eta: Positive | None = None  # path-loss exponent
    sigma: Positive | None = None  # [dB] that the team is told
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
    set_ups: tuple[str, ...] = ("*",)  # runs whose names fit the same pattern had the same hardware in the same place
    time: Time
    odometry: Odometry
    truth: GroundTruth
    anchors: Anchors | None = None
    prior: Prior
    model: Model = Model()

    @model_validator(mode="after")
    def _whole(self) -> Self:
        places = self.arena or (self.anchors.positions if self.anchors else ())
        if len({x for x, _ in places}) < 2 or len({y for _, y in places}) < 2:
            raise ValueError("anchors do not span an arena here; state its corners [m]: arena = [[0, 0], [6, 4]]")
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
    """The description in a TOML file.

    Raises:
        BadInput: it is not there, no TOML, or says what cannot be; names the line of an unknown key.

    """
    try:
        text = path.read_text(encoding="utf-8")
        content = tomllib.loads(text)
    except FileNotFoundError:
        raise BadInput(
            f"{path}: there is no such file; describe the columns of the log there, as the shipped wifi.log.toml does"
        ) from None
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError) as e:
        raise BadInput(f"{path}: cannot be read as TOML ({e}); repair it") from None
    _demand_known(path, text, content)
    try:
        return Description(**content)
    except ValidationError as e:
        first = e.errors()[0]
        named = [str(part) for part in first["loc"] if str(part).isidentifier() or isinstance(part, int)]
        raise BadInput(f"{path}: {'.'.join([*named, ''])} {first['msg'].removeprefix('Value error, ')}") from None


def shipped(name: str) -> Any:
    """The path of a description that comes with cooploc."""
    return files(__package__) / f"{name}.{NAME}"


def _demand_known(path: Any, text: str, content: Mapping[str, Any]) -> None:
    """Refuse an unknown key, with its line and the nearest one."""
    known = {"": list(Description.model_fields), **{name: list(t.model_fields) for name, t in TABLES.items()}}
    for name, part in (("", content), *((k, v) for k, v in content.items() if k in TABLES and isinstance(v, Mapping))):
        for key in part:
            if key not in known[name]:
                where = f"{path}{_line(text, key)}"
                raise BadInput(
                    f"{where}: there is no key {key!r}{name and f' in [{name}]'}; {nearest(key, known[name])}"
                )


def _line(text: str, key: str) -> str:
    """ ", line N" of a key's first appearance."""
    for i, line in enumerate(text.splitlines(), 1):
        if re.match(rf"\s*(\[\s*|[\w.]*\.)?[\"']?{re.escape(key)}[\"']?\s*[=.\]]", line):
            return f", line {i}"
    return ""
