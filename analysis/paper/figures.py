"""The figures of a paper: RMSE over what a study sweeps, in one scenario, and against consistency and cost.

They are those of the report in the sizes of a journal (`sizes.py`). Markers and line styles say what colours say, so
they can be read in grey; hollow markers are over-confident, broken lines so at most values.
"""

from typing import Any

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from cooploc.analysis.metrics.curves import swept
from cooploc.analysis.paper.labels import Labels, over_lines
from cooploc.analysis.paper.sizes import COLUMNS, TALLEST, figure, width
from cooploc.analysis.plot.marks import colour_of, curve, rmse_at, span
from cooploc.analysis.plot.style import DOTTED, GRID, Look, logarithmic
from cooploc.analysis.report.svg_figures import scatter

TOGETHER = 7  # curves that can still be distinguished in one panel
ACROSS = {1: 3, 2: 5}  # panels side by side, by the columns that a figure is wide
LINE = 0.15  # [in] of a line of a legend
SIZE = 4.5  # [pt] of a marker
KEYS = 1.15  # [in] that an entry of a legend is wide
OTHERS = ("anees", "bytes", "seconds")
SHORT = {"anees": "ANEES", "bytes": "bytes per robot and tick", "seconds": "µs per robot and tick"}
Looks = dict[str, Look]


