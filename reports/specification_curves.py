"""Specification curves: a claim's number in every specification of the paper's readings, above the choices of each.

Source: U. Simonsohn, J. Simmons, L. Nelson, "Specification curve analysis", Nature Human Behaviour 4, 2020.
"""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from cooploc.analysis.claims.kinds import KINDS
from cooploc.analysis.claims.multiverse import dimensions_of
from cooploc.analysis.plot import style
from cooploc.analysis.plot.ledgers import VERDICTS

CASE = {"scenario": "scenario", "of": "estimator", "than": "against"}  # column -> head of its rows
ENDS = {"letter": "0.1", "code": "0.3", "preset": "0.5"}  # column -> colour of its lines
ANEES = 0.1, 1e4  # values beyond are drawn at the edge
QUANTITIES = {"level": "RMSE [m]", "slope": "exponent", "time": "time [s]", "consistency": "ANEES"}
WIDE, CURVE, ROW = 8.0, 2.6, 0.155  # of the figure, and heights of the curve and of a row of the matrix [in]


def specification_curve(found: pd.DataFrame, claim: str) -> Any:
    """Draw a claim's number in every specification of `cl.readings`, sorted, and the choices of each as a matrix.

    Dotted lines mark the specifications of the paper's letter, of public code and of the preset. The first
    definition of the size is drawn.
    """
    part = found[(found["claim"] == claim) & found["value"].notna()].sort_values("value", kind="stable")
    part = part[part["definition"] == part["definition"].min()]
    rows: list[tuple[str, str]] = []  # of the matrix: column and choice, below each column's head
    for name in [*dimensions_of(part), *CASE]:
        choices = [choice for choice in dict.fromkeys(part.sort_index()[name]) if choice]
        if len(choices) > 1:
            rows += [(name, ""), *((name, choice) for choice in choices)]
    heights = CURVE, ROW * (len(rows) + 1)
    size = WIDE, sum(heights) + 0.3
    _, axes = plt.subplots(2, figsize=size, height_ratios=heights, sharex=True, layout="constrained")
    _draw_effects(axes[0], part)
    _draw_matrix(axes[1], part, rows)
    for ax in axes:
        for end, colour in ENDS.items():
            for x in np.flatnonzero(part[end].eq(True)).tolist():
                ax.axvline(x, color=colour, lw=0.8, ls=style.DOTTED, zorder=0)
                if ax is axes[0]:
                    place: Any = {"xycoords": ("data", "axes fraction"), "rotation": 90, "ha": "right", "va": "top"}
                    ax.annotate(end, (x, 1.0), fontsize=7, color=colour, **place)
    return axes[0].figure


def _draw_effects(ax: Axes, part: pd.DataFrame) -> None:
    """Draw the curve; long intervals do not squeeze it, they leave the axes."""
    first, x = part.iloc[0], np.arange(len(part))
    relative = KINDS[first["kind"]].unit is None
    unit = 100.0 if relative else 1.0
    value, low, high = (unit * part[name].to_numpy(float) for name in ("value", "low", "high"))
    if first["kind"] == "consistency":  # collapsed clouds have an ANEES of any size
        value, low, high = (np.clip(number, *ANEES) for number in (value, low, high))
        ax.set_yscale("log")
    size = float(np.clip(250 / len(part), 1.5, 5))  # [pt], so that neighbours do not cover each other
    for verdict, mark in VERDICTS.items():
        some = (part["verdict"] == verdict).to_numpy()
        if some.any():
            ax.vlines(x[some], low[some], high[some], color=mark.colour, lw=0.8, alpha=0.6)
            label = f"{verdict} ({some.sum()})"
            ax.plot(x[some], value[some], mark.marker, ls="", mec=mark.colour, mfc=mark.face, ms=size, label=label)
    for number in part["size"].dropna().unique():
        ax.axhline(unit * number, color=style.DARK, lw=1.5, ls=style.BROKEN, label="claimed", zorder=0)
    if relative:
        ax.axhline(0, color="0.6", lw=0.8, zorder=0)
    bottom, top = np.nanmin([low, value]), np.nanmax([high, value])
    if ax.get_yscale() == "log":
        ax.set_ylim(bottom / 1.3, top * 1.3)
    else:
        room = 0.35 * (np.ptp(value) or 1.0)
        ax.set_ylim(max(bottom, value.min() - room) - 0.05 * room, min(top, value.max() + room) + 0.05 * room)
    as_ratio = " (as a ratio of errors)" * (first["definition"] == "ratio")
    above = f"Claim {first['claim']}: {first['says']}{as_ratio}"
    style.finish(ax, "", QUANTITIES.get(first["kind"], "change [%]"), above, grid="y")
    ax.tick_params(axis="x", length=0)
    handles = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    inset: Any = {"loc": "upper left", "bbox_to_anchor": (0.0, 0.9), "edgecolor": "none", "fontsize": "small"}
    ax.legend(handles.values(), handles, **inset)


def _draw_matrix(ax: Axes, part: pd.DataFrame, rows: list[tuple[str, str]]) -> None:
    colours = np.array([VERDICTS[verdict].colour for verdict in part["verdict"]])
    for y, (name, choice) in enumerate(rows):
        if choice:
            x = np.flatnonzero(part[name] == choice)
            ax.vlines(x, y - 0.33, y + 0.33, color=colours[x], lw=0.6 * 62 * WIDE / (len(part) + 2))
            ax.axhline(y, color=style.GRID, lw=0.5, zorder=0)
    labels = [f"{choice}   " if choice else CASE.get(name, name) for name, choice in rows]
    ax.set_yticks(range(len(rows)), labels, fontsize=7)
    for label, (_, choice) in zip(ax.get_yticklabels(), rows, strict=True):
        label.set_fontweight("normal" if choice else "bold")
    ax.set(ylim=(len(rows) - 0.5, -0.5), xlim=(-1, len(part)))
    style.finish(ax, "specifications, sorted by their number")
    ax.tick_params(axis="both", length=0, labelbottom=False)
    ax.spines[["left", "bottom"]].set_visible(False)
