"""A ledger over all readings of its paper as one picture: where the claimed size lies among those that were found."""

import textwrap
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes

from cooploc.analysis.claims.kinds import RELATIVE
from cooploc.analysis.plot import style
from cooploc.analysis.plot.claims_forest import CLAIMED, LOOKS
from cooploc.estimators.errors import BadInput

# verdict -> the part of a row's height that its marks take, so that grey print tells them apart
HEIGHTS = {
    "supported": (0, 1),
    "direction only": (0.5, 1),
    "flat": (0.25, 0.75),
    "contradicted": (0, 0.5),
    "undecided": (0.35, 0.65),
}
ENDS = {"letter": ("v", 1.3, "the paper's letter"), "preset": ("^", -0.3, "our preset")}  # column, marker, y, name
STRIP, LINE = 0.55, 0.42  # heights of a row's marks and of a line of text, in units of the y axis
WIDTH, LETTERS = 4.2, 52  # of the figure [in], and of a line of text
MOST = 1.5  # changes beyond are drawn at the edge


def readings(found: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """The claims that name a size: every specification's number, the one claimed, and how many support it.

    Changes of the error, in per cent; below them, where levels are claimed too, the RMSE in m in axes of their own.

    Args:
        found: from `cl.readings`.
        ax: where to draw the changes alone; a new figure if None.

    Raises:
        BadInput: no claim that names a size was run.

    """
    sized = found[found["size"].notna() & found["value"].notna()]
    changes, levels = sized[sized["kind"].isin(RELATIVE)], sized[sized["kind"] == "level"]
    parts = [part for part in ((changes,) if ax else (changes, levels)) if len(part)]
    if not parts:
        raise BadInput("no claim that names a size was run: see the columns `size` and `value` of cl.readings")
    drawn = [ax] if ax else _new_axes([_height(part) for part in parts])
    for each, part in zip(drawn, parts, strict=True):
        if part is levels:
            _panel(each, part, 1.0, 0.0, "RMSE [m]")
        else:
            _panel(each, part, 100.0, -1.0, "change of the error [%]")
    _legend(drawn[-1], set(pd.concat(parts)["verdict"]))
    return drawn[0]


def _new_axes(heights: list[float]) -> list[Axes]:
    inches = 0.5 * sum(heights) + 0.55 * len(heights) + 0.6
    _, drawn = plt.subplots(
        len(heights), figsize=(WIDTH, inches), height_ratios=heights, squeeze=False, layout="constrained"
    )
    return list(drawn[:, 0])


def _panel(ax: Axes, part: pd.DataFrame, unit: float, least: float, xlabel: str) -> None:
    """One row per claim, from the top; numbers beyond the axis stand at its edge."""
    size = part["size"].abs().max()
    most = max(min(part["value"].max(), MOST if least < 0 else 4 * size), 1.2 * size if least == 0 else 0.25)
    y = 0.0
    for (claim, says), rows in part.groupby(["claim", "says"], sort=False):
        lines = _lines(claim, says)
        y -= LINE * len(lines)
        ax.annotate("\n".join(lines), (0, y), xycoords=("axes fraction", "data"), fontsize=7.5, va="bottom")
        y -= STRIP + 0.3
        _row(ax, rows.assign(value=rows["value"].clip(least, most)), unit, y)
        held = f"{(rows['verdict'] == 'supported').sum()} of {len(rows)}"
        ax.annotate(held, (1.02, y + STRIP / 2), xycoords=("axes fraction", "data"), fontsize=8, va="center")
        y -= 0.35
    ax.set(ylim=(y, 0.1), xlim=(unit * (least or 0), unit * (most + 0.02 * (most - least))), yticks=[])
    if least < 0:
        ax.axvline(0, color="0.6", lw=0.8, zorder=0)
    ax.tick_params(labelsize=7.5)
    style.finish(ax, grid="x")
    ax.set_xlabel(xlabel, fontsize=8)
    ax.spines["left"].set_visible(False)


def _row(ax: Axes, rows: pd.DataFrame, unit: float, y: float) -> None:
    """One claim: a mark for every specification, a bar at each claimed size, and the two ends of the design."""
    ax.axhspan(y, y + STRIP, color="0.955", lw=0, zorder=0)
    for verdict, (colour, _, _) in LOOKS.items():
        low, high = HEIGHTS[verdict]
        some = unit * rows.loc[rows["verdict"] == verdict, "value"]
        ax.vlines(some, y + STRIP * low, y + STRIP * high, color=colour, lw=1, alpha=0.8)
    for size in rows["size"].unique():
        ax.vlines(unit * size, y - 0.06, y + STRIP + 0.06, color=CLAIMED, lw=2.5)
    for end, (marker, height, _) in ENDS.items():
        for row in rows[rows[end]].to_dict("records"):
            colour, _, face = LOOKS[row["verdict"]]
            ax.plot(unit * row["value"], y + STRIP * height, marker, mec=colour, mfc=face, ms=5, mew=1)


def _height(part: pd.DataFrame) -> float:
    claims = part.drop_duplicates("claim")
    return sum(LINE * len(_lines(row.claim, row.says)) + STRIP + 0.65 for row in claims.itertuples())


def _lines(claim: Any, says: Any) -> list[str]:
    """A claim in lines; a number stays with its per cent."""
    return textwrap.wrap(f"{claim}. {says}".replace(" %", "\N{NO-BREAK SPACE}%"), LETTERS)


def _legend(ax: Axes, verdicts: set[str]) -> None:
    handles: list[Any] = []
    for verdict, (colour, _, _) in LOOKS.items():
        if verdict in verdicts:
            low, high = HEIGHTS[verdict]
            part, size = [(0, 2 * low - 1), (0, 2 * high - 1)], 4 if 0 < low < high < 1 else 11
            handles += ax.plot([], [], marker=part, color=colour, ls="", ms=size, mew=2, label=verdict)
    handles += ax.plot([], [], marker="|", color=CLAIMED, ls="", ms=10, mew=3, label="claimed")
    for marker, _, name in ENDS.values():
        handles += ax.plot([], [], marker, mec="0.4", mfc="0.4", ms=5, label=name)
    figure = ax.figure
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=7.5, handletextpad=0.3)
