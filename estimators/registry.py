"""How a name becomes an object: the built-in table first, then installed plug-ins; `path.py:Name` is always a file.

Estimators and scenarios have one registry each. A file is imported under a name made from its content and that of its
neighbours: loading it again gives the same classes, and an edited file gives new ones. Paths stay as written, relative
to the directory where the run began, which its workers share. What is sent to another process names the files that it
needs, and these are loaded there first.
"""

import hashlib
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

from cooploc.estimators.errors import BadInput, nearest, one_line
from cooploc.estimators.interface import API, Array
from cooploc.estimators.plugin_files import helpers_of, importable, module_name, plainly, stay_importable

if TYPE_CHECKING:
    from pandas import DataFrame


_loaded: dict[str, tuple[Path, tuple[str, ...]]] = {}  # module -> its file, and the names of its neighbours


def is_file(name: str) -> bool:
    """Return whether a name is `path.py:Name`.

    Raises:
        BadInput: it is a file's path without the name of an object in it.

    """
    if name.endswith(".py"):
        raise BadInput(f"{name} is a file: say which of its names, {name}:Name")
    return name.rpartition(":")[0].endswith(".py")


def found_in_file(name: str) -> Any:
    """The object that `path.py:Name` names.

    Raises:
        BadInput: the file has no such name, or cannot be imported; says why in one line.

    """
    file, _, attribute = name.rpartition(":")
    module = _import_file(Path(file))
    if not hasattr(module, attribute):
        public = {key: one for key, one in vars(module).items() if not key.startswith("_")}
        own = [key for key, one in public.items() if getattr(one, "__module__", "") == module.__name__]
        own += [key for key, one in public.items() if key not in own and type(one).__module__ != "builtins"]
        raise BadInput(f"{file} has no {attribute!r}; {nearest(attribute, own)}")
    return getattr(module, attribute)


def needed_files(sent: bytes) -> dict[str, Path]:
    """The files whose objects a pickle refers to, by the names under which they are imported here."""

    def refers_to(module: str) -> bool:
        return bytes([0x8C, len(module.encode())]) + module.encode() in sent  # as a pickle holds a string

    return {name: path for name, (path, beside) in _loaded.items() if any(map(refers_to, (name, *beside)))}


def load(files: dict[str, Path]) -> None:
    """Load the files that another process said are needed.

    Raises:
        BadInput: one of them cannot be imported, or was edited meanwhile.

    """
    for name, path in files.items():
        if name not in sys.modules and _import_file(path).__name__ != name:
            raise BadInput(f"{path} was edited after an estimator of it was made: make the estimator again")


def _import_file(path: Path) -> ModuleType:
    try:
        source = path.read_bytes()
    except OSError:
        raise BadInput(f"there is no file {path}; write path.py:Name") from None
    digest, helpers = hashlib.sha256(str(path.resolve()).encode() + b"\0" + source), helpers_of(path)
    stay_importable(path)
    for name, file in helpers:
        digest.update(name.encode() + b"\0" + file.read_bytes())
    name = f"_cooploc_{path.stem}_{digest.hexdigest()[:12]}"  # it hides no module, and pickle finds classes by it
    if name in sys.modules:
        return sys.modules[name]
    module = sys.modules[name] = ModuleType(name)
    module.__file__ = str(path.resolve())  # numba and tracebacks look there
    try:
        with importable(path, helpers):
            exec(compile(source, module.__file__, "exec"), vars(module))
    except BaseException as e:
        del sys.modules[name]  # it is half there
        if isinstance(e, BadInput | MemoryError) or not isinstance(e, (Exception, SystemExit, GeneratorExit)):
            raise  # of the machine, of the time limit or of Ctrl-C, not of the file
        remedy = "; install it in this environment, or put it beside the file" * isinstance(e, ModuleNotFoundError)
        raise BadInput(f"{path} cannot be imported: {one_line(e)}{remedy}") from e
    _loaded[name] = path.resolve(), tuple(module_name(one) for one, _ in helpers)
    return module


# The names of estimators, and those of scenarios.


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
        return load_object(point.value, f"the plug-in {self.kind} {name!r} ({point.value})")

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
            packages = [point.dist.name if point.dist is not None else "an unknown package" for point in points]
            claims = " and ".join(f"{point.value} of {one}" for point, one in zip(points, packages, strict=True))
            raise BadInput(f"{len(points)} plug-ins are called {self.kind} {name!r}: {claims}; uninstall all but one")
        return points[0]


