"""One trial of a scenario as a map, and the residuals of a recording's readings."""

from pathlib import Path
from typing import Any, cast

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle, Rectangle

from cooploc.analysis.plot import style
from cooploc.analysis.plot.style import DARK, GREY, ROBOTS
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios import resolve
from cooploc.scenarios.recordings.scenario import TeamScenario
from cooploc.scenarios.stream import Stream
from cooploc.scenarios.worlds.radio import Scene

BLOCKED = style.VERMILION


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

    """
    shown = resolve(label, data, **overrides)
    truth, stream = shown.simulate([trial], seed)
    ax = ax or style.new_axes(5.2, 5.2)
    path = truth.x[0, :, :, :2]
    tick = int(np.arange(len(path))[tick])
    _draw_arena(ax, stream)
    scene: Scene | None = shown.model.scene(seed, trial, path) if hasattr(shown.model, "scene") else None
    _draw_links(ax, path[tick], stream, scene, tick)
    if scene is not None:
        _draw_scene(ax, scene, tick)
    for i in range(path.shape[1]):
        colour = ROBOTS[i % len(ROBOTS)]
        ax.plot(*path[: tick + 1, i].T, color=colour, lw=1.2, zorder=2)
        known = np.flatnonzero(np.isfinite(path[:, i, 0]))
        if len(known):
            ax.plot(*path[known[0], i], "o", color=colour, mfc="white", ms=5, zorder=6)
        name = f"robot {i}" if path.shape[1] <= 8 else None
        ax.plot(*path[tick, i], "o", color=colour, ms=7, label=name, zorder=6)
    ax.plot([], [], color=GREY, linestyle=(0, (1, 2)), label="lost")
    ax.plot([], [], color=BLOCKED, linestyle="solid", label="something in the way")
    style.finish(ax, "x [m]", "y [m]", f"{stream.scenario}, trial {trial}, seed {seed}, tick {tick}")
    style.add_legend(ax, fontsize="x-small", bbox_to_anchor=(0.0, -0.09), ncols=4)
    return ax


def _draw_arena(ax: Axes, stream: Stream) -> None:
    known = stream.world
    low, high = known.arena
    ax.add_patch(Rectangle((low[0], low[1]), *(high - low), fill=False, ec=DARK, lw=1.2))
    if len(known.anchors):
        ax.plot(*known.anchors.T, "^", color=DARK, ms=9, label="anchors", clip_on=False, zorder=5)
    for i, (x, y) in enumerate(known.anchors):
        ax.annotate(f"N{i + 1}", (x, y), xytext=(7, 6), textcoords="offset points", fontsize="x-small")
    if len(known.landmarks):
        ax.plot(*known.landmarks.T, "s", color=DARK, ms=5, mfc="white", label="landmarks", zorder=4)
    margin = 0.05 * float(np.max(high - low))
    ax.set(aspect="equal", xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))


def _draw_links(ax: Axes, at: Array, stream: Stream, scene: Scene | None, tick: int) -> None:
    """Draw the links between robots, and to anchors where the scene has something that may stand in the way."""
    heard, anchors = stream.air.link[0, tick], stream.world.anchors
    pairs = [(i, j) for i in range(len(at)) for j in range(i)]
    lines = [np.stack([at[i], at[j]]) for i, j in pairs]
    lost = [not (heard[i, j] or heard[j, i]) for i, j in pairs]
    blocked = [scene is not None and bool(scene.robot_blockers[tick, i, j] > 0) for i, j in pairs]
    _add_lines(ax, lines, lost, blocked, 1.0)
    if scene is not None:
        there = np.argwhere(np.isfinite(stream.senses.anchor_rssi[0, tick])).tolist()
        lines = [np.stack([at[i], anchors[k]]) for i, k in there]
        blocked = [bool(scene.anchor_blockers[tick, i, k] > 0) for i, k in there]
        _add_lines(ax, lines, [False] * len(lines), blocked, 0.5)


def _add_lines(ax: Axes, lines: list[Array], lost: list[bool], blocked: list[bool], width: float) -> None:
    styles: Any = [(0, (1, 2)) if one else "solid" for one in lost]
    colours = [BLOCKED if one else GREY for one in blocked]
    ax.add_collection(LineCollection(lines, colors=colours, linestyles=styles, linewidths=width, zorder=1))


def _draw_scene(ax: Axes, scene: Scene, tick: int) -> None:
    """Draw walls and obstacles."""
    for k, wall in enumerate(scene.walls):
        ax.plot(*wall.T, color=DARK, lw=4, solid_capstyle="butt", label="walls" if k == 0 else None, zorder=3)
    for k in range(scene.obstacles.shape[1]):
        ax.plot(*scene.obstacles[: tick + 1, k].T, color=GREY, lw=0.6)
        name = "obstacles" if k == 0 else None
        ax.add_patch(Circle(tuple(scene.obstacles[tick, k]), scene.radius, fc=GREY, ec=DARK, label=name, zorder=3))


# ------------------------------------------------------------------------------------------------ residuals


def residuals(label: str, data: str | Path) -> Axes:
    """Draw reading less model over true distance, a row for each channel: where it was fitted, and where it is judged.

    `label` is a run of a team, "log/RUN", or "log/all" for the first. Dashed: two standard deviations as filters assume
    them. Choose nothing by the right column: its truth is judged.
    """
    model = resolve(label, data).model
    if not isinstance(model, TeamScenario):
        raise BadInput(f"{label!r} is not a recording of a team; name one whose log.toml begins with format")
    found = [one for one in model.at([0]).link_residuals() if len(one.residual)]
    channels = list(dict.fromkeys(one.what for one in found))
    if not channels:
        raise BadInput(f"{label!r} has no reading whose true distance is known; check the names in log.toml")
    size, sharing = (7.2, 2.6 * len(channels)), {"sharex": True, "sharey": "row", "squeeze": False}
    _, axes = plt.subplots(len(channels), 2, figsize=size, layout="constrained", **cast(Any, sharing))
    for row, channel in zip(axes, channels, strict=True):
        mine = [one for one in found if one.what == channel]
        links = list(dict.fromkeys(one.link for one in mine))
        for one in mine:
            ax, k = row[0 if one.fitted else 1], links.index(one.link)
            colour, name = (ROBOTS[k], one.link) if k < len(ROBOTS) else (GREY, None)  # further links are grey
            ax.plot(one.distance, one.residual, ".", ms=2, alpha=0.5, color=colour, label=name)
            for sign in (-2, 2):
                ax.axhline(sign * one.sigma, color=DARK, lw=0.8, ls="--")
        for ax in row:
            ax.axhline(0, color=DARK, lw=0.8)
        row[0].set_ylabel(f"{channel}: residual [{mine[0].unit}]")
        row[0].legend(frameon=False, fontsize=7, markerscale=3)
    for ax, title in zip(axes[0], ("fitted on", "judged"), strict=True):
        ax.set_title(title, fontsize=9)
    for ax in axes[-1]:
        ax.set_xlabel("true distance [m]")
    return cast(Axes, axes[0, 0])
