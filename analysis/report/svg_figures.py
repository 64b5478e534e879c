"""A report's figures, each a small SVG that stands alone: they wrap on a narrow page and print in grey.

Every estimator keeps its look throughout (`cooploc.analysis.plot.style`). Broken lines are over-confident.
"""

from functools import partial
from math import ceil
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from cooploc.analysis.metrics.consistency import CONSERVATIVE, OVER_CONFIDENT
from cooploc.analysis.metrics.curves import swept
from cooploc.analysis.metrics.ranking import is_refused, pareto_front
from cooploc.analysis.plot.marks import UNRANKED, colour_of, curve, marker, name_of, rmse_against, rmse_at, span
from cooploc.analysis.plot.style import BAND, BROKEN, DARK, DOTTED, GRID, Look, logarithmic
from cooploc.analysis.report.result_tables import ShortNames
from cooploc.analysis.report.svg import PANEL, WIDE, drawn

Looks = dict[str, Look]
TOGETHER = 6  # estimators that can still be distinguished in one panel
KEY = 0.16  # [in] of a line of a panel's key
LETTER = 0.075  # [in] of a label, on average
TITLE = 44  # characters that a panel is wide
IN_A_COLUMN = 8  # estimators of a legend
MOST = 24  # estimators of an overview
IN_FULL = ShortNames({})
NAMES = {"anees": "ANEES (1 is consistent)", "bytes": "bytes per robot and tick", "seconds": "µs per robot and tick"}


def panels(part: pd.DataFrame, looks: Looks) -> list[list[str]]:
    """The estimators of each panel of `lines`: all in one, or the variants of one, "arl" and "arl[K=1]"."""
    known = set(part["estimator"])
    names = [name for name in looks if name in known]
    if len(names) <= TOGETHER:
        return [names]
    shared: dict[str, list[str]] = {}
    for name in names:
        shared.setdefault(name.partition("[")[0], []).append(name)
    return [mine[i : i + TOGETHER] for mine in shared.values() for i in range(0, len(mine), TOGETHER)]


def lines(part: pd.DataFrame, looks: Looks, names: ShortNames = IN_FULL) -> list[str]:
    """RMSE over what the scenarios sweep, a figure for each of `panels`, among all other estimators in grey."""
    part = swept(part).sort_values("value", kind="stable")
    shown = panels(part, looks)
    if len(shown) == 1:
        return [drawn(partial(_panel, part=part, names=shown[0], looks=looks, short=names), WIDE)]
    most = max(map(len, shown))
    size = (PANEL[0], PANEL[1] + KEY * most * (most > 1))  # all alike
    return [drawn(partial(_panel, part=part, names=mine, looks=looks, short=names), size, panel=True) for mine in shown]


def overview(table: pd.DataFrame, looks: Looks, names: ShortNames = IN_FULL) -> str:
    """RMSE of every estimator relative to the baseline's, a mark for each scenario; the median smallest on top.

    Of many estimators those that ran in the most scenarios.
    """
    part = table[table["rmse"].notna() & (1 + table["change"] > 0) & (table["estimator"] != table["baseline"])]
    most = part["estimator"].value_counts().index[:MOST]
    part = part[part["estimator"].isin(most)].assign(ratio=1 + part["change"])
    ordered = part.groupby("estimator", sort=False)["ratio"].median().sort_values(ascending=False)

    def draw(ax: Axes) -> None:
        for y, (name, median) in enumerate(ordered.items()):
            for row in part[part["estimator"] == name].to_dict("records"):
                marker(ax, row["ratio"], y, row, looks[str(name)], ms=5, mew=1)
            ax.plot([median, median], [y - 0.32, y + 0.32], color=DARK, lw=1.6, zorder=4)
        ax.axvline(1, color="black", lw=1.1, ls=DOTTED)
        first = part.drop_duplicates("estimator").set_index("estimator", drop=False)
        ax.set_yticks(range(len(ordered)), [name_of(first.loc[n], names.of(str(n))) for n in ordered.index])
        ax.set_ylim(-0.6, len(ordered) - 0.4)
        logarithmic(ax.xaxis, *span(part, "ratio"))
        ax.set(xlabel="position RMSE / that of the baseline")
        ax.grid(color=GRID, lw=0.8)

    return drawn(draw, (9.0, 0.8 + 0.19 * len(ordered)))


def dots(part: pd.DataFrame, looks: Looks, names: ShortNames = IN_FULL) -> str:
    """RMSE of every estimator in one scenario with its interval, smallest on top."""
    part = part[part["rmse"].notna()].sort_values("rmse", ascending=False, kind="stable")
    said = part["estimator"].map(names.of) + np.where(part["certificate"].map(is_refused), UNRANKED, "")

    def draw(ax: Axes) -> None:
        for y, row in enumerate(part.to_dict("records")):
            rmse_at(ax, y, row, looks[row["estimator"]], vertical=False)
        ax.axvline(part["floor"].iloc[0], color="black", lw=1.1, ls=DOTTED)
        ax.set_yticks(range(len(part)), said)
        ax.set_ylim(-0.6, len(part) - 0.4)
        logarithmic(ax.xaxis, *span(part, "rmse", "floor"))
        ax.set(xlabel="position RMSE [m]", title=part["scenario"].iloc[0])
        ax.grid(color=GRID, lw=0.8)

    longest = max(map(len, said), default=0)
    left = LETTER * longest + 0.15
    return drawn(draw, (left + 2.6, 0.85 + 0.2 * len(part)), left=left)


def against(part: pd.DataFrame, other: str, looks: Looks) -> str:
    """RMSE of every estimator in one scenario against ANEES, bytes or seconds, with a cost's Pareto front."""
    part = part[part["rmse"].notna() & part[other].notna()]

    def draw(ax: Axes) -> None:
        scatter(ax, part, other, looks)
        ax.set_title(part["scenario"].iloc[0])

    return drawn(draw, PANEL, panel=True)


