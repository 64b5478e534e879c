"""Recordings of a team in CSV files, and in topics of a bag read as tables, as `log.toml` describes them."""

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import permutations, product
from pathlib import Path
from reprlib import repr as short_repr
from typing import NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput, count_of, first_of
from cooploc.estimators.interface import Array
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings import schema
from cooploc.scenarios.recordings.schema import (
    GroundTruth,
    LogColumn,
    Odometry,
    ReadingColumns,
    Source,
    TeamDescription,
    Turns,
    values_of,
)
from cooploc.scenarios.recordings.team_log import (
    Measured,
    Series,
    TeamLog,
    build_log,
    compose_poses,
    order_series,
    reading_tables,
    without_leaps,
    without_missing,
)
from cooploc.scenarios.recordings.text_files import (
    files_below,
    parse_field,
    read_lines,
    read_text,
    split_fields,
    unwrap_stamps,
)


def find_runs(data: Path, description: TeamDescription) -> dict[str, Path]:
    """Return the runs in a directory: itself, if its files are there, else each directory in it that has them."""
    file = (description.odometry.file if description.odometry else None) or ""
    pattern = file.replace("[", "[[]").replace("{robot}", "*").replace("{run}", "*")
    if description.run:
        places = sorted(data.glob(pattern))
        words = {
            run_in(description, names) for path in places for names in read_lines(path, (), [description.run]).names
        }
        found = dict.fromkeys(sorted(words - {""}), data)
    elif "{run}" in file:
        found = dict.fromkeys(_runs_of_files(data, file, {*description.robots, *description.moves.nodes}), data)
    elif any(data.glob(pattern)):
        found = {data.resolve().name: data}
    else:
        found = {place.name: place for place in sorted(data.iterdir()) if place.is_dir() and any(place.glob(pattern))}
    if not found:
        raise BadInput(
            f"{data}: neither it nor a directory in it has a file {file}; put the runs there, or "
            "correct `file` in [odometry] of log.toml"
        )
    return found


def run_in(description: TeamDescription, names: Sequence[str], k: int = 0) -> str:
    """Return the name of the run that is in field k of a line: its word, or trial7 of 7 in the column `trial`."""
    number = parse_field(names[k])
    return f"{description.run}{number:g}" if np.isfinite(number) else names[k].strip()


def _runs_of_files(data: Path, file: str, robots: Collection[str]) -> list[str]:
    """Return the runs of which a file, such as {run}_odom_{robot}.csv, is there of any robot."""
    run, words = "(?P<run>[^/]+)", "|".join(map(re.escape, robots))
    signs = {"*": "[^/]*", "{robot}": f"(?:{words})", "{run}": run}
    pattern = "".join(signs.get(part, re.escape(part)) for part in re.split(r"(\*|\{robot\}|\{run\})", file))
    first, *rest = pattern.split(run)
    whole = re.compile(first + run + "(?P=run)".join(rest))
    names = (path.relative_to(data).as_posix() for path in files_below(data))
    return sorted({match["run"] for name in names if (match := whole.fullmatch(name))})


def find_file(place: Path, name: str) -> Path:
    """Return a file by its name, where * stands for what one file alone has there, such as when it was written."""
    found = sorted(place.glob(re.sub(r"[\[?]", r"[\g<0>]", name))) if "*" in name else ()
    if len(found) > 1:
        some = first_of(path.relative_to(place).as_posix() for path in found)
        raise BadInput(f"{place / name}: this is of {some}; keep one there, or correct `file` in log.toml")
    return found[0] if found else place / name


class RunFiles(NamedTuple):
    """A run that is being read."""

    place: Path  # directory of its files
    name: str
    description: TeamDescription
    warnings: list[str]
    topics: "Callable[[Source, Sequence[LogColumn | None], Sequence[str]], Iterator[CsvRows]] | None" = None  # of a bag
    zero: Array | float = 0.0  # (columns of time,) subtracted before they are summed, which keeps the nanoseconds


def read_run(place: Path, name: str, description: TeamDescription) -> TeamLog:
    """Read one run."""
    return read_tables(place, RunFiles(place, name, description, []))


