"""Best estimators, over-confident ones and changes over a sweep, in sentences made from the numbers alone.

Best is the smallest RMSE of those that qualify (`ranking.disqualifications`). Another one ties with it where the
equivalence test says so, or where the 95 % interval of the paired change holds 0; in a run until decided, the
confidence sequence takes the place of both. An estimator is best alone if the intervals against all others exclude 0,
an intersection-union test that needs no adjustment (Berger 1982).
"""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.claims.trial_table import Missing, TrialTable
from cooploc.analysis.formats import change, interval, join_words, metres, percent, ratio
from cooploc.analysis.metrics.consistency import OVER_CONFIDENT
from cooploc.analysis.metrics.ranking import disqualifications, missing_checks
from cooploc.analysis.metrics.statistics import FIXED, LEAST_TRIALS, MARGIN, Interval, Stopping
from cooploc.analysis.metrics.sweeps import sweeps
from cooploc.estimators.errors import count_of

NAMED = 3  # names in a sentence; of more the first ones, and how many others there are
FEW = 6  # estimators; a sentence gives the change of each, of more only their range, of twice as many no names
UNKNOWN = Interval(np.nan, np.nan, np.nan)


class Standing(NamedTuple):
    """The best estimator of one scenario, and those that tie with it or do not qualify."""

    scenario: str
    best: str  # the smallest RMSE of those that qualify; empty where none does
    trials: int
    able: int  # how many qualify
    barred: tuple[str, ...]  # as accurate or more, and why they do not qualify
    rmse: Interval = UNKNOWN  # [m] of the best
    anees: Interval = UNKNOWN  # of the best
    equal: tuple[str, ...] = ()  # RMSE within `MARGIN` of the best, by the equivalence test
    tied: tuple[str, ...] = ()  # others that do not differ from the best significantly
    next: str = ""  # the next smallest RMSE of those that qualify
    lead: Interval = UNKNOWN  # change of RMSE from the next to the best
    unchecked: str = ""  # what the certificate of the best one lacks

    @property
    def word(self) -> str:
        """The standing of the smallest RMSE, in a word or two."""
        if not self.best:
            return "none"
        return "tie" if not self.is_alone else "best" if self.able > 1 else "the only one"

    @property
    def is_alone(self) -> bool:
        """Whether no other ties with the best."""
        return bool(self.best) and not self.equal and not self.tied


class SweepChange(NamedTuple):
    """Change of an estimator's RMSE from the first to the last value of a sweep, as a share."""

    estimator: str
    first: float  # RMSE [m]
    last: float
    share: Interval
    trials: int


def standings(table: pd.DataFrame, results: TrialTable) -> list[Standing]:
    """Return the standing of each scenario, from `compare` and `collect`."""
    return [_find_standing(str(scenario), part, results) for scenario, part in table.groupby("scenario", sort=False)]


def _find_standing(scenario: str, part: pd.DataFrame, results: TrialTable) -> Standing:
    trials = int(part["trials"].max())
    rows = part[part["rmse"].notna()].sort_values("rmse", kind="stable").to_dict("records")
    may = [row for row in rows if not disqualifications(row)]
    barred = [row for row in rows if disqualifications(row)]
    if not may or len(rows) < 2:
        return Standing(scenario, "", trials, len(may), tuple(map(_name_with_reasons, barred)))
    best, *others = may
    found: dict[str, list[str]] = {"equal": [], "tied": []}
    lead = UNKNOWN
    for row in others:
        first, other = results.mse((scenario, best["estimator"]), (scenario, row["estimator"])).T
        if row is others[0]:
            lead = results.stopping.change(other, first)
        if results.stopping.equal(first, other):
            found["equal"].append(row["estimator"])
        elif not results.stopping.change(first, other).low > 0:
            found["tied"].append(row["estimator"])
    return Standing(
        scenario,
        best["estimator"],
        trials,
        len(may),
        tuple(_name_with_reasons(row) for row in barred if row["rmse"] <= best["rmse"]),
        rmse=Interval(best["rmse"], best["rmse_low"], best["rmse_high"]),
        anees=FIXED.mean_of_positive(results.anees((scenario, best["estimator"]))),
        equal=tuple(found["equal"]),
        tied=tuple(found["tied"]),
        next=others[0]["estimator"] if others else "",
        lead=lead,
        unchecked=missing_checks(best["certificate"]),
    )


def _name_with_reasons(row: dict[Any, Any]) -> str:
    """Return an estimator, and why it does not qualify, with its ANEES where that is the reason."""
    anees = f", ANEES {ratio(row['anees'])}"
    reasons = [one + anees * one.endswith(("over-confident", "over-wide")) for one in disqualifications(row)]
    return f"{row['estimator']} ({', '.join(reasons)})"


