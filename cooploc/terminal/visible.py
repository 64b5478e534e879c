"""Text for a terminal: what could move its cursor, change its colours or hide text is shown as what it is."""

import re
import unicodedata

HIDDEN = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}  # Unicode's control, format, surrogate, private, separating
KEPT = {"\n", "\t"}
PLAIN = re.compile(r"[\n\t\x20-\x7e]*")


def visible(text: str) -> str:
    r"""The text with every control character written out, such as \x1b."""
    if PLAIN.fullmatch(text):
        return text
    return "".join(c if c in KEPT or unicodedata.category(c) not in HIDDEN else _written(c) for c in text)


def _written(c: str) -> str:
    return c.encode("unicode_escape").decode("ascii")
