"""Plug-ins in Python files: how `path.py:Name` becomes an object, and which files a plug-in is made of.

A file is imported under a name made from its content and that of its neighbours, the modules in its folder that it
imports: loading it again gives the same classes, and an edited file gives new ones.
"""

import ast
import hashlib
import importlib
import os
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from importlib.machinery import PathFinder
from importlib.metadata import packages_distributions, version
from importlib.util import cache_from_source, find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from cooploc.estimators.errors import BadInput, nearest, one_line

Named = tuple[str, Path]  # a file, and what it is called in a hash
_loaded: dict[str, tuple[Path, tuple[str, ...]]] = {}  # module -> its file, and the names of its neighbours
_neighbours: dict[str, tuple[Path, bytes]] = {}  # module -> its file, and what it held when it was imported


def is_file(name: str) -> bool:
    """Return whether a name is `path.py:Name`; BadInput where it is a file's path alone."""
    if name.endswith(".py"):
        raise BadInput(f"{name} is a file: say which of its names, {name}:Name")
    return name.rpartition(":")[0].endswith(".py")


def load_from_file(name: str) -> Any:
    """Return the object that `path.py:Name` names; BadInput says why there is none, or why the file is not imported."""
    file, _, attribute = name.rpartition(":")
    module = _import_file(Path(file))
    if not hasattr(module, attribute):
        public = {key: one for key, one in vars(module).items() if not key.startswith("_")}
        own = [key for key, one in public.items() if getattr(one, "__module__", "") == module.__name__]
        own += [key for key, one in public.items() if key not in own and type(one).__module__ != "builtins"]
        raise BadInput(f"{file} has no {attribute!r}; {nearest(attribute, own)}")
    return getattr(module, attribute)


def needed_files(sent: bytes) -> dict[str, Path]:
    """Return the files whose objects a pickle refers to, by the names under which they are imported here."""
    needed = {}
    for name, (path, beside) in _loaded.items():
        encoded = [module.encode() for module in (name, *beside)]
        if any(bytes([0x8C, len(module)]) + module in sent for module in encoded):  # as a pickle holds a string
            needed[name] = path
    return needed


def load(files: dict[str, Path]) -> None:
    """Load the files that another process said are needed; BadInput where one is broken, or was edited meanwhile."""
    for name, path in files.items():
        if name not in sys.modules and _import_file(path).__name__ != name:
            raise BadInput(f"{path} was edited after an estimator of it was made: make the estimator again")


def _import_file(path: Path) -> ModuleType:
    try:
        source = path.read_bytes()
    except OSError:
        raise BadInput(f"there is no file {path}; write path.py:Name, its path from this directory") from None
    digest, helpers = hashlib.sha256(os.fsencode(path.resolve()) + b"\0" + source), neighbours_of(path)
    for name, file in helpers:
        digest.update(name.encode() + b"\0" + file.read_bytes())
    name = f"_cooploc_{path.stem}_{digest.hexdigest()[:12]}"  # it hides no module, and pickle finds classes by it
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)  # for neighbours that functions import when they run
    if name in sys.modules:
        return sys.modules[name]
    module = sys.modules[name] = ModuleType(name)
    module.__file__ = str(path.resolve())  # numba and tracebacks look there
    try:
        with _neighbours_first(path, helpers):
            exec(compile(source, module.__file__, "exec"), vars(module))
    except BaseException as e:
        del sys.modules[name]  # it is half there
        if isinstance(e, BadInput | MemoryError) or not isinstance(e, (Exception, SystemExit, GeneratorExit)):
            raise  # of the machine, of the time limit or of Ctrl-C, not of the file
        remedy = "; install it in this environment, or put it beside the file" * isinstance(e, ModuleNotFoundError)
        raise BadInput(f"{path} cannot be imported: {one_line(e)}{remedy}") from e
    _loaded[name] = path.resolve(), tuple(_module_name(one) for one, _ in helpers)
    return module


@contextmanager
def _neighbours_first(file: Path, helpers: list[Named]) -> Iterator[None]:
    """Let a file's neighbours come before all other modules while the block runs, in their present version.

    Python keeps one module of a name: one that was edited, or that another folder's plug-in has brought, makes way.
    """
    now = {_module_name(name): (path.resolve(), path.read_bytes()) for name, path in helpers}
    loaded = {name: getattr(sys.modules[name], "__file__", None) for name in now if name in sys.modules}
    for name, place in loaded.items():
        if place and Path(place).resolve() != now[name][0] and name not in _neighbours:
            beside = now[name][0].name
            raise BadInput(
                f"{file} imports its neighbour {beside}, but a module {name} is loaded from {place}: rename one of them"
            )
    if any(_neighbours.get(name, now[name]) != now[name] for name in loaded):
        for name in loaded:
            del sys.modules[name]  # all of them, as one may have imported another
    importlib.invalidate_caches()
    sys.path.insert(0, str(file.resolve().parent))
    for path, _ in now.values():  # Python knows what it compiled by second and size, which an edited file may share
        with suppress(OSError):
            Path(cache_from_source(str(path))).unlink(missing_ok=True)
    try:
        yield
    finally:
        sys.path.pop(0)
        _neighbours.update({name: one for name, one in now.items() if name in sys.modules})


def _module_name(name: str) -> str:
    """Return `pack/deep.py` as Python imports it."""
    return name.removesuffix(".py").replace("/", ".").removesuffix(".__init__")


