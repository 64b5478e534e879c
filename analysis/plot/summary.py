"""Figures: each takes and returns matplotlib Axes, and is readable in grey print and by colour-blind readers."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from cooploc.analysis.metrics.compare import summarize
from cooploc.analysis.metrics.consistency import CONSERVATIVE, OVER_CONFIDENT, consistency
from cooploc.estimators.plugins.errors import BadInput

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
        name = estimator + " (bound)" * (estimator in bounds)
        ax.scatter([], [], marker=MARKERS[i % len(MARKERS)], color=colours[estimator], label=name)
    _dress(ax, scenarios, int(table["trials"].min()), bool((flags == "over-confident").any()))
    return ax


def tradeoff(errors: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Accuracy against consistency: position RMSE over ANEES, each with its 95 % interval over trials.

    One scenario. In the band an estimator's covariance tells the truth; right of it, it promises more than it holds.
    """
    table = summarize(errors)
    if table["scenario"].nunique() > 1:
        raise BadInput(f"a tradeoff shows one scenario, these errors have {table['scenario'].nunique()}: select one")
    if ax is None:
        _, ax = plt.subplots(figsize=(8.0, 0.9 + 0.27 * max(len(table), 10)), layout="constrained")
    colours = sns.color_palette("colorblind", len(table))
    ax.axvspan(CONSERVATIVE, OVER_CONFIDENT, color="0.93", zorder=0)
    for i, row in enumerate(table.to_dict("records")):
        ax.plot([row["anees_low"], row["anees_high"]], [row["rmse"]] * 2, color=colours[i], lw=1.2)
        ax.plot([row["anees"]] * 2, [row["rmse_low"], row["rmse_high"]], color=colours[i], lw=1.2)
        ax.plot(row["anees"], row["rmse"], MARKERS[i % len(MARKERS)], color=colours[i], ms=7, label=row["estimator"])
    ax.set_xscale("log")
    low, high = ax.get_xlim()
    _decades(ax.xaxis, subs=(1, 2, 5) if high < 1000 * low else (1,))
    ax.set_xlabel("ANEES (1 is consistent; grey: neither over-confident nor conservative)")
    ax.set_ylabel("position RMSE [m]")
    ax.grid(color="0.9", lw=0.8)
    ax.set_axisbelow(True)
    sns.despine(ax=ax)
    trials = int(table["trials"].min())
    ax.set_title(f"{table['scenario'][0]}, {trials} trials, 95 % intervals", loc="left", fontsize="small", color="0.35")
    ax.legend(frameon=False, bbox_to_anchor=(1.0, 1.0), loc="upper left", fontsize="small")
    return ax


def _decades(axis: Any, subs: tuple[int, ...]) -> None:
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _broken(label: str) -> str:
    """A scenario's label over several lines."""
    path, bracket, options = label.partition("[")
    return path.replace("/", "\n", 1) + (bracket and "\n[" + options.replace(",", ",\n"))


def _axes(scenarios: list[str], estimators: list[str]) -> Axes:
    width = max(6.5, 2.5 + 0.2 * len(scenarios) * (len(estimators) + 2))
    _, ax = plt.subplots(figsize=(min(width, 14), 4), layout="constrained")
    return ax


def _dress(ax: Axes, scenarios: list[str], trials: int, hollow: bool) -> None:
    ax.set_yscale("log")
    ax.set_xticks(range(len(scenarios)), [_broken(label) for label in scenarios])
    ax.set_xlim(-0.5, len(scenarios) - 0.5)
    for edge in range(1, len(scenarios)):
        ax.axvline(edge - 0.5, color="0.9", lw=1, zorder=0)
    ax.set_ylabel("position RMSE [m]")
    _decades(ax.yaxis, subs=(1, 2, 5))
    ax.grid(axis="y", color="0.9", lw=0.8)
    ax.set_axisbelow(True)
    sns.despine(ax=ax)
    bars = f"mean and 95 % interval over {trials} trials" if trials >= 5 else f"{trials} trial(s), no interval below 5"
    ax.set_title(bars + ("; hollow: over-confident" if hollow else ""), loc="left", fontsize="small", color="0.35")
    ax.legend(frameon=False, bbox_to_anchor=(1.0, 1.0), loc="upper left", fontsize="small")
