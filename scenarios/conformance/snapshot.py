"""What is inside an object, bit by bit, so that a hidden change shows."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from inspect import isroutine
from typing import Any

import numpy as np

from cooploc.scenarios.conformance.compare import CheckFailed

Snapshot = dict[str, Any]


def snapshot(thing: Any, path: str, above: tuple[int, ...] = ()) -> Snapshot:
    """Everything inside, by path, as values that `==` compares bitwise.

    Args:
        thing: any object: arrays, containers, dataclasses, generators.
        path: its name, where every path begins.
        above: ids of what it is inside of, so that a cycle ends.

    """
    if id(thing) in above:
        return {}
    if isinstance(thing, np.ndarray) and not thing.dtype.hasobject:
        return {path: (thing.dtype.str, thing.shape, thing.tobytes())}
    if isinstance(thing, int | float | complex | str | bytes | np.generic | None):
        return {path: repr(thing)}
    inside: Snapshot = {path: type(thing)}
    for name, member in _members(thing):
        inside |= snapshot(member, f"{path}{name}", (*above, id(thing)))
    return inside


def require_unchanged(before: Snapshot, after: Snapshot, when: str) -> None:
    """Require two equal snapshots.

    Raises:
        CheckFailed: they differ; names the first path, and `when`: "by predict() at tick 3".

    """
    for path in [*before, *after]:
        if before.get(path) != after.get(path):
            raise CheckFailed(f"{path} was changed {when}")


def _members(thing: Any) -> list[tuple[str, Any]]:
    if isinstance(thing, np.ndarray):
        return [(f"[{i}]", member) for i, member in enumerate(thing.ravel())]
    if isinstance(thing, np.random.Generator):
        return [(".state", thing.bit_generator.state)]
    if isinstance(thing, tuple) and hasattr(thing, "_fields"):  # a NamedTuple
        return [(f".{name}", getattr(thing, name)) for name in thing._fields]
    if isinstance(thing, Mapping):
        return [(f"[{key!r}]", member) for key, member in thing.items()]
    if isinstance(thing, set | frozenset):
        return [(f"[{i}]", member) for i, member in enumerate(sorted(thing, key=repr))]
    if isinstance(thing, list | tuple):
        return [(f"[{i}]", member) for i, member in enumerate(thing)]
    if is_dataclass(thing) and not isinstance(thing, type):
        return [(f".{f.name}", getattr(thing, f.name)) for f in fields(thing)]
    if isinstance(thing, type) or isroutine(thing):
        return [(" is", str(id(thing)))]
    return [(f".{name}", member) for name, member in sorted(getattr(thing, "__dict__", {}).items())]
