"""How a name becomes an object: the built-in table first, then installed plug-ins; `path.py:Name` is always a file.

Estimators and scenarios have one registry each.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from cooploc.estimators.plugins.errors import BadInput, nearest, one_line
from cooploc.estimators.plugins.python_file import found_in_file, is_file


@dataclass(frozen=True)
class Registry:
    """The names of one kind of thing, and what stands behind each."""

    kind: str  # "estimator" or "scenario", for messages
    group: str  # the entry-point group of plug-ins
    builtin: Mapping[str, Any]  # name -> an entry, which `find` returns as it is

    def names(self) -> list[str]:
        """The built-in names, then those of installed plug-ins."""
        return [*self.builtin, *(name for name in sorted(self._plugins()) if name not in self.builtin)]

    def find(self, name: str) -> Any:
        """The entry of a built-in name, or the object that a plug-in or a file holds.

        Raises:
            BadInput: an unknown name, a name that two plug-ins claim, or an object that cannot be imported.

        """
        if name in self.builtin:
            return self.builtin[name]
        if is_file(name):
            return found_in_file(name)
        point = self._plugin(name)
        return loaded(point.value, f"the plug-in {self.kind} {name!r} ({point.value})")

    def module_of(self, name: str) -> str:
        """The module of an installed plug-in; empty for a built-in name and for a file.

        Raises:
            BadInput: an unknown name, or one that two plug-ins claim.

        """
        return "" if name in self.builtin or is_file(name) else self._plugin(name).module

    def place_of(self, name: str) -> str:
        """`module:Name` of an installed plug-in.

        Raises:
            BadInput: as `module_of`.

        """
        return self._plugin(name).value

    def errors(self, reason: Callable[[str], str]) -> dict[str, str]:
        """The installed plug-ins that cannot be used, each with why; `reason(name)` is empty where one can be used."""
        found = {}
        for name, points in self._plugins().items():
            if name in self.builtin:
                found[name] = f"the name belongs to a built-in {self.kind}, so {points[0].value} is ignored"
            elif why := reason(name):
                found[name] = why
        return found

    def _plugins(self) -> dict[str, list[EntryPoint]]:
        """The entry points of each name; those that lead to the same place, once."""
        found: dict[str, dict[str, EntryPoint]] = {}
        for point in entry_points(group=self.group):
            found.setdefault(point.name, {}).setdefault(point.value, point)
        return {name: list(places.values()) for name, places in found.items()}

    def _plugin(self, name: str) -> EntryPoint:
        points = self._plugins().get(name)
        if points is None:
            raise BadInput(f"there is no {self.kind} {name!r}; {nearest(name, self.names())}")
        if len(points) > 1:
            claims = " and ".join(f"{point.value} of {_package(point)}" for point in points)
            raise BadInput(f"{len(points)} plug-ins are called {self.kind} {name!r}: {claims}; uninstall all but one")
        return points[0]


def loaded(place: str, what: str) -> Any:
    """The object at `module:Name`; `what` names it in the error message.

    Raises:
        BadInput: it cannot be imported; says why.

    """
    module, _, attribute = place.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except MemoryError:  # of the machine, not of the input
        raise
    except (Exception, SystemExit, GeneratorExit) as e:
        raise BadInput(f"{what} cannot be imported: {one_line(e)}") from e


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else "an unknown package"
