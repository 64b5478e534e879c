"""The files that a plug-in is made of: found without importing them, and imported in their present version."""

import ast
import hashlib
import importlib
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib.machinery import PathFinder
from importlib.metadata import packages_distributions, version
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from cooploc.estimators.errors import BadInput

Named = tuple[str, Path]  # a file, and what it is called in a hash


def helpers_of(file: Path) -> list[Named]:
    """The modules and packages that a Python file imports from its own folder, and those that these import from there.

    Only `import` statements count, wherever they stand. `cooploc` is the one that runs, also in its own source folder.
    """
    found: dict[str, Path] = {}
    waiting = [file]
    while waiting:
        for name in _imported_names(waiting.pop()):
            for path in _modules(file.parent, name):
                key = path.relative_to(file.parent).as_posix()
                if key not in found and path != file:
                    found[key] = path
                    waiting.append(path)
    return sorted(found.items())


def of_module(module: str) -> list[Named]:
    """The files of the package that an installed module is in, or its own."""
    path: str | None = None
    folders: list[str] = []
    parts = module.split(".")
    for i in range(len(parts)):  # the first that is not a namespace, which many packages share
        name = ".".join(parts[: i + 1])
        spec = PathFinder.find_spec(name, folders) if i else find_spec(name)
        if spec is None:
            return []
        folders = list(spec.submodule_search_locations or ())
        path = spec.origin
        if path is not None:
            break
    if folders:
        return [named for folder in folders for named in tree(Path(folder), ".py", ".so", ".pyd")]
    return [(Path(path).name, Path(path))] if path else []


def distributions(files: Iterable[Path]) -> dict[str, str]:
    """The installed distributions that Python files import, with their versions; but for cooploc itself."""
    names = {name for file in files if file.suffix == ".py" for name in _imported_names(file)}
    found = {one for name in names for one in _providers(tuple(sys.path)).get(name, ())}
    return {name: version(name) for name in sorted(found)}


@cache
def _providers(path: tuple[str, ...]) -> dict[str, list[str]]:
    """The distributions of each top-level module on this path; it takes a quarter of a second."""
    return dict(packages_distributions())


def tree(folder: Path, *suffixes: str) -> list[Named]:
    """The files of a folder and of those in it, with their paths from there."""
    files = sorted(file for file in folder.rglob("*") if file.suffix in suffixes)
    return [(file.relative_to(folder.parent).as_posix(), file) for file in files]


def _imported_names(file: Path) -> set[str]:
    """The top-level names that a file imports; none where it is not Python, which its import will say."""
    try:
        parsed = ast.parse(file.read_bytes())
    except (SyntaxError, ValueError):
        return set()
    names = set()
    for node in ast.walk(parsed):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.partition(".")[0])
    return names - sys.stdlib_module_names - {"cooploc"}


def _modules(folder: Path, name: str) -> list[Path]:
    """What a name stands for in a folder: a module, or all of a package; nothing where it is not there."""
    if (folder / name).is_dir():
        return [path for _, path in tree(folder / name, ".py")]
    return [folder / f"{name}.py"] if (folder / f"{name}.py").is_file() else []


# What an estimator's class says of files that it learned, read without importing it.
#
#     artifacts = ("weights.npz",)          # paths from the folder of the class's file
#     trained_on = "nlos, 100 trials"       # what tables say
#
# Both must be written out in the class, as text. The files are hashed with the source, so that other weights are
# another estimator: a run is not continued with them, and its certificate does not hold for them.


class Declared(NamedTuple):
    """What a class declares."""

    name: str  # of the class
    artifacts: tuple[str, ...] = ()
    trained_on: str = ""


def artifacts_of(files: Iterable[Path]) -> list[Named]:
    """The artifacts that the classes of these files name, each once.

    Raises:
        BadInput: one of them is not there, or is not a path from the folder of its file.

    """
    found: dict[Path, str] = {}
    for file in files:
        for one in declarations(file):
            for name in one.artifacts:
                path = file.parent / name
                if Path(name).is_absolute() or not path.is_file():
                    raise BadInput(f"{one.name} of {file} names {name!r} in artifacts, and there is no {path}")
                found[path] = name
    return sorted((name, path) for path, name in found.items())


