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
    robots: Sequence[str], where: Sequence[str], declared: Prior, arena: Array, poses: Array, turns: Array | None
) -> tuple[Belief, str]:
    """Return the belief before the first tick, x (1, n, d) and P (1, n, d, d), and a sentence of where it comes from.

    `where` names each robot's recording in errors; row 0 of the true poses (T + 1, n, 3) is at the prior's time; turns
    (T, n) [rad] are by odometry, or None: robots have a compass, and no heading is estimated. `arena` is (2, 2) [m].
    """
    n = len(robots)
    if declared.position == "arena":
        x, sd = np.tile(arena.mean(0), (n, 1)), np.tile((arena[1] - arena[0]) / np.sqrt(12), (n, 1))
        source = "anywhere in the arena"
    else:
        x = poses[0, :, :2]
        _require(where, x, "no true position where the prior is taken", 'start, or position = "arena" in [prior]')
        sd = np.full((n, 2), declared.position_sd)
        source = f"first truth, assumed sd {declared.position_sd:g} m"
    if turns is not None:
        heading, heading_sd = _headings(where, declared, poses, turns)
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


def _headings(where: Sequence[str], declared: Prior, poses: Array, turns: Array) -> tuple[Array, Array]:
    """Return headings (n,) and their standard deviations (n,) [rad]; one that the first motion does not show is 0."""
    n = len(where)
    if declared.heading == "unknown":
        return np.zeros(n), np.full(n, UNIFORM)
    if declared.heading == "first motion":
        _require(where, poses[0, :, :2], "no true position where the prior is taken", "another start")
        course = np.array([first_course(poses[:, i, :2], np.nan_to_num(turns[:, i])) for i in range(n)])
        return np.nan_to_num(course), np.where(np.isnan(course), UNIFORM, declared.heading_sd)
    remedy = 'heading = "first motion" or "unknown" in [prior]'
    _require(where, poses[0, :, 2:], "no true heading where the prior is taken", remedy)
    return poses[0, :, 2], np.full(n, declared.heading_sd)


def _require(where: Sequence[str], values: Array, lack: str, remedy: str) -> None:
    lost = np.isnan(values).any(-1)
    if lost.any():
        raise BadInput(f"{where[int(np.argmax(lost))]} has {lack}; choose {remedy} in log.toml")
