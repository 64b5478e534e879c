"""One experiment of a report: what it says in words, its figures, and its tables."""

import hashlib
import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd
from markupsafe import Markup

from cooploc.analysis.claims.trial_table import TrialTable
from cooploc.analysis.execution.stored_run import Kept
from cooploc.analysis.metrics.certificate_line import refused
from cooploc.analysis.metrics.over_time import sweep
from cooploc.analysis.metrics.ranking import rank_groups
from cooploc.analysis.metrics.statistics import LEAST_TRIALS
from cooploc.analysis.metrics.stopping import FIXED
from cooploc.analysis.plot.style import Look
from cooploc.analysis.report import result_tables, summaries, svg, svg_figures
from cooploc.analysis.report.tables import Table

SWEEP = 3  # values from which a sweep becomes a line
SCATTERED = 3  # scenarios of an experiment whose accuracy is drawn against consistency and cost


class Shown(NamedTuple):
    """A figure: panels, and what they show."""

    panels: list[Markup]
    caption: str
    width: str = ""  # of a panel: "", "middle" or "wide"
    head: str = ""  # of what may be folded away


class Numbers(NamedTuple):
    """What all tables, sentences and figures of a report are made from."""

    kept: Kept
    table: pd.DataFrame  # of `compare`
    results: TrialTable
    looks: dict[str, Look]


class Experiment(NamedTuple):
    """An experiment, as a section of the page."""

    name: str
    anchor: str
    found: list[summaries.Standing]
    sentence: str
    sweeps: list[str]
    figures: list[Shown]
    tables: list[Table]

    @property
    def standings(self) -> list[tuple[str, str]]:
        """Every scenario with its sentence on who is best."""
        return [(one.scenario, summaries.sentence(one)) for one in self.found]


def experiment(name: str, plan: dict[str, list[str]], numbers: Numbers, counter: Iterator[int]) -> Experiment:
    """An experiment with the estimators that it has in each scenario; `counter` numbers its figures."""
    labels = zip(numbers.table["scenario"], numbers.table["estimator"], strict=True)
    part = numbers.table[[estimator in plan.get(scenario, ()) for scenario, estimator in labels]]
    found = summaries.standings(part, numbers.results)
    anchor = f"experiment-{_anchor(name)}"
    sweeps: list[str] = []
    shown: list[Shown] = []
    changed: list[Table] = []
    for (_, parameter), group in groups(list(plan)).items():
        rows = part[part["scenario"].isin(group)]
        if parameter:
            changes = summaries.changes(group, dict.fromkeys(rows["estimator"]), numbers.results)
            sweeps.append(summaries.swept(group, changes, numbers.results.stopping))
            changed.append(result_tables.sweep(f"{anchor}-sweep{len(changed) + 1}", changes, parameter))
            shown.append(_lines(rows, numbers, counter))
        else:
            shown.append(_dots(rows, numbers, counter))
    shown.append(_scatter(part, numbers, counter))
    ranks = {str(label): ranked(rows, numbers.results) for label, rows in part.groupby("scenario", sort=False)}
    table = result_tables.results(anchor, part, ranks, f"{name}: {_about(part, numbers)}")
    said = summaries.overall(found) + " " + summaries.confidence(part)
    return Experiment(name, anchor, found, said, [line for line in sweeps if line], shown, [table, *changed])


def ranked(rows: pd.DataFrame, results: TrialTable) -> tuple[dict[str, float], dict[str, str]]:
    """Mean ranks (of a fixed number of trials) and letters of one scenario's estimators that failed nowhere.

    One that failed would take its trials from all others, and change their ranks and letters. What is offline is not
    ranked with filters.
    """
    ended = rows["rmse"].notna() & (rows["failed"] == 0) & ~rows["offline"]
    names = list(rows.loc[ended & ~rows["certificate"].map(refused).astype(bool), "estimator"])
    if not names:
        return {}, {}
    mse = results.errors(rows["scenario"].iloc[0], names)
    return rank_groups(mse.dropna() if results.stopping is FIXED else mse, results.stopping)


def groups(labels: list[str]) -> dict[tuple[str, str], list[str]]:
    """The scenarios by family and what they sweep; those of short sweeps together with those that sweep nothing."""
    found: dict[tuple[str, str], list[str]] = {}
    for label in labels:
        found.setdefault(sweep(label)[:2], []).append(label)
    out: dict[tuple[str, str], list[str]] = {}
    for label in labels:
        which = sweep(label)[:2]
        out.setdefault(which if which[1] and len(found[which]) >= SWEEP else ("", ""), []).append(label)
    return out


