"""The answer of a report in two sentences: whose error is lowest and by how much, and who is over-confident.

Both are made from the tables alone, by the rules of `summaries`.
"""

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

import pandas as pd

from cooploc.analysis.claims.trial_table import TrialTable
from cooploc.analysis.formats import counted, interval, listed, metres, percent, ratio
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.consistency import OVER_CONFIDENT
from cooploc.analysis.report.summaries import Standing, why

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
