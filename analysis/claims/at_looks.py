"""A ledger's verdicts in a run that stops when they are decided: each case keeps the verdict of its first look.

Verdicts come from confidence sequences (`stopping.ANYTIME`), so that each, taken alone, is false in at most one of
twenty runs, whatever look it was reached at. `p` is 1 / e, and Holm's correction holds for it as for any other p.

Claims about computing time are judged as well, and never make a run go on: a clock does not repeat itself.
"""

from collections.abc import Iterator, Sequence
from itertools import product

import pandas as pd

from cooploc.analysis.claims.claim import Case
from cooploc.analysis.claims.kinds import KINDS, cases
from cooploc.analysis.claims.ledger import Ledger, variants
from cooploc.analysis.claims.trial_table import Missing, TrialTable, canonical, collect
from cooploc.analysis.claims.verdicts import DECIDED, JUDGED, WOULD_BE, adjusted, judge
from cooploc.analysis.metrics.stopping import ANYTIME

TIMED = ("time", "slope", "cost")  # kinds of claims about computing time


def judge_at(ledger: Ledger, rows: pd.DataFrame, n: int, before: pd.DataFrame | None = None) -> pd.DataFrame:
    """The verdicts of `verdicts.judge` over the trials below n, with `look`; what was decided before stays.

    Args:
        ledger: from `load`.
        rows: of a run.
        n: trials of this look.
        before: what this gave at the look before.

    Raises:
        BadInput: estimators of one scenario ran on different streams.

    """
    now = judge(ledger, rows[rows["trial"] < n], ANYTIME)
    now["look"] = now["verdict"].isin(JUDGED) * n
    if before is None:
        return now
    decided = before["verdict"].isin(DECIDED)
    return adjusted(pd.concat([before[decided], now[~decided]]).sort_index())


def judge_at_looks(ledger: Ledger, rows: pd.DataFrame, at: Sequence[int]) -> pd.DataFrame:
    """The verdicts after all of these looks, one at least."""
    found = judge_at(ledger, rows, at[0])
    for n in at[1:]:
        found = judge_at(ledger, rows, n, found)
    return found


def judged(ledger: Ledger, rows: pd.DataFrame, at: Sequence[int]) -> pd.DataFrame:
    """The verdicts on a run: at these looks, or at the end where there were none."""
    return judge_at_looks(ledger, rows, at) if at else judge(ledger, rows)


def lasting(ledger: Ledger, found: pd.DataFrame) -> pd.DataFrame:
    """The judged rows that are not about computing time."""
    timed = [claim.id for claim in ledger.claims if claim.kind in TIMED]
    return found[found["verdict"].isin(JUDGED) & ~found["claim"].isin(timed)]


def open_cells(ledger: Ledger, rows: pd.DataFrame, found: pd.DataFrame) -> set[tuple[str, str]]:
    """The (scenario, estimator) whose further trials may decide a claim, by their labels in the run."""
    table = collect(rows)
    pairs = rows[["scenario", "estimator"]].drop_duplicates().itertuples(index=False)
    called = {(canonical(s), canonical(e)): (str(s), str(e)) for s, e in pairs}
    still = found["verdict"].eq("undecided") & ~found["remark"].fillna("").str.startswith(WOULD_BE)
    going = still & found.index.isin(lasting(ledger, found).index)
    asked = [cell for case, is_open in zip(_questions(ledger), going, strict=True) if is_open and case
             for cell in _cells(case, table)]  # fmt: skip
    return {called[cell] for cell in asked}


def _questions(ledger: Ledger) -> Iterator[Case | None]:
    """The cases in the order of the rows of `judge`; None for a claim that cannot be tested."""
    for claim in ledger.claims:
        for _, read in variants(claim, ledger):
            yield from cases(read) if KINDS[claim.kind].judge else [None]


def _cells(case: Case, table: TrialTable) -> list[tuple[str, str]]:
    try:
        scenarios = [s for label in case.scenarios for s in table.matching(label)]
    except Missing:
        return []
    return [(canonical(s), canonical(e)) for s, e in product(scenarios, (case.of, *case.than))]
