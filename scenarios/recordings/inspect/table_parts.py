"""The tables of log.toml that the columns of text files make: odometry, turns, truth, readings, places."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.inspect import naming
from cooploc.scenarios.recordings.inspect.columns import FAR, PART, TO_THE_SIDE, CsvTable, Guess
from cooploc.scenarios.recordings.inspect.findings import Finding
from cooploc.scenarios.recordings.schema import COLUMNS, UNITS

READINGS = ("sightings", "ranges", "rssi")
QUANTITIES = (("range", "bearing"), ("ahead", "left")), (("range",),), (("rssi",),)  # of each
STAMPS, PLANE = ("time", "sec", "nsec"), ("x", "y")
NAMELESS = "numbers where the names of the columns should be"
STRAIGHT = 0.02  # times the length of a path, its width
NO_STAMPS = "no column of it holds stamps"
MOTION = ("x", "y", "heading", "speed", "turn_rate")
KINDS = ("velocity", "path", "increment", "displacement", "pose")  # of odometry; the first whose columns a file has

# Of odometry in two files, speeds in one and turns in the other: quantity -> its table, and the kind of odometry.
HALVES = {"speed": ("odometry", "velocity"), "length": ("odometry", "path")}
HALVES |= {"turn_rate": ("turns", ""), "heading": ("turns", "")}


class TablePart(NamedTuple):
    """Columns that belong to one table of log.toml, in files with the same columns."""

    table: str  # "odometry", "turns", "truth", "ranges", "rssi", "sightings", "anchors" or "landmarks"
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
    def is_named(self) -> bool:
        """Whether a name of a file or column says that this is the table: ground_truth.csv, odom_x."""
        return self.table in {guess.side for guess in self.columns.values()}

    @property
    def is_of_files(self) -> bool:
        """Whether the files are called by robots, and none has several names in its column: 7 in all of red.csv."""
        each = [file.names(self.columns["robot"].column) for file in self.files if "robot" in self.columns]
        return len(naming.file_pattern(self.file_names)[1]) == len(each) > 1 and max(map(len, each)) <= 1

    @property
    def file_names(self) -> list[str]:
        """The names of the files, as in log.toml."""
        return [file.name for file in self.files]


def parts_of(file: CsvTable, halves: bool = False) -> list[TablePart]:
    """Return the tables that a file's columns belong to; a file without stamps can only hold places.

    With `halves` one file may hold the speeds, and another the turn rates or headings.
    """
    shared = first_columns(file.guesses, (*STAMPS, "robot", "other"))
    if "time" in shared:
        shared = {q: g for q, g in shared.items() if q not in ("sec", "nsec")}
    if not shared.keys() & {"time", "sec"}:
        own = first_columns(file.guesses, ("x", "y", "robot", "other"))
        label = own.get("robot") or own.get("other") or next((g for g in file.guesses if g.column not in "xy"), None)
        if not {"x", "y"} <= own.keys() or label is None or naming.is_on_globe(own["y"].column):
            return []
        kinds = {
            naming.OTHERS.get(word) for word in (*naming.words_of(Path(file.name).stem), *naming.words_of(label.column))
        }
        table = "landmarks" if "landmarks" in kinds and "anchors" not in kinds else "anchors"
        return [TablePart(table, (file,), {"name": label, "x": own["x"], "y": own["y"]})]
    parts, left = [], list(file.guesses)
    for kind in KINDS:
        own = first_columns(file.guesses, COLUMNS[kind], ("odometry",) if kind == "pose" else ("", "odometry"))
        if len(own) == len(COLUMNS[kind]) or (kind == "increment" and {"dx", "turn"} <= own.keys()):
            parts.append(TablePart("odometry", (file,), shared | own, kind))
            left = [g for g in left if g not in own.values()]
            break
    else:
        own = first_columns(file.guesses, ("speed", "length", "turn_rate", "heading", "x"), ("", "odometry"))
        for quantity in own if halves and "x" not in own else ():
            table, kind = HALVES[quantity]
            if table not in {part.table for part in parts}:
                parts.append(TablePart(table, (file,), shared | {quantity: own[quantity]}, kind))
    has_truth = any(g.side == "truth" and g.quantity == "x" for g in left)
    own_truth = [g for g in left if has_truth or not naming.is_estimate(g.column)]
    truth = first_columns(own_truth, ("x", "y", "heading"), ("truth",) if has_truth else ("",))
    if {"x", "y"} <= truth.keys() and not naming.is_estimate(Path(file.name).stem):
        parts.append(TablePart("truth", (file,), shared | truth))
    ways = [(table, way) for table, ways in zip(READINGS, QUANTITIES, strict=True) for way in ways]
    for table, quantities in ways:
        if table != "rssi" and "sightings" in {part.table for part in parts}:
            continue
        for each in split_readings([g for g in left if g.quantity == quantities[0]], "other" in shared):
            own = first_columns([*each, *left], quantities)
            alone = {q: g for q, g in shared.items() if q != "other"}  # with a column for each thing measured
            if len(own) == len(quantities):
                parts.append(TablePart(table, (file,), (alone if len(each) > 1 else shared) | own, each=each))
    return parts


def split_readings(guesses: Sequence[Guess], named: bool) -> list[tuple[Guess, ...]]:
    """Return the columns of robots by robots, and those of other things, apart.

    Of those whose things are `named` in a column one counts: "range" beside "range_raw", "rx_power" beside "fp_power".
    """
    pairs = tuple(g for g in guesses if "{other}" in g.column)
    others = tuple(g for g in guesses if "{other}" not in g.column)
    if named and len(others) > 1:
        plain = [g for g in others if naming.is_plain(g.column)]
        usual = [g for g in others if {"rx", "rssi"} & {*naming.words_of(g.column)}]
        best = plain[0] if len(plain) == 1 else (usual or others)[0]
        others = (best if best in plain else best._replace(reason=f"{best.reason}; of several, perhaps"),)
    return [each for each in (pairs, others) if each]


HELD = "the same in every line while positions change: not measured"


def is_held(heading: Array, places: Array) -> bool:
    """Return whether a heading, or a quaternion, never changes, and the places (m, 2) are not on a line."""
    places = places[np.isfinite(places).all(axis=1)]
    known = heading[np.isfinite(heading).all(axis=1)]
    if len(places) < 3 or not len(known) or np.ptp(known, axis=0).any():
        return False
    wide, narrow = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return bool(narrow > STRAIGHT * wide)


def drop_held_heading(part: TablePart, unused: list[str]) -> TablePart:
    """Return a part of the truth without a heading that was not measured, and note that."""
    if part.table != "truth" or "heading" not in part.columns:
        return part
    heading = part.columns["heading"]
    names, own = heading.quaternion or (heading.column,), [part.columns[q].column for q in "xy"]
    for file in part.files:
        if not is_held(*(np.array([file.columns[c] for c in some], float).T for some in (names, own))):
            return part
    unused.append(f"{', '.join(part.file_names)}: {', '.join(names)}, {HELD}")
    return part._replace(columns={q: g for q, g in part.columns.items() if q != "heading"})


def find_sideways(part: TablePart) -> Iterator[Finding]:
    """Yield what is odd about speeds of robots that move to the side."""
    sides = [g.column for f in part.files for g in f.guesses if g.reason == TO_THE_SIDE]
    if sides and part.kind == "velocity":
        fact = f"robots move to the side ({sides[0]}), of which speed and turn_rate say nothing"
        setting = 'kind = "displacement", with steps dx, dy along fixed axes, in place of speeds'
        yield Finding("sideways", "", part.file_names[0], fact, "likely", setting, "odometry")


def list_columns(names: Iterable[str]) -> str:
    """Return the names of columns in a line: covariance0 to covariance35 for all between."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(name.rstrip("0123456789"), []).append(name)
    return ", ".join(f"{some[0]} to {some[-1]}" if len(some) > 2 else ", ".join(some) for some in groups.values())


