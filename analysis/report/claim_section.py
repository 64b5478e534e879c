"""The claims of a ledger on the page: their verdicts, each claim's cases, and those of which nothing was run."""

from typing import NamedTuple

import pandas as pd

from cooploc.analysis.claims import multiverse, verdicts
from cooploc.analysis.claims.ledger import BASE, Ledger, load
from cooploc.analysis.execution.stored_run import Kept
from cooploc.analysis.formats import counted
from cooploc.analysis.metrics.sequential import ANYTIME, FIXED
from cooploc.analysis.report import claim_tables
from cooploc.analysis.report.tables import Table

LEGEND = (
    'A change is b/a - 1: negative where the error falls. "66 % more accurate" is judged as a change of -66 %; what '
    "the same interval means for a ratio of errors of 1.66, a change of -40 %, is said beside it. Each verdict, taken "
    "alone, is wrong in at most one of twenty repetitions of the run, so that of many some are wrong: how many are "
    "expected to be is said with them. It stands where that holds of all judged cases together (Holm). "
    "Readings: paper, as it stands; others as the ledger describes them. No verdict rests on one reading: the study "
    "readings runs all that the ledger declares, and cl.readings judges every claim in each."
)


class ClaimsShown(NamedTuple):
    """What a page says of a ledger that the run touches."""

    paper: str
    sentence: str
    overview: Table
    run: list[claim_tables.ClaimSection]
    not_run: list[claim_tables.ClaimSection]
    family: str
    table: Table  # all cases, for a file
    legend: str = LEGEND


def claims_shown(kept: Kept, ledger: Ledger) -> ClaimsShown | None:
    """The section on claims; None where the run touches no claim of the ledger that is shipped."""
    judged = verdicts.judge_run(ledger, kept.rows, kept.looks)
    touched = judged["verdict"].isin(verdicts.JUDGED).any()
    if not touched and ledger == load():
        return None
    readings = multiverse.sentences(multiverse.judge(ledger, kept.rows, ANYTIME if kept.looks else FIXED))
    table = claim_tables.claims(judged, ledger.paper)
    sections = claim_tables.by_claim(table, judged, ledger, readings)
    return ClaimsShown(
        ledger.paper,
        _sentence(judged),
        claim_tables.overview(verdicts.overview(judged), judged, ledger),
        [one for one in sections if one.run],
        [one for one in sections if not one.run],
        str(verdicts.family_of(judged)),
        table,
    )


def _sentence(judged: pd.DataFrame) -> str:
    """The claims that were judged, as they stand, by verdict; one whose cases differ is named with their counts."""
    base = judged[(judged["variant"] == BASE) & (judged["verdict"] != "not run")]
    alike: dict[str, list[str]] = {}
    mixed = []
    for claim, part in base.groupby("claim", sort=False):
        counts = part["verdict"].value_counts(sort=False)
        if len(counts) == 1:
            alike.setdefault(str(counts.index[0]), []).append(str(claim))
        else:
            mixed.append(f"{claim} ({', '.join(f'{count} {verdict}' for verdict, count in counts.items())})")
    parts = [f"{verdict}: {', '.join(alike[verdict])}" for verdict in verdicts.VERDICTS if verdict in alike]
    parts += [f"differs by case: {', '.join(mixed)}"] if mixed else []
    seen, every = base["claim"].nunique(), counted(judged["claim"].nunique(), "claim")
    found = "; ".join(parts)
    return f"As the paper states them, {seen} of {every} could be looked at. {found[:1].upper()}{found[1:]}."
