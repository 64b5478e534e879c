"""A log.toml for a directory of CSV files: what each column is and whose, always with the reason.

A column's meaning follows from its name first, then from its values; its robot from a column of names, else from the
names of the files.
"""

import csv
import re
import statistics
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from reprlib import repr as short_repr
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.inspect import naming
from cooploc.scenarios.recordings.inspect.checks import Finding
from cooploc.scenarios.recordings.inspect.draft_toml import Draft, DraftTable, Entry
from cooploc.scenarios.recordings.schema import COLUMNS, UNITS
from cooploc.scenarios.recordings.text_files import (
    COMMENTS,
    LEAST_LEFT,
    is_text,
    parse_field,
    read_text,
    split_fields,
)

DELIMITERS = (";", ",", "\t", "|", " ")
REMEDY = "name the files odom_NAME.csv and truth_NAME.csv, or write log.toml by hand (docs/how-to/robots.md)"
READINGS = {"sightings": ("range", "bearing"), "ranges": ("range",), "rssi": ("rssi",)}  # table -> its columns
STAMPS = ("time", "sec", "nsec")
KINDS = ("velocity", "path", "displacement", "pose")  # of odometry; the first whose columns a file has

# --- Files


class Guess(NamedTuple):
    """The probable meaning of a column."""

    column: str
    quantity: str  # "" if it is not known
    unit: str  # as in log.toml; "" if there is none
    side: str  # "truth" or "odometry", if the name says so
    reason: str
    quaternion: tuple[str, ...] = ()  # the columns of which it is the last


class CsvTable(NamedTuple):
    """A CSV file, with a guess for each column."""

    name: str  # as in log.toml
    delimiter: str
    columns: Mapping[str, Array | tuple[str, ...]]  # numbers (rows,), nan where empty; else the fields as they are
    guesses: tuple[Guess, ...] = ()
    robots: tuple[str, ...] = ()  # whose names stand in place of {robot} in the names of columns

    def numbers(self, column: str) -> Array:
        """Return a column's finite numbers, in order; none of a column of words."""
        values = self.columns[column]
        return np.empty(0) if isinstance(values, tuple) else values[np.isfinite(values)]

    def names(self, column: str) -> list[str]:
        """Return the different words in a column, in order of appearance."""
        values = self.columns[column]
        words = values if isinstance(values, tuple) else (f"{v:g}" for v in values[np.isfinite(values)])
        return list(dict.fromkeys(filter(None, words)))


def read_csv(path: Path, name: str) -> CsvTable:
    """Read a CSV file whose first line names the columns; lines that are too short or too long are left out."""
    text = read_text(path).lstrip()
    if not text:
        raise BadInput(f"{path}: the file is empty; get it again")
    lines = text.split("\n")
    first = next((line for line in lines if line and not line.startswith(COMMENTS)), lines[0]).strip()
    if not any(d in first for d in DELIMITERS):  # a title, or names that are divided by nothing
        first = next((line for line in lines[1:10] if any(d in line for d in DELIMITERS)), first)
    fields = {d: len(next(csv.reader([first], delimiter=d, skipinitialspace=True), [])) for d in DELIMITERS}
    delimiter = max(DELIMITERS, key=lambda d: (fields[d] > 1, d != " ", fields[d]))
    head, line, rows = split_fields(text, delimiter)
    if twice := next((name for name in head if head.count(name) > 1), None):
        raise BadInput(f"{path}, line {line}: two columns are named {short_repr(twice)}; rename one")
    whole = [row for _, row in rows if len(row) == len(head)]
    if not rows:
        raise BadInput(f"{path}: it has no line of data with {len(head)} fields as in line {line}; get the file again")
    if len(whole) < LEAST_LEFT * len(rows):
        most = statistics.mode(len(row) for _, row in rows)
        remedy = "leave one line above the numbers, with the names of all columns (of a truth: time, x, y, heading)"
        raise BadInput(f"{path}: most lines have {most} fields, and line {line}, with the names, {len(head)}; {remedy}")
    patterns, robots = naming.columns_of_robots(head)
    columns: dict[str, Array | tuple[str, ...]] = {}
    for column, words in zip(head, zip(*whole, strict=True), strict=True):  # of several robots the first one's values
        numbers = np.array([parse_field(word) for word in words])
        good, filled = np.isfinite(numbers), sum(map(bool, words))
        is_number = filled and good.sum() >= 0.9 * filled
        columns.setdefault(patterns.get(column, column), np.where(good, numbers, np.nan) if is_number else words)
    found = CsvTable(name, delimiter, columns, (), robots)
    return found._replace(guesses=infer_columns(found))


