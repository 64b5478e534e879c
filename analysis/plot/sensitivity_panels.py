"""How the error of each estimator depends on what is swept: small panels with one scale."""

from typing import Any, cast

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator

from cooploc.analysis.plot import style
from cooploc.analysis.plot.marks import curve, span

NAMES = {  # parameter -> what stands below its panel
    "prior_sigma": "sd of the prior position [m]",
    "odometry_sigma": "sd of odometry per axis and step [m]",
    "ticks": "duration [ticks]",
    "particles": "particles",
    "assumed.eta": "assumed path-loss exponent",
    "prior_heading": "no compass: sd of the prior heading [rad]",
}
ACROSS, WIDTH, HEIGHT = 2, 3.6, 2.3  # panels in a row, and the size of each [in]
WIDE = 4  # a sweep over more than this factor has a logarithmic axis


def sensitivity(table: pd.DataFrame) -> Axes:
    """Position RMSE over each parameter that is swept, with bands of 95 % intervals and the floor as a dotted line.

    All panels have one logarithmic scale. A dashed vertical line is the preset's value, of an assumed parameter the
    true one. Hollow markers are over-confident, centralised estimators are grey.

    Args:
        table: from `cl.sensitivity`.

    Returns:
        The axes of the first panel.

    """
    parameters = list(dict.fromkeys(table["parameter"]))
    down = -(-len(parameters) // ACROSS)
    figure, axes = plt.subplots(
        down, ACROSS, figsize=(ACROSS * WIDTH, down * HEIGHT + 0.5), sharey=True, squeeze=False, layout="constrained"
    )
    style.logarithmic(axes[0, 0].yaxis, *span(table, "rmse", "floor"))
    handles: dict[str, Any] = {}
    for k, (ax, parameter) in enumerate(zip(axes.flat, parameters, strict=False)):
        _panel(ax, table[table["parameter"] == parameter].sort_values("value", kind="stable"))
        ylabel = "position RMSE [m]" if k % ACROSS == 0 else ""
        style.finish(ax, NAMES.get(parameter, parameter), ylabel, grid="both")
        handles |= dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    for ax in list(axes.flat)[len(parameters) :]:
        ax.set_visible(False)
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    return cast(Axes, axes[0, 0])


def _panel(ax: Axes, part: pd.DataFrame) -> None:
    """One parameter."""
    for name, look in style.session_looks(part["estimator"]).items():
        curve(ax, part[part["estimator"] == name], "value", look, alpha=0.12)
    floor = part.groupby("value")["floor"].first()
    if floor.notna().any():
        ax.plot(floor.index, floor, color="black", ls=style.DOTTED, lw=1.6, label="floor", zorder=1)
    ax.axvline(part["preset"].iloc[0], color="0.5", ls=style.BROKEN, lw=1, zorder=0)
    values = np.unique(part["value"])
    if values[0] > 0 and values[-1] > WIDE * values[0]:
        ax.set_xscale("log")
        ax.xaxis.set_minor_locator(NullLocator())
    ax.set_xticks(values, [f"{value:g}" for value in values])