def summary_sentence(one: Standing) -> str:
    """Return a standing in words."""
    if one.trials < LEAST_TRIALS:
        return f"Not assessed: {count_of(one.trials, 'trial')}, and it takes {LEAST_TRIALS}."
    if not one.best:
        return f"No estimator qualifies: {capped_list(one.barred) or 'there is nothing to compare'}."
    barred = f" As accurate or more, but does not qualify: {capped_list(one.barred)}." if one.barred else ""
    barred += f" {one.best} {one.unchecked}." * bool(one.unchecked)
    rmse = f"{metres(one.rmse.value)} m ({interval(metres)(one.rmse.low, one.rmse.high)})"
    rmse += f", ANEES {ratio(one.anees.value)} ({interval(ratio)(one.anees.low, one.anees.high)})"
    rmse += ", which leaves open whether it is over-confident" if one.anees.value > OVER_CONFIDENT else ""
    if one.able == 1:
        return f"{one.best} is the only one that qualifies: RMSE {rmse}.{barred}"
    if one.is_alone:
        lead = f"{_lead(one)} below that of the next that qualifies, {one.next}"
        return f"{one.best} is best: RMSE {rmse}, {lead}.{barred}"
    ties = [f"no significant difference: {capped_list(one.tied)}"] if one.tied else []
    ties += [f"equal to it within {100 * MARGIN:.0f} %: {capped_list(one.equal)}"] if one.equal else []
    return f"A tie: {one.best} has the lowest RMSE of those that qualify, {rmse}; {'; '.join(ties)}.{barred}"


def _lead(one: Standing) -> str:
    """Return by how much the best is below the next, with its interval."""
    return f"{percent(-one.lead.value)} ({interval(percent)(-one.lead.high, -one.lead.low)})"


WORDS = ["no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"]


def in_words(number: int) -> str:
    """Return a whole number up to twelve as a word, a larger one in digits."""
    return WORDS[number] if number < len(WORDS) else str(number)


def capped_list(names: Iterable[str]) -> str:
    """Return names in a sentence; of many the first ones, and how many others there are."""
    names = list(names)
    if len(names) > NAMED + 1:
        return f"{', '.join(names[:NAMED])} and {len(names) - NAMED} others"
    return join_words(names) if names else ""


# ------------------------------------------------------------------------------------------------ a report's answer


def best_honest(found: list[Standing], table: pd.DataFrame) -> str:
    """Return which estimator is best in how many scenarios, its error and its lead, and with what it ties elsewhere."""
    if table["rmse"].isna().all():
        return "Every trial failed: failures below say why."
    if all(one.trials < LEAST_TRIALS for one in found):
        trials = count_of(int(table["trials"].max()), "trial")
        return f"Nothing is separable with {trials}, it takes {LEAST_TRIALS}."
    if len(found) == 1:
        return summary_sentence(found[0])
    wins: dict[str, list[Standing]] = {}
    for one in found:
        if one.is_alone and one.able > 1:
            wins.setdefault(one.best, []).append(one)
    best = sorted(wins, key=lambda name: -len(wins[name]))[: 1 + NAMED]
    first = next(iter(best), "")
    ties = [one for one in found if one.best and not one.is_alone]
    mine = [one for one in ties if first in (one.best, *one.equal, *one.tied)]
    parts = [
        f"{name}, in {_of(len(wins[name]), len(found))} scenarios ({_size_and_lead(wins[name])})" for name in best[:1]
    ]
    parts += [f"{name} in {in_words(len(wins[name]))} ({_size_and_lead(wins[name])})" for name in best[1:]]
    for some, words in ((mine, "it ties with {}"), ([one for one in ties if one not in mine], "{} tie")):
        names = [name for one in some for name in (one.best, *one.equal, *one.tied) if name != first]
        known = capped_list(dict.fromkeys(names)) if some else ""
        parts += [f"in {_of(len(some), len(found)).partition(' of ')[0]} {words.format(known)}"] * bool(some)
    single, none = sum(one.is_alone and one.able == 1 for one in found), sum(not one.best for one in found)
    parts += [f"in {in_words(single)} only one is honest"] * bool(single)
    parts += [f"in {in_words(none)} none is"] * bool(none)
    alone = "Best honest estimator" if first else "No honest estimator stands out"
    return f"{alone}: {'; '.join(parts)}."


def _size_and_lead(wins: list[Standing]) -> str:
    """Return the error of the best in some scenarios, and by how much at least it is below that of the next."""
    errors, least = sorted(one.rmse.value for one in wins), max(wins, key=lambda one: one.lead.value)
    size = f"{metres(errors[0])} m" if len(wins) == 1 else f"{interval(metres)(errors[0], errors[-1])} m"
    return f"{size}, {'at least ' * (len(wins) > 1)}{_lead(least)} below {least.next}"


def _of(number: int, every: int) -> str:
    if number == every:
        return "both" if every == 2 else f"all {in_words(every)}"
    return f"{in_words(number)} of {in_words(every)}"


