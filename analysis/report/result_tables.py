"""A run's results as `Table`s: every scenario, who is best, who is over-confident, the change over a sweep."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pandas as pd

from cooploc.analysis.formats import change, interval, metres, ratio
from cooploc.analysis.metrics.consistency import COLLAPSED
from cooploc.analysis.metrics.statistics import Interval
from cooploc.analysis.report.result_columns import ANEES, DECIDED, RESULTS, RMSE, percents
from cooploc.analysis.report.summaries import Change, Standing, sentence
from cooploc.analysis.report.tables import Row, Table, TableColumn, numbers, words

FLAGS = {flag: flag.replace("-", "_").replace(" ", "_") for flag in
         ("over-confident", "consistent", "conservative", "over-wide", "not shown", "not assessed")}  # fmt: skip
Ranks = dict[str, tuple[dict[str, float], dict[str, str]]]  # scenario -> mean ranks, and letters, by estimator


STOPPED = (
    "decided: by the confidence sequence of the change (better or worse where it excludes 0, tie within 5 %), at that "
    "number of trials; it holds however the run stops, and p is its 1 / e. Sizes and their intervals are those of a "
    "fixed number of trials: where a row stopped, they are a little too far from 0."
)


def results(name: str, part: pd.DataFrame, ranks: Ranks, about: str) -> Table:
    """One row per (scenario, estimator) of `compare`."""
    rows: list[Row] = []
    for row in part.to_dict("records"):
        mean, letters = ranks[row["scenario"]]
        estimator, status = row["estimator"], row["certificate"].partition(":")[0]
        rows.append({**row, "rank": mean.get(estimator, np.nan), "group": letters.get(estimator, ""), "status": status})
    marks = {f"data-{key}": key for key in ("scenario", "estimator", "consistency", "baseline")}
    marks["data-certificate"] = "status"
    columns = versus(part["baseline"], (*RESULTS, DECIDED) if "look" in part else RESULTS)
    empty = {"checks"} if not part["certificate"].any() else set()  # all are built in
    empty |= {"rank"} if "look" in part else set()  # rows stop at different numbers of trials
    columns = tuple(column for column in columns if column.head not in empty)
    return Table(name, about, columns, rows, marks)


def versus(baselines: Iterable[str], columns: tuple[TableColumn, ...]) -> tuple[TableColumn, ...]:
    """The columns with the baseline's name in the head of the comparison, where there is only one."""
    names = set(baselines)
    head = f"vs {names.pop()}" if len(names) == 1 else "vs baseline"
    return tuple(replace(column, head=head) if column.head == "vs baseline" else column for column in columns)


def where(found: dict[str, list[Standing]]) -> Table:
    """Who is best in how many scenarios of each experiment, among its estimators."""
    columns = (
        words("experiment"),
        numbers("scenarios"),
        words("best alone", "best"),
        words("lowest RMSE, tied with others", "tied"),
        words("the only one that qualifies", "only"),
        numbers("none qualifies", "none"),
    )
    rows = []
    for name, ones in found.items():
        best = {word: Counter(one.best for one in ones if one.word == word) for word in WORDS}
        said = {key: ", ".join(f"{e} ({n})" for e, n in best[word].most_common()) for word, key in WORDS.items()}
        rows.append({"experiment": name, "scenarios": len(ones), **said, "none": best["none"].total()})
    about = (
        "Estimators and in how many scenarios of the experiment. An estimator qualifies to be called best if it is "
        "distributed, is not over-wide, not over-confident nor probably so, and failed in no trial."
    )
    return Table("where", about, columns, rows)


WORDS = {"best": "best", "tie": "tied", "the only one": "only", "none": "none"}  # of `Standing.word` -> column


def best(found: list[Standing]) -> Table:
    """Who is best where."""
    columns = (
        words("scenario"),
        words("standing"),
        words("of those that qualify", "estimator"),
        *RMSE,
        *ANEES,
        words("ties with", "ties"),
        words("as accurate or more, but does not qualify", "barred", of=("some",)),
    )
    rows = [
        {
            "scenario": one.scenario,
            "standing": one.word,
            "estimator": one.best,
            **_ends("rmse", one.rmse),
            **_ends("anees", one.anees),
            "ties": ", ".join((*(f"{name} (equal)" for name in one.equal), *one.tied)),
            "barred": ", ".join(one.barred),
            "some": _some(one.barred),
            "alone": one.best if one.alone else "",
            "sentence": sentence(one),
        }
        for one in found
    ]
    about = (
        "Smallest RMSE of those that qualify to be called best. Ties: the 95 % interval of the paired change holds 0; "
        "equal: the RMSE is within 5 %, by two one-sided t tests of the same kind. In a run until decided, both are "
        "said by the confidence sequence of the change."
    )
    marks = {"data-scenario": "scenario", "data-best": "alone", "title": "sentence"}
    return Table("best", about, columns, rows, marks)


def _ends(name: str, found: Interval) -> dict[str, float]:
    return {name: found.value, f"{name}_low": found.low, f"{name}_high": found.high}


def _some(names: tuple[str, ...]) -> str:
    """The first two; a list that is longer than a line is for programs."""
    return ", ".join(names[:2]) + (f" and {len(names) - 2} more" if len(names) > 2 else "")


def confidence(table: pd.DataFrame) -> Table:
    """Who is over-confident, over all scenarios."""
    columns = (
        words("estimator"),
        numbers("scenarios"),
        *(numbers(flag, key) for flag, key in FLAGS.items()),
        numbers("largest ANEES", "anees", form=ratio),
        numbers("its median", "anees_median", form=ratio),
        words("in", "scenario"),
        numbers("most collapsed", "collapsed", form=percents(0)),
    )
    rows: list[Row] = []
    for name, part in table.groupby("estimator", sort=False):
        counts = {key: int((part["consistency"] == flag).sum()) for flag, key in FLAGS.items()}
        known = part.dropna(subset="anees").sort_values("anees")[["anees", "anees_median", "scenario"]]
        worst = known.iloc[-1].to_dict() if len(known) else {"anees": np.nan, "anees_median": np.nan, "scenario": ""}
        most = {"collapsed": float(part["collapsed"].max())}
        rows.append({"estimator": name, "scenarios": len(part), **counts, **worst, **most})
    about = (
        "Number of scenarios by ANEES: over-confident where its 95 % interval lies wholly above 1.5, conservative "
        "where wholly below 0.67, over-wide where below 0.1, consistent where wholly between 0.67 and 1.5, not shown "
        "where it holds a limit. A mean ANEES may be that of one collapsed trial: its median over trials "
        f"and the largest share of trials in a scenario whose ANEES exceeds {COLLAPSED:g}, do not depend on one."
    )
    return Table("consistency", about, columns, rows, {"data-estimator": "estimator"})


def sweep(name: str, found: list[Change], parameter: str) -> Table:
    """How RMSE changes over a sweep."""
    columns = (
        words("estimator"),
        numbers("RMSE [m], first", "first", form=metres),
        numbers("last", form=metres),
        numbers("change", form=change),
        numbers("95 %", "change_low", "change_high", form=interval(change)),
        numbers("trials"),
    )
    rows = [{**one._asdict(), **_ends("change", one.share)} for one in found]
    about = (
        f"From the first to the last value of {parameter}; jackknife intervals over trials, in a run until decided "
        "confidence sequences; not adjusted."
    )
    return Table(name, about, columns, rows, {"data-estimator": "estimator"})
