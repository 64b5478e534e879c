"""The figures of a page as SVG inside it: their panels, each of one scenario or of some estimators, and their captions.

Text stays text, ids are unique, nothing links elsewhere, and the same numbers give the same bytes.
"""

import io
import re
import warnings
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from cooploc.analysis.formats import count_of
from cooploc.analysis.metrics.curves import sweep
from cooploc.analysis.plot import results
from cooploc.analysis.plot.style import PAGE, round_numbers
from cooploc.analysis.report.run_numbers import Numbers, first_middle_last

FEW = 4  # scenarios that the first figure of a page draws side by side
Drawn = tuple[Figure, str, tuple[str, ...]]  # a figure, its scenario, its estimators


class Panel(NamedTuple):
    """A small figure, with the scenario and the estimators by which a page filters it."""

    svg: Markup
    scenario: str = ""
    estimators: tuple[str, ...] = ()


class Shown(NamedTuple):
    """A figure of a page: panels with a caption."""

    anchor: str
    panels: list[Panel]
    caption: str
    width: str = ""  # of a panel: "", "middle" or "wide"
    head: str = ""  # of what may be folded away


def first_figure(numbers: Numbers, counter: Iterator[int]) -> Shown:
    """Draw every RMSE of a few scenarios, or of many those relative to the baseline's."""
    ended = numbers.table[numbers.table["rmse"].notna()]
    if is_few(ended):
        return dots(ended, numbers, counter)
    baselines = ", ".join(map(numbers.names.of, dict.fromkeys(ended["baseline"])))
    number, most = ended["estimator"].nunique(), results.MOST
    some = f" Shown are the {most} of {number} that ran in the most scenarios." * (number > most)
    caption = (
        f"Position RMSE of every estimator divided by that of the baseline ({baselines}): a mark for each scenario, a "
        f"bar at their median; left of the dotted line the error is smaller. Hollow: over-confident; grey: "
        f"centralised.{some}"
    )
    drawn = results.overview(numbers.table, numbers.looks, numbers.names.of)
    return _show([(drawn, "", ())], caption, counter, "whole")


def is_few(table: pd.DataFrame) -> bool:
    """Return whether the scenarios fit side by side."""
    return bool(table["scenario"].nunique() <= FEW)


def lines(rows: pd.DataFrame, numbers: Numbers, counter: Iterator[int]) -> Shown:
    """Draw RMSE over the value that the scenarios sweep."""
    groups = results.groups(rows, numbers.looks)
    figures = results.sweep_panels(rows, numbers.looks, numbers.names.of)
    family, parameter, _ = sweep(rows["scenario"].iloc[0])
    one = "each panel one estimator and its variants, all others in grey" if len(figures) > 1 else "with intervals"
    caption = (
        f"Position RMSE over {parameter} in {family}, {one}; bands are 95 % intervals over trials. Hollow markers: "
        "over-confident; a broken line: so at most of the values; grey and dotted: centralised; black and dotted: the "
        f"floor. {trial_counts(rows)}."
    )
    drawn = [(figure, "", tuple(names)) for figure, names in zip(figures, groups, strict=True)]
    return _show(drawn, caption, counter, "wide" if len(figures) == 1 else "")


def dots(rows: pd.DataFrame, numbers: Numbers, counter: Iterator[int]) -> Shown:
    """Draw RMSE of every estimator, scenario by scenario."""
    drawn: list[Drawn] = [
        (results.ranking([part], numbers.looks, numbers.names.of), str(scenario), ())
        for scenario, part in rows.groupby("scenario", sort=False)
        if part["rmse"].notna().any()
    ]
    caption = (
        "Position RMSE, smallest on top, with 95 % intervals over trials. Hollow: over-confident; grey: centralised; "
        f"dotted: the floor. {trial_counts(rows)}."
    )
    return _show(drawn, caption, counter, "wide")


def scatter(rows: pd.DataFrame, numbers: Numbers, counter: Iterator[int]) -> Shown:
    """Draw accuracy against consistency and cost, in the first, the middle and the last scenario."""
    ended = rows[rows["rmse"].notna()]
    labels = list(dict.fromkeys(ended["scenario"]))
    chosen = first_middle_last(labels)
    there = ended[ended["scenario"].isin(chosen)]
    drawn: list[Drawn] = [
        (results.scatter(part, [other], numbers.looks, numbers.names.of), str(label), ())
        for label, part in there.groupby("scenario", sort=False)
        for other in results.NAMES
    ]
    some = f" Shown are {len(chosen)} of {len(labels)} scenarios, the first, the middle and the last."
    caption = (
        "Accuracy against consistency (grey band: neither over-confident nor conservative), bytes and time, with 95 % "
        "intervals over trials, cut off where they reach beyond the values. Broken line: the Pareto front, "
        "estimators than which no other is at least as good in both and better in one; centralised ones are never on "
        f"it, over-confident estimators (hollow) may be.{some * (len(chosen) < len(labels))} {trial_counts(there)}."
    )
    return _show(drawn, caption, counter, "middle", "Accuracy against consistency, bytes and time")


def trial_counts(part: pd.DataFrame) -> str:
    """Return how many trials a scenario has."""
    counts = np.unique(part["trials"])
    if not len(counts):
        return "No trials"
    return f"{count_of(counts[0], 'trial') if len(counts) == 1 else f'{counts[0]} to {counts[-1]} trials'} a scenario"


def _show(drawn: Iterable[Drawn], caption: str, counter: Iterator[int], width: str, head: str = "") -> Shown:
    """Return a figure of panels; matplotlib has escaped every text."""
    panels = []
    for figure, scenario, estimators in drawn:
        label = f"{caption.partition(';')[0].partition('. ')[0]}{': ' * bool(scenario)}{scenario}"
        panels.append(Panel(inline_svg(figure, next(counter), label), scenario, estimators))
    return Shown(f"figure-{next(counter)}", panels, caption, width, head)


# ------------------------------------------------------------------------------------------------ SVG in a page


def inline_svg(figure: Figure, number: int, label: str) -> Markup:
    """Return a figure as SVG to be put into a page: own ids, no links, a label.

    It is without ids that nothing uses and empty groups, and with coordinates to a tenth of a point: half as long.
    """
    out = io.StringIO()
    with mpl.rc_context(PAGE.rc), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # the reader's fonts draw the text
        figure.savefig(out, format="svg", metadata={"Date": None})
    svg = out.getvalue()
    svg = re.sub(r"<(metadata|style).*?</\1>", "", svg[svg.index("<svg") :], flags=re.DOTALL)  # the page has the style
    svg = re.sub(r' xmlns(:\w+)?="[^"]*"', "", svg).replace("xlink:href=", "href=")
    used = set(re.findall(r'(?:url\(#|href="#)([^")]+)', svg))
    svg = re.sub(r' id="([^"]*)"', lambda found: found[0] if found[1] in used else "", svg)
    svg = round_numbers(svg, r"<[a-z][^<>]*>", 1).replace("font-family: 'DejaVu Sans', sans-serif; ", "")
    svg = re.sub(r' transform="rotate\(-0 [^"]*\)"', "", svg)
    svg = re.sub(r">\s+<", "><", re.sub(r"\s*\n\s*", " ", svg))
    svg = re.sub(r"<g\b[^<>]*></g>", "", re.sub(r"<g\b[^<>]*/>", "", svg))
    svg = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>f{number}-", svg)
    return Markup(svg.replace("<svg", f'<svg role="img" aria-label="{escape(label)}"', 1))
