"""What each column of a CSV file probably is: by its name first, then by its values, always with the reason."""

import csv
import re
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.text_files import fields_of, parse_number, read_text

DELIMITERS = (",", ";", "\t", "|", " ")

# --- The file


class Guess(NamedTuple):
    """The probable meaning of a column."""

    column: str
    quantity: str  # "" if it is not known
    unit: str  # as in log.toml; "" if there is none
    side: str  # "truth" or "odometry", if the name says so
    reason: str


class CsvTable(NamedTuple):
    """A CSV file, with a guess for each column."""

    name: str  # as in log.toml
    delimiter: str
    columns: Mapping[str, Array | tuple[str, ...]]  # numbers (rows,), nan where empty; else the fields as they are
    guesses: tuple[Guess, ...] = ()

    def numbers(self, column: str) -> Array:
        """Return a column's finite numbers, in order; none of a column of words."""
        values = self.columns[column]
        return np.empty(0) if isinstance(values, tuple) else values[np.isfinite(values)]

    def words(self, column: str) -> list[str]:
        """Return a column's fields that are not empty, as words."""
        values = self.columns[column]
        return (
            [w for w in values if w] if isinstance(values, tuple) else [f"{v:g}" for v in values[np.isfinite(values)]]
        )

    def names(self, column: str) -> tuple[str, ...]:
        """Return the names in a column, in order of appearance."""
        return tuple(dict.fromkeys(self.words(column)))

    @property
    def lines(self) -> int:
        """The number of lines with data."""
        return len(next(iter(self.columns.values())))


def read_csv(path: Path, name: str) -> CsvTable:
    """Read a CSV file whose first line names the columns; lines that are too short or too long are left out.

    Raises:
        BadInput: the file is not text, has no header, or no line of data.

    """
    text = read_text(path, "utf-8-sig").lstrip()
    if not text:
        raise BadInput(f"{path}: the file is empty; get it again")
    fields = {d: len(next(csv.reader([text.partition("\n")[0]], delimiter=d), [])) for d in DELIMITERS}
    delimiter = max(DELIMITERS, key=lambda d: (fields[d] > 1, d != " ", fields[d]))
    table = [row for _, row in fields_of(path, text, delimiter)]
    head = [name.lstrip("#").strip() for name in table[0]]
    if all(np.isfinite(parse_number(field)) for field in head if field):
        raise BadInput(f"{path}, line 1: numbers where the names of the columns should be; add a line of names")
    if twice := next((name for name in head if head.count(name) > 1), None):
        raise BadInput(f"{path}, line 1: two columns are named {twice!r}; rename one")
    whole = [row for row in table[1:] if len(row) == len(head)]
    if not whole:
        raise BadInput(f"{path}: it has no line of data with {len(head)} fields as in line 1; get the file again")
    columns = {column: _values(words) for column, words in zip(head, zip(*whole, strict=True), strict=True)}
    found = CsvTable(name, delimiter, columns)
    return found._replace(guesses=infer_columns(found))


def _values(fields: tuple[str, ...]) -> Array | tuple[str, ...]:
    """Numbers, if nine of ten fields that are not empty are numbers."""
    numbers = np.array([parse_number(field) if field else np.nan for field in fields])
    good, filled = np.isfinite(numbers), sum(map(bool, fields))
    return np.where(good, numbers, np.nan) if filled and good.sum() >= 0.9 * filled else fields


# --- Names

