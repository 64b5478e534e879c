"""What is made of finished runs: reports, verdicts, comparisons, and trials that are run again."""

from pathlib import Path

from rich.console import Console

from cooploc.analysis.claims import ledger as ledgers
from cooploc.analysis.execution.stored_run import read


def report(folder: Path, out: Path, ledger: Path | None) -> None:
    """Write a run's report, and say where it is."""
    from cooploc.analysis.report import html_page

    written = html_page.write(read(folder), ledgers.load(ledger), out)
    _console().print(f"report: {written}   tables: {out / 'tables'}", soft_wrap=True)


def verdicts(folder: Path, ledger: Path | None) -> None:
    """Print the verdicts of a ledger on a run."""
    from cooploc.analysis.claims import verdicts, wording

    asked = ledgers.load(ledger)
    wording.show(verdicts.judge(asked, read(folder).rows), asked)


def compare(before: Path, after: Path) -> None:
    """Print what changed between two runs."""
    from cooploc.analysis.report import run_diff

    a, b = read(before), read(after)
    console = _console()
    found = run_diff.changes(a, b)
    console.print(f"from {before} to {after}", soft_wrap=True)
    for line in run_diff.settings(a, b):
        console.print(line, soft_wrap=True)
    console.print()
    if len(found):
        console.print(run_diff.table(found).terminal())
    for line in run_diff.sentences(found):
        console.print(line, soft_wrap=True)


def reproduce(page: Path, trials: int, data: Path | None) -> bool:
    """Run some of a report's trials again; whether all came out bit-equal."""
    from cooploc.analysis.report import reproduce as again

    embedded = again.load(page)
    console = _console()
    unlike = again.differences(embedded)
    found = again.rerun(embedded, trials, data)
    console.print(again.table(found).terminal())
    equal = sum(one.equal for one in found)
    console.print(f"{equal} of {len(found)} results are bit-equal")
    if equal < len(found) and unlike:
        console.print(f"where this place differs from that of the report: {'; '.join(unlike)}", soft_wrap=True)
    return equal == len(found)


def _console() -> Console:
    # Wide: a terminal may wrap a row, but numbers are never cut off.
    return Console(highlight=False, markup=False, width=400)
