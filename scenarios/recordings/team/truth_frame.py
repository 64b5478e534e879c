"""True poses as a description declares them: in another frame, and without positions that cannot be."""

import numpy as np

from cooploc.estimators.interface import Array, Mask
from cooploc.scenarios.recordings.team.schema import GroundTruth


def true_poses(time: Array, poses: Array, declared: GroundTruth) -> tuple[Array, int]:
    """Poses (m, 3) in the team's frame, and how many became nan as the robot cannot have been there.

    Args:
        time: (m,) rising [s].
        poses: (m, 3) x, y [m], heading [rad], as recorded; nan where absent.
        declared: `frame` and `max_speed`.

    """
    x, y, heading = poses.T
    if declared.frame == "mirrored":
        y, heading = -y, -heading
    elif declared.frame == "swapped":
        x, y, heading = y, x, np.pi / 2 - heading
    framed = np.stack([x, y, heading], -1)  # not wrapped: degrees that were not declared must remain visible
    jumps = unreachable(time, framed[:, :2], declared.max_speed or np.inf)
    framed[jumps] = np.nan
    return framed, int(jumps.sum())


def unreachable(time: Array, positions: Array, speed: float) -> Mask:
    """Positions (m, 2) that cannot be reached from the last valid one at `speed` [m/s]."""
    bad: Mask = np.zeros(len(time), bool)
    if not np.isfinite(speed):
        return bad
    known = np.flatnonzero(np.isfinite(positions).all(-1))
    last = known[0] if len(known) else 0
    for k in map(int, known[1:]):
        bad[k] = np.hypot(*(positions[k] - positions[last])) > speed * (time[k] - time[last])
        last = last if bad[k] else k
    return bad
