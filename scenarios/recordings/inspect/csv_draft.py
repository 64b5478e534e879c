"""A log.toml for a directory of CSV files: the meaning and the robot of each column, with the reasons."""

import re
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.inspect.draft_toml import Draft, DraftTable, Entry
from cooploc.scenarios.recordings.inspect.infer_columns import CsvTable, Guess, read_csv, words_of
from cooploc.scenarios.recordings.schema import COLUMNS, UNITS

ENDINGS = (".csv", ".txt", ".tsv")
REMEDY = 'name the files odom_NAME.csv and truth_NAME.csv, or write log.toml by hand; README, "Your own robots"'
READINGS = ("ranges", "rssi", "sightings")
STAMPS = ("time", "sec", "nsec")
KINDS = ("velocity", "path", "displacement", "pose")  # of odometry; the first whose columns a file has
ANCHORS = {"anchor", "anchors", "node", "nodes", "beacon", "beacons", "ap"}
LANDMARKS = {"landmark", "landmarks", "marker", "markers", "tag", "tags"}


class TablePart(NamedTuple):
    """Columns that belong to one table of log.toml, in files with the same columns."""

    table: str  # "odometry", "truth", "ranges", "rssi", "sightings", "anchors" or "landmarks"
    files: tuple[CsvTable, ...]
    columns: dict[str, Guess]  # quantity -> column; with time, robot and other where the files have them
    kind: str = ""  # of odometry
    each: tuple[Guess, ...] = ()  # a column for each thing that is measured

    def names(self, quantity: str) -> tuple[str, ...]:
        """Return the names in the column of a quantity; none without one."""
        if quantity not in self.columns:
            return ()
        return tuple(dict.fromkeys(n for file in self.files for n in file.names(self.columns[quantity].column)))

    @property
    def file_names(self) -> list[str]:
        """The names of the files, as in log.toml."""
        return [file.name for file in self.files]


def csv_draft(data: Path) -> Draft:
    """Return the draft for a directory of CSV files, or of runs with such files.

    Raises:
        BadInput: there are none, or nothing in them is odometry or truth.

    """
    return _draft_run(_first_run(data), data)[0]


def _first_run(data: Path) -> Path:
    """The first directory that is a run by itself, with robots of its own names; else the whole directory.

    `red/odom.csv` is of a robot, `monday/odom_red.csv` of a run: only the latter says in itself which robot it is of.
    """
    inside = [p for p in sorted(data.iterdir()) if p.is_dir() and _text_files(p)]
    if not inside or any(_has_stamps(p) for p in _text_files(data) if p.parent == data):
        return data
    try:
        return inside[0] if len(_draft_run(inside[0], data)[1]) > 1 else data
    except BadInput:
        return data


def _draft_run(folder: Path, data: Path) -> tuple[Draft, tuple[str, ...]]:
    """The draft for the CSV files of one run, with those beside the runs, which are of all; and its robots."""
    files, unused = _read_files(folder, data)
    delimiter, why = files[0].delimiter, "their names in the names of the files, or in a column"
    entries = [Entry("format", "csv", f"{len(files)} text files with columns")]
    runs = folder == data and _are_runs_of_one_robot(files)
    if runs:
        why = f"{len(files)} files of the same columns, one after the other in time: runs of one robot"
        files = files[:1]
    parts = _merge_alike([part for file in files for part in _parts(file)], unused)
    for needed in ("odometry", "truth"):
        if needed not in {part.table for part in parts}:
            unread = next((line for line in unused if line.startswith(str(data))), "")
            raise BadInput(unread or f"{folder}: no file has columns that look like {needed}; {REMEDY}")
    robots = ("robot",) if runs else _robots(folder, parts)
    wheels = next(part for part in parts if part.table == "odometry")
    still_there = robots if runs else tuple(robot for robot in robots if _count_lines(wheels, robot, robots) > 1)
    if still_there and still_there != robots:
        lost = ", ".join(robot for robot in robots if robot not in still_there)
        unused.append(f"{lost}: fewer than two lines of odometry")
        robots = still_there
    entries.append(Entry("robots", list(robots), why, "likely"))
    if delimiter != ",":
        entries.append(Entry("delimiter", delimiter, "between the names in the first line"))
    places = {name for part in parts for name in part.names("name")}
    drafted = [_table(part, robots, places, runs) for part in parts]
    unused += [table for table in drafted if isinstance(table, str)]
    tables = [table for table in drafted if isinstance(table, DraftTable)]
    columns = []
    for file in files:
        for g in file.guesses:
            quantity = (g.quantity or "not known") + f" [{g.unit}]" * bool(g.unit)
            columns.append((file.name, g.column, quantity, g.reason))
        if unknown := [g.column for g in file.guesses if not g.quantity]:
            unused.append(f"{file.name}: columns {', '.join(unknown)}")
    return Draft(tuple(entries), tuple(tables), tuple(columns), tuple(unused)), robots


