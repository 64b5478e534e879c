"""The description of a user's log: a small TOML file beside the CSV files that states what their columns mean.

`[time]`, `[odometry]`, `[truth]` and `[prior]` are required. A column is its name where the file is in SI units, else
`{column = "name", unit = "cm"}`. `wifi.log.toml` is a commented example.
"""

from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Mask
from cooploc.scenarios.recordings.schema import (
    Angle,
    LogColumn,
    Metres,
    Number,
    Power,
    Seconds,
    Speed,
    Strict,
    TurnRate,
    parse,
)
from cooploc.scenarios.recordings.text_files import Table, read_csv
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


# Reads one run of a user's log: a CSV file whose columns a description names.
#
# What was not recorded becomes nan and is counted: readings that mean "missing", truth that repeats a stale position or
# jumps, commands across a gap.

GAP = 5.0  # [median intervals] a longer interval is a gap, unless the description gives max_gap


class LogRun(NamedTuple):
    """One run. Row 0 is before the first tick; odometry k leads from row k to row k + 1."""

    path: Path
    stamp: Array  # (T + 1,)     as in the file [s]
    time: Array  # (T + 1,)     since row 0, to the nanosecond [s]
    odometry: Array  # (T, 2)       v [m/s], omega [rad/s]; of displacements dx, dy [m]
    known: Mask  # (T,)         False across gaps
    rssi: Array  # (T + 1, a)   [dBm]
    truth: Array  # (T + 1, 3)   x [m], y [m], heading [rad]; nan where unknown
    rows: Array  # (T + 1, c)   as in the file, to find lines that two files share
    counts: dict[str, Any]  # what was dropped

    @property
    def dt(self) -> Array:
        """Length of each tick (T,) [s]."""
        return np.diff(self.time)

    @property
    def t0(self) -> float:
        """The stamp of row 0 [s]."""
        return float(self.stamp[0])

    @property
    def tick(self) -> float:
        """The median length of a tick [s]."""
        return float(np.median(self.dt))

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self.path.stem

    def shared_lines(self, other: "LogRun") -> int:
        """How many lines two runs have in common, digit by digit."""
        _, i, j = np.intersect1d(self.stamp, other.stamp, return_indices=True)
        a, b = self.rows[i], other.rows[j]
        return int(((a == b) | (np.isnan(a) & np.isnan(b))).all(-1).sum())


def read_run(path: Path, description: Description) -> LogRun:
    """One run from its CSV file.

    Raises:
        BadInput: a column is missing, a field is not a number, or the stamps do not rise; names file and line.

    """
    named: dict[str, tuple[LogColumn, ...]] = {
        "time": description.time.columns,
        "odometry": tuple(getattr(description.odometry, name) for name in _odometry_columns(description)),
        "truth": tuple(c for c in (description.truth.x, description.truth.y, description.truth.heading) if c),
        "rssi": description.anchors.rssi if description.anchors else (),
        "status": description.anchors.status if description.anchors else (),
    }
    columns = [column for group in named.values() for column in group]
    table = read_csv(path, [column.column for column in columns], description.delimiter)
    ends = np.cumsum([0, *(len(group) for group in named.values())])
    part = {name: np.s_[:, a:b] for name, a, b in zip(named, ends[:-1], ends[1:], strict=True)}
    table, unplaced = _from_first_truth(table, part["truth"])
    raw, factor = table.values, np.array([column.factor for column in columns])
    time = _elapsed(table, raw[part["time"]], factor[: ends[1]])
    scaled = raw * factor
    truth, lost = _truth(description, time, scaled[part["truth"]])
    rssi, missing = _rssi(description, scaled[part["rssi"]], raw[part["status"]])
    odometry, known = _odometry(description, time, scaled[part["odometry"]])
    counts = {
        "before_first_truth": unplaced,
        **lost,
        "rssi_missing": missing,
        "odometry_missing": int((np.isnan(odometry).any(-1) & known).sum()),
        "gaps": [
            {"line": int(table.line[k + 1]), "seconds": round(float(time[k + 1] - time[k]), 3)}
            for k in np.flatnonzero(~known)
        ],
    }
    return LogRun(path, scaled[:, : ends[1]].sum(-1), time, odometry, known, rssi, truth, raw, counts)


