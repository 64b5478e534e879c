"""A sketch of a recording: tracks, counts of readings between robots, and what was recorded when."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cooploc.analysis.plot import style
from cooploc.analysis.plot.style import DARK, GREY, ROBOTS
from cooploc.scenarios.recordings.inspect.inspection import SeriesRow, count_measurements, series_rows
from cooploc.scenarios.recordings.inspect.motion import dead_reckoned, known_truth
from cooploc.scenarios.recordings.team_log import TeamLog

MOST_ROWS = 24  # of the time line; pairs beyond it are drawn by robot
MOST_TICKS = 2000  # of one series


def recording(log: TeamLog, note: str = "") -> Figure:
    """Draw a recording of a team.

    Left the tracks: solid the truth, dotted odometry alone from the true start. Right how often the robot of a row
    measured that of a column. Below what was recorded when, a stroke for each sample; gaps are white.
    """
    rows = series_rows(log)
    if len(rows) > MOST_ROWS:
        groups: dict[tuple[str, str], list[SeriesRow]] = {}
        for row in rows:
            groups.setdefault((row.series, row.of.partition("-")[0]), []).append(row)
        times = [np.sort(np.concatenate([row.time for row in group])) for group in groups.values()]
        gaps = [np.diff(np.unique(time)) for time in times]
        rates = [1 / float(np.median(gap)) if len(gap) else np.nan for gap in gaps]
        named = zip(groups, times, rates, groups.values(), strict=True)
        rows = [group[0]._replace(of=key[1], time=time, rate=rate) for key, time, rate, group in named]
    figure = plt.figure(figsize=(9.2, 4.6 + 0.17 * len(rows)), layout="constrained")
    places: Any = [["tracks", "measured"], ["time", "time"]]
    axes = figure.subplot_mosaic(places, height_ratios=[4.4, 0.2 + 0.17 * len(rows)], width_ratios=[1.25, 1])
    _draw_tracks(axes["tracks"], log, note)
    _draw_reading_counts(axes["measured"], log)
    _draw_time_line(axes["time"], rows, log)
    return figure


def _draw_tracks(ax: Axes, log: TeamLog, above: str) -> None:
    """Draw truth and dead reckoning of every robot, with anchors and landmarks."""
    for i, robot in enumerate(log.robots):
        colour = ROBOTS[i % len(ROBOTS)]
        truth, alone = known_truth(log, i), dead_reckoned(log, i)
        if truth is not None:
            ax.plot(*truth.values[:, :2].T, color=colour, lw=1.3, label=robot, zorder=3)
            ax.plot(*truth.values[0, :2], "o", color=colour, mfc="white", ms=6, zorder=5)
        if alone is not None:
            ax.plot(*alone.T, color=colour, ls=style.DOTTED, lw=1.0, zorder=2)
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
    rows, columns, counts = count_measurements(log)
    used = [k for k in range(len(columns)) if k < len(rows) or counts[:, k].any()]
    shown = counts[:, used]
    ax.imshow(np.where(shown > 0, np.log1p(shown), np.nan), cmap="Blues", vmin=0, aspect="auto")
    if len(used) * len(rows) <= 60:
        for i, k in np.ndindex(*shown.shape):
            text = "" if used[k] == i else f"{int(shown[i, k])}"
            dark = np.log1p(shown[i, k]) > 0.6 * np.log1p(max(shown.max(), 1))
            ax.text(k, i, text, ha="center", va="center", fontsize="x-small", color="white" if dark else DARK)
    ax.set_xticks(range(len(used)), [columns[k] for k in used], rotation=90 if len(used) > 6 else 0, fontsize="x-small")
    ax.set_yticks(range(len(rows)), rows, fontsize="x-small")
    style.finish(ax, above="readings of (column) by (row)")


def _draw_time_line(ax: Axes, rows: list[SeriesRow], log: TeamLog) -> None:
    """Draw a line for each series, a stroke for each sample."""
    colours = {robot: ROBOTS[i % len(ROBOTS)] for i, robot in enumerate(log.robots)}
    for place, row in enumerate(rows):
        time = row.time[:: max(1, len(row.time) // MOST_TICKS)]
        width = max(float(np.median(np.diff(time))) if len(time) > 1 else 0.0, 1e-3)
        spans: Any = [(t, 1.05 * width) for t in time]
        ax.broken_barh(spans, (place - 0.35, 0.7), color=colours.get(row.of.partition("-")[0], GREY), lw=0)
    labels = [f"{row.series} {row.of}, {row.rate:.3g} Hz" for row in rows]
    ax.set_yticks(range(len(rows)), labels, fontsize="x-small")
    ax.invert_yaxis()
    style.finish(ax, "time since the first sample [s]", grid="x")
