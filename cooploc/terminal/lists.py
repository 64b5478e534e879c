"""Lists of estimators, scenarios and studies."""

from collections.abc import Callable
from typing import Any

from rich.console import Console

from cooploc import estimators, scenarios
from cooploc.analysis.formats import duration
from cooploc.analysis.report.tables import Table, words
from cooploc.scenarios.studies import study

Listed = tuple[list[dict[str, Any]], dict[str, str]]  # rows, and what is not usable with its reason


def show(kind: str) -> None:
    """Print one list, with the plug-ins that could not be loaded."""
    heads, listed = LISTS[kind]
    rows, errors = listed()
    console = Console(highlight=False, markup=False)
    console.print(Table(kind, kind, tuple(map(words, heads)), rows).terminal(wrap=True))
    for name, reason in errors.items():
        console.print(f"  {name}: not usable, {reason}", soft_wrap=True)
    console.print()


def _estimators() -> Listed:
    broken = estimators.plugin_errors()
    rows = []
    for name in estimators.names():
        if name not in broken:
            made = estimators.make(name)
            about = (type(made).__doc__ or "").strip().partition("\n")[0]
            bound = " (a bound)" if getattr(made, "bound", False) else ""
            rows.append({"name": name, "what it is": about + bound, "uses": ", ".join(made.uses)})
    return rows, broken


def _scenarios() -> Listed:
    broken = scenarios.plugin_errors()
    found = {name: scenarios.family(name) for name in scenarios.names() if name not in broken}
    return [{"name": _labels(name, family), "what it is": family.about} for name, family in found.items()], broken


def _labels(name: str, found: scenarios.Family) -> str:
    short = [f"{name}/{key}=…" for key in found.sweep] + [f"{name}/{word}" for word in found.variants]
    short += [f"{name}/{found.word.upper()}"] if found.word else []
    return "|".join(short or [name])


def _studies() -> Listed:
    shipped = [study.load(name) for name in study.names()]
    takes = ["" if one.minutes is None else duration(60 * one.minutes) for one in shipped]
    return [{"name": o.name, "takes": t, "what it is": o.about} for o, t in zip(shipped, takes, strict=True)], {}


LISTS: dict[str, tuple[tuple[str, ...], Callable[[], Listed]]] = {
    "estimators": (("name", "what it is", "uses"), _estimators),
    "scenarios": (("name", "what it is"), _scenarios),
    "studies": (("name", "takes", "what it is"), _studies),
}