def load_object(place: str, what: str) -> Any:
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


# Labels: `mrsl-rssi[particles=500]` is a name and its parameters; commas separate the labels of a list.

LABEL = re.compile(r"\s*([^\[\]]*[^\[\]\s])\s*(?:\[([^\[\]]*)\])?\s*")
LONGEST = 2000  # characters


def parse(label: str) -> tuple[str, dict[str, str]]:
    """`mrsl-rssi[particles=500,reading=rssi]` as its name and its parameters.

    Raises:
        BadInput: the label cannot be read.

    """
    if len(label) > LONGEST:
        raise BadInput(f"a label has {len(label)} characters, and at most {LONGEST} are allowed: {label[:40]!r}...")
    if not label.isprintable():
        raise BadInput(f"{label!r} has a character that cannot be printed: write the label without it")
    match = LABEL.fullmatch(label)
    if match is None:
        raise BadInput(f"cannot read {label!r}; write it like mrsl-rssi[particles=500,K=1]")
    parameters = {}
    for item in filter(None, (part.strip() for part in (match[2] or "").split(","))):
        key, equals, value = (part.strip() for part in item.partition("="))
        if not (key and equals and value):
            raise BadInput(f"cannot read {item!r} in {label!r}; write name=value")
        if key in parameters:
            raise BadInput(f"{label!r} gives {key} twice; leave one out")
        parameters[key] = value
    return match[1], parameters


def split_labels(listed: str) -> list[str]:
    """The labels of a comma-separated list; commas inside brackets do not separate."""
    return [part.strip() for part in re.split(r",(?![^\[]*\])", listed) if part.strip()]


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
    """The optional members of an estimator."""
    bound = bool(getattr(estimator, "bound", False))
    offline = bool(getattr(estimator, "offline", False))
    return Traits(
        team=offline or hasattr(estimator, "exchange"),
        centralised=bound or offline or bool(getattr(estimator, "centralised", False)),
        bound=bound,
        mutable=bool(getattr(estimator, "mutable", False)),
        axes=getattr(estimator, "axes", ""),
        own_motion=getattr(estimator, "own_motion", ""),
        notes=getattr(estimator, "notes", lambda state: {}),
        trained_on=plainly(str(getattr(estimator, "trained_on", "") or "")),
        offline=offline,
    )


def refusal(estimator: Any) -> str:
    """Return the reason why an estimator does not fit this version of the interface; empty where it does."""
    uses = getattr(estimator, "uses", None)
    if reason := wrong_version(estimator):
        return reason
    if not (isinstance(uses, tuple) and all(isinstance(channel, str) for channel in uses)):
        return f"uses is {uses!r}; it must be a tuple of channel names, such as ('odometry', 'anchor_rssi')"
    return ""


def wrong_version(estimator: Any) -> str:
    """Return the reason why an estimator's number does not fit this version of the interface; empty where it does."""
    api = getattr(estimator, "api", None)
    return "" if api == API else f"it is written for interface {api!r}, this is version {API}: set api = {API}"


def source_of(cls: type) -> str:
    """The first paper that the docstring of a class's module names after "Source:", up to its year; else empty."""
    text = re.sub(r"\s+", " ", sys.modules[cls.__module__].__doc__ or "")
    found = re.search(r"Sources?: (.+?\b(?:19|20)\d\d)\b", text)
    return found[1] if found else ""


# Packages that list what they hold when they are called: `cl.estimators()`, `cl.scenarios()`.
#
# Importing a sub-package sets an attribute of its parent, so `cooploc.estimators` is the package and could not stay a
# function of that name. The package itself is callable instead, as Python lets a module change its class.


class CallablePackage(ModuleType):
    """A package whose call returns its `table()`: set `sys.modules[__name__].__class__` to this class."""

    def __call__(self) -> "DataFrame":
        """One row for everything that can be used by name."""
        listed: DataFrame = self.table()
        return listed

    def __reduce__(self) -> tuple[Any, ...]:
        return import_module, (self.__name__,)  # cloudpickle knows plain modules only
