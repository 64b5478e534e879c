"""A report's figures, each a small SVG that stands alone: they wrap on a narrow page and print in grey.

Every estimator keeps its colour, marker and line style throughout. Hollow markers and broken lines are over-confident,
grey dotted lines are bounds.
"""

import io
import re
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from cooploc.analysis.metrics.certificate_line import refused
from cooploc.analysis.metrics.consistency import CONSERVATIVE, OVER_CONFIDENT
from cooploc.analysis.metrics.over_time import sweep
from cooploc.analysis.metrics.ranking import front

MARKERS = "osD^vP*Xph<>d8"
DASHES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (3, 1, 1, 1)), (0, (8, 1, 1, 1, 1, 1)))  # of honest estimators
BROKEN, DOTTED = (0, (2, 2)), (0, (1, 1.5))
TOGETHER = 6  # estimators that are still told apart in one panel
GREY = "0.55"
UNRANKED = " (failed a check)"
LOOK: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "cooploc",
    "font.sans-serif": ["DejaVu Sans"],
    "text.parse_math": False,  # labels are text, whatever they hold
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
}
PANEL, WIDE = (3.5, 2.7), (7.4, 3.5)  # [in]
KEY = 0.16  # [in] of a line of a panel's key
TITLE = 44  # characters that a panel is wide


class Style(NamedTuple):
    """How an estimator looks."""

    colour: Any
    marker: str
    line: Any


