"""The error for what a user can fix: an unknown name, a value out of bounds, a malformed file.

Its message is one line that states the fact, the place and the remedy; the command line prints it and exits with 2.
"""

import os
import re
import reprlib
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any


class BadInput(ValueError):
    """A request or an input that is not valid; the message states the fact, the place and the remedy."""

    def _render_traceback_(self) -> list[str]:
        """Return what a notebook shows: where in its own code, and the message; none of the frames of our code."""
        return [*places_of_user(self), f"{type(self).__name__}: {self}"]


MOST = 30  # names in a message


def nearest(name: str, known: list[str]) -> str:
    """Return the end of an error message: known names that begin so, or the nearest; else all, or some of many."""
    by_lower = {one.lower(): one for one in known}
    longer = [one for one in by_lower if len(name) > 2 and one.startswith(name.lower())]
    if close := longer or get_close_matches(name.lower(), by_lower, n=1):
        return f"did you mean {' or '.join(repr(by_lower[one]) for one in close)}?"
    more = f" and {len(known) - MOST} more (cooploc list)" * (len(known) > MOST)
    return f"known are {', '.join(known[:MOST])}{more}" if known else "it has none"


PLAIN_WORDS = {  # of pydantic's kinds of errors
    "greater_than_equal": "it must be at least {ge}",
    "greater_than": "it must be above {gt}",
    "less_than_equal": "it must be at most {le}",
    "less_than": "it must be below {lt}",
    "finite_number": "it must be a finite number",
    "literal_error": "it must be {expected}",
    **dict.fromkeys(("int_parsing", "int_type", "int_from_float"), "it must be a whole number"),
    **dict.fromkeys(("float_parsing", "float_type"), "it must be a number"),
    **dict.fromkeys(("bool_parsing", "bool_type"), "it must be true or false"),
    "string_type": "it must be text",
    "tuple_type": "it must be a list",
    "missing": "it is missing",
}


def plain_words(error: Mapping[str, Any]) -> str:
    """Return what one of pydantic's errors says, in plain words where there are some."""
    words = PLAIN_WORDS.get(error["type"])
    return words.format(**error.get("ctx", {})) if words else str(error["msg"]).removeprefix("Value error, ")


def first_reason(errors: list[Any]) -> str:
    """Return the first of pydantic's errors as "place: what is wrong, not VALUE"."""
    first: Mapping[str, Any] = errors[0]
    place, said = ".".join(map(str, first["loc"])), plain_words(first)
    value = first.get("input")
    said += f", not {reprlib.repr(value)}" if isinstance(value, bool | int | float | str) else ""
    return f"{place}: {said}" if place else said


OURS = f"{Path(__file__).parents[1]}{os.sep}"  # where our code is


def places_of_user(e: BaseException) -> list[str]:
    """Return the lines of a traceback before and after our code, such as "mine.py, line 3, in predict: x = y"."""
    frames = list(traceback.extract_tb(e.__traceback__))
    ours = [i for i, one in enumerate(frames) if one.filename.startswith(OURS)] or [len(frames)]
    began = max((i for i, one in enumerate(frames) if one.name == "run_code"), default=-1)  # of a notebook's cell
    lines = []
    for one in (*frames[began + 1 : ours[0]], *frames[ours[-1] + 1 :]):
        place = [Path(one.filename).name] * Path(one.filename).is_file() + [f"line {one.lineno}"]
        where = ", ".join([*place, *[f"in {one.name}"] * (one.name != "<module>")])
        lines.append(f"{where}: {one.line}" if one.line else where)
    return lines


def traceback_text(e: BaseException) -> str:
    """Return a traceback as Python prints it, from a user's code on; an error of our own without any says it all."""
    frames = e.__traceback__
    while frames and frames.tb_frame.f_code.co_filename.startswith((OURS, sys.prefix, sys.base_prefix)):
        frames = frames.tb_next
    if not frames and type(e).__module__.startswith("cooploc."):
        return one_line(e)
    return "".join(traceback.format_exception(type(e), e, frames or e.__traceback__))


def one_line(e: BaseException) -> str:
    """Return an exception's type and message on one line."""
    return f"{type(e).__name__}: {message(e)}" if message(e) else type(e).__name__


def message(e: BaseException) -> str:
    """Return an exception's message on one line, without memory addresses, whatever its `__str__` does."""
    try:
        return " ".join(re.sub(r" at 0x[0-9a-f]+", "", str(e)).split())
    except BaseException:
        return "its message cannot be read"


# Limits of parameters, so that a slip of the keyboard is refused at once instead of filling the memory for hours.


Limits = Mapping[str, tuple[float, float]]  # the smallest and the largest value of a parameter, by its name


def require(owner: Any, limits: Limits) -> None:
    """Refuse parameters outside their limits, both included, by a ValueError; nan is outside of any."""
    for name, (low, high) in limits.items():
        value = getattr(owner, name)
        if not low <= value <= high:
            least, most = f"at least {low:g}", f"at most {high:g}"
            raise ValueError(
                f"{name} is {value}; it must be {least if value < low else most if value > high else 'a number'}"
            )


def count_of(number: int, noun: str) -> str:
    """Return a number of things in words: "1 trial", "3 trials"."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def first_of(names: Iterable[str], most: int = 3) -> str:
    """Return names in words, of many the first ones and how many more there are: "red, blue, green and 5 more"."""
    every = list(names)
    return ", ".join(every[:most]) + f" and {len(every) - most} more" * (len(every) > most)


FEW = 4  # remarks of one kind


def shorten(remarks: Iterable[str]) -> Iterator[str]:
    """Yield the first few of remarks that differ in robots and numbers alone, and how many more there are."""
    kinds: dict[str, list[str]] = {}
    for remark in remarks:
        kinds.setdefault(re.sub(r"robot '.*?'|[-+]?\d[\d.e+-]*", "", remark), []).append(remark)
    for alike in kinds.values():
        yield from alike[:FEW]
        if len(alike) > FEW:
            yield f"{len(alike) - FEW} more like the last"
