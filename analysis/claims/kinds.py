"""The kinds of claims: which keys one takes in a ledger, which cases it comes down to, and how a case is judged.

To add a kind, write a function from a case to its `Finding` and list it in `KINDS` (and its words in `wording.WORDS`).
A change is relative, b/a - 1: negative where the error, or the time, is smaller. Trials of two scenarios are paired by
their number: pairs are independent of each other whether or not the two of a pair are correlated (scenarios of one seed
share some of their random numbers), so this is right in either case.
"""

from collections.abc import Callable, Sequence
from collections.abc import Set as AbstractSet
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy import stats

from cooploc.analysis.claims import zones
from cooploc.analysis.claims.claim import Claim
from cooploc.analysis.claims.trial_table import Missing, TrialTable
from cooploc.analysis.claims.zones import Finding, Zones, decide, p_above
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.statistics import Interval


class Case(NamedTuple):
    """One question that a claim comes down to."""

    of: str
    than: tuple[str, ...]
    scenarios: tuple[str, ...]
    definition: str = ""  # of the size: change or ratio


Judge = Callable[[Case, Claim, TrialTable], Finding]


class Kind(NamedTuple):
    """How a kind of claim is written and judged."""

    judge: Judge | None  # None: it cannot be tested
    scenarios: str  # of a case: "each" one, the first with each "later" one, or "all" (a range is possible)
    needs: AbstractSet[str]  # keys in the ledger
    may: AbstractSet[str] = frozenset()


def cases(claim: Claim) -> list[Case]:
    """The questions that a claim comes down to, each on its own."""
    one_by_one: Sequence[tuple[str, ...]] = [(name,) for name in claim.than] or [()]
    where: dict[str, Sequence[tuple[str, ...]]] = {
        "each": [(label,) for label in claim.scenarios],
        "later": [(claim.scenarios[0], label) for label in claim.scenarios[1:]],
        "all": [claim.scenarios],
    }
    than = [claim.than] if claim.kind == "all" else one_by_one
    sized = "definitions" in KINDS[claim.kind].may and claim.size is not None
    definitions: Sequence[str] = claim.definitions if sized else ("",)
    return [
        Case(of, other, s, d)
        for s, of, other, d in product(where[KINDS[claim.kind].scenarios], claim.of, than, definitions)
    ]


def claimed(claim: Claim, definition: str) -> float:
    """The size of a claim; one that is a ratio, such as "66 % better" for a/b = 1.66, as the change b/a - 1."""
    size = np.nan if claim.size is None else claim.size
    return _as_change(size) if definition == "ratio" else size


def _as_change(ratio: float) -> float:
    return 1 / (1 - ratio) - 1


