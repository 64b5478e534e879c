"""The same trials in other surroundings: another process, hash seed, directory and date.

An honest estimator gives the same bits there. The files that it reads are noted, and the functions of this package that
it replaced.
"""

import datetime
import hashlib
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from functools import cache
from importlib import import_module
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any, NamedTuple

from cooploc.analysis.execution.played import Given, Played, play
from cooploc.estimators import BUILTIN, make, module_of
from cooploc.estimators.plugins.guard import of_program
from cooploc.estimators.plugins.labels import parse
from cooploc.estimators.plugins.python_file import is_file

LATER = 400 * 86400.0  # [s]
OURS = "cooploc."
_opened: list[set[str]] = []  # an audit hook cannot be removed: it fills the last set, where there is one


class Elsewhere(NamedTuple):
    """What an estimator did in other surroundings."""

    played: list[Played]
    inputs: dict[str, str]  # hash of each file that it opened, by path
    replaced: tuple[str, ...]  # functions of this package that it replaced


def play_elsewhere(one: Given) -> Elsewhere:
    """Play in this process, which must be a fresh one; directory and date are others than those of the run."""
    # A plug-in may replace what measures it, or what a rival does: all of that is imported before.
    import_module("cooploc.analysis.execution.walled")
    for name in BUILTIN:
        make(name)
    before = functions()
    path, known = absolute(one.label), set(sys.modules)
    play(one._replace(label=path, stream=one.stream.first_ticks(2)))  # compiled libraries must load first
    _forget(path, set(sys.modules) - known)
    with tempfile.TemporaryDirectory() as folder, opened_files() as files, another_date():
        with chdir(folder):
            played = play(one._replace(label=path))
        inputs = {name: found for name in sorted(files) if (found := hash_of(name))}
    return Elsewhere(played, inputs, tuple(sorted(replaced(before))))


def _forget(label: str, loaded: set[str]) -> None:
    """Forget an estimator's own modules, so that they are imported again in the other surroundings; libraries stay."""
    package, installed = module_of(parse(label)[0]).partition(".")[0], packages_distributions()
    for name in loaded:
        top, file = name.partition(".")[0], str(getattr(sys.modules[name], "__file__", None) or "")
        library = top in installed or file.startswith((sys.prefix, sys.base_prefix))  # wherever it is installed
        own = top == package or not library
        if own and file.endswith(".py") and not name.startswith(OURS):
            del sys.modules[name]


@contextmanager
def opened_files() -> Iterator[set[str]]:
    """The files that are opened inside the block, without code, libraries and devices."""
    _listen()
    _opened.append(set())
    try:
        yield _opened[-1]
    finally:
        _opened.pop()


def functions() -> dict[str, Any]:
    """The code of every function and method of this package that is imported, by name."""
    found = dict[str, Any]()
    for name, module in list(sys.modules.items()):
        if name.startswith(OURS):
            found |= _codes(name, module)
            for cls in [value for value in vars(module).values() if isinstance(value, type)]:
                found |= _codes(f"{name}.{cls.__name__}", cls) if cls.__module__ == name else {}
    return found


def _codes(where: str, holder: Any) -> dict[str, Any]:
    members = ((name, getattr(member, "__func__", member)) for name, member in vars(holder).items())
    return {f"{where}.{name}": member.__code__ for name, member in members if hasattr(member, "__code__")}


def replaced(before: dict[str, Any]) -> set[str]:
    """The functions whose code has changed since, or that are gone."""
    now = functions()
    return {name for name, code in before.items() if now.get(name) is not code}


@contextmanager
def another_date() -> Iterator[None]:
    """More than a year later, for what asks `time` or `datetime`; timers of the runner are monotonic and go on."""
    real = {name: getattr(time, name) for name in ("time", "time_ns", "localtime", "gmtime")}
    kept = datetime.datetime

    class Later(kept):  # type: ignore[valid-type, misc]
        __slots__ = ()

        @classmethod
        def now(cls, tz: Any = None) -> Any:
            return kept.fromtimestamp(time.time(), tz)

        @classmethod
        def utcnow(cls) -> Any:
            return cls.now(datetime.UTC).replace(tzinfo=None)

        today = now

    shifted: dict[str, Any] = {
        "time": lambda: real["time"]() + LATER,
        "time_ns": lambda: real["time_ns"]() + int(LATER) * 10**9,
        "localtime": lambda at=None: real["localtime"](time.time() if at is None else at),
        "gmtime": lambda at=None: real["gmtime"](time.time() if at is None else at),
    }
    try:
        vars(time).update(shifted)
        datetime.datetime = Later  # type: ignore[misc]
        yield
    finally:
        vars(time).update(real)
        datetime.datetime = kept  # type: ignore[misc]


@cache
def _listen() -> None:
    sys.addaudithook(_note)


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "open" and _opened and isinstance(arguments[0], str | bytes) and not of_program(arguments[0]):
        _opened[-1].add(os.path.abspath(os.fsdecode(arguments[0])))


def hash_of(path: str) -> str:
    """The hash of a file; empty where it is gone, as a temporary file is."""
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError:
        return ""


def absolute(label: str) -> str:
    """A label that means the same in another directory."""
    return str(Path.cwd() / label) if is_file(parse(label)[0]) else label