def read_tables(place: Path, run: RunFiles) -> TeamLog:
    """Read the tables of a run; `place` is named in messages."""
    d, zero = run.description, 0.0
    moves, poses = d.moves, d.truth
    if d.sample.tick == "lines" and poses:
        rows = next(rows_of(run, poses, [poses.x, poses.y], ()))
        known = np.flatnonzero(np.isfinite(rows.values).all(-1) & np.isfinite(rows.time))
        if not len(known):
            raise BadInput(f"{rows.path}: no line has a true position; check the columns named in [truth]")
        run = run._replace(zero=np.asarray(rows.stamp[known[0]], float))
        zero = float((run.zero * np.array([column.factor for column in moves.time])).sum())
    odometry, truth = read_motion(run, moves), read_motion(run, poses) if poses else {}
    if d.turns:
        turns = read_motion(run, d.turns)
        odometry = {
            robot: with_turns(series, turns[robot], d.turns.heading is not None, moves.kind, d.sample.max_hold)
            for robot, series in odometry.items()
            if robot in turns
        }
    readings = {
        kind: [m for table in tables for m in read_measurements(run, table, (*d.robots, *fixed.names))]
        for kind, tables, fixed in reading_tables(d)
    }
    warnings = list(dict.fromkeys(run.warnings))  # several tables may be in one file
    return build_log(place, run.name, d, odometry, truth, readings, warnings)._replace(zero=zero)


class CsvRows(NamedTuple):
    """Lines of one file or topic of a source."""

    path: Path | str
    stamp: Array  # (m, columns of time)  as in the file
    time: Array  # (m,) [s]
    robot: list[str]  # (m,) as named in the description
    other: list[str]  # (m,) empty where the source has none
    values: Array  # (m, k) in SI units; nan where a field is empty or a column is None


def rows_of(
    run: RunFiles, source: Source, columns: Sequence[LogColumn | None], others: Sequence[str]
) -> Iterator[CsvRows]:
    """Yield the lines of every file or topic of a source in one run."""
    if run.topics and not source.in_files:
        yield from run.topics(source, columns, others)
        return
    pattern = (source.file or "").replace("{run}", run.name)
    words_for: dict[str, list[str]] = {}  # of a robot, in names of files and columns
    for word, name in source.nodes.items():
        words_for.setdefault(name, []).append(word)
    numbers = [*source.time, *(column for column in columns if column is not None)]
    names = [name for column in numbers for name in column.columns]
    of = source.other if isinstance(source, ReadingColumns) else None
    whose, what = ([column.column] if column is not None else [] for column in (source.robot, of))
    named = [*whose, *[run.description.run] * bool(run.description.run), *what]
    mates = dict(permutations(run.description.robots, 2))  # of two, the only one
    robots = run.description.robots if source.robot is None else ("",)  # "": a column gives the name
    in_columns, k = "{other}" in "".join(names), len(source.time)
    lines_of: dict[tuple[Path, tuple[str, ...]], tuple[str, str]] = {}
    for robot, other in product(robots, others if in_columns or "{other}" in pattern else ("",)):
        for a, b in (
            product(*([*words_for.get(n, []), n] for n in (robot, other))) if robot != other or not robot else ()
        ):
            file, *filled = (name.replace("{robot}", a).replace("{other}", b) for name in (pattern, *names))
            lines_of[find_file(run.place, file), tuple(filled)] = robot, other
    if not any(path.is_file() for path, _ in lines_of):
        raise BadInput(f"{next(iter(lines_of))[0]}: there is no such file; put it there, or correct `file` in log.toml")
    for (path, own), (robot, other) in lines_of.items():
        if not path.is_file():
            continue
        if in_columns and not {*own} <= {*split_fields(read_text(path)[:100_000])[0]}:
            continue
        lines = read_lines(path, own, named)
        if run.description.run:
            mine = [k for k, n in enumerate(lines.names) if run_in(run.description, n, len(whose)) == run.name]
            lines = lines._replace(values=lines.values[mine], names=[lines.names[k] for k in mine])
        run.warnings.extend(lines.notes)
        stamp = lines.values[:, :k]
        time, notes = unwrap_stamps(((stamp - run.zero) * [c.factor for c in source.time]).sum(-1))
        run.warnings.extend(f"{path}: {note}" for note in notes)
        values = in_si(lines.values[:, k:], columns)
        who = [source.nodes.get(names[0], names[0]) if source.robot else robot for names in lines.names]
        things = {**source.nodes, **getattr(source, "others", {})}
        seen = [things.get(names[-1], names[-1]) if of else other for names in lines.names]
        seen = seen if of or other else [mates.get(one, "") for one in who]
        yield CsvRows(path, stamp, time + values_of(source.clock_offset, who), who, seen, values)


def in_si(numbers: Array, columns: Sequence[LogColumn | None]) -> Array:
    """Return columns (m, k) in SI units from their numbers (m, fields), those of one quantity together; None: nan."""

    def read(c: LogColumn, of: Sequence[Array]) -> Array:
        return _heading(*of) if c.quaternion else c.factor * (np.hypot(*of) if c.norm else of[0])

    rest, none = iter(numbers.T), np.full(len(numbers), np.nan)
    si = [none if c is None else read(c, [next(rest) for _ in c.columns]) for c in columns]
    return np.array(si).T.reshape(-1, len(columns))


