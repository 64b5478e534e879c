"""Labels: `mrsl-rssi[particles=500]` is a name and its parameters; commas separate the labels of a list."""

import re

from cooploc.estimators.plugins.errors import BadInput

LABEL = re.compile(r"\s*([^\[\]]*[^\[\]\s])\s*(?:\[([^\[\]]*)\])?\s*")
LONGEST = 2000  # characters


def parse(label: str) -> tuple[str, dict[str, str]]:
    """`mrsl-rssi[particles=500,reading=rssi]` as its name and its parameters.

    Raises:
        BadInput: the label cannot be read.

    """
    if len(label) > LONGEST:
        raise BadInput(f"a label has {len(label)} characters, and at most {LONGEST} are allowed: {label[:40]!r}...")
    if not label.isprintable():
        raise BadInput(f"{label!r} has a character that cannot be printed: write the label without it")
    match = LABEL.fullmatch(label)
    if match is None:
        raise BadInput(f"cannot read {label!r}; write it like mrsl-rssi[particles=500,K=1]")
    parameters = {}
    for item in filter(None, (part.strip() for part in (match[2] or "").split(","))):
        key, equals, value = (part.strip() for part in item.partition("="))
        if not (key and equals and value):
            raise BadInput(f"cannot read {item!r} in {label!r}; write name=value")
        if key in parameters:
            raise BadInput(f"{label!r} gives {key} twice; leave one out")
        parameters[key] = value
    return match[1], parameters


def split(listed: str) -> list[str]:
    """The labels of a comma-separated list; commas inside brackets do not separate."""
    return [part.strip() for part in re.split(r",(?![^\[]*\])", listed) if part.strip()]
