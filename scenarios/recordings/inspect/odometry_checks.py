"""Checks of odometry against the truth: it stands, leaps, drops out, goes aside or turns by a constant too much."""

import numpy as np

from cooploc.scenarios.recordings.inspect import motion
from cooploc.scenarios.recordings.inspect.findings import EVIDENCE, FOLLOWS, CheckedLog
from cooploc.scenarios.recordings.inspect.truth_checks import FAST, FASTEST, JUMP


def check_standstill(c: CheckedLog, i: int) -> None:
    """Find odometry that never drives, or never turns, of a robot that does."""
    m = motion.robot_motion(c.log, i)
    heading = np.nancumsum(motion.true_turns(m.steps(m.truth)))
    turns = bool(len(heading)) and np.ptp(heading) > np.pi
    for column, word, does in (
        (m.odometry.length, "drives", motion.moves(c.log, i)),
        (m.odometry.turn, "turns", turns),
    ):
        if does and len(column) and np.ptp(column) == 0:
            setting = "another file or topic has it: name it in [odometry], or turn rates in [turns]"
            c.add(
                "standstill", i, c.log.odometry[i].source, f"odometry never {word}, and the robot does", "sure", setting
            )


def check_odometry_jumps(c: CheckedLog, i: int) -> None:
    """Find speeds that no robot drives, and poses that leap as where a counter begins again."""
    odometry, kind = c.log.odometry[i], c.log.odometry_kind
    first, time = odometry.values[:, :2], odometry.time - odometry.time[:1]
    apart = np.hypot(*np.diff(first, axis=0).T)
    speeds = np.abs(first[:, 0]) if kind == "velocity" else apart / np.maximum(np.diff(time), 1e-3)
    usual = motion.quantile(speeds, 0.9)
    if kind == "velocity" and len(fast := np.flatnonzero(speeds > max(FASTEST, 100 * usual))):
        fact = f"{len(fast)} speeds of more than {FASTEST:g} m/s, up to {speeds.max():.3g}"
        fact += f"; the first {time[fast[0]]:.1f} s after the start"
        c.add("jump", i, odometry.source, fact, "sure", "nothing: remove these lines", "odometry", ("speed",))
    if kind == "pose" and len(again := np.flatnonzero((apart > JUMP) & (speeds > FAST * max(usual, 0.05)))):
        fact = f"odometry leaps by up to {apart[again].max():.2g} m; the first time"
        fact += f" {time[again[0]]:.1f} s after the start: did it begin again?"
        c.add("jump", i, odometry.source, fact, "sure", "nothing: make a run of each part", "odometry", ("x", "y"))


LEAST = 5.0  # [s] of a dropout
RARE = 1.0  # [s] between lines of odometry
OFTEN, NOTICED = 5.0, 0.1  # times the usual misfit, and m/s or rad/s, that it has at least


def check_dropouts(c: CheckedLog, i: int) -> None:
    """Find stretches where odometry is off by far more than usual: held or zero, perhaps."""
    if c.log.odometry_kind == "displacement" or not motion.moves(c.log, i):
        return
    m = motion.robot_motion(c.log, i)
    interval, start = float(np.median(np.diff(m.odometry.time))), max(m.odometry.time[0], m.truth.time[0])
    longer = m._replace(window=interval if interval > RARE else max(m.window, 1.0))
    steps, true = longer.common_steps()
    for word, unit, measured, truth in (
        ("drives", "m/s", np.abs(steps.length), np.abs(true.length)),
        ("turns", "rad/s", steps.turn, motion.true_turns(true)),
    ):
        off = np.abs(measured - truth * motion.robust_slope(truth, measured)[0]) / longer.window
        usual, edges = motion.quantile(off, 0.5, motion.FEWEST_WINDOWS), start + longer.window * np.arange(len(off) + 1)
        found = motion.lasting(edges, off > max(OFTEN * usual, NOTICED), LEAST) - start
        if interval > RARE and usual > NOTICED / 2:
            fact = (
                f"odometry comes every {interval:.3g} s, and {word} {usual:.2g} {unit} otherwise than the truth between"
            )
            setting = "nothing: what it was between its lines is not known"
            c.add("coarse", i, c.log.odometry[i].source, f"{fact} its lines (median)", "likely", setting, "odometry")
            return
        if np.isfinite(usual) and len(found):
            begin, end = found[np.argmax(np.diff(found, axis=1)[:, 0])]
            worst = off[int(begin / longer.window) : int(np.rint(end / longer.window))].mean()
            fact = f"for {end - begin:.3g} s from {begin:.3g} s after the start it {word} {worst:.2g} {unit} otherwise"
            fact += f" than the truth (usually within {usual:.1g}){f'; so {len(found)} times' * (len(found) > 1)}"
            setting = "nothing: leave that out by start and duration in [sample], or make a run of each part"
            c.add("dropout", i, c.log.odometry[i].source, fact, "likely", setting, "odometry")
            return


SMOOTH = 2.0  # [s] in which noise of positions is small beside the way


def check_sideways(c: CheckedLog, i: int) -> None:
    """Find robots that go elsewhere than their own heading, forwards or backwards, by odometry or by the truth."""
    kind, m = c.log.odometry_kind, motion.robot_motion(c.log, i)
    poses = c.log.odometry[i] if kind == "pose" else m.poses
    if kind == "displacement" or not motion.moves(c.log, i) or len(poses.time) < 2:
        return
    edges = np.arange(poses.time[0], poses.time[-1], max(m.window, SMOOTH))
    columns = (*poses.values[:, :2].T, np.unwrap(poses.values[:, 2]))
    x, y, heading = (np.interp(edges, poses.time, column) for column in columns)
    course = motion.course(np.column_stack([np.diff(x), np.diff(y)]))
    follows, _ = motion.concentration(2 * (course - (heading[1:] + heading[:-1]) / 2))
    if 0 < follows < FOLLOWS / 2 and kind == "pose":
        fact = f"odometry goes elsewhere than its own heading (agreement {follows:.2f})"
        fact += ": steps are perhaps along the axes"
        setting = 'of steps kind = "displacement", without turn; else write poses with the heading of the motion'
        c.add("frame", i, poses.source, fact, "likely", setting, "odometry")
    elif 0 < follows < FOLLOWS / 2:
        fact = f"the robot goes elsewhere than its heading (agreement {follows:.2f}), perhaps to the side, of which"
        setting = 'kind = "displacement", with steps dx, dy along fixed axes, in place of speeds'
        c.add("sideways", i, c.log.odometry[i].source, f"{fact} speeds say nothing", "likely", setting, "odometry")


def check_turn_bias(c: CheckedLog, i: int) -> None:
    """Find turn rates that are off by a constant, as those of a gyroscope: the truth turns as fast but for that."""
    if c.log.odometry_kind not in ("velocity", "path") or not motion.moves(c.log, i):
        return
    odometry, (bias, error, span) = c.log.odometry[i], motion.turn_bias(motion.robot_motion(c.log, i))
    if abs(bias) > EVIDENCE * error and abs(bias) * span > motion.LEADS_ASTRAY:
        fact = f"odometry turns {bias:+.2g} rad/s where the truth does not: {bias * span:+.2g} rad in {span:.3g} s"
        setting = f"turn_bias = {{ {c.log.robots[i]} = {bias:.3g} }}"
        c.add("turn bias", i, odometry.source, fact, "likely", setting, "odometry")
        c.correct("odometry", i, odometry._replace(values=odometry.values - [0.0, bias]))
