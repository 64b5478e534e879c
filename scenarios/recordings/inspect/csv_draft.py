"""A log.toml for a directory of CSV files: which columns make a table, and whose they are, always with the reason.

A column's robot follows from a column of names, else from the names of the files.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from cooploc.estimators.errors import BadInput, first_of, shorten
from cooploc.scenarios.recordings.inspect import naming
from cooploc.scenarios.recordings.inspect.columns import (
    BESIDE,
    PART,
    SEVERAL_KINDS,
    CsvTable,
    Guess,
    infer_columns,
    infer_unit,
    no_reading,
    read_csv,
)
from cooploc.scenarios.recordings.inspect.draft_toml import Draft, DraftTable, Entry
from cooploc.scenarios.recordings.inspect.findings import Finding
from cooploc.scenarios.recordings.inspect.places import kind_of_places, read_places, split_places
from cooploc.scenarios.recordings.inspect.runs import are_runs_of_one_robot, first_of_column, runs_in_names, text_files
from cooploc.scenarios.recordings.inspect.table_parts import (
    NAMELESS,
    NO_STAMPS,
    READINGS,
    STAMPS,
    TablePart,
    drop_held_heading,
    find_sideways,
    list_columns,
    merge_parts,
    name_estimates,
    parts_of,
    why_no_table,
)
from cooploc.scenarios.recordings.schema import UNITS
from cooploc.scenarios.recordings.text_files import NAMED_DATE, OTHER_TABLES, are_called_runs, is_text

REMEDY = "name the files odom_NAME.csv and truth_NAME.csv, or write log.toml by hand (docs/how-to/robots.md)"
LOOKS = {
    "odometry": "odometry (speeds and turn rates, poses with headings, or steps), from which every estimator starts",
    "truth": "truth (x and y)",
}
MOST_RUNS = 3  # of which a draft is tried
LOUDER = 8.0  # [dB] than what stands for no signal are all others
KEYS = {"ahead": "x", "left": "y"}  # quantity -> its key in log.toml, where it is another

# --- Files


def _read_files(
    paths: Iterable[Path], folder: Path, data: Path, of_run: Mapping[str, str] = MappingProxyType({})
) -> tuple[list[CsvTable], list[str]]:
    """Read the CSV files of a run, and note those that are no tables. `of_run`: file -> its name with {run}."""
    files, unread = [], []
    for path in paths:
        name = path.relative_to(folder if path.is_relative_to(folder) else data).as_posix()
        kind = kind_of_places(path)
        fault = f"{name}: not read; write its places into [{kind}]" if kind else f"{name}: a text, and no table"
        is_csv = ".csv" in path.name.lower() or path.suffix.lower() in {*OTHER_TABLES} - {".json"}
        if kind and (places := read_places(path, name)):
            files.append(places)
            continue
        try:
            file = read_csv(path, name) if is_text(path) else None
            if file and (is_csv or "1" in file.columns or any(guess.quantity for guess in file.guesses)):
                files.append(file)
                continue
        except BadInput as e:
            fault = str(e) if is_csv or SEVERAL_KINDS in str(e) else fault
        unread.append(fault)
    files = [file._replace(name=of_run.get(file.name, file.name)) for file in files]
    starred = naming.without_dates([file.name for file in files])
    files = [file._replace(name=starred.get(file.name, file.name)) for file in files]
    return [*chain(*split_places(files))], unread


def _name_mates(files: Sequence[CsvTable], robots: Sequence[str], fixed: Sequence[str]) -> list[CsvTable]:
    """Return the files with {other} in the names of columns, where those of each robot are of teammates or places."""
    for quantity in ("range", "rssi"):
        columns = [[g.column for g in f.guesses if g.quantity == quantity and "{other}" not in g.column] for f in files]
        owners = [naming.file_pattern([file.name], robots)[1] for file in files]
        places = fixed if len({frozenset(some) for some in columns if some}) > 1 else ()
        patterns = {
            naming.pattern_of_mates(some, own[0], robots, places) if own else ""
            for some, own in zip(columns, owners, strict=True)
            if some
        }
        if len(patterns) != 1 or not (pattern := patterns.pop()):
            continue
        renamed = []
        for file, some in zip(files, columns, strict=True):
            order = dict.fromkeys([*(c for c in some if not len(file.numbers(c))), *file.columns])  # never heard: first
            file = file._replace(columns={pattern if c in some else c: file.columns[c] for c in order})
            renamed.append(file._replace(guesses=infer_columns(file)))
        files = renamed
    return list(files)


def _name_readings(file: CsvTable, robots: Sequence[str], fixed: Sequence[str]) -> CsvTable:
    """Return the file with columns of two robots, or of one and a place, as patterns, and readings of places known."""
    _, own = naming.file_pattern([file.name], robots)
    about, numbers = naming.name_meaning(Path(file.name).stem)[0], [] if own else [*naming.numbers_of(robots)]
    pairs: dict[str, str] = {}
    for words in ([*robots], numbers) if not file.robots else ():
        pairs = pairs or naming.pairs_of_robots(file.columns, words, about)
    unnamed = [g.column for g in file.guesses if not g.quantity and g.column not in fixed]
    of_places = naming.pairs_with_places(unnamed, robots, () if own or file.is_nameless else fixed)
    said = {c: pattern for c, pattern in of_places.items() if naming.name_meaning(pattern)[0] in ("range", "rssi")}
    pairs |= said or (of_places if about in ("range", "rssi") else {})
    if pairs:
        file = file._replace(columns={pairs.get(c, c): values for c, values in file.columns.items()})
        file = file._replace(guesses=infer_columns(file))
    quantities = [g.quantity for g in file.guesses]
    if own and "robot" in quantities and "other" not in quantities:  # odom_red.csv does not need to say whose it is
        k = quantities.index("robot")
        named = file.names(file.guesses[k].column)
        meant = {*named, *naming.match_names([name for name in named if name not in fixed], robots).values()}
        if own[0] not in meant and meant & {*robots, *fixed}:
            guess = file.guesses[k]._replace(quantity="other", reason=f"its names are not {own[0]}, whose file it is")
            file = file._replace(guesses=(*file.guesses[:k], guess, *file.guesses[k + 1 :]))
    unknown = {*pairs.values()} - {g.column for g in file.guesses if g.quantity}
    r = [c for c in unnamed if naming.words_of(c) in (["r"], ["rho"])] if own or len(robots) == 1 else []
    numbered = {*r} if len(naming.match_names(r, fixed)) == len(r) > 1 else set()
    places = set() if file.is_nameless else {*fixed}  # there 1 is the first column, and not a place
    of = [column for column in file.columns if column in places | unknown | numbered and len(file.numbers(column))]
    kind = "rssi" if any((file.numbers(column) < 0).all() for column in of) else "range"
    found = {}
    for c in of:
        why = "its name is that of a place" if c in fixed else f"the names of robots or places, in {file.name}"
        why = "its number is that of a place" if c in numbered else why
        found[c] = Guess(c, kind, infer_unit(kind, "", file.numbers(c), np.inf)[0], "", why)
    return file._replace(guesses=tuple(found.get(g.column, g) for g in file.guesses))


# --- Robots, runs and their names


def _robots(folder: Path, parts: Sequence[TablePart]) -> tuple[str, ...]:
    """Return names from a column of names, else from the files' names, else the one file's name."""
    own = [part for part in parts if part.table in ("odometry", "truth")]
    if wide := next((file.robots for part in own for file in part.files if file.robots), ()):
        return wide
    if column := next((part for part in own if "robot" in part.columns and not part.is_of_files), None):
        return tuple(map(naming.clean_name, column.names("robot")))
    for part in own:
        if names := naming.file_pattern(part.file_names)[1]:
            if all(map(NAMED_DATE.fullmatch, names)):
                at = f"the names of files differ in dates ({first_of(names)})"
                raise BadInput(f"{folder}: {at}; put the files of each run into a directory of its own")
            named = [naming.file_pattern(other.file_names, names)[1] or names for other in own]
            return tuple(name for name in names if all(name in some for some in named)) or names
    files = {name for part in own for name in part.file_names}
    if len(files) == 1:
        return (naming.clean_name(Path(files.pop()).stem.replace("{run}", "").strip("-_. ")) or "robot",)
    if all(len(part.files) == 1 for part in own):
        return ("robot",)  # one file of odometry and one of the truth
    raise BadInput(f"{folder}: neither the names of files nor a column says which robot is which; {REMEDY}")


# --- The draft


def csv_draft(data: Path) -> Draft:
    """Return the draft for a directory of CSV files, or of runs with such files."""
    runs = runs_in_names(data)
    for run in [*runs][:MOST_RUNS]:  # a file of the first may be broken
        with suppress(BadInput):
            draft, robots = _draft_run(data, data, {run: runs[run], **runs})
            moves = next(table for table in draft.tables if table.name == "odometry")
            is_of_run = any(entry.key == "file" and "{run}" in entry.value for entry in moves.entries)
            if is_of_run and (len(robots) > 1 or are_called_runs(runs)):  # else a robot's clock may be far off
                return draft
    inside = [p for p in sorted(data.iterdir()) if p.is_dir() and text_files(p)]
    if inside:
        beside, _ = _read_files([p for p in text_files(data) if p.parent == data], data, data)
        stamped = any(guess.quantity in ("time", "sec") for file in beside for guess in file.guesses)
        inside = [] if stamped else inside
    if not inside:
        return _draft_run(data, data)[0]
    try:  # red/odom.csv is of a robot, monday/odom_red.csv of a run: only the latter says itself whose it is
        draft, robots = _draft_run(inside[0], data)
        if len(robots) > 1 and "truth" in {table.name for table in draft.tables}:
            return draft
    except BadInput:
        robots = ()
    try:  # odom/red.csv and truth/red.csv are of one run, too
        whole, _ = _draft_run(data, data)
    except BadInput:
        if not robots:
            raise
        return draft
    return draft if len(robots) > 1 and "truth" not in {table.name for table in whole.tables} else whole


def _read_run(folder: Path, data: Path, runs: Mapping[str, Mapping[str, str]]) -> tuple[list[CsvTable], list[str], str]:
    """Read the files of a run; note those that are not read, and first one that should be."""
    of_run, *of_others = runs.values() if runs else ({},)
    beside = [p for p in text_files(data) if p.parent == data]
    count = Counter(p.name for p in text_files(folder) if p.parent != data)  # in several folders: of each robot
    above = {p.name for p in beside if folder == data and count[p.name] == 1}
    copies = [p for p in text_files(folder) if p.name in above and p.parent != data]
    own = [p for p in text_files(folder) if p not in copies]
    places = [p for home in (folder, data) for p in sorted(home.iterdir()) if kind_of_places(p)]
    not_of_run = {data / name for of in of_others for name in of}
    paths = [p for p in dict.fromkeys([*own, *beside, *places]) if p not in not_of_run]
    files, unused = _read_files(paths, folder, data, of_run)
    unread = next((line for line in unused if line.startswith(str(data))), "")
    unused += [f"{p.relative_to(data).as_posix()}: {p.name} stands above it" for p in copies]
    if not files:
        texts = f"{unused[0]}; save it as CSV, with a line of names" if own else "there is no text file in it"
        raise BadInput(unread or f"{folder}: {texts}")
    return files, unused, unread


def _draft_run(
    folder: Path, data: Path, in_names: Mapping[str, Mapping[str, str]] = MappingProxyType({})
) -> tuple[Draft, tuple[str, ...]]:
    """Return the draft for the CSV files of one run, with those beside the runs, which are of all; and its robots.

    `in_names` are runs that are told by a word in the names of their files.
    """
    files, unused, unread = _read_run(folder, data, in_names)
    files, column = first_of_column(files)
    doubts: tuple[Finding, ...] = ()
    runs, why = are_runs_of_one_robot(files)
    runs &= folder == data and not in_names
    if not why and folder == data and not in_names:
        common = f"{len(files)} files of the same columns, with stamps in common"
        setting = f'for runs: robots = ["robot"], and file = "{{run}}{Path(files[0].name).suffix}" in every table'
        doubts = (Finding("robots", "", "", f"{common}, may be of one robot each, or runs of one", "perhaps", setting),)
    of_runs = f" of a run; {{run}} is {first_of(in_names)}" if in_names else ""
    entries = [Entry("format", "csv", f"{len(files)} text files with columns{of_runs}")]
    entries += [Entry("run", column, "the column of runs, by its name and its few values", "likely")] * bool(column)
    files = files[:1] if runs else files
    tables_found = {part.table for file in files for part in parts_of(file)}
    halved = {part.table for file in files for part in parts_of(file, True)}
    halves = "odometry" not in tables_found and {"odometry", "turns"} <= halved
    parts = merge_parts([part for file in files for part in parts_of(file, halves)], unused)
    if "truth" not in {part.table for part in parts}:  # then a camera above all of them saw what is in such a file
        files = [_seen_from_above(file) for file in files]
        parts = merge_parts([part for file in files for part in parts_of(file, halves)], [])
    lacking = {file.name: lack for file in files if (lack := why_no_table(file, halves))}
    there = {part.table for part in parts}
    for needed in [table for table in LOOKS if table not in there]:
        unread = unread or _lack_of(needed, folder, files, lacking)
        if unread or needed == "odometry":
            raise BadInput(unread or f"{folder}: no file has columns that look like {LOOKS[needed]}; {REMEDY}")
        unused.append(f"{needed}, as no file has columns that look like {LOOKS[needed]}{name_estimates(files)}")
    doubts += tuple(finding for part in parts for finding in find_sideways(part))
    robots = ("robot",) if runs else _robots(folder, parts)
    unused += [] if runs else _half_robots(parts, robots)
    fixed = [name for part in parts if part.table in ("anchors", "landmarks") for name in _places_of(part, robots)]
    files = [_name_readings(file, robots, fixed) for file in _name_mates(files, robots, fixed)]
    unused += _for_files((why_no_table(file, halves), file.name) for file in files)
    parts = merge_parts([part for file in files for part in parts_of(file, halves)], [])
    parts = [drop_held_heading(one, unused) for part in parts for one in _of_files(part, robots)]
    entries.append(Entry("robots", list(robots), why or "their names in the names of the files", "likely"))
    tables: dict[str, DraftTable] = {}
    for part in parts:
        table = _draft_table(part, robots, fixed, runs)
        if isinstance(table, DraftTable):
            tables.setdefault(repr(table.entries), table)
        elif part.table in ("odometry", "turns", "truth"):
            raise BadInput(f"{folder}: {table}; or {REMEDY}")
        else:
            unused.append(table)
    unused += _left_columns(files, parts)
    return Draft(tuple(entries), tuple(tables.values()), _column_rows(files), tuple(shorten(unused)), doubts), robots


def _seen_from_above(file: CsvTable) -> CsvTable:
    """Return the file with x and y in place of what was taken for ahead and left."""
    back = {"ahead": "x", "left": "y"}
    guesses = (g._replace(quantity=back[g.quantity]) if g.reason == BESIDE else g for g in file.guesses)
    return file._replace(guesses=tuple(guesses))


def _of_files(part: TablePart, robots: Sequence[str]) -> list[TablePart]:
    """Return a part for each file of readings, if their lines name the robots, their names do not, and they differ.

    Of the same things, as uwb_raw.csv and uwb_filtered.csv are, one alone should be read.
    """
    named, others = naming.file_pattern(part.file_names, robots)[1], _others(part)
    of_robots = {*named, *naming.match_names(named, robots).values()} & {*robots}
    differ = len(others) == len(part.files) and len({*chain(*others)}) == sum(map(len, others))
    if part.table in READINGS and "robot" in part.columns and named and not of_robots and differ:
        return [part._replace(files=(file,)) for file in part.files]
    return [part]


def _half_robots(parts: Sequence[TablePart], robots: Sequence[str]) -> list[str]:
    """Return a line for each robot that has odometry and no truth, or a truth and no odometry."""
    other, lines = {"odometry": "truth", "truth": "odometry"}, list[str]()
    for part in parts:
        if part.table in other:
            _, named = naming.file_pattern(part.file_names, robots)
            lost = sorted({*named} - {*robots, *naming.match_names(named, robots)})
            lines += [f"robot {one!r}, as there is {part.table} of it and no {other[part.table]}" for one in lost]
    return lines


def _left_columns(files: Sequence[CsvTable], parts: Sequence[TablePart]) -> list[str]:
    """Return a line on the columns of each file that no table reads and that are not known."""
    read, left = {g.column for part in parts for g in part.each}, list[tuple[str, str]]()
    for file in files:
        lost = {g.column for g in file.guesses if g.quantity in ("range", "rssi") and read} - read
        lost |= {g.column for g in file.guesses if not g.quantity and g.reason != PART}
        if unknown := list_columns([g.column for g in file.guesses if g.column in lost]):
            left.append((f"columns {unknown}", file.name))
    return _for_files(left)


def _lack_of(needed: str, folder: Path, files: Sequence[CsvTable], lacking: Mapping[str, str]) -> str:
    """Return which file should hold odometry or the truth, and what it lacks; "" where none should.

    `lacking` says of files why they make no table.
    """
    if nameless := next((name for name, lack in lacking.items() if lack == NAMELESS), ""):
        remedy = "add a line of names"
        if not naming.side_of(Path(nameless).stem):
            remedy += ", or call it by what is in it (odom_NAME, gt_NAME, uwb)"
        return f"{folder / nameless}: {NAMELESS}; {remedy}"
    sides = (needed,) if len(lacking) < len(files) else (needed, "")  # of some that say nothing none is to blame
    if odd := next((name for name in lacking if naming.side_of(Path(name).stem) in sides), ""):
        remedy = "add one, such as `time` [s]" if lacking[odd] == NO_STAMPS else "name its columns in log.toml"
        return f"{folder / odd}: {lacking[odd]}, and so no {needed}; {remedy}"
    for file in files:
        known = {guess.quantity for guess in file.guesses}
        of_wheels = next((guess for guess in file.guesses if guess.reason in naming.REMEDY.values()), None)
        if of_wheels and needed == "odometry":
            return f"{folder / file.name}: {of_wheels.column!r} is {of_wheels.reason}"
        of_it = known | {guess.side for guess in file.guesses if needed == "odometry"}  # places need no stamps
        if of_it & {"speed", "turn_rate", "dx", "odometry"} and not known & {"time", "sec"}:
            stamps = [f" ({g.reason})" for g in file.guesses if naming.name_meaning(g.column)[0] in ("time", "sec")]
            return f"{folder / file.name}: {NO_STAMPS}{''.join(stamps)}; add one, such as `time` [s]"
    return ""


def _for_files(lines: Iterable[tuple[str, str]]) -> list[str]:
    """Return each line once, behind all files that it is about; an empty one is about nothing."""
    files: dict[str, list[str]] = {}
    for line, file in lines:
        files.setdefault(line, []).append(file)
    return [f"{first_of(names, 5)}: {line}" for line, names in files.items() if line]


def tables_beside_bag(
    folder: Path, paths: Sequence[Path], robots: Sequence[str], there: Collection[str], places: Sequence[CsvTable]
) -> Draft:
    """Return the draft of what a bag lacks: tables in text files but those `there`, and `places` from its messages."""
    files, unused = _read_files(paths, folder, folder)
    files += places
    parts = merge_parts([part for file in files for part in parts_of(file)], unused)
    fixed = [name for part in parts if part.table in ("anchors", "landmarks") for name in _places_of(part, robots)]
    files = [_name_readings(file, robots, fixed) for file in _name_mates(files, robots, fixed)]
    drafted = [
        _draft_table(part, tuple(robots), fixed, False)
        for several in merge_parts([part for file in files for part in parts_of(file)], [])
        for part in _of_files(several, robots)
        if part.table not in ("odometry", *there)
    ]
    tables = tuple(table for table in drafted if isinstance(table, DraftTable))
    return Draft((), tables, _column_rows(files), (*unused, *(line for line in drafted if isinstance(line, str))))


def _column_rows(files: Sequence[CsvTable]) -> tuple[tuple[str, str, str, str], ...]:
    """Return a row for each column: its file, its name, its probable meaning, and the reason."""
    return tuple(
        (file.name, g.column, (g.quantity or "not known") + f" [{g.unit}]" * bool(g.unit), g.reason)
        for file in files
        for g in file.guesses
    )


def _draft_table(part: TablePart, robots: tuple[str, ...], fixed: Sequence[str], runs: bool) -> DraftTable | str:
    """Return one table of log.toml; or why it cannot be used. `fixed` are names of places."""
    table, files, columns = part.table, part.file_names, part.columns
    names = ", ".join(files)
    if table in ("anchors", "landmarks"):
        places = _places_of(part, robots)
        entry = Entry("places", places, f"{files[0]} has names and places")
        return DraftTable(table, (entry,)) if places else f"{names}: looks like {table}, but has no place with a name"
    owners = _whose(part, robots, fixed, runs)
    if isinstance(owners, str):
        return owners
    file, columns, nodes, why_nodes = owners
    time = [columns[q] for q in STAMPS if q in columns]
    stamps = [_column(guess) for guess in time]
    at = stamps if len(stamps) > 1 else stamps[0]
    written = " ".join([file.value, *(g.column for g in part.each)])
    if table in READINGS and "other" not in columns and "{other}" not in written:
        found = _each_thing(table, part.each, [*robots, *fixed], robots)
        if isinstance(found, Entry):
            whose = tuple(column_entry("robot", columns["robot"]) for _ in columns.keys() & {"robot"})
            return DraftTable(table, (file, Entry("time", at, time[0].reason), *whose, found, *_missing(part)))
        if len(robots) != 2 or len(part.each) > 1 or fixed or table == "rssi":  # which is an access point's, mostly
            return f"{names}: {found}"
        guess = part.each[0]._replace(reason=f"{part.each[0].reason}; of the other robot, perhaps")
        columns = {q: guess if g == part.each[0] else g for q, g in columns.items()}
    entries = [Entry("kind", part.kind, "its columns")] if part.kind else []
    entries += [file, Entry("time", at, "; ".join(guess.reason for guess in time))]
    entries += [
        column_entry(q, g) for q, g in columns.items() if q not in STAMPS and (q != "other" or table in READINGS)
    ]
    entries += [*_missing(part), *(frame_entries(columns, part.files[0]) if table == "truth" else [])]
    if table in READINGS:
        others, nodes = _of_places(part, robots, fixed, nodes)
        entries += others
        if "{other}" in written and "{robot}" in f"{file.value} {written}" and not nodes:
            nodes = {number: robot for number, robot in naming.numbers_of(robots).items() if number != robot}
    if nodes:
        entries.append(Entry("nodes", nodes, why_nodes, "likely"))
    return DraftTable(table, tuple(entries))


def _whose(
    part: TablePart, robots: tuple[str, ...], fixed: Sequence[str], runs: bool
) -> tuple[Entry, dict[str, Guess], dict[str, str], str] | str:
    """Return the files of a table, its columns, and robots by what they are called there, with why; or what lacks."""
    files, columns = part.file_names, part.columns
    names = ", ".join(files)
    pattern, named = naming.file_pattern(files, robots)
    nodes, why_nodes = dict[str, str](), "these words and the names of robots or places are alike"
    for words in (named, (*part.names("robot"), *part.names("other"))):
        nodes |= naming.match_names([word for word in words if naming.clean_name(word) not in fixed], robots)
    if len(robots) == len(part.names("robot")) == 1 and not {*part.names("robot")} & {*nodes, *robots, *fixed}:
        nodes, why_nodes = {part.names("robot")[0]: robots[0]}, "the one that measured is the one robot"
    pairs = naming.pairs_of_robots(files, robots) or naming.pairs_with_places(files, robots, fixed)
    pairs = pairs if part.table in READINGS else {}
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
        owners = [files_of.get(name, name) for name in named]
        if devices := _devices(part, owners):
            nodes, why_nodes = files_of | devices, "each stands in the file of one robot"
        elif any(
            nodes.get(word) == owner for owner, words in zip(owners, _others(part), strict=False) for word in words
        ):
            nodes = files_of  # a robot measures no distance from itself: these are numbers of anchors
        columns = {q: g for q, g in columns.items() if q != "robot"}
    elif len(robots) == len(files) == 1:
        file = Entry("file", files[0], "of the one robot")
    elif part.table == "ranges" and (len(robots), len(files), len(part.each), len(fixed)) == (2, 1, 1, 0):
        file = Entry("file", files[0], "a range is of both robots", "perhaps")
    else:
        lack = "add a column `robot`" if "robot" not in columns else "keep one of these files, or call them by robots"
        return f"{names}: looks like {part.table}, but does not say whose it is; {lack}"
    return file, columns, nodes, why_nodes


def _of_places(
    part: TablePart, robots: Sequence[str], fixed: Sequence[str], nodes: dict[str, str]
) -> tuple[list[Entry], dict[str, str]]:
    """Return the line for places that have the names of robots, if any has, and `nodes` with the numbers of places."""
    things = [word for word in part.names("other") if f"a{word}" in fixed]
    kinds = {naming.OTHERS.get(word) for word in naming.words_of(part.columns["other"].column)} if things else set()
    if {*things} & {*robots} and (kinds & {"anchors", "landmarks"} or {*things} - {*robots}):
        why = "places that have the names of robots"
        return [Entry("others", {word: f"a{word}" for word in things}, why, "likely")], nodes
    numbered = [word for word in part.names("other") if word.isdigit() and word not in (*nodes, *robots, *fixed)]
    return [], nodes | naming.match_names(numbered, fixed)


def frame_entries(columns: Mapping[str, Guess], table: CsvTable) -> list[Entry]:
    """Return the lines for a truth on the globe or by a compass: where x and y are 0, and the heading of north."""
    found = []
    if naming.is_on_globe(columns["y"].column):
        every = [table.numbers(columns[q].column) for q in "yx"]
        places = [float(np.median(degrees[degrees != 0])) if degrees.any() else 0.0 for degrees in every]
        why = "latitude and longitude [deg] of x = y = 0: the middle of a path"
        found.append(Entry("origin", [round(degrees, 6) for degrees in places], why, "likely"))
    if "heading" in columns and naming.is_clockwise(columns["heading"].column):
        found.append(Entry("heading_offset", 1.570796, "[rad] north is along y, if x is to the east", "likely"))
    return found


def _devices(part: TablePart, robots: Sequence[str]) -> dict[str, str]:
    """Return whose the names in a column of the robots' own files are, such as numbers of tags: each in one file."""
    if "robot" not in part.columns or len(robots) != len(part.files):
        return {}
    own = [file.names(part.columns["robot"].column) for file in part.files]
    count = Counter(name for names in own for name in names)
    if len(robots) < 2 or max(count.values(), default=2) > 1 or {*count} & {*robots}:
        return {}
    return {name: robot for names, robot in zip(own, robots, strict=True) for name in names}


