"""Entry points of plug-ins by name, where two packages may claim the same one."""

from collections.abc import Iterable
from typing import Any

from cooploc.estimators.plugins.errors import BadInput


def listed_points(points: Iterable[Any]) -> dict[str, list[Any]]:
    """The entry points of each name; those that lead to the same place, once."""
    found: dict[str, dict[str, Any]] = {}
    for point in points:
        found.setdefault(point.name, {}).setdefault(point.value, point)
    return {name: list(places.values()) for name, places in found.items()}


def only_one(what: str, name: str, points: list[Any]) -> Any:
    """The only entry point of a name.

    Raises:
        BadInput: several packages claim the name.

    """
    if len(points) > 1:
        claims = " and ".join(f"{point.value} of {_package(point)}" for point in points)
        raise BadInput(f"{len(points)} plug-ins are called {what} {name!r}: {claims}; uninstall all but one")
    return points[0]


def _package(point: Any) -> str:
    return point.dist.name if point.dist is not None else "an unknown package"
