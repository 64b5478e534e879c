"""What each column of a CSV file probably is: by its name first, then by its values, always with the reason."""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.inspect.csv_look import CsvLook
from cooploc.scenarios.recordings.inspect.names import named, side_of, words_of

SI = {
    "time": "s",
    "sec": "s",
    "nsec": "ns",
    "turn_rate": "rad/s",
    "speed": "m/s",
    "heading": "rad",
    "bearing": "rad",
    "rssi": "dBm",
}
LENGTHS = ("x", "y", "dx", "dy", "length", "range")
EPOCHS = {"ns": 1e9, "us": 1e6, "ms": 1e3, "s": 1.0}  # in a second
SINCE_1970 = (5e8, 5e9)  # [s] from 1985 to 2128
NAMES = ("robot", "other")  # quantities whose values are names


class Guess(NamedTuple):
    """What a column probably is."""

    column: str
    quantity: str  # "" where it is not known
    unit: str  # as in log.toml; "" where there is none
    side: str  # "truth" or "odometry", where the name says so
    reason: str


def guesses(look: CsvLook) -> tuple[Guess, ...]:
    """A guess for each column of a file."""
    file_side = side_of(words_of(look.path.stem))
    found = [_guess(look, column, file_side) for column in look.columns]
    if not any(guess.quantity in ("time", "sec") for guess in found):
        found = _first_rising(look, found)
    return tuple(found)


def _guess(look: CsvLook, column: str, file_side: str) -> Guess:
    said = named(column)
    quantity, reason = said.quantity, f"its name {column!r}"
    if not quantity:
        return Guess(column, "", "", said.side, "neither name nor values say what it is")
    if isinstance(look.columns[column], tuple) and quantity not in NAMES:
        return Guess(column, "", "", said.side, f"its name says {quantity}, but its values are not numbers")
    values = look.numbers(column)
    if quantity == "turn_rate" and _beside_pose(look, column):
        return Guess(column, "", "", said.side, "w beside x and y: part of a quaternion, or a heading")
    if quantity == "x" and said.side == "odometry" and _is_counter(values) and not _has(look, "y", said.side):
        quantity, reason = "length", f"{reason} has no y beside it, and its values only rise: a counter of metres"
    if quantity in ("time", "sec") and len(values) > 1 and (np.diff(values) < 0).mean() > 0.01:
        return Guess(column, "", "", said.side, f"its name says {quantity}, but its values fall")
    unit, why = _unit(quantity, said.unit, values)
    return Guess(column, quantity, unit, said.side or file_side, reason + (f"; {why}" if why else ""))


def _unit(quantity: str, said: str, values: Array) -> tuple[str, str]:
    """The unit of a quantity and the reason, by the column's name, else by its values."""
    if quantity in NAMES:
        return "", ""
    if said:
        return said, f"{said} is in its name"
    if not len(values):
        return SI.get(quantity, "m"), "no values"
    if quantity == "time":
        return _time_unit(values)
    largest = float(np.quantile(np.abs(values), 0.99))
    if quantity in ("heading", "bearing"):
        if 2.1 * np.pi < largest <= 361:
            return "deg", f"values reach {largest:.4g}, more than 2 pi"
        return "rad", f"values reach {largest:.3g}"
    if quantity == "turn_rate":
        fast = float(np.quantile(np.abs(values), 0.75)) > 2 * np.pi
        return ("deg/s", f"values reach {largest:.4g}: no robot spins so fast in rad/s") if fast else ("rad/s", "SI")
    if quantity == "speed":
        return ("mm/s", f"values reach {largest:.4g}: too fast for m/s") if largest > 30 else ("m/s", "SI")
    if quantity in LENGTHS:
        return _length_unit(values)
    return SI.get(quantity, "m"), ""


def _time_unit(values: Array) -> tuple[str, str]:
    """By the size of stamps since 1970, else by their intervals: between 0.1 ms and 30 s."""
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


def _length_unit(values: Array) -> tuple[str, str]:
    """mm where values span more than 1000, cm where more than 100."""
    span = float(np.ptp(np.quantile(values, [0.02, 0.98])))
    if span > 1000:
        return "mm", f"values span {span:.4g}: too far for metres"
    if span > 100:
        return "cm", f"values span {span:.4g}: far for metres, perhaps"
    return "m", f"values span {span:.3g}"


def _beside_pose(look: CsvLook, column: str) -> bool:
    """Whether a column "..._w" stands beside "..._x" and "..._y" that are a place."""
    stem = column[:-1]
    beside = [stem + letter for letter in "xy"]
    places = all(name in look.columns and named(name).quantity == name[-1] for name in beside)
    return bool(stem) and column[-1:] == "w" and places


def _is_counter(values: Array) -> bool:
    return len(values) > 10 and bool((np.diff(values) >= 0).all()) and float(np.ptp(values)) > 0


def _has(look: CsvLook, quantity: str, side: str) -> bool:
    return any(named(name).quantity == quantity and named(name).side == side for name in look.columns)


def _first_rising(look: CsvLook, found: list[Guess]) -> list[Guess]:
    """The first column that nothing is known of and that rises throughout is the time."""
    for i, guess in enumerate(found):
        values = look.numbers(guess.column)
        if not guess.quantity and len(values) > 10 and (np.diff(values) > 0).all():
            unit, why = _time_unit(values)
            found[i] = guess._replace(quantity="time", unit=unit, reason=f"it is the first column that rises; {why}")
            break
    return found
