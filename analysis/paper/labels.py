"""Short labels for a paper: the settings of a configured estimator become a letter, which a legend explains.

"ekf-local[anchor_reading=rssi]" is written "ekf-local [a]", and the legend says "[a] anchor_reading=rssi". Equal
settings have equal letters.
"""

import re
import string
from collections.abc import Callable, Iterable
from typing import NamedTuple

LONGEST = 24  # characters of a name that is written in full


class Labels(NamedTuple):
    """What estimators are called in figures and tables."""

    short: dict[str, str]  # by the estimator's full name
    settings: dict[str, str]  # what a letter stands for

    def legend(self, names: Iterable[str]) -> list[str]:
        """The letters that these estimators' labels have, with what they stand for."""
        used = {re.sub(r".* \[(\w+)\]$", r"\1", self.short[name]) for name in names if self.short[name] != name}
        return [f"[{letter}] {said}" for letter, said in self.settings.items() if letter in used]


def labels(names: Iterable[str]) -> Labels:
    """A short label for each name; one that is short already, without settings, stays as it is."""
    letters: dict[str, str] = {}
    short: dict[str, str] = {}
    for name in dict.fromkeys(names):
        base, bracket, settings = name.partition("[")
        base = base.rpartition("/")[2]  # of an estimator in a file, whose folder says nothing
        if len(base) > LONGEST:
            base, settings = base[: LONGEST - 1] + "…", f"{base}, {settings}" if bracket else f"{base}]"
        if not settings:
            short[name] = base
            continue
        said = settings.removesuffix("]").replace(",", ", ")
        letter = letters.setdefault(said, _letter(len(letters)))
        short[name] = f"{base} [{letter}]"
    return Labels(short, {letter: said for said, letter in letters.items()})


def over_lines(text: str, fits: Callable[[str], bool]) -> list[str]:
    """A scenario's label over as many lines as it takes, parted after commas and strokes and before brackets."""
    lines = [""]
    for piece in text.replace(",", ",\0").replace("/", "/\0").replace("[", "\0[").split("\0"):
        lines = [*lines[:-1], lines[-1] + piece] if fits(lines[-1] + piece) else [*lines, piece]
    return [line for line in lines if line]


def file_name(*words: str) -> str:
    """Words as a name that LaTeX can include: letters, digits and hyphens."""
    return "-".join(re.sub(r"[^A-Za-z0-9]+", "-", word).strip("-") for word in words)[:80]


def _letter(number: int) -> str:
    """a to z, and then a1 to z1, and so on."""
    again, place = divmod(number, 26)
    return string.ascii_lowercase[place] + (str(again) if again else "")
