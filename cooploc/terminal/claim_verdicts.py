"""The verdicts of a ledger: a table for every claim, then the readings and what the numbers mean."""

import pandas as pd

from cooploc.analysis.claims.ledger import Ledger
from cooploc.analysis.claims.multiverse import shares
from cooploc.analysis.report.claim_tables import called, cases, over_readings
from cooploc.terminal.console import wide

STYLES = {"supported": "green", "direction only": "yellow", "contradicted": "red", "undecided": "cyan"}


def show(verdicts: pd.DataFrame, ledger: Ledger) -> None:
    """Print a table for every claim, then the readings and what the numbers mean."""
    console = wide()
    console.print(ledger.paper)
    for claim, part in verdicts.groupby("claim", sort=False):
        says, where, left_open = part[["says", "where", "open"]].iloc[0]
        console.print(f"\n{claim}. {called(says, where)}", style="bold")
        console.print(cases(part).terminal(style=lambda row: STYLES.get(row["verdict"], "dim")))
        if left_open:
            console.print(f" open: {left_open}", style="dim")
    console.print()
    for name, variant in ledger.variants.items():
        console.print(f"{name}: {variant.about}", style="dim")
    console.print(_legend(verdicts), style="dim")


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


def _legend(verdicts: pd.DataFrame) -> str:
    decided = int(verdicts["verdict"].isin(("supported", "direction only", "contradicted")).sum())
    return (
        "Changes are b/a - 1: negative where the error falls. (r): claimed as a ratio of errors a/b. At worst a "
        f"verdict is wrong in one of twenty repetitions: of these {decided}, about {decided / 20:.0f}."
    )