def _others(part: TablePart) -> list[list[str]]:
    """Return the names of what was measured, of each file."""
    return [file.names(part.columns["other"].column) for file in part.files] if "other" in part.columns else []


def _missing(part: TablePart) -> list[Entry]:
    """Return the line for ranges, or signal strengths, that mean none."""
    if part.table not in ("ranges", "rssi"):
        return []
    values = np.concatenate([f.numbers(g.column) * UNITS["m"].get(g.unit, 1.0) for f in part.files for g in part.each])
    is_rssi = part.table == "rssi"
    if np.isinf(largest := no_reading(-values, 1.2, LOUDER) if is_rssi else no_reading(values)):
        return []
    sign, unit, key = (-1, "dBm", "missing_below") if is_rssi else (1, "m", "missing_from")
    why = f"[{unit}] {(values == sign * largest).sum()} of {len(values)} {part.table} are {sign * largest:.6g} {unit}"
    return [Entry(key, float(f"{sign * 0.99 * largest:.3g}"), f"{why}, and no other is near", "likely")]


def _each_thing(table: str, each: Sequence[Guess], things: Sequence[str], robots: Sequence[str]) -> Entry | str:
    """Return the line for readings with a column for each thing measured; or what to write, if it has no name."""
    columns: dict[str, Guess] = {}
    for guess in each:
        ends = [name for name in things if naming.letters_of(guess.column).endswith(naming.letters_of(name))]
        columns |= {max(ends, key=len): guess} if ends else {}  # d_A0 is of A0, and not of 0
    named = [guess.column for guess in each]
    numbered = naming.match_names(named, [name for name in things if name not in robots])
    if not columns and len(numbered) == len(each) and not naming.match_names(named, robots):  # d1 is of a1
        columns = {numbered[guess.column]: guess for guess in each}
    if table == "sightings" or len(columns) < len(each):
        own = ", ".join(f'a{k} = "{g.column}"' for k, g in enumerate(each, 1))
        remedy = f"write [{table}] with each = {{ {own} }}, and [anchors] with places = {{ a1 = [X, Y], ... }}"
        return f"{table} of things without a name; add a column `to`, or {remedy}"
    return Entry(
        "each", {name: _column(g) for name, g in columns.items()}, "they end with a name or its number", "likely"
    )


