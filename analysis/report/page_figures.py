"""The figures of a page: their panels, each of one scenario or of some estimators, and what they show."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd
from markupsafe import Markup

from cooploc.analysis.formats import counted
from cooploc.analysis.metrics.curves import sweep
from cooploc.analysis.report import svg, svg_figures
from cooploc.analysis.report.result_tables import Numbers

SCATTERED = 3  # scenarios of an experiment whose accuracy is drawn against consistency and cost
FEW = 4  # scenarios that the first figure of a page draws side by side
Drawn = tuple[str, str, tuple[str, ...]]  # an SVG file, its scenario, its estimators
HOLLOW = "Hollow: over-confident; grey: centralised; dotted: the floor."


class Panel(NamedTuple):
    """A small figure, and what the page's filters know of it."""

    svg: Markup
    scenario: str = ""
    estimators: tuple[str, ...] = ()


class Shown(NamedTuple):
    """A figure: panels, and what they show."""

    anchor: str
    panels: list[Panel]
    caption: str
    width: str = ""  # of a panel: "", "middle" or "wide"
    head: str = ""  # of what may be folded away


def first_figure(numbers: Numbers, counter: Iterator[int]) -> Shown:
    """The figure of the first screen: every RMSE of a few scenarios, or of many those relative to the baseline's."""
    ended = numbers.table[numbers.table["rmse"].notna()]
    if few(ended):
        return dots(ended, numbers, counter)
    baselines = ", ".join(map(numbers.names.of, dict.fromkeys(ended["baseline"])))
    number = ended["estimator"].nunique()
    most = svg_figures.MOST
    some = f" Shown are the {most} of {number} that ran in the most scenarios." * (number > most)
    drawn = svg_figures.overview(numbers.table, numbers.looks, numbers.names)
    return _shown(
        [(drawn, "", ())],
        f"Position RMSE of every estimator divided by that of the baseline ({baselines}): a mark for each scenario, a "
        f"bar at their median; left of the dotted line the error is smaller. Hollow: over-confident; grey: "
        f"centralised.{some}",
        counter,
        "whole",
    )


def few(table: pd.DataFrame) -> bool:
    """Whether the scenarios fit side by side."""
    return bool(table["scenario"].nunique() <= FEW)


def lines(rows: pd.DataFrame, numbers: Numbers, counter: Iterator[int]) -> Shown:
    """RMSE over what the scenarios sweep."""
    groups = svg_figures.panels(rows, numbers.looks)
    svgs = svg_figures.lines(rows, numbers.looks, numbers.names)
    family, parameter, _ = sweep(rows["scenario"].iloc[0])
    one = "each panel one estimator and its variants, all others in grey" if len(svgs) > 1 else "with intervals"
    return _shown(
        [(drawn, "", tuple(names)) for drawn, names in zip(svgs, groups, strict=True)],
        f"Position RMSE over {parameter} in {family}, {one}; bands are 95 % intervals over trials. Hollow markers: "
        "over-confident; a broken line: so at most of the values; grey and dotted: centralised; black and dotted: the "
        f"floor. {trials(rows)}",
        counter,
        "wide" if len(svgs) == 1 else "",
    )


def dots(rows: pd.DataFrame, numbers: Numbers, counter: Iterator[int]) -> Shown:
    """RMSE of every estimator, scenario by scenario."""
    drawn: list[Drawn] = [
        (svg_figures.dots(part, numbers.looks, numbers.names), str(scenario), ())
        for scenario, part in rows.groupby("scenario", sort=False)
        if part["rmse"].notna().any()
    ]
    said = f"Position RMSE, smallest on top, with 95 % intervals over trials. {HOLLOW} {trials(rows)}"
    return _shown(drawn, said, counter, "wide")


def scatter(rows: pd.DataFrame, numbers: Numbers, counter: Iterator[int]) -> Shown:
    """Accuracy against consistency and cost, in the first, the middle and the last scenario."""
    ended = rows[rows["rmse"].notna()]
    labels = list(dict.fromkeys(ended["scenario"]))
    chosen = labels if len(labels) <= SCATTERED else [labels[0], labels[len(labels) // 2], labels[-1]]
    drawn: list[Drawn] = []
    for label in chosen:
        part = ended[ended["scenario"] == label]
        drawn += [(svg_figures.against(part, by, numbers.looks), label, ()) for by in ("anees", "bytes", "seconds")]
    some = f" Shown are {len(chosen)} of {len(labels)} scenarios, the first, the middle and the last." * (
        len(chosen) < len(labels)
    )
    there = ended[ended["scenario"].isin(chosen)]
    drawn += [(svg_figures.key(there, numbers.looks, numbers.names), "", ())] if chosen else []
    said = (
        "Accuracy against consistency (grey band: neither over-confident nor conservative), bytes and time, with 95 % "
        "intervals over trials, cut off where they reach beyond the values. Broken line: the Pareto front, "
        "estimators than which no other is at least as good in both and better in one; centralised ones are never on "
        f"it, over-confident estimators (hollow) may be.{some} {trials(there)}"
    )
    return _shown(drawn, said, counter, "middle", "Accuracy against consistency, bytes and time")


def trials(part: pd.DataFrame) -> str:
    """How many trials a figure is made from."""
    counts = np.unique(part["trials"])
    if not len(counts):
        return "No trials."
    few = counted(counts[0], "trial")
    return f"{few} a scenario." if len(counts) == 1 else f"{counts[0]} to {counts[-1]} trials a scenario."


def _shown(
    drawn: list[Drawn],
    caption: str,
    counter: Iterator[int],
    width: str,
    head: str = "",
) -> Shown:
    """A figure of SVG files, each with its scenario and its estimators; matplotlib has escaped every text."""
    panels = []
    for file, scenario, estimators in drawn:
        number = next(counter)
        label = f"{caption.partition(';')[0].partition('. ')[0]}{': ' * bool(scenario)}{scenario}"
        panels.append(Panel(Markup(svg.inline(file, number, label)), scenario, estimators))
    return Shown(f"figure-{next(counter)}", panels, caption, width, head)
