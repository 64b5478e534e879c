"""A run's tables: results, who is best and over-confident, changes over a sweep, scenarios, events, failures, tuning.

To add a column of results to the page, LaTeX, Markdown, CSV, a paper's tables and `--wide`, add one entry to `RESULTS`:
its head, the key of `compare`'s table that it shows (two keys for an interval), and how it is written. A terminal shows
the few of `essential_columns` by default.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.claims.trial_table import TrialTable
from cooploc.analysis.formats import (
    change,
    count,
    decimals,
    interval,
    metres,
    microseconds,
    p_value,
    percent,
    ratio,
)
from cooploc.analysis.metrics.errors import NOTE
from cooploc.analysis.metrics.ranking import disqualifications, is_refused, rank_groups, short_certificate
from cooploc.analysis.metrics.statistics import FIXED, Interval
from cooploc.analysis.report.sentences import Standing, SweepChange, summary_sentence
from cooploc.analysis.report.tables import Row, Table, TableColumn, number_column, read_toml, text_column, words
from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput, count_of, first_of
from cooploc.estimators.label_syntax import parse, shorten_labels
from cooploc.estimators.listing import declares_bytes, setting_kind

CONSISTENCY = {flag: flag for flag in ("over-confident", "over-wide", "conservative")}
CONSISTENCY["not shown"] = "consistency not shown"


def remark(
    estimator: str,
    certificate: str,
    flag: str,
    central: bool,
    bound: bool,
    offline: bool,
    failed: int,
    rmse: float,
    mark: str,
) -> str:
    """Return what a reader of a result must know."""
    out_of_rank = failed > 0 or is_refused(certificate)
    remarks = [setting_kind(estimator), "not ranked" if out_of_rank else "", CONSISTENCY.get(flag, "")]
    not_again = "" if out_of_rank else ", not ranked"
    remarks += [f"offline{not_again}" if offline else "bound" if bound else "centralised" if central else ""]
    remarks += ["bytes as declared"] * (not central and declares_bytes(estimator))
    remarks += [mark]
    lost = "every trial failed" if np.isnan(rmse) else f"{failed} failed"
    return ", ".join(filter(None, [*remarks, lost * int(failed > 0)]))


def decision(verdict: str, look: int, trials: int) -> str:
    """Return what a run until decided found of a row, and when."""
    if not verdict:
        return ""
    stopped = verdict != "open" and trials <= look
    return f"{verdict}{', stopped' * stopped} at n = {look}"


def _short_decision(verdict: str, look: int, trials: int) -> str:
    return f"{verdict}, n = {look}" * bool(verdict)


WHOLE_PERCENT = partial(percent, digits=0)
NOT_COMPARABLE = "not comparable:"


def _write_change(estimator: str, baseline: str, value: float, trial: float) -> str:
    """Write the change against the baseline; not that of the baseline itself, and not one that one trial decides."""
    return "baseline" if estimator == baseline else change(value) if np.isnan(trial) else NOT_COMPARABLE


def _write_change_ends(estimator: str, baseline: str, low: float, high: float, trial: float) -> str:
    if estimator == baseline:
        return ""
    return interval(change)(low, high) if np.isnan(trial) else f"trial {trial:.0f} decides"


def ends_column(name: str, form: Callable[[float], str], **layout: Any) -> TableColumn:
    """Return the column of an interval, of the keys NAME_low and NAME_high."""
    return number_column("95 %", f"{name}_low", f"{name}_high", form=interval(form), **layout)


RMSE = number_column("RMSE [m]", "rmse", form=metres), ends_column("rmse", metres, second_line=True)
ANEES = number_column("ANEES", "anees", form=ratio), ends_column("anees", ratio)
VERSUS = ("estimator", "baseline")
REMARK_FIELDS = ("estimator", "certificate", "consistency", "centralised", "bound", "offline", "failed", "rmse", "mark")
REMARK_KEYS = ("consistency", "centralised", "bound", "offline", "failed", "baseline", "stream")  # a remark, in CSV
RARE: dict[str, Any] = {"collapsed": True, "rare": True}
RESULTS = (
    text_column("scenario", report_only=True),
    text_column("estimator"),
    text_column("remark", *REMARK_KEYS, of=REMARK_FIELDS, form=remark, second_line=True),
    text_column("senses", second_line=True),
    text_column("checks", "certificate", form=short_certificate),
    *RMSE,
    number_column("median", "rmse_median", form=metres, collapsed=True, report_only=True),
    number_column("outlying", form=WHOLE_PERCENT, **RARE),
    ends_column("outlying", WHOLE_PERCENT, report_only=True),
    number_column("rank", form=partial(decimals, digits=1), report_only=True),
    text_column("group", report_only=True),
    number_column("vs baseline", "change", of=(*VERSUS, "change", "decisive_trial"), form=_write_change),
    replace(
        ends_column("change", change, second_line=True),
        of=(*VERSUS, "change_low", "change_high", "decisive_trial"),
        form=_write_change_ends,
    ),
    number_column("p (Holm)", "p_holm", form=p_value, priority=2),
    ANEES[0],
    replace(ANEES[1], report_only=True),
    number_column("median", "anees_median", form=ratio, second_line=True, collapsed=True),
    number_column("collapsed", form=WHOLE_PERCENT, priority=7, **RARE),
    ends_column("collapsed", WHOLE_PERCENT, report_only=True),
    number_column("in 95 %", "coverage95", form=WHOLE_PERCENT, priority=4),
    number_column("NLL", "nll", form=ratio, second_line=True, priority=5, collapsed=True),
    number_column("ellipse [m²]", "area95", form=ratio, collapsed=True, report_only=True),
    number_column("diverged", form=partial(percent, digits=1), priority=3, **RARE),
    number_column("messages", form=ratio, priority=6, collapsed=True),
    number_column("bytes", form=count),
    number_column("µs", "seconds", form=microseconds, second_line=True),
    number_column("trials", second_line=True, priority=1, report_only=True),
)
DECIDED = text_column("decided", "verdict", "look", of=("verdict", "look", "trials"), form=decision)


def result_columns(baselines: Iterable[str], until_decided: bool) -> tuple[TableColumn, ...]:
    """Return the columns of some rows of `compare`, with the baseline's name in a head where there is only one."""
    names = set(baselines)
    head = f"vs {shorten_labels(names.pop())}" if len(names) == 1 else "vs baseline"
    columns = (*RESULTS, DECIDED) if until_decided else RESULTS
    return tuple(replace(column, head=head) if column.head == "vs baseline" else column for column in columns)


