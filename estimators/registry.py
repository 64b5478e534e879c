"""Names of estimators and scenarios, and the objects behind them.

A name is looked up in the built-in table first, then among installed plug-ins; `path.py:Name` is always a file. Here
are, too, the optional members of an estimator.
"""

import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import Field, dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

from cooploc.estimators.errors import BadInput, nearest, one_line
from cooploc.estimators.interface import API, Array
from cooploc.estimators.plugin_files import cited_in, is_file, load_from_file, one_clause

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True)
class Registry:
    """The names of one kind of thing, and what stands behind each."""

    kind: str  # "estimator" or "scenario", for messages
    group: str  # the entry-point group of plug-ins
    builtin: Mapping[str, Any]  # name -> an entry, which `find` returns as it is

    def names(self) -> list[str]:
        """Return the built-in names, then those of installed plug-ins."""
        return [*self.builtin, *(name for name in sorted(self._plugins()) if name not in self.builtin)]

    def has(self, name: str) -> bool:
        """Return whether a name is built in or that of an installed plug-in, which takes longer to find out."""
        return name in self.builtin or name in self._plugins()

    def find(self, name: str) -> Any:
        """Return the entry of a built-in name, or the object of a plug-in or a file; BadInput where there is none."""
        if name in self.builtin:
            return self.builtin[name]
        if is_file(name):
            return load_from_file(name)
        place = self.place_of(name)
        return load_object(place, f"the plug-in {self.kind} {name!r} ({place})")

    def module_of(self, name: str) -> str:
        """Return the module of an installed plug-in; empty for a built-in name and for a file."""
        return "" if name in self.builtin or is_file(name) else self.place_of(name).partition(":")[0]

    def place_of(self, name: str) -> str:
        """Return `module:Name` of an installed plug-in; BadInput where there is none, or two."""
        points = self._plugins().get(name)
        if points is None:
            raise BadInput(f"there is no {self.kind} {name!r}; {nearest(name, self.names())}")
        if len(points) > 1:
            both = " and ".join(f"{p.value} of {p.dist.name if p.dist else 'an unknown package'}" for p in points)
            raise BadInput(f"{len(points)} plug-ins are called {self.kind} {name!r}: {both}; uninstall all but one")
        return points[0].value

    def errors(self, reason: Callable[[str], str]) -> dict[str, str]:
        """Return the installed plug-ins that cannot be used, with why; `reason(name)` is empty for one that can."""
        found = {}
        for name, points in self._plugins().items():
            if name in self.builtin:
                found[name] = f"the name belongs to a built-in {self.kind}, so {points[0].value} is ignored"
            elif why := reason(name):
                found[name] = why
        return found

    def _plugins(self) -> dict[str, list[EntryPoint]]:
        """Return the entry points of each name; those that lead to the same place, once."""
        found: dict[str, dict[str, EntryPoint]] = {}
        for point in entry_points(group=self.group):
            found.setdefault(point.name, {}).setdefault(point.value, point)
        return {name: list(places.values()) for name, places in found.items()}


def load_object(place: str, what: str) -> Any:
    """Return the object at `module:Name`; BadInput says why `what` cannot be imported."""
    module, _, attribute = place.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except MemoryError:  # of the machine, not of the input
        raise
    except (Exception, SystemExit, GeneratorExit) as e:
        raise BadInput(f"{what} cannot be imported: {one_line(e)}") from e


# What an estimator says of itself beyond the methods that every estimator has; all of it is optional.


class Traits(NamedTuple):
    """The optional members of an estimator, with their defaults filled in."""

    team: bool  # it holds the whole team: it has `exchange`, and neither `send` nor `fuse`; or it is offline
    centralised: bool  # `centralised`, `bound` or `offline`: every reading reaches one computer
    bound: bool  # `bound`: of the centralised ones, one that uses all readings as well as any estimator could
    mutable: bool  # `mutable`: its state changes in place
    axes: str  # `axes`: why its estimates do not turn with the world; empty where they do
    own_motion: str  # `own_motion`: why it does not move as dead reckoning does; empty where it does
    notes: Callable[[Any], Mapping[str, Array]]  # `notes(state)`: what it counted, by name; empty by default
    trained_on: str  # `trained_on`: what its artifacts were learned from; empty where it learned nothing
    offline: bool  # `offline`: it has `smooth`, and is given all readings of all ticks at once, as no robot could be


def traits(estimator: Any) -> Traits:
    """Return the optional members of an estimator."""
    flags = {name: bool(getattr(estimator, name, False)) for name in ("bound", "offline", "mutable")}
    return Traits(
        **flags,
        team=flags["offline"] or hasattr(estimator, "exchange"),
        centralised=flags["bound"] or flags["offline"] or bool(getattr(estimator, "centralised", False)),
        axes=getattr(estimator, "axes", ""),
        own_motion=getattr(estimator, "own_motion", ""),
        notes=getattr(estimator, "notes", lambda state: {}),
        trained_on=one_clause(str(getattr(estimator, "trained_on", "") or "")),
    )


def refusal(estimator: Any) -> str:
    """Return the reason why an estimator does not fit this version of the interface; empty where it does."""
    uses, api, cls = getattr(estimator, "uses", None), getattr(estimator, "api", None), type(estimator).__name__
    if any(isinstance(value, Field) for value in vars(type(estimator)).values()):
        return f"{cls} declares parameters, which it does not get: write @dataclass(frozen=True) above the class"
    if api != API:
        return f"it is written for interface {api!r}, this is version {API}: set api = {API}"
    if isinstance(uses, tuple | list) and all(isinstance(channel, str) for channel in uses):
        return ""
    return (
        f"uses is {uses!r}: make it a tuple of channel names, such as ('odometry', 'anchor_rssi'), of one ('odometry',)"
    )


def source_of(cls: type) -> str:
    """Return the first paper that the docstring of a class's module names after "Source:", up to its year."""
    return cited_in(sys.modules[cls.__module__].__doc__)


class CallablePackage(ModuleType):
    """A package that can be called, as `cl.list_estimators()` was once called `cl.estimators()`; for this version."""

    def __call__(self) -> "DataFrame":
        """Return the table of names that can be used."""
        name = f"list_{self.__name__.rpartition('.')[2]}"
        warnings.warn(f"cl.{name.removeprefix('list_')}() is called cl.{name}() now", FutureWarning, stacklevel=2)
        listed: DataFrame = getattr(import_module("cooploc"), name)()
        return listed

    def __reduce__(self) -> tuple[Any, ...]:
        return import_module, (self.__name__,)  # cloudpickle knows plain modules only
