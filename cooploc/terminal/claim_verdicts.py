"""The verdicts of a ledger: a table for every claim, then the readings, what numbers mean, how many may be false."""

import pandas as pd
from rich.console import Console

from cooploc.analysis.claims.ledger import Ledger
from cooploc.analysis.claims.multiverse import shares
from cooploc.analysis.claims.verdicts import family_of
from cooploc.analysis.formats import listed
from cooploc.analysis.report.claim_tables import called, cases, not_run, over_readings
from cooploc.terminal.console import wide

LEGEND = (
    "Changes are b/a - 1: negative where the error falls. A verdict, taken alone, is wrong in at most one of twenty "
    "repetitions of the run; of many some are. stands: still decided after Holm's correction over all judged cases. "
    "Each verdict is of one reading of the paper; cl.readings judges a claim in all that were run (the study "
    "readings runs them)."
)
STYLES = {
    "supported": "green",
    "direction only": "yellow",
    "flat": "magenta",
    "contradicted": "red",
    "undecided": "cyan",
}


def show(verdicts: pd.DataFrame, ledger: Ledger) -> None:
    """Print a table for every claim, then the readings, what the numbers mean, and how many verdicts may be false.

    Args:
        verdicts: from `cl.verdicts`.
        ledger: its ledger.

    """
    console, skipped = wide(), []
    console.print(ledger.paper)
    for claim, part in verdicts.groupby("claim", sort=False):
        if (part["verdict"] == "not run").all():
            skipped.append(str(claim))
        else:
            _claim(console, str(claim), part)
    console.print()
    if skipped:
        console.print(f"Not run at all, as this run lacks their scenarios or estimators: claims {listed(skipped)}")
    ran = set(verdicts.loc[verdicts["verdict"] != "not run", "variant"])
    for name, variant in ledger.variants.items():
        if name in ran:
            console.print(f"{name}: {variant.about}", style="dim")
    console.print(LEGEND, style="dim")
    console.print(str(family_of(verdicts)))


def _claim(console: Console, claim: str, part: pd.DataFrame) -> None:
    """Print one claim: what was run of it, what was not, and what the paper leaves open."""
    says, where, left_open, readings = part[["says", "where", "open", "map"]].iloc[0]
    console.print(f"\n{claim}. {called(says, where)}", style="bold")
    console.print(cases(part).terminal(style=lambda row: STYLES.get(row["verdict"], "dim")))
    if lacking := not_run(part):
        console.print(f" {lacking}", style="dim")
    if left_open:
        console.print(f" open: {left_open}", style="dim")
    if readings:
        console.print(f" over all readings: {readings}")


def show_readings(found: pd.DataFrame) -> None:
    """Print the map: for every claim, in how many specifications it holds, and in which.

    Args:
        found: from `multiverse.judge`.

    """
    console, counted = wide(), shares(found)
    console.print("\nThe claims over all readings of the paper that were run", style="bold")
    console.print(over_readings(counted).terminal())
    for row in counted.to_dict("records"):
        console.print(f" {row['claim']}. {row['says']}: {row['sentence']}.")
    console.print(
        "A specification is a case (scenario, estimators, definition of the size) in a reading of the paper; what "
        "runs the same counts once. letter: the reading nearest to the words of the paper.",
        style="dim",
    )
