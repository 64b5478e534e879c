"""A log.toml for a ROS bag: which topics are odometry, truth and ranges, of which robots, and which radio is whose."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.bags import TopicInfo, TopicSeries, read_topics, topics
from cooploc.scenarios.recordings.inspect.names import ODOMETRY, words_of
from cooploc.scenarios.recordings.inspect.toml_text import Entry, Table
from cooploc.scenarios.recordings.radio_nodes import Assignment, NodeRanges, assign
from cooploc.scenarios.recordings.team_log import Series

NUMBERS = ("sensor_msgs/msg/Range", "std_msgs/msg/Float32", "std_msgs/msg/Float64")
SURE = 2.0  # times the misfit of the best assignment of radios that the next best must have


class BagDraft(NamedTuple):
    """What is thought of a bag."""

    entries: tuple[Entry, ...]
    tables: tuple[Table, ...]
    columns: tuple[tuple[str, str, str, str], ...]  # topic, type, what it probably is, why
    unused: tuple[str, ...]


class Choice(NamedTuple):
    """Topics by robot, and by pair of radio nodes."""

    odometry: Mapping[str, str]
    truth: Mapping[str, str]
    ranges: Mapping[tuple[str, str], str]


def bag_draft(path: Path) -> BagDraft:
    """The draft for a bag.

    Raises:
        BadInput: it cannot be read, or no topic is odometry, or none the truth of a robot with odometry.

    """
    found = [topic for topic in topics(path)[0] if topic.messages and topic.columns]
    choice = _choice(path, found)
    robots = tuple(choice.odometry)
    wanted = [*choice.odometry.values(), *choice.truth.values(), *choice.ranges.values()]
    series = read_topics(path, wanted)[0]
    entries = (
        Entry("format", "bag", "a ROS bag"),
        Entry("robots", list(robots), "what differs between the topics of odometry that have a truth", "likely"),
    )
    tables = [_odometry(choice, series), _truth(choice)]
    if choice.ranges:
        tables.append(_ranges(choice, series))
    used = dict.fromkeys(choice.odometry.values(), "odometry")
    used |= dict.fromkeys(choice.truth.values(), "truth") | dict.fromkeys(choice.ranges.values(), "range")
    columns = [(t.name, t.type.rpartition("/")[2], used.get(t.name, "not used"), _rate(t)) for t in found]
    unused = [f"{t.name} ({t.type.rpartition('/')[2]}, {t.messages})" for t in found if t.name not in used]
    return BagDraft(entries, tuple(tables), tuple(columns), tuple(unused))


def _choice(path: Path, found: Sequence[TopicInfo]) -> Choice:
    """Odometry by its type, truth by other poses with a robot's name or number, ranges by two nodes in a name."""
    wheels = _by_robot([t.name for t in found if t.type.endswith("/Odometry")])
    poses = [t.name for t in found if "x [m]" in t.columns and t.name not in wheels.values()]
    poses = [name for name in poses if not any(word in ODOMETRY for word in words_of(name))]
    poses = [name for name in poses if "PoseArray" not in next(t.type for t in found if t.name == name)]
    truth = {robot: next((name for name in poses if _speaks_of(name, robot)), "") for robot in wheels}
    truth = {robot: name for robot, name in truth.items() if name}
    if not truth:
        raise BadInput(
            f"{path}: no robot has both odometry (nav_msgs/Odometry) and a true pose under its name or number; topics: "
            f"{', '.join(t.name for t in found)[:300]}"
        )
    ranges = {pair: t.name for t in found if t.type in NUMBERS and (pair := _pair(t.name))}
    return Choice({robot: wheels[robot] for robot in truth}, truth, ranges)


def _by_robot(names: Sequence[str]) -> dict[str, str]:
    """Robot -> topic: the part of the names that differs between most of them; the first topic of each robot."""
    marked = [(name, part) for name in names for part in name.strip("/").split("/")]
    counts = Counter(_without(name, part) for name, part in marked)
    if not counts:
        return {}
    best, most = counts.most_common(1)[0]
    if most < 2:
        return {name.strip("/").split("/")[0]: name for name in reversed(names)}
    found = {part: name for name, part in reversed(marked) if _without(name, part) == best}
    letters = {re.sub(r"\d", "", robot) for robot in found}
    for name, part in marked:  # the same kind of robot under another topic
        if part not in found and re.search(r"\d", part) and re.sub(r"\d", "", part) in letters:
            found[part] = name
    return dict(sorted(found.items()))


def _without(name: str, part: str) -> str:
    return "/".join("{robot}" if piece == part else piece for piece in name.split("/"))


def _speaks_of(topic: str, robot: str) -> bool:
    """Whether a topic has a robot's name, or a part with its number and letters in common at the beginning."""
    if robot in topic:
        return True
    letters, number = re.match(r"([A-Za-z]*)[_-]?(\d*)", robot).groups()  # type: ignore[union-attr]
    if not number:
        return False
    parts = re.findall(r"([A-Za-z]+)[_-]?(\d+)", topic)
    return any(int(digits) == int(number) and word.lower().startswith(letters.lower()[:4]) for word, digits in parts)


