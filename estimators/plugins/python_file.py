"""Estimators and scenarios in a single Python file, named `path.py:Name`, so that nothing has to be installed.

A file is imported under a name made from its content and that of its neighbours: loading it again gives the same
classes, and an edited file gives new ones. Paths stay as written, relative to the directory where the run began, which
its workers share. What is sent to another process names the files that it needs, and these are loaded there first.
"""

import ast
import hashlib
import sys
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

from cooploc.estimators.plugins.errors import BadInput, nearest, one_line
from cooploc.estimators.plugins.neighbours import importable, module_name, stay_importable
from cooploc.estimators.plugins.sources import Named, helpers_of

_loaded: dict[str, tuple[Path, tuple[str, ...]]] = {}  # module -> its file, and the names of its neighbours


def is_file(name: str) -> bool:
    """Whether a name is `path.py:Name`.

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
    module = _imported(Path(file))
    if not hasattr(module, attribute):
        raise BadInput(f"{file} has no {attribute!r}; {nearest(attribute, _own(module, Path(file).read_bytes()))}")
    return getattr(module, attribute)


def _own(module: ModuleType, source: bytes) -> list[str]:
    """The public classes, functions and objects that a file defines: neither what it imports, nor plain constants."""
    names = []
    for node in ast.parse(source).body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            names.append(node.name)
        elif isinstance(node, ast.Assign):
            targets = [target.id for target in node.targets if isinstance(target, ast.Name)]
            names += [name for name in targets if type(getattr(module, name, None)).__module__ != "builtins"]
    return [name for name in names if not name.startswith("_")]


def needed(sent: bytes) -> dict[str, Path]:
    """The files whose objects a pickle refers to, by the names under which they are imported here."""
    return {
        name: path
        for name, (path, beside) in _loaded.items()
        if any(_as_pickled(one) in sent for one in (name, *beside))
    }


def load(files: dict[str, Path]) -> None:
    """Load the files that another process said are needed.

    Raises:
        BadInput: one of them cannot be imported, or was edited meanwhile.

    """
    for name, path in files.items():
        if name not in sys.modules and _imported(path).__name__ != name:
            raise BadInput(f"{path} was edited after an estimator of it was made: make the estimator again")


def _as_pickled(name: str) -> bytes:
    """A string as a pickle holds it, with its length."""
    return bytes([0x8C, len(name.encode())]) + name.encode()


def _imported(path: Path) -> ModuleType:
    try:
        source = path.read_bytes()
    except OSError:
        raise BadInput(f"there is no file {path}; write path.py:Name") from None
    helpers = helpers_of(path)
    stay_importable(path)
    name = _name(path, source, helpers)
    if name in sys.modules:
        return sys.modules[name]
    spec = spec_from_loader(name, loader=None, origin=str(path))
    if spec is None:
        raise BadInput(f"{path} cannot be imported: it is not a Python file")
    module = module_from_spec(spec)
    module.__file__ = str(path.resolve())  # numba and tracebacks look there
    sys.modules[name] = module
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


def _name(path: Path, source: bytes, helpers: list[Named]) -> str:
    """A name that hides no module, by which pickle finds its classes; another one for every version."""
    digest = hashlib.sha256(str(path.resolve()).encode() + b"\0" + source)
    for name, file in helpers:
        digest.update(name.encode() + b"\0" + file.read_bytes())
    return f"_cooploc_{path.stem}_{digest.hexdigest()[:12]}"