def _change(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """By how much the RMSE of `of` differs from that of `than` in a scenario (Fieller).

    Of a size below 0: supported below size + margin; direction only between size and 0; contradicted above 0. Of a size
    above 0 the mirror image. Without a size: supported below 0; contradicted above.
    """
    (scenario,), (than,) = case.scenarios, case.than
    pairs = table.mse((scenario, than), (scenario, case.of))
    return decide(statistics.change(*pairs.T), len(pairs), _zones(case, claim))


def _trend(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """By how much the RMSE of `of` changes from the first scenario to each later one; zones as of a change."""
    first, later = case.scenarios
    pairs = table.mse((first, case.of), (later, case.of))
    return decide(statistics.change(*pairs.T), len(pairs), _zones(case, claim))


def _all(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """`of` is better than every `than` in every scenario. The number is the weakest case.

    Supported where every change is below 0, an intersection-union test that needs no adjustment (Berger 1982);
    contradicted where one of them is above 0 after Holm over all of them.
    """
    labels = list(product(case.scenarios, case.than))
    pairs = [table.mse((scenario, than), (scenario, case.of)) for scenario, than in labels]
    return zones.decide_all(pairs, labels, zones.FALLS, [p_above(a, b, 1.0) for a, b in (p.T for p in pairs)])


def _same(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """From the first scenario to every later one the RMSE changes by less than a factor 1 + margin.

    Supported where all intervals lie within; contradicted where one lies outside after Holm. Each is compared with the
    first and not with the one before, for small steps may add up. The number is the largest change.
    """
    first, *later = case.scenarios
    if not later:
        raise Missing(f"only {first} was run; it needs another scenario to be compared with")
    pairs = [table.mse((first, case.of), (scenario, case.of)) for scenario in later]
    top, low, high = (1 + claim.margin) ** 2, -claim.margin / (1 + claim.margin), claim.margin
    within = ("supported", low, high), ("contradicted", -np.inf, low), ("contradicted", high, np.inf)
    outside = [min(p_above(a, b, top), p_above(b, a, top)) for a, b in (p.T for p in pairs)]
    return zones.decide_all(pairs, [(scenario, "") for scenario in later], within, outside)


def _growth(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """By how much the RMSE grows per unit of what is swept, from the slope of its logarithm (jackknife).

    Supported above 0; contradicted below 0.
    """
    if len(case.scenarios) < 3:
        raise Missing(f"growth needs three scenarios, the run has {', '.join(case.scenarios)}")
    x = np.array([table.swept(scenario) for scenario in case.scenarios])
    values = table.mse(*((scenario, case.of) for scenario in case.scenarios))
    away = x - x.mean()
    slope = statistics.log_contrast(values, away / (away**2).sum() / 2)
    return decide(slope, len(values), zones.GROWS)._replace(interval=_relative(slope))


def _interaction(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """The error of `of` grows by a larger factor than that of `than`, from the first scenario to each later one.

    Jackknife on the ratio of ratios, minus 1: supported above 0; contradicted below 0.
    """
    (first, later), (than,) = case.scenarios, case.than
    values = table.mse((later, case.of), (first, case.of), (later, than), (first, than))
    more = statistics.log_contrast(values, np.array([1, -1, -1, 1]) / 2)
    return decide(more, len(values), zones.GROWS)._replace(interval=_relative(more))


def _level(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """RMSE [m]: supported up to size; contradicted above."""
    (scenario,) = case.scenarios
    values = table.mse((scenario, case.of))[:, 0]
    rmse = Interval(*(float(np.sqrt(end)) for end in statistics.mean_of_positive(values)))
    return decide(rmse, len(values), zones.at_most(claim.size or 0.0))


def _slope(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """Exponent of seconds per robot and tick over the number of robots, least squares over the scenarios.

    Supported up to size + margin; contradicted above. Trials are sizes of the team here.
    """
    seconds = [table.seconds((scenario, case.of))[:, 0] for scenario in case.scenarios]
    x = np.log([table.robots(scenario) for scenario in case.scenarios])
    if len(set(x)) < statistics.LEAST_TRIALS:
        raise Missing(f"a slope needs teams of five sizes, the run has {len(set(x))}")
    fit = stats.linregress(x, np.log([s.mean() for s in seconds]))
    half = float(stats.t.ppf(1 - zones.ALPHA, len(x) - 2) * fit.stderr)
    interval = Interval(float(fit.slope), float(fit.slope) - half, float(fit.slope) + half)
    found = decide(interval, len(x), zones.at_most((claim.size or 0.0) + claim.margin))
    return found._replace(needed=np.nan)  # more trials add no sizes


def _cost(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """By how much the time of `of` differs from that of `than`; zones as of a change.

    Here a trial is not the unit but a part of the run, the trials whose time was taken together.
    """
    (scenario,), (than,) = case.scenarios, case.than
    logs = np.log(table.seconds((scenario, case.of), (scenario, than)))
    found = decide(_relative(statistics.mean(logs[:, 0] - logs[:, 1])), len(logs), _zones(case, claim))
    return found._replace(needed=found.needed * table.trials((scenario, case.of)) / len(logs))


def _relative(logs: Interval) -> Interval:
    """From a difference of logarithms to a relative change."""
    return Interval(*(float(np.expm1(end)) for end in logs))


def _zones(case: Case, claim: Claim) -> Zones:
    if claim.size is None:
        return zones.FALLS
    least = claim.size - float(np.copysign(claim.margin, claim.size))
    return zones.of_size(claimed(claim, case.definition), _as_change(least) if case.definition == "ratio" else least)


RELATIVE = ("change", "trend", "cost")  # kinds whose size is a relative change
_SIZED = {"size", "margin"}
KINDS = {
    "change": Kind(_change, "each", {"of", "than", "scenarios"}, {*_SIZED, "definitions"}),
    "trend": Kind(_trend, "later", {"of", "scenarios"}, {*_SIZED, "definitions"}),
    "all": Kind(_all, "all", {"of", "than", "scenarios"}),
    "same": Kind(_same, "all", {"of", "scenarios", "margin"}),
    "growth": Kind(_growth, "all", {"of", "scenarios"}),
    "interaction": Kind(_interaction, "later", {"of", "than", "scenarios"}),
    "level": Kind(_level, "each", {"of", "scenarios", "size"}),
    "slope": Kind(_slope, "all", {"of", "scenarios", "size"}, {"margin"}),
    "cost": Kind(_cost, "each", {"of", "than", "scenarios"}, _SIZED),
    "untestable": Kind(None, "each", {"why"}),
}
