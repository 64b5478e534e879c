"""Labels that stand for many: `packet-drop/drop={0,0.5}`, `scalability/n={1..99..2}`, `arl[consistent]`.

Braces sweep a parameter, as in a shell: a list, or first..last or first..last..step, both ends included. A word in
brackets that is not name=value is a variant: overrides to which the study gives a name.
"""

import re
from collections.abc import Mapping
from decimal import Decimal, InvalidOperation
from itertools import product
from math import prod

from cooploc.estimators.plugins.errors import BadInput, nearest

MOST_LABELS = 10_000  # for which one label may stand
LARGEST = 30  # powers of ten of a number in a range


def expand(label: str, variants: Mapping[str, str]) -> list[str]:
    """Every label that a swept one stands for, in order; the rightmost braces change fastest.

    Raises:
        BadInput: braces or a range that cannot be read, that stand for too many labels, or a variant that the study
            does not have.

    """
    texts, swept = (re.split(r"\{([^{}]*)\}", label)[i::2] for i in (0, 1))
    if any("{" in text for text in texts):
        raise BadInput(f"cannot read {label!r}: write a sweep like drop={{0,0.5}} or n={{1..9..2}}")
    if any("}" in text for text in texts):
        raise BadInput(f"cannot read {label!r}: a brace is closed that was not opened")
    values = [_values(inside, label) for inside in swept]
    if (count := prod(map(len, values))) > MOST_LABELS:
        raise BadInput(f"{label!r} stands for {count} labels, and at most {MOST_LABELS} are allowed: sweep fewer")
    filled = ("".join(map("".join, zip(texts, (*chosen, ""), strict=True))) for chosen in product(*values))
    return [named(each, variants) for each in filled]


def named(label: str, variants: Mapping[str, str]) -> str:
    """The label with its variants written out.

    Raises:
        BadInput: the study has no variant of that name.

    """
    match = re.fullmatch(r"([^\[\]]*)\[([^\[\]]*)\]", label)
    if match is None:
        return label
    written = [_meant(item.strip(), label, variants) for item in match[2].split(",")]
    return f"{match[1]}[{','.join(written)}]"


def _meant(item: str, label: str, variants: Mapping[str, str]) -> str:
    if "=" in item:
        return item
    if item not in variants:
        known = nearest(item, list(variants)) if variants else "give it in the study's [variants]"
        raise BadInput(f"{label!r}: {item!r} is neither name=value nor a variant of the study; {known}")
    return variants[item]


def _values(inside: str, label: str) -> list[str]:
    if ".." not in inside:
        return [value.strip() for value in inside.split(",")]
    try:
        first, last, *step = (Decimal(part) for part in inside.split(".."))
        (by,) = step or [Decimal(1)]
    except (InvalidOperation, ValueError):
        raise BadInput(f"cannot read {{{inside}}} in {label!r}: write first..last or first..last..step") from None
    for number in (first, last, by):
        if not number.is_finite() or abs(number.adjusted()) > LARGEST:
            raise BadInput(f"{{{inside}}} in {label!r}: {number} must be a number from 1e-{LARGEST} to 1e{LARGEST}")
    if by <= 0 or last < first:
        raise BadInput(f"{{{inside}}} in {label!r} holds nothing: it must rise, by a step above 0")
    if (last - first) / by >= MOST_LABELS:
        count = f"{(last - first) / by + 1:.0f}" if last / by < 10**12 else f"about {(last - first) / by:.0e}"
        raise BadInput(f"{{{inside}}} in {label!r} holds {count} values, and at most {MOST_LABELS} are allowed")
    return [f"{(first + k * by).normalize():f}" for k in range(int((last - first) / by) + 1)]