def over(part: pd.DataFrame, looks: Looks, known: Labels, columns: int) -> Figure:
    """RMSE over what the scenarios sweep: all in one panel, or of many methods a panel each, all others in grey."""
    part = swept(part).sort_values("value", kind="stable")
    names = [name for name in looks if name in set(part["estimator"])]
    panels = [names]
    if len(names) > TOGETHER:
        shared: dict[str, list[str]] = {}
        for name in names:
            shared.setdefault(name.partition("[")[0], []).append(name)
        panels = list(shared.values())
    across = min(len(panels), ACROSS[columns])
    down = -(-len(panels) // across)
    keyed = [name for mine in panels if len(mine) > 1 for name in mine]
    legend = LINE * -(-len(keyed) // _keys(columns))
    tall = 2.1 if len(panels) == 1 else 0.4 + min(1.15, (TALLEST - 0.4 - legend) / down) * down

    def draw(made: Figure) -> None:
        grid = made.subplots(down, across, sharex=True, sharey=True, squeeze=False)
        for ax, mine in zip(grid.flat, panels, strict=False):
            _curves(ax, part, mine, looks, known)
            if len(panels) > 1:
                ax.set_title(known.short[mine[0]] if len(mine) == 1 else mine[0].partition("[")[0], pad=3)
        for ax in grid.flat[len(panels) :]:
            ax.remove()
        for ax in grid.flat[max(0, len(panels) - across) : len(panels)]:
            ax.tick_params(labelbottom=True)
            ax.set_xlabel(part["parameter"].iloc[0])
        _axis_of(grid[0, 0], part, len(panels) > 1)
        _ylabel(made, grid)
        _legend(made, grid.flat[: len(panels)], keyed, known, columns)

    return figure(tall + legend + 0.1, columns, draw)


def dots(parts: list[pd.DataFrame], looks: Looks, known: Labels, columns: int) -> Figure:
    """RMSE of every estimator with its interval, in one scenario or several; smallest in the first on top."""
    parts = [part[part["rmse"].notna()] for part in parts]
    room = 72 * (COLUMNS[columns] - 1.4) / len(parts)  # [pt] of a title
    order = list(dict.fromkeys(name for part in parts for name in part.sort_values("rmse")["estimator"]))[::-1]

    def draw(made: Figure) -> None:
        for ax, part in zip(made.subplots(1, len(parts), sharey=True, squeeze=False)[0], parts, strict=True):
            for row in part.to_dict("records"):
                rmse_at(ax, order.index(row["estimator"]), row, looks[row["estimator"]], vertical=False)
            ax.axvline(part["floor"].iloc[0], color="black", lw=1.0, ls=DOTTED)
            logarithmic(ax.xaxis, *span(part, "rmse", "floor"))
            ax.set_xlabel("position RMSE [m]")
            _finish(ax, "\n".join(over_lines(str(part["scenario"].iloc[0]), lambda line: width(line) < room)))
        ax.set_yticks(range(len(order)), [known.short[name] for name in order])
        ax.set_ylim(-0.6, len(order) - 0.4)

    return figure(0.65 + 0.165 * len(order), columns, draw)


def against(part: pd.DataFrame, others: tuple[str, ...], looks: Looks, known: Labels, columns: int) -> Figure:
    """RMSE of every estimator in one scenario against ANEES, bytes or seconds, or against several side by side."""
    part = part[part["rmse"].notna()]
    names = [name for name in looks if name in set(part["estimator"])]
    legend = LINE * -(-len(names) // _keys(columns))

    def draw(made: Figure) -> None:
        row = made.subplots(1, len(others), sharey=True, squeeze=False)[0]
        for ax, other in zip(row, others, strict=True):
            scatter(ax, part[part[other].notna()], other, looks)
            ax.set(xlabel=SHORT[other], ylabel="")
            _finish(ax)
        row[0].set_ylabel("position RMSE [m]")
        once = part.drop_duplicates("estimator").set_index("estimator", drop=False).to_dict("index")
        for name in names:
            colour = colour_of(once[name], looks[name])
            row[0].plot([], [], marker=looks[name].marker, color=colour, ms=SIZE, ls="none", label=known.short[name])
        _legend(made, row, names, known, columns)

    return figure(2.1 + legend, columns, draw)


def _curves(ax: Axes, part: pd.DataFrame, names: list[str], looks: Looks, known: Labels) -> None:
    """The named estimators over the swept value; all others in light grey."""
    for name, rows in part.groupby("estimator", sort=False):
        if name not in names:
            ax.plot(rows["value"], rows["rmse"], color="0.88", lw=0.8, zorder=1)
    for name in names:
        curve(ax, part[part["estimator"] == name], "value", looks[name], 0.12, known.short[name])
    floor = part.groupby("value")["floor"].first()
    ax.plot(floor.index, floor, color="black", lw=1.0, ls=DOTTED, label="floor" if floor.notna().any() else None)
    _finish(ax, size=SIZE if len(names) > 2 else SIZE - 1.5)


def _axis_of(ax: Axes, part: pd.DataFrame, small: bool) -> None:
    """The axes that all panels of a sweep share."""
    low, high = span(part, "rmse", "floor")
    logarithmic(ax.yaxis, low, high)
    ax.yaxis.set_minor_locator(NullLocator())
    if low > 0:
        ax.set_ylim(0.8 * low, 1.25 * high)
    values = sorted(set(part["value"]))
    ticks = values[:: -(-len(values) // (3 if small else 8))]
    ax.set_xticks(ticks, [f"{value:g}" for value in ticks])


def _ylabel(made: Figure, grid: Any) -> None:
    """One label for the axes of all rows."""
    if len(grid) == 1:
        grid[0, 0].set_ylabel("position RMSE [m]")
    else:
        made.supylabel("position RMSE [m]")


def _finish(ax: Axes, title: str = "", size: float = SIZE) -> None:
    """What all panels have."""
    if title:
        ax.set_title(title)
    ax.grid(color=GRID, lw=0.6)
    for line in ax.lines:
        line.set_markersize(min(line.get_markersize(), size))
    ax.set_axisbelow(True)
    sns.despine(ax=ax)


def _legend(made: Figure, axes: Any, names: list[str], known: Labels, columns: int) -> None:
    """One legend below all panels, of these estimators and of the floor."""
    found = {label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    shown = [label for label in (*(known.short[name] for name in names), "floor") if names and label in found]
    if shown:
        made.legend(
            [found[label] for label in shown],
            shown,
            loc="outside lower center",
            ncols=min(len(shown), _keys(columns)),
            frameon=False,
            handlelength=2.2,
            columnspacing=1.0,
            labelspacing=0.2,
            borderpad=0.4,
        )


def _keys(columns: int) -> int:
    """Entries of a legend side by side."""
    return int(COLUMNS[columns] / KEYS)


def three(labels: list[str]) -> list[str]:
    """The first, the middle and the last of many."""
    return labels if len(labels) <= 3 else [labels[int(i)] for i in np.linspace(0, len(labels) - 1, 3)]