# --- Files


def _read_files(folder: Path, data: Path) -> tuple[list[CsvTable], list[str]]:
    """Every CSV file of a run, and those beside the runs, such as places of anchors; and notes that are no tables.

    Raises:
        BadInput: there is none, or one cannot be read.

    """
    files, unread = [], []
    for path in dict.fromkeys([*_text_files(folder), *(p for p in _text_files(data) if p.parent == data)]):
        name = path.relative_to(folder if path.is_relative_to(folder) else data).as_posix()
        try:
            files.append(read_csv(path, name))
        except BadInput as e:
            unread.append(f"{name}: a text, and no table" if path.suffix.lower() == ".txt" else str(e))
    if not files:
        raise BadInput(
            next((line for line in unread if line.startswith(str(data))), "")
            or f"{folder}: there is no CSV file, bag, PyFG file or MRCLAM text in it; name another directory"
        )
    usual = Counter(file.delimiter for file in files).most_common(1)[0][0]
    if strange := next((file for file in files if file.delimiter != usual), None):
        raise BadInput(
            f"{folder / strange.name}, line 1: {strange.delimiter!r} between the names, and {usual!r} in most files; "
            "save it as the others"
        )
    return files, unread


def _text_files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.rglob("*") if p.is_file() and p.suffix.lower() in ENDINGS)


def _has_stamps(path: Path) -> bool:
    """Return whether a file has stamps, and so belongs to one run; a file without may belong to all."""
    try:
        return any(guess.quantity in ("time", "sec") for guess in read_csv(path, path.name).guesses)
    except BadInput:
        return False


def _are_runs_of_one_robot(files: Sequence[CsvTable]) -> bool:
    """Return whether all files have the same columns, with odometry and truth, and follow each other in time."""
    stamps = []
    for file in files:
        parts = {part.table: part.columns for part in _parts(file)}
        same = file.columns.keys() == files[0].columns.keys()
        if not same or not {"odometry", "truth"} <= parts.keys() or "robot" in parts["odometry"]:
            return False
        t = file.numbers(next(parts["odometry"][q].column for q in STAMPS if q in parts["odometry"]))
        if len(t) > 1:
            stamps.append((t[0], t[-1]))
    overlaps = sum(later[0] < earlier[1] for earlier, later in pairwise(sorted(stamps)))
    return len(stamps) > 1 and overlaps < len(stamps) / 2


# --- Tables that columns belong to


def _parts(file: CsvTable) -> list[TablePart]:
    """The tables that a file's columns belong to; a file without stamps can only hold places."""
    shared = _first(file.guesses, (*STAMPS, "robot", "other"))
    if {"time", "sec"} <= shared.keys():
        shared = {q: g for q, g in shared.items() if q not in ("sec", "nsec")}
    if not shared.keys() & {"time", "sec"}:
        return _places(file)
    parts, left = [], list(file.guesses)
    for kind in KINDS:
        own = _first(file.guesses, COLUMNS[kind], ("odometry",) if kind == "pose" else ("", "odometry"))
        if len(own) == len(COLUMNS[kind]):
            parts.append(TablePart("odometry", (file,), shared | own, kind))
            left = [g for g in left if g not in own.values()]
            break
    sides = ("truth",) if any(g.side == "truth" and g.quantity == "x" for g in left) else ("",)
    truth = _first(left, ("x", "y", "heading"), sides)
    if {"x", "y"} <= truth.keys():
        parts.append(TablePart("truth", (file,), shared | truth))
    ranges, bearings, rssi = ([g for g in left if g.quantity == q] for q in ("range", "bearing", "rssi"))
    if bearings and ranges:
        parts.append(TablePart("sightings", (file,), shared | {"range": ranges[0], "bearing": bearings[0]}))
    for table, quantity, found in (("ranges", "range", ranges), ("rssi", "rssi", rssi)):
        if len(found) > 1:  # a column for each thing measured
            alone = {q: g for q, g in shared.items() if q != "other"}
            parts.append(TablePart(table, (file,), alone, each=tuple(found)))
        elif found and not (quantity == "range" and bearings):
            parts.append(TablePart(table, (file,), shared | {quantity: found[0]}))
    return parts


