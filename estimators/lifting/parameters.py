"""The parameters of a plain class or function: what it takes beside what it is always given.

A default may be `cl.tunable(...)`, as in a dataclass: the class gets its default, and `cooploc tune` may change it.
"""

from collections.abc import Callable, Mapping
from dataclasses import Field
from inspect import Parameter, signature
from typing import Any


def parameters(make: Callable[..., Any], given: tuple[str, ...]) -> dict[str, Parameter] | None:
    """Those of a class or function after the arguments that it is always given, by name.

    Returns:
        None: it takes any name (`**rest`), or does not say what it takes.

    Raises:
        TypeError: it cannot be called with what it is given.

    """
    try:
        taken = list(signature(make).parameters.values())
    except ValueError:  # written in C
        return None
    if any(one.kind is one.VAR_KEYWORD for one in taken):
        return None
    placed = [one for one in taken if one.kind in (one.POSITIONAL_ONLY, one.POSITIONAL_OR_KEYWORD)]
    if len(placed) < len(given) and not any(one.kind is one.VAR_POSITIONAL for one in taken):
        has = ", ".join(one.name for one in placed)
        raise TypeError(f"{make.__name__} takes ({has}); it is called with ({', '.join(given)}), then its parameters")
    rest = [*placed[len(given) :], *(one for one in taken if one.kind is one.KEYWORD_ONLY)]
    return {one.name: one for one in rest}


def completed(name: str, known: Mapping[str, Parameter] | None, stated: Mapping[str, Any]) -> dict[str, Any]:
    """Every parameter as stated, else its default.

    Raises:
        TypeError: one that is not known, or one without a default that is not stated.

    """
    if known is None:
        return dict(stated)
    for key in stated:
        if key not in known:
            has = f"it has {', '.join(known)}" if known else "it has none"
            raise TypeError(f"{name} has no parameter {key!r}; {has}")
    missing = [key for key, one in known.items() if one.default is one.empty and key not in stated]
    if missing:
        raise TypeError(f"{name} needs {missing[0]}: give it a default, or state it, {missing[0]}=...")
    return {key: stated.get(key, one.default) for key, one in known.items()}


def value(given: Any) -> Any:
    """What the class gets: the default of a `cl.tunable(...)`, anything else as it is."""
    return given.default if isinstance(given, Field) else given