def _heading(*xyzw: Array) -> Array:
    """Return the angles about z [rad] of quaternions: x, y, z, w, each (m,), or z and w; nan where all are zero."""
    z, w = xyzw[-2:]
    x, y = xyzw[:2] if len(xyzw) == 4 else (0 * z, 0 * z)
    there = np.any(np.not_equal(xyzw, 0.0), axis=0)
    return np.where(there, np.arctan2(2 * (w * z + x * y), w**2 + x**2 - y**2 - z**2), np.nan)


def columns_of(table: Source) -> list[LogColumn | None]:
    """Return the columns, or fields, that a table reads, in their order; None where it does not name one."""
    if isinstance(table, Turns):
        return [table.turn_rate or table.heading]
    if isinstance(table, ReadingColumns):
        return list(getattr(table, "each", {}).values()) or [getattr(table, name) for name in table.columns]
    names = schema.COLUMNS[table.kind if isinstance(table, Odometry) else "pose"]
    return [getattr(table, name) for name in names if name != "turn_rate" or getattr(table, name)]


def read_motion(run: RunFiles, table: Odometry | Turns | GroundTruth) -> Mapping[str, Series]:
    """Return the odometry, its turns or the truth of each robot, from the first file that has lines of it."""
    columns = columns_of(table)
    steps = isinstance(table, Odometry) and table.kind == "increment"
    found: dict[str, Series] = {}
    strangers = set[str]()
    for rows in rows_of(run, table, columns, ()):
        for robot in dict.fromkeys(rows.robot):
            mine = np.flatnonzero([name == robot for name in rows.robot])
            if robot in run.description.robots and robot not in found:
                values = rows.values[mine]
                if steps:
                    values[:, 1] = 0.0 if columns[1] is None else values[:, 1]  # no motion to the side
                    values[np.isnan(values[:, 2])] = np.nan  # of a step without its turn nothing is known
                found[robot], notes = order_series(rows.time[mine], values, str(rows.path))
                if isinstance(table, Odometry) and table.kind == "path":
                    found[robot], leaps = without_leaps(found[robot])
                    notes += leaps
                if steps and len(found[robot].time):
                    found[robot] = found[robot]._replace(values=compose_poses(found[robot].values[1:]))
                run.warnings.extend(notes)
            elif robot not in run.description.robots and robot not in strangers:
                strangers.add(robot)
                left_out = f"{len(mine)} lines of {short_repr(robot)}, which is not in `robots`, were left out"
                run.warnings.append(f"{rows.path}: {left_out}")
    return found


def with_turns(moves: Series, turns: Series, are_headings: bool, kind: str, hold: float) -> Series:
    """Return odometry with the turns of another sensor: lines at the stamps of both, each value held until the next.

    `moves` is speeds (m, 1) [m/s], or with kind "path" metres driven, which are interpolated; `turns` is turn rates
    (n, 1) [rad/s], or headings [rad]. Nothing is held for longer than `hold` [s].
    """
    source, first = f"{moves.source}, {turns.source}", moves.values[:, 0]
    if not len(moves.time) or not len(turns.time):
        return Series(np.empty(0), np.empty((0, 2)), source)
    rate, time = turns.values[:, 0], np.union1d(moves.time, turns.time)
    if are_headings:
        rate = np.append(wrap(np.diff(rate)) / np.diff(turns.time), 0.0)

    def hold_last(at: Array, values: Array) -> Array:
        last = np.searchsorted(at, time, "right") - 1
        return np.where((last >= 0) & (time - at[last] <= hold), values[last], np.nan)

    moved = np.interp(time, moves.time, first, np.nan, np.nan) if kind == "path" else hold_last(moves.time, first)
    values = np.stack([moved, hold_last(turns.time, rate)], -1)
    both = np.isfinite(values).all(-1)
    if not both.any():
        raise BadInput(f"{source}: they have no time in common; correct time or clock_offset in [turns] of log.toml")
    return Series(time[both], values[both], source)


def read_measurements(run: RunFiles, table: ReadingColumns, names: Sequence[str]) -> Iterator[Measured]:
    """Yield the measurements in each file of a table, of things by these names."""
    each: Mapping[str, LogColumn] = getattr(table, "each", {})  # the column of each thing that is measured
    for rows in rows_of(run, table, columns_of(table), names):
        stamped = np.isfinite(rows.time)
        if not stamped.all():
            left_out = f"left out {count_of(int((~stamped).sum()), 'line')} without a stamp"
            run.warnings.append(f"{rows.path}: {left_out}")
        robots, others = ([n for n, s in zip(of, stamped, strict=True) if s] for of in (rows.robot, rows.other))
        values = without_missing(table, rows.values[stamped], robots)
        m = max(len(each), 1)
        yield Measured(
            np.repeat(rows.time[stamped], m),
            [robot for robot in robots for _ in range(m)],
            list(each) * len(robots) if each else others,
            values.reshape(-1, 1) if each else values,
            str(rows.path),
        )