def _from_first_truth(table: Table, truth: Any) -> tuple[Table, int]:
    """The table from the first line on whose truth is known, and how many lines were before it."""
    there = ~np.isnan(table.values[truth]).any(-1)
    first = int(np.argmax(there))
    if there[first:].sum() < 2:
        raise BadInput(f"{table.path}: fewer than two lines have a truth; check the columns named in [truth]")
    return Table(table.path, table.values[first:], table.line[first:]), first


def _elapsed(table: Table, stamps: Array, factor: Array) -> Array:
    """Seconds since the first line; the columns are subtracted before they are summed, which keeps the nanoseconds."""
    time: Array = ((stamps - stamps[0]) * factor).sum(-1)
    bad = np.isnan(time)
    bad[1:] |= ~(np.diff(time) > 0)
    if bad.any():
        row = int(np.argmax(bad))
        later = 0.0 if row == 0 else time[row - 1] - time[row]
        fact = f"is {later:g} s before the previous line's" if later else "equals the previous line's"
        fact = "is missing" if np.isnan(time[row]) else fact
        raise BadInput(f"{table.at(row)}: its stamp {fact}; sort the file by time, or remove the line")
    return time


def _odometry_columns(description: Description) -> tuple[str, str]:
    return {"path": ("length", "turn_rate"), "velocity": ("speed", "turn_rate"), "displacement": ("dx", "dy")}[
        description.odometry.kind
    ]


def _odometry(description: Description, time: Array, values: Array) -> tuple[Array, Mask]:
    """Odometry (T, 2) between the lines, and where it is known.

    Across a gap a speed or a turn rate is unknown (nan), as it may have changed; a counter still gives the distance.
    """
    dt = np.diff(time)
    known: Mask = dt <= (description.time.max_gap or GAP * np.median(dt))
    if description.odometry.kind == "displacement":
        return values[1:], known
    held = values[:-1] if description.odometry.holds == "until the next line" else values[1:]
    u = np.where(known[:, None], held, np.nan)
    if description.odometry.kind == "path":
        u[:, 0] = np.diff(values[:, 0]) / dt
    return u, known


def _rssi(description: Description, rssi: Array, status: Array) -> tuple[Array, list[int]]:
    """Readings with nan where they are missing, and how many are, by anchor."""
    if description.anchors is None:
        return rssi, []
    missing = np.isnan(rssi) | (rssi >= description.anchors.missing_from)
    if status.shape[1]:
        missing |= ~(np.nan_to_num(status) != 0)
    return np.where(missing, np.nan, rssi), missing.sum(0).tolist()


def _truth(description: Description, time: Array, values: Array) -> tuple[Array, dict[str, Any]]:
    """True poses (T + 1, 3), nan where they are not valid, and how many are not, by reason."""
    absent = np.isnan(values).any(-1)
    stale = np.zeros(len(time), bool)
    if description.truth.repeats == "stale":
        stale[1:] = (np.diff(values[:, :2], axis=0) == 0).all(-1)
    use = ~absent & ~stale
    jumped = _unreachable(time, values[:, :2], use, description.truth.max_speed or np.inf)
    heading = values[:, 2:] if values.shape[1] > 2 else np.full((len(time), 1), np.nan)
    poses = np.where((use & ~jumped)[:, None], np.concatenate([values[:, :2], heading], -1), np.nan)
    reasons = {"absent": absent, "stale": stale & ~absent, "jumps": jumped}
    return poses, {f"truth_{reason}": int(mask.sum()) for reason, mask in reasons.items()}


def _unreachable(time: Array, positions: Array, use: Mask, speed: float) -> Mask:
    """Positions that cannot be reached from the last valid one at `speed` [m/s]."""
    bad, last = np.zeros(len(time), bool), 0
    for k in map(int, np.flatnonzero(use)[1:]):
        bad[k] = np.hypot(*(positions[k] - positions[last])) > speed * (time[k] - time[last])
        last = last if bad[k] else k
    return bad