def scatter(ax: Axes, part: pd.DataFrame, other: str, looks: Looks) -> None:
    """RMSE of every estimator in one scenario against ANEES, bytes or seconds."""
    _anees(ax, part) if other == "anees" else _cost(ax, part, other)
    for row in part.to_dict("records"):
        rmse_against(ax, other, row, looks[row["estimator"]], _scale(other))
    low, high = span(part, other)
    if other == "anees" and low > 0:  # intervals of heavy tails span many powers of ten
        ax.set_xlim(min(low / 1.4, 0.5), max(1.4 * high, 2.0))
    logarithmic(ax.yaxis, *span(part, "rmse", "floor"))
    ax.set(xlabel=NAMES[other], ylabel="position RMSE [m]")
    ax.grid(color=GRID, lw=0.8)


def key(part: pd.DataFrame, looks: Looks, short: ShortNames = IN_FULL) -> str:
    """The legend of the figures that name no estimators."""
    once = part.drop_duplicates("estimator").set_index("estimator", drop=False).to_dict("index")
    names = [name for name in looks if name in once]
    longest = max((len(name_of(once[name], short.of(name))) for name in names), default=0)
    columns = 2 if len(names) > IN_A_COLUMN and 2 * (LETTER * longest + 0.4) <= PANEL[0] else 1

    def draw(ax: Axes) -> None:
        for name in names:
            row, look = once[name], looks[name]
            ax.plot(
                [],
                [],
                marker=look.marker,
                color=colour_of(row, look),
                ls="none",
                ms=6,
                label=name_of(row, short.of(name)),
            )
        ax.axis("off")
        title = "estimators (hollow: over-confident)"
        ax.legend(frameon=False, loc="upper left", fontsize=8, ncols=columns, title=title)

    return drawn(draw, (PANEL[0], 0.5 + 0.18 * ceil(len(names) / columns)))


def _panel(ax: Axes, part: pd.DataFrame, names: list[str], looks: Looks, short: ShortNames) -> None:
    """The named estimators over the swept value; all others in light grey."""
    for name, rows in part.groupby("estimator", sort=False):
        if name not in names:
            ax.plot(rows["value"], rows["rmse"], color="0.88", lw=1, zorder=1)
    for name in names:
        rows = part[part["estimator"] == name]
        label = name_of(rows.iloc[0], short.of(name))
        curve(ax, rows, "value", looks[name], 0.22 if len(names) == 1 else 0.1, label)
    floor = part.groupby("value")["floor"].first()
    ax.plot(floor.index, floor, color="black", lw=1.1, ls=DOTTED, label="floor" if floor.notna().any() else None)
    low, high = span(part, "rmse", "floor")
    logarithmic(ax.yaxis, low, high)
    ax.set(xlabel=part["parameter"].iloc[0], ylabel="position RMSE [m]")
    values = sorted(set(part["value"]))
    if len(values) <= 8:
        ax.set_xticks(values, [f"{value:g}" for value in values])
    ax.grid(color=GRID, lw=0.8)
    every = part["estimator"].nunique()
    if len(names) == every > 1:
        ax.legend(frameon=False, bbox_to_anchor=(1.0, 1.0), loc="upper left", fontsize=8)
        return
    if low > 0:  # the same for every panel, though a band may reach beyond
        ax.set_ylim(0.8 * low, 1.25 * high)
    _head(ax, part, names, short)


def _head(ax: Axes, part: pd.DataFrame, names: list[str], short: ShortNames) -> None:
    """The title of a panel of its own, and below it the key of several variants."""
    first = part[part["estimator"] == names[0]].iloc[0]
    ax.set_title(_over_lines(name_of(first, short.of(names[0]) if len(names) == 1 else names[0].partition("[")[0])))
    if len(names) > 1:
        where: Any = {"loc": "lower left", "bbox_to_anchor": (0.02, 0.0), "bbox_transform": ax.figure.transFigure}
        ax.legend(frameon=False, fontsize=6.5, borderpad=0, labelspacing=0.3, **where)


def _over_lines(title: str) -> str:
    """A title over two lines where one would be cut off."""
    cut = title.rfind(",", 0, TITLE) + 1
    return title if len(title) <= TITLE or not cut else f"{title[:cut]}\n{title[cut:]}"


def _scale(other: str) -> float:
    return 1e6 if other == "seconds" else 1.0


def _anees(ax: Axes, part: pd.DataFrame) -> None:
    ax.axvspan(CONSERVATIVE, OVER_CONFIDENT, color=BAND, zorder=0)
    logarithmic(ax.xaxis, *span(part, "anees"))


def _cost(ax: Axes, part: pd.DataFrame, other: str) -> None:
    """The axis of a cost, and the Pareto front of those that can be had."""
    out = part["certificate"].map(is_refused).astype(bool) | part["centralised"].astype(bool)
    best = part[pareto_front(part["rmse"].where(~out).to_numpy(float), part[other].to_numpy(float))].sort_values(other)
    if len(best):
        ax.step(_scale(other) * best[other], best["rmse"], where="post", color="0.3", lw=1, ls=BROKEN, zorder=1)
    if other == "seconds":
        logarithmic(ax.xaxis, *(1e6 * end for end in span(part, other)))
        return
    high = 1.6 * max(10.0, float(part[other].max()))
    ax.set_xscale("symlog", linthresh=10)
    subs = (1, 2, 5) if high < 1000 else (1,)
    ax.set_xticks([0, *(v for k in range(1, 9) for sub in subs if (v := sub * 10**k) < high)])
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.set_xlim(-2, high)
