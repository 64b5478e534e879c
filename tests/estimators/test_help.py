"""`help(cl.make(name))` says what every parameter means, with its unit, its range or its choices."""

import re
from dataclasses import fields
from pydoc import plain, render_doc
from typing import Literal, get_args, get_origin, get_type_hints

import pytest

import cooploc as cl
from cooploc.estimators import BUILTIN


def described(name, parameter):
    """What help says after `parameter:`, up to the next parameter or an empty line."""
    shown = plain(render_doc(cl.make(name))).partition(") -> None")[2].replace(" |  ", "")  # without the signature
    found = re.search(rf"^ +{parameter}: (.+?)(?=\n +\w+: |\n *\|? *\n)", shown, re.DOTALL | re.MULTILINE)
    return found[1] if found else ""


@pytest.mark.parametrize("name", BUILTIN)
def test_help_names_every_parameter_with_its_unit_its_range_or_its_choices(name):
    cls = type(cl.make(name))
    hints = get_type_hints(cls)
    for parameter in (field.name for field in fields(cls) if field.init and field.name != "uses"):
        told = described(name, parameter)
        assert told, f"{parameter} is not in the docstring of {cls.__name__}"
        if get_origin(hints[parameter]) is Literal:
            assert all(f'"{choice}"' in told for choice in get_args(hints[parameter])), f"{parameter}: {told}"
        elif hints[parameter] is not bool:
            assert re.search(r"\[.+\]|\d|no unit", told), f"{parameter} has neither unit nor range: {told}"
