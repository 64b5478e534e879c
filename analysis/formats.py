"""Functions that write numbers, one for each kind, in every table, sentence and figure; and lists of words and lines.

What is absent (nan) is written as nothing, and no number is shown as minus zero.
"""

import math
from collections.abc import Callable, Iterable, Mapping

Format = Callable[[float], str]


def decimals(value: float, digits: int) -> str:
    """Return a number with so many decimals; large numbers get fewer, so that none has more than four digits or so."""
    if math.isnan(value):
        return ""
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    if abs(value) >= 1e5:
        return f"{value:.2g}"
    digits = min(digits, max(0, 4 - len(f"{abs(value):.0f}"))) if abs(value) >= 10 else digits
    return f"{round(value, digits) + 0.0:.{digits}f}"


def metres(value: float) -> str:
    """Return a length or an RMSE, to the millimetre."""
    return decimals(value, 3)


def ratio(value: float) -> str:
    """Return an ANEES, messages per tick, and other numbers that are near one."""
    return decimals(value, 2)


def count(value: float) -> str:
    """Return a whole number, or a mean of whole numbers to the nearest one: trials, bytes."""
    return decimals(value, 0)


def microseconds(seconds: float) -> str:
    """Return a time given in seconds, in µs."""
    return decimals(1e6 * seconds, 0)


def percent(share: float, digits: int | None = None, sign: bool = False) -> str:
    """Return a share as a percentage; without `digits`, with two significant ones, also where it is nearly 100 %."""
    if not math.isfinite(share):
        return decimals(share, 0)
    if digits is None:
        size = abs(share)
        if 0.99 <= size < 1 - 5e-7:
            digits = min(4, 1 - math.floor(math.log10(100 * (1 - size))))
        else:
            digits = 0 if size >= 0.1 or size == 0 else 1 if size >= 0.01 else 2
    rounded = round(100 * share, digits) + 0.0
    return f"{rounded:{'+' if sign and rounded else ''}.{digits}f} %"


def change(share: float) -> str:
    """Return a relative change, with its sign."""
    return percent(share, sign=True)


def p_value(p: float) -> str:
    """Return a p-value; small ones as a bound."""
    return "<0.001" if p < 0.001 else decimals(p, 3)


def interval(form: Format) -> Callable[[float, float], str]:
    """Return a function that writes both ends of an interval with `form`; nothing where one is absent."""

    def write_ends(low: float, high: float) -> str:
        return "" if math.isnan(low) or math.isnan(high) else f"{form(low)} to {form(high)}"

    return write_ends


def duration(seconds: float) -> str:
    """Return a duration: "40 s", "12 min", "1.5 h"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def join_words(names: Iterable[str]) -> str:
    """Return names in a sentence: "a, b and c"."""
    *most, last = list(names) or [""]
    return f"{', '.join(most)} and {last}" if most else last


def lines_about(lines: Mapping[str, Iterable[str]]) -> list[str]:
    """Return the lines about each of several things, and those about many once: "a, b: one trial"."""
    subjects: dict[str, list[str]] = {}
    for subject, line in ((subject, line) for subject, some in lines.items() for line in some):
        subjects.setdefault(line, []).append(subject)
    return [f"{', '.join(of)}: {line}" for line, of in subjects.items()]
