"""What `cooploc inspect` prints: series, guesses, findings, and what to run next."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from cooploc.analysis.report.tables import Table, numbers, words
from cooploc.inspection import Inspection
from cooploc.scenarios.recordings.schema import NAME
from cooploc.terminal.console import wide

SERIES = (
    words("series"),
    words("of"),
    numbers("samples"),
    numbers("rate [Hz]", "rate"),
    numbers("from [s]", "first"),
    numbers("to [s]", "last"),
    numbers("gaps"),
    numbers("longest [s]", "longest"),
)
COLUMNS = (words("file"), words("column"), words("probably"), words("why"))
MOST = 40  # rows of a table; `cl.inspect` has all


def show(found: Inspection, files: Sequence[Path]) -> None:
    """Print the tables of an inspection, its findings, and the files that were written."""
    console, inspected = wide(), found.inspected
    console.print(f"{inspected.path}: {inspected.format} ({inspected.why}), runs: {', '.join(inspected.runs)}\n")
    _table("series", SERIES, found.series)
    _table("columns", COLUMNS, found.columns)
    for line in inspected.unused:
        console.print(f"not used: {line}")
    for row in found.findings.to_dict("records"):
        whose = f" {row['robot']}" if row["robot"] else ""
        console.print(f"found ({row['sure']}): {row['kind']}{whose}: {row['fact']}")
        console.print(f"  to change in {NAME}: {row['change']}")
    if not len(found.findings):
        console.print("nothing odd was found")
    names = ", ".join(str(file) for file in files)
    kept = "" if any(file.name == NAME for file in files) else f"; the {NAME} that is there was left as it is"
    console.print(f"written: {names}{kept}")
    console.print(f"next: look at both, then cooploc run log --data {files[-1].parent}")


def _table(name: str, columns: Any, table: pd.DataFrame) -> None:
    """One table, its first rows."""
    if not len(table):
        return
    rows = [{str(k): _text(v) for k, v in row.items()} for row in table.head(MOST).to_dict("records")]
    console = wide()
    console.print(Table(name, name, columns, rows).terminal(wrap=True))
    if len(table) > MOST:
        console.print(f"  and {len(table) - MOST} more")
    console.print()


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
