"""The kinds of claims: which keys one takes in a ledger, and which cases it comes down to.

To add a kind, write a function from a case to its `Finding` in `judges.py` and list it in `KINDS` (and its words in
`wording.WORDS`).
"""

from collections.abc import Callable, Sequence
from collections.abc import Set as AbstractSet
from itertools import product
from typing import NamedTuple

from cooploc.analysis.claims import judges
from cooploc.analysis.claims.claim import Case, Claim
from cooploc.analysis.claims.trial_table import TrialTable
from cooploc.analysis.claims.zones import Finding

Judge = Callable[[Case, Claim, TrialTable], Finding]


class Kind(NamedTuple):
    """How a kind of claim is written and judged."""

    judge: Judge | None  # None: it cannot be tested
    scenarios: str  # of a case: "each" one, the first with each "later" one, or "all" (a range is possible)
    needs: AbstractSet[str]  # keys in the ledger
    may: AbstractSet[str] = frozenset()


def definitions(claim: Claim) -> Sequence[str]:
    """How the size of a claim can be read, the one that it is judged by first; none without a size."""
    sized = "definitions" in KINDS[claim.kind].may and claim.size is not None
    return claim.definitions if sized else ("",)


def cases(claim: Claim) -> list[Case]:
    """The questions that a claim comes down to, each on its own, by the first definition of its size."""
    one_by_one: Sequence[tuple[str, ...]] = [(name,) for name in claim.than] or [()]
    where: dict[str, Sequence[tuple[str, ...]]] = {
        "each": [(label,) for label in claim.scenarios],
        "later": [(claim.scenarios[0], label) for label in claim.scenarios[1:]],
        "all": [claim.scenarios],
    }
    than = [claim.than] if claim.kind == "all" else one_by_one
    definition = definitions(claim)[0]
    return [
        Case(of, other, s, definition) for s, of, other in product(where[KINDS[claim.kind].scenarios], claim.of, than)
    ]


RELATIVE = ("change", "trend", "cost")  # kinds whose size is a relative change
_SIZED = {"size", "margin"}
KINDS = {
    "change": Kind(judges.change, "each", {"of", "than", "scenarios"}, {*_SIZED, "definitions"}),
    "trend": Kind(judges.trend, "later", {"of", "scenarios"}, {*_SIZED, "definitions"}),
    "all": Kind(judges.every, "all", {"of", "than", "scenarios"}),
    "same": Kind(judges.same, "all", {"of", "scenarios", "margin"}),
    "growth": Kind(judges.growth, "all", {"of", "scenarios"}, {"margin"}),
    "interaction": Kind(judges.interaction, "later", {"of", "than", "scenarios"}),
    "level": Kind(judges.level, "each", {"of", "scenarios", "size"}),
    "time": Kind(judges.time, "each", {"of", "scenarios", "size"}),
    "consistency": Kind(judges.consistency, "each", {"of", "scenarios"}),
    "slope": Kind(judges.slope, "all", {"of", "scenarios", "size"}, {"margin"}),
    "cost": Kind(judges.cost, "each", {"of", "than", "scenarios"}, _SIZED),
    "untestable": Kind(None, "each", {"why"}),
}