def _places_of(part: TablePart, robots: Sequence[str]) -> dict[str, list[float]]:
    """Return the places [m] in a file by name; blanks and signs that a name cannot have become _.

    Where a robot has the name of a place, such as 1, places are a1, a2, ...
    """
    file, columns = part.files[0], part.columns
    named = file.words(columns["name"].column)
    x, y = (np.asarray(file.columns[columns[q].column], float) * UNITS["m"][columns[q].unit] for q in "xy")
    sign = "a" * bool({*named} & {*robots})
    return {
        sign + naming.clean_name(name): [float(a), float(b)]
        for name, a, b in zip(named, x, y, strict=True)
        if name and np.isfinite([a, b]).all()
    }


def column_entry(quantity: str, guess: Guess) -> Entry:
    """Return the line of log.toml that names a column or a field."""
    weak = "perhaps" in guess.reason or "too " in guess.reason
    return Entry(KEYS.get(quantity, quantity), _column(guess), guess.reason, "perhaps" if weak else "likely")


def _column(guess: Guess) -> Any:
    """Return a column in TOML: its name alone if its unit is SI; the columns of a quaternion, or of a velocity."""
    if guess.quaternion:
        return {"quaternion": list(guess.quaternion)}
    if guess.norm:
        return {"norm": list(guess.norm)} | ({} if guess.unit in UNITS else {"unit": guess.unit})
    return guess.column if guess.unit in UNITS else {"column": guess.column, "unit": guess.unit}
