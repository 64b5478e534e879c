"""A figure for each finding of an inspection: what the recording shows, beside what it shows once corrected."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cooploc.analysis.plot import style
from cooploc.analysis.plot.style import DARK, GREY, ROBOTS
from cooploc.analysis.plot.worlds import draw_time_line
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings.inspect import motion
from cooploc.scenarios.recordings.inspect.checks import Finding
from cooploc.scenarios.recordings.inspect.inspection import series_rows
from cooploc.scenarios.recordings.team_log import TeamLog, other_names

SIZE = 7.2, 2.6  # [inch]
BLUE = ROBOTS[0]


def finding(one: Finding, read: TeamLog, corrected: TeamLog) -> Figure | None:
    """Draw what a finding rests on; None for a line that could not be read, of which there is nothing to draw.

    Gaps and late robots: when each series of the robot was recorded. Ranges and bearings: their errors by pair. All
    else: the robot's path as read and as corrected, and its speed by odometry and by the truth, in which shifted
    clocks, wrong units, jumps and positions that repeat are seen.
    """
    if one.kind == "dropped":
        return None
    figure = plt.figure(figsize=SIZE, layout="constrained")
    if one.kind in ("gap", "span"):
        rows = [row for row in series_rows(read) if row.of == one.robot]
        draw_time_line(figure.add_subplot(), rows, read)
    elif not one.robot:
        _draw_reading_errors(figure.add_subplot(), one, corrected if one.kind == "bias" else read)
    else:
        path, speed = figure.subplots(1, 2, width_ratios=[1, 1.6])
        _draw_paths(path, read.robots.index(one.robot), read, corrected)
        _draw_speeds(speed, read.robots.index(one.robot), read, one.kind)
    return figure


def _draw_paths(ax: Axes, robot: int, read: TeamLog, corrected: TeamLog) -> None:
    """Draw the true path of a robot as read and as corrected, and odometry alone; what is in another unit is scaled."""
    before, after = (motion.known_truth(log, robot) for log in (read, corrected))
    if before is not None and after is not None:
        wide, wanted = (float(np.ptp(one.values[:, :2], axis=0).max()) for one in (before, after))
        scaled = wide > 5 * wanted > 0 or wanted > 5 * wide > 0
        places = before.values[:, :2] * (wanted / wide if scaled else 1.0)
        ax.plot(*places.T, color=GREY, lw=1.3, label="truth, as read" + ", scaled" * scaled)
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
    ax.legend(frameon=False, fontsize="x-small", ncols=2, loc="upper right")


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
