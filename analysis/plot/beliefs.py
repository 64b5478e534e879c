"""What estimators believed beside what was true: in one tick, along a path, over the ticks, and as a film."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.animation import FuncAnimation
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.patches import Ellipse

from cooploc.analysis.formats import counted
from cooploc.analysis.metrics.curves import over_time
from cooploc.analysis.metrics.errors import INSIDE_95, demand_same
from cooploc.analysis.metrics.statistics import LEAST_TRIALS
from cooploc.analysis.plot import style
from cooploc.analysis.plot.style import DARK, GREY, Look
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.stream import Stream, Truth


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
    looks = style.session_looks(run.traces)
    axes = style.new_panels(len(run.traces), 2, (3.7, 3.7), sharex=True, sharey=True)
    for ax, (name, trace) in zip(axes, run.traces.items(), strict=True):
        x, P = trace.x[i, :, robot], trace.P[i, :, robot]
        ax.plot(*truth.x[i, :, robot, :2].T, color="black", lw=1.2, label="truth")
        ax.plot(*x[:, :2].T, color=looks[name].colour, lw=1.0, ls="--", label="estimate")
        for k in range(9, len(x), 10):
            ax.add_patch(ellipse(x[k], P[k], ec=looks[name].colour, lw=0.7))
        ax.set_aspect("equal")
        style.finish(ax, "x [m]", "y [m]", name)
    axes[0].legend(frameon=False, fontsize="small")
    return axes[0]


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
    table = over_time(truth, run)
    _draw_over_time(ax, run, table, "rmse")
    ax.set_ylim(0, 1.4 * style.span(table, "rmse")[1])
    style.finish(ax, "tick", "position RMSE [m]", _trials(run), grid="y")
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
    _draw_over_time(ax, run, table, "anees")
    low, high = style.span(table, "anees", "band_low", "band_high")
    style.logarithmic(ax.yaxis, low, high)
    ax.set_ylim(low / 1.4, 1.4 * high)
    style.finish(ax, "tick", "ANEES (1 is consistent)", _trials(run))
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


def _draw_over_time(ax: Axes, run: Run, table: pd.DataFrame, what: str) -> None:
    """A line over the ticks for each estimator, with its band."""
    looks = style.session_looks(run.traces)
    for name, rows in table.groupby("estimator", sort=False):
        colour, _, line = looks[str(name)]
        style.band(ax, rows["tick"], rows[f"{what}_low"], rows[f"{what}_high"], colour)
        ax.plot(rows["tick"], rows[what], color=colour, ls=line, lw=1.6, label=name)


def _trials(run: Run) -> str:
    intervals = ", 95 % intervals" * (len(run.trial) >= LEAST_TRIALS)
    return f"{run.scenario}, {counted(len(run.trial), 'trial')}{intervals}"


# ------------------------------------------------------------------------------------------------ a film

MOST = 400  # pictures, if no step is asked for
RADIUS_95 = float(np.sqrt(INSIDE_95))  # of the 95 % ellipse, in standard deviations
TRAIL = 30  # ticks of the past that stay visible
HEARD, LOST = GREY, style.VERMILION


def animate(
    truth: Truth,
    run: Run,
    stream: Stream | None = None,
    trial: int = 0,
    interval: float = 100.0,
    ax: Axes | None = None,
    step: int | None = None,
) -> FuncAnimation:
    """Show one trial, tick by tick; in a notebook `HTML(animation.to_jshtml())`, in a file `animation.save("a.gif")`.

    Args:
        truth: of the same stream as the run.
        run: from `run`.
        stream: what was run on; with it links are drawn, dotted vermilion where the packets of both are lost.
        trial: its number.
        interval: between two ticks [ms].
        ax: where to draw; a new figure if None.
        step: ticks from one picture to the next; where not given, so many that there are at most 400 pictures, as a
            notebook cuts off what is longer than 20 MB.

    Raises:
        BadInput: truth, run and stream do not belong together, or have no such trial; or step is below 1.

    """
    if step is not None and step < 1:
        raise BadInput(f"step is {step}; it must be at least 1")
    i = place(truth, run, trial)[0]
    if stream is not None and stream.hashes != run.hashes:
        raise BadInput(f"this stream ({stream.scenario}) is not the run's ({run.scenario}): simulate it again")
    made = ax is None
    ax = ax or style.new_axes(6.8, 5.2)
    _draw_arena(ax, truth, stream)
    _widen(ax, truth, list(run.traces.values()), i)
    path = truth.x[i, :, :, :2]  # (ticks, n, 2)
    links = LineCollection([], linewidths=1.0, zorder=1)
    ax.add_collection(links)
    trails = [ax.plot([], [], color=DARK, lw=1.0, zorder=2)[0] for _ in range(path.shape[1])]
    dots = ax.plot([], [], "x", color="black", ms=8, mew=2, ls="none", label="truth", zorder=5)[0]
    looks = style.session_looks(run.traces)
    beliefs = [_Belief(ax, name, trace, i, looks[name]) for name, trace in run.traces.items()]
    style.finish(ax, "x [m]", "y [m]", " ")
    style.legend(ax)
    if made:
        style.fit_height(ax)

    def draw(k: int) -> list[Any]:
        dots.set_data(*path[k].T)
        for robot, trail in enumerate(trails):
            trail.set_data(*path[max(0, k - TRAIL) : k + 1, robot].T)
        if stream is not None:
            _show_links(links, path[k], stream.air.link[i, k])
        for belief in beliefs:
            belief.show(k)
        style.note(ax, f"{run.scenario}, trial {trial}, tick {k}")
        return []

    frames = range(0, len(path), step or -(-len(path) // MOST))
    return FuncAnimation(ax.get_figure(True), draw, frames=frames, interval=interval)  # type: ignore[arg-type]


class _Belief:
    """What one estimator believes."""

    def __init__(self, ax: Axes, name: str, trace: Trace, trial: int, look: Look) -> None:
        self.x, self.P = trace.x[trial, :, :, :2], trace.P[trial, :, :, :2, :2]
        n = self.x.shape[1]
        self.dots = ax.plot([], [], ".", color=look.colour, ms=6, zorder=4)[0]
        ax.plot([], [], color=look.colour, ls=look.line, label=name)
        self.ellipses = EllipseCollection(
            np.ones(n), np.ones(n), np.zeros(n), units="xy", offsets=np.zeros((n, 2)), transOffset=ax.transData
        )
        self.ellipses.set(facecolor="none", edgecolor=look.colour, linestyle=look.line, linewidth=1.4, zorder=3)
        ax.add_collection(self.ellipses)

    def show(self, k: int) -> None:
        """Draw tick k."""
        self.dots.set_data(*self.x[k].T)
        width, height, angle = np.array([shape(P) for P in self.P[k]]).T
        self.ellipses.set_offsets(self.x[k])
        self.ellipses.set(widths=width, heights=height, angles=angle)


def _show_links(links: LineCollection, at: Array, heard: Array) -> None:
    """Lines between robots; a link counts as held where either of the two hears the other."""
    pairs = [(i, j) for i in range(len(at)) for j in range(i)]
    held = [bool(heard[i, j] or heard[j, i]) for i, j in pairs]
    links.set_segments([np.stack([at[i], at[j]]) for i, j in pairs])
    links.set_color([HEARD if yes else LOST for yes in held])
    links.set_linestyle(["solid" if yes else (0, (1, 2)) for yes in held])


def _draw_arena(ax: Axes, truth: Truth, stream: Stream | None) -> None:
    """The arena, and what is fixed in it."""
    (x0, y0), (x1, y1) = truth.arena
    margin = 0.05 * float(np.max(truth.arena[1] - truth.arena[0]))
    ax.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color=DARK, lw=1.2)
    if stream is not None:
        anchors, landmarks = stream.world.anchors, stream.world.landmarks
        for places, marker, name in ((anchors, "^", "anchors"), (landmarks, "s", "landmarks")):
            if len(places):
                ax.plot(*places.T, marker, color=DARK, mfc="white", ms=6, ls="none", label=name)
        ax.plot([], [], color=HEARD, label="packets arrive")
        ax.plot([], [], color=LOST, ls=":", label="packets are lost")
    ax.set(aspect="equal", xlim=(x0 - margin, x1 + margin), ylim=(y0 - margin, y1 + margin))


def _widen(ax: Axes, truth: Truth, traces: list[Trace], trial: int) -> None:
    """Limits that hold every ellipse of every tick, as far as half an arena beyond the arena."""
    low, high = truth.arena
    most = (high - low) / 2
    for trace in traces:
        x, P = trace.x[trial, ..., :2], trace.P[trial]
        reach = RADIUS_95 * np.sqrt(np.stack([P[..., 0, 0], P[..., 1, 1]], -1))
        low = np.fmin(low, np.nanmin(x - reach, (0, 1)))
        high = np.fmax(high, np.nanmax(x + reach, (0, 1)))
    low, high = np.maximum(low, truth.arena[0] - most), np.minimum(high, truth.arena[1] + most)
    (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
    ax.set(xlim=(min(x0, low[0]), max(x1, high[0])), ylim=(min(y0, low[1]), max(y1, high[1])))
