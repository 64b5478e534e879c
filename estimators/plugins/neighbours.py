"""Modules beside a plug-in's file: it imports them by name, in their present version.

Python keeps one module of a name. So a neighbour that was edited, or that another folder's plug-in has brought, makes
way for the one that is meant; where a module of that name comes from elsewhere, the neighbour must be renamed.
"""

import hashlib
import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from cooploc.estimators.plugins.errors import BadInput
from cooploc.estimators.plugins.sources import Named

_seen: dict[str, tuple[Path, str]] = {}  # module -> its file, and the hash of what was imported


@contextmanager
def importable(file: Path, helpers: list[Named]) -> Iterator[None]:
    """While the block runs, a file's neighbours come before all other modules; afterwards they come after them.

    Raises:
        BadInput: another module has the name of a neighbour.

    """
    folder = str(file.resolve().parent)
    names = {module_name(name): path.resolve() for name, path in helpers}
    outdated = [name for name, path in names.items() if _outdated(file, name, path)]
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


def _outdated(file: Path, name: str, path: Path) -> bool:
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
