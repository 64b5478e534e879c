"""What is inside an object, bit by bit, so that a hidden change shows."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from inspect import isroutine
from typing import Any

import numpy as np


def contents(thing: Any, path: str, above: tuple[int, ...] = ()) -> dict[str, Any]:
    """Everything inside, by path, as values that `==` compares bitwise."""
    if id(thing) in above:
        return {}
    if isinstance(thing, np.ndarray) and not thing.dtype.hasobject:
        return {path: (thing.dtype.str, thing.shape, thing.tobytes())}
    if isinstance(thing, int | float | complex | str | bytes | np.generic | None):
        return {path: repr(thing)}
    inside: dict[str, Any] = {path: type(thing)}
    for name, part in _parts(thing):
        inside |= contents(part, f"{path}{name}", (*above, id(thing)))
    return inside


def _parts(thing: Any) -> list[tuple[str, Any]]:
    if isinstance(thing, np.ndarray):
        return [(f"[{i}]", part) for i, part in enumerate(thing.ravel())]
    if isinstance(thing, np.random.Generator):
        return [(".state", thing.bit_generator.state)]
    if isinstance(thing, tuple) and hasattr(thing, "_fields"):
        return [(f".{name}", getattr(thing, name)) for name in thing._fields]
    if isinstance(thing, Mapping):
        return [(f"[{key!r}]", part) for key, part in thing.items()]
    if isinstance(thing, set | frozenset):
        return [(f"[{i}]", part) for i, part in enumerate(sorted(thing, key=repr))]
    if isinstance(thing, list | tuple):
        return [(f"[{i}]", part) for i, part in enumerate(thing)]
    if is_dataclass(thing) and not isinstance(thing, type):
        return [(f".{f.name}", getattr(thing, f.name)) for f in fields(thing)]
    if isinstance(thing, type) or isroutine(thing):
        return [(" is", str(id(thing)))]
    return [(f".{name}", part) for name, part in sorted(getattr(thing, "__dict__", {}).items())]
