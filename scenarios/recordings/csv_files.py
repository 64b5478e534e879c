"""The lines of one source in CSV files: whose they are, of what, and when."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings import schema
from cooploc.scenarios.recordings.schema import LogColumn, ReadingColumns, Source, TeamDescription
from cooploc.scenarios.recordings.team_log import (
    Channel,
    Measured,
    Places,
    Readings,
    Series,
    TeamLog,
    divided,
    in_order,
    odometry_of,
    truth_of,
)
from cooploc.scenarios.recordings.text_files import Lines, read_lines


class Rows(NamedTuple):
    """Lines of one file."""

    lines: Lines
    time: Array  # (m,) [s]
    robot: list[str]  # (m,) as named in the description
    other: list[str]  # (m,) empty where the source has none
    values: Array  # (m, k) in SI units; nan where a field is empty or a column is None

    def of(self, robot: str) -> "Rows":
        """The lines of one robot."""
        rows = [row for row, name in enumerate(self.robot) if name == robot]
        lines = self.lines._replace(line=self.lines.line[rows])
        return Rows(lines, self.time[rows], [robot] * len(rows), [self.other[r] for r in rows], self.values[rows])


def rows_of(
    place: Path,
    source: Source,
    columns: Sequence[LogColumn | None],
    robots: Sequence[str],
    others: Sequence[str],
    delimiter: str,
) -> Iterator[Rows]:
    """The lines of every file of a source.

    Raises:
        BadInput: none of its files is there, or one is malformed.

    """
    files = list(_files(place, source, robots, others))
    found = [item for item in files if item[0].is_file()]
    if not found:
        raise BadInput(f"{files[0][0]}: there is no such file; put it there, or correct `file` in log.toml")
    for path, robot, other in found:
        yield _read(path, source, columns, robot, other, delimiter)


def measured(rows: Rows, each: Sequence[str]) -> Measured:
    """Measurements of a file; `each`: the names of what its columns measure, if there is one for each."""
    if not each:
        return Measured(rows.time, rows.robot, rows.other, rows.values, str(rows.lines.path))
    m = len(each)
    return Measured(
        np.repeat(rows.time, m),
        [robot for robot in rows.robot for _ in each],
        list(each) * len(rows.robot),
        rows.values.reshape(-1, 1),
        str(rows.lines.path),
    )


def _files(
    place: Path, source: Source, robots: Sequence[str], others: Sequence[str]
) -> Iterator[tuple[Path, str | None, str | None]]:
    """(path, robot, other), None where a column says which."""
    pattern = source.file or ""
    called = {name: written for written, name in source.nodes.items()}
    for robot in robots if "{robot}" in pattern or source.robot is None else (None,):
        for other in others if "{other}" in pattern else (None,):
            if robot is None or robot != other:
                names = {"{robot}": robot, "{other}": other}
                yield place / _filled(pattern, names, called), robot, other


def _filled(pattern: str, names: Mapping[str, str | None], called: Mapping[str, str]) -> str:
    for mark, name in names.items():
        if name is not None:
            pattern = pattern.replace(mark, called.get(name, name))
    return pattern


def _read(
    path: Path,
    source: Source,
    columns: Sequence[LogColumn | None],
    robot: str | None,
    other: str | None,
    delimiter: str,
) -> Rows:
    there = [column for column in columns if column is not None]
    of = source.other if isinstance(source, ReadingColumns) else None
    named = [column.column for column in (source.robot, of) if column is not None]
    lines = read_lines(path, [c.column for c in (*source.time, *there)], named, delimiter)
    scaled = lines.values * [c.factor for c in (*source.time, *there)]
    stamps, rest = scaled[:, : len(source.time)], iter(scaled[:, len(source.time) :].T)
    values = np.array([np.full(len(scaled), np.nan) if c is None else next(rest) for c in columns])
    words = [[source.nodes.get(word, word) for word in names] for names in lines.names]
    whose = [robot if robot is not None else names[0] for names in words]
    what = [other if other is not None else (names[-1] if of is not None else "") for names in words]
    return Rows(lines, stamps.sum(-1) + source.clock_offset, whose, what, values.T.reshape(-1, len(columns)))


# The places of anchors or landmarks: in the description itself, or in a CSV file beside it.


def places(data: Path, declared: schema.Places | None, delimiter: str) -> Places:
    """The fixed things that a table of the description names, those of the file last.

    Raises:
        BadInput: the file is missing or malformed, or names a thing twice.

    """
    found: dict[str, tuple[float, float]] = dict(declared.places) if declared else {}
    if declared and declared.file and declared.name and declared.x and declared.y:
        columns = (declared.x, declared.y)
        path = data / declared.file
        lines = read_lines(path, [c.column for c in columns], [declared.name.column], delimiter)
        for row, (name,) in enumerate(lines.names):
            if name in found or np.isnan(lines.values[row]).any():
                why = "was given before" if name in found else "has no place"
                raise BadInput(f"{lines.at(row)}: {name!r} {why}; correct or remove the line")
            x, y = lines.values[row] * [c.factor for c in columns]
            found[name] = float(x), float(y)
    return Places(tuple(found), np.array(list(found.values()), float).reshape(-1, 2))


# Recordings of a team in CSV files, as `log.toml` describes them.

SourceTable = TypeVar("SourceTable", bound=Source)


def runs(data: Path, description: TeamDescription) -> dict[str, Path]:
    """The runs in a directory: itself, if its files are there, else each directory in it that has them.

    Raises:
        BadInput: there are none.

    """
    file = (description.odometry.file if description.odometry else None) or ""
    if "{run}" in file:  # a file for each run of one robot
        begin, end = file.split("{run}", 1)
        names = {path.name.removeprefix(begin).removesuffix(end): data for path in sorted(data.glob(f"{begin}*{end}"))}
        if names:
            return names
    pattern = file.replace("{robot}", "*").replace("[", "[[]")
    if any(data.glob(pattern)):
        return {data.resolve().name: data}
    found = {place.name: place for place in sorted(data.iterdir()) if place.is_dir() and any(place.glob(pattern))}
    if not found:
        raise BadInput(
            f"{data}: neither it nor a directory in it has a file {file}; put the runs there, or "
            "correct `file` in [odometry] of log.toml"
        )
    return found


def read(data: Path, place: Path, name: str, description: TeamDescription) -> TeamLog:
    """One run.

    Raises:
        BadInput: a file or column is missing, or a line is malformed; names file, line and remedy.

    """
    if description.odometry is None or description.truth is None:
        raise BadInput(f"{data}: log.toml lacks [odometry] or [truth]; add the table")
    robots = description.robots
    warnings: list[str] = []
    moves, poses = _of_run(description.odometry, name), _of_run(description.truth, name)
    columns = [getattr(moves, name) for name in schema.COLUMNS[moves.kind]]
    odometry = odometry_of(place, _by_robot(place, description, moves, columns, warnings), robots)
    found_poses = _by_robot(place, description, poses, [poses.x, poses.y, poses.heading], warnings)
    truth = truth_of(place, found_poses, robots, poses, warnings)
    anchors = places(data, description.anchors, description.delimiter)
    landmarks = places(data, description.landmarks, description.delimiter)
    readings: dict[Channel, Readings] = {}
    for kind, tables, fixed in (
        ("range", description.ranges, anchors.names),
        ("rssi", description.rssi, anchors.names),
        ("sighting", description.sightings, landmarks.names),
    ):
        several = [
            m for table in tables for m in _measured(place, description, table, (*robots, *fixed), warnings, name)
        ]
        found, told = divided(kind, several, robots, fixed)  # type: ignore[arg-type]
        readings |= found
        warnings += told
    return TeamLog(
        name, robots, description.odometry.kind, odometry, truth, readings, landmarks, anchors, tuple(warnings)
    )


def _of_run(table: SourceTable, run: str) -> SourceTable:
    """A table of log.toml whose file is that of one run."""
    return table.model_copy(update={"file": (table.file or "").replace("{run}", run)})


def _by_robot(
    place: Path, d: TeamDescription, table: schema.Source, columns: Sequence[LogColumn | None], warnings: list[str]
) -> Mapping[str, Series]:
    found: dict[str, list[Rows]] = {}
    for rows in rows_of(place, table, columns, d.robots, (), d.delimiter):
        warnings += [rows.lines.cut_off] if rows.lines.cut_off else []
        for robot in dict.fromkeys(rows.robot):
            found.setdefault(robot, []).append(rows.of(robot))
    ordered = {}
    for robot, (rows, *_) in found.items():
        if robot not in d.robots:
            warnings.append(
                f"{rows.lines.path}: {len(rows.time)} lines of {robot!r}, which is not in `robots`, were left out"
            )
            continue
        ordered[robot], told = in_order(rows.time, rows.values, str(rows.lines.path), rows.lines.at)
        warnings += told
    return ordered


def _measured(
    place: Path, d: TeamDescription, table: schema.ReadingColumns, names: Sequence[str], warnings: list[str], run: str
) -> list[Measured]:
    each: Mapping[str, LogColumn] = getattr(table, "each", {})
    columns = list(each.values()) or [getattr(table, name) for name in VALUES[type(table)]]
    found = []
    for rows in rows_of(place, _of_run(table, run), columns, d.robots, names, d.delimiter):
        warnings += [rows.lines.cut_off] if rows.lines.cut_off else []
        if np.isnan(rows.time).any():
            where = rows.lines.at(int(np.argmax(np.isnan(rows.time))))
            raise BadInput(f"{where}: the stamp is missing; correct or remove the line")
        one = measured(rows, list(each))
        if isinstance(table, schema.Rssi):
            one.values[one.values >= table.missing_from] = np.nan
        found.append(one)
    return found


VALUES: Mapping[type[schema.ReadingColumns], tuple[str, ...]] = {
    schema.Ranges: ("range",),
    schema.Rssi: ("rssi",),
    schema.Sightings: ("range", "bearing"),
}
