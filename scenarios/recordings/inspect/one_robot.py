"""CSV files that are runs of one robot, one after the other: the log.toml of a single robot, and its first run.

Files with the same columns are robots of a team where their stamps overlap, and runs of one robot where they do not.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from cooploc.estimators.errors import BadInput, nearest
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.inspect.csv_look import CsvLook
from cooploc.scenarios.recordings.inspect.guesses import Guess
from cooploc.scenarios.recordings.inspect.tables import Part, parts_of
from cooploc.scenarios.recordings.inspect.toml_text import Entry, Table
from cooploc.scenarios.recordings.schema import UNITS
from cooploc.scenarios.recordings.team_log import OdometryKind, Places, Series, TeamLog

FACTORS = {unit: factor for units in UNITS.values() for unit, factor in units.items()}
KINDS: dict[str, tuple[OdometryKind, tuple[str, ...]]] = {
    "velocity": ("velocity", ("speed", "turn_rate")),
    "path": ("path", ("length", "turn_rate")),
    "displacement": ("displacement", ("dx", "dy")),
}
Files = Sequence[tuple[CsvLook, tuple[Guess, ...]]]


def is_one_robot(files: Files) -> bool:
    """Whether several files with the same columns, odometry and truth among them, follow each other in time."""
    if len(files) < 2 or len({tuple(look.columns) for look, _ in files}) > 1:
        return False
    parts = [_needed(look, found) for look, found in files]
    if not all(parts) or any("robot" in part.columns for pair in parts if pair for part in pair):
        return False
    stamps = sorted(
        (float(t[0]), float(t[-1])) for pair in parts if pair and len(t := _values(pair[0], *_time(pair[0]))) > 1
    )
    overlaps = sum(later[0] < earlier[1] for earlier, later in pairwise(stamps))
    return len(stamps) > 1 and overlaps < len(stamps) / 2


def one_robot_log(files: Files, run: str) -> TeamLog:
    """A run as a team of one; the first if `run` is empty.

    Raises:
        BadInput: there is no run of this name, or it has no stamps.

    """
    names = [look.path.stem for look, _ in files]
    if run and run not in names:
        raise BadInput(f"{files[0][0].path.parent}: there is no run {run!r}; {nearest(run, names)}")
    look, found = files[names.index(run) if run else 0]
    needed = _needed(look, found)
    if needed is None:
        raise BadInput(f"{look.path}: it has no odometry or no truth; get the file again")
    wheels, truth = needed
    time = _values(wheels, *_time(wheels))
    kind, columns = KINDS[wheels.kind]
    poses = np.full((len(time), 3), np.nan)
    for k, name in enumerate(("x", "y", "heading")):
        if name in truth.columns:
            poses[:, k] = _values(truth, name)
    order = np.argsort(time, kind="stable")
    order = order[np.isfinite(time[order])]
    odometry = np.stack([_values(wheels, name) for name in columns], -1)
    nothing = Places((), np.empty((0, 2)))
    return TeamLog(
        look.path.stem,
        ("robot",),
        kind,
        (Series(time[order], odometry[order], str(look.path)),),
        (Series(time[order], poses[order], str(look.path)),),
        {},
        nothing,
        nothing,
        (f"{look.path}: {look.dropped} lines with another number of fields",) if look.dropped else (),
    )


def one_robot_tables(files: Files) -> tuple[tuple[Entry, ...], tuple[Table, ...]]:
    """The lines of a log.toml of one robot."""
    needed = _needed(*files[0])
    if needed is None:
        return (), ()
    wheels, truth = needed
    ending = files[0][0].path.suffix
    entries: tuple[Entry, ...] = (
        Entry("files", f"*{ending}", f"{len(files)} files one after the other in time: runs of one robot"),
    )
    if files[0][0].delimiter != ",":
        entries += (Entry("delimiter", files[0][0].delimiter, "between the names in the first line"),)
    time = [_column(wheels.columns[q]) for q in _time(wheels)]
    why = "; ".join(wheels.columns[q].reason for q in _time(wheels))
    odometry = [Entry("kind", wheels.kind, "its columns")]
    odometry += [_entry(name, wheels.columns[name]) for name in KINDS[wheels.kind][1]]
    if wheels.kind != "displacement":
        odometry.append(Entry("holds", "until the next line", "usual of commands and of drivers", "perhaps"))
    places = [_entry(name, truth.columns[name]) for name in ("x", "y", "heading") if name in truth.columns]
    headed = "heading" in truth.columns
    prior = (
        Entry("position", "first truth", "what the robot knows of its start", "perhaps"),
        Entry("position_sd", 0.05, "[m] usual for a marked start", "perhaps"),
        Entry("heading", "first truth" if headed else "first motion", "as the truth has it", "likely"),
        Entry("heading_sd", 0.05 if headed else 0.2, "[rad]", "perhaps"),
    )
    tables = (
        Table("time", (Entry("columns", time, why),)),
        Table("odometry", tuple(odometry)),
        Table("truth", tuple(places)),
        Table("prior", prior),
    )
    return entries, tables


def rssi_remark(files: Files) -> tuple[str, ...]:
    """What [anchors] would need for the columns of signal strength that are there."""
    columns = [guess.column for guess in files[0][1] if guess.quantity == "rssi"]
    if not columns:
        return ()
    names = ", ".join(f'"{name}"' for name in columns)
    return (f"signal strength is not used until you add [anchors] with positions = [[x, y], ...] and rssi = [{names}]",)


def _needed(look: CsvLook, found: tuple[Guess, ...]) -> tuple[Part, Part] | None:
    """Odometry and truth of a file."""
    parts = {part.table: part for part in reversed(parts_of(look, found))}
    if "odometry" not in parts or "truth" not in parts or parts["odometry"].kind not in KINDS:
        return None
    return parts["odometry"], parts["truth"]


def _time(part: Part) -> tuple[str, ...]:
    return tuple(q for q in ("time", "sec", "nsec") if q in part.columns)


def _values(part: Part, *quantities: str) -> Array:
    """The sum of some columns in SI units (m,)."""
    total = np.zeros(part.look.rows)
    for quantity in quantities:
        guess = part.columns[quantity]
        column = part.look.columns[guess.column]
        total = total + (np.full(part.look.rows, np.nan) if isinstance(column, tuple) else column * FACTORS[guess.unit])
    return total


def _entry(name: str, guess: Guess) -> Entry:
    return Entry(name, _column(guess), guess.reason, "likely")


def _column(guess: Guess) -> Any:
    return guess.column if guess.unit in UNITS else {"column": guess.column, "unit": guess.unit}
