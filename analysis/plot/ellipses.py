"""What estimators believed beside what was true: 95 % ellipses in one tick, and ANEES over the ticks."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse

from cooploc.analysis.formats import counted
from cooploc.analysis.metrics.curves import over_time
from cooploc.analysis.metrics.errors import INSIDE_95, demand_same
from cooploc.analysis.metrics.statistics import LEAST_TRIALS
from cooploc.analysis.plot import style
from cooploc.analysis.plot.marks import span
from cooploc.estimators.interface import Array
from cooploc.estimators.plugins.errors import BadInput
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
    looks = style.session_looks(run.traces)
    for name, rows in table.groupby("estimator", sort=False):
        colour, _, line = looks[str(name)]
        style.band(ax, rows["tick"], rows["anees_low"], rows["anees_high"], colour)
        ax.plot(rows["tick"], rows["anees"], color=colour, ls=line, lw=1.6, label=name)
    low, high = span(table, "anees", "band_low", "band_high")
    style.logarithmic(ax.yaxis, low, high)
    ax.set_ylim(low / 1.4, 1.4 * high)
    intervals = ", 95 % intervals" * (len(run.trial) >= LEAST_TRIALS)
    note = f"{run.scenario}, {counted(len(run.trial), 'trial')}{intervals}"
    style.finish(ax, "tick", "ANEES (1 is consistent)", note)
    style.legend(ax)
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


def ellipse(x: Array, P: Array, **look: Any) -> Ellipse:
    """The 95 % ellipse of a belief, position first."""
    width, height, angle = shape(P[:2, :2])
    return Ellipse((float(x[0]), float(x[1])), width, height, angle=angle, fill=False, **look)