def _read_files(paths: Iterable[Path], folder: Path, data: Path) -> tuple[list[CsvTable], list[str]]:
    """Read the CSV files of a run, and note those that are no tables."""
    files, unread = [], []
    for path in paths:
        name = path.relative_to(folder if path.is_relative_to(folder) else data).as_posix()
        try:
            files.append(read_csv(path, name))
        except BadInput as e:
            unread.append(str(e) if ".csv" in path.name.lower() else f"{name}: a text, and no table")
    return files, unread


def _unread_places(folder: Path) -> list[tuple[Path, str]]:
    """Return files that probably hold anchors or landmarks by their names, in a format that is not read."""
    files = [p for p in sorted(folder.iterdir()) if p.suffix.lower() in (".yaml", ".yml", ".json", ".xml")]
    kinds = [(p, naming.OTHERS.get(word, "")) for p in files for word in naming.words_of(p.stem)]
    return [(p, kind) for p, kind in kinds if kind in ("anchors", "landmarks")]


def _text_files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.rglob("*") if is_text(p))


# --- Values

EPOCHS = {"ns": 1e9, "us": 1e6, "ms": 1e3, "s": 1.0}  # in a second
SINCE_1970 = (5e8, 5e9)  # [s] from 1985 to 2128
SLOW = 2.0  # [1/s] in radians robots turn more slowly, in degrees faster
NAMES = ("robot", "other")  # quantities whose values are names
PART = "part of a quaternion"
TUM = (("time", "s"), ("x", "m"), ("y", "m"), ("", ""))  # quantities and units of the columns before a quaternion


def infer_columns(table: CsvTable) -> tuple[Guess, ...]:
    """Guess the meaning of each column."""
    file_side, quaternions = naming.side_of(Path(table.name).stem), _quaternions(table)
    guesses = [
        quaternions[column]._replace(side=naming.side_of(column) or file_side)
        if column in quaternions
        else _guess(table, column, file_side)
        for column in table.columns
    ]
    both = [g for g in guesses if g.quantity in NAMES or g.column in ("i", "j")]  # robot1 and robot2, or i and j
    if len(both) == 2 and {*table.names(both[0].column)} & {*table.names(both[1].column)}:
        for one, quantity in zip(both, NAMES, strict=True):
            if both[0].quantity == both[1].quantity:
                guesses[guesses.index(one)] = one._replace(quantity=quantity, reason="two columns with the same names")
    return tuple(guesses)


def _quaternions(table: CsvTable) -> dict[str, Guess]:
    """Return guesses for columns that are quaternions, of x, y, z, w or of z, w: that of w is taken for the heading.

    A unit may follow: q_RS_w [] of EuRoC. Eight columns without names, of which the last four are a quaternion, are
    stamp, position and orientation (TUM).
    """
    found: dict[str, Guess] = {}
    numbered = list(table.columns) == list("12345678")
    for column in table.columns:
        of_w = re.fullmatch(r"(.*)([wW])(\s*[\[(].*)?", column)
        own = [f"{of_w[1]}{q}{of_w[3] or ''}" for q in ("xyzw" if of_w[2] == "w" else "XYZW")] if of_w else []
        own = [name for name in own if name in table.columns]
        own = list("5678") if numbered and column == "8" else own
        values = [values for name in own if not isinstance(values := table.columns[name], tuple)]
        if len(own) not in (2, 4) or len(values) < len(own):
            continue
        lengths = np.linalg.norm(np.array(values, float), axis=0)
        if (np.abs(lengths[np.isfinite(lengths)] - 1) < 0.01).mean() > 0.9 and np.isfinite(lengths).any():
            found |= {name: Guess(name, "", "", "", PART) for name in own}
            whole = f"with {', '.join(own[:-1])} of length 1: a quaternion"
            found[column] = Guess(column, "heading", "rad", "", whole, tuple(own))
            for k, (quantity, unit) in enumerate(TUM if numbered else (), 1):
                found[f"{k}"] = Guess(f"{k}", quantity, unit, "", f"column {k} of eight as in TUM files")
    return found


