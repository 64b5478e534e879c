"""The matrix of information as one picture: error by own reading, by readings between robots, and by rule of fusion."""

from typing import Any, cast

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from cooploc.analysis.formats import counted
from cooploc.analysis.plot import style
from cooploc.analysis.plot.marks import marker, rmse_at, span

OWN = {"none": "none", "doa": "direction of arrival", "gradient": "gradient", "rssi": "raw RSSI"}
BETWEEN = {"none": "none", "rssi": "RSSI", "range": "range"}
RULES = {  # (fusion, filter) -> name, and the estimator whose look it has
    ("alone", "particles"): ("alone, particles", "arl"),
    ("alone", "Kalman"): ("alone, Kalman", "ekf-local"),
    ("product", "particles"): ("product of beliefs, particles", "mrsl-rssi"),
    ("intersection", "particles"): ("covariance intersection, particles", "ctrn"),
    ("intersection", "Kalman"): ("covariance intersection, Kalman", "ekf-ci"),
    ("centralised", "Kalman"): ("centralised, Kalman", "ekf-joint"),
    ("bound", "MAP"): ("bound, maximum a posteriori", "map-joint"),
}
WIDTH, ROW, GAP = 7.2, 1.55, 0.6  # of the figure and of a row [in]; between teams, in units of the x axis


def information(table: pd.DataFrame) -> Axes:
    """Position RMSE with 95 % intervals in every cell of the matrix, and the cell's floor as a dotted line.

    A row for each own reading, on the same logarithmic scale; in it, from left to right, the teams, and what they read
    of each other. Hollow markers are over-confident; centralised estimators and the bound are grey.

    Args:
        table: from `cl.information`.

    Returns:
        The axes of the first row; the others stand below.

    """
    rows = [name for name in OWN if (table["own"] == name).any()]
    _, axes = plt.subplots(
        len(rows), figsize=(WIDTH, ROW * len(rows) + 1.1), sharex=True, sharey=True, squeeze=False, layout="constrained"
    )
    groups = _groups(table)
    style.logarithmic(axes[0, 0].yaxis, *span(table, "rmse", "floor"))
    for ax, name in zip(axes[:, 0], rows, strict=True):
        _row(ax, table[table["own"] == name], groups)
        style.finish(ax, "", "RMSE [m]", f"own reading: {OWN[name]}", grid="y")
    _below(axes[-1, 0], groups)
    _legend(axes[-1, 0], table)
    return cast(Axes, axes[0, 0])


def _groups(table: pd.DataFrame) -> dict[tuple[int, str], float]:
    """The place of each (robots, between) on the x axis; teams stand apart."""
    found = {(int(n), str(b)) for n, b in zip(table["robots"], table["between"], strict=True)}
    groups, x = {}, 0.0
    for robots in sorted({n for n, _ in found}):
        for between in (b for b in BETWEEN if (robots, b) in found):
            groups[robots, between] = x
            x += 1
        x += GAP
    return groups


def _row(ax: Axes, part: pd.DataFrame, groups: dict[tuple[int, str], float]) -> None:
    looks = style.looks(look for _, look in RULES.values())
    for (robots, between), x in groups.items():
        here = part[(part["robots"] == robots) & (part["between"] == between)]
        floor = here["floor"].min()
        if np.isfinite(floor):
            ax.plot([x - 0.42, x + 0.42], [floor, floor], color="black", ls=style.DOTTED, lw=1.6, zorder=1)
        dodge = 0.15 * (np.arange(len(here)) - (len(here) - 1) / 2)
        for shift, row in zip(dodge, here.to_dict("records"), strict=True):
            rmse_at(ax, x + shift, row, looks[RULES[row["fusion"], row["filter"]][1]])


def _below(ax: Axes, groups: dict[tuple[int, str], float]) -> None:
    """What is read between robots, under each group, and the team under its groups."""
    ax.set_xticks(list(groups.values()), [BETWEEN[between] for _, between in groups])
    ax.tick_params(axis="x", length=0)
    ax.annotate(
        "read of\nteammates", (0, 0), (-4, -3), xycoords="axes fraction",
        textcoords="offset points", ha="right", va="top", fontsize=8,
    )  # fmt: skip
    for robots in dict.fromkeys(n for n, _ in groups):
        middle = float(np.mean([x for (n, _), x in groups.items() if n == robots]))
        ax.annotate(
            counted(robots, "robot"), (middle, 0), (0, -20), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", va="top", weight="bold",
        )  # fmt: skip


def _legend(ax: Axes, table: pd.DataFrame) -> None:
    there = set(zip(table["fusion"], table["filter"], strict=True))
    looks, handles = style.looks(look for _, look in RULES.values()), []
    for rule, (name, look) in RULES.items():
        if rule in there:
            grey: dict[str, Any] = {"consistency": "", "centralised": rule[0] in ("centralised", "bound")}
            marker(ax, np.nan, np.nan, grey, looks[look], label=name)
            handles.append(ax.lines[-1])
    handles += ax.plot([], [], color="black", ls=style.DOTTED, lw=1.6, label="floor of the readings in the cell")
    handles += ax.plot([], [], "o", mfc="white", mec=style.DARK, label="hollow: over-confident")
    ax.figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
