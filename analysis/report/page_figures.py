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

from cooploc.analysis.formats import counted
from cooploc.analysis.metrics.curves import sweep
from cooploc.analysis.plot import results
from cooploc.analysis.plot.style import PAGE
from cooploc.analysis.report.run_numbers import Numbers

SCATTERED = 3  # scenarios of an experiment whose accuracy is drawn against consistency and cost
FEW = 4  # scenarios that the first figure of a page draws side by side
HOLLOW = "Hollow: over-confident; grey: centralised; dotted: the floor."
Drawn = tuple[Figure, str, tuple[str, ...]]  # a figure, its scenario, its estimators


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
    number, most = ended["estimator"].nunique(), results.MOST
    some = f" Shown are the {most} of {number} that ran in the most scenarios." * (number > most)
    caption = (
        f"Position RMSE of every estimator divided by that of the baseline ({baselines}): a mark for each scenario, a "
        f"bar at their median; left of the dotted line the error is smaller. Hollow: over-confident; grey: "
        f"centralised.{some}"
    )
    drawn = results.overview(numbers.table, numbers.looks, numbers.names.of)
    return _panels_of([(drawn, "", ())], caption, counter, "whole")


def few(table: pd.DataFrame) -> bool:
    """Whether the scenarios fit side by side."""
    return bool(table["scenario"].nunique() <= FEW)


def lines(rows: pd.DataFrame, numbers: Numbers, counter: Iterator[int]) -> Shown:
    """RMSE over what the scenarios sweep."""
    groups = results.groups(rows, numbers.looks)
    figures = results.sweep_panels(rows, numbers.looks, numbers.names.of)
    family, parameter, _ = sweep(rows["scenario"].iloc[0])
    one = "each panel one estimator and its variants, all others in grey" if len(figures) > 1 else "with intervals"
    caption = (
        f"Position RMSE over {parameter} in {family}, {one}; bands are 95 % intervals over trials. Hollow markers: "
        "over-confident; a broken line: so at most of the values; grey and dotted: centralised; black and dotted: the "
        f"floor. {trials(rows)}"
    )
    drawn = [(figure, "", tuple(names)) for figure, names in zip(figures, groups, strict=True)]
    return _panels_of(drawn, caption, counter, "wide" if len(figures) == 1 else "")


def dots(rows: pd.DataFrame, numbers: Numbers, counter: Iterator[int]) -> Shown:
    """RMSE of every estimator, scenario by scenario."""
    drawn: list[Drawn] = [
        (results.ranking([part], numbers.looks, numbers.names.of), str(scenario), ())
        for scenario, part in rows.groupby("scenario", sort=False)
        if part["rmse"].notna().any()
    ]
    caption = f"Position RMSE, smallest on top, with 95 % intervals over trials. {HOLLOW} {trials(rows)}"
    return _panels_of(drawn, caption, counter, "wide")