def name_estimates(files: Sequence[CsvTable]) -> str:
    """Return the end of a sentence on files without a truth: which of their columns are of a filter; "" without any."""
    found = [g.column for file in files for g in file.guesses if g.quantity in PLANE and naming.is_estimate(g.column)]
    columns = ", ".join(dict.fromkeys(found))
    return f"; what a filter estimated is none ({columns}): if it is, name it in [truth]" * bool(found)


def why_no_table(file: CsvTable, halves: bool = False) -> str:
    """Return why a file makes no table; "" where it makes one."""
    if not any(g.quantity for g in file.guesses) and file.is_nameless:
        return NAMELESS
    if parts_of(file, halves) or not {g.quantity for g in file.guesses} & {"time", "sec"}:
        why = next((g.reason for g in file.guesses if naming.name_meaning(g.column)[0] in ("time", "sec")), "")
        return "" if parts_of(file, halves) else f"{NO_STAMPS}{f' ({why})' * bool(why)}"
    if naming.is_estimate(Path(file.name).stem) and {"x", "y"} <= {g.quantity for g in file.guesses}:
        return "what a filter estimated is not taken for the truth; if it is, name it in [truth]"
    reasons: dict[str, list[str]] = {}
    if alone := [g.column for g in file.guesses if g.quantity == "bearing"]:
        reasons["bearings are read beside ranges alone"] = alone
    for g in file.guesses:
        if not g.quantity and g.reason != PART:
            reasons.setdefault(g.reason, []).append(g.column)
    shown = {why: [*some[:3], *[f"{len(some) - 3} others"] * (len(some) > 3)] for why, some in reasons.items()}
    unknown = "; ".join(f"{', '.join(some)}: {why}" for why, some in shown.items())
    return f"its columns make no table, of stamps with motion, positions or readings{f' ({unknown})' * bool(unknown)}"