# Quantity -> words that name it. The first quantity with a word of the column wins, so the special come first.
WORDS = {
    "nsec": "nsec nsecs nanosec nanoseconds nanosecs",
    "sec": "sec secs seconds",
    "time": "t time stamp timestamp ts clock",
    "turn_rate": "w omega wz yawrate gyro angvel turnrate",
    "rssi": "rssi signal dbm power",
    "bearing": "bearing azimuth aoa doa",
    "heading": "yaw theta heading th psi orientation azimut",
    "range": "range ranges dist distance tof uwb",
    "dx": "dx deltax",
    "dy": "dy deltay",
    "length": "length path odometer mileage travelled metres meters",
    "speed": "v vx vel velocity speed vlin",
    "x": "x px posx east easting",
    "y": "y py posy north northing",
    "other": "to other target responder tag subject anchor landmark dst dest receiver",
    "robot": "robot id from name agent vehicle source src initiator node sender",
}
PAIRS = {  # two words that together name one quantity
    "turn_rate": ("yaw rate", "turn rate", "ang vel", "vel w", "angular z", "angular velocity", "angular vel"),
    "speed": ("linear x", "vel v", "vel x"),
    "": ("vel y",),
    "dx": ("delta x",),
    "dy": ("delta y",),
}
TRUTH = {"truth", "true", "gt", "groundtruth", "ground", "mocap", "vicon", "optitrack", "vrpn", "pos", "cap"}
ODOMETRY = {"odom", "odometry", "odo", "wheel", "wheels", "encoder", "imu", "cmd"}
UNIT = {"millimeters": "mm", "millimetres": "mm", "degs": "deg", "degree": "deg", "degrees": "deg", "radians": "rad"}
UNIT |= {"dbm": "dBm", "mps": "m/s", "kmh": "km/h"}
UNIT |= {unit: unit for unit in ("mm", "cm", "m", "deg", "rad", "ms", "us", "ns", "s")}
LENGTH, ANGLE, RATES = ("m", "cm", "mm"), ("rad", "deg"), ("speed", "turn_rate")
UNITS_OF = {
    "time": ("s", "ms", "us", "ns"),
    "rssi": ("dBm",),
    "heading": ANGLE,
    "bearing": ANGLE,
    "sec": (),
    "nsec": (),
}
QUANTITY = {word: quantity for quantity, words in WORDS.items() for word in words.split()}
QUANTITY_OF_PAIR = {pair: quantity for quantity, pairs in PAIRS.items() for pair in pairs}


class NameMeaning(NamedTuple):
    """The meaning of a column's name; "" where it has none."""

    quantity: str
    unit: str
    side: str  # "truth" or "odometry"