def _without_standing(estimator: str, certificate: str, *rest: Any) -> str:
    """Return a remark without what has a column of its own, and without whose reading of a paper it is."""
    return remark(estimator, certificate, "", *rest).removeprefix(setting_kind(estimator)).removeprefix(", ")


WIDEST_HEAD = 18  # characters; a wider one would leave too few for the names of estimators


def _join_interval(head: str, value: TableColumn, ends: TableColumn, **layout: Any) -> TableColumn:
    """Return one column of a value and its interval, as in "0.332 [0.254, 0.432]"; per cent are said in the head.

    A change that is not comparable is "trial 2 decides" alone, as a caption says what that means.
    """
    of = value.of or value.keys

    def write(*values: Any) -> str:
        text, both = value.form(*values[: len(of)]), ends.form(*values[len(of) :])
        joined = f"{text} [{both.replace(' to ', ', ')}]" if " to " in both else f"{text} {both}".strip()
        return joined.replace(" %", "").removeprefix(NOT_COMPARABLE).strip()

    return number_column(head, *value.keys, of=(*of, *(ends.of or ends.keys)), form=write, **layout)


def essential_columns(baselines: Iterable[str], until_decided: bool) -> tuple[TableColumn, ...]:
    """Return what a terminal shows by default, in 80 characters: estimator, consistency, error, its change, bytes."""
    named = {column.keys[0]: column for column in result_columns(baselines, until_decided)}
    remarks, versus = named["consistency"], named["change"]
    head = versus.head if len(versus.head) <= WIDEST_HEAD else "vs baseline"
    others = tuple(key for key in remarks.of if key != "consistency")
    return (
        named["estimator"],
        replace(remarks, keys=("failed",), of=others, form=_without_standing),
        replace(named["certificate"], second_line=True),
        text_column("consistency"),
        *([replace(DECIDED, form=_short_decision, second_line=True)] if until_decided else ()),
        _join_interval("RMSE [m]", named["rmse"], named["rmse_low"]),
        _join_interval(f"{head} [%]", versus, named["change_low"]),
        named["bytes"],
    )


