"""The lines of one table of log.toml for CSV files: which columns it has, and whose lines they are."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cooploc.scenarios.recordings.inspect.csv_folder import relative
from cooploc.scenarios.recordings.inspect.guesses import Guess
from cooploc.scenarios.recordings.inspect.tables import Part
from cooploc.scenarios.recordings.inspect.templates import MARK, Template, template_of
from cooploc.scenarios.recordings.inspect.toml_text import Entry, Table
from cooploc.scenarios.recordings.schema import UNITS

KEYS = {  # quantity -> key of log.toml
    "speed": "speed",
    "turn_rate": "turn_rate",
    "x": "x",
    "y": "y",
    "heading": "heading",
    "length": "length",
    "dx": "dx",
    "dy": "dy",
    "range": "range",
    "bearing": "bearing",
    "rssi": "rssi",
    "robot": "robot",
    "other": "other",
    "name": "name",
}
SI = set(UNITS)


def table_of(
    folder: Path, table: str, group: list[Part], robots: tuple[str, ...], places: set[str], unused: list[str]
) -> Table | None:
    """One table of log.toml; None where it cannot be used, and `unused` then says why."""
    part, files = _agreed(group), files_of(folder, group)
    if table in ("anchors", "landmarks"):
        lines = [_entry(quantity, guess) for quantity, guess in part.columns.items()]
        return Table(table, (Entry("file", files[0], "it has names and places, and no stamps"), *lines))
    where = _where(files, part, robots)
    if where is None:
        unused.append(f"{', '.join(files)}: looks like {table}, but does not say whose it is; add a column `robot`")
        return None
    entries = [*([Entry("kind", part.kind, "its columns")] if part.kind else []), where, _time(part)]
    nodes: dict[str, str] = {}
    for quantity, guess in part.columns.items():
        if quantity in ("time", "sec", "nsec") or (quantity == "robot" and MARK in str(where.value)):
            continue
        if quantity in ("robot", "other"):
            names = tuple(dict.fromkeys(name for one in group for name in names_in(one, quantity)))
            nodes |= _nodes(names, robots, places)
        if quantity != "other" or table in ("ranges", "rssi", "sightings"):
            entries.append(_entry(quantity, guess))
    if nodes:
        why = "names in the files that are not names of robots, in their order"
        entries.append(Entry("nodes", nodes, why, "perhaps"))
    if part.each:
        each = _each(part.each, robots, places)
        if not each:
            columns = ", ".join(guess.column for guess in part.each)
            unused.append(f"{', '.join(files)}: {columns}: it is not known where what they measure is; add [anchors]")
            return None
        entries.append(Entry("each", each, "a column for each thing that is measured", "likely"))
    elif table in ("ranges", "rssi", "sightings") and "other" not in part.columns:
        if len(robots) != 2:
            unused.append(f"{', '.join(files)}: looks like {table}, but does not say to whom; add a column `to`")
            return None
        unused.append(f"{', '.join(files)}: looks like {table} of the one other robot; add a column `to` with its name")
        return None
    return Table(table, tuple(entries))


def _agreed(group: list[Part]) -> Part:
    """The first file's part; a column whose unit seems to differ between files is read in SI, and a look tells more."""
    first, columns = group[0], {}
    for quantity, guess in first.columns.items():
        units = dict.fromkeys(part.columns[quantity].unit for part in group)
        if len(units) > 1:
            unit = next((u for u in units if u in SI), guess.unit)
            seen = ", ".join(f"{p.look.path.name} {p.columns[quantity].unit}" for p in group)
            guess = guess._replace(unit=unit, reason=f"files differ: {seen}, perhaps")
        columns[quantity] = guess
    return first._replace(columns=columns)


def _where(files: Sequence[str], part: Part, robots: tuple[str, ...]) -> Entry | None:
    """The line `file = ...`; None where nothing says whose the lines are."""
    if "robot" in part.columns and (len(files) == 1 or not template_of(files).robots):
        return Entry("file", files[0], "one file for all robots")
    template: Template = template_of(files, robots)
    if set(template.robots) & set(robots):
        return Entry("file", template.file, f"a file for each robot: {', '.join(files)}")
    return None


def _time(part: Part) -> Entry:
    """The line `time = ...`."""
    columns = [part.columns[q] for q in ("time", "sec", "nsec") if q in part.columns]
    value = [_column(guess) for guess in columns]
    return Entry("time", value[0] if len(value) == 1 else value, "; ".join(guess.reason for guess in columns))


def _entry(quantity: str, guess: Guess) -> Entry:
    weak = "perhaps" in guess.reason or "too " in guess.reason
    return Entry(KEYS[quantity], _column(guess), guess.reason, "perhaps" if weak else "likely")


def _column(guess: Guess) -> Any:
    """A column in TOML: its name alone where its unit is SI."""
    return guess.column if guess.unit in SI else {"column": guess.column, "unit": guess.unit}


def _each(columns: Sequence[Guess], robots: tuple[str, ...], places: set[str]) -> dict[str, Any]:
    """Name -> column, for columns whose names hold the name of a robot or an anchor."""
    found = {}
    for guess in columns:
        fits = [name for name in (*robots, *places) if guess.column.lower().endswith(name.lower())]
        if fits:
            found[max(fits, key=len)] = _column(guess)
    return found


def _nodes(names: Sequence[str], robots: tuple[str, ...], places: set[str]) -> dict[str, str]:
    """Names in a column -> names of robots: those that differ in case or by a prefix, else in their order."""
    strange = [name for name in names if name not in robots and name not in places]
    found: dict[str, str] = {}
    for name in strange:
        alike = [r for r in robots if r.lower().endswith(name.lower()) or name.lower().endswith(r.lower())]
        if len(alike) == 1:
            found[name] = alike[0]
    if not found and len(strange) == len(robots) and not set(names) & set(robots):
        found = dict(zip(sorted(strange), robots, strict=True))
    return found


def names_in(part: Part, quantity: str) -> tuple[str, ...]:
    """The names in a column, in order of appearance."""
    column = part.look.columns[part.columns[quantity].column]
    words = column if isinstance(column, tuple) else tuple(f"{v:g}" for v in column[np.isfinite(column)])
    return tuple(dict.fromkeys(word for word in words if word))


def files_of(folder: Path, group: Sequence[Part]) -> list[str]:
    """The names of a group's files, as in log.toml."""
    return [relative(part.look.path, folder) for part in group]
