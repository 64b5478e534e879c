"""Lists of what there is, for the terminal."""

import pandas as pd
from rich.console import Console
from rich.table import Table

COLUMNS = {
    "estimators": ["name", "about", "uses"],
    "scenarios": ["labels", "about"],
    "studies": ["name", "minutes", "about"],
}


def show(kind: str, listed: pd.DataFrame) -> None:
    """Print the table of `cl.estimators()`, `cl.scenarios()` or `cl.studies()`, with plug-ins that cannot be used."""
    table = Table(title=kind, title_justify="left", box=None, show_header=False, padding=(0, 2))
    broken = listed["problem"] != "" if "problem" in listed else pd.Series(False, listed.index)
    for row in listed[~broken].to_dict("records"):
        shown = {**row, "about": row["about"] + " (a bound)" * row.get("bound", False)}
        shown |= {"minutes": _takes(row["minutes"])} if "minutes" in row else {}
        table.add_row(*(str(shown[column]) for column in COLUMNS[kind]))
    console = Console(highlight=False, markup=False)
    console.print(table)
    for row in listed[broken].to_dict("records"):
        console.print(f"  {row['name']}: not usable, {row['problem']}", soft_wrap=True)
    console.print()


def _takes(minutes: float) -> str:
    """How long a study takes on two cores; empty where that depends on the user's data."""
    if minutes != minutes:
        return ""
    return f"{60 * minutes:.0f} s" if minutes < 1.5 else f"{minutes:.0f} min"
