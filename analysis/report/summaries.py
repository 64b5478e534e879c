"""Who is best where and who is over-confident, in sentences made from the numbers alone.

Best is the smallest RMSE of those that qualify: distributed, not over-wide, not over-confident nor probably so (ANEES
above twice the limit, with an interval that does not exclude it), no trial and no check failed. Another one ties with
it where the equivalence test says so, or where the 95 % interval of the paired change holds 0; in a run until decided,
the confidence sequence takes the place of both. An estimator is best alone if the intervals against all others exclude
0, an intersection-union test that needs no adjustment (Berger 1982).
"""

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


def sentence(one: Standing) -> str:
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


def changes(scenarios: list[str], estimators: Iterable[str], results: TrialTable) -> list[Change]:
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