def words_of(name: str) -> list[str]:
    """Return the words of a name in small letters: camelCase, digits and signs divide it."""
    return [word.lower() for word in re.findall(r"[A-Za-z]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name))]


def name_meaning(column: str) -> NameMeaning:
    """Return the meaning of a column's name; a unit that does not fit the quantity is left out."""
    inside = re.search(r"[\[(]([^\])]*)[\])]", column)
    words = words_of(re.sub(r"[\[(][^\])]*[\])]", " ", column))
    pair = next((f"{a} {b}" for a, b in pairwise(words) if f"{a} {b}" in QUANTITY_OF_PAIR), "")
    known = [QUANTITY[word] for word in words if word in QUANTITY]
    quantity = QUANTITY_OF_PAIR[pair] if pair else min(known, key=list(WORDS).index, default="")
    unit = next((UNIT[word] for word in (words_of(inside[1]) if inside else words[1:]) if word in UNIT), "")
    if quantity in RATES:
        unit = f"{unit}/s" if unit in (*LENGTH, *ANGLE) else unit * ("/" in unit)
    elif unit not in UNITS_OF.get(quantity, LENGTH):
        unit = ""
    return NameMeaning(quantity, unit, side_of(words))


def side_of(words: list[str]) -> str:
    """Return "truth" or "odometry" if words speak of it."""
    return "odometry" if ODOMETRY & {*words} else "truth" if TRUTH & {*words} else ""


# --- Values

SI = {"time": "s", "sec": "s", "nsec": "ns", "turn_rate": "rad/s", "speed": "m/s", "rssi": "dBm"}  # else m
EPOCHS = {"ns": 1e9, "us": 1e6, "ms": 1e3, "s": 1.0}  # in a second
SINCE_1970 = (5e8, 5e9)  # [s] from 1985 to 2128
NAMES = ("robot", "other")  # quantities whose values are names


def infer_columns(table: CsvTable) -> tuple[Guess, ...]:
    """Guess the meaning of each column; the first unknown one that rises throughout is the time if no other is."""
    file_side = side_of(words_of(Path(table.name).stem))
    guesses = [_guess(table, column, file_side) for column in table.columns]
    if not any(guess.quantity in ("time", "sec") for guess in guesses):
        for i, guess in enumerate(guesses):
            values = table.numbers(guess.column)
            if not guess.quantity and len(values) > 10 and (np.diff(values) > 0).all():
                unit, why = _time_unit(values)
                why = f"it is the first column that rises; {why}"
                guesses[i] = guess._replace(quantity="time", unit=unit, reason=why)
                break
    return tuple(guesses)


def _guess(table: CsvTable, column: str, file_side: str) -> Guess:
    quantity, named_unit, side = name_meaning(column)
    reason, values = f"its name {column!r}", table.numbers(column)
    falls, rises = np.diff(values) < 0, len(values) > 10 and (np.diff(values) >= 0).all() and np.ptp(values) > 0
    unknown = ""
    if not quantity:
        unknown = "neither name nor values say what it is"
    elif isinstance(table.columns[column], tuple) and quantity not in NAMES:
        unknown = f"its name says {quantity}, but its values are not numbers"
    elif quantity == "turn_rate" and _is_beside_pose(table, column):
        unknown = "w beside x and y: part of a quaternion, or a heading"
    elif quantity in ("time", "sec") and len(values) > 1 and falls.mean() > 0.01:
        unknown = f"its name says {quantity}, but its values fall"
    if unknown:
        return Guess(column, "", "", side, unknown)
    beside = {name_meaning(name)[::2] for name in table.columns}
    if rises and (quantity, side) == ("x", "odometry") and ("y", "odometry") not in beside:
        quantity = "length"
        reason += " has no y beside it, and its values only rise: a counter of metres"
    unit, why = _unit(quantity, named_unit, values)
    return Guess(column, quantity, unit, side or file_side, reason + (f"; {why}" if why else ""))


def _unit(quantity: str, named: str, values: Array) -> tuple[str, str]:
    """Return the unit of a quantity and the reason: by the column's name, else by its values."""
    if quantity in NAMES:
        return "", ""
    if named:
        return named, f"{named} is in its name"
    if not len(values):
        return SI.get(quantity, "rad" if UNITS_OF.get(quantity) == ANGLE else "m"), "no values"
    if quantity == "time":
        return _time_unit(values)
    largest = float(np.quantile(np.abs(values), 0.99))
    if UNITS_OF.get(quantity) == ANGLE:
        if 2.1 * np.pi < largest <= 361:
            return "deg", f"values reach {largest:.4g}, more than 2 pi"
        return "rad", f"values reach {largest:.3g}"
    if quantity == "turn_rate":
        fast = float(np.quantile(np.abs(values), 0.75)) > 2 * np.pi
        return ("deg/s", f"values reach {largest:.4g}: no robot spins so fast in rad/s") if fast else ("rad/s", "SI")
    if quantity == "speed":
        return ("mm/s", f"values reach {largest:.4g}: too fast for m/s") if largest > 30 else ("m/s", "SI")
    if quantity in SI:
        return SI[quantity], ""
    span = float(np.ptp(np.quantile(values, [0.02, 0.98])))
    if span > 1000:
        return "mm", f"values span {span:.4g}: too far for metres"
    if span > 100:
        return "cm", f"values span {span:.4g}: far for metres, perhaps"
    return "m", f"values span {span:.3g}"


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


def _is_beside_pose(table: CsvTable, column: str) -> bool:
    """Return whether a column "..._w" stands beside "..._x" and "..._y" that are a place."""
    beside = {letter: column[:-1] + letter for letter in "xy"}
    places = all(name in table.columns and name_meaning(name).quantity == q for q, name in beside.items())
    return len(column) > 1 and column.endswith("w") and places
