"""What the commands on finished runs print."""

from pathlib import Path

import pandas as pd

from cooploc.analysis.claims import ledger as ledgers
from cooploc.analysis.formats import counted
from cooploc.terminal.console import wide


def report(page: Path) -> None:
    """Say where a report is."""
    wide().print(f"report: {page}\ntables: {page.parent / 'tables'}")


def paper(example: Path) -> None:
    """Say where a paper's figures and tables are, and how to look at them."""
    folder = example.parent
    figures, tables = (
        counted(len(list((folder / name).glob(f"*.{ending}"))), name.removesuffix("s"))
        for name, ending in (("figures", "pdf"), ("tables", "tex"))
    )
    console = wide()
    console.print(f"paper: {folder}\nin it: {figures}, {tables}, estimators.bib")
    latex = f"pdflatex {example.stem}"
    console.print(f"to see them all: cd {folder} && {latex} && bibtex {example.stem} && {latex} && {latex}")


def verdicts(found: pd.DataFrame, ledger: Path | None) -> None:
    """Print the verdicts of a ledger on a run."""
    from cooploc.terminal import claim_verdicts

    claim_verdicts.show(found, ledgers.load(ledger))


def readings(found: pd.DataFrame) -> None:
    """Print in how many readings each claim holds, where a run holds more than the preset's."""
    from cooploc.terminal import claim_verdicts

    if not found["preset"].all():
        claim_verdicts.show_readings(found)


def changes(title: str, settings: list[str], found: pd.DataFrame, sentences: list[str]) -> None:
    """Print what changed between two runs."""
    from cooploc.analysis.report import run_diff

    console = wide()
    for line in (title, *settings, ""):
        console.print(line)
    if len(found):
        console.print(run_diff.table(found).terminal())
    for line in sentences:
        console.print(line)


def reproduced(found: pd.DataFrame, differences: list[str]) -> None:
    """Print which trials of a report came out bit-equal."""
    from cooploc.analysis.report import reproduce as again

    console = wide()
    trials = [again.Again(*row) for row in found.itertuples(index=False)]
    console.print(again.table(trials).terminal())
    equal = found["equal"].sum()
    console.print(f"{equal} of {len(trials)} results are bit-equal")
    if equal < len(trials) and differences:
        console.print(f"this machine differs from that of the report: {'; '.join(differences)}")