def _guess(table: CsvTable, column: str, file_side: str) -> Guess:
    quantity, named_unit, side = naming.name_meaning(column)
    reason, values = f"its name {column!r}", table.numbers(column)
    change = np.diff(values)
    beside = {naming.name_meaning(name)[::2] for name in table.columns}
    places = [name for name in (column[:-1] + q for q in "xy") if name in table.columns]
    unknown = ""
    if not quantity:
        remedies = [naming.REMEDY[word] for word in naming.words_of(column) if word in naming.REMEDY]
        unknown = remedies[0] if remedies else "neither name nor values say what it is"
    elif isinstance(table.columns[column], tuple) and quantity not in NAMES:
        unknown = f"its name says {quantity}, but its values are not numbers"
    elif (
        quantity == "turn_rate"
        and column[1:]
        and column[-1] == "w"
        and [naming.name_meaning(n)[0] for n in places] == ["x", "y"]
        and "speed" not in dict(beside)
    ):
        unknown = "w beside x and y: part of a quaternion, or a heading"
    elif quantity in ("time", "sec") and len(values) > 1 and (change < 0).mean() > 0.3:
        unknown = f"its name says {quantity}, but its values fall"
    if unknown:
        return Guess(column, "", "", side, unknown)
    rises = len(values) > 10 and (change >= 0).all() and np.ptp(values) > 0
    if rises and (quantity, side) == ("x", "odometry") and ("y", "odometry") not in beside:
        quantity = "length"
        reason += " has no y beside it, and its values only rise: a counter of metres"
    unit, why = _unit(quantity, named_unit, values, _turn_rate(table, column) if quantity == "heading" else np.inf)
    return Guess(column, quantity, unit, side or file_side, reason + (f"; {why}" if why else ""))


def _turn_rate(table: CsvTable, column: str) -> float:
    """Return how fast a column of angles turns: the 90th percentile of its changes [1/s]; inf where that is unknown."""
    stamp = next((c for c in table.columns if naming.name_meaning(c)[0] == "time"), column)
    t, values = table.columns[stamp], table.columns[column]
    if isinstance(t, tuple) or isinstance(values, tuple) or not np.isfinite(t).any():
        return np.inf
    dt = np.diff(t) / EPOCHS[_time_unit(t[np.isfinite(t)])[0]]
    rates = np.abs(np.diff(values))[dt > 0] / dt[dt > 0]
    return float(np.nanquantile(rates, 0.9)) if np.isfinite(rates).any() else np.inf


def _unit(quantity: str, named: str, values: Array, turn_rate: float) -> tuple[str, str]:
    """Return the unit of a quantity and the reason: by the column's name, else by its values."""
    if quantity in NAMES:
        return "", ""
    if named:
        return named, f"{named} is in its name"
    usual_unit = (naming.SI | naming.RATES).get(quantity, "m")
    if not len(values):
        return usual_unit, "no values"
    if quantity == "time":
        return _time_unit(values)
    largest, usual = (float(q) for q in np.quantile(np.abs(values), [0.99, 0.75]))
    span, far = float(np.ptp(np.quantile(values, [0.02, 0.98]))), largest > 2.1 * np.pi
    slow = turn_rate < SLOW and not (np.abs(np.diff(values)) > 300).any()
    unwrapped = f"turn by up to {turn_rate:.2g} in a second: radians, unwrapped, perhaps"
    rules = (
        (usual_unit == "rad" and far and slow, "rad", f"values reach {largest:.4g} and {unwrapped}"),
        (usual_unit == "rad" and far and largest <= 361, "deg", f"values reach {largest:.4g}, more than 2 pi"),
        (usual_unit == "rad", "rad", f"values reach {largest:.3g}"),
        (quantity == "turn_rate" and usual > 2 * np.pi, "deg/s", f"values reach {largest:.4g}: too fast in rad/s"),
        (quantity == "speed" and largest > 30, "mm/s", f"values reach {largest:.4g}: too fast for m/s"),
        (usual_unit != "m", usual_unit, "SI" * (quantity in naming.RATES)),
        (span > 1000, "mm", f"values span {span:.4g}: too far for metres"),
        (span > 100, "cm", f"values span {span:.4g}: far for metres, perhaps"),
    )
    return next(((unit, why) for holds, unit, why in rules if holds), ("m", f"values span {span:.3g}"))


def _time_unit(values: Array) -> tuple[str, str]:
    """Return the unit of stamps by their size since 1970, else by their intervals: between 0.1 ms and 30 s."""
    middle = float(np.median(values))
    for unit, factor in EPOCHS.items():
        if SINCE_1970[0] < middle / factor < SINCE_1970[1]:
            return unit, f"{middle:.4g} since 1970 is in {unit}"
    intervals = np.diff(values)
    usual = float(np.median(intervals[intervals > 0])) if (intervals > 0).any() else 1.0
    for unit, least in (("ns", 1e6), ("us", 1e3), ("ms", 5.0)):
        if usual >= least and float(np.ptp(values)) > 2e3:
            return unit, f"the usual interval is {usual:.4g}"
    return "s", f"the usual interval is {usual:.3g}"


# --- Tables that columns belong to