def scatter(rows: pd.DataFrame, numbers: Numbers, counter: Iterator[int]) -> Shown:
    """Accuracy against consistency and cost, in the first, the middle and the last scenario."""
    ended = rows[rows["rmse"].notna()]
    labels = list(dict.fromkeys(ended["scenario"]))
    chosen = labels if len(labels) <= SCATTERED else [labels[0], labels[len(labels) // 2], labels[-1]]
    there = ended[ended["scenario"].isin(chosen)]
    drawn: list[Drawn] = [
        (results.scatter(part, [other], numbers.looks, numbers.names.of), str(label), ())
        for label, part in there.groupby("scenario", sort=False)
        for other in results.NAMES
    ]
    some = f" Shown are {len(chosen)} of {len(labels)} scenarios, the first, the middle and the last." * (
        len(chosen) < len(labels)
    )
    caption = (
        "Accuracy against consistency (grey band: neither over-confident nor conservative), bytes and time, with 95 % "
        "intervals over trials, cut off where they reach beyond the values. Broken line: the Pareto front, "
        "estimators than which no other is at least as good in both and better in one; centralised ones are never on "
        f"it, over-confident estimators (hollow) may be.{some} {trials(there)}"
    )
    return _panels_of(drawn, caption, counter, "middle", "Accuracy against consistency, bytes and time")


def trials(part: pd.DataFrame) -> str:
    """How many trials a figure is made from."""
    counts = np.unique(part["trials"])
    if not len(counts):
        return "No trials."
    few = counted(counts[0], "trial")
    return f"{few} a scenario." if len(counts) == 1 else f"{counts[0]} to {counts[-1]} trials a scenario."


def _panels_of(drawn: Iterable[Drawn], caption: str, counter: Iterator[int], width: str, head: str = "") -> Shown:
    """A figure of panels, each with its scenario and its estimators; matplotlib has escaped every text."""
    panels = []
    for figure, scenario, estimators in drawn:
        label = f"{caption.partition(';')[0].partition('. ')[0]}{': ' * bool(scenario)}{scenario}"
        panels.append(Panel(inline(figure, next(counter), label), scenario, estimators))
    return Shown(f"figure-{next(counter)}", panels, caption, width, head)


# ------------------------------------------------------------------------------------------------ SVG in a page

TAG, STYLE = re.compile(r"<[a-z][^<>]*>"), re.compile(r' style="([\w :;.,()#%-]*)"')
NUMBER = re.compile(r"\d+\.\d{2,}")


def inline(figure: Figure, number: int, label: str) -> Markup:
    """A figure as SVG to be put into a page: own ids, no links, a label."""
    out = io.StringIO()
    with mpl.rc_context(PAGE.rc), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # the reader's fonts draw the text
        figure.savefig(out, format="svg", metadata={"Date": None})
    svg = out.getvalue()
    svg = re.sub(r"<(metadata|style).*?</\1>", "", svg[svg.index("<svg") :], flags=re.DOTALL)  # the page has the style
    svg = re.sub(r' xmlns(:\w+)?="[^"]*"', "", svg).replace("xlink:href=", "href=")
    svg = _smaller(svg)
    svg = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>f{number}-", svg)
    return Markup(svg.replace("<svg", f'<svg role="img" aria-label="{escape(label)}"', 1))


def shared_styles(markup: str) -> tuple[str, str]:
    """A page's markup with classes instead of the styles that repeat themselves, and the CSS of these classes.

    Only tags are looked at, so that no text can be taken for a style: it has no angle brackets that are not escaped.
    """
    classes: dict[str, str] = {}

    def tag(found: re.Match[str]) -> str:
        style = STYLE.search(found[0])
        if style is None or " class=" in found[0]:
            return found[0]
        name = classes.setdefault(style[1], f"s{len(classes)}")
        return found[0].replace(style[0], f' class="{name}"')

    markup = TAG.sub(tag, markup)
    return markup, "\n".join(f".{name} {{ {style} }}" for style, name in classes.items())


def _smaller(svg: str) -> str:
    """Without what nothing uses, and with coordinates to a tenth of a point: less than half as long."""
    used = set(re.findall(r'(?:url\(#|href="#)([^")]+)', svg))
    svg = re.sub(r' id="([^"]*)"', lambda found: found[0] if found[1] in used else "", svg)
    svg = TAG.sub(lambda found: NUMBER.sub(lambda n: f"{float(n[0]):.1f}".removesuffix(".0"), found[0]), svg)
    svg = svg.replace("font-family: 'DejaVu Sans', sans-serif; ", "")
    svg = re.sub(r' transform="rotate\(-0 [^"]*\)"', "", svg)
    svg = re.sub(r">\s+<", "><", re.sub(r"\s*\n\s*", " ", svg))
    return re.sub(r"<g\b[^<>]*></g>", "", re.sub(r"<g\b[^<>]*/>", "", svg))  # empty groups
