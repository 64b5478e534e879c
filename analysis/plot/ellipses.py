"""What estimators believed beside what was true: 95 % ellipses in one tick, and ANEES over the ticks."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse
from matplotlib.ticker import FuncFormatter, NullFormatter

from cooploc.analysis.metrics.errors import INSIDE_95, demand_same
from cooploc.analysis.metrics.over_time import over_time
from cooploc.estimators.interface import Array
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.stream import Truth

LINES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.5, 1.5)), (0, (5, 1.5, 1.5, 1.5)))


def ellipses(truth: Truth, run: Run, trial: int = 0, tick: int = -1, ax: Axes | None = None) -> Axes:
    """Every robot's true position (x) in one tick, and where each estimator puts it with its 95 % ellipse.

    Args:
        truth: of the same stream as the run.
        run: from `run`.
        trial: its number.
        tick: which one; negative ones count from the end.
        ax: where to draw.

    Raises:
        BadInput: truth and run are of different streams, or have no such trial or tick.

    """
    i, k = place(truth, run, trial, tick)
    if ax is None:
        _, ax = plt.subplots(figsize=(7.2, 4.2), layout="constrained")
    for (name, trace), colour, line in zip(run.traces.items(), colours(run), lines(run), strict=True):
        for x, P in zip(trace.x[i, k, :, :2], trace.P[i, k, :, :2, :2], strict=True):
            width, height, angle = shape(P)
            ax.add_patch(Ellipse((x[0], x[1]), width, height, angle=angle, fill=False, ec=colour, ls=line, lw=1.6))
        ax.plot(*trace.x[i, k, :, :2].T, ".", color=colour, ms=5)
        ax.plot([], [], color=colour, ls=line, label=name)
    ax.plot(*truth.x[i, k, :, :2].T, "x", color="black", ms=8, mew=2, ls="none", label="truth")
    ax.autoscale_view()
    ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    title = f"{run.scenario}, trial {trial}, tick {k}: 95 % ellipses"
    ax.set_title(title, loc="left", fontsize="small", color="0.35")
    ax.legend(frameon=False, fontsize="small", bbox_to_anchor=(1.0, 1.0), loc="upper left")
    sns.despine(ax=ax)
    return ax


def anees(truth: Truth, run: Run, ax: Axes | None = None) -> Axes:
    """ANEES over the ticks, with 95 % intervals over trials from 5 on.

    Grey: where a consistent estimator's lies in 95 % of the ticks, were errors Gaussian.

    Raises:
        BadInput: truth and run are of different streams.

    """
    if ax is None:
        _, ax = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
    table = over_time(truth, run)
    band = table.groupby("tick")[["band_low", "band_high"]].mean()
    ax.fill_between(band.index, band["band_low"], band["band_high"], color="0.9", lw=0, zorder=0)
    ax.axhline(1.0, color="0.5", lw=1, zorder=1)
    for (name, rows), colour, line in zip(
        table.groupby("estimator", sort=False), colours(run), lines(run), strict=True
    ):
        ax.fill_between(rows["tick"], rows["anees_low"], rows["anees_high"], color=colour, alpha=0.15, lw=0)
        ax.plot(rows["tick"], rows["anees"], color=colour, ls=line, lw=1.6, label=name)
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.set(xlabel="tick", ylabel="ANEES (1 is consistent)")
    title = f"{run.scenario}, {len(run.trial)} trial(s)" + ", 95 % intervals" * (len(run.trial) >= 5)
    ax.set_title(title, loc="left", fontsize="small", color="0.35")
    ax.legend(frameon=False, fontsize="small", bbox_to_anchor=(1.0, 1.0), loc="upper left")
    sns.despine(ax=ax)
    return ax


def place(truth: Truth, run: Run, trial: int, tick: int = -1) -> tuple[int, int]:
    """The positions of a trial and of a tick in the arrays.

    Raises:
        BadInput: truth and run are of different streams, or have no such trial or tick.

    """
    demand_same(truth, run)
    known, ticks = run.trial.tolist(), truth.x.shape[1]
    if trial not in known:
        raise BadInput(f"this run has no trial {trial}; it has {', '.join(map(str, known))}")
    if not -ticks <= tick < ticks:
        raise BadInput(f"this run has no tick {tick}; it has {ticks}, from 0")
    return known.index(trial), tick % ticks


def shape(P: Array) -> tuple[float, float, float]:
    """Width [m], height [m] and angle [deg] of the 95 % ellipse of a covariance (2, 2)."""
    values, vectors = np.linalg.eigh(P)
    width, height = 2 * np.sqrt(INSIDE_95 * np.maximum(values[::-1], 0.0))
    return float(width), float(height), float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))


def colours(run: Run) -> list[Any]:
    """One for each estimator."""
    return list(sns.color_palette("colorblind", len(run.traces)))


def lines(run: Run) -> list[Any]:
    """A line style for each estimator, so that grey print tells them apart."""
    return [LINES[i % len(LINES)] for i in range(len(run.traces))]