def trained_on(files: Iterable[Path], name: str) -> str:
    """What the class of this name says that it was trained on; empty where it says nothing."""
    said = [one.trained_on for file in files for one in declarations(file) if one.name == name]
    return plainly(said[0]) if said else ""


def plainly(said: str) -> str:
    """A text in one line that ends no part of a certificate's."""
    return " ".join(said.replace(";", ",").split())


def declarations(file: Path) -> Iterator[Declared]:
    """What each class of a Python file declares; nothing where it is not Python, which its import will say."""
    source = file.read_bytes()
    if not (b"artifacts" in source or b"trained_on" in source):
        return
    try:
        parsed = ast.parse(source)
    except (SyntaxError, ValueError):
        return
    for node in ast.walk(parsed):
        if isinstance(node, ast.ClassDef):
            values = dict(_assigned_literals(node))
            names, said = values.get("artifacts", ()), values.get("trained_on", "")
            if isinstance(names, tuple | list) and isinstance(said, str):
                yield Declared(node.name, tuple(map(str, names)), said)


def _assigned_literals(node: ast.ClassDef) -> Iterator[tuple[str, object]]:
    """The literals that a class assigns, by name."""
    for line in node.body:
        if isinstance(line, ast.Assign | ast.AnnAssign) and line.value is not None:
            targets = line.targets if isinstance(line, ast.Assign) else [line.target]
            for target in targets:
                if isinstance(target, ast.Name) and target.id in ("artifacts", "trained_on"):
                    try:
                        yield target.id, ast.literal_eval(line.value)
                    except ValueError:
                        continue


# Modules beside a plug-in's file: it imports them by name, in their present version.
#
# Python keeps one module of a name. So a neighbour that was edited, or that another folder's plug-in has brought, makes
# way for the one that is meant; where a module of that name comes from elsewhere, the neighbour must be renamed.

_seen: dict[str, tuple[Path, str]] = {}  # module -> its file, and the hash of what was imported


@contextmanager
def importable(file: Path, helpers: list[Named]) -> Iterator[None]:
    """While the block runs, a file's neighbours come before all other modules; afterwards they come after them.

    Raises:
        BadInput: another module has the name of a neighbour.

    """
    folder = str(file.resolve().parent)
    names = {module_name(name): path.resolve() for name, path in helpers}
    outdated = [name for name, path in names.items() if _is_outdated(file, name, path)]
    if outdated:
        for name in names:
            sys.modules.pop(name, None)  # all of them, as one may have imported another
    importlib.invalidate_caches()
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        sys.path.remove(folder)
        _seen.update({name: (path, _hash(path)) for name, path in names.items() if name in sys.modules})


def stay_importable(file: Path) -> None:
    """Neighbours that functions import when they run are found, after all other modules."""
    folder = str(file.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)


def _is_outdated(file: Path, name: str, path: Path) -> bool:
    """Whether the module of that name is another version of a neighbour, or another plug-in's.

    Raises:
        BadInput: it is neither.

    """
    place, now = _place(sys.modules.get(name)), (path, _hash(path))
    if place is None:
        return False
    if place == path:
        return _seen.setdefault(name, now) != now
    if name in _seen and _seen[name][0] == place:
        return True
    raise BadInput(
        f"{file} imports its neighbour {path.name}, but a module {name} is loaded from {place}: rename one of them"
    )


def module_name(name: str) -> str:
    """`pack/deep.py` as Python imports it."""
    return name.removesuffix(".py").replace("/", ".").removesuffix(".__init__")


def _place(module: ModuleType | None) -> Path | None:
    file = getattr(module, "__file__", None)
    return Path(file).resolve() if file else None


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
