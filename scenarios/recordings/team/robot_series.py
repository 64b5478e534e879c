"""What a reader found of each robot, demanded and put in order: odometry of all, and truth of some."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.team.schema import GroundTruth
from cooploc.scenarios.recordings.team.team_log import Series
from cooploc.scenarios.recordings.team.truth_frame import true_poses


def odometry_of(place: Path, found: Mapping[str, Series], robots: Sequence[str]) -> tuple[Series, ...]:
    """Odometry of every robot.

    Raises:
        BadInput: one has fewer than two samples.

    """
    for robot in robots:
        if robot not in found or len(found[robot].time) < 2:
            raise BadInput(
                f"{place}: robot {robot!r} has fewer than two samples of odometry; correct [odometry] of log.toml, or "
                "take it out of `robots`"
            )
    return tuple(found[robot] for robot in robots)


def truth_of(
    place: Path, found: Mapping[str, Series], robots: Sequence[str], table: GroundTruth, warnings: list[str]
) -> tuple[Series | None, ...]:
    """True poses of every robot, None of those that have none; what is missing or left out goes into `warnings`.

    Raises:
        BadInput: no robot has a truth.

    """
    poses: list[Series | None] = []
    for robot in robots:
        series = found.get(robot)
        if series is None or len(series.time) < 2:
            warnings.append(f"{place}: robot {robot!r} has no truth, and so no errors")
            poses.append(None)
            continue
        values, jumps = true_poses(series.time, series.values, table)
        if jumps:
            warnings.append(f"{series.source}: {jumps} true positions are out of reach at max_speed, and were left out")
        poses.append(series._replace(values=values))
    if all(series is None for series in poses):
        raise BadInput(f"{place}: no robot has a truth; correct [truth] of log.toml")
    return tuple(poses)
