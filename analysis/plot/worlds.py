"""One trial of a scenario as a map; a recording as a sketch, its residuals, and a figure for each finding in it."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from cooploc.analysis.plot import style
from cooploc.analysis.plot.style import DARK, GREY, ROBOTS
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, World
from cooploc.estimators.models import wrap
from cooploc.scenarios import resolve
from cooploc.scenarios.recordings.inspect import motion
from cooploc.scenarios.recordings.inspect.findings import Finding
from cooploc.scenarios.recordings.inspect.inspection import SeriesRow, count_measurements, series_rows
from cooploc.scenarios.recordings.inspect.motion import dead_reckoned, known_truth
from cooploc.scenarios.recordings.inspect.rssi_checks import CHANNELS as RSSI_CHANNELS
from cooploc.scenarios.recordings.scenario import TeamScenario
from cooploc.scenarios.recordings.team_log import TeamLog, other_names
from cooploc.scenarios.worlds.radio import Scene

BLOCKED = style.VERMILION
LOST: Any = (0, (1, 2))  # line of lost packets


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

    `tick` is that of links and obstacles, a negative one counts from the end; `data` is the directory of recordings;
    `overrides` are parameters of the scenario.
    """
    shown = resolve(label, data, **overrides)
    truth, stream = shown.simulate([trial], seed)
    ax = ax or style.new_axes(5.2, 5.2)
    path, known = truth.x[0, :, :, :2], stream.world
    tick = int(np.arange(len(path))[tick])
    draw_arena(ax, known.arena, known)
    for i, place in enumerate(known.anchors):
        ax.annotate(f"N{i + 1}", place, xytext=(7, 6), textcoords="offset points", fontsize="x-small")
    scene: Scene | None = shown.model.scene(seed, trial, path) if hasattr(shown.model, "scene") else None
    links = LineCollection([], linewidths=1.0, zorder=1)
    ax.add_collection(links)
    set_links(links, path[tick], stream.air.link[0, tick], None if scene is None else scene.robot_blockers[tick])
    if scene is not None:
        _draw_scene(ax, scene, tick)
        for i, k in np.argwhere(np.isfinite(stream.senses.anchor_rssi[0, tick])):
            colour = BLOCKED if scene.anchor_blockers[tick, i, k] > 0 else GREY
            ax.plot(*np.stack([path[tick, i], known.anchors[k]]).T, color=colour, lw=0.5, zorder=1)
    for i, own in enumerate(path.transpose(1, 0, 2)):
        colour = ROBOTS[i % len(ROBOTS)]
        ax.plot(*own[: tick + 1].T, color=colour, lw=1.2, zorder=2)
        ax.plot(*own[np.isfinite(own[:, 0])][:1].T, "o", color=colour, mfc="white", ms=5, zorder=6)
        ax.plot(*own[tick], "o", color=colour, ms=7, label=f"robot {i}" if path.shape[1] <= 8 else None, zorder=6)
    if scene is not None and (scene.robot_blockers.any() or scene.anchor_blockers.any()):
        ax.plot([], [], color=BLOCKED, linestyle="solid", label="something in the way")
    style.finish(ax, "x [m]", "y [m]", f"{stream.scenario}, trial {trial}, seed {seed}, tick {tick}")
    style.add_legend(ax, fontsize="x-small", bbox_to_anchor=(0.0, -0.09), ncols=4)
    return ax


def draw_arena(ax: Axes, arena: Array, known: World | None = None) -> None:
    """Draw the arena (2, 2) with anchors and landmarks, set limits around it, and name lines of lost packets."""
    low, high = arena
    margin = 0.05 * float(np.max(high - low))
    ax.add_patch(Rectangle((low[0], low[1]), *(high - low), fill=False, ec=DARK, lw=1.2))
    for places, marker, name in ((known.anchors, "^", "anchors"), (known.landmarks, "s", "landmarks")) if known else ():
        if len(places):
            ax.plot(*places.T, marker, color=DARK, mfc="white", ms=7, ls="none", label=name, clip_on=False, zorder=5)
    if known:
        ax.plot([], [], color=GREY, ls=LOST, label="packets are lost")
    ax.set(aspect="equal", xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))


