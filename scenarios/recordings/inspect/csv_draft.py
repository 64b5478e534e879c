"""A log.toml for a directory of CSV files: which columns are what, whose they are, and why it is thought so."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.inspect.draft_toml import Draft, Entry, Table
from cooploc.scenarios.recordings.inspect.infer_columns import CsvTable, Guess, read_csv, words_of
from cooploc.scenarios.recordings.schema import UNITS

ENDINGS = (".csv", ".txt", ".tsv")
REMEDY = 'name the files odom_NAME.csv and truth_NAME.csv, or write log.toml by hand; README, "Your own robots"'
READINGS = ("ranges", "rssi", "sightings")


def csv_draft(data: Path) -> Draft:
    """Return the draft for a directory of CSV files, or of runs with such files.

    Raises:
        BadInput: there are none, or nothing in them is odometry or truth.

    """
    folder = _first_run(data)
    return _draft_run(folder, data)[0]


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
    count, runs = len(files), folder == data and _are_runs_of_one_robot(files)
    if runs:
        files = files[:1]
    parts = [part for file in files for part in _parts(file)]
    groups = _groups(folder, parts, unused)
    for needed in ("odometry", "truth"):
        if needed not in {group[0].table for group in groups}:
            raise BadInput(f"{folder}: no file has columns that look like {needed}; {REMEDY}")
    robots = ("robot",) if runs else _robots(folder, groups)
    places = {name for part in parts if "name" in part.columns for name in part.names("name")}
    pattern = f"{{run}}{files[0].path.suffix}" if runs else ""
    tables = [_table(folder, group, robots, places, unused, pattern) for group in groups]
    kept = [table for table in tables if table is not None]
    twice = Counter(table.name for table in kept)
    delimiter = files[0].delimiter
    why = "their names in the names of the files, or in a column"
    if runs:
        why = f"{count} files of the same columns, one after the other in time: runs of one robot"
    entries = [
        Entry("format", "csv", f"{count} text files with columns"),
        Entry("robots", list(robots), why, "likely"),
    ]
    if delimiter != ",":
        entries.append(Entry("delimiter", delimiter, "between the names in the first line"))
    columns = []
    for file in files:
        name = _relative(file.path, folder)
        for g in file.guesses:
            columns.append((name, g.column, (g.quantity or "not known") + f" [{g.unit}]" * bool(g.unit), g.reason))
        if unknown := [g.column for g in file.guesses if not g.quantity]:
            unused.append(f"{name}: not used: {', '.join(unknown)}")
    tables_ = tuple(table._replace(repeated=twice[table.name] > 1) for table in kept)
    return Draft(tuple(entries), tables_, tuple(columns), tuple(unused)), robots


# --- Files


def _read_files(folder: Path, data: Path) -> tuple[list[CsvTable], list[str]]:
    """Every CSV file of a run, and those beside the runs, such as places of anchors; and notes that are no tables.

    Raises:
        BadInput: there is none, or one cannot be read.

    """
    files, unread = [], []
    for path in dict.fromkeys([*_text_files(folder), *(p for p in _text_files(data) if p.parent == data)]):
        try:
            files.append(read_csv(path))
        except BadInput:
            if path.suffix.lower() != ".txt":
                raise
            unread.append(f"{_relative(path, folder)}: a text, and no table")
    if not files:
        raise BadInput(f"{folder}: there is no CSV file, bag, PyFG file or MRCLAM text in it; name another directory")
    usual = Counter(file.delimiter for file in files).most_common(1)[0][0]
    if strange := next((file for file in files if file.delimiter != usual), None):
        raise BadInput(
            f"{strange.path}, line 1: {strange.delimiter!r} between the names, and {usual!r} in most files; "
            "save it as the others"
        )
    return files, unread


def _text_files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.rglob("*") if p.is_file() and p.suffix.lower() in ENDINGS)


def _has_stamps(path: Path) -> bool:
    """Whether a file is a table with a column of stamps, and so of a run; one without may be of all runs."""
    try:
        return any(guess.quantity in ("time", "sec") for guess in read_csv(path).guesses)
    except BadInput:
        return False


def _relative(path: Path, folder: Path) -> str:
    """The name of a file in log.toml: from the run's directory, or from the one above for what all runs share."""
    return path.relative_to(folder if path.is_relative_to(folder) else folder.parent).as_posix()


