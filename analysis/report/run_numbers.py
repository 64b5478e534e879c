"""Numbers, labels and figures of a run, from which its page and its paper are made."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cooploc.analysis.claims.trial_table import TrialTable, collect
from cooploc.analysis.execution.run_directory import StoredRun
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.sequential import ANYTIME, add_decisions
from cooploc.analysis.metrics.statistics import FIXED
from cooploc.analysis.metrics.sweeps import add_sweep, sweeps
from cooploc.analysis.plot import results, style
from cooploc.analysis.report import sentences
from cooploc.analysis.report.labels import LONGEST, Labels, short_labels, variants_of
from cooploc.estimators.errors import count_of

SWEEP = 3  # values from which a sweep becomes a line
FLOORED = 20  # robots: the floor of larger teams takes seconds for each scenario


class Numbers(NamedTuple):
    """A run, its table and its trials, and how its estimators are drawn and written."""

    kept: StoredRun
    table: pd.DataFrame  # of `compare`
    results: TrialTable
    pens: dict[str, style.Pen]
    names: Labels


def numbers_of(kept: StoredRun, longest: int = LONGEST) -> Numbers:
    """Return the run's table and trials, and how its estimators are drawn and written; a label longer has a letter."""
    table = compare(kept.rows, kept.baselines, full=True)
    table = table if kept.comparisons is None else add_decisions(table, kept.comparisons)
    estimators = [str(name) for name in kept.rows["estimator"].unique()]
    names = short_labels(estimators, variants_of(kept.manifest["study"]), longest)
    return Numbers(kept, table, collect(kept.rows, ANYTIME if kept.looks else FIXED), style.pens(estimators), names)


def rows_of_experiment(table: pd.DataFrame, plan: Mapping[str, list[str]]) -> pd.DataFrame:
    """Return the rows of an experiment: `plan` has its estimators by scenario."""
    labels = zip(table["scenario"], table["estimator"], strict=True)
    return table[[estimator in plan.get(scenario, ()) for scenario, estimator in labels]]


def group_by_sweep(labels: list[str]) -> dict[tuple[str, str], list[str]]:
    """Return scenarios by family and swept parameter; short sweeps are with those that sweep nothing."""
    which = {label: point[:2] for label, point in sweeps(labels).items()}
    sizes = Counter(which.values())
    out: dict[tuple[str, str], list[str]] = {}
    for label, (family, parameter) in which.items():
        long = parameter and sizes[family, parameter] >= SWEEP
        out.setdefault((family, parameter) if long else ("", ""), []).append(label)
    return out


def rows_of_estimator_sweeps(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the rows of one scenario whose estimators sweep a parameter, by it: each with its family's name."""
    read = add_sweep(rows, "estimator")
    lengths = read.groupby(["family", "parameter"])["value"].transform("size")
    long = read[(read["parameter"] != "") & (lengths >= SWEEP)]
    return {str(name): part for name, part in long.groupby("parameter", sort=False)}


def sweeps_of_experiment(rows: pd.DataFrame, scenarios: list[str], costly: list[str]) -> Iterator[sentences.Sweep]:
    """Yield the sweeps of scenarios in rows of `compare`, and those of estimators in the scenarios `costly`."""
    for (_, parameter), group in group_by_sweep(scenarios).items():
        if parameter:
            names = dict.fromkeys(rows.loc[rows["scenario"].isin(group), "estimator"])
            yield sentences.sweep_of_scenarios(group, names)
    for label in costly:
        for part in rows_of_estimator_sweeps(rows[rows["scenario"] == label]).values():
            yield sentences.sweep_of_estimators(label, part)


def first_middle_last(labels: list[str]) -> list[str]:
    """Return the first, the middle and the last of many labels, or all of at most three."""
    return labels if len(labels) <= 3 else [labels[0], labels[len(labels) // 2], labels[-1]]


def trial_counts(part: pd.DataFrame) -> str:
    """Return how many trials a scenario has."""
    counts = np.unique(part["trials"])
    if not len(counts):
        return "No trials"
    return f"{count_of(counts[0], 'trial') if len(counts) == 1 else f'{counts[0]} to {counts[-1]} trials'} a scenario"


HOLLOW = "Hollow: over-confident; grey: centralised"
OVER = "Position RMSE over {} in {}; bands: 95 % intervals over trials. {}; broken lines: over-confident mostly."
DOTS = f"Position RMSE with 95 % intervals over trials. {HOLLOW}; dotted: the Cramer-Rao bound of all readings."
AGAINST = "Position RMSE against {} in {}, with 95 % intervals over trials. {}."
OTHERS = {
    "anees": "ANEES (grey band: consistent)",
    "bytes": "bytes (broken: the Pareto front)",
    "seconds": "time (broken: the Pareto front)",
}


class RunFigure(NamedTuple):
    """A figure of some rows of `compare`."""

    figure: Figure
    words: list[str]  # of its file's name
    caption: str
    rows: pd.DataFrame


def draw_experiment(
    rows: pd.DataFrame,
    drawn: list[str],
    costly: list[str],
    names: Labels,
    pens: results.Pens,
    medium: style.Style,
    kind: str = "",
) -> Iterator[RunFigure]:
    """Draw rows of `compare` with floors: every sweep, the scenarios `drawn` side by side, and those `costly` by cost.

    A sweep of estimators is drawn in the `costly`, too. A `kind` of figure is drawn alone: "rmse", or one of `OTHERS`.
    """
    ended = dict(list(rows[rows["rmse"].notna()].groupby("scenario", sort=False)))
    labels, several = list(dict.fromkeys(rows["scenario"])), medium.width > 4
    for (family, parameter), group in group_by_sweep(labels).items() if kind in ("", "rmse") else ():
        part = rows[rows["scenario"].isin(group)]
        if parameter and part["rmse"].notna().any():
            figure = results.sweep_panels(add_sweep(part), pens, names.shorten, medium)
            caption = OVER.format(results.SWEPT.get(parameter, parameter), family, HOLLOW)
            yield RunFigure(figure, [family, parameter], caption, part)
    shown, across = [label for label in drawn if label in ended], 3 if several else 1
    for i in range(0, len(shown), across) if kind in ("", "rmse") else ():
        parts = [ended[label] for label in shown[i : i + across]]
        yield RunFigure(results.ranking(parts, pens, names.shorten, medium), ["rmse", shown[i]], DOTS, pd.concat(parts))
    for label in filter(ended.__contains__, costly if kind == "" else ()):
        for parameter, part in rows_of_estimator_sweeps(rows[rows["scenario"] == label]).items():
            own = style.pens(map(str, part["family"]))
            figure = results.sweep_panels(part.assign(estimator=part["family"]), own, names.shorten, medium)
            caption = OVER.format(results.SWEPT.get(parameter, parameter), label, HOLLOW)
            yield RunFigure(figure, [parameter, label], caption, part)
    for label in filter(ended.__contains__, costly if kind != "rmse" else ()):
        for others in [(kind,)] if kind else [tuple(OTHERS)] if several else [(other,) for other in OTHERS]:
            figure = results.scatter(ended[label], others, pens, names.shorten, medium)
            caption = AGAINST.format(", ".join(OTHERS[other] for other in others), label, HOLLOW)
            yield RunFigure(figure, ["-".join(others), label], caption, ended[label])
