"""The list of estimators as a table: `cl.estimators()`."""

import re
import sys
from typing import TYPE_CHECKING, Any

from cooploc.estimators import make, names, plugin_errors

if TYPE_CHECKING:
    from pandas import DataFrame


def listing() -> "DataFrame":
    """One row per estimator, the built-in ones first.

    Columns: `name`; `about`, in a sentence; `uses`, the channels it needs; `bound`, whether it knows more than any
    robot could; `source`, the paper; `problem`, why a plug-in cannot be used, empty where it can.
    """
    from pandas import DataFrame

    problems = plugin_errors()
    rows = [_row(name, make(name)) for name in names() if name not in problems]
    empty = {"name": "", "about": "", "uses": "", "bound": False, "source": "", "problem": ""}
    rows += [{"name": name, "problem": reason} for name, reason in problems.items()]
    return DataFrame([{**empty, **row} for row in rows])


def _row(name: str, made: Any) -> dict[str, Any]:
    about = (type(made).__doc__ or "").strip().partition("\n")[0]
    bound, uses = getattr(made, "bound", False), ", ".join(made.uses)
    return {"name": name, "about": about, "uses": uses, "bound": bound, "source": source_of(type(made))}


def source_of(cls: type) -> str:
    """The first paper that the docstring of a class's module names after "Source:", up to its year; else empty."""
    text = re.sub(r"\s+", " ", sys.modules[cls.__module__].__doc__ or "")
    found = re.search(r"Sources?: (.+?\b(?:19|20)\d\d)\b", text)
    return found[1] if found else ""