def styles(estimators: list[str]) -> dict[str, Style]:
    """One look for each."""
    colours = [c for i, c in enumerate(sns.color_palette("colorblind", 10)) if i not in (6, 7, 8)]  # grey, or too pale
    return {
        name: Style(colours[i % len(colours)], MARKERS[i % len(MARKERS)], DASHES[i // 3 % len(DASHES)])
        for i, name in enumerate(estimators)
    }


def lines(part: pd.DataFrame, looks: dict[str, Style]) -> list[str]:
    """RMSE over what the scenarios sweep: one panel, or with many estimators one for each, among all others in grey.

    The variants of an estimator, "arl" and "arl[K=1]", share a panel.
    """
    part = part.assign(value=[sweep(label)[2] for label in part["scenario"]]).sort_values("value", kind="stable")
    parameter = sweep(part["scenario"].iloc[0])[1]
    names = list(dict.fromkeys(part["estimator"]))
    names = sorted(names, key=list(looks).index)
    if len(names) <= TOGETHER:
        return [_drawn(partial(_panel, part=part, names=names, looks=looks, parameter=parameter), WIDE)]
    shared: dict[str, list[str]] = {}
    for name in names:
        shared.setdefault(name.partition("[")[0], []).append(name)
    panels = [mine[i : i + TOGETHER] for mine in shared.values() for i in range(0, len(mine), TOGETHER)]
    most = max(map(len, panels))
    size = (PANEL[0], PANEL[1] + KEY * most * (most > 1))  # all alike
    return [_drawn(partial(_panel, part=part, names=mine, looks=looks, parameter=parameter), size) for mine in panels]


def dots(part: pd.DataFrame, looks: dict[str, Style]) -> str:
    """RMSE of every estimator in one scenario with its interval, smallest on top."""
    part = part[part["rmse"].notna()].sort_values("rmse", ascending=False, kind="stable")
    refuse = part["certificate"].map(refused)
    names = part["estimator"] + np.where(refuse, UNRANKED, "")

    def draw(ax: Axes) -> None:
        for y, row in enumerate(part.to_dict("records")):
            _whiskers(ax, row, "rmse", y, looks[row["estimator"]])
        ax.axvline(part["floor"].iloc[0], color="black", lw=1.1, ls=DOTTED)
        ax.set_yticks(range(len(part)), names)
        ax.set_ylim(-0.6, len(part) - 0.4)
        _logarithmic(ax.xaxis, *_span(part, "rmse"))
        ax.set_xlabel("position RMSE [m]")
        ax.set_title(part["scenario"].iloc[0])
        ax.grid(color="0.9", lw=0.8)

    longest = max(map(len, part["estimator"]), default=0)
    return _drawn(draw, (1.2 * PANEL[0] + 0.065 * longest, 0.9 + 0.2 * len(part)))


def against(part: pd.DataFrame, other: str, looks: dict[str, Style]) -> str:
    """RMSE of every estimator in one scenario against ANEES, bytes or seconds, with a cost's Pareto front."""
    part = part[part["rmse"].notna() & part[other].notna()]

    def draw(ax: Axes) -> None:
        if other == "anees":
            ax.axvspan(CONSERVATIVE, OVER_CONFIDENT, color="0.93", zorder=0)
            low, high = _span(part, other)
            _logarithmic(ax.xaxis, low, high)
        else:
            _cost(ax, part, other)
        for row in part.to_dict("records"):
            _point(ax, row, other, looks[row["estimator"]])
        if other == "anees" and 0 < low <= high < np.inf:  # intervals of heavy tails span many powers of ten
            ax.set_xlim(min(low / 1.4, 0.5), max(1.4 * high, 2.0))
        _logarithmic(ax.yaxis, *_span(part, "rmse"))
        ax.set_ylabel("position RMSE [m]")
        names = {
            "anees": "ANEES (1 is consistent)",
            "bytes": "bytes per robot and tick",
            "seconds": "µs per robot and tick",
        }
        ax.set_xlabel(names[other])
        ax.set_title(part["scenario"].iloc[0])
        ax.grid(color="0.9", lw=0.8)

    return _drawn(draw, PANEL)


def key(part: pd.DataFrame, looks: dict[str, Style]) -> str:
    """The legend of the figures that name no estimators."""
    names = sorted(dict.fromkeys(part["estimator"]), key=list(looks).index)
    bounds = set(part.loc[part["bound"].astype(bool), "estimator"])
    refuse = set(part.loc[part["certificate"].map(refused).astype(bool), "estimator"])

    def draw(ax: Axes) -> None:
        for name in names:
            colour, label = (GREY, f"{name} (bound)") if name in bounds else (looks[name].colour, name)
            label += UNRANKED * (name in refuse)
            ax.plot([], [], marker=looks[name].marker, color=colour, ls="none", ms=6, label=label)
        ax.axis("off")
        ax.legend(frameon=False, loc="center left", fontsize=8, title="estimators (hollow: over-confident)")

    return _drawn(draw, (PANEL[0], max(PANEL[1], 0.5 + 0.18 * len(names))))


def inline(svg: str, number: int, label: str) -> str:
    """An SVG file's text to be put into a page: ids of its own, no links to other places, and a label."""
    from markupsafe import escape

    body = svg[svg.index("<svg") :]
    body = re.sub(r"<(metadata|style).*?</\1>", "", body, flags=re.DOTALL)  # the page has the style
    body = re.sub(r' xmlns(:\w+)?="[^"]*"', "", body).replace("xlink:href=", "href=")
    body = _smaller(body)
    body = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>f{number}-", body)
    return re.sub(r"^<svg", f'<svg role="img" aria-label="{escape(label)}"', body)


def _smaller(svg: str) -> str:
    """Without ids that nothing uses, and with coordinates to a hundredth of a point: half as long."""
    used = set(re.findall(r'(?:url\(#|href="#)([^)"]+)', svg))
    svg = re.sub(r' id="([^"]*)"', lambda found: found[0] if found[1] in used else "", svg)
    svg = re.sub(r"\d+\.\d{3,}", lambda found: f"{float(found[0]):.2f}".rstrip("0").rstrip("."), svg)
    svg = svg.replace("font-family: 'DejaVu Sans', sans-serif; ", "")
    return re.sub(r">\s+<", "><", re.sub(r"\s*\n\s*", " ", svg))


def _panel(ax: Axes, part: pd.DataFrame, names: list[str], looks: dict[str, Style], parameter: str) -> None:
    """The named estimators over the swept value; all others in light grey."""
    for name, rows in part.groupby("estimator", sort=False):
        if name not in names:
            ax.plot(rows["value"], rows["rmse"], color="0.88", lw=1, zorder=1)
    for name in names:
        _curve(ax, part[part["estimator"] == name], looks[name], 0.22 if len(names) == 1 else 0.1)
    least = part.groupby("value")["floor"].first()
    ax.plot(least.index, least, color="black", lw=1.1, ls=DOTTED, label="floor" if least.notna().any() else None)
    low, high = _span(part, "rmse")
    _logarithmic(ax.yaxis, low, high)
    every = list(dict.fromkeys(part["estimator"]))
    alone = len(names) < len(every) or len(every) == 1
    if alone and 0 < low <= high < np.inf:  # the same for every panel, though a band may reach beyond
        ax.set_ylim(0.8 * low, 1.25 * high)
    ax.set_xlabel(parameter)
    ax.set_ylabel("position RMSE [m]")
    values = sorted(set(part["value"]))
    if len(values) <= 8:
        ax.set_xticks(values, [f"{value:g}" for value in values])
    ax.grid(color="0.93", lw=0.8)
    if alone:
        mine = part[part["estimator"] == names[0]]
        ax.set_title(_broken(_called(mine, names[0] if len(names) == 1 else names[0].partition("[")[0])))
        if len(names) > 1:
            where: Any = {"loc": "lower left", "bbox_to_anchor": (0.02, 0.0), "bbox_transform": ax.figure.transFigure}
            ax.legend(frameon=False, fontsize=6.5, borderpad=0, labelspacing=0.3, **where)
    else:
        ax.legend(frameon=False, bbox_to_anchor=(1.0, 1.0), loc="upper left", fontsize=8)


def _broken(title: str) -> str:
    """A title over two lines where one would be cut off."""
    cut = title.rfind(",", 0, TITLE) + 1
    return title if len(title) <= TITLE or not cut else f"{title[:cut]}\n{title[cut:]}"


def _curve(ax: Axes, rows: pd.DataFrame, look: Style, alpha: float) -> None:
    bound = bool(rows["bound"].any())
    over = (rows["consistency"] == "over-confident").to_numpy()
    colour = GREY if bound else look.colour
    line = DOTTED if bound else BROKEN if over.mean() > 0.5 else look.line
    x, y = rows["value"].to_numpy(), rows["rmse"].to_numpy()
    ax.plot(x, y, color=colour, ls=line, lw=1.6, zorder=3)
    ax.fill_between(x, rows["rmse_low"], rows["rmse_high"], color=colour, alpha=alpha, lw=0, zorder=2)
    every = max(1, len(x) // 25)
    for i in range(0, len(x), every):
        fill = "white" if over[i] else colour
        ax.plot(x[i], y[i], look.marker, mfc=fill, mec=colour, ms=5, mew=1.2, zorder=4)
    ax.plot(
        [], [], marker=look.marker, color=colour, ls=line, label=_called(rows), mfc="white" if over.all() else colour
    )


def _called(rows: pd.DataFrame, name: str = "") -> str:
    """An estimator's name, or another one, and what keeps it from being ranked."""
    name = (name or str(rows["estimator"].iloc[0])) + " (bound)" * bool(rows["bound"].any())
    return name + UNRANKED * refused(rows["certificate"].iloc[0])


def _whiskers(ax: Axes, row: dict[Any, Any], of: str, y: float, look: Style) -> None:
    colour = GREY if row["bound"] else look.colour
    ax.plot([row[f"{of}_low"], row[f"{of}_high"]], [y, y], color=colour, lw=1.6, ls=DOTTED if row["bound"] else "-")
    fill = "white" if row["consistency"] == "over-confident" else colour
    ax.plot(row[of], y, look.marker, mfc=fill, mec=colour, ms=6, mew=1.3, zorder=3)


def _point(ax: Axes, row: dict[Any, Any], other: str, look: Style) -> None:
    colour = GREY if row["bound"] else look.colour
    x = 1e6 * row[other] if other == "seconds" else row[other]
    ax.plot([x, x], [row["rmse_low"], row["rmse_high"]], color=colour, lw=1)
    if other == "anees":
        ax.plot([row["anees_low"], row["anees_high"]], [row["rmse"]] * 2, color=colour, lw=1)
    fill = "white" if row["consistency"] == "over-confident" else colour
    ax.plot(x, row["rmse"], look.marker, mfc=fill, mec=colour, ms=6, mew=1.3, zorder=3)


def _cost(ax: Axes, part: pd.DataFrame, other: str) -> None:
    """The axis of a cost, and the front of those that can be had."""
    refuse = part["certificate"].map(refused).astype(bool)
    had = part["rmse"].where(~part["bound"].astype(bool) & ~refuse).to_numpy(float)
    best = part[front(had, part[other].to_numpy(float))].sort_values(other)
    factor = 1e6 if other == "seconds" else 1.0
    if len(best):
        ax.step(factor * best[other], best["rmse"], where="post", color="0.3", lw=1, ls=BROKEN, zorder=1)
    if other == "seconds":
        _logarithmic(ax.xaxis, factor * part[other].min(), factor * part[other].max())
    else:
        high = 1.6 * max(10.0, float(part[other].max()))
        ax.set_xscale("symlog", linthresh=10)
        subs = (1, 2, 5) if high < 1000 else (1,)
        ax.set_xticks([0, *(v for k in range(1, 9) for sub in subs if (v := sub * 10**k) < high)])
        ax.xaxis.set_major_formatter(FuncFormatter(_plain))
        ax.set_xlim(-2, high)


def _span(part: pd.DataFrame, of: str) -> tuple[float, float]:
    """From the least to the largest; of errors, the floor too."""
    values = part[[of, "floor"] if of == "rmse" else [of]].replace([np.inf, -np.inf], np.nan).to_numpy(float)
    if np.isnan(values).all():
        return np.nan, np.nan
    return float(np.nanmin(values)), float(np.nanmax(values))


def _logarithmic(axis: Any, low: float, high: float) -> None:
    """A logarithmic axis with some margin, and ticks that are numbers."""
    if not (np.isfinite([low, high]).all() and low > 0):
        return
    axis.axes.set_xscale("log") if axis.axis_name == "x" else axis.axes.set_yscale("log")
    few: tuple[float, ...] = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0) if high < 5 * low else (1.0, 2.0, 5.0)
    few = few if high < 30 * low else (1.0, 3.0) if high < 300 * low else (1.0,)
    axis.set_major_locator(LogLocator(subs=few))
    axis.set_major_formatter(FuncFormatter(_plain))
    axis.set_minor_formatter(NullFormatter())


def _plain(value: float, _: int) -> str:
    return f"{value:g}"


def _drawn(draw: Callable[[Axes], None], size: tuple[float, float]) -> str:
    """One axes, as the text of an SVG file that is the same for the same numbers."""
    with mpl.rc_context(LOOK), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # the reader's fonts draw the text
        panel = size[0] == PANEL[0]  # its labels are known to have room; to measure them takes twice as long as to draw
        figure = Figure(figsize=size, layout=None if panel else "constrained")
        share = PANEL[1] / size[1]  # a key is below
        ax = figure.add_axes((0.17, 1 - 0.82 * share, 0.77, 0.7 * share)) if panel else figure.add_subplot()
        draw(ax)
        sns.despine(ax=ax)
        ax.set_axisbelow(True)
        out = io.StringIO()
        figure.savefig(out, format="svg", metadata={"Date": None})
    return out.getvalue()
