"""Beliefs of estimators beside the truth: in one tick, along a path, over the ticks, and as a film."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.animation import FuncAnimation
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.patches import Ellipse

from cooploc.analysis.metrics.compare import over_time
from cooploc.analysis.metrics.errors import INSIDE_95, demand_same
from cooploc.analysis.metrics.statistics import LEAST_TRIALS
from cooploc.analysis.plot import style
from cooploc.analysis.plot.results import MOST_ANEES
from cooploc.analysis.plot.style import DARK
from cooploc.analysis.plot.worlds import draw_arena, set_links
from cooploc.estimators.errors import BadInput, count_of
from cooploc.estimators.interface import Array
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.stream import Stream, Truth


def ellipses(truth: Truth, run: Run, trial: int = 0, tick: int = -1, ax: Axes | None = None) -> Axes:
    """Draw every robot's true position (x) in one tick, and where each estimator puts it with its 95 % ellipse.

    Truth and run are of one stream; a negative tick counts from the end. Without `ax` a figure is made.
    """
    i, k = find_place(truth, run, trial, tick)
    drawn = ax or style.new_axes(7.2, 4.2)
    for name, (colour, _, line) in style.session_pens(run.traces).items():
        x, P = run.traces[name].x[i, k, :, :2], run.traces[name].P[i, k]
        for mean, covariance in zip(x, P, strict=True):
            drawn.add_patch(ellipse(mean, covariance, ec=colour, ls=line, lw=1.6))
        drawn.plot(*x.T, ".", color=colour, ms=5)
        drawn.plot([], [], color=colour, ls=line, label=name)
    drawn.plot(*truth.x[i, k, :, :2].T, "x", color="black", ms=8, mew=2, ls="none", label="truth")
    drawn.autoscale_view()
    drawn.set_aspect("equal")
    style.finish(drawn, "x [m]", "y [m]", f"{run.scenario}, trial {trial}, tick {k}: 95 % ellipses")
    style.add_legend(drawn)
    if ax is None:
        style.fit_height(drawn)
    return drawn


def trajectories(truth: Truth, run: Run, trial: int = 0, robot: int = 0) -> Axes:
    """Draw a robot's true path and its estimate by each estimator, with the 95 % ellipse of every tenth tick.

    Of more than a thousand ticks a hundred have one; without covariances none has. Each estimator has axes of its own;
    those of the first are returned.
    """
    i = find_place(truth, run, trial)[0]
    if not 0 <= robot < truth.x.shape[2]:
        raise BadInput(f"robot is {robot}; there are {truth.x.shape[2]}, from 0 on")
    pens = style.session_pens(run.traces)
    axes = style.new_panels(len(run.traces), 2, (3.7, 3.7), sharex=True, sharey=True)
    for ax, (name, trace) in zip(axes, run.traces.items(), strict=True):
        x, P = trace.x[i, :, robot], trace.P[i, :, robot]
        ax.plot(*truth.x[i, :, robot, :2].T, color="black", lw=1.2, label="truth")
        ax.plot(*x[:, :2].T, color=pens[name].colour, lw=1.0, ls="--", label="estimate")
        for k in (k for k in range(9, len(x), max(10, len(x) // 100)) if np.isfinite(P[k]).all()):
            ax.add_patch(ellipse(x[k], P[k], ec=pens[name].colour, lw=0.7))
        ax.set_aspect("equal")
        style.finish(ax, "x [m]", "y [m]", name)
    axes[0].legend(frameon=False, fontsize="small")
    return axes[0]


def error_over_time(truth: Truth, run: Run, ax: Axes | None = None) -> Axes:
    """Draw position RMSE over the ticks, with 95 % intervals over trials from 5 on."""
    ax = ax or style.new_axes(7.0, 3.6)
    table = _draw_over_time(ax, truth, run, "rmse", "position RMSE [m]")
    ax.set_ylim(0, 1.4 * style.span(table, "rmse")[1])
    return ax


def anees(truth: Truth, run: Run, ax: Axes | None = None) -> Axes:
    """Draw ANEES over the ticks, with 95 % intervals over trials from 5 on, cut off far beyond the values.

    Grey: where a consistent estimator's lies in 95 % of the ticks, if errors are Gaussian.
    """
    ax = ax or style.new_axes(7.0, 3.6)
    table = _draw_over_time(ax, truth, run, "anees", "ANEES (1 is consistent)")
    band = table.groupby("tick")[["band_low", "band_high"]].mean()
    ax.fill_between(band.index, band["band_low"], band["band_high"], color="0.9", lw=0, zorder=0)
    ax.axhline(1.0, color="0.5", lw=1, zorder=1)
    low, high = style.span(table, "anees", "band_low", "band_high")
    style.set_log_scale(ax.yaxis, low, high)
    ax.set_ylim(low / 1.4, min(1.4 * high, MOST_ANEES))
    return ax


MOST_TICKS = 2000  # more than a figure has points beside each other


def _draw_over_time(ax: Axes, truth: Truth, run: Run, what: str, label: str) -> pd.DataFrame:
    """Draw a line over the ticks for each estimator, with its band; return the table of `over_time`.

    Of more than `MOST_TICKS` every second one is drawn, or fewer.
    """
    step = -(-truth.x.shape[1] // MOST_TICKS)
    table, pens = over_time(truth, run, step), style.session_pens(run.traces)
    for name, rows in table.groupby("estimator", sort=False):
        colour, _, line = pens[str(name)]
        style.draw_band(ax, rows["tick"], rows[f"{what}_low"], rows[f"{what}_high"], colour)
        ax.plot(rows["tick"], rows[what], color=colour, ls=line, lw=1.6, label=name)
    intervals = ", 95 % intervals" * (len(run.trial) >= LEAST_TRIALS)
    style.finish(ax, "tick", label, f"{run.scenario}, {count_of(len(run.trial), 'trial')}{intervals}", "y")
    style.add_legend(ax)
    return table


def find_place(truth: Truth, run: Run, trial: int, tick: int = -1) -> tuple[int, int]:
    """Return the positions of a trial and of a tick in the arrays."""
    demand_same(truth, run)
    known, ticks = run.trial.tolist(), truth.x.shape[1]
    if trial not in known:
        raise BadInput(f"this run has no trial {trial}; it has {', '.join(map(str, known))}")
    if not -ticks <= tick < ticks:
        raise BadInput(f"this run has no tick {tick}; it has {ticks}, from 0")
    return known.index(trial), tick % ticks


def ellipse_shape(P: Array) -> tuple[float, float, float]:
    """Return width [m], height [m] and angle [deg] of the 95 % ellipse of a covariance (2, 2)."""
    values, vectors = np.linalg.eigh(P)
    width, height = 2 * np.sqrt(INSIDE_95 * np.maximum(values[::-1], 0.0))
    return float(width), float(height), float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))


def ellipse(x: Array, P: Array, **how: Any) -> Ellipse:
    """Return the 95 % ellipse of a belief, position first."""
    width, height, angle = ellipse_shape(P[:2, :2])
    return Ellipse((float(x[0]), float(x[1])), width, height, angle=angle, fill=False, **how)


# ------------------------------------------------------------------------------------------------ a film

MOST = 400  # pictures
TRAIL = 30  # ticks of the past that stay visible


def animate(
    truth: Truth,
    run: Run,
    stream: Stream | None = None,
    trial: int = 0,
    interval: float = 100.0,
    ax: Axes | None = None,
) -> FuncAnimation:
    """Show one trial, tick by tick; in a notebook `HTML(animation.to_jshtml())`, in a file `animation.save("a.gif")`.

    With the `stream` of the run links are drawn, dotted where the packets of both are lost; `interval` [ms] is
    from one picture to the next, of which there are at most 400: a notebook cuts off what is longer than 20 MB.
    """
    i = find_place(truth, run, trial)[0]
    if stream is not None and stream.hashes != run.hashes:
        raise BadInput(f"this stream ({stream.scenario}) is not the run's ({run.scenario}): simulate it again")
    drawn = ax or style.new_axes(6.8, 5.2)
    draw_arena(drawn, truth.arena, stream.world if stream else None)
    path = truth.x[i, :, :, :2]  # (ticks, n, 2)
    links = LineCollection([], linewidths=1.0, zorder=1)
    drawn.add_collection(links)
    trails = [drawn.plot([], [], color=DARK, lw=1.0, zorder=2)[0] for _ in range(path.shape[1])]
    robots = drawn.plot([], [], "x", color="black", ms=8, mew=2, ls="none", label="truth", zorder=5)[0]
    beliefs, none = [], np.zeros(path.shape[1])
    for name, pen in style.session_pens(run.traces).items():
        dots = drawn.plot([], [], ".", color=pen.colour, ms=6, zorder=4)[0]
        drawn.plot([], [], color=pen.colour, ls=pen.line, label=name)
        ovals = EllipseCollection(none, none, none, units="xy", offsets=path[0], transOffset=drawn.transData)
        ovals.set(facecolor="none", edgecolor=pen.colour, linestyle=pen.line, linewidth=1.4, zorder=3)
        drawn.add_collection(ovals)
        beliefs.append((run.traces[name], dots, ovals))
    style.finish(drawn, "x [m]", "y [m]", " ")
    style.add_legend(drawn)
    if ax is None:
        style.fit_height(drawn)

    def draw(k: int) -> list[Any]:
        robots.set_data(*path[k].T)
        for robot, trail in enumerate(trails):
            trail.set_data(*path[max(0, k - TRAIL) : k + 1, robot].T)
        if stream is not None:
            set_links(links, path[k], stream.air.link[i, k])
        for trace, dots, ovals in beliefs:
            x, P = trace.x[i, k, :, :2], trace.P[i, k, :, :2, :2]
            dots.set_data(*x.T)
            width, height, angle = np.array([ellipse_shape(one) for one in P]).T
            ovals.set(offsets=x, widths=width, heights=height, angles=angle)
        style.set_note(drawn, f"{run.scenario}, trial {trial}, tick {k}")
        return []

    frames = range(0, len(path), -(-len(path) // MOST))
    return FuncAnimation(drawn.get_figure(True), draw, frames=frames, interval=interval)  # type: ignore[arg-type]
