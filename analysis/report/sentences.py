"""Who is best where and who is over-confident, in sentences made from the numbers alone.

Best is the smallest RMSE of those that qualify: distributed, not over-wide, not over-confident nor probably so (ANEES
above twice the limit, with an interval that does not exclude it), no trial and no check failed. Another one ties with
it where the equivalence test says so, or where the 95 % interval of the paired change holds 0; in a run until decided,
the confidence sequence takes the place of both. An estimator is best alone if the intervals against all others exclude
0, an intersection-union test that needs no adjustment (Berger 1982).
"""

from collections import Counter
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.claims.trial_table import Missing, TrialTable
from cooploc.analysis.formats import change, counted, interval, listed, metres, percent, ratio
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import MARGIN
from cooploc.analysis.metrics.consistency import OVER_CONFIDENT
from cooploc.analysis.metrics.curves import sweep
from cooploc.analysis.metrics.ranking import disqualifications
from cooploc.analysis.metrics.sequential import FIXED, Stopping

FEW = 6  # estimators; a sentence gives the number of each, of more only their range, of twice as many no names


class Standing(NamedTuple):
    """What can be said of one scenario."""

    scenario: str
    best: str  # the smallest RMSE of those that qualify; empty where none does
    rmse: statistics.Interval  # [m] of it
    anees: statistics.Interval  # of it
    equal: tuple[str, ...]  # RMSE within `MARGIN` of it, by the equivalence test
    tied: tuple[str, ...]  # others that do not differ from it significantly
    barred: tuple[str, ...]  # as accurate or more, and why they do not qualify
    able: int  # how many qualify
    trials: int
    unchecked: bool = False  # whether the best one lacks a certificate

    @property
    def word(self) -> str:
        """The standing of the smallest RMSE, in a word or two."""
        if not self.best:
            return "none"
        return "tie" if not self.alone else "best" if self.able > 1 else "the only one"

    @property
    def alone(self) -> bool:
        """Whether no other ties with the best."""
        return bool(self.best) and not self.equal and not self.tied


class Change(NamedTuple):
    """How the RMSE of an estimator changes from the first to the last scenario of a sweep, as a share."""

    estimator: str
    first: float  # RMSE [m]
    last: float
    share: statistics.Interval
    trials: int


def standings(table: pd.DataFrame, results: TrialTable) -> list[Standing]:
    """One per scenario, from `compare` and `collect`."""
    return [_standing(str(scenario), part, results) for scenario, part in table.groupby("scenario", sort=False)]


def _standing(scenario: str, part: pd.DataFrame, results: TrialTable) -> Standing:
    trials = int(part["trials"].max())
    part = part[part["rmse"].notna()].sort_values("rmse", kind="stable")
    barred = np.array([bool(why(row)) for row in part.to_dict("records")], bool)
    may = part[~barred]
    if may.empty or len(part) < 2:
        nothing = statistics.Interval(np.nan, np.nan, np.nan)
        return Standing(scenario, "", nothing, nothing, (), (), _named(part[barred]), len(may), trials)
    best = may.iloc[0]
    equal, tied = [], []
    for row in may[may["estimator"] != best["estimator"]].to_dict("records"):
        pairs = results.mse((scenario, best["estimator"]), (scenario, row["estimator"]))
        first, other = pairs.T
        if results.stopping.equal(first, other, MARGIN):
            equal.append(row["estimator"])
        elif not results.stopping.change(first, other).low > 0:
            tied.append(row["estimator"])
    lost = part[(part["rmse"] <= best["rmse"]) & barred]
    bare = best["certificate"].startswith("unchecked")
    rmse = statistics.Interval(best["rmse"], best["rmse_low"], best["rmse_high"])
    anees = statistics.mean_of_positive(results.anees((scenario, best["estimator"])))
    return Standing(
        scenario, best["estimator"], rmse, anees, tuple(equal), tuple(tied), _named(lost), len(may), trials, bare
    )


def why(row: dict[Any, Any]) -> str:
    """Why an estimator does not qualify as best, with its ANEES where that is the reason; empty where it qualifies."""
    anees = f", ANEES {ratio(row['anees'])}"
    return ", ".join(
        reason + anees * reason.endswith(("over-confident", "over-wide")) for reason in disqualifications(row)
    )


def _named(lost: pd.DataFrame) -> tuple[str, ...]:
    return tuple(f"{row['estimator']} ({why(row)})" for row in lost.to_dict("records"))


