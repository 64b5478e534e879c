"""The lines of one source in CSV files: whose they are, of what, and when."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.logs.columns import LogColumn
from cooploc.scenarios.recordings.team.channels import Measured
from cooploc.scenarios.recordings.team.csv_lines import Lines, read_lines
from cooploc.scenarios.recordings.team.schema import Readings, Source


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
    for robot in robots if "{robot}" in pattern else (None,):
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
    of = source.other if isinstance(source, Readings) else None
    named = [column.column for column in (source.robot, of) if column is not None]
    lines = read_lines(path, [c.column for c in (*source.time, *there)], named, delimiter)
    scaled = lines.values * [c.factor for c in (*source.time, *there)]
    stamps, rest = scaled[:, : len(source.time)], iter(scaled[:, len(source.time) :].T)
    values = np.array([np.full(len(scaled), np.nan) if c is None else next(rest) for c in columns])
    words = [[source.nodes.get(word, word) for word in names] for names in lines.names]
    whose = [robot if robot is not None else names[0] for names in words]
    what = [other if other is not None else (names[-1] if of is not None else "") for names in words]
    return Rows(lines, stamps.sum(-1) + source.clock_offset, whose, what, values.T.reshape(-1, len(columns)))