class TablePart(NamedTuple):
    """Columns that belong to one table of log.toml, in files with the same columns."""

    table: str  # "odometry", "truth", "ranges", "rssi", "sightings", "anchors" or "landmarks"
    files: tuple[CsvTable, ...]
    columns: dict[str, Guess]  # quantity -> column; with time, robot and other where the files have them
    kind: str = ""  # of odometry
    each: tuple[Guess, ...] = ()  # of readings: all columns of their first quantity

    def names(self, quantity: str) -> tuple[str, ...]:
        """Return the names in the column of a quantity; none without one."""
        if quantity not in self.columns:
            return ()
        return tuple(dict.fromkeys(n for file in self.files for n in file.names(self.columns[quantity].column)))

    @property
    def file_names(self) -> list[str]:
        """The names of the files, as in log.toml."""
        return [file.name for file in self.files]


def _parts(file: CsvTable) -> list[TablePart]:
    """Return the tables that a file's columns belong to; a file without stamps can only hold places."""
    shared = _first_columns(file.guesses, (*STAMPS, "robot", "other"))
    if "time" in shared:
        shared = {q: g for q, g in shared.items() if q not in ("sec", "nsec")}
    if not shared.keys() & {"time", "sec"}:
        own = _first_columns(file.guesses, ("x", "y", "robot", "other"))
        label = own.get("robot") or own.get("other") or next((g for g in file.guesses if g.column not in "xy"), None)
        if not {"x", "y"} <= own.keys() or label is None:
            return []
        kinds = {
            naming.OTHERS.get(word) for word in (*naming.words_of(Path(file.name).stem), *naming.words_of(label.column))
        }
        table = "landmarks" if "landmarks" in kinds and "anchors" not in kinds else "anchors"
        return [TablePart(table, (file,), {"name": label, "x": own["x"], "y": own["y"]})]
    parts, left = [], list(file.guesses)
    for kind in KINDS:
        own = _first_columns(file.guesses, COLUMNS[kind], ("odometry",) if kind == "pose" else ("", "odometry"))
        if len(own) == len(COLUMNS[kind]):
            parts.append(TablePart("odometry", (file,), shared | own, kind))
            left = [g for g in left if g not in own.values()]
            break
    has_truth = any(g.side == "truth" and g.quantity == "x" for g in left)
    truth = _first_columns(left, ("x", "y", "heading"), ("truth",) if has_truth else ("",))
    if {"x", "y"} <= truth.keys():
        parts.append(TablePart("truth", (file,), shared | truth))
    for table, quantities in READINGS.items():
        if table == "ranges" and "sightings" in {part.table for part in parts}:
            continue
        for each in split_readings([g for g in left if g.quantity == quantities[0]], "other" in shared):
            own = _first_columns([*each, *left], quantities)
            alone = {q: g for q, g in shared.items() if q != "other"}  # with a column for each thing measured
            if len(own) == len(quantities):
                parts.append(TablePart(table, (file,), (alone if len(each) > 1 else shared) | own, each=each))
    return parts


def split_readings(guesses: Sequence[Guess], named: bool) -> list[tuple[Guess, ...]]:
    """Return the columns of robots by robots, and those of other things, apart.

    Of those whose things are `named` in a column the plain one counts: "range" beside "range_raw" and "gt_range".
    """
    pairs = tuple(g for g in guesses if "{other}" in g.column)
    others = tuple(g for g in guesses if "{other}" not in g.column)
    plain = tuple(g for g in others if naming.is_plain(g.column))
    return [each for each in (pairs, plain if named and len(plain) == 1 else others) if each]


def _name_readings(file: CsvTable, robots: Sequence[str], fixed: Sequence[str]) -> CsvTable:
    """Return the file with its columns of two robots as patterns, and those named as places as readings of these."""
    if not file.robots and (pairs := naming.pairs_of_robots(file.columns, robots)):
        file = file._replace(columns={pairs.get(c, c): values for c, values in file.columns.items()})
        file = file._replace(guesses=infer_columns(file))
    _, own = naming.file_pattern([file.name], robots)
    quantities = [g.quantity for g in file.guesses]
    if own and "robot" in quantities and "other" not in quantities:  # odom_red.csv does not need to say whose it is
        k = quantities.index("robot")
        named = file.names(file.guesses[k].column)
        meant = {*named, *naming.match_names(named, robots).values()}
        if own[0] not in meant and meant & {*robots, *fixed}:
            guess = file.guesses[k]._replace(quantity="other", reason=f"its names are not {own[0]}, whose file it is")
            file = file._replace(guesses=(*file.guesses[:k], guess, *file.guesses[k + 1 :]))
    of = [column for column in file.columns if column in fixed and len(file.numbers(column))]
    kind = "rssi" if any((file.numbers(column) < 0).all() for column in of) else "range"
    found = {
        c: Guess(c, kind, *_unit(kind, "", file.numbers(c), np.inf)[:1], "", "its name is that of a place") for c in of
    }
    return file._replace(guesses=tuple(found.get(g.column, g) for g in file.guesses))


