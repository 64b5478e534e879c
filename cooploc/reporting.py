"""What the commands on finished runs print."""

from pathlib import Path

import pandas as pd
from rich.console import Console

from cooploc.runs import Reproduced, RunChanges


def report(page: Path) -> None:
    """Say where a report is."""
    _console().print(f"report: {page}   tables: {page.parent / 'tables'}", soft_wrap=True)


def verdicts(found: pd.DataFrame, ledger: Path | None) -> None:
    """Print the verdicts of a ledger on a run."""
    from cooploc.analysis.claims import ledger as ledgers
    from cooploc.analysis.claims import wording

    wording.show(found, ledgers.load(ledger))


def changes(before: Path, after: Path, found: RunChanges) -> None:
    """Print what changed between two runs."""
    from cooploc.analysis.report import run_diff

    console = _console()
    console.print(f"from {before} to {after}", soft_wrap=True)
    for line in found.settings:
        console.print(line, soft_wrap=True)
    console.print()
    if len(found.table):
        console.print(run_diff.table(found.table).terminal())
    for line in found.sentences:
        console.print(line, soft_wrap=True)


def reproduced(found: Reproduced) -> None:
    """Print which trials of a report came out bit-equal."""
    from cooploc.analysis.report import reproduce as again

    console = _console()
    trials = [again.Again(*row) for row in found.table.itertuples(index=False)]
    console.print(again.table(trials).terminal())
    console.print(f"{found.table['equal'].sum()} of {len(trials)} results are bit-equal")
    if not found.equal and found.differences:
        console.print(
            f"where this place differs from that of the report: {'; '.join(found.differences)}", soft_wrap=True
        )


def _console() -> Console:
    # Wide: a terminal may wrap a row, but numbers are never cut off.
    return Console(highlight=False, markup=False, width=400)
