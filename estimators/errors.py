"""The error for what a user can fix: an unknown name, a value out of bounds, a malformed file.

Its message is one line that states the fact, the place and the remedy; the command line prints it and exits with 2.
"""

import reprlib
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any


class BadInput(ValueError):
    """A request or an input that is not valid; the message says what, where, and what to do."""


def nearest(name: str, known: list[str]) -> str:
    """The end of an error message: the nearest known name, or all of them."""
    close = get_close_matches(name, known, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"known are {', '.join(known)}" if known else "it has none"


def first_reason(errors: list[Any]) -> str:
    """The first of pydantic's errors as "place: what is wrong, not VALUE"."""
    first: Mapping[str, Any] = errors[0]
    place = ".".join(map(str, first["loc"]))
    value = first.get("input")
    said = f", not {reprlib.repr(value)}" if isinstance(value, bool | int | float | str) else ""
    return f"{place}: {first['msg']}{said}" if place else f"{first['msg']}{said}"


def one_line(e: BaseException) -> str:
    """An exception's type and message on one line."""
    return f"{type(e).__name__}: {message(e)}" if message(e) else type(e).__name__


def message(e: BaseException) -> str:
    """An exception's message on one line, whatever its `__str__` does."""
    try:
        return " ".join(str(e).split())
    except BaseException:
        return "its message cannot be read"


# Limits of parameters, so that a slip of the keyboard is refused at once instead of filling the memory for hours.


def require(owner: Any, **limits: tuple[float, float]) -> None:
    """Refuse parameters outside their limits, both included; nan is outside of any.

    Raises:
        ValueError: names the parameter, its value and the limits.

    """
    for name, (low, high) in limits.items():
        value = getattr(owner, name)
        if not low <= value <= high:
            least, most = f"at least {low:g}", f"at most {high:g}"
            raise ValueError(
                f"{name} is {value}; it must be {least if value < low else most if value > high else 'a number'}"
            )