def over_confident_estimators(table: pd.DataFrame) -> str:
    """Return which estimators are over-confident, in how many scenarios, and by how much in the median trial."""
    assessed = table[table["consistency"] != "not assessed"]
    if assessed.empty:
        return f"Consistency is not assessed: that takes {LEAST_TRIALS} trials."
    over = assessed[assessed["consistency"] == "over-confident"]
    doubt = assessed[(assessed["consistency"] == "not shown") & (assessed["anees"] > OVER_CONFIDENT)]
    open_ = [str(e) for e in dict.fromkeys(doubt["estimator"]) if e not in set(over["estimator"])]
    left = f"; consistency is not shown for {capped_list(open_)}" if open_ else ""
    if over.empty:
        return f"No estimator was found over-confident{left}."
    counts = Counter(over["estimator"])
    names = capped_list(f"{name} in {count_of(n, 'scenario')}" for name, n in counts.items())
    if len(set(counts.values())) == 1 and len(counts) > 1:  # said once
        names = f"{capped_list(counts)}, each in {count_of(next(iter(counts.values())), 'scenario')}"
    one = over.sort_values("anees_median", na_position="first").iloc[-1]
    most = f"the squared errors of {one['estimator']} are {ratio(one['anees_median'])} times as large as it states"
    return f"Over-confident: {names}; {most} (median trial of {one['scenario']}){left}."


# ------------------------------------------------------------------------------------------------ a sweep


class Sweep(NamedTuple):
    """The first and last value of a parameter, and the (scenario, estimator) that has each, by the name to show."""

    about: str  # the scenario, or a family of scenarios
    parameter: str
    low: float
    high: float
    ends: dict[str, tuple[tuple[str, str], tuple[str, str]]]


def sweep_of_scenarios(scenarios: list[str], estimators: Iterable[str]) -> Sweep:
    """Return a sweep of scenarios, of these estimators."""
    points = sweeps(scenarios)
    first, *_, last = sorted(scenarios, key=lambda label: points[label].value)
    ends = {name: ((first, name), (last, name)) for name in estimators}
    return Sweep(*points[first], points[last].value, ends)


def sweep_of_estimators(scenario: str, swept: pd.DataFrame) -> Sweep:
    """Return the sweep of one parameter, by rows of `add_sweep` in a scenario, of those that ran at both ends."""
    low, high = swept["value"].min(), swept["value"].max()
    named = {(row["family"], row["value"]): (scenario, row["estimator"]) for row in swept.to_dict("records")}
    both = [name for name in swept["family"].unique() if {(name, low), (name, high)} <= named.keys()]
    ends = {name: (named[name, low], named[name, high]) for name in both}
    return Sweep(scenario, swept["parameter"].iloc[0], low, high, ends)


def changes_over_sweep(sweep: Sweep, results: TrialTable) -> list[SweepChange]:
    """Return how the RMSE changes over a sweep, paired by trial, of every estimator that ran at both ends."""
    out = []
    for name, ends in sweep.ends.items():
        try:
            values = results.mse(*ends)
        except Missing:
            continue
        logs = results.stopping.log_contrast(values, np.array([-0.5, 0.5]))
        first, last = (float(v) for v in np.sqrt(values.mean(0))) if len(values) else (np.nan, np.nan)
        out.append(SweepChange(name, first, last, Interval(*(float(np.expm1(end)) for end in logs)), len(values)))
    return out


DIRECTIONS: dict[str, Callable[[Interval], bool]] = {  # words -> whether an interval says so
    "it grows": lambda share: share.low > 0,
    "it falls": lambda share: share.high < 0,
    "no significant change": lambda share: share.low <= 0 <= share.high and share.low < share.high,
    "equal errors": lambda share: share.low == share.high == 0,
}


def sweep_sentence(sweep: Sweep, found: list[SweepChange], stopping: Stopping = FIXED) -> str:
    """Return the changes over a sweep in words; where the interval holds 0, no significant change."""
    judged = "95 % intervals" if stopping is FIXED else "confidence sequences"
    parts = []
    for words, holds in DIRECTIONS.items():
        if not (some := [one for one in found if holds(one.share)]):
            continue
        names = [one.estimator for one in some]
        listed = join_words(names) if len(names) <= 2 * FEW else f"{len(names)} estimators"
        if words.startswith("it") and len(some) <= FEW:
            ends = [interval(change)(one.share.low, one.share.high) for one in some]
            sizes = [change(one.share.value) for one in some]
            listed = join_words(f"{n} ({size}, {both})" for n, size, both in zip(names, sizes, ends, strict=True))
        elif words.startswith("it"):
            least, *_, most = sorted(abs(one.share.value) for one in some)
            listed += f" (by {interval(percent)(least, most)})"
        parts.append(f"{words} for {listed}")
    about = f"{sweep.about}: RMSE from {sweep.parameter} = {sweep.low:g} to {sweep.high:g} ({judged}, unadjusted)"
    return f"{about}: {'; '.join(parts)}." if parts else ""