def _places(file: CsvTable) -> list[TablePart]:
    """A file of names and places; of anchors, if its name does not speak of landmarks."""
    own = _first(file.guesses, ("x", "y", "robot", "other"))
    label = own.get("robot") or own.get("other") or next((g for g in file.guesses if g.column not in ("x", "y")), None)
    if not {"x", "y"} <= own.keys() or label is None:
        return []
    words = {*words_of(Path(file.name).stem), *words_of(label.column)}
    table = "landmarks" if words & LANDMARKS and not words & ANCHORS else "anchors"
    return [TablePart(table, (file,), {"name": label, "x": own["x"], "y": own["y"]})]


def _first(
    guesses: Sequence[Guess], quantities: Sequence[str], sides: Sequence[str] = ("", "truth", "odometry")
) -> dict[str, Guess]:
    """The first column of each quantity on some sides."""
    found = {g.quantity: g for g in reversed(guesses) if g.side in sides}
    return {q: found[q] for q in quantities if q in found}


def _merge_alike(parts: Sequence[TablePart], unused: list[str]) -> list[TablePart]:
    """Merge parts of the same table and columns; of odometry and truth keep the one with the most files.

    A column whose unit seems to differ between files is read in SI, and a check tells more.
    """
    alike: dict[Any, list[TablePart]] = {}
    for part in parts:
        names = frozenset((q, g.column) for q, g in part.columns.items())
        alike.setdefault((part.table, part.kind, names, tuple(g.column for g in part.each)), []).append(part)
    merged: dict[str, list[TablePart]] = {}
    for group in alike.values():
        columns = group[0].columns.copy()
        for q, guess in columns.items():
            units = [part.columns[q].unit for part in group]
            if len({*units}) > 1:
                seen = ", ".join(f"{p.files[0].name} {unit}" for p, unit in zip(group, units, strict=True))
                unit = next((u for u in units if u in UNITS), guess.unit)
                columns[q] = guess._replace(unit=unit, reason=f"files differ: {seen}, perhaps")
        files = tuple(part.files[0] for part in group)
        merged.setdefault(group[0].table, []).append(group[0]._replace(columns=columns, files=files))
    kept = []
    for table, own in merged.items():
        own.sort(key=lambda part: -len(part.files))
        count = len(own) if table in READINGS else 1
        kept += own[:count]
        for part in own[count:]:
            files_ = ", ".join(part.file_names)
            unused.append(f"{files_}: looks like {table} too, but has other columns than the rest; make them alike")
    return kept


# --- Robots


def _robots(folder: Path, parts: Sequence[TablePart]) -> tuple[str, ...]:
    """Names from a column of names, else from the files' names, else the one file's name."""
    own = [part for part in parts if part.table in ("odometry", "truth")]
    if column := next((part for part in own if "robot" in part.columns), None):
        return column.names("robot")
    for part in sorted(own, key=lambda part: -len(part.files)):
        if names := file_pattern(part.file_names)[1]:
            return names
    files = {name for part in own for name in part.file_names}
    if len(files) == 1:
        return (Path(files.pop()).stem,)
    raise BadInput(f"{folder}: neither the names of files nor a column says which robot is which; {REMEDY}")


def _count_lines(part: TablePart, robot: str, robots: tuple[str, ...]) -> int:
    """Return how many lines of a table are of a robot."""
    if "robot" in part.columns:
        column = part.columns["robot"].column
        return sum(file.words(column).count(robot) for file in part.files)
    pattern = file_pattern(part.file_names, robots)[0]
    return max((file.lines for file in part.files if file.name == pattern.replace("{robot}", robot)), default=0)


