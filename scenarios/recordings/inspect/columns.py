"""What the columns of a table are: each by its name first, then by its values, always with the reason."""

import re
import statistics
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from reprlib import repr as short_repr
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Mask
from cooploc.scenarios.recordings.inspect import naming
from cooploc.scenarios.recordings.inspect.nameless import names_by_values
from cooploc.scenarios.recordings.schema import UNITS
from cooploc.scenarios.recordings.text_files import (
    LEAST_LEFT,
    Rows,
    parse_field,
    parse_fields,
    plain_numbers,
    read_text,
    split_fields,
)

SEVERAL_KINDS = "lines of several kinds"


class Guess(NamedTuple):
    """The probable meaning of a column."""

    column: str
    quantity: str  # "" if it is not known
    unit: str  # as in log.toml; "" if there is none
    side: str  # "truth" or "odometry", if the name says so
    reason: str
    quaternion: tuple[str, ...] = ()  # the columns of which it is the last
    norm: tuple[str, ...] = ()  # of a speed: the columns of velocities along x and y of the world


class CsvTable(NamedTuple):
    """A CSV file, with a guess for each column."""

    name: str  # as in log.toml
    columns: Mapping[str, Array | tuple[str, ...]]  # numbers (rows,), nan where empty; else the fields as they are
    guesses: tuple[Guess, ...] = ()
    robots: tuple[str, ...] = ()  # whose names stand in place of {robot} in the names of columns
    units: Mapping[str, str] = {}  # of columns, in a line below their names

    @property
    def is_nameless(self) -> bool:
        """Whether its columns have numbers in place of names."""
        return [*self.columns] == [f"{k}" for k in range(1, len(self.columns) + 1)]

    def numbers(self, column: str) -> Array:
        """Return a column's finite numbers, in order; none of a column of words, or that is not there."""
        values = self.columns.get(column, ())
        return np.empty(0) if isinstance(values, tuple) else values[np.isfinite(values)]

    def names(self, column: str) -> list[str]:
        """Return the different words in a column, in order of appearance."""
        return list(dict.fromkeys(filter(None, self.words(column))))

    def words(self, column: str) -> Sequence[str]:
        """Return the word in each line of a column, numbers as names; "" where there is none."""
        values = self.columns[column]
        return values if isinstance(values, tuple) else [number_name(v) if np.isfinite(v) else "" for v in values]


def number_name(number: float) -> str:
    """Return a number as the name of a robot or an anchor: all digits of a whole one."""
    return f"{number:.0f}" if number == np.rint(number) else f"{number:g}"


def read_csv(path: Path, name: str, ends: int = 0) -> CsvTable:
    """Read a CSV file whose first line names the columns; lines that are too short or too long are left out.

    With `ends` its first and last so many lines alone.
    """
    text = read_text(path).lstrip()
    if ends and text.count("\n") > 2 * ends:
        text = "\n".join([*text.split("\n", ends)[:ends], *text.rsplit("\n", ends)[1:]])
    if not text:
        raise BadInput(f"{path}: the file is empty; get it again")
    plain = plain_numbers(text)
    head, line, rows = (plain.head, plain.named, []) if plain else split_fields(text)
    twice = {name for name in head if head.count(name) > 1}  # not read, and missed where no other column is alike
    once = {naming.name_meaning(name)[0] for name in head if name not in twice}
    if missed := next((name for name in head if name in twice and naming.name_meaning(name)[0] not in {"", *once}), ""):
        raise BadInput(f"{path}, line {line}: two columns are named {short_repr(missed)}; rename one")
    patterns, robots = naming.columns_of_robots(head, naming.ESTIMATES)
    whole = [] if plain else _whole_rows(path, head, line, rows)
    fields = plain.values.T if plain else zip(*whole, strict=True)
    columns: dict[str, Array | tuple[str, ...]] = {}
    for column, own in zip(head, fields, strict=True):  # of several robots the first one's values
        if column not in twice:
            columns.setdefault(patterns.get(column, column), own if plain else _numbers_or_words(own))
    below = whole[0] if whole and not any(np.isfinite(parse_field(word)) for word in whole[0]) else ()
    is_units = {"".join(naming.words_of(word)[:1]) for word in below} & {"s", "sec", "ms", "us", "ns"}
    units = {patterns.get(c, c): unit for c, unit in zip(head, below, strict=False)} if is_units else {}
    found = CsvTable(name, columns, (), robots, units)
    return found._replace(guesses=infer_columns(found))


