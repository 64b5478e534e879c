"""What the commands on finished runs print."""

from pathlib import Path

import pandas as pd
from rich.console import Console


def report(page: Path) -> None:
    """Say where a report is."""
    _console().print(f"report: {page}   tables: {page.parent / 'tables'}", soft_wrap=True)


def verdicts(found: pd.DataFrame, ledger: Path | None) -> None:
    """Print the verdicts of a ledger on a run."""
    from cooploc.analysis.claims import ledger as ledgers
    from cooploc.analysis.claims import wording

    wording.show(found, ledgers.load(ledger))


def changes(title: str, settings: list[str], found: pd.DataFrame, sentences: list[str]) -> None:
    """Print what changed between two runs."""
    from cooploc.analysis.report import run_diff

    console = _console()
    for line in (title, *settings, ""):
        console.print(line, soft_wrap=True)
    if len(found):
        console.print(run_diff.table(found).terminal())
    for line in sentences:
        console.print(line, soft_wrap=True)


def reproduced(found: pd.DataFrame, differences: list[str]) -> None:
    """Print which trials of a report came out bit-equal."""
    from cooploc.analysis.report import reproduce as again

    console = _console()
    trials = [again.Again(*row) for row in found.itertuples(index=False)]
    console.print(again.table(trials).terminal())
    equal = found["equal"].sum()
    console.print(f"{equal} of {len(trials)} results are bit-equal")
    if equal < len(trials) and differences:
        console.print(f"this machine differs from that of the report: {'; '.join(differences)}", soft_wrap=True)


def _console() -> Console:
    # Wide: a terminal may wrap a row, but numbers are never cut off.
    return Console(highlight=False, markup=False, width=400)