def set_links(lines: LineCollection, at: Array, heard: Array, blockers: Array | None = None) -> None:
    """Set lines between robots at places (n, 2): dotted where neither hears the other, vermilion where blocked."""
    i, j = np.tril_indices(len(at), -1)
    lines.set_segments(list(np.stack([at[i], at[j]], 1)))
    lines.set_linestyle(["solid" if one else LOST for one in np.logical_or(heard[i, j], heard[j, i])])
    blocked = np.zeros(len(i)) if blockers is None else blockers[i, j]
    lines.set_color([BLOCKED if one > 0 else GREY for one in blocked])


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
    axes = style.new_panels(2 * len(channels), 2, (3.6, 2.6), sharex=True, sharey="row")
    for k, channel in enumerate(channels):
        mine, pair = [one for one in found if one.what == channel], axes[2 * k : 2 * k + 2]
        links = list(dict.fromkeys(one.link for one in mine))
        for one in mine:
            ax, i = pair[0 if one.fitted else 1], links.index(one.link)
            colour, name = (ROBOTS[i], one.link) if i < len(ROBOTS) else (GREY, None)  # further links are grey
            ax.plot(one.distance, one.residual, ".", ms=2, alpha=0.5, color=colour, label=name)
            for level in (-2 * one.sigma, 2 * one.sigma):
                ax.axhline(level, color=DARK, lw=0.8, ls="--")
        for ax in pair:
            ax.axhline(0, color=DARK, lw=0.8)
        pair[0].set_ylabel(f"{channel}: residual [{mine[0].unit}]")
        pair[0].legend(frameon=False, fontsize=7, markerscale=3)
    for ax, title in zip(axes, ("fitted on", "judged"), strict=False):
        ax.set_title(title, fontsize=9)
    for ax in axes[-2:]:
        ax.set_xlabel("true distance [m]")
    return axes[0]


# ------------------------------------------------------------------------------------------------ a recording

MOST_ROWS = 24  # of the time line
MOST_TICKS = 2000  # of one series


def recording(log: TeamLog, note: str = "") -> Figure:
    """Draw a recording of a team.

    Left the tracks: solid the truth, dotted odometry alone from the true start. Right how often the robot of a row
    measured that of a column. Below what was recorded when, a stroke for each sample; gaps are white.
    """
    rows = series_rows(log)[:MOST_ROWS]
    figure = plt.figure(figsize=(9.2, 4.6 + 0.17 * len(rows)), layout="constrained")
    places: Any = [["tracks", "measured"], ["time", "time"]]
    axes = figure.subplot_mosaic(places, height_ratios=[4.4, 0.2 + 0.17 * len(rows)], width_ratios=[1.25, 1])
    _draw_tracks(axes["tracks"], log, note)
    _draw_reading_counts(axes["measured"], log)
    draw_time_line(axes["time"], rows, log)
    return figure


def _draw_tracks(ax: Axes, log: TeamLog, above: str) -> None:
    """Draw truth and dead reckoning of every robot, with anchors and landmarks."""
    for i, (robot, colour) in enumerate(style.robot_colours(log.robots).items()):
        truth, alone = known_truth(log, i), dead_reckoned(log, i)
        if truth is not None:
            ax.plot(*truth.values[:, :2].T, color=colour, lw=1.3, label=robot, zorder=3)
            ax.plot(*truth.values[0, :2], "o", color=colour, mfc="white", ms=6, zorder=5)
        if alone is not None:
            label = robot if truth is None else None
            ax.plot(*alone.T, color=colour, ls=style.DOTTED, lw=1.0, zorder=2, label=label)
    for places, marker, face in ((log.anchors, "^", DARK), (log.landmarks, "s", "white")):
        for name, (x, y) in zip(places.names, places.positions, strict=True):
            ax.plot(x, y, marker, color=DARK, mfc=face, ms=6, zorder=4)
            ax.annotate(name, (x, y), xytext=(5, 4), textcoords="offset points", fontsize="x-small")
    ax.plot([], [], color=GREY, ls=style.DOTTED, label="odometry alone")
    ax.plot([], [], "o", color=GREY, mfc="white", label="start")
    ax.set_aspect("equal", adjustable="datalim")
    style.finish(ax, "x [m]", "y [m]", above or log.name)
    ax.legend(frameon=False, fontsize="x-small", loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=4)


def _draw_reading_counts(ax: Axes, log: TeamLog) -> None:
    """Draw the number of readings of a row's robot of what a column names; darker is more."""
    import seaborn  # late, as it takes a second

    rows, columns, counts = count_measurements(log)
    used = [k for k in range(len(columns)) if k < len(rows) or counts[:, k].any()]
    shown = counts[:, used]
    own = np.equal.outer(np.arange(len(rows)), used)
    texts = np.where(own, "", shown.astype(int).astype(str)) if shown.size <= 60 else False
    lower = [("\n" if place % 2 and len(used) > 6 else "") + columns[k] for place, k in enumerate(used)]
    how: dict[str, Any] = {"fmt": "", "annot_kws": {"fontsize": "x-small"}, "cbar": False, "cmap": "Blues", "vmin": 0}
    labels = {"xticklabels": lower, "yticklabels": rows}
    shade = np.log1p(shown)
    how["vmax"] = max(shade.max(initial=0.0), 1.0)
    seaborn.heatmap(shade, mask=shown == 0, annot=texts, **how, **labels, ax=ax)
    ax.tick_params(labelsize="x-small", rotation=0)
    style.finish(ax, above="readings of (column) by (row)")