def _are_runs_of_one_robot(files: Sequence[CsvTable]) -> bool:
    """Whether files have the same columns, odometry and truth among them, and follow each other in time."""
    if len(files) < 2 or len({tuple(file.columns) for file in files}) > 1:
        return False
    stamps = []
    for file in files:
        parts = {part.table: part for part in _parts(file)}
        if not {"odometry", "truth"} <= set(parts) or "robot" in parts["odometry"].columns:
            return False
        times = [parts["odometry"].columns[q] for q in ("time", "sec") if q in parts["odometry"].columns]
        t = file.numbers(times[0].column)
        if len(t) > 1:
            stamps.append((t[0], t[-1]))
    overlaps = sum(later[0] < earlier[1] for earlier, later in pairwise(sorted(stamps)))
    return len(stamps) > 1 and overlaps < len(stamps) / 2


# --- Tables that columns belong to

ODOMETRY = {  # kind -> its quantities; the first kind that a file has all of
    "velocity": ("speed", "turn_rate"),
    "path": ("length", "turn_rate"),
    "displacement": ("dx", "dy"),
    "pose": ("x", "y", "heading"),
}
ANCHORS = {"anchor", "anchors", "node", "nodes", "beacon", "beacons", "ap"}
LANDMARKS = {"landmark", "landmarks", "marker", "markers", "tag", "tags"}
STAMPS = ("time", "sec", "nsec")


class Part(NamedTuple):
    """Columns of one file that belong to one table of log.toml."""

    file: CsvTable
    table: str  # "odometry", "truth", "ranges", "rssi", "sightings", "anchors" or "landmarks"
    columns: dict[str, Guess]  # quantity -> column; with time, robot and other where the file has them
    kind: str = ""  # of odometry
    each: tuple[Guess, ...] = ()  # a column for each thing that is measured

    def names(self, quantity: str) -> tuple[str, ...]:
        """Return the names in the column of a quantity."""
        return self.file.names(self.columns[quantity].column)


def _parts(file: CsvTable) -> list[Part]:
    """The tables that a file's columns belong to; a file without stamps can only hold places."""
    shared = _first(file.guesses, (*STAMPS, "robot", "other"))
    if {"time", "sec"} <= shared.keys():
        shared = {q: g for q, g in shared.items() if q not in ("sec", "nsec")}
    if not shared.keys() & {"time", "sec"}:
        return _places(file)
    odometry = [
        Part(file, "odometry", shared | own, kind)
        for kind, needed in ODOMETRY.items()
        if len(own := _first(file.guesses, needed, ("odometry",) if kind == "pose" else ("", "odometry")))
        == len(needed)
    ][:1]
    used = {g.column for part in odometry for q, g in part.columns.items() if q not in shared}
    left = [g for g in file.guesses if g.column not in used]
    named = any(g.side == "truth" and g.quantity == "x" for g in left)
    truth = _first(left, ("x", "y", "heading"), ("truth",) if named else ("",))
    parts = [*odometry, *([Part(file, "truth", shared | truth)] if {"x", "y"} <= truth.keys() else [])]
    ranges, bearings, rssi = ([g for g in left if g.quantity == q] for q in ("range", "bearing", "rssi"))
    if bearings and ranges:
        parts.append(Part(file, "sightings", shared | {"range": ranges[0], "bearing": bearings[0]}))
    for table, quantity, found in (("ranges", "range", ranges), ("rssi", "rssi", rssi)):
        if len(found) > 1:  # a column for each thing measured
            parts.append(Part(file, table, {q: g for q, g in shared.items() if q != "other"}, each=tuple(found)))
        elif found and not (quantity == "range" and bearings):
            parts.append(Part(file, table, shared | {quantity: found[0]}))
    return parts