def summary_sentence(one: Standing) -> str:
    """A standing in words."""
    barred = f" As accurate or more, but does not qualify: {listed(one.barred)}." if one.barred else ""
    barred += f" {one.best} was not checked." * one.unchecked
    if one.trials < statistics.LEAST_TRIALS:
        return f"Not assessed: {counted(one.trials, 'trial')}, and it takes {statistics.LEAST_TRIALS}."
    if not one.best:
        return f"No estimator qualifies: {listed(one.barred) if one.barred else 'there is nothing to compare'}."
    rmse = f"{metres(one.rmse.value)} m ({interval(metres)(one.rmse.low, one.rmse.high)})"
    rmse += f", ANEES {ratio(one.anees.value)} ({interval(ratio)(one.anees.low, one.anees.high)})"
    rmse += ", which leaves open whether it is over-confident" if one.anees.value > OVER_CONFIDENT else ""
    if one.able == 1:
        return f"{one.best} is the only one that qualifies: RMSE {rmse}.{barred}"
    if one.alone:
        others = "the other one" if one.able == 2 else f"each of the {one.able - 1} others"
        return f"{one.best} is best: RMSE {rmse}, significantly smaller than that of {others} that qualify.{barred}"
    ties = [f"no significant difference: {listed(one.tied)}"] if one.tied else []
    ties += [f"equal to it within {100 * MARGIN:.0f} %: {listed(one.equal)}"] if one.equal else []
    return f"A tie: {one.best} has the lowest RMSE of those that qualify, {rmse}; {'; '.join(ties)}.{barred}"


def summary_changes(scenarios: list[str], estimators: Iterable[str], results: TrialTable) -> list[Change]:
    """How the RMSE changes over a sweep, paired by trial, of every estimator that ran at both ends."""
    ordered = sorted(scenarios, key=lambda label: sweep(label)[2])
    out = []
    for name in estimators:
        try:
            values = results.mse((ordered[0], name), (ordered[-1], name))
        except Missing:
            continue
        logs = results.stopping.log_contrast(values, np.array([-0.5, 0.5]))
        first, last = (float(v) for v in np.sqrt(values.mean(0))) if len(values) else (np.nan, np.nan)
        share = statistics.Interval(*(float(np.expm1(end)) for end in logs))
        out.append(Change(name, first, last, share, len(values)))
    return out


def swept(scenarios: list[str], found: list[Change], stopping: Stopping = FIXED) -> str:
    """The changes over a sweep in words; where the interval holds 0, no significant change."""
    judged = "95 % intervals" if stopping is FIXED else "confidence sequences"
    ordered = sorted(scenarios, key=lambda label: sweep(label)[2])
    where, parameter, low = sweep(ordered[0])
    high = sweep(ordered[-1])[2]
    known = [one for one in found if one.share.low == one.share.low]
    if not known:
        return ""
    grows = [one for one in known if one.share.low > 0]
    falls = [one for one in known if one.share.high < 0]
    equal = [one.estimator for one in known if one.share.low == one.share.high == 0]
    same = [one.estimator for one in known if one.share.low <= 0 <= one.share.high and one.estimator not in equal]
    parts = [f"it grows for {_moved(grows)}"] if grows else []
    parts += [f"it falls for {_moved(falls)}"] if falls else []
    parts += [f"no significant change for {_names(same)}"] if same else []
    parts += [f"it stays the same for {_names(equal)}"] if equal else []
    return f"{where}: RMSE from {parameter} = {low:g} to {high:g} ({judged}, unadjusted): {'; '.join(parts)}."


def _moved(found: list[Change]) -> str:
    """The estimators that changed, each with its interval; of many, their names and the range of the changes."""
    if len(found) <= FEW:
        return listed(f"{one.estimator} ({_share(one.share)})" for one in found)
    least, *_, most = sorted(abs(one.share.value) for one in found)
    return f"{_names([one.estimator for one in found])} (by {interval(percent)(least, most)})"


def _names(names: list[str]) -> str:
    return listed(names) if len(names) <= 2 * FEW else f"{len(names)} estimators"


def _share(share: statistics.Interval) -> str:
    return f"{change(share.value)}, {interval(change)(share.low, share.high)}"


# The answer of a report in two sentences: whose error is lowest and by how much, and who is over-confident.
#
# Both are made from the tables alone, by the rules of `summaries`.

NAMED = 3  # names in a sentence; of more the first ones, and how many others there are


class Lead(NamedTuple):
    """By how much the lowest error of a scenario is below the next."""

    scenario: str
    best: str
    next: str  # the next smallest error of those that qualify
    share: statistics.Interval  # the change of RMSE against the next: negative