def _lack(file: CsvTable) -> str:
    """Return why a file makes no table; "" where it makes one."""
    if _parts(file) or not {g.quantity for g in file.guesses} & {"time", "sec"}:
        return "" if _parts(file) else "no column of it holds stamps (time)"
    unknown = "; ".join(f"{g.column}: {g.reason}" for g in file.guesses if not g.quantity and g.reason != PART)
    return (
        f"its columns make no table, of stamps with motion, positions or readings{f' ({unknown})' if unknown else ''}"
    )


def _first_columns(
    guesses: Sequence[Guess], quantities: Sequence[str], sides: Sequence[str] = ("", "truth", "odometry")
) -> dict[str, Guess]:
    """Return the first column of each quantity on some sides."""
    found = {g.quantity: g for g in reversed(guesses) if g.side in sides}
    return {q: found[q] for q in quantities if q in found}


def _merge_parts(parts: Sequence[TablePart], unused: list[str]) -> list[TablePart]:
    """Merge parts of the same table and columns; of all but readings keep the one with the most files."""
    merged: dict[Any, TablePart] = {}
    for part in parts:
        key = part.table, part.kind, frozenset((q, g.column) for q, g in part.columns.items())
        if key in merged:
            before, columns = merged[key], {}
            for q, guess in before.columns.items():
                other = part.columns[q]
                better = guess if guess.unit in UNITS else other  # of two units that of SI is more probable
                why = f"files differ, in {part.files[0].name} it is {other.unit}, perhaps"
                columns[q] = guess if guess.unit == other.unit else better._replace(reason=why)
            part = before._replace(columns=columns, files=(*before.files, *part.files))
        merged[key] = part
    kept: list[TablePart] = []
    for part in sorted(merged.values(), key=lambda part: (-len(part.files), len(part.columns))):
        k = next((k for k, other in enumerate(kept) if other.table == part.table), -1)
        if part.table in READINGS or k < 0:
            kept.append(part)
        elif all(q in part.columns and part.columns[q].column == g.column for q, g in kept[k].columns.items()):
            kept[k] = kept[k]._replace(files=(*kept[k].files, *part.files))  # such as one that has headings too
        else:
            names = ", ".join(part.file_names)
            unused.append(f"{names}: looks like {part.table} too, but has other columns than the rest; make them alike")
    return kept


# --- Robots, runs and their names


def _are_runs_of_one_robot(files: Sequence[CsvTable]) -> tuple[bool, str]:
    """Return whether files are runs of one robot, and why; "" of files that may be either.

    They have the same columns, with odometry and truth, and follow each other in time, or more than a word of their
    names differs. With one word, and stamps in common, they are of robots: surely if they measured each other.
    """
    stamps, measured = [], set[str]()
    for file in files:
        parts = {part.table: part for part in _parts(file)}
        same = file.columns.keys() == files[0].columns.keys()
        if not same or not {"odometry", "truth"} <= parts.keys() or "robot" in parts["odometry"].columns:
            return False, "their names in the names of the files, or in a column"
        own = parts["odometry"].columns
        t = file.numbers(next(own[q].column for q in STAMPS if q in own))
        measured |= {name for part in parts.values() for name in part.names("other")}
        if len(t) > 1:
            stamps.append((t[0], t[-1]))
    overlaps = sum(later[0] < earlier[1] for earlier, later in pairwise(sorted(stamps)))
    robots = naming.file_pattern([file.name for file in files])[1]
    if len(stamps) > 1 and (overlaps < len(stamps) / 2 or len(robots) < len(files)):
        how = "one after the other in time" if overlaps < len(stamps) / 2 else "whose names differ in more than a word"
        return True, f"{len(files)} files of the same columns, {how}: runs of one robot"
    certain = len(stamps) < 2 or measured & {*robots}
    return False, "their names in the names of the files" if certain else ""


def _robots(folder: Path, parts: Sequence[TablePart]) -> tuple[str, ...]:
    """Return names from a column of names, else from the files' names, else the one file's name."""
    own = [part for part in parts if part.table in ("odometry", "truth")]
    if wide := next((file.robots for part in own for file in part.files if file.robots), ()):
        return wide
    if column := next((part for part in own if "robot" in part.columns), None):
        return tuple(map(naming.clean_name, column.names("robot")))
    for part in own:
        if names := naming.file_pattern(part.file_names)[1]:
            named = [naming.file_pattern(other.file_names, names)[1] or names for other in own]
            return tuple(name for name in names if all(name in some for some in named)) or names
    files = {name for part in own for name in part.file_names}
    if len(files) == 1:
        return (naming.clean_name(Path(files.pop()).stem),)
    if all(len(part.files) == 1 for part in own):
        return ("robot",)  # one file of odometry and one of the truth
    raise BadInput(f"{folder}: neither the names of files nor a column says which robot is which; {REMEDY}")


