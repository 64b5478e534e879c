"""The files that a plug-in is made of: found without importing them, and imported in their present version."""

import ast
import hashlib
import importlib
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.machinery import PathFinder
from importlib.metadata import packages_distributions, version
from importlib.util import find_spec
from pathlib import Path

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
    """The top-level names that a file imports."""
    parsed, names = _parse(file.read_bytes()), set()
    for node in ast.walk(parsed) if parsed else ():
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.partition(".")[0])
    return names - sys.stdlib_module_names - {"cooploc"}


def _modules(folder: Path, name: str) -> list[Path]:
    """Return the files of a module or package of this name in a folder; nothing where it is not there."""
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


def artifacts_of(files: Iterable[Path]) -> list[Named]:
    """The artifacts that the classes of these files name, each once.

    Raises:
        BadInput: one of them is not there, or is not a path from the folder of its file.

    """
    found: dict[Path, str] = {}
    for file in files:
        for cls, names in _literals(file, "artifacts"):
            for name in map(str, names if isinstance(names, tuple | list) else ()):
                path = file.parent / name
                if Path(name).is_absolute() or not path.is_file():
                    raise BadInput(f"{cls} of {file} names {name!r} in artifacts, and there is no {path}")
                found[path] = name
    return sorted((name, path) for path, name in found.items())


def trained_on(files: Iterable[Path], name: str) -> str:
    """Return the training that the class of this name states; empty where it states none."""
    said = [text for file in files for cls, text in _literals(file, "trained_on") if cls == name]
    return plainly(said[0]) if said and isinstance(said[0], str) else ""


def plainly(said: str) -> str:
    """A text in one line that ends no part of a certificate's."""
    return " ".join(said.replace(";", ",").split())


def _literals(file: Path, attribute: str) -> Iterator[tuple[str, object]]:
    """The classes of a Python file that assign a literal to this attribute, by name, each with its value."""
    source = file.read_bytes()
    parsed = _parse(source) if attribute.encode() in source else None
    for node in ast.walk(parsed) if parsed else ():
        if isinstance(node, ast.ClassDef):
            for line in node.body:
                targets = line.targets if isinstance(line, ast.Assign) else [getattr(line, "target", None)]
                value = getattr(line, "value", None)
                if value and attribute in [target.id for target in targets if isinstance(target, ast.Name)]:
                    with suppress(ValueError):  # no literal
                        yield node.name, ast.literal_eval(value)


def _parse(source: bytes) -> ast.Module | None:
    """None where it is not Python, which its import will say."""
    try:
        return ast.parse(source)
    except (SyntaxError, ValueError):
        return None


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
    folder, outdated = str(file.resolve().parent), False
    now = {module_name(name): (path.resolve(), _hash(path)) for name, path in helpers}
    for name, (path, digest) in now.items():
        loaded = getattr(sys.modules.get(name), "__file__", None)
        place = Path(loaded).resolve() if loaded else None
        if place == path:
            outdated |= _seen.setdefault(name, (path, digest)) != (path, digest)
        elif place is not None:
            outdated = True
            if name not in _seen or _seen[name][0] != place:
                raise BadInput(
                    f"{file} imports its neighbour {path.name}, but a module {name} is loaded from {place}: rename one "
                    "of them"
                )
    if outdated:
        for name in now:
            sys.modules.pop(name, None)  # all of them, as one may have imported another
    importlib.invalidate_caches()
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        sys.path.remove(folder)
        _seen.update({name: one for name, one in now.items() if name in sys.modules})


def stay_importable(file: Path) -> None:
    """Neighbours that functions import when they run are found, after all other modules."""
    folder = str(file.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)


def module_name(name: str) -> str:
    """`pack/deep.py` as Python imports it."""
    return name.removesuffix(".py").replace("/", ".").removesuffix(".__init__")


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