# The files of a plug-in, found without importing them.


def neighbours_of(file: Path) -> list[Named]:
    """Return the modules that a Python file imports from its own folder, and those that these import from there."""
    found: dict[str, Path] = {}
    waiting, folder = [file], file.parent
    while waiting:
        for name in _imported_names(waiting.pop()):
            package = [path for _, path in tree(folder / name, ".py")] if (folder / name).is_dir() else []
            for path in package or [folder / f"{name}.py"]:
                key = path.relative_to(folder).as_posix()
                if key not in found and path != file and path.is_file():
                    found[key] = path
                    waiting.append(path)
    return sorted(found.items())


def files_of_module(module: str) -> list[Named]:
    """Return the files of the package that an installed module is in, or its own."""
    path: str | None = None
    folders: list[str] = []
    parts = module.split(".")
    for i in range(len(parts)):  # the first that is not a namespace, which many packages share
        name = ".".join(parts[: i + 1])
        spec = PathFinder.find_spec(name, folders) if i else find_spec(name)
        if spec is None:
            return []
        folders, path = list(spec.submodule_search_locations or ()), spec.origin
        if path is not None:
            break
    if folders:
        return [named for folder in folders for named in tree(Path(folder), ".py", ".so", ".pyd")]
    return [(Path(path).name, Path(path))] if path else []


def distributions(files: Iterable[Path]) -> dict[str, str]:
    """Return the installed distributions that Python files import, with their versions; but for cooploc itself."""
    names = {name for file in files if file.suffix == ".py" for name in _imported_names(file)}
    found = {one for name in names for one in _providers(tuple(sys.path)).get(name, ())}
    return {name: version(name) for name in sorted(found)}


@cache
def _providers(path: tuple[str, ...]) -> dict[str, list[str]]:
    """Return the distributions of each top-level module on this path; it takes a quarter of a second."""
    return dict(packages_distributions())


def tree(folder: Path, *suffixes: str) -> list[Named]:
    """Return the files of a folder and of those in it, with their paths from there."""
    files = sorted(file for file in folder.rglob("*") if file.suffix in suffixes)
    return [(file.relative_to(folder.parent).as_posix(), file) for file in files]


def _imported_names(file: Path) -> set[str]:
    """Return the top-level names that a file imports."""
    names = set()
    for node in _nodes(file):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.partition(".")[0])
    return names - sys.stdlib_module_names - {"cooploc"}


def artifacts_of(files: Iterable[Path]) -> list[Named]:
    """Return the files that classes name in `artifacts = ("weights.npz",)`, each once; BadInput where one is not."""
    found: dict[Path, str] = {}
    for file in files:
        for cls, names in _literals(file, "artifacts"):
            for name in map(str, names if isinstance(names, tuple | list) else ()):
                path = file.parent / name
                if Path(name).is_absolute() or not path.is_file():
                    raise BadInput(f"{cls} of {file} names {name!r} in artifacts, and there is no {path}")
                found[path] = name
    return sorted((name, path) for path, name in found.items())


def statements(files: Sequence[Path], name: str) -> dict[str, str]:
    """Return what Python files state, each empty where none does, and none of them is imported.

    `licence`: after SPDX-License-Identifier, such as MIT. `cites`: the paper that a module's docstring names after
    "Source:". `trained_on`: what the class of this name assigns to it, such as "nlos, 100 trials".
    """
    licences = (re.search(rb"SPDX-License-Identifier:\s*([\w.+-]+)", file.read_bytes()) for file in files)
    trained = [text for file in files for cls, text in _literals(file, "trained_on") if cls == name]
    modules = (node for file in files for node in _nodes(file) if isinstance(node, ast.Module))
    return {
        "licence": next((found[1].decode() for found in licences if found), ""),
        "cites": next(filter(None, (cited_in(ast.get_docstring(module)) for module in modules)), ""),
        "trained_on": one_clause(trained[0]) if trained and isinstance(trained[0], str) else "",
    }


def cited_in(docstring: str | None) -> str:
    """Return the first paper that a docstring names after "Source:", up to its year; empty where it names none."""
    found = re.search(r"Sources?: (.+?\b(?:19|20)\d\d)\b", re.sub(r"\s+", " ", docstring or ""))
    return found[1] if found else ""


def one_clause(text: str) -> str:
    """Return a text in one line that ends no part of a certificate's."""
    return " ".join(text.replace(";", ",").split())


def _literals(file: Path, attribute: str) -> Iterator[tuple[str, object]]:
    """Yield the classes of a Python file that assign a literal to this attribute, by name, each with its value."""
    for node in _nodes(file):
        for line in node.body if isinstance(node, ast.ClassDef) else ():
            targets = line.targets if isinstance(line, ast.Assign) else [getattr(line, "target", None)]
            value = getattr(line, "value", None)
            if value and attribute in [target.id for target in targets if isinstance(target, ast.Name)]:
                with suppress(ValueError):  # no literal
                    yield node.name, ast.literal_eval(value)  # type: ignore[attr-defined]


def _nodes(file: Path) -> Iterable[ast.AST]:
    """Return the nodes of a file's syntax tree; none where it is not Python, which its import will say."""
    try:
        return ast.walk(ast.parse(file.read_bytes()))
    except (SyntaxError, ValueError):
        return ()