# --- The draft


def csv_draft(data: Path) -> Draft:
    """Return the draft for a directory of CSV files, or of runs with such files."""
    beside, _ = _read_files([p for p in _text_files(data) if p.parent == data], data, data)
    stamped = any(guess.quantity in ("time", "sec") for file in beside for guess in file.guesses)
    inside = [] if stamped else [p for p in sorted(data.iterdir()) if p.is_dir() and _text_files(p)]
    try:  # red/odom.csv is of a robot, monday/odom_red.csv of a run: only the latter says itself whose it is
        draft, robots = _draft_run(inside[0] if inside else data, data)
    except BadInput:
        if not inside:
            raise
        robots = ()
    return draft if len(robots) > 1 or not inside else _draft_run(data, data)[0]


def _draft_run(folder: Path, data: Path) -> tuple[Draft, tuple[str, ...]]:
    """Return the draft for the CSV files of one run, with those beside the runs, which are of all; and its robots."""
    beside = [p for p in _text_files(data) if p.parent == data]
    count = Counter(p.name for p in _text_files(folder) if p.parent != data)  # in several folders: of each robot
    above = {p.name for p in beside if folder == data and count[p.name] == 1}
    copies = [p for p in _text_files(folder) if p.name in above and p.parent != data]
    own = [p for p in _text_files(folder) if p not in copies]
    files, unused = _read_files(dict.fromkeys([*own, *beside]), folder, data)
    unread = next((line for line in unused if line.startswith(str(data))), "")
    unused += [f"{p.relative_to(data).as_posix()}: {p.name} stands above it" for p in copies]
    unused += [f"{p.name}: not read; write its places into [{table}]" for p, table in _unread_places(folder)]
    if not files:
        texts = f"{unused[0]}; save it as CSV, with a line of names" if own else "there is no text file in it"
        raise BadInput(unread or f"{folder}: {texts}")
    doubts: tuple[Finding, ...] = ()
    runs, why = _are_runs_of_one_robot(files)
    runs &= folder == data
    if not why and folder == data:
        common = f"{len(files)} files of the same columns, with stamps in common"
        setting = f'for runs: robots = ["robot"], and file = "{{run}}{Path(files[0].name).suffix}" in every table'
        doubts = (Finding("robots", "", "", f"{common}, may be of one robot each, or runs of one", "perhaps", setting),)
    entries = [Entry("format", "csv", f"{len(files)} text files with columns")]
    files = files[:1] if runs else files
    parts = _merge_parts([part for file in files for part in _parts(file)], unused)
    lacking = {file.name: lack for file in files if (lack := _lack(file))}
    motion = "odometry (speeds and turn rates, poses, or steps), from which every estimator starts"
    for needed, words in (("odometry", motion), ("truth", "truth (x and y)")):
        if needed not in {part.table for part in parts}:
            if nameless := next((file.name for file in files if [*file.columns][:2] == ["1", "2"]), ""):
                unread = f"{folder / nameless}: numbers where the names of the columns should be; add a line of names"
            halves = [
                next((f.name for f in files for g in f.guesses if g.quantity == q), "") for q in COLUMNS["velocity"]
            ]
            if needed == "odometry" and all(halves):
                unread = f"{folder}: speeds are in {halves[0]}, turn rates in {halves[1]}; write both into one file"
            odd = [name for name in lacking if naming.side_of(Path(name).stem) in ("", needed)]
            if odd and not unread:
                unread = f"{folder / odd[0]}: {lacking[odd[0]]}, and so no {needed}; name its columns in log.toml"
            if unread or needed == "odometry":
                raise BadInput(unread or f"{folder}: no file has columns that look like {words}; {REMEDY}")
            unused.append(f"{needed}, as no file has columns that look like {words}")
    robots = ("robot",) if runs else _robots(folder, parts)
    other = {"odometry": "truth", "truth": "odometry"}
    for part in parts:
        if part.table in other and not runs:
            _, named = naming.file_pattern(part.file_names, robots)
            lost = {*named} - {*robots, *naming.match_names(named, robots)}
            unused += [
                f"robot {one!r}, as there is {part.table} of it and no {other[part.table]}" for one in sorted(lost)
            ]
    fixed = [name for part in parts if part.table in ("anchors", "landmarks") for name in _places_of(part)]
    files = [_name_readings(file, robots, fixed) for file in files]
    unused += [f"{file.name}: {lack}" for file in files if (lack := _lack(file))]
    parts = _merge_parts([part for file in files for part in _parts(file)], [])
    entries.append(Entry("robots", list(robots), why or "their names in the names of the files", "likely"))
    delimiter = files[0].delimiter
    if delimiter != ",":
        entries.append(Entry("delimiter", delimiter, "between the names in the first line"))
    tables: dict[str, DraftTable] = {}
    for part in parts:
        table = _draft_table(part, robots, fixed, runs, delimiter)
        if isinstance(table, DraftTable):
            tables.setdefault(repr(table.entries), table)
        elif part.table in ("odometry", "truth"):
            raise BadInput(f"{folder}: {table}; or {REMEDY}")
        else:
            unused.append(table)
    for file in files:
        if unknown := [g.column for g in file.guesses if g.column and not g.quantity and g.reason != PART]:
            unused.append(f"{file.name}: columns {', '.join(unknown)}")
    return Draft(tuple(entries), tuple(tables.values()), _column_rows(files), tuple(unused), doubts), robots


