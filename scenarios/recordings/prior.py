"""The prior of a recording: the position and heading of each robot at its start, and their source."""

from collections.abc import Sequence

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Belief
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings.schema import Prior

UNIFORM = np.pi / np.sqrt(3)  # [rad] standard deviation of a uniform heading
REST, REACH = 0.02, 0.1  # [m] the first motion: from the last position within REST of the start to the first past REACH


def start_belief(
    robots: Sequence[str], run: str, declared: Prior, arena: Array, poses: Array, turns: Array | None
) -> tuple[Belief, str]:
    """Return the belief before the first tick, x (1, n, d) and P (1, n, d, d), and a sentence of where it comes from.

    Row 0 of the true poses (T + 1, n, 3) is at the prior's time; turns (T, n) [rad] are by odometry, or None: robots
    have a compass, and no heading is estimated. `arena` is (2, 2) [m].
    """

    def require(values: Array, lack: str, remedy: str) -> None:
        if (lost := np.isnan(values).any(-1)).any():
            robot = robots[int(np.argmax(lost))]
            raise BadInput(f"run {run!r}: robot {robot!r} has no true {lack}; choose {remedy} in log.toml")

    n, no_position = len(robots), "position where the prior is taken"
    if declared.position == "arena":
        x, sd = np.tile(arena.mean(0), (n, 1)), np.tile((arena[1] - arena[0]) / np.sqrt(12), (n, 1))
        source = "anywhere in the arena"
    else:
        x, sd = poses[0, :, :2], np.full((n, 2), declared.position_sd)
        require(x, no_position, 'start, or position = "arena" in [prior]')
        source = f"first truth, assumed sd {declared.position_sd:g} m"
    if turns is not None:
        heading, heading_sd = np.zeros(n), np.full(n, UNIFORM if declared.heading == "unknown" else declared.heading_sd)
        if declared.heading == "first truth":
            heading, remedy = poses[0, :, 2], 'heading = "first motion" or "unknown" in [prior]'
            require(poses[0, :, 2:], "heading where the prior is taken", remedy)
        elif declared.heading == "first motion":
            require(poses[0, :, :2], no_position, "another start")
            course = np.array([first_course(poses[:, i, :2], np.nan_to_num(turns[:, i])) for i in range(n)])
            heading, heading_sd = np.nan_to_num(course), np.where(np.isnan(course), UNIFORM, heading_sd)
        x, sd = np.column_stack([x, heading]), np.column_stack([sd, heading_sd])
        source += f"; heading: {declared.heading}, assumed sd {heading_sd.min():g} rad"
        still = [name for name, sd_ in zip(robots, heading_sd, strict=True) if sd_ == UNIFORM]
        if declared.heading == "first motion" and still:
            source += f"; unknown of {', '.join(still)}, which hardly moved"
    P = np.stack([np.diag(row**2) for row in sd])
    return Belief(x[None].copy(), P[None]), source


def first_course(truth: Array, turns: Array) -> float:
    """Return the true course of the first REACH metres, less the turn (T,) until then by odometry [rad].

    `truth` (T + 1, 2) [m] is nan where unknown but for the first; the course of a robot that stays is nan.
    """
    away = np.hypot(*(truth - truth[0]).T)
    if not (away > REACH).any():
        return np.nan
    end = int(np.argmax(away > REACH))
    begin = int(np.flatnonzero(away[:end] <= REST)[-1])
    step = truth[end] - truth[begin]
    turned = np.concatenate([[0.0], np.cumsum(turns)])
    course = np.arctan2(step[1], step[0]) - (turned[begin] + turned[end]) / 2
    return float(wrap(np.array(course)))
