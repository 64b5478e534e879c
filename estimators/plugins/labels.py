"""Labels: `mrsl-rssi[particles=500]` is a name and its parameters; commas separate the labels of a list."""

import re

from cooploc.estimators.plugins.errors import BadInput

LABEL = re.compile(r"\s*([^\[\]]*[^\[\]\s])\s*(?:\[([^\[\]]*)\])?\s*")


def parse(label: str) -> tuple[str, dict[str, str]]:
    """`mrsl-rssi[particles=500,reading=rssi]` as its name and its parameters.

    Raises:
        BadInput: the label cannot be read.

    """
    match = LABEL.fullmatch(label)
    if match is None:
        raise BadInput(f"cannot read {label!r}; write it like mrsl-rssi[particles=500,K=1]")
    parameters = {}
    for item in filter(None, (part.strip() for part in (match[2] or "").split(","))):
        key, equals, value = (part.strip() for part in item.partition("="))
        if not (key and equals and value):
            raise BadInput(f"cannot read {item!r} in {label!r}; write name=value")
        parameters[key] = value
    return match[1], parameters


def split(listed: str) -> list[str]:
    """The labels of a comma-separated list; commas inside brackets do not separate."""
    return [part.strip() for part in re.split(r",(?![^\[]*\])", listed) if part.strip()]
