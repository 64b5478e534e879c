"""cooploc compares estimators for multi-robot cooperative localization fairly.

    import cooploc as cl
    truth, stream = cl.simulate("packet-drop/drop=0.7", trials=20, seed=1)
    run = cl.run(["arl", "mrsl-rssi[particles=500]"], stream)
    errors = cl.errors(truth, run)
    cl.compare(errors, baseline="arl")
    cl.plot.rmse(errors)

`cl.list_estimators()`, `cl.list_scenarios()` and `cl.list_studies()` say what there is; `cl.run_study("quick")` runs a
whole study. Names are imported when they are first used, so that `cooploc --help` does not wait for pandas.
"""

import ast as _ast
import warnings as _warnings
from importlib import import_module as _import_module
from importlib.metadata import version as _version
from pathlib import Path as _Path
from typing import Any as _Any

_STUB = _ast.parse(_Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
_IMPORTS = [
    (node.module or "", name.name) for node in _STUB.body if isinstance(node, _ast.ImportFrom) for name in node.names
]
_MODULES = {"estimators": "cooploc.estimators", "scenarios": "cooploc.scenarios", "plot": "cooploc.analysis.plot"}
# name -> the module that it is imported from, when it is first used
_HOME = {name: module for module, name in _IMPORTS if name not in _MODULES and name != "CallablePackage"}
_RENAMED = {"studies": "list_studies", "problems": "list_problems"}  # the old names, for this version

__all__ = [*_HOME, *_MODULES]  # noqa: PLE0604 (strings, as the mappings say)
__version__ = _version("cooploc")


def __getattr__(name: str) -> _Any:
    if name in _MODULES:
        found = _import_module(_MODULES[name])
    elif name in _HOME:
        found = getattr(_import_module(_HOME[name]), name)
    elif name in _RENAMED:
        _warnings.warn(f"cl.{name} is called cl.{_RENAMED[name]} now", FutureWarning, stacklevel=2)
        return __getattr__(_RENAMED[name])
    else:
        raise AttributeError(f"module 'cooploc' has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
