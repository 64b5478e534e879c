"""What each robot knows of its start."""

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Belief
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings.schema import Prior
from cooploc.scenarios.recordings.single_robot import UNKNOWN, first_course
from cooploc.scenarios.recordings.team_log import TeamLog


def prior(log: TeamLog, declared: Prior, arena: Array, poses: Array, turns: Array | None) -> tuple[Belief, str]:
    """The belief before the first tick, x (1, n, d) and P (1, n, d, d), and where it comes from.

    Args:
        log: the recording.
        declared: from which sources.
        arena: (2, 2) [m].
        poses: (T + 1, n, 3) true ones; row 0 is at the prior's time.
        turns: (T, n) by odometry in each tick [rad]; None: robots have a compass, and no heading is estimated.

    Raises:
        BadInput: a source that is declared does not give a position or a heading.

    """
    n = len(log.robots)
    if declared.position == "arena":
        x, sd = np.tile(arena.mean(0), (n, 1)), np.tile((arena[1] - arena[0]) / np.sqrt(12), (n, 1))
        source = "anywhere in the arena"
    else:
        first = declared.position == "first truth"
        stated = declared.position if isinstance(declared.position, dict) else {}
        x = poses[0, :, :2] if first else np.array([_of(stated, robot, "position") for robot in log.robots])
        _demand(log, x, "no true position where the prior is taken", "start, or a position in [prior]")
        sd = np.full((n, 2), declared.position_sd)
        source = f"{'true' if first else 'stated'} position, assumed sd {declared.position_sd:g} m"
    if turns is not None:
        heading, spread = _headings(log, declared, poses, turns)
        x, sd = np.column_stack([x, heading]), np.column_stack([sd, np.full(n, spread)])
        kind = declared.heading if isinstance(declared.heading, str) else "stated"
        source += f"; heading: {kind}, assumed sd {spread:g} rad"
    P = np.stack([np.diag(row**2) for row in sd])
    return Belief(x[None].copy(), P[None]), source


def _headings(log: TeamLog, declared: Prior, poses: Array, turns: Array) -> tuple[Array, float]:
    n = len(log.robots)
    if declared.heading == "unknown":
        return np.zeros(n), float(UNKNOWN)
    if declared.heading == "first motion":
        _demand(log, poses[0, :, :2], "no true position where the prior is taken", "another start")
        where = [f"run {log.name!r}, robot {robot!r}" for robot in log.robots]
        courses = [first_course(where[i], poses[:, i, :2], np.nan_to_num(turns[:, i])) for i in range(n)]
        return np.array(courses), declared.heading_sd
    if declared.heading == "first truth":
        heading = poses[0, :, 2]
    else:
        heading = wrap(np.array([_of(declared.heading, robot, "heading") for robot in log.robots], float))
    _demand(log, heading[:, None], "no true heading where the prior is taken", 'heading = "first motion" in [prior]')
    return heading, declared.heading_sd


def _of(stated: object, robot: str, what: str) -> object:
    if not isinstance(stated, dict) or robot not in stated:
        raise BadInput(f"[prior] {what} in log.toml lacks robot {robot!r}; add it")
    return stated[robot]


def _demand(log: TeamLog, values: Array, lack: str, remedy: str) -> None:
    lost = np.isnan(values).any(-1)
    if lost.any():
        raise BadInput(
            f"run {log.name!r}: robot {log.robots[int(np.argmax(lost))]!r} has {lack}; choose {remedy} in log.toml"
        )
