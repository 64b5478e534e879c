"""Where robots are: one trial of a scenario, and what the readings of a recording are off by."""

from pathlib import Path
from typing import Any, Protocol, cast, runtime_checkable

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle, Rectangle

from cooploc.analysis.plot import style
from cooploc.analysis.plot.style import DARK, GREY
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios import resolve
from cooploc.scenarios.recordings.fit import Leftover
from cooploc.scenarios.recordings.scenario import TeamScenario
from cooploc.scenarios.scenario import ResolvedScenario
from cooploc.scenarios.stream import Stream
from cooploc.scenarios.worlds.radio import Scene

BLOCKED = style.VERMILION


@runtime_checkable
class HasScene(Protocol):
    """A scenario with walls and obstacles to draw."""

    def scene(self, seed: int, trial: int, path: Array) -> Scene:
        """What stands in the way at every tick of one trial, for robots on `path` (T, n, 2) [m]."""
        ...


def world(
    label: str,
    trial: int = 0,
    seed: int = 1,
    tick: int = -1,
    data: str | Path | None = None,
    ax: Axes | None = None,
    **overrides: Any,
) -> Axes:
    """Draw one trial; links and obstacles as they stand in one tick.

    A solid line between robots is a packet that gets through, a dotted one is lost; vermilion has something in the way.

    Args:
        label: the scenario's label.
        trial: its number.
        seed: of the simulation.
        tick: of the links and obstacles; negative ones count from the end.
        data: directory of recordings, for a scenario that is one.
        ax: where to draw; a new figure if None.
        **overrides: parameters of the scenario.

    Raises:
        BadInput: an unknown scenario or parameter, or a value that does not fit.

    """
    shown = resolve(label, data, **overrides)
    truth, stream = shown.simulate([trial], seed)
    ax = ax or style.new_axes(5.2, 5.2)
    path = truth.x[0, :, :, :2]
    tick = int(np.arange(len(path))[tick])
    _arena(ax, stream)
    _surroundings(ax, shown, seed, trial, path, tick, stream)
    _trajectories(ax, path, tick)
    for name, colour, line in (("lost", GREY, (0, (1, 2))), ("something in the way", BLOCKED, "solid")):
        ax.plot([], [], color=colour, linestyle=line, label=name)
    style.finish(ax, "x [m]", "y [m]", f"{stream.scenario}, trial {trial}, seed {seed}, tick {tick}")
    style.legend(ax, fontsize="x-small", bbox_to_anchor=(0.0, -0.09), ncols=4)
    return ax


def _arena(ax: Axes, stream: Stream) -> None:
    known = stream.world
    low, high = known.arena
    ax.add_patch(Rectangle((low[0], low[1]), *(high - low), fill=False, ec=DARK, lw=1.2))
    if len(known.anchors):
        ax.plot(*known.anchors.T, "^", color=DARK, ms=9, label="anchors", clip_on=False, zorder=5)
    for i, (x, y) in enumerate(known.anchors):
        ax.annotate(f"N{i + 1}", (x, y), xytext=(7, 6), textcoords="offset points", fontsize="x-small")
    if len(known.landmarks):
        ax.plot(*known.landmarks.T, "s", color=DARK, ms=5, mfc="white", label="landmarks", zorder=4)
    ax.set_aspect("equal")
    margin = 0.05 * float(np.max(high - low))
    ax.set_xlim(low[0] - margin, high[0] + margin)
    ax.set_ylim(low[1] - margin, high[1] + margin)


def _surroundings(
    ax: Axes, shown: ResolvedScenario, seed: int, trial: int, path: Array, tick: int, stream: Stream
) -> None:
    """Walls, obstacles and links; a recording has only links."""
    n = path.shape[1]
    scene = shown.model.scene(seed, trial, path) if isinstance(shown.model, HasScene) else None
    in_the_way = scene.robot_blockers[tick] > 0 if scene else np.zeros((n, n), bool)
    heard = stream.air.link[0, tick]
    pairs = [(i, j) for i in range(n) for j in range(i)]
    _lines(ax, [(path[tick, i], path[tick, j], heard[i, j] or heard[j, i], in_the_way[i, j]) for i, j in pairs])
    if scene is None:
        return
    anchors = [
        (path[tick, i], q, True, scene.anchor_blockers[tick, i, k] > 0)
        for i in range(n)
        for k, q in enumerate(stream.world.anchors)
        if np.isfinite(stream.senses.anchor_rssi[0, tick, i, k])
    ]
    _lines(ax, anchors, width=0.5)
    for k, wall in enumerate(scene.walls):
        ax.plot(*wall.T, color=DARK, lw=4, solid_capstyle="butt", label="walls" if k == 0 else None, zorder=3)
    for k in range(scene.obstacles.shape[1]):
        ax.plot(*scene.obstacles[: tick + 1, k].T, color=GREY, lw=0.6)
        name = "obstacles" if k == 0 else None
        ax.add_patch(Circle(tuple(scene.obstacles[tick, k]), scene.radius, fc=GREY, ec=DARK, label=name, zorder=3))


