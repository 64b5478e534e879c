"""Labels that stand for many: `packet-drop/drop={0,0.5}`, `scalability/n={1..99..2}`, `arl[consistent]`.

Braces sweep a parameter, as in a shell: a list, or first..last or first..last..step, both ends included. A word in
brackets that is not name=value is a variant: overrides to which the study gives a name.
"""

import re
from collections.abc import Mapping
from decimal import Decimal, InvalidOperation

from cooploc.estimators.plugins.errors import BadInput, nearest


def expand(label: str, variants: Mapping[str, str]) -> list[str]:
    """Every label that a swept one stands for, in order; the rightmost braces change fastest.

    Raises:
        BadInput: braces or a range that cannot be read, or a variant that the study does not have.

    """
    before, brace, rest = label.partition("{")
    if not brace:
        if "}" in label:
            raise BadInput(f"cannot read {label!r}: a brace is closed that was not opened")
        return [named(label, variants)]
    inside, brace, after = rest.partition("}")
    if not brace or "{" in inside:
        raise BadInput(f"cannot read {label!r}: write a sweep like drop={{0,0.5}} or n={{1..9..2}}")
    return [each for value in _values(inside, label) for each in expand(f"{before}{value}{after}", variants)]


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
    if by <= 0 or last < first:
        raise BadInput(f"{{{inside}}} in {label!r} holds nothing: it must rise, by a step above 0")
    return [f"{(first + k * by).normalize():f}" for k in range(int((last - first) / by) + 1)]
