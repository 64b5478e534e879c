"""Lists of what there is, for the terminal."""

from rich.console import Console
from rich.table import Table

from cooploc import estimators, scenarios
from cooploc.scenarios.studies import study


def show(kind: str) -> None:
    """Print one list, with the plug-ins that could not be loaded."""
    rows, errors = {"estimators": _estimators, "scenarios": _scenarios, "studies": _studies}[kind]()
    table = Table(title=kind, title_justify="left", box=None, show_header=False, padding=(0, 2))
    for row in rows:
        table.add_row(*row)
    console = Console(highlight=False, markup=False)
    console.print(table)
    for name, reason in errors.items():
        console.print(f"  {name}: not usable, {reason}", soft_wrap=True)
    console.print()


Listed = tuple[list[tuple[str, ...]], dict[str, str]]  # rows, and what is not usable with its reason


def _estimators() -> Listed:
    broken = estimators.plugin_errors()
    rows: list[tuple[str, ...]] = []
    for name in estimators.names():
        if name not in broken:
            made = estimators.make(name)
            about = (type(made).__doc__ or "").strip().partition("\n")[0]
            rows.append((name, about + (" (a bound)" if getattr(made, "bound", False) else ""), ", ".join(made.uses)))
    return rows, broken


def _scenarios() -> Listed:
    broken = scenarios.plugin_errors()
    rows: list[tuple[str, ...]] = []
    for name in scenarios.names():
        if name not in broken:
            found = scenarios.family(name)
            rows.append(("|".join(_labels(name, found)), found.about))
    return rows, broken


def _labels(name: str, found: scenarios.Family) -> list[str]:
    short = [f"{name}/{key}=…" for key in found.sweep] + [f"{name}/{word}" for word in found.variants]
    short += [f"{name}/{found.word.upper()}"] if found.word else []
    return short or [name]


def _studies() -> Listed:
    shipped = [study.load(name) for name in study.names()]
    return [(one.name, _takes(one.minutes), one.about) for one in shipped], {}


def _takes(minutes: float | None) -> str:
    """How long a study takes on two cores."""
    if minutes is None:
        return ""
    return f"{60 * minutes:.0f} s" if minutes < 1.5 else f"{minutes:.0f} min"