def lowest(found: list[Standing], table: pd.DataFrame, results: TrialTable) -> str:
    """Which estimator has the lowest error where, by how much, and what is not separable from it."""
    if all(one.trials < statistics.LEAST_TRIALS for one in found):
        return _bare(table)
    if len(found) == 1:
        return _one(found[0], table, results)
    decided = [one for one in found if one.alone and one.able > 1]
    count = Counter(one.best for one in decided)
    lead = _narrowest([_lead(one, table, results) for one in decided])
    if len(count) == 1 and len(decided) == len(found):
        return f"{decided[0].best} has the lowest RMSE of those that qualify in all {len(found)} scenarios{lead}."
    names = capped([f"{name} in {n}" for name, n in count.most_common()])
    parts = [f"the lowest RMSE of those that qualify is that of {names}{lead}"] if count else []
    return f"Of {counted(len(found), 'scenario')}, {'; '.join([*parts, *_others(found)])}."


def over_confident(table: pd.DataFrame) -> str:
    """Which estimators are over-confident, in how many scenarios, and by how much in the median trial."""
    assessed = table[table["consistency"] != "not assessed"]
    if assessed.empty:
        return f"Consistency is not assessed: that takes {statistics.LEAST_TRIALS} trials."
    over = assessed[assessed["consistency"] == "over-confident"]
    doubt = assessed[(assessed["consistency"] == "not shown") & (assessed["anees"] > OVER_CONFIDENT)]
    open_ = [str(e) for e in dict.fromkeys(doubt["estimator"]) if e not in set(over["estimator"])]
    left = f"; consistency is not shown for {capped(open_)}" if open_ else ""
    if over.empty:
        return f"No estimator was found over-confident{left}."
    one = over.sort_values("anees_median", na_position="first").iloc[-1]
    place = f" of {one['scenario']}" * (table["scenario"].nunique() > 1)
    whose = "its ANEES" if over["estimator"].nunique() == 1 else f"the ANEES of {one['estimator']}"
    most = f"{whose} is {ratio(one['anees_median'])} in the median trial{place} (1 is consistent)"
    return f"Over-confident: {_where(over, assessed)}; {most}{left}."


def _where(over: pd.DataFrame, assessed: pd.DataFrame) -> str:
    """The estimators that are over-confident, each with its number of scenarios; of many only how many they are."""
    runs, count = Counter(assessed["estimator"]), Counter(over["estimator"])
    if assessed["scenario"].nunique() == 1:
        return capped(count)
    if len(count) <= NAMED:
        return listed(f"{name} in {n} of {runs[name]} scenarios" for name, n in count.items())
    always = [name for name, n in count.items() if n == runs[name]]
    said = f"{len(count)} of {len(runs)} estimators in some scenario"
    return f"{said}, {capped(always)} in every one" if always else said


def capped(names: Iterable[str]) -> str:
    """Names in a sentence, nothing of none; of many the first ones, and how many others there are."""
    names = list(names)
    more = len(names) - NAMED
    if not names:
        return ""
    return listed(names) if more <= 1 else f"{', '.join(names[:NAMED])} and {more} others"


def _one(one: Standing, table: pd.DataFrame, results: TrialTable) -> str:
    """The only scenario."""
    if not one.best:
        return f"No estimator qualifies: {capped(one.barred) if one.barred else 'there is nothing to compare'}."
    rmse = f"{metres(one.rmse.value)} m ({interval(metres)(one.rmse.low, one.rmse.high)})"
    if one.able == 1:
        return f"{one.best} is the only one that qualifies: RMSE {rmse}."
    said = f"{one.best} has the lowest RMSE of those that qualify, {rmse}"
    if one.alone:
        return f"{said}{_narrowest([_lead(one, table, results)])}."
    return f"{said}; not separable from it: {capped((*one.equal, *one.tied))}."


def _bare(table: pd.DataFrame) -> str:
    """The lowest errors of too few trials for any interval."""
    ended = table[table["rmse"].notna()]
    if ended.empty:
        return "Every trial failed."
    ended = ended if ended["centralised"].all() else ended[~ended["centralised"].astype(bool)]
    count = Counter(ended.loc[ended.groupby("scenario", sort=False)["rmse"].idxmin(), "estimator"])
    names = capped([f"{name} in {n}" for name, n in count.most_common()])
    trials = counted(int(ended["trials"].max()), "trial")
    return (
        f"Nothing is separable with {trials}, it takes {statistics.LEAST_TRIALS}; the lowest RMSE that a robot reached "
        f"is that of {names} of {counted(ended['scenario'].nunique(), 'scenario')}."
    )


