"""What an estimator's class says of files that it learned, read without importing it.

    artifacts = ("weights.npz",)          # paths from the folder of the class's file
    trained_on = "nlos, 100 trials"       # what tables say

Both must be written out in the class, as text. The files are hashed with the source, so that other weights are another
estimator: a run is not continued with them, and its certificate does not hold for them.
"""

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from cooploc.estimators.plugins.errors import BadInput
from cooploc.estimators.plugins.sources import Named


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
        for one in declared(file):
            for name in one.artifacts:
                path = file.parent / name
                if Path(name).is_absolute() or not path.is_file():
                    raise BadInput(f"{one.name} of {file} names {name!r} in artifacts, and there is no {path}")
                found[path] = name
    return sorted((name, path) for path, name in found.items())


def trained_on(files: Iterable[Path], name: str) -> str:
    """What the class of this name says that it was trained on; empty where it says nothing."""
    said = [one.trained_on for file in files for one in declared(file) if one.name == name]
    return plainly(said[0]) if said else ""


def plainly(said: str) -> str:
    """A text in one line that ends no part of a certificate's."""
    return " ".join(said.replace(";", ",").split())


def declared(file: Path) -> Iterator[Declared]:
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
            values = dict(_assigned(node))
            names, said = values.get("artifacts", ()), values.get("trained_on", "")
            if isinstance(names, tuple | list) and isinstance(said, str):
                yield Declared(node.name, tuple(map(str, names)), said)


def _assigned(node: ast.ClassDef) -> Iterator[tuple[str, object]]:
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