# ------------------------------------------------------------------------------------------------ tables

FLAGS = {flag: flag.replace("-", "_").replace(" ", "_") for flag in
         ("over-confident", "consistent", "conservative", "over-wide", "not shown", "not assessed")}  # fmt: skip
STUDY = "study"  # instead of a column by which rows are sorted: the order of the study


def sort_rows(table: pd.DataFrame, by: str = "rmse") -> pd.DataFrame:
    """Return the rows of each scenario by rising `by`, a column of `compare`; those of "study" as they were."""
    known = [str(name) for name in table.select_dtypes("number")]
    if by not in (STUDY, *known):
        raise BadInput(f"--sort is {by!r}; {nearest(by, [STUDY, *known])}")
    parts = [part for _, part in table.groupby("scenario", sort=False)]
    return table if by == STUDY else pd.concat([part.sort_values(by, kind="stable") for part in parts])


def lowest_that_qualifies(rows: Iterable[Row]) -> Row | None:
    """Return the row of `compare` with the lowest RMSE of those that may be called best; None: no such row."""
    return min((row for row in rows if not disqualifications(row)), key=lambda row: row["rmse"], default=None)


def rank_scenario(rows: pd.DataFrame, results: TrialTable) -> tuple[dict[str, float], dict[str, str]]:
    """Return mean ranks (of a fixed number of trials) and letters of one scenario's estimators that failed nowhere.

    One that failed would take its trials from all others, and change their ranks and letters. Offline estimators are
    not ranked with filters.
    """
    names = list(rows.loc[may_be_ranked(rows), "estimator"])
    if not names:
        return {}, {}
    mse = results.errors(rows["scenario"].iloc[0], names)
    return rank_groups(mse.dropna() if results.stopping is FIXED else mse, results.stopping)


def may_be_ranked(rows: pd.DataFrame) -> "pd.Series[bool]":
    """Return which rows of `compare` failed nowhere, no check either, and did not see later readings."""
    ended = rows["rmse"].notna() & (rows["failed"] == 0) & ~rows["offline"]
    return ended & ~rows["certificate"].map(is_refused).astype(bool)


