"""What estimators believed beside what was true: 95 % ellipses in one tick, and ANEES over the ticks."""

from typing import Any, cast

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse

from cooploc.analysis.formats import counted
from cooploc.analysis.metrics.curves import over_time
from cooploc.analysis.metrics.errors import INSIDE_95, demand_same
from cooploc.analysis.metrics.statistics import LEAST_TRIALS
from cooploc.analysis.plot import style
from cooploc.analysis.plot.marks import span
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.stream import Truth


def ellipses(truth: Truth, run: Run, trial: int = 0, tick: int = -1, ax: Axes | None = None) -> Axes:
    """Every robot's true position (x) in one tick, and where each estimator puts it with its 95 % ellipse.

    Args:
        truth: of the same stream as the run.
        run: from `run`.
        trial: its number.
        tick: which one; negative ones count from the end.
        ax: where to draw; a new figure if None.

    Raises:
        BadInput: truth and run are of different streams, or have no such trial or tick.

    """
    i, k = place(truth, run, trial, tick)
    made = ax is None
    ax = ax or style.new_axes(7.2, 4.2)
    looks = style.session_looks(run.traces)
    for name, trace in run.traces.items():
        colour, _, line = looks[name]
        for x, P in zip(trace.x[i, k, :, :2], trace.P[i, k, :, :2, :2], strict=True):
            ax.add_patch(ellipse(x, P, ec=colour, ls=line, lw=1.6))
        ax.plot(*trace.x[i, k, :, :2].T, ".", color=colour, ms=5)
        ax.plot([], [], color=colour, ls=line, label=name)
    ax.plot(*truth.x[i, k, :, :2].T, "x", color="black", ms=8, mew=2, ls="none", label="truth")
    ax.autoscale_view()
    ax.set_aspect("equal")
    style.finish(ax, "x [m]", "y [m]", f"{run.scenario}, trial {trial}, tick {k}: 95 % ellipses")
    style.legend(ax)
    if made:
        style.fit_height(ax)
    return ax


def trajectories(truth: Truth, run: Run, trial: int = 0, robot: int = 0) -> Axes:
    """One robot's true path and its estimate by each estimator, with the 95 % ellipse of every tenth tick.

    Args:
        truth: of the same stream as the run.
        run: from `run`.
        trial: its number.
        robot: its number.

    Returns:
        The axes of the first estimator; each has its own.

    Raises:
        BadInput: truth and run are of different streams, or have no such trial.

    """
    i = place(truth, run, trial)[0]
    across = min(2, len(run.traces))
    down = -(-len(run.traces) // across)
    size = 3.7 * across, 3.7 * down
    _, axes = plt.subplots(down, across, figsize=size, layout="constrained", sharex=True, sharey=True, squeeze=False)
    looks = style.session_looks(run.traces)
    for ax, (name, trace) in zip(axes.flat, run.traces.items(), strict=False):
        x, P = trace.x[i, :, robot], trace.P[i, :, robot]
        ax.plot(*truth.x[i, :, robot, :2].T, color="black", lw=1.2, label="truth")
        ax.plot(*x[:, :2].T, color=looks[name].colour, lw=1.0, ls="--", label="estimate")
        for k in range(9, len(x), 10):
            ax.add_patch(ellipse(x[k], P[k], ec=looks[name].colour, lw=0.7))
        ax.set_aspect("equal")
        style.finish(ax, "x [m]", "y [m]", name)
    for ax in axes.flat[len(run.traces) :]:
        ax.remove()
    axes[0, 0].legend(frameon=False, fontsize="small")
    return cast(Axes, axes[0, 0])


def error_over_time(truth: Truth, run: Run, ax: Axes | None = None) -> Axes:
    """Position RMSE over the ticks, with 95 % intervals over trials from 5 on.

    Args:
        truth: of the same stream as the run.
        run: from `run`.
        ax: where to draw; a new figure if None.

    Raises:
        BadInput: truth and run are of different streams.

    """
    ax = ax or style.new_axes(7.0, 3.6)
    _curves(ax, run, over_time(truth, run), "rmse")
    ax.set_ylim(0)
    style.finish(ax, "tick", "position RMSE [m]", _note(run), grid="y")
    style.legend(ax)
    return ax


def anees(truth: Truth, run: Run, ax: Axes | None = None) -> Axes:
    """ANEES over the ticks, with 95 % intervals over trials from 5 on.

    Grey: where a consistent estimator's lies in 95 % of the ticks, if errors are Gaussian. Intervals are cut off where
    they reach far beyond the values.

    Args:
        truth: of the same stream as the run.
        run: from `run`.
        ax: where to draw; a new figure if None.

    Raises:
        BadInput: truth and run are of different streams.

    """
    ax = ax or style.new_axes(7.0, 3.6)
    table = over_time(truth, run)
    band = table.groupby("tick")[["band_low", "band_high"]].mean()
    ax.fill_between(band.index, band["band_low"], band["band_high"], color="0.9", lw=0, zorder=0)
    ax.axhline(1.0, color="0.5", lw=1, zorder=1)
    _curves(ax, run, table, "anees")
    low, high = span(table, "anees", "band_low", "band_high")
    style.logarithmic(ax.yaxis, low, high)
    ax.set_ylim(low / 1.4, 1.4 * high)
    style.finish(ax, "tick", "ANEES (1 is consistent)", _note(run))
    style.legend(ax)
    return ax


def _curves(ax: Axes, run: Run, table: pd.DataFrame, what: str) -> None:
    """A line over the ticks for each estimator, with its band."""
    looks = style.session_looks(run.traces)
    for name, rows in table.groupby("estimator", sort=False):
        colour, _, line = looks[str(name)]
        style.band(ax, rows["tick"], rows[f"{what}_low"], rows[f"{what}_high"], colour)
        ax.plot(rows["tick"], rows[what], color=colour, ls=line, lw=1.6, label=name)


def _note(run: Run) -> str:
    intervals = ", 95 % intervals" * (len(run.trial) >= LEAST_TRIALS)
    return f"{run.scenario}, {counted(len(run.trial), 'trial')}{intervals}"


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


def ellipse(x: Array, P: Array, **look: Any) -> Ellipse:
    """The 95 % ellipse of a belief, position first."""
    width, height, angle = shape(P[:2, :2])
    return Ellipse((float(x[0]), float(x[1])), width, height, angle=angle, fill=False, **look)
