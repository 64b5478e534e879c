"""A run's tables: results, who is best and over-confident, changes over a sweep, scenarios, events, failures."""

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.formats import change, count, interval, metres, ratio
from cooploc.analysis.metrics.consistency import COLLAPSED
from cooploc.analysis.metrics.errors import NOTE
from cooploc.analysis.metrics.ranking import disqualifications
from cooploc.analysis.metrics.statistics import Interval
from cooploc.analysis.report.result_columns import ANEES, RMSE, result_columns, share
from cooploc.analysis.report.sentences import Standing, SweepChange, summary_sentence
from cooploc.analysis.report.tables import Row, Table, number_column, text_column
from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput

FLAGS = {flag: flag.replace("-", "_").replace(" ", "_") for flag in
         ("over-confident", "consistent", "conservative", "over-wide", "not shown", "not assessed")}  # fmt: skip
Ranks = dict[str, tuple[dict[str, float], dict[str, str]]]  # scenario -> mean ranks, and letters, by estimator
STUDY = "study"  # instead of a column by which rows are sorted: the order of the study


def sort_rows(table: pd.DataFrame, by: str = "rmse") -> pd.DataFrame:
    """Return the rows of each scenario by rising `by`, a column of `compare`; those of "study" as they were."""
    known = [str(name) for name in table.select_dtypes("number")]
    if by not in (STUDY, *known):
        raise BadInput(f"--sort is {by!r}; {nearest(by, [STUDY, *known])}")
    parts = [part for _, part in table.groupby("scenario", sort=False)]
    return table if by == STUDY else pd.concat([part.sort_values(by, kind="stable") for part in parts])


def lowest_that_qualifies(rows: list[Row]) -> Row | None:
    """Return the row of `compare` with the lowest RMSE of those that may be called best; None: no such row."""
    return min((row for row in rows if not disqualifications(row)), key=lambda row: row["rmse"], default=None)


def results(name: str, part: pd.DataFrame, ranks: Ranks, caption: str) -> Table:
    """Return one row per (scenario, estimator) of `compare`, those of a scenario in order of error."""
    rows: list[Row] = []
    for row in sort_rows(part).to_dict("records"):
        mean, letters = ranks[row["scenario"]]
        estimator, status = row["estimator"], row["certificate"].partition(":")[0]
        rows.append({**row, "rank": mean.get(estimator, np.nan), "group": letters.get(estimator, ""), "status": status})
    for _, same in groupby(rows, key=lambda row: row["scenario"]):
        together = list(same)
        chosen = lowest_that_qualifies(together)
        for row in together:
            row["best"] = "yes" if row is chosen else ""
    marks = {f"data-{key}": key for key in ("scenario", "estimator", "consistency", "baseline", "best")}
    until_decided = "look" in part
    empty = {"checks"} if not part["certificate"].any() else set()  # all are built in
    empty |= {"rank"} if until_decided else set()  # rows stop at different numbers of trials
    columns = tuple(c for c in result_columns(part["baseline"], until_decided) if c.head not in empty)
    return Table(name, caption, columns, rows, {**marks, "data-certificate": "status"})


def best(found: list[Standing], name: str = "best") -> Table:
    """Return who is best in each scenario."""
    columns = (
        text_column("scenario"),
        text_column("standing"),
        text_column("of those that qualify", "estimator"),
        *RMSE,
        *ANEES,
        text_column("ties with", "ties"),
        text_column("as accurate or more, but does not qualify", "barred", of=("some",)),
    )
    rows = [
        {
            "scenario": one.scenario,
            "standing": one.word,
            "estimator": one.best,
            **_interval_values("rmse", one.rmse),
            **_interval_values("anees", one.anees),
            "ties": ", ".join((*(f"{name} (equal)" for name in one.equal), *one.tied)),
            "barred": ", ".join(one.barred),
            "some": ", ".join(one.barred[:2]) + (f" and {len(one.barred) - 2} more" if len(one.barred) > 2 else ""),
            "alone": one.best if one.is_alone else "",
            "sentence": summary_sentence(one),
        }
        for one in found
    ]
    caption = (
        "Smallest RMSE of those that qualify to be called best. Ties: the 95 % interval of the paired change holds 0; "
        "equal: the RMSE is within 5 %, by two one-sided t tests of the same kind. In a run until decided, both are "
        "said by the confidence sequence of the change."
    )
    marks = {"data-scenario": "scenario", "data-best": "alone", "title": "sentence"}
    return Table(name, caption, columns, rows, marks)