def tables_beside_bag(folder: Path, paths: Sequence[Path], robots: Sequence[str], there: Collection[str]) -> Draft:
    """Return the draft of what a bag lacks: the tables in text files, but for those that are `there`."""
    files, unused = _read_files(paths, folder, folder)
    parts = _merge_parts([part for file in files for part in _parts(file)], unused)
    fixed = [name for part in parts if part.table in ("anchors", "landmarks") for name in _places_of(part)]
    files = [_name_readings(file, robots, fixed) for file in files]
    drafted = [
        _draft_table(part, tuple(robots), fixed, False, ",")
        for part in _merge_parts([part for file in files for part in _parts(file)], [])
        if part.table not in ("odometry", *there)
    ]
    tables = tuple(table for table in drafted if isinstance(table, DraftTable))
    return Draft((), tables, _column_rows(files), (*unused, *(line for line in drafted if isinstance(line, str))))


def guess_fields(topic: str, fields: Mapping[str, Sequence[Any]]) -> tuple[CsvTable, tuple[Guess, ...]]:
    """Return the fields of a topic's messages as columns, with a guess for each."""
    columns: dict[str, Array | tuple[str, ...]] = {}
    for name, values in fields.items():
        numbers = not any(isinstance(value, str) for value in values)
        columns[name] = np.array(values, float) if numbers else tuple(map(str, values))
    table = CsvTable(topic, "", columns)
    return table, infer_columns(table)


def _column_rows(files: Sequence[CsvTable]) -> tuple[tuple[str, str, str, str], ...]:
    """Return a row for each column: its file, its name, its probable meaning, and the reason."""
    return tuple(
        (file.name, g.column, (g.quantity or "not known") + f" [{g.unit}]" * bool(g.unit), g.reason)
        for file in files
        for g in file.guesses
    )


def _draft_table(
    part: TablePart, robots: tuple[str, ...], fixed: Sequence[str], runs: bool, delimiter: str
) -> DraftTable | str:
    """Return one table of log.toml; or why it cannot be used. `fixed` are names of places."""
    table, files, columns = part.table, part.file_names, part.columns
    names = ", ".join(files)
    if table in ("anchors", "landmarks"):
        places = Entry("places", _places_of(part), f"{files[0]} has names and places, and no stamps")
        return DraftTable(table, (places,))
    pattern, named = naming.file_pattern(files, robots)
    nodes, why_nodes = dict[str, str](), "these words and the names of the robots are alike"
    for words in (named, (*part.names("robot"), *part.names("other"))):
        nodes |= naming.match_names([word for word in words if naming.clean_name(word) not in fixed], robots)
    pairs = naming.pairs_of_robots(files, robots) if table in READINGS else {}
    if runs:
        file = Entry("file", f"{{run}}{Path(files[0]).suffix}", "a file for each run")
    elif any("{robot}" in g.column for g in columns.values()):
        file = Entry("file", files[0], "one file for all robots, with columns of each")
    elif len(pairs) == len(files) and len({*pairs.values()}) == 1:
        file = Entry("file", next(iter(pairs.values())), "a file for each pair of robots")
    elif "robot" in columns and (len(files) == 1 or not named):
        file = Entry("file", files[0], "one file for all robots")
    elif {nodes.get(name, name) for name in named} & {*robots}:
        file = Entry("file", pattern, f"a file for each robot: {names}")
        files_of = naming.match_names(named, robots)
        if devices := _devices(part, [files_of.get(name, name) for name in named]):
            nodes, why_nodes = files_of | devices, "each stands in the file of one robot"
        columns = {q: g for q, g in columns.items() if q != "robot"}
    elif len(robots) == len(files) == 1:
        file = Entry("file", files[0], "of the one robot")
    else:
        return f"{names}: looks like {table}, but does not say whose it is; add a column `robot`"
    time = [columns[q] for q in STAMPS if q in columns]
    stamps = [_column(guess) for guess in time]
    at = stamps if len(stamps) > 1 else stamps[0]
    written = " ".join([file.value, *(g.column for g in part.each)])
    if table in READINGS and "other" not in columns and "{other}" not in written:
        found = _each_thing(table, part.each, [*robots, *fixed], robots)
        if isinstance(found, str):
            return f"{names}: {found}"
        whose = tuple(column_entry("robot", columns["robot"]) for _ in columns.keys() & {"robot"})
        return DraftTable(table, (file, Entry("time", at, time[0].reason), *whose, found, *_missing(part)))
    entries = [Entry("kind", part.kind, "its columns")] if part.kind else []
    if part.files[0].delimiter != delimiter:
        entries.append(Entry("delimiter", part.files[0].delimiter, "between the fields of these files"))
    entries += [file, Entry("time", at, "; ".join(guess.reason for guess in time))]
    entries += [
        column_entry(q, g) for q, g in columns.items() if q not in STAMPS and (q != "other" or table in READINGS)
    ]
    entries += _missing(part)
    if nodes:
        entries.append(Entry("nodes", nodes, why_nodes, "likely"))
    return DraftTable(table, tuple(entries))


