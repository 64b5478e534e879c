"""One experiment of a report: its figures, its tables, and what it says in words."""

import hashlib
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import pandas as pd

from cooploc.analysis.claims.trial_table import TrialTable
from cooploc.analysis.metrics.curves import sweep
from cooploc.analysis.metrics.ranking import is_refused, rank_groups
from cooploc.analysis.metrics.sequential import FIXED
from cooploc.analysis.metrics.statistics import LEAST_TRIALS
from cooploc.analysis.report import answer, page_figures, result_tables, summaries
from cooploc.analysis.report.page_figures import Shown
from cooploc.analysis.report.run_numbers import Numbers
from cooploc.analysis.report.tables import Table

SWEEP = 3  # values from which a sweep becomes a line


class Experiment(NamedTuple):
    """An experiment, as a section of the page."""

    name: str
    anchor: str
    found: list[summaries.Standing]
    sentences: list[str]  # its answer, where the report has several experiments, and what it says of sweeps
    figures: list[Shown]
    tables: list[Table]
    standings: Table  # who is best where


def experiment(name: str, plan: dict[str, list[str]], numbers: Numbers, counter: Iterator[int]) -> Experiment:
    """An experiment with the estimators that it has in each scenario; `counter` numbers its figures."""
    labels = zip(numbers.table["scenario"], numbers.table["estimator"], strict=True)
    part = numbers.table[[estimator in plan.get(scenario, ()) for scenario, estimator in labels]]
    found = summaries.standings(part, numbers.results)
    anchor = f"experiment-{_anchor(name)}"
    only = len(part) == len(numbers.table)
    said = [] if only else [answer.lowest(found, part, numbers.results), answer.over_confident(part)]
    shown: list[Shown] = []
    changed: list[Table] = []
    for (_, parameter), group in groups(list(plan)).items():
        rows = part[part["scenario"].isin(group)]
        if parameter:
            changes = summaries.changes(group, dict.fromkeys(rows["estimator"]), numbers.results)
            said.append(summaries.swept(group, changes, numbers.results.stopping))
            changed.append(result_tables.sweep(f"{anchor}-sweep{len(changed) + 1}", changes, parameter))
            shown.append(page_figures.lines(rows, numbers, counter))
        elif not (only and page_figures.few(part)):  # else it is the first figure of the page
            shown.append(page_figures.dots(rows, numbers, counter))
    shown.append(page_figures.scatter(part, numbers, counter))
    ranks = {str(label): ranked(rows, numbers.results) for label, rows in part.groupby("scenario", sort=False)}
    table = result_tables.results(anchor, part, ranks, f"{name}: {_about(part, numbers)}")
    standings = replace(result_tables.best(found), name=f"best-{anchor}")
    return Experiment(name, anchor, found, list(filter(None, said)), shown, [table, *changed], standings)


def ranked(rows: pd.DataFrame, results: TrialTable) -> tuple[dict[str, float], dict[str, str]]:
    """Mean ranks (of a fixed number of trials) and letters of one scenario's estimators that failed nowhere.

    One that failed would take its trials from all others, and change their ranks and letters. What is offline is not
    ranked with filters.
    """
    ended = rows["rmse"].notna() & (rows["failed"] == 0) & ~rows["offline"]
    names = list(rows.loc[ended & ~rows["certificate"].map(is_refused).astype(bool), "estimator"])
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


def _about(part: pd.DataFrame, numbers: Numbers) -> str:
    """Trials, seed, test and correction, for the caption of a table."""
    few = part["trials"].min() < LEAST_TRIALS
    tested = int(numbers.table["p"].notna().sum())
    test = "confidence sequences of the change" if numbers.kept.looks else "t test of the change"
    return (
        f"{page_figures.trials(part).removesuffix('.')}, seed {numbers.kept.manifest['seed']}; {test} against "
        f"the baseline, Holm over the {tested} comparisons of this report."
        + f" Below {LEAST_TRIALS} trials there are no intervals."
        * bool(few)
    )


def _anchor(name: str) -> str:
    """A name for links and files."""
    plain = re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")[:60]
    return plain if plain == name else f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:6]}"