def _interval_values(name: str, found: Interval) -> dict[str, float]:
    return {name: found.value, f"{name}_low": found.low, f"{name}_high": found.high}


def consistency(table: pd.DataFrame) -> Table:
    """Return who is over-confident, over all scenarios."""
    columns = (
        text_column("estimator"),
        number_column("scenarios"),
        *(number_column(flag, key) for flag, key in FLAGS.items()),
        number_column("largest ANEES", "anees", form=ratio),
        number_column("its median", "anees_median", form=ratio),
        text_column("in", "scenario"),
        number_column("most collapsed", "collapsed", form=share(0)),
    )
    rows: list[Row] = []
    for name, part in table.groupby("estimator", sort=False):
        counts = {key: int((part["consistency"] == flag).sum()) for flag, key in FLAGS.items()}
        known = part.dropna(subset="anees").sort_values("anees")[["anees", "anees_median", "scenario"]]
        worst = known.iloc[-1].to_dict() if len(known) else {"anees": np.nan, "anees_median": np.nan, "scenario": ""}
        most = {"collapsed": float(part["collapsed"].max())}
        rows.append({"estimator": name, "scenarios": len(part), **counts, **worst, **most})
    caption = (
        "Number of scenarios by ANEES: over-confident where its 95 % interval lies wholly above 1.5, conservative "
        "where wholly below 0.67, over-wide where below 0.1, consistent where wholly between 0.67 and 1.5, not shown "
        "where it holds a limit. A mean ANEES may be that of one collapsed trial: its median over trials "
        f"and the largest share of trials in a scenario whose ANEES exceeds {COLLAPSED:g}, do not depend on one."
    )
    return Table("consistency", caption, columns, rows, {"data-estimator": "estimator"})


def sweep_table(name: str, found: list[SweepChange], parameter: str) -> Table:
    """Return how RMSE changes over a sweep."""
    columns = (
        text_column("estimator"),
        number_column("RMSE [m], first", "first", form=metres),
        number_column("last", form=metres),
        number_column("change", form=change),
        number_column("95 %", "change_low", "change_high", form=interval(change)),
        number_column("trials"),
    )
    rows = [{**one._asdict(), **_interval_values("change", one.share)} for one in found]
    caption = (
        f"From the first to the last value of {parameter}; jackknife intervals over trials, in a run until decided "
        "confidence sequences; not adjusted."
    )
    return Table(name, caption, columns, rows, {"data-estimator": "estimator"})


# ------------------------------------------------------------------------------------------------ scenarios

DIFFERS = "differs"
HASH = 12  # characters of a stream's hash


@cache
def meanings() -> dict[str, dict[str, str]]:
    """Return the `meaning` and the `unit` of each parameter of built-in scenarios."""
    return tomllib.loads((files(__package__) / "parameters.toml").read_text("utf-8"))


def scenario_tables(table: pd.DataFrame, settings: Mapping[str, Mapping[str, Any]]) -> list[Table]:
    """Return, for each set of scenarios with the same parameters, the scenarios and then their parameters.

    `table` is from `compare`; `settings` has the parameters of each scenario, as the manifest has them.
    """
    kinds: dict[tuple[str, ...], list[str]] = {}
    for scenario in dict.fromkeys(table["scenario"]):
        kinds.setdefault(tuple(settings.get(scenario, {})), []).append(str(scenario))
    most = table.sort_values("trials", ascending=False, kind="stable").drop_duplicates("scenario").set_index("scenario")
    out = []
    for i, (names, scenarios) in enumerate(kinds.items()):
        given = {scenario: settings.get(scenario, {}) for scenario in scenarios}
        unlike = [name for name in names if len({repr(one[name]) for one in given.values()}) > 1]
        ending = f"-{i + 1}" if len(kinds) > 1 else ""
        out.append(_scenarios(f"scenarios{ending}", given, [n for n in unlike if n != "robots"], most))
        if names:
            shared = {key: DIFFERS if key in unlike else parameter_text(v) for key, v in given[scenarios[0]].items()}
            rows = [
                {"unit": "", "meaning": "", "parameter": k, "value": v, **meanings().get(k, {})}
                for k, v in shared.items()
            ]
            about = "What these scenarios share; parameters that differ have their values beside each scenario, above."
            columns = tuple(map(text_column, ("parameter", "value", "unit", "meaning")))
            out.append(Table(f"parameters{ending}", about, columns, rows))
    return out


