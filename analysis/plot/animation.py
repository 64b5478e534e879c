"""One trial as an animation: truth, estimates with their 95 % ellipses, links that hold and packets that are lost."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import seaborn as sns
from matplotlib.animation import FuncAnimation
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection

from cooploc.analysis.plot.ellipses import colours, lines, place, shape
from cooploc.estimators.interface import Array
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.stream import Stream, Truth

TRAIL = 30  # ticks of the past that stay visible
HEARD, LOST = "0.55", "#d55e00"


def animate(
    truth: Truth,
    run: Run,
    stream: Stream | None = None,
    trial: int = 0,
    interval: float = 100.0,
    ax: Axes | None = None,
) -> FuncAnimation:
    """Show one trial, tick by tick; in a notebook `HTML(animation.to_jshtml())`, in a file `animation.save("a.gif")`.

    Args:
        truth: of the same stream as the run.
        run: from `run`.
        stream: what was run on; with it links are drawn, dotted vermilion where the packets of both are lost.
        trial: its number.
        interval: between two ticks [ms].
        ax: where to draw.

    Raises:
        BadInput: truth, run and stream are not of each other, or have no such trial.

    """
    i, _ = place(truth, run, trial)
    if stream is not None and stream.hashes != run.hashes:
        raise BadInput(f"this stream ({stream.scenario}) is not what the run is of ({run.scenario}): simulate anew")
    if ax is None:
        _, ax = plt.subplots(figsize=(6.4, 5.2), layout="constrained")
    _room(ax, truth, stream)
    path = truth.x[i, :, :, :2]
    links = LineCollection([], linewidths=1.0, zorder=1)
    ax.add_collection(links)
    trails = [ax.plot([], [], color="0.3", lw=1.0, zorder=2)[0] for _ in range(path.shape[1])]
    dots = ax.plot([], [], "x", color="black", ms=8, mew=2, ls="none", label="truth", zorder=5)[0]
    beliefs = [
        _Belief(ax, name, t, i, c, line)
        for (name, t), c, line in zip(run.traces.items(), colours(run), lines(run), strict=True)
    ]
    ax.legend(frameon=False, fontsize="small", bbox_to_anchor=(1.0, 1.0), loc="upper left")
    title = ax.set_title("", loc="left", fontsize="small", color="0.35")

    def draw(k: int) -> list[Any]:
        dots.set_data(*path[k].T)
        for robot, trail in enumerate(trails):
            trail.set_data(*path[max(0, k - TRAIL) : k + 1, robot].T)
        if stream is not None:
            _link(links, path[k], stream.air.link[i, k])
        for belief in beliefs:
            belief.show(k)
        title.set_text(f"{run.scenario}, trial {trial}, tick {k}")
        return [dots, *trails, links, title]

    figure: Any = ax.figure
    return FuncAnimation(figure, draw, frames=len(path), interval=interval)


class _Belief:
    """What one estimator draws."""

    def __init__(self, ax: Axes, name: str, trace: Trace, trial: int, colour: Any, line: Any) -> None:
        self.x, self.P = trace.x[trial, :, :, :2], trace.P[trial, :, :, :2, :2]
        n = self.x.shape[1]
        self.dots = ax.plot([], [], ".", color=colour, ms=6, zorder=4)[0]
        ax.plot([], [], color=colour, ls=line, label=name)
        self.ellipses = EllipseCollection(
            np.ones(n), np.ones(n), np.zeros(n), units="xy", offsets=np.zeros((n, 2)), transOffset=ax.transData
        )
        self.ellipses.set(facecolor="none", edgecolor=colour, linestyle=line, linewidth=1.4, zorder=3)
        ax.add_collection(self.ellipses)

    def show(self, k: int) -> None:
        """Draw tick k."""
        self.dots.set_data(*self.x[k].T)
        width, height, angle = np.array([shape(P) for P in self.P[k]]).T
        self.ellipses.set_offsets(self.x[k])
        self.ellipses.set(widths=width, heights=height, angles=angle)


def _room(ax: Axes, truth: Truth, stream: Stream | None) -> None:
    """The arena, and what is fixed in it."""
    (x0, y0), (x1, y1) = truth.arena
    margin = 0.05 * float(np.max(truth.arena[1] - truth.arena[0]))
    ax.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color="0.2", lw=1.2)
    if stream is not None:
        for places, marker, name in (
            (stream.world.anchors, "^", "anchors"),
            (stream.world.landmarks, "s", "landmarks"),
        ):
            if len(places):
                ax.plot(*places.T, marker, color="0.2", mfc="white", ms=6, ls="none", label=name)
        ax.plot([], [], color=HEARD, label="packets arrive")
        ax.plot([], [], color=LOST, ls=":", label="packets are lost")
    ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    ax.set(xlim=(x0 - margin, x1 + margin), ylim=(y0 - margin, y1 + margin))
    sns.despine(ax=ax)


def _link(links: LineCollection, at: Array, heard: Any) -> None:
    """Lines between robots; a link counts as held where either of the two hears the other."""
    pairs = [(i, j) for i in range(len(at)) for j in range(i)]
    held = [bool(heard[i, j] or heard[j, i]) for i, j in pairs]
    links.set_segments([np.stack([at[i], at[j]]) for i, j in pairs])
    links.set_color([HEARD if yes else LOST for yes in held])
    links.set_linestyle(["solid" if yes else (0, (1, 2)) for yes in held])
