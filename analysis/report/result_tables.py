"""The columns of a run's results, and what a reader of a row must know."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.claims.trial_table import TrialTable
from cooploc.analysis.execution.run_directory import StoredRun
from cooploc.analysis.formats import (
    change,
    count,
    counted,
    fixed,
    interval,
    metres,
    microseconds,
    p_value,
    percent,
    ratio,
)
from cooploc.analysis.metrics.consistency import COLLAPSED
from cooploc.analysis.metrics.errors import NOTE
from cooploc.analysis.metrics.ranking import is_refused, short_certificate
from cooploc.analysis.metrics.statistics import Interval
from cooploc.analysis.plot.style import Look
from cooploc.analysis.report.parameter_meanings import MEANINGS
from cooploc.analysis.report.sentences import Change, Standing, summary_sentence
from cooploc.analysis.report.tables import Row, Table, TableColumn, numbers, words
from cooploc.estimators.listing import declares_bytes, standing

SAID = {flag: flag for flag in ("over-confident", "over-wide", "conservative")} | {"not shown": "consistency not shown"}


def remark(
    estimator: str,
    certificate: str,
    consistency: str,
    centralised: bool,
    bound: bool,
    offline: bool,
    failed: int,
    rmse: float,
) -> str:
    """What a reader of a result must know."""
    remarks = [standing(estimator)] if standing(estimator) else []
    remarks += ["not ranked"] if is_refused(certificate) else []
    remarks += [SAID[consistency]] if consistency in SAID else []
    remarks += ["offline, not ranked"] if offline else ["bound"] if bound else ["centralised"] * centralised
    remarks += ["bytes as declared"] * (not centralised and declares_bytes(estimator))
    lost = "every trial failed" if np.isnan(rmse) else f"{failed} failed, numbers of the other trials"
    return ", ".join(remarks + [lost] * int(failed > 0))


def decided(verdict: str, look: int, trials: int) -> str:
    """What a run until decided found of a row, and when."""
    if not verdict:
        return ""
    stopped = verdict != "open" and trials <= look
    return f"{verdict}{', stopped' * stopped} at n = {look}"


def _of_others(form: Any) -> Any:
    """Writes a comparison with the baseline; nothing for the baseline itself."""
    return lambda estimator, baseline, *values: "" if estimator == baseline else form(*values)


def percents(digits: int) -> Any:
    """A format of a share, with so many digits."""
    return lambda share: percent(share, digits)


RMSE = (
    numbers("RMSE [m]", "rmse", form=metres),
    numbers("95 %", "rmse_low", "rmse_high", form=interval(metres), under=True),
)
ANEES = numbers("ANEES", "anees", form=ratio), numbers("95 %", "anees_low", "anees_high", form=interval(ratio))
OTHER = ("estimator", "baseline")
REMARK = words(
    "remark",
    *("consistency", "centralised", "bound", "offline", "failed", "baseline", "stream"),
    of=("estimator", "certificate", "consistency", "centralised", "bound", "offline", "failed", "rmse"),
    form=remark,
    under=True,
)
RESULTS = (
    words("scenario"),
    words("estimator"),
    REMARK,
    words("senses", under=True),
    words("checks", "certificate", form=short_certificate),
    *RMSE,
    numbers("median", "rmse_median", form=metres, detail=True),
    numbers("outlying", form=percents(0), detail=True),
    numbers("95 %", *(f"outlying_{end}" for end in ("low", "high")), form=interval(percents(0))),
    numbers("rank", form=lambda rank: fixed(rank, 1)),
    words("group"),
    numbers("vs baseline", "change", of=(*OTHER, "change"), form=_of_others(change)),
    numbers(
        "95 %",
        *(ends := ("change_low", "change_high")),
        of=(*OTHER, *ends),
        form=_of_others(interval(change)),
        under=True,
    ),
    numbers("p (Holm)", "p_holm", form=p_value, spare=2),
    *ANEES,
    numbers("median", "anees_median", form=ratio, under=True, detail=True),
    numbers("collapsed", form=percents(0), spare=7, detail=True),
    numbers("95 %", "collapsed_low", "collapsed_high", form=interval(percents(0))),
    numbers("in 95 %", "coverage95", form=percents(0), spare=4),
    numbers("NLL", "nll", form=ratio, under=True, spare=5, detail=True),
    numbers("ellipse [m²]", "area95", form=ratio, detail=True),
    numbers("diverged", form=percents(1), spare=3, detail=True),
    numbers("messages", form=ratio, spare=6, detail=True),
    numbers("bytes", form=count),
    numbers("µs", "seconds", form=microseconds, under=True),
    numbers("trials", under=True, spare=1),
)


DECIDED = words("decided", "verdict", "look", of=("verdict", "look", "trials"), form=decided)


# A run's results as `Table`s: every scenario, who is best, who is over-confident, the change over a sweep.

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
            "sentence": summary_sentence(one),
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


# What scenarios are: the parameters that they share, with units, and scenario by scenario those that differ.

DIFFERS = "differs"
SHOWN = 12  # characters of a stream's hash


def scenario_tables(table: pd.DataFrame, settings: Mapping[str, Mapping[str, Any]]) -> list[Table]:
    """For each kind of scenario, those that have the same parameters: its scenarios, then its parameters.

    Args:
        table: from `compare`.
        settings: the parameters of each scenario, as the manifest has them.

    """
    kinds: dict[tuple[str, ...], list[str]] = {}
    for scenario in dict.fromkeys(table["scenario"]):
        kinds.setdefault(tuple(settings.get(scenario, {})), []).append(str(scenario))
    once = table.sort_values("trials", ascending=False, kind="stable").drop_duplicates("scenario")
    facts = once.set_index("scenario").to_dict("index")
    out = []
    for i, (names, scenarios) in enumerate(kinds.items()):
        given = {scenario: settings.get(scenario, {}) for scenario in scenarios}
        unlike = [name for name in names if len({repr(one[name]) for one in given.values()}) > 1]
        ending = f"-{i + 1}" if len(kinds) > 1 else ""
        out.append(_scenarios(f"scenarios{ending}", given, [n for n in unlike if n != "robots"], facts))
        out += [_parameters(f"parameters{ending}", given, names, unlike)] if names else []
    return out


def _scenarios(name: str, given: Mapping[str, Mapping[str, Any]], unlike: list[str], facts: Any) -> Table:
    columns = (
        words("scenario"),
        numbers("robots"),
        numbers("trials"),
        words("baseline"),
        *(numbers(_with_unit(parameter), parameter) for parameter in unlike),
        words("stream", form=lambda stream: str(stream)[:SHOWN]),
    )
    rows: list[Row] = [
        {
            "scenario": scenario,
            **{key: facts[scenario][key] for key in ("robots", "trials", "baseline", "stream")},
            **{parameter: written(values[parameter]) for parameter in unlike},
        }
        for scenario, values in given.items()
    ]
    about = (
        "Scenarios, with the parameters in which they differ. Results of equal streams can be paired: the hash is over "
        "every reading, link and initial position of the trials."
    )
    return Table(name, about, columns, rows, {"data-scenario": "scenario"})


def _parameters(name: str, given: Mapping[str, Mapping[str, Any]], names: tuple[str, ...], unlike: list[str]) -> Table:
    columns = words("parameter"), words("value"), words("unit"), words("meaning")
    first = next(iter(given.values()))
    rows: list[Row] = []
    for parameter in names:
        unit, meaning = MEANINGS.get(parameter, ("", ""))
        value = DIFFERS if parameter in unlike else written(first[parameter])
        rows.append({"parameter": parameter, "value": value, "unit": unit, "meaning": meaning})
    about = "What these scenarios share; parameters that differ have their values beside each scenario, above."
    return Table(name, about, columns, rows)


def written(value: Any) -> str:
    """A parameter's value in a few words."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value:g}".replace("inf", "∞")
    if isinstance(value, list | tuple):
        nested = any(isinstance(one, list | tuple) for one in value)
        return ("; " if nested else ", ").join(map(written, value)) or "none"
    return str(value)


