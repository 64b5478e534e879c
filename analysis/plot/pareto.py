"""Accuracy against traffic: which error is bought with how many bytes, and by whom without over-confidence."""

from typing import cast

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from cooploc.analysis.formats import counted
from cooploc.analysis.plot import style
from cooploc.analysis.plot.marks import drawable, marker, name_of, rmse_against, span
from cooploc.analysis.plot.style import Look
from cooploc.estimators.interface import Array

ACROSS = 2  # panels side by side
WIDTH, HEIGHT, LEGEND_ROW = 7.2, 2.5, 0.2  # of the figure, of a panel and of a line of the legend [in]


def pareto(errors: pd.DataFrame) -> Axes:
    """Position RMSE over the bytes that a robot sends in a tick, a panel for each scenario, and the frontier.

    The frontier joins the estimators that no other one beats in both error and bytes, of those that are neither
    over-confident (hollow) nor centralised (grey: all readings reach one computer). What sends nothing stands at the
    left, at 0.

    Args:
        errors: from `cl.errors`, one row per (scenario, estimator, trial, robot).

    Returns:
        The axes of the first scenario; the others follow.

    """
    table = drawable(errors)
    table = table[table["rmse"].notna()]
    scenarios, estimators = (list(dict.fromkeys(table[name])) for name in ("scenario", "estimator"))
    looks, zero = style.session_looks(estimators), _zero(table)
    table = table.assign(place=np.where(table["bytes"] > 0, table["bytes"], zero))
    rows, lines = -(-len(scenarios) // ACROSS), -(-len(estimators) // 3)
    size = WIDTH, HEIGHT * rows + LEGEND_ROW * (lines + 2)
    figure, axes = plt.subplots(
        rows, min(ACROSS, len(scenarios)), figsize=size, sharex=True, squeeze=False, layout="constrained"
    )
    for ax, scenario in zip(axes.flat, scenarios, strict=False):
        _panel(ax, table[table["scenario"] == scenario], looks, zero)
    for ax in axes.flat[len(scenarios) :]:
        ax.set_visible(False)
    for ax in axes.flat[max(0, len(scenarios) - axes.shape[1]) : len(scenarios)]:
        ax.tick_params(labelbottom=True)
    for row in table.drop_duplicates("estimator").to_dict("records"):
        marker(axes.flat[0], np.nan, np.nan, {**row, "consistency": ""}, looks[row["estimator"]], label=name_of(row))
    axes.flat[0].plot([], [], color=style.DARK, lw=1, label="frontier")
    axes.flat[0].plot([], [], "o", mfc="white", mec=style.DARK, label="hollow: over-confident")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return cast(Axes, axes.flat[0])


def _zero(table: pd.DataFrame) -> float:
    """Where the axis has its 0: a third of the least that anything sends."""
    sent = table.loc[table["bytes"] > 0, "bytes"]
    return float(sent.min()) / 3 if len(sent) else 1.0


def _panel(ax: Axes, part: pd.DataFrame, looks: dict[str, Look], zero: float) -> None:
    for row in part.to_dict("records"):
        rmse_against(ax, "place", row, looks[row["estimator"]])
    best = frontier(part)
    ax.step(best["place"], best["rmse"], where="post", color=style.DARK, lw=1, zorder=1)
    style.logarithmic(ax.yaxis, *span(part, "rmse_low", "rmse_high", "rmse"))
    ax.set_xscale("log")
    ticks = _ticks(2 * zero, max(part["place"].max(), 10 * zero))
    ax.set_xticks([zero, *ticks], ["0", *(f"{tick:g}" for tick in ticks)])
    ax.xaxis.minorticks_off()
    trials = counted(int(part["trials"].min()), "trial")
    style.finish(ax, "bytes per robot and tick", "RMSE [m]", f"{part['scenario'].iloc[0]}, {trials}", grid="both")


def _ticks(low: float, high: float) -> Array:
    """Powers of ten from `low` to `high`; within two decades their double and fivefold, too."""
    among = (1.0, 2.0, 5.0) if high < 100 * low else (1.0,)
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    ticks = np.sort(np.outer(powers, among).ravel())
    return ticks[(ticks >= low) & (ticks <= high)]


def frontier(table: pd.DataFrame) -> pd.DataFrame:
    """The rows that none beats in bytes and RMSE, by bytes; over-confident and centralised ones do not count."""
    able = table[~(table["consistency"].isin(["over-confident", "over-wide"]) | table["centralised"].astype(bool))]
    able = able.sort_values(["bytes", "rmse"])
    return able[able["rmse"] < able["rmse"].cummin().shift(fill_value=np.inf)]