def _others(found: list[Standing]) -> list[str]:
    """The scenarios in which no estimator alone is lowest."""
    ties = [one for one in found if one.best and not one.alone]
    count = Counter(name for one in ties for name in (one.best, *one.equal, *one.tied))
    names = capped([f"{name} in {n}" for name, n in count.most_common()])
    single = sum(one.alone and one.able == 1 for one in found)
    none = sum(not one.best for one in found)
    parts = [f"in {len(ties)} the lowest are not separable ({names})"] if ties else []
    parts += [f"in {single} only one qualifies"] if single else []
    return parts + ([f"in {none} none qualifies"] if none else [])


def _narrowest(leads: list[Lead | None]) -> str:
    """The smallest of the leads that are known, with its interval."""
    known = [lead for lead in leads if lead]
    if not known:
        return ""
    least = max(known, key=lambda lead: lead.share.value)
    below = f"{percent(-least.share.value)} ({interval(percent)(-least.share.high, -least.share.low)})"
    if len(leads) == 1:
        return f", {below} below that of the next, {least.next}"
    return f", at least {below} below that of the next ({least.next}, {least.scenario})"


def _lead(one: Standing, table: pd.DataFrame, results: TrialTable) -> Lead | None:
    """Against the next smallest RMSE of those that qualify."""
    part = table[(table["scenario"] == one.scenario) & table["rmse"].notna()].sort_values("rmse", kind="stable")
    able = [str(row["estimator"]) for row in part.to_dict("records") if not why(row)]
    after = able[able.index(one.best) + 1 :]
    if not after:
        return None
    next_one, best = results.mse((one.scenario, after[0]), (one.scenario, one.best)).T
    return Lead(one.scenario, one.best, after[0], results.stopping.change(next_one, best))


# What cooperation buys, in sentences made from the matrix of information alone.

OWN = {
    "none": "no reading of their own",
    "doa": "the direction of arrival",
    "gradient": "the gradient",
    "rssi": "the four raw readings",
}
RULES = {
    ("product", "particles"): "the product of beliefs",
    ("intersection", "particles"): "covariance intersection of particle filters",
    ("intersection", "Kalman"): "covariance intersection of Kalman filters",
    ("centralised", "Kalman"): "a Kalman filter of the whole team",
    ("bound", "MAP"): "the bound",
}
FILTERS = {"particles": "with particles", "Kalman": "with a Kalman filter", "MAP": "by the bound"}
NOTHING = 5e-4  # a change whose whole interval is smaller
BETWEEN = {"rssi": "RSSI", "range": "ranges"}


def cooperation_sentences(table: pd.DataFrame) -> list[tuple[str, int, list[str]]]:
    """For each own reading and team of more than one robot: (own, robots, sentences).

    The first says how large errors and floor are alone, each other one what a rule of fusion buys.

    Args:
        table: from `cl.information`.

    """
    found = []
    for (own, robots), part in table[table["robots"] > 1].groupby(["own", "robots"], sort=False):
        said = [_alone(part)]
        for rule, name in RULES.items():
            mine = part[(part["fusion"] == rule[0]) & (part["filter"] == rule[1]) & part["change"].notna()]
            if len(mine):
                said.append(_rule(name, mine))
        found.append((str(own), int(str(robots)), said))
    return found


def heading(own: str, robots: int) -> str:
    """The beginning of such a paragraph."""
    return f"{counted(robots, 'robot')} with {OWN[own]}"


def _alone(part: pd.DataFrame) -> str:
    """The errors and the floor without teammates, and how far the floor falls with them."""
    alone = part[part["between"] == "none"]
    errors = [f"{metres(row['rmse'])} m {FILTERS[row['filter']]}" for row in alone.to_dict("records")]
    said = f"Alone they err by {listed(errors)}." if errors else "None of them was run alone."
    floor = alone["floor"].min()
    together = part[part["between"] != "none"].groupby("between", sort=False)["floor"].min().dropna()
    falls = [f"{change(low / floor - 1)} by {BETWEEN[str(name)]}" for name, low in together.items()]
    if floor != floor or not falls:
        return said
    return f"{said} The floor, {metres(floor)} m alone, changes by {listed(falls)}."


