"""The list of estimators as a table: `cl.estimators()`."""

import re
import sys
from typing import TYPE_CHECKING, Any

from cooploc.estimators import make, names, plugin_errors
from cooploc.estimators.plugins.configurations import configurations
from cooploc.estimators.plugins.traits import traits

if TYPE_CHECKING:
    from pandas import DataFrame


def listing() -> "DataFrame":
    """One row per estimator, the built-in ones first.

    Columns: `name`; `about`, in a sentence; `uses`, the channels it needs; `centralised`, whether all readings reach
    one computer; `bound`, whether it bounds all others; `offline`, whether it sees later readings too; `published` and
    `best`, its configurations as published and at its best (see `plugins.configurations`); `source`, the paper;
    `problem`, why a plug-in cannot be used, empty where it can.
    """
    from pandas import DataFrame

    problems = plugin_errors()
    rows = [_row(name, make(name)) for name in names() if name not in problems]
    empty = {"name": "", "about": "", "uses": "", "centralised": False, "bound": False, "offline": False}
    empty |= {"published": "", "best": "", "source": "", "problem": ""}
    rows += [{"name": name, "problem": reason} for name, reason in problems.items()]
    return DataFrame([{**empty, **row} for row in rows])


def _row(name: str, made: Any) -> dict[str, Any]:
    about = (type(made).__doc__ or "").strip().partition("\n")[0]
    has = traits(made)
    known = {
        "centralised": has.centralised,
        "bound": has.bound,
        "offline": has.offline,
        "source": source_of(type(made)),
    }
    return {"name": name, "about": about, "uses": ", ".join(made.uses), **configurations(name)._asdict(), **known}


def source_of(cls: type) -> str:
    """The first paper that the docstring of a class's module names after "Source:", up to its year; else empty."""
    text = re.sub(r"\s+", " ", sys.modules[cls.__module__].__doc__ or "")
    found = re.search(r"Sources?: (.+?\b(?:19|20)\d\d)\b", text)
    return found[1] if found else ""
