"""The files that a plug-in is made of, and the distributions that it imports, found without importing any of them."""

import ast
import sys
from collections.abc import Iterable
from functools import cache
from importlib.machinery import PathFinder
from importlib.metadata import packages_distributions, version
from importlib.util import find_spec
from pathlib import Path

Named = tuple[str, Path]  # a file, and what it is called in a hash


def helpers_of(file: Path) -> list[Named]:
    """The modules and packages that a Python file imports from its own folder, and those that these import from there.

    Only `import` statements count, wherever they stand. `cooploc` is the one that runs, also in its own source folder.
    """
    found: dict[str, Path] = {}
    waiting = [file]
    while waiting:
        for name in _imported(waiting.pop()):
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
    names = {name for file in files if file.suffix == ".py" for name in _imported(file)}
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


def _imported(file: Path) -> set[str]:
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