def _pair(topic: str) -> tuple[str, str] | None:
    """The two parts of a name that differ in their number alone: the nodes of a range."""
    parts = [part for part in topic.split("/") if re.search(r"\d", part)]
    alike = [(a, b) for a, b in pairwise(parts) if re.sub(r"\d", "", a) == re.sub(r"\d", "", b)]
    return alike[0] if alike and alike[0][0] != alike[0][1] else None


def _odometry(choice: Choice, series: Mapping[str, TopicSeries]) -> Table:
    """Poses where their headings turn as their turn rates say and their places change, else velocities."""
    every = [series[topic] for topic in choice.odometry.values()]
    if all(_turns(one) for one in every) and any(np.ptp(_column(one, "x [m]")) > 0.01 for one in every):
        kind, why = "pose", "poses lose nothing with a lost message"
    else:
        kind, why = "velocity", "the headings of the poses do not turn as the turn rates beside them"
    return Table("odometry", (Entry("kind", kind, why, "likely"), *_topics(choice.odometry, "its type is Odometry")))


def _turns(series: TopicSeries) -> bool:
    """Whether headings change by half to twice the integral of the turn rate; or neither turns by a radian in all."""
    heading, rate = _column(series, "heading [rad]"), _column(series, "omega [rad/s]")
    if not np.isfinite(heading).all() or len(heading) < 2:
        return False
    said = np.abs(np.diff(np.unwrap(heading))).sum()
    turned = np.abs(np.diff(series.time) * rate[1:]).sum()
    return bool(max(said, turned) < 1.0 or turned == 0 or turned / 2 < said < 2 * turned)


def _truth(choice: Choice) -> Table:
    return Table("truth", _topics(choice.truth, "a pose under the name or number of a robot that is not odometry"))


def _topics(by_robot: Mapping[str, str], why: str) -> tuple[Entry, ...]:
    """One pattern where all have it, else the topic of each robot."""
    patterns = {topic.replace(robot, "{robot}") for robot, topic in by_robot.items()}
    if len(patterns) == 1 and "{robot}" in next(iter(patterns)):
        return (Entry("topic", patterns.pop(), why, "likely"),)
    return (Entry("topics", dict(by_robot), why, "likely"),)


def _ranges(choice: Choice, series: Mapping[str, TopicSeries]) -> Table:
    """The ranges, and which radio is on which robot: by the truth, which names may be found from; and that is said."""
    (a, b), topic = next(iter(choice.ranges.items()))
    pattern = topic.replace(f"/{a}", "/{robot}", 1).replace(f"/{b}", "/{other}", 1)
    every = [NodeRanges(x, y, series[t].time, series[t].values[:, 0]) for (x, y), t in choice.ranges.items()]
    carriers = {robot: _pose(series[t], t) for robot, t in choice.truth.items()}
    entries = [Entry("topic", pattern, f"{len(every)} topics with two numbered nodes", "likely")]
    if len(carriers) < 2:
        return Table("ranges", tuple(entries))
    found = assign(every, carriers)
    nodes = {node: robot for robot, node in found.nodes.items()}
    entries.append(Entry("nodes", nodes, *_how_sure(found)))
    stood = "; ".join(
        f"{node} at ({place.position[0]:.2f}, {place.position[1]:.2f}) m, residual {place.residual:.2f} m"
        for node, place in found.anchors.items()
    )
    remarks = (
        (
            f"Nodes on no robot, and where they stood, by ranges and the truth of this very run: {stood}.",
            "As anchors they would tell estimators of that truth: survey them, and name them in [anchors] places.",
        )
        if stood
        else ()
    )
    return Table("ranges", tuple(entries), remarks)


def _how_sure(found: Assignment) -> tuple[str, str]:
    """Why the radios are where they are said to be, and how sure that is."""
    if len(found.nodes) == 2 and not found.anchors:
        return "two radios on two robots: which is whose makes no difference to ranges", "perhaps"
    why = (
        f"ranges fit the distances by the truth to {found.residual:.3f} m (median, less a bias of each pair); "
        f"the next best assignment to {found.second:.3f} m"
    )
    return why, "likely" if found.second > SURE * found.residual else "perhaps"


def _pose(series: TopicSeries, topic: str) -> Series:
    columns = [_column(series, name) for name in ("x [m]", "y [m]", "heading [rad]")]
    return Series(series.time, np.stack(columns, -1), topic)


def _column(series: TopicSeries, name: str) -> np.ndarray:
    return series.values[:, series.columns.index(name)]


def _rate(topic: TopicInfo) -> str:
    gaps = f", {len(topic.gaps)} gaps" if topic.gaps else ""
    return f"{topic.messages} messages, {topic.rate:.3g} Hz, {topic.last - topic.first:.3g} s{gaps}"