def _lines(ax: Axes, links: list[tuple[Array, Array, bool, bool]], width: float = 1.0) -> None:
    """Links (from, to, gets through, has something in the way)."""
    ends = [(a, b) for a, b, _, _ in links]
    styles: Any = ["solid" if through else (0, (1, 2)) for _, _, through, _ in links]
    colours = [BLOCKED if blocked else GREY for _, _, _, blocked in links]
    ax.add_collection(LineCollection(ends, colors=colours, linestyles=styles, linewidths=width, zorder=1))


def _trajectories(ax: Axes, path: Array, tick: int) -> None:
    colours = [style.ROBOTS[i % len(style.ROBOTS)] for i in range(path.shape[1])]
    for i, colour in enumerate(colours):
        ax.plot(*path[: tick + 1, i].T, color=colour, lw=1.2, zorder=2)
        known = np.flatnonzero(np.isfinite(path[:, i, 0]))
        if len(known):
            ax.plot(*path[known[0], i], "o", color=colour, mfc="white", ms=5, zorder=6)
        name = f"robot {i}" if len(colours) <= 8 else None
        ax.plot(*path[tick, i], "o", color=colour, ms=7, label=name, zorder=6)


# ------------------------------------------------------------------------------------------------ residuals

MOST_LINKS = len(style.ROBOTS)  # with a colour and a line of the legend of their own; further ones are grey
WIDTH, HEIGHT = 7.2, 2.6  # of the figure and of a panel [in]


def residuals(label: str, data: str | Path) -> Axes:
    """Reading less model over true distance, a row for each channel: where it was fitted, and where it is judged.

    Dashed: two standard deviations as filters are told. The right column looks at truth that is judged: choose nothing
    by it.

    Args:
        label: a run of a team, "log/RUN", or "log/all" for the first.
        data: its directory.

    Returns:
        The axes of the first panel; the others follow.

    Raises:
        BadInput: it is not a recording of a team, or has no readings with a true distance.

    """
    model = resolve(label, data).model
    if not isinstance(model, TeamScenario):
        raise BadInput(f"{label!r} is not a recording of a team; name one whose log.toml begins with format")
    found = [one for one in model.at([0]).leftovers() if len(one.residual)]
    whats = list(dict.fromkeys(one.what for one in found))
    if not whats:
        raise BadInput(f"{label!r} has no reading whose true distance is known; check the names in log.toml")
    size = WIDTH, HEIGHT * len(whats)
    _, axes = plt.subplots(len(whats), 2, figsize=size, sharex=True, sharey="row", squeeze=False, layout="constrained")
    for row, what in zip(axes, whats, strict=True):
        mine = [one for one in found if one.what == what]
        links = list(dict.fromkeys(one.link for one in mine))
        for ax, fitted in zip(row, (True, False), strict=True):
            _draw_residuals(ax, [one for one in mine if one.fitted == fitted], links)
        row[0].set_ylabel(f"{what}: residual [{mine[0].unit}]")
        row[0].legend(frameon=False, fontsize=7, markerscale=3)
    for ax, title in zip(axes[0], ("fitted on", "judged"), strict=True):
        ax.set_title(title, fontsize=9)
    for ax in axes[-1]:
        ax.set_xlabel("true distance [m]")
    return cast(Axes, axes[0, 0])


def _draw_residuals(ax: Axes, found: list[Leftover], links: list[str]) -> None:
    for one in found:
        k = links.index(one.link)
        named = k < MOST_LINKS
        colour = style.ROBOTS[k] if named else style.GREY
        ax.plot(one.distance, one.residual, ".", ms=2, alpha=0.5, color=colour, label=one.link if named else None)
        for sign in (-2, 2):
            ax.axhline(sign * one.sigma, color=style.DARK, lw=0.8, ls="--")
    ax.axhline(0, color=style.DARK, lw=0.8)