def first_columns(
    guesses: Sequence[Guess], quantities: Sequence[str], sides: Sequence[str] = ("", "truth", "odometry")
) -> dict[str, Guess]:
    """Return the first column of each quantity on some sides; of motion a plain one, such as x, before e_x.

    Of second choice are those that were wanted, and a heading of these is none of a place that was measured.
    """
    plain = {g.column for g in guesses if g.quantity in MOTION and naming.is_plain(g.column)}
    ordered = sorted(guesses, key=lambda g: (naming.is_second_choice(g.column), g.column not in plain))
    found = {g.quantity: g for g in reversed(ordered) if g.side in sides}
    second = {q for q, g in found.items() if naming.is_second_choice(g.column)}
    lost = {"heading"} & second if {"x", "y"} & (found.keys() - second) else set[str]()
    return {q: found[q] for q in quantities if q in found.keys() - lost}


def _smaller_unit(one: Guess, other: Guess) -> Guess:
    """Return the guess of the smaller unit, of two by how far values span."""
    return min(one, other, key=lambda guess: UNITS["m"][guess.unit])


def merge_parts(parts: Sequence[TablePart], unused: list[str]) -> list[TablePart]:
    """Merge parts of the same table and columns; of all but readings keep what its name says, or has the most files."""
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
                if FAR in guess.reason and FAR in other.reason:
                    columns[q] = _smaller_unit(guess, other)
            part = before._replace(columns=columns, files=(*before.files, *part.files))
        merged[key] = part
    for key, part in merged.items():  # x and y have one unit
        far = {q: g for q, g in part.columns.items() if q in "xy" and FAR in g.reason}
        if len(far) == 2:
            one = _smaller_unit(*far.values())
            same = {q: g._replace(unit=one.unit, reason=one.reason) for q, g in far.items() if g.unit != one.unit}
            merged[key] = part._replace(columns=part.columns | same)
    kept: list[TablePart] = []
    for part in sorted(merged.values(), key=lambda part: (not part.is_named, -len(part.files), len(part.columns))):
        k = next((k for k, other in enumerate(kept) if other.table == part.table), -1)
        if part.table in READINGS or k < 0:
            kept.append(part)
        elif all(q in part.columns and part.columns[q].column == g.column for q, g in kept[k].columns.items()):
            kept[k] = kept[k]._replace(files=(*kept[k].files, *part.files))  # such as one that has headings too
        else:
            why = "but has other columns than the rest; make them alike"
            if kept[k].is_named and not part.is_named:
                why = f"and of {kept[k].file_names[0]} the name says it"
            unused.append(f"{', '.join(part.file_names)}: looks like {part.table} too, {why}")
    return kept