def _places(file: CsvTable) -> list[Part]:
    """A file of names and places; of anchors, if its name does not speak of landmarks."""
    own = _first(file.guesses, ("x", "y", "robot", "other"))
    label = own.get("robot") or own.get("other") or next((g for g in file.guesses if g.column not in ("x", "y")), None)
    if not {"x", "y"} <= own.keys() or label is None:
        return []
    words = {*words_of(file.path.stem), *words_of(label.column)}
    table = "landmarks" if words & LANDMARKS and not words & ANCHORS else "anchors"
    return [Part(file, table, {"name": label, "x": own["x"], "y": own["y"]})]


def _first(
    guesses: Sequence[Guess], quantities: Sequence[str], sides: Sequence[str] = ("", "truth", "odometry")
) -> dict[str, Guess]:
    """The first column of each quantity on some sides."""
    found = {g.quantity: g for g in reversed(guesses) if g.side in sides}
    return {q: found[q] for q in quantities if q in found}


def _groups(folder: Path, parts: Sequence[Part], unused: list[str]) -> list[list[Part]]:
    """Parts with the same table and columns together; of odometry and truth only the largest group."""
    alike: dict[tuple[Any, ...], list[Part]] = {}
    for part in parts:
        columns = tuple(sorted((q, g.column) for q, g in part.columns.items()))
        alike.setdefault((part.table, part.kind, columns, tuple(g.column for g in part.each)), []).append(part)
    chosen = []
    for table in dict.fromkeys(part.table for part in parts):
        groups = sorted((group for key, group in alike.items() if key[0] == table), key=len, reverse=True)
        count = len(groups) if table in READINGS else 1
        chosen += groups[:count]
        for group in groups[count:]:
            names = ", ".join(_files(folder, group))
            unused.append(f"{names}: looks like {table} too, but has other columns than the rest; make them alike")
    return chosen


# --- Robots

MARK = "{robot}"


def _robots(folder: Path, groups: Sequence[list[Part]]) -> tuple[str, ...]:
    """Names from a column of names, else from the files' names, else the one file's name."""
    own = [group for group in groups if group[0].table in ("odometry", "truth")]
    for group in own:
        if "robot" in group[0].columns:
            return group[0].names("robot")
    for group in sorted(own, key=len, reverse=True):
        if names := file_pattern(_files(folder, group))[1]:
            return names
    files = {file for group in own for file in _files(folder, group)}
    if len(files) == 1:
        return (Path(next(iter(files))).stem,)
    raise BadInput(f"{folder}: neither the names of files nor a column says which robot is which; {REMEDY}")


def file_pattern(files: Sequence[str], known: Sequence[str] = ()) -> tuple[str, tuple[str, ...]]:
    """Return the pattern that most files share, with {robot} in it, and the robots in the order of the files.

    odom_red.csv and odom_blue.csv are odom_{robot}.csv of red and blue. `known`: names of robots, for a single file.
    """
    if len(files) == 1:
        robot = next((name for name in known if name in _name_parts(files[0])), "")
        return (_marked(files[0], robot), (robot,)) if robot else (files[0], ())
    counts = Counter(_marked(file, word) for file in files for word in dict.fromkeys(_name_parts(file)))
    best = max(counts, key=lambda pattern: (counts[pattern], len(pattern)))
    if counts[best] < 2:
        return files[0], ()
    robots = [word for file in files for word in _name_parts(file) if _marked(file, word) == best]
    return best, tuple(dict.fromkeys(robots))


def _name_parts(file: str) -> list[str]:
    return re.findall(r"[^/_\-. ]+", file.rpartition(".")[0])


def _marked(file: str, word: str) -> str:
    """The file's name with every appearance of a whole word replaced."""
    stem, dot, ending = file.rpartition(".")
    return re.sub(rf"(?<![^/_\-. ]){re.escape(word)}(?![^/_\-. ])", MARK, stem) + dot + ending


def _files(folder: Path, group: Sequence[Part]) -> list[str]:
    return [_relative(part.file.path, folder) for part in group]


# --- Lines of log.toml