def results(name: str, part: pd.DataFrame, trials: TrialTable, caption: str) -> Table:
    """Return one row per (scenario, estimator) of `compare`, those of a scenario in order of error."""
    rows: list[Row] = sort_rows(part).to_dict("records")
    for scenario, same in groupby(rows, key=lambda row: row["scenario"]):
        together, (mean, letters) = list(same), rank_scenario(part[part["scenario"] == scenario], trials)
        chosen = lowest_that_qualifies(together)
        for row in together:
            row["rank"], row["group"] = mean.get(row["estimator"], np.nan), letters.get(row["estimator"], "")
            row |= {"status": row["certificate"].partition(":")[0], "best": "yes" * (row is chosen)}
    marks = {f"data-{key}": key for key in ("scenario", "estimator", "consistency", "baseline", "best")}
    until_decided = "look" in part  # rows stop at different numbers of trials, and have no ranks
    empty = ["checks"] * (not part["certificate"].any()) + ["rank"] * until_decided
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
        text_column("ties with", "ties", of=("some_ties",)),
        text_column("as accurate or more, but does not qualify", "barred", of=("some",)),
    )
    rows = [
        {
            "scenario": one.scenario,
            "standing": one.word,
            "estimator": one.best,
            **_interval_values("rmse", one.rmse),
            **_interval_values("anees", one.anees),
            "ties": ", ".join(ties),
            "some_ties": first_of(ties, 8),
            "barred": ", ".join(one.barred),
            "some": first_of(one.barred, 2),
            "alone": one.best if one.is_alone else "",
            "sentence": shorten_labels(summary_sentence(one)),
        }
        for one in found
        for ties in [(*(f"{name} (equal)" for name in one.equal), *one.tied)]
    ]
    marks = {"data-scenario": "scenario", "data-best": "alone", "title": "sentence"}
    return Table(name, words("captions")["best"], columns, rows, marks)


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
        number_column("most collapsed", "collapsed", form=WHOLE_PERCENT),
    )
    rows: list[Row] = []
    for name, part in table.groupby("estimator", sort=False):
        counts = {key: int((part["consistency"] == flag).sum()) for flag, key in FLAGS.items()}
        known = part.dropna(subset="anees").sort_values("anees")[["anees", "anees_median", "scenario"]]
        worst = known.iloc[-1].to_dict() if len(known) else {"anees": np.nan, "anees_median": np.nan, "scenario": ""}
        most = {"collapsed": float(part["collapsed"].max())}
        rows.append({"estimator": name, "scenarios": len(part), **counts, **worst, **most})
    return Table("consistency", words("captions")["consistency"], columns, rows, {"data-estimator": "estimator"})


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
    caption = words("captions")["sweep"].format(parameter=parameter)
    return Table(name, caption, columns, rows, {"data-estimator": "estimator"})


# ------------------------------------------------------------------------------------------------ scenarios

HASH = 12  # characters of a stream's hash


def scenario_tables(table: pd.DataFrame, settings: Mapping[str, Mapping[str, Any]]) -> list[Table]:
    """Return the scenarios of a table of `compare`, and their parameters, of which `settings` has the values.

    A parameter that not all have with one value has its values with the number of scenarios of each.
    """
    most = table.sort_values("trials", ascending=False, kind="stable").drop_duplicates("scenario").set_index("scenario")
    names = list(dict.fromkeys(table["scenario"]))
    rows: list[Row] = most.loc[names, ["robots", "trials", "baseline", "stream"]].reset_index().to_dict("records")
    heads = (
        text_column("scenario"),
        *map(number_column, ("robots", "trials")),
        text_column("baseline"),
        text_column("stream", form=lambda stream: str(stream)[:HASH]),
    )
    values: dict[str, Counter[str]] = {}
    for name in names:
        for key, value in settings.get(name, {}).items():
            values.setdefault(key, Counter())[parameter_text(value)] += 1
    counted = {
        key: "; ".join(value if n == len(names) else f"{value} ({n})" for value, n in found.items())
        for key, found in values.items()
    }
    both = [Table("scenarios", words("captions")["scenarios"], heads, rows, {"data-scenario": "scenario"})]
    return both + [parameter_table(counted, words("captions")["parameters"])] * bool(counted)


def parameter_table(values: Mapping[str, str], caption: str) -> Table:
    """Return parameters of scenarios with their values, units and meanings."""
    known = read_toml("parameters.toml")
    rows: list[Row] = [
        {"parameter": key, "value": value, "unit": "", "meaning": "", **known.get(key, {})}
        for key, value in values.items()
    ]
    return Table("parameters", caption, tuple(map(text_column, ("parameter", "value", "unit", "meaning"))), rows)


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


