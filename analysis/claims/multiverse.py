"""A ledger judged over the readings that its paper allows: for every claim not one verdict but a map of them.

A *specification* of a claim is one of its cases (estimators, scenario, definition of the size) in one reading. Readings
that differ only in what does not touch the case's estimators and scenarios are one specification, counted once. What is
said of a claim is how many of its specifications support it, and which choices these have in common.

Sources: U. Simonsohn, J. Simmons, L. Nelson, "Specification curve analysis", Nature Human Behaviour 4, 2020;
S. Steegen et al., "Increasing transparency through a multiverse analysis", 2016.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.claims import readings
from cooploc.analysis.claims.claim import Case, Claim
from cooploc.analysis.claims.common_choices import sentence
from cooploc.analysis.claims.kinds import KINDS, cases, definitions
from cooploc.analysis.claims.ledger import Ledger
from cooploc.analysis.claims.readings import Dimensions, Reading
from cooploc.analysis.claims.trial_table import collect
from cooploc.analysis.claims.verdicts import COLUMNS, JUDGED, judged
from cooploc.analysis.metrics.pooling import demand_same_streams
from cooploc.analysis.metrics.stopping import FIXED, Stopping
from cooploc.estimators.plugins.errors import BadInput
from cooploc.estimators.plugins.labels import parse

ADDED = {
    "readings": "how many readings of the design come down to this specification",
    "letter": "whether the reading nearest to the paper's letter does",
    "preset": "whether the preset does",
}
OF_LEDGERS = ("variant", "p_holm", "stands", "otherwise", "look")  # columns of verdicts that a map does not have
SHOWN = [name for name in COLUMNS if name not in OF_LEDGERS] + list(ADDED)


class Specification(NamedTuple):
    """A case in one reading, and all readings that come down to the same."""

    case: Case
    choices: dict[str, str]  # dimension -> choice; empty where it makes no difference
    readings: list[int]  # their numbers in the design


def judge(ledger: Ledger, rows: pd.DataFrame, stopping: Stopping = FIXED) -> pd.DataFrame:
    """One row per claim and specification that was run.

    Columns are those of `verdicts.judge` without those of `OF_LEDGERS`; those of `ADDED`; and one for every dimension,
    with the choice, or empty where no choice in it makes a difference to this specification. Estimators and scenarios
    are called as in the ledger.

    Args:
        ledger: from `load`, with dimensions.
        rows: from `errors` or a run directory of the study `readings`.
        stopping: whether the number of trials was fixed before, or may depend on results.

    Raises:
        BadInput: estimators of one scenario ran on different streams, or a dimension is named like a column.

    """
    if taken := [name for name in ledger.dimensions if name in (*COLUMNS, *ADDED)]:
        raise BadInput(f"dimension {taken[0]!r} is named like a column of the verdicts: rename it in the ledger")
    demand_same_streams(rows)
    table, design = collect(rows, stopping), readings.design(ledger.dimensions)
    preset, letter = (design.index(end(ledger.dimensions)) for end in (readings.preset, readings.letter))
    out: list[dict[str, Any]] = []
    for claim in ledger.claims:
        for case in _defined(claim) if KINDS[claim.kind].judge else ():
            asked = specifications(case, design, ledger.dimensions)
            for one, row in zip(asked, judged(claim, table, [one.case for one in asked]), strict=True):
                if row["verdict"] in JUDGED:
                    ends = {"letter": letter in one.readings, "preset": preset in one.readings}
                    named = _named(row, case, one.case)
                    out.append({**row, **named, "readings": len(one.readings), **ends, **one.choices})
    return pd.DataFrame(out, columns=[*SHOWN, *ledger.dimensions])


def _defined(claim: Claim) -> list[Case]:
    """The cases of a claim by every definition of its size, for a definition is a reading of the paper, too."""
    return [case._replace(definition=name) for case in cases(claim) for name in definitions(claim)]


def dimensions_of(found: pd.DataFrame) -> list[str]:
    """The dimensions that make a difference to some of these specifications."""
    return [name for name in found.columns if name not in SHOWN and (found[name] != "").any()]


def specifications(case: Case, design: Sequence[Reading], dimensions: Dimensions) -> list[Specification]:
    """The case in every reading; readings that lead to the same estimators and scenarios are one specification."""
    preset = readings.preset(dimensions)
    matters = {
        name
        for name, one in dimensions.items()
        if any(substituted(case, {**preset, name: choice}, dimensions) != case for choice in one.choices)
    }
    found: dict[Case, Specification] = {}
    for number, reading in enumerate(design):
        shown = matters - readings.settled(reading, dimensions)
        choices = {name: choice if name in shown else "" for name, choice in reading.items()}
        read = substituted(case, reading, dimensions)
        found.setdefault(read, Specification(read, choices, [])).readings.append(number)
    return list(found.values())


def substituted(case: Case, reading: Reading, dimensions: Dimensions) -> Case:
    """The case as a reading wants it, in every estimator and scenario alike."""
    return case._replace(
        of=readings.estimator(case.of, reading, dimensions),
        than=tuple(readings.estimator(label, reading, dimensions) for label in case.than),
        scenarios=tuple(readings.scenario(label, reading, dimensions) for label in case.scenarios),
    )


def shares(found: pd.DataFrame) -> pd.DataFrame:
    """One row per claim: how many specifications there are, how many have each verdict, and a sentence.

    Columns: `claim`, `says`, `scenarios`, `specifications`; one for each verdict; `letter` and `preset`, the verdicts
    in these readings; `dimensions` that make a difference to the claim; and `sentence`.
    """
    out = []
    for claim, part in found.groupby("claim", sort=False):
        dimensions, counts = dimensions_of(part), part["verdict"].value_counts()
        out.append(
            {
                "claim": claim,
                "says": part["says"].iloc[0],
                "scenarios": ", ".join(dict.fromkeys(part["scenario"])),
                "specifications": len(part),
                **{verdict: int(counts.get(verdict, 0)) for verdict in JUDGED},
                **{end: _counted(part.loc[part[end], "verdict"]) for end in ("letter", "preset")},
                "dimensions": ", ".join(dimensions),
                "sentence": sentence(part, dimensions),
            }
        )
    columns = ("claim", "says", "scenarios", "specifications", *JUDGED, "letter", "preset", "dimensions", "sentence")
    return pd.DataFrame(out, columns=list(columns))


def sentences(found: pd.DataFrame) -> dict[str, str]:
    """Of every claim of which more than the preset's reading was run: in how many readings it holds.

    Args:
        found: from `judge`.

    """
    beyond = set(found.loc[~found["preset"].astype(bool), "claim"])
    rows = shares(found[found["claim"].isin(beyond)]).to_dict("records")
    return {row["claim"]: f"{row['sentence']} (cl.readings)" for row in rows}


def _named(row: dict[str, Any], case: Case, read: Case) -> dict[str, str]:
    """Estimators and scenarios of a row by the ledger's labels, which are the same in every reading."""
    than = dict(zip((*read.than, ", ".join(read.than)), (*case.than, ", ".join(case.than)), strict=True))
    kept = {key for label in case.scenarios for key in parse(label)[1]}
    where = " to ".join(_without(label, kept) for label in row["scenario"].split(" to "))
    return {"of": case.of, "than": than.get(row["than"], row["than"]), "scenario": where}


def _without(label: str, kept: set[str]) -> str:
    """A scenario's label with no other options than these."""
    path, options = parse(label)
    left = ",".join(f"{key}={value}" for key, value in options.items() if key in kept)
    return path + (f"[{left}]" if left else "")


def _counted(found: "pd.Series[str]") -> str:
    """Verdicts with their counts, "2 supported, 1 undecided"; of one kind, the verdict alone."""
    counts = found.value_counts()
    ordered = [name for name in JUDGED if name in counts.index]
    return ordered[0] if len(ordered) == 1 else ", ".join(f"{counts[name]} {name}" for name in ordered)
