"""The kinds of claims: the keys that each takes in a ledger, how a case of it is judged, and its words.

A claim comes down to one number with an interval over trials. Its verdict is the first whose zone of numbers holds the
whole interval, both ends included; without one it is undecided. Its p, by the test that the interval inverts, is that
of the zone that holds its number. A change is relative, b/a - 1: negative where the error, or the time, is smaller.
Trials of two scenarios are paired by their number, which is right whether or not the two of a pair are correlated.

To add a kind, write a function from a case to its `CaseVerdict` and list it in `KINDS`.
"""

from collections.abc import Callable, Sequence
from collections.abc import Set as AbstractSet
from functools import partial
from itertools import product
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import scipy
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from cooploc.analysis.claims.trial_table import Missing, TrialTable
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.consistency import LEAST_COVERAGE, OVER_CONFIDENT
from cooploc.analysis.metrics.sequential import trials_to_exclude
from cooploc.analysis.metrics.statistics import FIXED, Interval, Stopping
from cooploc.analysis.metrics.sweeps import sweeps
from cooploc.estimators import nearest
from cooploc.estimators.interface import Array
from cooploc.estimators.label_syntax import expand


def _write_out(given: Any) -> Any:
    """Return labels with a sweep {2,3} written out; a range {2..9} waits for what a run has of it."""
    labels = (given,) if isinstance(given, str) else given
    if not isinstance(labels, list | tuple) or not all(isinstance(one, str) for one in labels):
        return labels  # pydantic says what is wrong
    return tuple(one for label in labels for one in ([label] if ".." in label else expand(label)))


Labels = Annotated[tuple[str, ...], BeforeValidator(_write_out)]
ALWAYS = {"id", "says", "where", "quote", "kind", "open"}  # keys of every kind
Zones = tuple[tuple[str, float, float], ...]  # verdict, from, to
PValue = Callable[[float], float]  # two-sided p against a true value
FALLS: Zones = (("contradicted", 0.0, np.inf), ("supported", -np.inf, 0.0))  # no difference at all contradicts
GROWS: Zones = (("contradicted", -np.inf, 0.0), ("supported", 0.0, np.inf))
ALPHA = (1 - statistics.LEVEL) / 2  # one-sided, as an end of the interval