def _devices(part: TablePart, robots: Sequence[str]) -> dict[str, str]:
    """Return whose the names in a column of the robots' own files are, such as numbers of tags: each in one file."""
    if "robot" not in part.columns or len(robots) != len(part.files):
        return {}
    own = [file.names(part.columns["robot"].column) for file in part.files]
    count = Counter(name for names in own for name in names)
    if len(robots) < 2 or max(count.values(), default=2) > 1 or {*count} & {*robots}:
        return {}
    return {name: robot for names, robot in zip(own, robots, strict=True) for name in names}


def _missing(part: TablePart) -> list[Entry]:
    """Return the line for ranges that mean none: the largest, often there, and by half above all others."""
    if part.table != "ranges":
        return []
    values = np.concatenate([f.numbers(g.column) * UNITS["m"][g.unit] for f in part.files for g in part.each])
    largest, others = np.max(values, initial=0.0), values[values < np.max(values, initial=0.0)]
    count = len(values) - len(others)
    if count < max(10, 0.005 * len(values)) or largest < 1.5 * np.max(others, initial=0.0):
        return []
    why = f"[m] {count} of {len(values)} ranges are {largest:.6g} m, and no other is near"
    return [Entry("missing_from", float(f"{0.99 * largest:.3g}"), why, "likely")]


def _each_thing(table: str, each: Sequence[Guess], things: Sequence[str], robots: Sequence[str]) -> Entry | str:
    """Return the line for readings with a column for each thing measured; or what to write, if it has no name."""
    columns: dict[str, Guess] = {}
    for guess in each:
        ends = [name for name in things if naming.letters_of(guess.column).endswith(naming.letters_of(name))]
        columns |= {max(ends, key=len): guess} if ends else {}  # d_A0 is of A0, and not of 0
    if table == "sightings" or len(columns) < len(each):
        own = ", ".join(f'a{k} = "{g.column}"' for k, g in enumerate(each, 1))
        remedy = f"write [{table}] with each = {{ {own} }}, and [anchors] with places = {{ a1 = [X, Y], ... }}"
        return f"{table} of things without a name; add a column `to`, or {remedy}"
    patterns = {g.column[: -len(name)] + "{other}": g for name, g in columns.items()}
    if len(patterns) == 1 and {*columns} <= {*robots}:
        pattern, guess = patterns.popitem()
        return column_entry(table.removesuffix("s"), guess._replace(column=pattern))
    return Entry("each", {name: _column(g) for name, g in columns.items()}, "columns end with a name", "likely")


def _places_of(part: TablePart) -> dict[str, list[float]]:
    """Return the places [m] in a file by name; blanks and signs that a name cannot have become _."""
    file, columns = part.files[0], part.columns
    words = file.columns[columns["name"].column]
    named = words if isinstance(words, tuple) else [f"{number:g}" for number in words]
    x, y = (np.asarray(file.columns[columns[q].column], float) * UNITS["m"][columns[q].unit] for q in "xy")
    return {
        naming.clean_name(name): [float(a), float(b)]
        for name, a, b in zip(named, x, y, strict=True)
        if name and np.isfinite([a, b]).all()
    }


def column_entry(quantity: str, guess: Guess) -> Entry:
    """Return the line of log.toml that names a column or a field."""
    weak = "perhaps" in guess.reason or "too " in guess.reason
    return Entry(quantity, _column(guess), guess.reason, "perhaps" if weak else "likely")


def _column(guess: Guess) -> Any:
    """Return a column in TOML: its name alone if its unit is SI; the columns of a quaternion."""
    if guess.quaternion:
        return {"quaternion": list(guess.quaternion)}
    return guess.column if guess.unit in UNITS else {"column": guess.column, "unit": guess.unit}
