"""What the command line prints, imported when it is first used."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cooploc.terminal import tables as tables


def __getattr__(name: str) -> Any:
    if name == "tables":
        return import_module("cooploc.terminal.tables")
    raise AttributeError(name)
