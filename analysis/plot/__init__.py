"""The figures of `cl.plot`. Each takes and returns matplotlib Axes; to add one, write a function and name it in `.pyi`.

A figure's file is imported when it is first drawn, so that a study does not wait for what it does not draw.
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

_STUB = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
_HOME = {of.name: node.module for node in _STUB.body if isinstance(node, ast.ImportFrom) for of in node.names}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name] or ""), name)


def __dir__() -> list[str]:
    return [*_HOME]
