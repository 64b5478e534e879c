"""Recordings of a team in CSV files, as `log.toml` describes them."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Indices
from cooploc.scenarios.recordings import schema
from cooploc.scenarios.recordings.schema import LogColumn, ReadingColumns, Source, TeamDescription
from cooploc.scenarios.recordings.team_log import Measured, Places, Series, TeamLog, build_log, in_order, reading_tables
from cooploc.scenarios.recordings.text_files import Table, count_of, read_lines

VALUES: Mapping[type[ReadingColumns], tuple[str, ...]] = {
    schema.Ranges: ("range",),
    schema.Rssi: ("rssi",),
    schema.Sightings: ("range", "bearing"),
}


def runs(data: Path, description: TeamDescription) -> dict[str, Path]:
    """Return the runs in a directory: itself, if its files are there, else each directory in it that has them.

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
    """Read one run.

    Raises:
        BadInput: a file or column is missing, or a line is malformed; names file, line and remedy.

    """
    d, warnings = description, list[str]()
    moves, poses = d.recorded
    odometry = _by_robot(
        place, name, d, moves, [getattr(moves, column) for column in schema.COLUMNS[moves.kind]], warnings
    )
    truth = _by_robot(place, name, d, poses, [poses.x, poses.y, poses.heading], warnings)
    anchors, landmarks = (read_places(data, table, d.delimiter) for table in (d.anchors, d.landmarks))
    readings = {
        kind: [m for table in tables for m in _measurements(place, name, d, table, (*d.robots, *fixed.names), warnings)]
        for kind, tables, fixed in reading_tables(d, anchors, landmarks)
    }
    return build_log(place, name, d, odometry, truth, readings, anchors, landmarks, warnings)


def read_places(data: Path, declared: schema.PlacesTable | None, delimiter: str) -> Places:
    """Return the fixed things that a table of the description names, those of its CSV file last.

    Raises:
        BadInput: the file is missing or malformed, or names a thing twice.

    """
    found: dict[str, tuple[float, float]] = dict(declared.places) if declared else {}
    if declared and declared.file and declared.name and declared.x and declared.y:
        columns = (declared.x, declared.y)
        lines = read_lines(data / declared.file, [c.column for c in columns], [declared.name.column], delimiter)
        for row, (name,) in enumerate(lines.names):
            if name in found or np.isnan(lines.values[row]).any():
                why = "was given before" if name in found else "has no place"
                raise BadInput(f"{lines.at(row)}: {name!r} {why}; correct or remove the line")
            x, y = lines.values[row] * [c.factor for c in columns]
            found[name] = float(x), float(y)
    return Places(tuple(found), np.array(list(found.values()), float).reshape(-1, 2))


class Rows(NamedTuple):
    """Lines of one file of a source."""

    lines: Table
    time: Array  # (m,) [s]
    robot: list[str]  # (m,) as named in the description
    other: list[str]  # (m,) empty where the source has none
    values: Array  # (m, k) in SI units; nan where a field is empty or a column is None

    def select(self, rows: Indices) -> "Rows":
        """Return these rows."""
        robot, other = ([names[i] for i in rows] for names in (self.robot, self.other))
        return Rows(self.lines, self.time[rows], robot, other, self.values[rows])


def rows_of(
    place: Path,
    run: str,
    d: TeamDescription,
    source: Source,
    columns: Sequence[LogColumn | None],
    others: Sequence[str],
    warnings: list[str],
) -> Iterator[Rows]:
    """Yield the lines of every file of a source in one run.

    Raises:
        BadInput: none of its files is there, or one is malformed.

    """
    source = source.model_copy(update={"file": (source.file or "").replace("{run}", run)})
    files = list(_files(place, source, d.robots, others))
    if not any(path.is_file() for path, _, _ in files):
        raise BadInput(f"{files[0][0]}: there is no such file; put it there, or correct `file` in log.toml")
    for path, robot, other in files:
        if path.is_file():
            rows = _read(path, source, columns, robot, other, d.delimiter)
            warnings += rows.lines.notes
            yield rows


def _files(
    place: Path, source: Source, robots: Sequence[str], others: Sequence[str]
) -> Iterator[tuple[Path, str | None, str | None]]:
    """(path, robot, other), None where a column gives the name."""
    pattern = source.file or ""
    written = {name: word for word, name in source.nodes.items()}
    for robot in robots if "{robot}" in pattern or source.robot is None else (None,):
        for other in others if "{other}" in pattern else (None,):
            if robot is None or robot != other:
                file = pattern
                for mark, name in (("{robot}", robot), ("{other}", other)):
                    file = file.replace(mark, written.get(name, name)) if name is not None else file
                yield place / file, robot, other


def _read(
    path: Path,
    source: Source,
    columns: Sequence[LogColumn | None],
    robot: str | None,
    other: str | None,
    delimiter: str,
) -> Rows:
    numbers = [*source.time, *(column for column in columns if column is not None)]
    of = source.other if isinstance(source, ReadingColumns) else None
    named = [column.column for column in (source.robot, of) if column is not None]
    lines = read_lines(path, [c.column for c in numbers], named, delimiter)
    scaled = lines.values * [c.factor for c in numbers]
    stamps, rest = scaled[:, : len(source.time)], iter(scaled[:, len(source.time) :].T)
    values = np.array([np.full(len(scaled), np.nan) if c is None else next(rest) for c in columns])
    words = [[source.nodes.get(word, word) for word in names] for names in lines.names]
    robots = [robot if robot is not None else names[0] for names in words]
    others = [other if other is not None else (names[-1] if of is not None else "") for names in words]
    return Rows(lines, stamps.sum(-1) + source.clock_offset, robots, others, values.T.reshape(-1, len(columns)))


def _by_robot(
    place: Path, run: str, d: TeamDescription, table: Source, columns: Sequence[LogColumn | None], warnings: list[str]
) -> Mapping[str, Series]:
    """The series of each robot, from the first file that has lines of it."""
    found: dict[str, Series] = {}
    strangers = set[str]()
    for rows in rows_of(place, run, d, table, columns, (), warnings):
        path = rows.lines.path
        for robot in dict.fromkeys(rows.robot):
            mine = np.flatnonzero([name == robot for name in rows.robot])
            if robot not in d.robots and robot not in strangers:
                strangers.add(robot)
                warnings.append(f"{path}: {len(mine)} lines of {robot!r}, which is not in `robots`, were left out")
            elif robot in d.robots and robot not in found:
                found[robot], notes = in_order(rows.time[mine], rows.values[mine], str(path))
                warnings += notes
    return found


def _measurements(
    place: Path, run: str, d: TeamDescription, table: ReadingColumns, names: Sequence[str], warnings: list[str]
) -> Iterator[Measured]:
    each: Mapping[str, LogColumn] = getattr(table, "each", {})  # the column of each thing that is measured
    columns = list(each.values()) or [getattr(table, name) for name in VALUES[type(table)]]
    for rows in rows_of(place, run, d, table, columns, names, warnings):
        stamped = np.isfinite(rows.time)
        if not stamped.all():
            warnings.append(f"{rows.lines.path}: left out {count_of(int((~stamped).sum()), 'line')} without a stamp")
            rows = rows.select(np.flatnonzero(stamped))
        if isinstance(table, schema.Rssi):
            rows.values[rows.values >= table.missing_from] = np.nan
        m, source = max(len(each), 1), str(rows.lines.path)
        others = list(each) * len(rows.robot) if each else rows.other
        values = rows.values.reshape(-1, 1) if each else rows.values
        yield Measured(np.repeat(rows.time, m), [r for r in rows.robot for _ in range(m)], others, values, source)
