"""Figures: each takes and returns matplotlib Axes, and is readable in grey print and by colour-blind readers."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from cooploc.analysis.compare import consistency, summarize
from cooploc.analysis.world import world as world

MARKERS = "osD^vP*Xph<>"


def rmse(errors: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Position RMSE of every estimator in every scenario, with 95 % intervals over trials.

    Hollow markers are over-confident: their 95 % ellipses promise more than they hold.
    """
    table = summarize(errors)
    scenarios, estimators = (list(dict.fromkeys(table[column])) for column in ("scenario", "estimator"))
    ax = ax or _axes(scenarios, estimators)
    colours = dict(zip(estimators, sns.color_palette("colorblind", len(estimators)), strict=True))
    flags = consistency(table)
    bounds = set(errors.loc[errors["bound"], "estimator"])
    place = np.linspace(-0.3, 0.3, len(estimators)) if len(estimators) > 1 else [0.0]
    for i, estimator in enumerate(estimators):
        rows = table[table["estimator"] == estimator]
        x = [scenarios.index(s) + place[i] for s in rows["scenario"]]
        around = np.abs(rows[["rmse_low", "rmse_high"]].to_numpy().T - rows["rmse"].to_numpy())
        ax.errorbar(x, rows["rmse"], np.nan_to_num(around), fmt="none", ecolor=colours[estimator], capsize=3, lw=1.5)
        hollow = (flags[rows.index] == "over-confident").to_numpy()
        for fill, which in ((colours[estimator], ~hollow), ("white", hollow)):
            style: dict[str, Any] = {"marker": MARKERS[i % len(MARKERS)], "s": 45, "zorder": 3, "linewidths": 1.5}
            ax.scatter(np.array(x)[which], rows["rmse"][which], facecolor=fill, edgecolor=colours[estimator], **style)
        ax.scatter(
            [],
            [],
            marker=MARKERS[i % len(MARKERS)],
            color=colours[estimator],
            label=estimator + " (bound)" * (estimator in bounds),
        )
    _dress(ax, scenarios, int(table["trials"].min()), bool((flags == "over-confident").any()))
    return ax


def _axes(scenarios: list[str], estimators: list[str]) -> Axes:
    width = max(6.5, 2.5 + 0.2 * len(scenarios) * (len(estimators) + 2))
    _, ax = plt.subplots(figsize=(min(width, 14), 4), layout="constrained")
    return ax


def _dress(ax: Axes, scenarios: list[str], trials: int, hollow: bool) -> None:
    ax.set_yscale("log")
    ax.set_xticks(range(len(scenarios)), [label.replace("/", "\n", 1) for label in scenarios])
    ax.set_xlim(-0.5, len(scenarios) - 0.5)
    for edge in range(1, len(scenarios)):
        ax.axvline(edge - 0.5, color="0.9", lw=1, zorder=0)
    ax.set_ylabel("position RMSE [m]")
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.grid(axis="y", color="0.9", lw=0.8)
    ax.set_axisbelow(True)
    sns.despine(ax=ax)
    bars = f"mean and 95 % interval over {trials} trials" if trials >= 5 else f"{trials} trial(s), no interval below 5"
    ax.set_title(bars + ("; hollow: over-confident" if hollow else ""), loc="left", fontsize="small", color="0.35")
    ax.legend(frameon=False, bbox_to_anchor=(1.0, 1.0), loc="upper left", fontsize="small")