def failures(rows: pd.DataFrame) -> list[Failure]:
    """Return each kind of failure once, the most frequent first."""
    failed = rows[rows["failure"].notna()].drop_duplicates(["scenario", "estimator", "trial"])
    kinds = failed["failure"].astype(str).str.replace(r"\d+(\.\d+)?(e[-+]?\d+)?", "0", regex=True)
    found = []
    for _, part in failed.groupby(kinds, sort=False):
        where = []
        for (scenario, estimator), one in part.groupby(["scenario", "estimator"], sort=False):
            trials = ", ".join(map(str, sorted(one["trial"])[:SHOWN_TRIALS])) + " ..." * (len(one) > SHOWN_TRIALS)
            where.append(shorten_labels(f"{scenario}, {estimator}: trial{'s' * (len(one) > 1)} {trials}"))
        message, traceback = part[["failure", "traceback"]].astype(str).iloc[0]
        found.append(Failure(shorten_labels(message), len(part), where, traceback))
    return sorted(found, key=lambda kind: -kind.trials)


# ---- a tuning: as shipped and tuned, with the gain on training streams and on fresh ones


def gain(value: float) -> str:
    """Write a difference of scores [nats, or log m], with its sign."""
    return f"{'+' if round(value, 2) > 0 else ''}{decimals(value, 2)}"


def parameters(label: str) -> str:
    """Return a configuration's parameters in words."""
    return ", ".join(f"{key}={value}" for key, value in parse(label)[1].items())


GAINS = (
    text_column("estimator"),
    number_column("RMSE shipped [m]", "rmse_shipped", form=metres),
    number_column("tuned [m]", "rmse_tuned", form=metres),
    number_column("change", "change", form=change),
    number_column("95 %", "change_low", "change_high", form=interval(change)),
    number_column("p", "p_holm", form=p_value, priority=4),
    number_column("score shipped", "score_shipped", form=ratio, priority=6),
    number_column("tuned", "score_tuned", form=ratio, second_line=True, priority=6),
    number_column("ANEES shipped", "anees_shipped", form=ratio, priority=5),
    number_column("tuned", "anees_tuned", form=ratio, second_line=True, priority=5),
    number_column("training gain", "training_gain", form=gain, priority=1),
    number_column("fresh gain", "fresh_gain", form=gain),
    number_column("95 %", "fresh_gain_low", "fresh_gain_high", form=interval(gain), priority=3),
    number_column("rank shipped", "rank_shipped", form=count, priority=2),
    number_column("tuned", "rank_tuned", form=count, second_line=True, priority=2),
    number_column("failed", "failed_tuned", form=lambda failed: count(failed) if failed else ""),
)


def gains_table(scenario: str, part: pd.DataFrame) -> Table:
    """Return one scenario's estimators, by their error as shipped."""
    ordered = part.sort_values("rmse_shipped", kind="stable")
    caption = f"{scenario}: {count(part['trials'].max())} fresh trials"
    return Table("tuned", caption, GAINS, ordered.to_dict("records"))


def chosen_table(history: pd.DataFrame, tuned: dict[str, str]) -> Table:
    """Return the chosen parameters of every estimator, and what the search took."""
    rows = [
        {
            "estimator": str(name),
            "tuned": "as shipped" if tuned[str(name)] == name else parameters(tuned[str(name)]),
            "configurations": len(part),
            "stopped": (part["state"] == "stopped").sum(),
            "trials": part["trials"].sum(),
        }
        for name, part in history.groupby("estimator", sort=False)
    ]
    columns = (
        text_column("estimator"),
        text_column("tuned"),
        *map(number_column, ("configurations", "stopped", "trials")),
    )
    caption = "what was chosen, of how many configurations, how many of them were stopped early, and all their trials"
    return Table("chosen", caption, columns, rows)


def order_sentence(table: pd.DataFrame, by: str) -> str:
    """Return in two sentences how tuning changed the order of all pairs."""
    changed = (table["smaller_shipped"] != table["smaller_tuned"]).sum()
    became = table["became"].value_counts().reindex(["reversed", "kept", "appeared", "vanished", "open"], fill_value=0)
    reversed_, kept, appeared, vanished, never = became
    return (
        f"By {by}, of {count_of(len(table), 'pair')} of estimators in a scenario tuning reversed a significant order "
        f"in {reversed_}, and kept one in {kept}; {appeared} differ only when tuned, {vanished} only as shipped, "
        f"{never} in neither. Without a test, the smaller error changed sides in {changed}."
    )