def _lines(rows: pd.DataFrame, numbers: Numbers, counter: Iterator[int]) -> Shown:
    svgs = svg_figures.lines(rows, numbers.looks)
    family, parameter, _ = sweep(rows["scenario"].iloc[0])
    one = "each panel one estimator and its variants, all others in grey" if len(svgs) > 1 else "with intervals"
    return Shown(
        _panels(svgs, f"position RMSE over {parameter}", counter),
        f"Position RMSE over {parameter} in {family}, {one}; bands are 95 % intervals over trials. Hollow markers: "
        f"over-confident; a broken line: so at most of the values; grey and dotted: centralised; black and dotted: the "
        f"floor. {_about(rows, numbers)}",
        width="wide" if len(svgs) == 1 else "",
    )


def _dots(rows: pd.DataFrame, numbers: Numbers, counter: Iterator[int]) -> Shown:
    svgs = [
        svg_figures.dots(part, numbers.looks)
        for _, part in rows.groupby("scenario", sort=False)
        if part["rmse"].notna().any()
    ]
    about = (
        "Position RMSE, smallest on top, with 95 % intervals over trials. Hollow: over-confident; grey: centralised; "
    )
    about += "dotted: the floor."
    return Shown(_panels(svgs, "position RMSE of every estimator", counter), f"{about} {_about(rows, numbers)}", "wide")


def _scatter(rows: pd.DataFrame, numbers: Numbers, counter: Iterator[int]) -> Shown:
    """Accuracy against consistency and cost, in the first, the middle and the last scenario."""
    ended = rows[rows["rmse"].notna()]
    labels = list(dict.fromkeys(ended["scenario"]))
    chosen = labels if len(labels) <= SCATTERED else [labels[0], labels[len(labels) // 2], labels[-1]]
    svgs = []
    for label in chosen:
        part = ended[ended["scenario"] == label]
        svgs += [svg_figures.against(part, other, numbers.looks) for other in ("anees", "bytes", "seconds")]
    some = f" Shown are {len(chosen)} of {len(labels)} scenarios, the first, the middle and the last." * (
        len(chosen) < len(labels)
    )
    drawn = ended[ended["scenario"].isin(chosen)]
    svgs += [svg_figures.key(drawn, numbers.looks)] if chosen else []
    return Shown(
        _panels(svgs, "position RMSE against ANEES, bytes and seconds", counter),
        "Accuracy against consistency (grey band: neither over-confident nor conservative), bytes and time, with 95 % "
        "intervals over trials, cut off where they reach beyond the values. Broken line: the Pareto front, "
        "estimators than which no other is at least as good in both and better in one; centralised ones are never on "
        f"it, over-confident estimators (hollow) may be.{some} {_about(drawn, numbers)}",
        width="middle",
        head="Accuracy against consistency, bytes and time",
    )


def _panels(svgs: list[str], label: str, counter: Iterator[int]) -> list[Markup]:
    return [Markup(svg.inline(one, next(counter), label)) for one in svgs]  # matplotlib has escaped every text


def _about(part: pd.DataFrame, numbers: Numbers) -> str:
    """Trials, seed, test, correction and streams, for a caption."""
    counts = np.unique(part["trials"])
    trials = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}" if len(counts) else "0"
    hashes = list(dict.fromkeys(part["stream"]))
    streams = ", ".join(one[:12] for one in hashes[:4]) + (
        f" and {len(hashes) - 4} more, listed below" if len(hashes) > 4 else ""
    )
    few = f" Below {LEAST_TRIALS} trials there are no intervals." if len(counts) and counts[0] < LEAST_TRIALS else ""
    tested = int(numbers.table["p"].notna().sum())
    test = "confidence sequences of the change" if numbers.kept.looks else "t test of the change"
    return (
        f"n = {trials} trials a scenario, seed {numbers.kept.manifest['seed']}; {test} against "
        f"the baseline, Holm over the {tested} comparisons of this report; streams {streams}.{few}"
    )


def _anchor(name: str) -> str:
    """A name for links and files."""
    plain = re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")[:60]
    return plain if plain == name else f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:6]}"
