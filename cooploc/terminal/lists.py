"""Lists of estimators, scenarios and studies."""

from typing import Any

import pandas as pd

from cooploc.analysis.formats import duration
from cooploc.analysis.report.tables import Table, words
from cooploc.terminal.console import wide

USES = "uses: a|b is the first of the two that a scenario has; a? is used where it is there"
HINDSIGHT = "with hindsight, from Python alone: cl.Smoother(), offline: neither ranked nor best"
HEADS = {
    "estimators": (
        words("name"),
        words("what it is", "about"),
        words("uses"),
    ),
    "scenarios": (words("name", "labels"), words("what it is", "about")),
    "studies": (words("name"), words("takes"), words("what it is", "about")),
}


def show(kind: str, listed: pd.DataFrame) -> None:
    """Print the table of `cl.estimators()`, `cl.scenarios()` or `cl.studies()`, then plug-ins that cannot be used."""
    broken = listed["problem"] != "" if "problem" in listed else pd.Series(False, listed.index)
    rows = [_row(row) for row in listed[~broken].to_dict("records")]
    console = wide()
    console.print(Table(kind, kind, HEADS[kind], rows).terminal(wrap=True))
    for row in listed[broken].to_dict("records"):
        console.print(f"  {row['name']}: not usable, {row['problem']}")
    if kind == "estimators":
        for line in (USES, HINDSIGHT):
            console.print(f"  {line}")
    console.print()


def _row(row: dict[Any, Any]) -> dict[str, Any]:
    minutes = row.get("minutes", float("nan"))
    takes = "" if minutes != minutes else duration(60 * minutes)
    return {**row, "about": row["about"] + _standing(row) + _configured(row), "takes": takes}


def _standing(row: dict[Any, Any]) -> str:
    if row.get("offline", False):
        return " (offline: neither ranked nor best)"
    if row.get("bound", False):
        return " (a bound)"
    centralised = row.get("centralised", False) and not row["about"].startswith("Centralised")
    return " (centralised)" * centralised


def _configured(row: dict[Any, Any]) -> str:
    """The configurations of an estimator that differ from its default."""
    words = {"published": "as published", "best": "at its best"}
    return "".join(f" {word}: {row[key]}." for key, word in words.items() if row.get(key, row["name"]) != row["name"])