def _whole_rows(path: Path, head: Sequence[str], line: int, rows: Rows) -> list[list[str]]:
    """Return the lines with as many fields as there are names; refuse lines of several kinds, or of another number."""
    if kinds := _kinds_of_lines(head, [row for _, row in rows[:1000]]):
        shown = ", ".join([*map(short_repr, kinds[:3]), *["..."] * (len(kinds) > 3)])
        own = re.sub(r"\W", "", kinds[0]).lower()
        example = f"grep -F '{kinds[0]}' {path.name} > {own}_{path.name}"
        raise BadInput(f"{path}: {SEVERAL_KINDS} ({shown}); write a file of each, such as {example}")
    if not rows:
        raise BadInput(f"{path}: it has no line of data with {len(head)} fields as in line {line}; get the file again")
    whole = [row for _, row in rows if len(row) == len(head)]
    if len(whole) < LEAST_LEFT * len(rows):
        most = statistics.mode(len(row) for _, row in rows)
        remedy = "leave one line above the numbers, with the names of all columns (of a truth: time, x, y, heading)"
        raise BadInput(f"{path}: most lines have {most} fields, and line {line}, with the names, {len(head)}; {remedy}")
    return whole


def _numbers_or_words(words: tuple[str, ...]) -> Array | tuple[str, ...]:
    """Return a column's numbers, nan where there is none, if most of its fields are; else its fields."""
    numbers = parse_fields(words)
    good, filled = np.isfinite(numbers), (~np.isnan(numbers)).sum()
    return np.where(good, numbers, np.nan) if good.sum() >= 0.9 * filled else words


