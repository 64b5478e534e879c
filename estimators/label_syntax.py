"""Labels: how estimators and scenarios are written with their parameters.

`mrsl-rssi[particles=500]` is a name and its parameters; commas separate the labels of a list. What is in a file may
have a name in front, `mine=path.py:Name[gate=9]`, by which readers see it: `mine[gate=9]`. Braces sweep a parameter, as
in a shell: `mrsl-rssi[particles={50,200}]` stands for two labels, `packet-drop/drop={0..1..0.5}` for three.
"""

import re
from collections.abc import Mapping
from decimal import Decimal
from itertools import product
from math import prod

from cooploc.estimators.errors import BadInput, nearest

LABEL = re.compile(r"\s*([^\[\]]*[^\[\]\s])\s*(?:\[([^\[\]]*)\])?\s*")
GIVEN = re.compile(r"([^/=]*)=(.*\.py(?::.*)?)")
SHOWN = re.compile(r"(?<![\w./=\[,-])([a-z][a-z0-9-]*)=[^\s\[\],=]*\.py:\w+")


def parse(label: str) -> tuple[str, dict[str, str]]:
    """Read `mrsl-rssi[particles=500,reading=rssi]` as its name and its parameters; BadInput where it is none."""
    match = LABEL.fullmatch(label) if isinstance(label, str) else None
    if match is None or not label.isprintable():
        raise BadInput(f"cannot read {label!r}; write it like name[parameter=value,other=value]")
    parameters = {}
    for item in filter(None, (part.strip() for part in (match[2] or "").split(","))):
        key, equals, value = (part.strip() for part in item.partition("="))
        if not (key and equals and value):
            raise BadInput(f"cannot read {item!r} in {label!r}; write name=value{', a single value' * ('{' in label)}")
        if key in parameters:
            raise BadInput(f"{label!r} gives {key} twice; leave one out")
        parameters[key] = value
    given = GIVEN.fullmatch(match[1])
    if given and not re.fullmatch("[a-z][a-z0-9-]*", given[1]):
        raise BadInput(f"{given[1]!r} cannot be a name: write small letters, digits, hyphens, as in mine={given[2]}")
    if not given and (named := re.match("[a-z][a-z0-9-]*=", match[1])):
        raise BadInput(
            f"{label!r}: only what is in a Python file may have a name in front; leave {named[0]} out, and give "
            "parameters a name in a study's [variants]"
        )
    return given[2] if given else match[1], parameters


def write_label(name: str, parameters: Mapping[str, str]) -> str:
    """Return the label that `parse` reads as a name and its parameters."""
    return name + (f"[{','.join(f'{key}={value}' for key, value in parameters.items())}]" if parameters else "")


def drop_folders(label: str) -> str:
    """Return the label of an estimator as a figure shows it: of one in a file, with its last folder alone."""
    method, bracket, parameters = shorten_labels(label).partition("[")
    return "/".join(method.split("/")[-2:]) + bracket + parameters


def shorten_labels(text: str) -> str:
    """Write each `mine=path.py:Name[gate=9]` in a text as readers see it, `mine[gate=9]`."""
    return SHOWN.sub(r"\1", text)


def split_labels(listed: str) -> list[str]:
    """Split a comma-separated list into labels; commas inside brackets do not separate."""
    return [part.strip() for part in re.split(r",(?![^\[]*\])", listed) if part.strip()]


# Sweeps: one label that stands for several.

MOST_LABELS = 10_000  # for which one label, or the scenarios of a block, may stand


def expand(label: str, variants: Mapping[str, str] | None = None) -> list[str]:
    """Return every label that a swept one stands for, in order; the rightmost braces change fastest.

    Where there can be variants they are written out.
    """
    texts, swept = (re.split(r"\{([^{}]*)\}", label)[i::2] for i in (0, 1))
    if any("{" in text or "}" in text for text in texts):
        raise BadInput(f"cannot read the braces of {label!r}: write a sweep like drop={{0,0.5}} or n={{1..9..2}}")
    values = [_swept_values(inside, label) for inside in swept]
    if (count := prod(map(len, values))) > MOST_LABELS:
        raise BadInput(f"{label!r} stands for {count} labels, and at most {MOST_LABELS} are allowed: sweep fewer")
    filled = ("".join(map("".join, zip(texts, (*chosen, ""), strict=True))) for chosen in product(*values))
    return [each if variants is None else write_out_variants(each, variants) for each in filled]


def write_out_variants(label: str, variants: Mapping[str, str]) -> str:
    """Return the label with its variants written out; "ekf-ci [any]", as tables have it, is "ekf-ci[any]"."""
    match = re.fullmatch(r"([^\[\]]*)\[([^\[\]]*)\]", label)
    if match is None:
        return label
    written = [item.strip() for item in match[2].split(",")]
    for item in written:
        if "=" not in item and item not in variants:
            known = nearest(item, list(variants)) if variants else "give it in the study's [variants]"
            raise BadInput(f"{label!r}: {item!r} is neither name=value nor a variant of the study; {known}")
    return f"{match[1].rstrip()}[{','.join(variants.get(item, item) for item in written)}]"


def _swept_values(inside: str, label: str) -> list[str]:
    """Return the values of a list, or of first..last or first..last..step in exact decimals."""
    if ".." not in inside:
        return [value.strip() for value in inside.split(",")]
    try:
        first, last, *step = numbers = [Decimal(part) for part in inside.split("..")]
        (by,) = step or [Decimal(1)]
        if any(abs(number.adjusted()) > 30 for number in numbers if number):
            raise ValueError("out of all bounds")
        steps = (last - first) / by if by > 0 else Decimal(-1)
        fits = 0 <= steps < MOST_LABELS
    except (ArithmeticError, ValueError):
        raise BadInput(f"cannot read {{{inside}}} in {label!r}: write first..last or first..last..step") from None
    if not fits:
        held = f"{max(0, steps + 1):.12g} values, and at most {MOST_LABELS} are allowed"
        raise BadInput(f"{{{inside}}} in {label!r} holds {held}; it must rise, by a step above 0")
    return [f"{(first + k * by).normalize():f}" for k in range(int(steps) + 1)]
