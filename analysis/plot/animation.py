"""One trial as an animation: truth, estimates with their 95 % ellipses, links that hold and packets that are lost."""

from typing import Any

import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection

from cooploc.analysis.plot import style
from cooploc.analysis.plot.ellipses import place, shape
from cooploc.analysis.plot.style import DARK, GREY, Look
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.stream import Stream, Truth

MOST = 400  # pictures, if no step is asked for
RADIUS_95 = 2.4477  # of the 95 % ellipse, in standard deviations
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
    ax = _arena(ax or style.new_axes(6.8, 5.2), truth, stream)
    _widen(ax, truth, list(run.traces.values()), i)
    team = _Team(ax, truth.x[i, :, :, :2], None if stream is None else stream.air.link[i])
    looks = style.session_looks(run.traces)
    beliefs = [_Belief(ax, name, trace, i, looks[name]) for name, trace in run.traces.items()]
    style.finish(ax, "x [m]", "y [m]", " ")
    style.legend(ax)
    if made:
        style.fit_height(ax)

    def draw(k: int) -> list[Any]:
        team.show(k)
        for belief in beliefs:
            belief.show(k)
        style.note(ax, f"{run.scenario}, trial {trial}, tick {k}")
        return []

    ticks = truth.x.shape[1]
    frames = range(0, ticks, step or -(-ticks // MOST))
    return FuncAnimation(ax.get_figure(True), draw, frames=frames, interval=interval)  # type: ignore[arg-type]


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


class _Team:
    """The true positions, where the robots come from, and their links."""

    def __init__(self, ax: Axes, path: Array, heard: Any) -> None:
        self.path, self.heard = path, heard  # (ticks, n, 2), and (ticks, receiver, sender) or None
        self.links = LineCollection([], linewidths=1.0, zorder=1)
        ax.add_collection(self.links)
        self.trails = [ax.plot([], [], color=DARK, lw=1.0, zorder=2)[0] for _ in range(path.shape[1])]
        self.dots = ax.plot([], [], "x", color="black", ms=8, mew=2, ls="none", label="truth", zorder=5)[0]

    def show(self, k: int) -> None:
        """Draw tick k."""
        self.dots.set_data(*self.path[k].T)
        for robot, trail in enumerate(self.trails):
            trail.set_data(*self.path[max(0, k - TRAIL) : k + 1, robot].T)
        if self.heard is not None:
            self._link(self.path[k], self.heard[k])

    def _link(self, at: Array, heard: Any) -> None:
        """Lines between robots; a link counts as held where either of the two hears the other."""
        pairs = [(i, j) for i in range(len(at)) for j in range(i)]
        held = [bool(heard[i, j] or heard[j, i]) for i, j in pairs]
        self.links.set_segments([np.stack([at[i], at[j]]) for i, j in pairs])
        self.links.set_color([HEARD if yes else LOST for yes in held])
        self.links.set_linestyle(["solid" if yes else (0, (1, 2)) for yes in held])


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


def _arena(ax: Axes, truth: Truth, stream: Stream | None) -> Axes:
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
    return ax