def _kinds_of_lines(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the words with which lines of several kinds begin, at once or after a stamp; none of a plain table.

    Lines of different kinds have other numbers of fields, or, without names of columns, the words say what they are.
    """
    for k in range(2):
        sizes: dict[str, list[int]] = {}
        for row in rows:
            sizes.setdefault(row[k] if len(row) > k else "", []).append(len(row))
        again = 1 < len(sizes) <= min(20, len(rows) / 2)  # sentences begin with another word each
        if not again or not all(word and np.isinf(parse_field(word)) for word in sizes):
            continue
        meant = {naming.side_of(word) or naming.name_meaning(word)[0] for word in sizes} - {""}
        if len({*map(statistics.mode, sizes.values())}) > 1 or (head[0] == "1" and len(meant) > 1):
            return [*sizes]
    return []


def table_of_fields(topic: str, fields: Mapping[str, Sequence[Any]]) -> CsvTable:
    """Return the fields of a topic's messages as columns, with a guess for each."""
    columns: dict[str, Array | tuple[str, ...]] = {}
    for name, values in ((name, values) for name, values in fields.items() if values):
        numbers = not any(isinstance(value, str) for value in values)
        columns[name] = np.array(values, float) if numbers else tuple(map(str, values))
    found = CsvTable(topic, columns)
    return found._replace(guesses=infer_columns(found))


# --- Values

EPOCHS = {"ns": 1e9, "us": 1e6, "ms": 1e3, "s": 1.0}  # in a second
SINCE_1970 = (5e8, 5e9)  # [s] from 1985 to 2128
FAR = "far for metres"  # of a length whose span alone is for another unit
SLOW = 2.0  # [1/s] in radians robots turn more slowly, in degrees faster
NAMES = ("robot", "other")  # quantities whose values are names
ENDS = ("i", "j", "a", "b", "rx", "tx")  # names of the columns of who measured and what was measured
RELATIVE = {"dx": "ahead", "dy": "left"}  # quantities that are of places if a column says whose
MEASURED = {*RELATIVE, "range", "rssi", "bearing", "ahead", "left", "x", "speed"}
FLAGS = 10  # values that a column without a quantity may have and be no measurement
PART = "read with another column"
BESIDE = "beside who was seen, perhaps"
LONGEST_FLIGHT = 1e-4  # [s] of 30 km
OF_FLIGHT = "a time of flight: write the range, 0.299792458 m for each ns"


def infer_columns(table: CsvTable) -> tuple[Guess, ...]:
    """Guess the meaning of each column; of those without names by what they are probably called."""
    if table.is_nameless and (called := names_by_values(table.columns, table.name)):
        named = table._replace(columns={called[column]: values for column, values in table.columns.items()})
        columns = {name: column for column, name in called.items()}
        return tuple(
            guess._replace(
                column=columns[guess.column],
                quaternion=tuple(columns[name] for name in guess.quaternion),
                norm=tuple(columns[name] for name in guess.norm),
                reason=f"{guess.column!r} by its place and its values{', perhaps' * (guess.quantity != 'time')}"
                if guess.quantity
                else guess.reason,
            )
            for guess in infer_columns(named)
        )
    path, quaternions = Path(table.name), _quaternions(table)
    file_side = naming.side_of(path.stem) or naming.side_of(path.parent.name)
    guesses = [
        quaternions[column]._replace(side=naming.side_of(column) or file_side)
        if column in quaternions
        else _guess(table, column, file_side)
        for column in table.columns
    ]
    count = {g.column: len({*table.names(g.column)}) for g in guesses if g.quantity == "robot"}
    of_motion = not {"range", "rssi", "bearing", "ahead"} & {guess.quantity for guess in guesses}
    if of_motion and 1 in count.values() and max(count.values()) > 1:  # agent_role beside agent_id
        why = "the same in all lines, beside names that differ"
        guesses = [g._replace(quantity="", reason=why) if count.get(g.column) == 1 else g for g in guesses]
    lines = max((len(values) for values in table.columns.values()), default=0)
    if {"time", "sec"} & {g.quantity for g in guesses} and lines > FLAGS:
        why = "another in each line: it counts them"
        guesses = [g._replace(quantity="", reason=why) if count.get(g.column) == lines else g for g in guesses]
    both = [g for g in guesses if g.quantity in NAMES or g.column.lower() in ENDS]  # robot1 and robot2, or i and j
    both.sort(key=lambda guess: naming.is_anchor(guess.column))  # a tag measures anchors
    if len(both) == 2 and not np.array_equal(table.columns[both[0].column], table.columns[both[1].column]):
        same = {*table.names(both[0].column)} & {*table.names(both[1].column)}
        of_anchors = [naming.is_anchor(guess.column) for guess in both] == [False, True]
        alike = both[0].quantity == both[1].quantity
        measured = of_anchors or bool({"range", "rssi"} & {guess.quantity for guess in guesses})
        for one, quantity in zip(both, NAMES, strict=True) if same or (alike and measured) else ():
            if alike or not {one.quantity for one in both} & {*NAMES}:
                why = "two columns with the same names" if same else "what measured, and what was measured"
                why = "what measured, and an anchor" if of_anchors else why
                guesses[guesses.index(one)] = one._replace(quantity=quantity, reason=why)
    guesses = _with_y_up(table, _join_velocities(table, guesses))
    there = {guess.quantity for guess in guesses}
    return tuple(_seen_at(table, _seen_of_another(table, guesses, there)) if {"time", "other"} <= there else guesses)


def _seen_of_another(table: CsvTable, guesses: Sequence[Guess], there: Collection[str]) -> list[Guess]:
    """Return guesses where a column says who was measured: steps are its place, the only number is its range."""
    alone = [g for g in guesses if not g.quantity and len({*table.numbers(g.column)}) > FLAGS]
    alone = [
        g
        for g in alone
        if g.reason not in (PART, OF_FLIGHT) and "nothing" not in map(naming.QUANTITY.get, naming.words_of(g.column))
    ]
    found = list(guesses)
    for k, guess in enumerate(guesses):
        if guess.quantity in RELATIVE and {*RELATIVE} <= {*there}:
            seen = f"{guess.reason}; beside who was seen"
            found[k] = guess._replace(quantity=RELATIVE[guess.quantity], reason=seen)
        elif alone == [guess] and not MEASURED & {*there}:
            kind = "rssi" if (table.numbers(guess.column) < 0).all() else "range"
            unit, why = infer_unit(kind, "", table.numbers(guess.column), np.inf)
            only = f"the only number beside who was measured, perhaps; {why}"
            found[k] = guess._replace(quantity=kind, unit=unit, reason=only)
    return found


def _seen_at(table: CsvTable, guesses: list[Guess]) -> list[Guess]:
    """Return guesses where x and y in a file of detections are ahead and left of who saw; of a camera z and -x are."""
    places = {g.quantity: g for g in guesses if g.quantity in ("x", "y") and g.side != "truth"}
    there = {g.quantity for g in guesses}
    measured = {"range", "bearing", "ahead"} & there
    if len(places) < 2 or measured or "robot" not in there or not naming.SEEN & {*naming.words_of(table.name)}:
        return guesses
    x, y, why = places["x"], places["y"], BESIDE
    new = {x.column: ("ahead", x.unit), y.column: ("left", y.unit)}
    depth = x.column.replace("x", "z")
    if depth in table.columns and (table.numbers(depth) > 0).mean() > 0.95:
        new = {depth: ("ahead", x.unit), x.column: ("left", f"-{x.unit}"), y.column: ("", "")}
        why = "the axes of a camera, beside who was seen, perhaps"
    return [Guess(g.column, *new[g.column], "", why) if g.column in new else g for g in guesses]


def _quaternions(table: CsvTable) -> dict[str, Guess]:
    """Return guesses for columns that are quaternions, of x, y, z, w or of z, w: that of w is taken for the heading.

    A unit may follow: q_RS_w [] of EuRoC.
    """
    found: dict[str, Guess] = {}
    for column in table.columns:
        of_w = re.fullmatch(r"(.*)([wW])(\s*[\[(].*)?", column)
        own = [f"{of_w[1]}{q}{of_w[3] or ''}" for q in ("xyzw" if of_w[2] == "w" else "XYZW")] if of_w else []
        own = [name for name in own if name in table.columns]
        values = [values for name in own if not isinstance(values := table.columns[name], tuple)]
        if len(own) not in (2, 4) or len(values) < len(own):
            continue
        lengths = np.linalg.norm(np.array(values, float), axis=0)
        if (np.abs(lengths[np.isfinite(lengths)] - 1) < 0.01).mean() > 0.9 and np.isfinite(lengths).any():
            found |= {name: Guess(name, "", "", "", PART) for name in own}
            whole = f"with {', '.join(own[:-1])} of length 1: a quaternion"
            found[column] = Guess(column, "heading", "rad", "", whole, tuple(own))
    return found


LEVEL = 0.05  # times as far as x and z, which change by a metre: y that changes no more is a height


def _with_y_up(table: CsvTable, guesses: list[Guess]) -> list[Guess]:
    """Return guesses where y hardly changes, and z does: y is up, as of much motion capture, and -z is to the left.

    The heading is about y, then: in a quaternion y and z change places.
    """
    of = {g.quantity: g for g in guesses if g.quantity in ("x", "y") and g.side != "odometry"}
    z = "z".join(of["y"].column.rsplit("y", 1)) if len(of) == 2 else ""
    columns = [table.numbers(c) for c in (of["x"].column, of["y"].column, z)] if z else [np.empty(0)]
    there = {g.quantity for g in guesses}
    if not all(map(len, columns)) or "other" in there or not {"time", "sec"} & there:
        return guesses
    wide, high, deep = (float(np.quantile(v, 0.98) - np.quantile(v, 0.02)) for v in columns)
    if not high < LEVEL * min(wide, deep) or not min(wide, deep) > 1.0:
        return guesses
    unit, why = infer_unit("y", "", table.numbers(z), np.inf)
    new = {of["y"].column: of["y"]._replace(quantity="", reason="a height, as it hardly changes beside x and z")}
    new[z] = of["y"]._replace(column=z, unit=f"-{unit}", reason=f"beside a y that hardly changes, perhaps up; {why}")
    for g in guesses:
        if len(g.quaternion) == 4:
            x, y, z_, w = g.quaternion
            new[g.column] = g._replace(quaternion=(x, z_, y, w), reason=f"{g.reason}, with y up")
    return [new.get(g.column, g) for g in guesses]


SIDEWAYS = 0.2  # of the speed, on average: robots on two wheels have less to the side
TO_THE_SIDE = "to the side, and large beside what is ahead: it is not used"


def _join_velocities(table: CsvTable, guesses: list[Guess]) -> list[Guess]:
    """Return guesses where velocities along x and y of the world are one speed; others to the side are marked.

    Velocities of the world's axes turn as the robot does; a robot's own have next to nothing to the side.
    """
    speed = next((g for g in guesses if g.quantity == "speed" and "x" in g.column), None)
    if speed is None:
        return guesses
    left = "y".join(speed.column.rsplit("x", 1))
    values = [v for c in (speed.column, left) if not isinstance(v := table.columns.get(c, ()), tuple)]
    if len(values) < 2 or not np.isfinite(total := np.hypot(*values)).any():
        return guesses
    whose = next((np.asarray(table.columns[g.column]) for g in guesses if g.quantity == "robot"), np.zeros(len(total)))
    own = whose == whose[0]  # the lines of several robots may alternate
    fast = np.flatnonzero(own & (total > 0.3 * np.nanquantile(total, 0.9)))
    ahead, to_left = (v[fast] for v in values)
    if not (to_left**2).sum() > SIDEWAYS**2 * (total[fast] ** 2).sum():
        return guesses
    course, turned = np.unwrap(np.arctan2(to_left, ahead)), _turned(table, guesses, own)[fast]
    of_world = np.ptp(course) > 0.5 and np.std(course - turned) < 0.3 * np.std(course)
    why = f"with {left!r} along the axes of the world, as they turn with the robot"
    new = {left: Guess(left, "", "", "", PART if of_world else TO_THE_SIDE)}
    new |= {speed.column: speed._replace(norm=(speed.column, left), reason=why)} if of_world else {}
    return [new.get(g.column, g) for g in guesses]


def _turned(table: CsvTable, guesses: Sequence[Guess], own: Mask) -> Array:
    """Return how far a robot turned up to each of its `own` lines [rad], by rates or headings; nan if not known."""
    of = {g.quantity: g for g in guesses if not g.quaternion and not isinstance(table.columns[g.column], tuple)}
    turned = np.full(len(own), np.nan)

    def si(quantity: str, unit: str) -> Array:
        told = of[quantity].unit
        factor = UNITS[unit][told.removeprefix("-")] * (-1 if told.startswith("-") else 1)
        return factor * np.asarray(table.columns[of[quantity].column], float)[own]

    if {"time", "turn_rate"} <= of.keys():
        t = si("time", "s")
        turned[own] = np.nancumsum(si("turn_rate", "rad/s") * np.diff(t, prepend=t[0]))
    elif "heading" in of:
        turned[own] = np.unwrap(si("heading", "rad"))
    return turned


def _guess(table: CsvTable, column: str, file_side: str) -> Guess:
    below = f" [{table.units[column]}]" if column in table.units else ""
    quantity, named_unit, own_side = naming.name_meaning(column + below)
    reason, values = f"its name {column!r}", table.numbers(column)
    side = file_side if file_side and not {*naming.words_of(column)} & naming.CERTAIN else own_side
    about = naming.name_meaning(Path(table.name).stem)[0]
    change = np.diff(values)
    beside = {naming.name_meaning(name)[::2] for name in table.columns}
    of_many = len({*values.tolist()}) > FLAGS and about not in dict(beside)
    if quantity == "other" and about in ("range", "rssi") and of_many:
        quantity, reason = about, f"{reason}, in a file of that name"
    places = [name for name in (column[:-1] + q for q in "xy") if name in table.columns]
    unknown = ""
    named = [naming.QUANTITY.get(word, "") for word in naming.words_of(column)]
    no_names = bool(((values < -1) | (values != np.rint(values))).any())  # -1 is of none
    if quantity in ("range", "rssi") and isinstance(table.columns[column], tuple):  # uwb_to, if its values are names
        quantity = next((one for one in named if one in NAMES), quantity)
    elif quantity in NAMES and no_names:  # distanceFromTag
        quantity = next((one for one in named if one in ("range", "rssi")), quantity)
    if quantity == "angle":  # to what is measured, or of what is somewhere, if no other column is that
        by, known = {"range": "bearing", "x": "heading"}, dict(beside)
        quantity = next((angle for other, angle in by.items() if other in known and angle not in known), "")
    if not quantity:
        remedies = [naming.REMEDY[word] for word in naming.words_of(column) if word in naming.REMEDY]
        unknown = remedies[0] if remedies else "neither name nor values say what it is"
    elif isinstance(table.columns[column], tuple) and quantity not in NAMES:
        of_lists = any(str(word).startswith(("(", "[")) for word in table.columns[column][:10])
        values_are = "lists: write a line for each element" if of_lists else "not numbers"
        unknown = f"its name says {quantity}, but its values are {values_are}"
    elif (
        quantity == "turn_rate"
        and column[1:]
        and column[-1] == "w"
        and [naming.name_meaning(n)[0] for n in places] == ["x", "y"]
        and "speed" not in dict(beside)
    ):
        unknown = "w beside x and y: part of a quaternion, or a heading"
    elif quantity in NAMES and no_names:
        unknown = f"its name says {quantity}, but its values are negative or not whole"
    elif quantity in ("time", "sec") and len(change) and 0.3 < (change < 0).mean() < 1 and _falls(table, values):
        unknown = f"its name says {quantity}, but its values fall"
    elif quantity == "range" and _is_of_flight({*naming.words_of(column + below)}, values):
        unknown = OF_FLIGHT
    elif quantity == "time" and len(values) > 10 > 2 * len({*values.tolist()}):
        unknown = f"{values[0]:.10g} and hardly another: it was written with too few digits"
    if unknown:
        return Guess(column, "", "", side, unknown)
    if quantity == "rssi" and len(values) and np.median(values) > 0:
        return Guess(
            column, quantity, "-dBm", side or file_side, f"{reason}; positive: dBm without their sign, perhaps"
        )
    rises = len(values) > 10 and (change >= 0).all() and np.ptp(values) > 0
    lacks = {"x": ("y", own_side) not in beside and "y", "range": "speed" not in dict(beside) and "speed"}.get(quantity)
    if rises and side == "odometry" and lacks:
        quantity = "length"
        reason += f" has no {lacks} beside it, and its values only rise: a counter of metres"
    values = values[values < no_reading(values)] if quantity == "range" else values
    unit, why = infer_unit(quantity, named_unit, values, _turn_rate(table, column) if quantity == "heading" else np.inf)
    if quantity == "heading" and naming.is_clockwise(column):
        unit, why = f"-{unit}", f"{why}; of a compass: clockwise from north"
    return Guess(column, quantity, unit, side or file_side, reason + (f"; {why}" if why else ""))


def _is_of_flight(words: Collection[str], values: Array) -> bool:
    """Return whether a column is of times that a signal flew: by its unit, or by how short they are in seconds."""
    return bool({"ns", "ps"} & {*words}) or ("tof" in words and np.max(np.abs(values), initial=0.0) < LONGEST_FLIGHT)


def _falls(table: CsvTable, values: Array) -> bool:
    """Return whether values often fall also from a line to the next one by the same robot, if lines name a robot."""
    names = (words for name, words in table.columns.items() if naming.name_meaning(name)[0] == "robot")
    order = np.argsort(np.asarray(next(names, np.zeros(len(values)))), kind="stable")
    return bool((np.diff(values[order]) < 0).mean() > 0.3)


def no_reading(values: Array, far: float = 1.5, more: float = np.inf) -> float:
    """Return what a radio says of nothing: the largest, often there, and so many times all others, or so much more.

    inf if there is none.
    """
    largest = np.max(values, initial=0.0)
    others = values[values < largest]
    often = len(values) > len(values) - len(others) >= max(10, 0.005 * len(values))
    return float(largest) if often and largest >= min(far * np.max(others), more + np.max(others)) else np.inf


def _turn_rate(table: CsvTable, column: str) -> float:
    """Return how fast a column of angles turns: the 90th percentile of its changes [1/s]; inf where that is unknown."""
    stamp = next((c for c in table.columns if naming.name_meaning(c)[0] == "time"), column)
    t, values = table.columns[stamp], table.columns[column]
    if isinstance(t, tuple) or isinstance(values, tuple) or not (there := np.isfinite(t) & np.isfinite(values)).any():
        return np.inf
    names = (words for name, words in table.columns.items() if naming.name_meaning(name)[0] == "robot")
    robot = np.asarray(next(names, np.zeros(len(t))))
    if (same := there & (robot == robot[np.argmax(there)])).any():  # the lines of several may alternate
        there = same
    dt, turned = np.abs(np.diff(t[there])) / EPOCHS[_time_unit(t[there])[0]], np.abs(np.diff(values[there]))
    return float(np.quantile(turned[dt > 0] / dt[dt > 0], 0.9)) if (dt > 0).any() else np.inf


def infer_unit(quantity: str, named: str, values: Array, turn_rate: float) -> tuple[str, str]:
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
        (span > 1000, "mm", f"values span {span:.4g}: too {FAR}"),
        (span > 100, "cm", f"values span {span:.4g}: {FAR}, perhaps"),
    )
    return next(((unit, why) for holds, unit, why in rules if holds), ("m", f"values span {span:.3g}"))


def _time_unit(values: Array) -> tuple[str, str]:
    """Return the unit of stamps by their size since 1970, else by their intervals: between 0.1 ms and 30 s."""
    middle = float(np.median(values))
    for unit, factor in EPOCHS.items():
        if SINCE_1970[0] < middle / factor < SINCE_1970[1]:
            return unit, f"{middle:.4g} since 1970 is in {unit}"
    intervals = np.abs(np.diff(values))
    usual = float(np.median(intervals[intervals > 0])) if (intervals > 0).any() else 1.0
    for unit, least in (("ns", 1e6), ("us", 1e3), ("ms", 5.0)):
        if usual >= least and float(np.ptp(values)) > 2e3:
            return unit, f"the usual interval is {usual:.4g}"
    return "s", f"the usual interval is {usual:.3g}"