def file_pattern(files: Sequence[str], known: Sequence[str] = ()) -> tuple[str, tuple[str, ...]]:
    """Return the pattern that most files share, with {robot} in it, and the robots in the order of the files.

    odom_red.csv and odom_blue.csv are odom_{robot}.csv of red and blue. `known`: names of robots, for a single file.
    """
    patterns: dict[str, list[str]] = {}  # pattern -> the word that it stands for, of each file
    for file in files:
        stem, dot, ending = file.rpartition(".")
        for word in dict.fromkeys(re.findall(r"[^/_\-. ]+", stem)):
            whole_word = rf"(?<![^/_\-. ]){re.escape(word)}(?![^/_\-. ])"
            patterns.setdefault(re.sub(whole_word, "{robot}", stem) + dot + ending, []).append(word)
    if len(files) == 1:
        patterns = {pattern: words for pattern, words in patterns.items() if words[0] in known}
    best = max(patterns, key=lambda pattern: (len(patterns[pattern]), len(pattern)), default=files[0])
    robots = patterns.get(best, [])
    return (best, tuple(dict.fromkeys(robots))) if len(robots) > 1 or len(files) == len(robots) else (files[0], ())


# --- Lines of log.toml


def _table(part: TablePart, robots: tuple[str, ...], places: set[str], runs: bool) -> DraftTable | str:
    """One table of log.toml; or why it cannot be used."""
    table, files, columns, readings = part.table, part.file_names, part.columns, part.table in READINGS
    names = ", ".join(files)
    if table in ("anchors", "landmarks"):
        lines = [_entry(quantity, guess) for quantity, guess in columns.items()]
        return DraftTable(table, (Entry("file", files[0], "it has names and places, and no stamps"), *lines))
    pattern, named = file_pattern(files, robots)
    if runs:
        file = Entry("file", f"{{run}}{Path(files[0]).suffix}", "a file for each run")
    elif "robot" in columns and (len(files) == 1 or not named):
        file = Entry("file", files[0], "one file for all robots")
    elif {*named} & {*robots}:
        file = Entry("file", pattern, f"a file for each robot: {names}")
        columns = {q: g for q, g in columns.items() if q != "robot"}
    else:
        return f"{names}: looks like {table}, but does not say whose it is; add a column `robot`"
    time = [columns[q] for q in STAMPS if q in columns]
    stamps, why = [_column(guess) for guess in time], "; ".join(guess.reason for guess in time)
    entries = [Entry("kind", part.kind, "its columns")] if part.kind else []
    entries += [file, Entry("time", stamps if len(stamps) > 1 else stamps[0], why)]
    entries += [_entry(q, columns[q]) for q in columns if q not in STAMPS and (q != "other" or readings)]
    nodes: dict[str, str] = {}
    for quantity in ("robot", "other"):
        nodes |= _nodes(part.names(quantity), robots, places) if quantity in columns else {}
    if nodes:
        why = "names in the files that are not names of robots, in their order"
        entries.append(Entry("nodes", nodes, why, "perhaps"))
    if part.each:
        each: dict[str, Any] = {}
        for guess in part.each:
            fits = [name for name in (*robots, *places) if guess.column.lower().endswith(name.lower())]
            each |= {name: _column(guess) for name in sorted(fits, key=len)[-1:]}
        if not each:
            measured = ", ".join(guess.column for guess in part.each)
            return f"{names}: {measured}: it is not known where what they measure is; add [anchors]"
        entries.append(Entry("each", each, "a column for each thing that is measured", "likely"))
    elif readings and "other" not in columns:
        return f"{names}: looks like {table}, but does not say to whom; add a column `to` with names"
    return DraftTable(table, tuple(entries))


def _entry(quantity: str, guess: Guess) -> Entry:
    weak = "perhaps" in guess.reason or "too " in guess.reason
    return Entry(quantity, _column(guess), guess.reason, "perhaps" if weak else "likely")


def _column(guess: Guess) -> Any:
    """A column in TOML: its name alone if its unit is SI."""
    return guess.column if guess.unit in UNITS else {"column": guess.column, "unit": guess.unit}


def _nodes(names: Sequence[str], robots: tuple[str, ...], places: set[str]) -> dict[str, str]:
    """Names in a column -> names of robots: those that differ in case or by a prefix, else in their order."""
    strange = [name for name in names if name not in robots and name not in places]
    found = {}
    for name in strange:
        alike = [r for r in robots if r.lower().endswith(name.lower()) or name.lower().endswith(r.lower())]
        if len(alike) == 1:
            found[name] = alike[0]
    if not found and len(strange) == len(robots) and not {*names} & {*robots}:
        found = dict(zip(sorted(strange), robots, strict=True))
    return found