def _table(
    folder: Path, group: list[Part], robots: tuple[str, ...], places: set[str], unused: list[str], runs: str
) -> Table | None:
    """One table of log.toml; None if it cannot be used, and `unused` then says why."""
    part, files = group[0], _files(folder, group)
    table, columns, called = part.table, _agreed_columns(group), ", ".join(files)
    if table in ("anchors", "landmarks"):
        lines = [_entry(quantity, guess) for quantity, guess in columns.items()]
        return Table(table, (Entry("file", files[0], "it has names and places, and no stamps"), *lines))
    file = Entry("file", runs, "a file for each run") if runs else _file_entry(files, part, robots)
    if file is None:
        unused.append(f"{called}: looks like {table}, but does not say whose it is; add a column `robot`")
        return None
    stamps = [columns[q] for q in STAMPS if q in columns]
    time = [_column(guess) for guess in stamps]
    why = "; ".join(guess.reason for guess in stamps)
    entries = [Entry("kind", part.kind, "its columns")] if part.kind else []
    entries += [file, Entry("time", time[0] if len(time) == 1 else time, why)]
    nodes: dict[str, str] = {}
    for quantity, guess in columns.items():
        if quantity in STAMPS or (quantity == "robot" and MARK in str(file.value)):
            continue
        if quantity in ("robot", "other"):
            names = tuple(dict.fromkeys(name for one in group for name in one.names(quantity)))
            nodes |= _nodes(names, robots, places)
        if quantity != "other" or table in READINGS:
            entries.append(_entry(quantity, guess))
    if nodes:
        why = "names in the files that are not names of robots, in their order"
        entries.append(Entry("nodes", nodes, why, "perhaps"))
    if part.each:
        each = {name: _column(guess) for guess in part.each if (name := _named_in(guess.column, (*robots, *places)))}
        if not each:
            measured = ", ".join(guess.column for guess in part.each)
            unused.append(f"{called}: {measured}: it is not known where what they measure is; add [anchors]")
            return None
        entries.append(Entry("each", each, "a column for each thing that is measured", "likely"))
    elif table in READINGS and "other" not in columns:
        unused.append(f"{called}: looks like {table}, but does not say to whom; add a column `to` with names")
        return None
    return Table(table, tuple(entries))


def _agreed_columns(group: list[Part]) -> dict[str, Guess]:
    """The first file's columns; one whose unit seems to differ between files is read in SI, and a check tells more."""
    agreed = {}
    for quantity, guess in group[0].columns.items():
        units = dict.fromkeys(part.columns[quantity].unit for part in group)
        if len(units) > 1:
            seen = ", ".join(f"{part.file.path.name} {part.columns[quantity].unit}" for part in group)
            unit = next((u for u in units if u in UNITS), guess.unit)
            guess = guess._replace(unit=unit, reason=f"files differ: {seen}, perhaps")
        agreed[quantity] = guess
    return agreed


def _file_entry(files: Sequence[str], part: Part, robots: tuple[str, ...]) -> Entry | None:
    """The line `file = ...`; None if nothing says whose the lines are."""
    if "robot" in part.columns and (len(files) == 1 or not file_pattern(files)[1]):
        return Entry("file", files[0], "one file for all robots")
    pattern, named = file_pattern(files, robots)
    return Entry("file", pattern, f"a file for each robot: {', '.join(files)}") if {*named} & {*robots} else None


def _entry(quantity: str, guess: Guess) -> Entry:
    weak = "perhaps" in guess.reason or "too " in guess.reason
    return Entry(quantity, _column(guess), guess.reason, "perhaps" if weak else "likely")


def _column(guess: Guess) -> Any:
    """A column in TOML: its name alone if its unit is SI."""
    return guess.column if guess.unit in UNITS else {"column": guess.column, "unit": guess.unit}


def _named_in(column: str, names: Sequence[str]) -> str:
    """The longest name that a column ends with."""
    return max((name for name in names if column.lower().endswith(name.lower())), key=len, default="")


def _nodes(names: Sequence[str], robots: tuple[str, ...], places: set[str]) -> Mapping[str, str]:
    """Names in a column -> names of robots: those that differ in case or by a prefix, else in their order."""
    strange = [name for name in names if name not in robots and name not in places]
    found: dict[str, str] = {}
    for name in strange:
        alike = [r for r in robots if r.lower().endswith(name.lower()) or name.lower().endswith(r.lower())]
        if len(alike) == 1:
            found[name] = alike[0]
    if not found and len(strange) == len(robots) and not {*names} & {*robots}:
        found = dict(zip(sorted(strange), robots, strict=True))
    return found