class LedgerTable(BaseModel):
    """A table of a ledger's file, which refuses unknown keys by the nearest known one."""

    model_config = ConfigDict(frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _knows_its_keys(cls, given: Any) -> Any:
        for key in [key for key in given if key not in cls.model_fields] if isinstance(given, dict) else ():
            raise ValueError(f"there is no key {key!r}; {nearest(key, list(cls.model_fields))}")
        return given


class Claim(LedgerTable):
    """A claim of a paper, as a ledger states it; `KINDS` says which keys its kind takes."""

    id: str
    says: str  # in our words
    where: str = ""  # in the paper
    quote: str = ""  # the paper's own words
    kind: str
    of: Labels = ()  # estimators the claim is about
    than: Labels = ()  # estimators they are compared with
    scenarios: Labels = ()
    size: float | None = None  # of a change: -0.66 is 66 % less, 0.5 is 50 % more; of a level [m]; of a slope
    also: tuple[float, ...] = ()  # other sizes of a level, of which the verdicts stand beside
    margin: Annotated[float, Field(gt=0)] = 0.05  # the size is met up to this; equal numbers lie within it
    # how a size of -0.66 can be read: as the change b/a - 1, or as the ratio a/b - 1; it is judged by the first
    definitions: Annotated[tuple[Literal["change", "ratio"], ...], Field(min_length=1)] = ("change", "ratio")
    open: tuple[str, ...] = ()  # conditions that the paper leaves open

    @model_validator(mode="after")
    def _fits_its_kind(self) -> "Claim":
        if self.kind not in KINDS:
            raise ValueError(f"there is no kind {self.kind!r}; {nearest(self.kind, list(KINDS))}")
        kind, given, this = KINDS[self.kind], self.model_fields_set, f"kind {self.kind!r}"
        takes = ", ".join(sorted(kind.needs | kind.may))
        for key in sorted(kind.needs - given):
            raise ValueError(f"{this} needs {key!r}: add it")
        for key in sorted(given - kind.needs - kind.may - ALWAYS):
            raise ValueError(f"{this} does not use {key!r}; it takes {takes}")
        for label in self.scenarios if kind.scenarios != "all" else ():
            if "{" in label:
                raise ValueError(f"{this} takes no range like {label!r}: list the values, {{1,2,3}}, or the scenarios")
        if kind.scenarios == "later" and len(self.scenarios) < 2:
            raise ValueError(f"{this} needs at least 2 scenarios: add some")
        if self.kind in RELATIVE and self.size is not None and self.size <= -1:
            raise ValueError(f"size {self.size:g} is no change of an error: write -0.5 for 50 % less")
        if self.kind in RELATIVE and self.size is not None and abs(self.size) <= self.margin:
            raise ValueError(f"size {self.size} is not beyond margin {self.margin}: make margin smaller")
        return self


class Case(NamedTuple):
    """A question that a claim comes down to."""

    of: str
    than: tuple[str, ...]
    scenarios: tuple[str, ...]
    definition: str = ""  # of the size: change or ratio


class CaseVerdict(NamedTuple):
    """A case's number and verdict."""

    interval: Interval
    trials: int
    verdict: str
    needed: float  # trials that would decide
    p: float  # of the verdict; nan without an interval
    scenario: str = ""  # of several, the one that the number is of
    than: str = ""


# ---- from an interval to a verdict


def decide(interval: Interval, n: int, zones: Zones, test: PValue) -> CaseVerdict:
    """Return the verdict on an interval over n trials, with its p by the test that the interval inverts."""

    def p_of_zone(low: float, high: float) -> float:  # both of its ends must be excluded (Berger 1982)
        return max((test(end) for end in (low, high) if np.isfinite(end)), default=0.0)

    for verdict, low, high in zones:
        if low <= interval.low and interval.high <= high:
            return CaseVerdict(interval, n, verdict, np.nan, p_of_zone(low, high))
    value = interval.value
    around = [(low, high) for _, low, high in zones if low <= value <= high]
    needed = [trials_to_exclude(interval, n, min(value - low, high - value)) for low, high in around]
    p = np.nan if np.isnan(interval.low) else min(p_of_zone(*ends) for ends in around)
    return CaseVerdict(interval, n, "undecided", min((v for v in needed if np.isfinite(v)), default=np.nan), p)


def decide_all(
    pairs: list[Array], labels: list[tuple[str, str]], zones: Zones, p: list[float], stopping: Stopping = FIXED
) -> CaseVerdict:
    """Return the verdict on several changes: supported where each is; contradicted where one is, after Holm over all.

    Each case has squared errors (trial, 2) before and after, the labels of its scenario and `than`, and its one-sided
    p, small where it contradicts the claim.
    """
    found = [decide(stopping.change(*x.T), len(x), zones, partial(stopping.p_of_change, *x.T)) for x in pairs]
    low, high = next(ends for verdict, *ends in zones if verdict == "supported")
    room = [min(f.interval.low - low, high - f.interval.high) for f in found]
    adjusted = statistics.holm(np.array(p))
    refuted = bool((adjusted < ALPHA).any())
    worst = int(np.nanargmin(adjusted)) if refuted else int(np.argmin(np.nan_to_num(room, nan=-np.inf)))
    scenario, than = labels[worst]
    needed, outside = np.nan, [f for f in found if not low <= f.interval.value <= high]
    for_all = float(np.max([1.0 if f in outside else f.p for f in found]))  # nan without an interval
    against = float(np.minimum(1.0, 2 * np.fmin.reduce(adjusted)))
    if all(f.verdict == "supported" for f in found):
        verdict, chance = "supported", for_all
    elif refuted:
        verdict, chance = "contradicted", against
    else:  # trials until one case is decided against the claim, also after Holm, or all are for it
        verdict, chance = "undecided", float(np.fmin(for_all, against))
        away = [(f, max(low - f.interval.value, f.interval.value - high)) for f in outside]
        against_it = [trials_to_exclude(f.interval, f.trials, distance, len(found)) for f, distance in away]
        for_it = [f.needed if f.verdict == "undecided" else f.trials for f in found]
        needed = float(np.fmin.reduce(against_it) if outside else np.max(for_it))
    return found[worst]._replace(verdict=verdict, needed=needed, p=chance, scenario=scenario, than=than)


# ---- how a case of each kind is judged


def size_as_change(size: float | None, definition: str) -> float:
    """Return a size as the change b/a - 1; a ratio is one such as "66 % better" for a/b = 1.66; nan: no size."""
    size = np.nan if size is None else size
    return 1 / (1 - size) - 1 if definition == "ratio" else size


def _zones_of_size(case: Case, claim: Claim) -> Zones:
    if claim.size is None:
        return FALLS
    least = claim.size - float(np.copysign(claim.margin, claim.size))
    size, least = (size_as_change(one, case.definition) for one in (claim.size, least))
    if size > 0:
        return ("contradicted", -np.inf, 0.0), ("supported", least, np.inf), ("direction only", 0.0, size)
    return ("contradicted", 0.0, np.inf), ("supported", -np.inf, least), ("direction only", size, 0.0)


def judge_change(case: Case, claim: Claim, table: TrialTable) -> CaseVerdict:
    """Judge by how much the RMSE of `of` differs from that of `than`, or from its own in the first scenario.

    Of a size below 0 (above: the mirror image): supported below size + margin; direction only between size and 0;
    contradicted above 0. Without a size: supported below 0; contradicted above.
    """
    first, last = case.scenarios[0], case.scenarios[-1]
    a, b = table.mse((first, (case.than or (case.of,))[0]), (last, case.of)).T
    zones = _zones_of_size(case, claim)
    return decide(table.stopping.change(a, b), len(a), zones, partial(table.stopping.p_of_change, a, b))


def judge_all(case: Case, claim: Claim, table: TrialTable) -> CaseVerdict:
    """Judge whether `of` is better than every `than` in every scenario. The number is the weakest case.

    Supported where every change is below 0, an intersection-union test that needs no adjustment (Berger 1982);
    contradicted where one of them is above 0 after Holm over all of them.
    """
    labels = list(product(case.scenarios, case.than))
    pairs = [table.mse((scenario, than), (scenario, case.of)) for scenario, than in labels]
    p = [table.stopping.p_above(a, b, 1.0) for a, b in (p.T for p in pairs)]
    return decide_all(pairs, labels, FALLS, p, table.stopping)


def judge_same(case: Case, claim: Claim, table: TrialTable) -> CaseVerdict:
    """Judge whether from the first scenario to every later one the RMSE changes by less than a factor 1 + margin.

    Supported where all intervals lie within; contradicted where one lies outside after Holm.
    """
    first, *later = case.scenarios
    if not later:
        raise Missing(f"only {first} was run; it needs another scenario to be compared with")
    pairs = [table.mse((first, case.of), (scenario, case.of)) for scenario in later]
    top, low, high = (1 + claim.margin) ** 2, -claim.margin / (1 + claim.margin), claim.margin
    within = ("supported", low, high), ("contradicted", -np.inf, low), ("contradicted", high, np.inf)
    above = table.stopping.p_above
    outside = [min(above(a, b, top), above(b, a, top)) for a, b in (p.T for p in pairs)]
    return decide_all(pairs, [(scenario, "") for scenario in later], within, outside, table.stopping)


def judge_growth(case: Case, claim: Claim, table: TrialTable) -> CaseVerdict:
    """Judge by how much the RMSE grows per unit of what is swept, from the slope of its logarithm (jackknife).

    Flat where the change over the whole sweep lies within a factor 1 + margin (two one-sided tests, Schuirmann 1987),
    whether or not it differs from nothing; else supported above 0, contradicted below 0.
    """
    if len(case.scenarios) < 3:
        raise Missing(f"growth needs three scenarios, the run has {', '.join(case.scenarios)}")
    points = sweeps(case.scenarios)
    x = np.array([points[scenario].value for scenario in case.scenarios])
    if not np.isfinite(x).all():
        raise Missing(f"{case.scenarios[int(np.argmin(np.isfinite(x)))]} sweeps no number")
    values = table.mse(*((scenario, case.of) for scenario in case.scenarios))
    away = x - x.mean()
    limit = float(np.log1p(claim.margin) / np.ptp(x))
    return _decide_contrast(values, away / (away**2).sum() / 2, (("flat", -limit, limit), *GROWS), table)


def judge_interaction(case: Case, claim: Claim, table: TrialTable) -> CaseVerdict:
    """Judge whether the error of `of` grows by a larger factor than that of `than`, from the first scenario to a later.

    Jackknife on the ratio of ratios, minus 1: supported above 0; contradicted below 0.
    """
    (first, later), (than,) = case.scenarios, case.than
    values = table.mse((later, case.of), (first, case.of), (later, than), (first, than))
    return _decide_contrast(values, np.array([1, -1, -1, 1]) / 2, GROWS, table)


def judge_level(case: Case, claim: Claim, table: TrialTable) -> CaseVerdict:
    """Judge the RMSE [m]: supported up to size; contradicted above."""
    values = table.mse((case.scenarios[0], case.of))[:, 0]
    rmse = Interval(*(float(np.sqrt(end)) for end in table.stopping.mean_of_positive(values)))
    return _decide_positive(rmse, len(values), claim.size or 0.0, table)


def judge_time(case: Case, claim: Claim, table: TrialTable) -> CaseVerdict:
    """Judge seconds per robot and tick, the mean over parts of the run: supported up to size; contradicted above.

    A run of few parts has no useful interval: then supported where ten times the slowest part is below the size.
    """
    key, size = (case.scenarios[0], case.of), claim.size or 0.0
    seconds = table.seconds(key)[:, 0]
    found = _decide_positive(table.stopping.mean_of_positive(seconds), len(seconds), size, table)
    if found.verdict == "undecided" and 10 * seconds.max() < size:
        return found._replace(verdict="supported", needed=np.nan)
    return found._replace(needed=found.needed * len(table.frame(key)) / len(seconds))


def judge_consistency(case: Case, claim: Claim, table: TrialTable) -> CaseVerdict:
    """Judge whether ANEES is at most 1.5, and the 95 % ellipse holds the truth as often as then.

    Supported where both intervals lie within; contradicted where one lies outside after Holm over the two. The number
    is the ANEES; where a few collapsed trials make its interval useless, coverage may decide.
    """
    key = (case.scenarios[0], case.of)
    values, inside = table.anees(key), table.values("coverage95", key)[:, 0]
    if not len(values):
        raise Missing(f"{case.of} has no covariance in {case.scenarios[0]}")
    anees = _decide_positive(table.stopping.mean_of_positive(values), len(values), OVER_CONFIDENT, table)
    covered = table.stopping.mean(inside)
    test = partial(table.stopping.p_of_mean, covered, len(inside))
    at_least: Zones = ("supported", LEAST_COVERAGE, np.inf), ("contradicted", -np.inf, LEAST_COVERAGE)
    coverage = decide(covered, len(inside), at_least, test)
    against = np.array([f.p if f.verdict == "contradicted" else np.nan for f in (anees, coverage)])
    refuted = float(np.fmin.reduce(2 * against))
    if refuted <= 1 - statistics.LEVEL:
        return anees._replace(verdict="contradicted", needed=np.nan, p=refuted)
    for_both = 1.0 if np.isfinite(refuted) else float(np.max([anees.p, coverage.p]))
    if anees.verdict == coverage.verdict == "supported":
        return anees._replace(p=for_both)
    return anees._replace(verdict="undecided", p=float(np.fmin(for_both, refuted)))


def judge_slope(case: Case, claim: Claim, table: TrialTable) -> CaseVerdict:
    """Judge the exponent of seconds per robot and tick over the number of robots, least squares over the scenarios.

    Supported up to size + margin; contradicted above. Trials are sizes of the team here.
    """
    seconds = [table.seconds((scenario, case.of))[:, 0] for scenario in case.scenarios]
    x = np.log([table.frame((scenario, case.of))["robots"].iloc[0] for scenario in case.scenarios])
    if len(set(x)) < statistics.LEAST_TRIALS:
        raise Missing(f"a slope needs teams of five sizes, the run has {len(set(x))}")
    fit = scipy.stats.linregress(x, np.log([s.mean() for s in seconds]))
    half = float(scipy.stats.t.ppf(1 - ALPHA, len(x) - 2) * fit.stderr)
    interval = Interval(float(fit.slope), float(fit.slope) - half, float(fit.slope) + half)

    def test(value: float) -> float:
        return float(2 * scipy.stats.t.sf(abs(fit.slope - value) / fit.stderr, len(x) - 2)) if fit.stderr > 0 else 0.0

    limit = (claim.size or 0.0) + claim.margin
    up_to: Zones = ("supported", -np.inf, limit), ("contradicted", limit, np.inf)
    found = decide(interval, len(x), up_to, test)
    return found._replace(needed=np.nan)  # more trials add no sizes


def judge_cost(case: Case, claim: Claim, table: TrialTable) -> CaseVerdict:
    """Judge by how much the time of `of` differs from that of `than`; zones as of a change.

    Here a trial is not the unit but a part of the run, the trials whose time was taken together.
    """
    (scenario,), (than,) = case.scenarios, case.than
    key = (scenario, case.of)
    logs = np.log(table.seconds(key, (scenario, than)))
    interval = table.stopping.mean(logs[:, 0] - logs[:, 1])
    test = partial(table.stopping.p_of_mean, interval, len(logs))
    change = Interval(*(float(np.expm1(end)) for end in interval))
    found = decide(change, len(logs), _zones_of_size(case, claim), lambda value: test(float(np.log1p(value))))
    return found._replace(needed=found.needed * len(table.frame(key)) / len(logs))


def judge_traffic(case: Case, claim: Claim, table: TrialTable) -> CaseVerdict:
    """Judge by how much the bytes sent by `of` differ from those of `than`: supported up to 0; contradicted above."""
    (scenario,), (than,) = case.scenarios, case.than
    sent, other = table.values("bytes", (scenario, case.of), (scenario, than)).T  # of the trials that both have
    values = other**2, sent**2  # `change` is of their roots
    zones: Zones = ("supported", -np.inf, 0.0), ("contradicted", 0.0, np.inf)
    return decide(table.stopping.change(*values), len(sent), zones, partial(table.stopping.p_of_change, *values))


def _decide_contrast(values: Array, weights: Array, zones: Zones, table: TrialTable) -> CaseVerdict:
    """Return the verdict on a contrast of logarithms, which is then written as a relative change."""
    logs, n = table.stopping.log_contrast(values, weights), len(values)
    found = decide(logs, n, zones, partial(table.stopping.p_of_mean, logs, n))
    return found._replace(interval=Interval(*(float(np.expm1(end)) for end in logs)))


def _decide_positive(interval: Interval, n: int, limit: float, table: TrialTable) -> CaseVerdict:
    """Return the verdict on a positive number that is claimed not to be above a limit; tested on its logarithm."""
    logs = Interval(*np.log(interval))
    up_to: Zones = ("supported", -np.inf, limit), ("contradicted", limit, np.inf)
    return decide(interval, n, up_to, lambda value: table.stopping.p_of_mean(logs, n, float(np.log(value))))


# ---- the kinds


class Kind(NamedTuple):
    """A kind of claim: its judge, its keys in a ledger, and its words."""

    judge: Callable[[Case, Claim, TrialTable], CaseVerdict]
    scenarios: str  # of a case: "each" one, the first with each "later" one, or "all" (a range is possible)
    needs: AbstractSet[str]  # keys in the ledger
    may: AbstractSet[str] = frozenset()
    words: str = ""  # {} is the number without a sign; of [more/less] the first where it is not below 0
    unit: str | None = None  # None: a relative change
    over: str = "trials"  # what the number is a mean over


def definitions(claim: Claim) -> Sequence[str]:
    """Return the ways to read the size of a claim, the one that it is judged by first; none without a size."""
    sized = "definitions" in KINDS[claim.kind].may and claim.size is not None
    return claim.definitions if sized else ("",)


def cases(claim: Claim) -> list[Case]:
    """Return the questions that a claim comes down to, each on its own, by the first definition of its size."""
    first, *later = claim.scenarios or ("",)
    where: dict[str, list[tuple[str, ...]]] = {
        "each": [(label,) for label in claim.scenarios],
        "later": [(first, label) for label in later],
        "all": [claim.scenarios],
    }
    one_by_one: list[tuple[str, ...]] = [(name,) for name in claim.than]
    than = [claim.than] if claim.kind == "all" else one_by_one or [()]
    scenarios, definition = where[KINDS[claim.kind].scenarios], definitions(claim)[0]
    return [Case(of, other, s, definition) for s, of, other in product(scenarios, claim.of, than)]


RELATIVE = ("change", "trend", "cost")  # kinds whose size is a relative change
TIMED = ("time", "slope", "cost")  # kinds of claims about computing time
_SIZED = {"size", "margin"}
_PARTS = "parts of the run"
KINDS = {
    "change": Kind(
        judge_change, "each", {"of", "than", "scenarios"}, {*_SIZED, "definitions"},
        "the RMSE of {of} is {} [higher/lower] than that of {than}",
    ),
    "trend": Kind(
        judge_change, "later", {"of", "scenarios"}, {*_SIZED, "definitions"}, "the RMSE of {of} [grows/falls] by {}"
    ),
    "all": Kind(
        judge_all, "all", {"of", "than", "scenarios"}, set(),
        "the [worst/narrowest] case: the RMSE of {of} is {} [higher/lower] than that of {than}",
    ),
    "same": Kind(
        judge_same, "all", {"of", "scenarios", "margin"}, set(),
        "the largest change: the RMSE of {of} [grows/falls] by {}",
    ),
    "growth": Kind(
        judge_growth, "all", {"of", "scenarios"}, {"margin"},
        "the RMSE of {of} [grows/falls] by {} for each further unit of what is swept",
    ),
    "interaction": Kind(
        judge_interaction, "later", {"of", "than", "scenarios"}, set(),
        "the RMSE of {of} grows by a factor {} [larger/smaller] than that of {than}",
    ),
    "level": Kind(judge_level, "each", {"of", "scenarios", "size"}, {"also"}, "the RMSE of {of} is {}", " m"),
    "time": Kind(
        judge_time, "each", {"of", "scenarios", "size"}, set(),
        "the computing time of {of} per robot and tick is {}", " ms", _PARTS,
    ),
    "consistency": Kind(judge_consistency, "each", {"of", "scenarios"}, set(), "the ANEES of {of} is {}", ""),
    "slope": Kind(
        judge_slope, "all", {"of", "scenarios", "size"}, {"margin"},
        "the seconds of {of} per robot and tick grow with the number of robots to the power {}", "", "sizes",
    ),
    "cost": Kind(
        judge_cost, "each", {"of", "than", "scenarios"}, _SIZED,
        "{of} takes {} [more/less] time than {than}", over=_PARTS,
    ),
    "traffic": Kind(
        judge_traffic, "each", {"of", "than", "scenarios"}, set(), "{of} sends {} [more/less] bytes than {than}"
    ),
}  # fmt: skip