def _rule(name: str, mine: pd.DataFrame) -> str:
    rows = mine.to_dict("records")
    said = f"{name[0].upper()}{name[1:]} {listed(effect(row) for row in rows)}"
    over = [f"{BETWEEN[row['between']]}: ANEES {ratio(row['anees'])}" for row in rows if _over_confident(row)]
    return f"{said}{f', but is over-confident ({listed(over)})' if over else ''}."


def effect(row: dict[Any, Any]) -> str:
    """What a reading changes in the error, against the same filter alone, by its interval."""
    size, low, high = float(row["change"]), float(row["change_low"]), float(row["change_high"])
    by = BETWEEN[row["between"]]
    if max(abs(low), abs(high)) < NOTHING:
        return f"leaves the error as it is by {by}"
    if low != low:
        return f"changes the error by {change(size)} by {by} (no interval)"
    if row["decisive_trial"] == row["decisive_trial"]:
        return f"cannot be compared by {by} (trial {row['decisive_trial']:.0f} decides)"
    if low <= 0 <= high:
        return f"makes no difference that {counted(int(row['trials']), 'trial')} show by {by} ({_between(low, high)})"
    verb = "takes {} off the error" if size < 0 else "adds {} to the error"
    return f"{verb.format(percent(abs(size)))} by {by} ({_between(low, high)})"


def _between(low: float, high: float) -> str:
    return interval(change)(low, high)


def _over_confident(row: dict[Any, Any]) -> bool:
    return bool(row["consistency"] == "over-confident")


# What results depend on, in two sentences per swept parameter, made from the table of sensitivity alone.


def dependence_sentences(table: pd.DataFrame, baseline: str = "arl") -> list[tuple[str, str]]:
    """For each swept parameter: (parameter, who depends on it most and least, and who beats the baseline where).

    Args:
        table: from `cl.sensitivity`.
        baseline: the estimator that its changes are against.

    """
    groups = table.groupby("parameter", sort=False)
    return [(str(name), f"{_range(part)} {_against(part, baseline)}") for name, part in groups]


def _range(part: pd.DataFrame) -> str:
    """Whose largest error is the largest multiple of the smallest one, and whose is the smallest multiple."""
    error = part.groupby("estimator", sort=False)["rmse"]
    factor = (error.max() / error.min()).dropna()
    if len(factor) < 2:
        return "Fewer than two estimators were run."
    most, least = str(factor.idxmax()), str(factor.idxmin())
    return f"{most} depends on it most, with {_ends(part, most)}; {least} least, with {_ends(part, least)}."


def _ends(part: pd.DataFrame, name: str) -> str:
    """The smallest and the largest error of an estimator, with the values where they are."""
    mine = part[(part["estimator"] == name) & part["rmse"].notna()].sort_values("rmse").to_dict("records")
    return f"{_error(mine[0])} and {_error(mine[-1])}"


def _error(row: dict[Any, Any]) -> str:
    ends = interval(metres)(row["rmse_low"], row["rmse_high"])
    return f"{metres(row['rmse'])} m{f' ({ends})' if ends else ''} at {row['value']:g}"


def _against(part: pd.DataFrame, baseline: str) -> str:
    """At how many values each estimator's error is below the baseline's, and above it, by the paired interval."""
    counts: dict[tuple[int, int, int], list[str]] = {}
    for name in (str(each) for each in dict.fromkeys(part["estimator"]) if each != baseline):
        mine = part[part["estimator"] == name]
        better, worse = int((mine["change_high"] < 0).sum()), int((mine["change_low"] > 0).sum())
        counts.setdefault((better, worse, len(mine)), []).append(name)
    if not counts:
        return f"Only {baseline} was run."
    said = [_standing_of(names, baseline, *where) for where, names in sorted(counts.items(), reverse=True)]
    return f"By paired intervals, {'; '.join(said)}."


def _standing_of(names: list[str], baseline: str, better: int, worse: int, n: int) -> str:
    one = len(names) == 1
    beat, lose = ("beats", "loses") if one else ("beat", "lose")
    wins = f"{beat} {baseline} at {_of(better, n)}"
    loses = f"{lose} to it at {_of(worse, n)}" if better else f"{lose} to {baseline} at {_of(worse, n)}"
    if not (better or worse):
        return f"{listed(names)} neither {beat} {baseline} nor {lose} to it at any of {counted(n, 'value')}"
    return f"{listed(names)} {' and '.join([wins] * bool(better) + [loses] * bool(worse))}"


def _of(some: int, n: int) -> str:
    return f"all {counted(n, 'value')}" if some == n else f"{some} of {counted(n, 'value')}"
