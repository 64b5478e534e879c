"""Packages that list what they hold when they are called: `cl.estimators()`, `cl.scenarios()`.

Importing a sub-package sets an attribute of its parent, so `cooploc.estimators` is the package and could not stay a
function of that name, whatever was imported first. The package itself is callable instead: Python lets a module change
its class ("Customizing module attribute access" in the language reference), and the new class adds `__call__`.
"""

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pandas import DataFrame


class CallablePackage(ModuleType):
    """A package whose call returns its `table()`: set `sys.modules[__name__].__class__` to this class."""

    def __call__(self) -> "DataFrame":
        """One row for everything that can be used by name."""
        listed: DataFrame = self.table()
        return listed

    def __reduce__(self) -> tuple[Any, ...]:
        return import_module, (self.__name__,)  # cloudpickle knows plain modules only