def _with_unit(parameter: str) -> str:
    unit = MEANINGS.get(parameter, ("", ""))[0]
    return f"{parameter} [{unit}]" if unit else parameter


# What estimators counted during a run, such as packets that they refused, as a `Table`.


def events(rows: pd.DataFrame) -> Table:
    """What estimators counted, over all scenarios: sums, and maxima of what is called largest."""
    columns = (
        words("estimator"),
        words("event"),
        numbers("in all", "total", form=_short),
        numbers("scenarios", form=count),
        words("most in", "most"),
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
                total = float(each.agg(how))
                most = str(some.idxmax())
                found.append(
                    {"estimator": estimator, "event": event, "total": total, "scenarios": len(some), "most": most}
                )
    return Table("events", "Events that estimators counted, summed over trials and robots.", columns, found)


def _short(value: float) -> str:
    return f"{value:.3g}"


# What failed in a run, each different failure once.

SHOWN_FAILURES = 10  # trials that are named
FEW = 3  # scenarios that are named


def failures(rows: pd.DataFrame) -> list[tuple[str, str]]:
    """Each different failure of an estimator in a line with its trials, and where it was raised."""
    failed = rows[rows["failure"].notna()].drop_duplicates(["scenario", "estimator", "trial"])
    out = []
    for (estimator, failure), part in failed.groupby(["estimator", "failure"], sort=False):
        out.append((f"{estimator}, {_where(part)}: {failure}", str(part["traceback"].iloc[0])))
    return out


def _where(part: pd.DataFrame) -> str:
    """The trials of one scenario, or how many there are in which scenarios."""
    scenarios = list(dict.fromkeys(part["scenario"]))
    if len(scenarios) == 1:
        trials = ", ".join(map(str, sorted(part["trial"])[:SHOWN_FAILURES])) + " ..." * (len(part) > SHOWN_FAILURES)
        return f"{scenarios[0]}, trial {trials}"
    named = ", ".join(scenarios[:FEW]) + " ..." * (len(scenarios) > FEW)
    return f"{counted(len(part), 'trial')} of {counted(len(scenarios), 'scenario')} ({named})"


class FailureKind(NamedTuple):
    """A failure that occurred in one trial or in many, whatever numbers its message holds."""

    message: str  # of its first trial
    trials: int
    where: list[tuple[str, str, int]]  # scenario, estimator, trials
    traceback: str  # of its first trial


def failure_kinds(rows: pd.DataFrame) -> list[FailureKind]:
    """Each kind of failure once, the most frequent first."""
    failed = rows[rows["failure"].notna()].drop_duplicates(["scenario", "estimator", "trial"])
    kinds = failed["failure"].astype(str).str.replace(r"\d+(\.\d+)?(e[-+]?\d+)?", "0", regex=True)
    found = []
    for _, part in failed.groupby(kinds, sort=False):
        cells = part.groupby(["scenario", "estimator"], sort=False)
        where = [(str(scenario), str(estimator), len(one)) for (scenario, estimator), one in cells]
        found.append(FailureKind(str(part["failure"].iloc[0]), len(part), where, str(part["traceback"].iloc[0])))
    return sorted(found, key=lambda kind: -kind.trials)


# Short labels for long configured estimators, on the page alone: files keep the labels in full.
#
# A configuration that the study names ("raw" for "anchor_reading=rssi") is written with that name, `ekf-local[raw]`. Of
# others that are longer than `LONGEST`, the one that is its method's best is `mrsl-rssi[best]`, and the rest get
# numbers, `mrsl-rssi[#2]`. The page's list of estimators is the legend.

LONGEST = 24  # characters that fit into a column


@dataclass(frozen=True)
class ShortNames:
    """Labels in full and, of those that have one, their short label."""

    known: Mapping[str, str]  # label -> short label

    def of(self, label: str) -> str:
        """The short label, or the label itself."""
        return self.known.get(label, label)

    def within(self, text: str) -> str:
        """A text with every label that has a short one replaced by it."""
        return self._pattern.sub(lambda found: self.known[found[0]], text) if self.known else text

    @cached_property
    def _pattern(self) -> re.Pattern[str]:
        return re.compile("|".join(map(re.escape, sorted(self.known, key=len, reverse=True))))


def short_names(labels: Iterable[str], variants: Mapping[str, str]) -> ShortNames:
    """The short labels of estimators, each used once; `variants`: the study's name of a configuration -> parameters."""
    labels = list(dict.fromkeys(labels))
    named = {_sorted(parameters): name for name, parameters in variants.items()}
    known: dict[str, str] = {}
    taken = set(labels)
    count: dict[str, int] = {}
    for label in labels:
        method, bracket, inside = label.partition("[")
        if not bracket:
            continue
        count[method] = count.get(method, 0) + 1
        name = named.get(_sorted(inside.removesuffix("]")), "")
        if not name and len(label) <= LONGEST:
            continue
        best = "best" * (standing(label) == "at its best")
        short = f"{method}[{name or best or f'#{count[method]}'}]"
        if len(short) < len(label) and short not in taken:
            known[label] = short
            taken.add(short)
    return ShortNames(known)


def _sorted(parameters: str) -> tuple[str, ...]:
    """Parameters in an order that does not depend on how they were written."""
    return tuple(sorted(part.strip() for part in parameters.split(",")))


# What all tables, sentences and figures of a report are made from.


class Numbers(NamedTuple):
    """A run, its table and its trials, and how its estimators are drawn and written."""

    kept: StoredRun
    table: pd.DataFrame  # of `compare`
    results: TrialTable
    looks: dict[str, Look]
    names: ShortNames