def draw_time_line(ax: Axes, rows: list[SeriesRow], log: TeamLog) -> None:
    """Draw a line for each series, a stroke for each sample."""
    colours = style.robot_colours(log.robots)
    for place, row in enumerate(rows):
        time = row.time[:: max(1, len(row.time) // MOST_TICKS)]
        width = max(float(np.median(np.diff(time))) if len(time) > 1 else 0.0, 1e-3)
        spans: Any = [(t, 1.05 * width) for t in time]
        ax.broken_barh(spans, (place - 0.35, 0.7), color=colours.get(row.of.partition("-")[0], GREY), lw=0)
    labels = [f"{row.series} {row.of}, {row.rate:.3g} Hz" for row in rows]
    ax.set_yticks(range(len(rows)), labels, fontsize="x-small")
    ax.invert_yaxis()
    style.finish(ax, "time since the first sample [s]", grid="x")


# ---- findings of an inspection: what the recording shows, beside what it shows once corrected

SIZE = 7.2, 2.6  # [inch]
BLUE = ROBOTS[0]


def finding(one: Finding, read: TeamLog, corrected: TeamLog) -> Figure | None:
    """Draw what a finding rests on; None for a line that could not be read, or for what is of no robot and no readings.

    Gaps and late robots: when each series of the robot was recorded. Ranges and bearings: their errors by pair.
    Signal strengths: all of them over distance. All else: the robot's path as read and as corrected, and its speed by
    odometry and by the truth, in which shifted clocks, wrong units, jumps and positions that repeat are seen; or its
    turn rate, where that is off.
    """
    if one.kind == "dropped" or (not one.robot and one.source not in {r.source for r in read.readings.values()}):
        return None
    figure = plt.figure(figsize=SIZE, layout="constrained")
    if one.kind in ("gap", "span"):
        rows = [row for row in series_rows(read) if row.of == one.robot]
        draw_time_line(figure.add_subplot(), rows, read)
    elif not one.robot and any(read.readings[c].source == one.source for c in RSSI_CHANNELS if c in read.readings):
        _draw_signals(figure.add_subplot(), one, read)
    elif not one.robot:
        _draw_reading_errors(figure.add_subplot(), one, corrected if one.kind == "bias" else read)
    else:
        path, speed = figure.subplots(1, 2, width_ratios=[1, 1.6])
        _draw_paths(path, read.robots.index(one.robot), read, corrected)
        if one.kind.startswith("turn ") or " it turns " in one.fact:
            _draw_turns(speed, read.robots.index(one.robot), read)
        else:
            _draw_speeds(speed, read.robots.index(one.robot), read, one.kind)
    return figure


def _draw_paths(ax: Axes, robot: int, read: TeamLog, corrected: TeamLog) -> None:
    """Draw the true path of a robot as read and as corrected, and odometry alone; what is in another unit is scaled."""
    before, after = (motion.known_truth(log, robot) for log in (read, corrected))
    if before is not None:
        wide, wanted = (float(np.ptp(one.values[:, :2], axis=0).max()) for one in (before, after or before))
        scaled = wide > 5 * wanted > 0 or wanted > 5 * wide > 0
        places = before.values[:, :2] * (wanted / wide if scaled else 1.0)
        ax.plot(*places.T, color=GREY, lw=1.3, label="truth, as read" + ", scaled" * scaled)
    if after is not None:
        ax.plot(*after.values[:, :2].T, color=BLUE, lw=1.3, label="truth, corrected")
    if (alone := motion.dead_reckoned(corrected, robot)) is not None:
        ax.plot(*alone.T, color=DARK, ls=style.DOTTED, lw=1.0, label="odometry alone")
    ax.set_aspect("equal", adjustable="datalim")
    style.finish(ax, "x [m]", "y [m]")
    ax.legend(frameon=False, fontsize="x-small", loc="upper center", bbox_to_anchor=(0.5, -0.28))


def _draw_speeds(ax: Axes, robot: int, log: TeamLog, kind: str) -> None:
    """Draw how fast a robot is by odometry and by the truth, as read.

    Where clocks are in question each is in parts of its own 95th percentile; where units are, the axis is logarithmic.
    """
    found, highest = motion.robot_motion(log, robot), 0.0
    zero = min((m.time[0] for m in (found.odometry, found.truth) if len(m.time)), default=0.0)
    for of, colour, label in ((found.odometry, DARK, "odometry"), (found.truth, BLUE, "truth")):
        speed = np.abs(found.steps(of).length) / found.window
        usual = motion.quantile(speed, 0.95)
        if not usual > 0:
            continue
        if kind in ("clock", "stale", "robots"):
            speed, usual = speed / usual, 1.0
        ax.plot(of.time[0] - zero + found.window * np.arange(len(speed)), speed, color=colour, lw=0.9, label=label)
        highest = max(highest, usual)
    if kind == "unit":
        ax.set_yscale("log")
    else:
        ax.set_ylim(0, (5 if kind == "jump" else 1.6) * highest or 1)
    unit = "speed, of its usual one" if kind in ("clock", "stale", "robots") else "speed, as read [m/s]"
    style.finish(ax, "time since the first sample [s]", unit)
    if highest:
        ax.legend(frameon=False, fontsize="x-small", ncols=2, loc="upper right")


def _draw_turns(ax: Axes, robot: int, log: TeamLog) -> None:
    """Draw how fast a robot turns by odometry and by the truth, as read, in windows of at least a second."""
    found = motion.robot_motion(log, robot)
    longer, start = found._replace(window=max(found.window, 1.0)), max(found.odometry.time[0], found.truth.time[0])
    measured, true = longer.common_steps()
    since = start - min(found.odometry.time[0], found.truth.time[0]) + longer.window * np.arange(len(measured.turn))
    for turned, colour, label in (
        (measured.turn, DARK, "odometry"),
        (motion.true_turns(true), BLUE, "truth"),
    ):
        ax.plot(since, turned / longer.window, color=colour, lw=0.9, label=label)
    style.finish(ax, "time since the first sample [s]", "turn rate [rad/s]")
    ax.legend(frameon=False, fontsize="x-small", ncols=2, loc="lower right", bbox_to_anchor=(1, 1))


def _draw_signals(ax: Axes, one: Finding, log: TeamLog) -> None:
    """Draw signal strengths over distance, by the robot that received them."""
    colours, near, far = [*style.robot_colours(log.robots).items()], np.inf, 0.0
    for channel in (c for c in RSSI_CHANNELS if c in log.readings and log.readings[c].source == one.source):
        readings, distance = log.readings[channel], motion.distances(log, channel)
        near, far = float(np.nanmin(distance, initial=near)), float(np.nanmax(distance, initial=far))
        for i, (robot, colour) in enumerate(colours):
            own = readings.robot == i
            ax.plot(distance[own], readings.values[own, 0], ".", ms=2, alpha=0.5, color=colour, label=robot)
    style.set_log_scale(ax.xaxis, near, far)
    style.finish(ax, "distance [m]", "signal strength [dBm]")
    names = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    ax.legend(names.values(), names.keys(), frameon=False, fontsize="x-small", markerscale=4, title="received by")


def _draw_reading_errors(ax: Axes, one: Finding, log: TeamLog) -> None:
    """Draw reading minus truth of every pair, median and middle half, with the middle nine tenths as a line."""
    labels, rows = [], []
    column = 1 if one.kind in ("degrees", "bearing") else 0
    for channel, readings in motion.range_channels(log):
        if readings.source != one.source:
            continue
        expected = motion.bearings(log, channel) if column else motion.distances(log, channel)
        error = readings.values[:, column] - expected
        error = wrap(error) if column else error
        for i, k, chosen in motion.pairs(readings, channel):
            known = error[chosen][np.isfinite(error[chosen])]
            if len(known):
                labels.append(f"{log.robots[i]}-{other_names(log, channel)[k]}")
                rows.append(np.quantile(known, [0.05, 0.25, 0.5, 0.75, 0.95]))
    for place, (low, first, middle, third, high) in enumerate(rows):
        ax.plot([low, high], [place, place], color=GREY, lw=1)
        ax.plot([first, third], [place, place], color=BLUE, lw=4)
        ax.plot(middle, place, "o", color=DARK, ms=4)
    ax.axvline(0, color=DARK, lw=0.8)
    ax.set_yticks(range(len(rows)), labels, fontsize="x-small")
    ax.invert_yaxis()
    style.finish(ax, "bearing minus true direction [rad]" if column else "range minus distance [m]", grid="x")
