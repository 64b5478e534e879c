"""What is made of finished runs: reports, verdicts, comparisons, and trials that are run again."""

from pathlib import Path

from cooploc.analysis.claims import ledger as ledgers
from cooploc.analysis.execution.stored_run import read
from cooploc.terminal.console import wide


def report(folder: Path, out: Path, ledger: Path | None) -> None:
    """Write a run's report, and say where it is."""
    from cooploc.analysis.report import html_page

    written = html_page.write(read(folder), ledgers.load(ledger), out)
    wide().print(f"report: {written}   tables: {out / 'tables'}")


def verdicts(folder: Path, ledger: Path | None) -> None:
    """Print the verdicts of a ledger on a run."""
    from cooploc.analysis.claims import verdicts
    from cooploc.terminal import claim_verdicts

    asked = ledgers.load(ledger)
    claim_verdicts.show(verdicts.judge(asked, read(folder).rows), asked)


def compare(before: Path, after: Path) -> None:
    """Print what changed between two runs."""
    from cooploc.analysis.report import run_diff

    a, b = read(before), read(after)
    found = run_diff.changes(a, b)
    console = wide()
    for line in (f"from {before} to {after}", *run_diff.settings(a, b), ""):
        console.print(line)
    if len(found):
        console.print(run_diff.table(found).terminal())
    for line in run_diff.sentences(found):
        console.print(line)


def reproduce(page: Path, trials: int, data: Path | None) -> bool:
    """Run some of a report's trials again; whether all came out bit-equal."""
    from cooploc.analysis.report import reproduce as again

    embedded = again.load(page)
    differences = again.differences(embedded)
    found = again.rerun(embedded, trials, data)
    console = wide()
    console.print(again.table(found).terminal())
    equal = sum(one.equal for one in found)
    console.print(f"{equal} of {len(found)} results are bit-equal")
    if equal < len(found) and differences:
        console.print(f"this machine differs from that of the report: {'; '.join(differences)}")
    return equal == len(found)