def _scenarios(name: str, given: Mapping[str, Mapping[str, Any]], unlike: list[str], most: pd.DataFrame) -> Table:
    units = {parameter: meanings().get(parameter, {}).get("unit", "") for parameter in unlike}
    columns = (
        text_column("scenario"),
        *map(number_column, ("robots", "trials")),
        text_column("baseline"),
        *(number_column(f"{name} [{unit}]" if unit else name, name) for name, unit in units.items()),
        text_column("stream", form=lambda stream: str(stream)[:HASH]),
    )
    rows: list[Row] = [
        {
            "scenario": scenario,
            **most.loc[scenario, ["robots", "trials", "baseline", "stream"]].to_dict(),
            **{parameter: parameter_text(values[parameter]) for parameter in unlike},
        }
        for scenario, values in given.items()
    ]
    caption = (
        "Scenarios, with the parameters in which they differ. Results of equal streams can be paired: the hash is over "
        "every reading, link and initial position of the trials."
    )
    return Table(name, caption, columns, rows, {"data-scenario": "scenario"})


def parameter_text(value: Any) -> str:
    """Return a parameter's value in a few words."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value:g}".replace("inf", "∞")
    if isinstance(value, list | tuple):
        nested = any(isinstance(one, list | tuple) for one in value)
        return ("; " if nested else ", ").join(map(parameter_text, value)) or "none"
    return str(value)


# ------------------------------------------------------------------------------------------------ events, failures


def events(rows: pd.DataFrame) -> Table:
    """Return counts of estimators, such as of refused packets: sums, or maxima where the name begins with largest."""
    columns = (
        text_column("estimator"),
        text_column("event"),
        number_column("in all", "total", form=lambda value: f"{value:.3g}"),
        number_column("scenarios", form=count),
        text_column("most in", "most"),
    )
    found: list[Row] = []
    for key in (str(name) for name in rows if str(name).startswith(NOTE)):
        event = key.removeprefix(NOTE)
        how = "max" if event.startswith("largest") else "sum"
        known = rows.loc[rows[key].notna(), ["scenario", "estimator", key]]
        for estimator, part in known.groupby("estimator", sort=False):
            each = part.groupby("scenario", sort=False)[key].agg(how)
            some = each[each != 0]
            if len(some):
                counts = {"total": float(each.agg(how)), "scenarios": len(some), "most": str(some.idxmax())}
                found.append({"estimator": estimator, "event": event, **counts})
    return Table("events", "Events that estimators counted, summed over trials and robots.", columns, found)


SHOWN_TRIALS = 5  # of a failure


class Failure(NamedTuple):
    """A failure that occurred in one trial or in many; the numbers in its message may differ."""

    message: str  # of its first trial
    trials: int
    where: list[str]  # "scenario, estimator: trials 3, 5"
    traceback: str  # of its first trial


def trial_list(trials: pd.Series) -> str:
    """Return the first numbers of the trials: "trial 3", "trials 3, 5, 8 ..."."""
    shown = ", ".join(map(str, sorted(trials)[:SHOWN_TRIALS])) + " ..." * (len(trials) > SHOWN_TRIALS)
    return f"{'trial' if len(trials) == 1 else 'trials'} {shown}"


def failures(rows: pd.DataFrame) -> list[Failure]:
    """Return each kind of failure once, the most frequent first."""
    failed = rows[rows["failure"].notna()].drop_duplicates(["scenario", "estimator", "trial"])
    kinds = failed["failure"].astype(str).str.replace(r"\d+(\.\d+)?(e[-+]?\d+)?", "0", regex=True)
    found = []
    for _, part in failed.groupby(kinds, sort=False):
        cells = part.groupby(["scenario", "estimator"], sort=False)
        where = [f"{scenario}, {estimator}: {trial_list(one['trial'])}" for (scenario, estimator), one in cells]
        found.append(Failure(str(part["failure"].iloc[0]), len(part), where, str(part["traceback"].iloc[0])))
    return sorted(found, key=lambda kind: -kind.trials)
