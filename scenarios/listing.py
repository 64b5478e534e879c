"""The list of scenarios as a table: `cl.scenarios()`."""

from typing import TYPE_CHECKING, Any

from cooploc import scenarios as registry
from cooploc.estimators.plugins.listing import source_of

if TYPE_CHECKING:
    from pandas import DataFrame


def listing() -> "DataFrame":
    """One row per family of scenarios, the built-in ones first.

    Columns: `name`; `about`, in a sentence; `labels`, how its members are written; `parameters`, what can be set in
    brackets or by keyword; `source`, the paper or data set; `problem`, why a plug-in cannot be used, else empty.
    """
    from pandas import DataFrame

    problems = registry.plugin_errors()
    rows = [_row(name) for name in registry.names() if name not in problems]
    rows += [{"name": name, "problem": reason} for name, reason in problems.items()]
    empty = dict.fromkeys(("name", "about", "labels", "parameters", "source", "problem"), "")
    return DataFrame([{**empty, **row} for row in rows])


def _row(name: str) -> dict[str, Any]:
    family = registry.family(name)
    model = family.model_class(name)
    parameters = [field for field in model.model_fields if field != "data"]
    return {
        "name": name,
        "about": family.about,
        "labels": ", ".join(_labels(name, family)),
        "parameters": ", ".join(parameters),
        "source": source_of(model),
    }


def _labels(name: str, family: registry.Family) -> list[str]:
    """The name alone where it stands for one scenario; else the name with each thing that can follow it."""
    swept = [f"{name}/{key}=…" for key in family.sweep] + [f"{name}/{word}" for word in family.variants]
    return [*swept, *([f"{name}/{family.word.upper()}"] if family.word else [])] or [name]
