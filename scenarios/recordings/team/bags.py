"""Recordings of a team in ROS bags, as `log.toml` describes them: which topic is of which robot, and of what.

A pose is in metres and radians and a speed in SI units, as ROS has it (REP 103); a number (std_msgs/Float32, Float64)
has the unit that the description says. What a camera saw (`[sightings]`) is a pose in the robot's frame, x forward and
y left, or a geometry_msgs/PoseArray in the camera's, z forward and x right, with one detection in a message.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.team import schema
from cooploc.scenarios.recordings.team.bag_files import ENDINGS
from cooploc.scenarios.recordings.team.bag_source import columns_of, topics_of, values_of
from cooploc.scenarios.recordings.team.bag_topics import TopicInfo as TopicInfo
from cooploc.scenarios.recordings.team.bag_topics import TopicSeries, read_present
from cooploc.scenarios.recordings.team.bag_topics import read_series as read_series
from cooploc.scenarios.recordings.team.bag_topics import read_topics as read_topics
from cooploc.scenarios.recordings.team.bag_topics import topics as topics
from cooploc.scenarios.recordings.team.channels import Kind, Measured, divided
from cooploc.scenarios.recordings.team.places_file import places
from cooploc.scenarios.recordings.team.robot_series import odometry_of, truth_of
from cooploc.scenarios.recordings.team.schema import TeamDescription
from cooploc.scenarios.recordings.team.series import in_order
from cooploc.scenarios.recordings.team.team_log import Channel, Readings, Series, TeamLog

Found = Mapping[str, TopicSeries]
ODOMETRY = {"velocity": ("v [m/s]", "omega [rad/s]"), "pose": ("x [m]", "y [m]", "heading [rad]")}


def runs(data: Path, description: TeamDescription) -> dict[str, Path]:
    """The runs in a directory: itself, if it is a ROS 2 bag, else each bag in it, and each directory of bags.

    A directory of bags is one run, which was recorded in parts or by each robot.

    Raises:
        BadInput: there are none.

    """
    if (data / "metadata.yaml").exists():
        return {data.resolve().name: data}
    found: dict[str, Path] = {}
    for path in sorted(data.iterdir()):
        holds = path.is_dir() and any(inside.suffix in ENDINGS for inside in path.rglob("*"))
        if holds or (path.is_file() and path.suffix in ENDINGS):
            name = path.name if holds else path.stem
            if name in found:
                raise BadInput(f"{path}: {found[name].name} has the same name; rename one")
            found[name] = path
    if not found:
        raise BadInput(f"{data}: no bag here; it needs files that end with {', '.join(ENDINGS)}")
    return found


def read(data: Path, place: Path, name: str, description: TeamDescription) -> TeamLog:
    """One run.

    Raises:
        BadInput: the bag cannot be read, or a topic is missing or of another type than its table needs.

    """
    if description.odometry is None or description.truth is None:
        raise BadInput(f"{data}: log.toml lacks [odometry] or [truth]; add the table")
    robots, d = description.robots, description
    anchors, landmarks = (places(data, table, d.delimiter) for table in (d.anchors, d.landmarks))
    tables: list[tuple[Kind, Sequence[schema.Readings], Sequence[str]]] = [
        ("range", d.ranges, anchors.names),
        ("rssi", d.rssi, anchors.names),
        ("sighting", d.sightings, landmarks.names),
    ]
    sources = [(s, (*robots, *fixed)) for _, several, fixed in tables for s in several]
    wanted = {topic for s, others in sources for topic, _, _ in topics_of(s, robots, others)}
    wanted |= {topic for s in (description.odometry, description.truth) for topic, _, _ in topics_of(s, robots, ())}
    found, told = read_present(place, wanted)
    warnings = list(told)
    moves, poses = description.odometry, description.truth
    if moves.kind not in ODOMETRY:
        raise BadInput(f"{place}: a bag has odometry of kind {' or '.join(ODOMETRY)}, not {moves.kind!r}; correct kind")
    series = _by_robot(moves, found, robots, ODOMETRY[moves.kind], "odometry", warnings)
    odometry = odometry_of(place, series, robots)
    series = _by_robot(poses, found, robots, ODOMETRY["pose"], "truth", warnings)
    truth = truth_of(place, series, robots, poses, warnings)
    readings: dict[Channel, Readings] = {}
    for kind, several, fixed in tables:
        measured = [m for s in several for m in _measured(place, s, found, robots, (*robots, *fixed), warnings)]
        channels, told_ = divided(kind, measured, robots, fixed)
        readings |= channels
        warnings += told_
    kind_ = description.odometry.kind
    return TeamLog(name, robots, kind_, odometry, truth, readings, landmarks, anchors, tuple(warnings))


def _by_robot(
    table: schema.Source,
    found: Found,
    robots: Sequence[str],
    columns: Sequence[str],
    named: str,
    warnings: list[str],
) -> dict[str, Series]:
    ordered: dict[str, Series] = {}
    for topic, robot, _ in topics_of(table, robots, ()):
        if topic in found and len(found[topic].time):
            if robot in ordered:
                raise BadInput(
                    f"robot {robot!r} has two topics in [{named}], {ordered[robot].source} and {topic}; choose"
                )
            time = found[topic].time + table.clock_offset
            values = columns_of(topic, found[topic], columns, named)
            ordered[robot], told = in_order(time, values, topic, partial(_message, topic))
            warnings += told
    return ordered


def _measured(
    place: Path,
    table: schema.Readings,
    found: Found,
    robots: Sequence[str],
    others: Sequence[str],
    warnings: list[str],
) -> Iterator[Measured]:
    """Measurements of every topic of a table; without {other} in the topic, a robot measures its only teammate."""
    any_ = False
    for topic, robot, other in topics_of(table, robots, others):
        if topic not in found:
            continue
        any_ = True
        if not other and len(robots) != 2:
            raise BadInput(f"topic {topic} does not say what was measured; write it with {{other}} in log.toml")
        time, values = values_of(topic, table, found[topic])
        mate = other or next(name for name in robots if name != robot)
        yield Measured(time + table.clock_offset, [robot] * len(time), [mate] * len(time), values, topic)
    if not any_:
        warnings.append(f"{place}: none of the topics {table.topic or ', '.join(table.topics.values())} is in the bag")


def _message(topic: str, row: int) -> str:
    return f"{topic}, message {row + 1}"
