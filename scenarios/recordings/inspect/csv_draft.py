"""A log.toml for a directory of CSV files: which columns are what, whose they are, and why it is thought so."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.inspect.csv_folder import csv_files, has_stamps, relative, text_files
from cooploc.scenarios.recordings.inspect.csv_look import CsvLook
from cooploc.scenarios.recordings.inspect.csv_tables import files_of, names_in, table_of
from cooploc.scenarios.recordings.inspect.guesses import Guess
from cooploc.scenarios.recordings.inspect.tables import Part, parts_of
from cooploc.scenarios.recordings.inspect.templates import template_of
from cooploc.scenarios.recordings.inspect.toml_text import Entry, Table

REMEDY = 'name the files odom_NAME.csv and truth_NAME.csv, or write log.toml by hand; README, "Your own robots"'


class CsvDraft(NamedTuple):
    """What is thought of a directory of CSV files."""

    robots: tuple[str, ...]
    entries: tuple[Entry, ...]  # outside of tables
    tables: tuple[Table, ...]
    files: tuple[tuple[CsvLook, tuple[Guess, ...]], ...]
    unused: tuple[str, ...]  # files and columns that went nowhere, and why


def run_folder(data: Path) -> Path:
    """The first directory that is a run by itself, with robots of its own names; else the whole directory.

    `red/odom.csv` is of a robot, `monday/odom_red.csv` of a run: only the latter says in itself who is who.
    """
    inside = [p for p in sorted(data.iterdir()) if p.is_dir() and text_files(p)]
    if not inside or any(has_stamps(p) for p in text_files(data) if p.parent == data):
        return data
    try:
        alone = csv_draft(inside[0], data)
    except BadInput:
        return data
    return inside[0] if len(alone.robots) > 1 else data


def csv_draft(folder: Path, shared: Path | None = None) -> CsvDraft:
    """The draft for the CSV files of one run, with those in `shared` itself, which are of all runs.

    Raises:
        BadInput: there are none, or nothing in them is odometry or truth.

    """
    files, unread = csv_files(folder, shared)
    parts = [part for look, found in files for part in parts_of(look, found)]
    groups, unused = _groups(folder, parts)
    for needed in ("odometry", "truth"):
        if needed not in {table for table, _ in groups}:
            raise BadInput(f"{folder}: no file has columns that look like {needed}; {REMEDY}")
    robots = _robots(folder, groups)
    named = {name for part in parts if part.table in ("anchors", "landmarks") for name in names_in(part, "name")}
    tables = [table_of(folder, table, group, robots, named, unused) for table, group in groups]
    kept = [table for table in tables if table is not None]
    twice = Counter(table.name for table in kept)
    kept = [table._replace(repeated=twice[table.name] > 1) for table in kept]
    delimiter = files[0][0].delimiter
    entries = (
        Entry("format", "csv", f"{len(files)} text files with columns"),
        Entry("robots", list(robots), "their names in the names of the files, or in a column", "likely"),
        *([Entry("delimiter", delimiter, "between the names in the first line")] if delimiter != "," else []),
    )
    return CsvDraft(robots, entries, tuple(kept), files, (*unread, *unused, *_unknown(folder, files)))


def _groups(folder: Path, parts: Sequence[Part]) -> tuple[list[tuple[str, list[Part]]], list[str]]:
    """Parts with the same table and columns together; of odometry and truth only the largest group."""
    same: dict[tuple[Any, ...], list[Part]] = {}
    for part in parts:
        columns = tuple(sorted((q, g.column) for q, g in part.columns.items()))
        same.setdefault((part.table, part.kind, columns, tuple(g.column for g in part.each)), []).append(part)
    chosen: list[tuple[str, list[Part]]] = []
    unused = []
    for table in dict.fromkeys(part.table for part in parts):
        groups = sorted((group for key, group in same.items() if key[0] == table), key=len, reverse=True)
        several = groups if table in ("ranges", "rssi", "sightings") else groups[:1]
        chosen += [(table, group) for group in several]
        for group in groups[len(several) :]:
            names = ", ".join(relative(part.look.path, folder) for part in group)
            unused.append(f"{names}: looks like {table} too, but has other columns than the rest; make them alike")
    return chosen, unused


def _robots(folder: Path, groups: Sequence[tuple[str, list[Part]]]) -> tuple[str, ...]:
    """Names from a column of names, else from the files' names, else the one file's name."""
    own = [group for table, group in groups if table in ("odometry", "truth")]
    for group in own:
        if "robot" in group[0].columns:
            return names_in(group[0], "robot")
    for group in sorted(own, key=len, reverse=True):
        if found := template_of(files_of(folder, group)).robots:
            return found
    files = {file for group in own for file in files_of(folder, group)}
    if len(files) == 1:
        return (Path(next(iter(files))).stem,)
    raise BadInput(f"{folder}: neither the names of files nor a column says which robot is which; {REMEDY}")


def _unknown(folder: Path, files: Sequence[tuple[CsvLook, tuple[Guess, ...]]]) -> list[str]:
    """Columns of which nothing is known, file by file."""
    told = []
    for look, found in files:
        columns: Mapping[str, Guess] = {g.column: g for g in found if not g.quantity}
        if columns:
            told.append(f"{relative(look.path, folder)}: not used: {', '.join(columns)}")
    return told
