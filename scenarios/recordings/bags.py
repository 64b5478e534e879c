"""The messages of a bag by topic: from rosbags where the bag is intact, salvaged where it is not."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput, nearest
from cooploc.estimators.interface import Array, Indices
from cooploc.scenarios.recordings import schema
from cooploc.scenarios.recordings.bag_storage import (
    ENDINGS,
    KINDS,
    Bag,
    Row,
    bag_paths,
    opened,
    stamp_of,
    storage_files,
    write_ahead_log,
)
from cooploc.scenarios.recordings.csv_files import places
from cooploc.scenarios.recordings.schema import UNITS, TeamDescription
from cooploc.scenarios.recordings.sqlite_recovery import salvaged
from cooploc.scenarios.recordings.team_log import (
    Channel,
    Kind,
    Measured,
    Readings,
    Series,
    TeamLog,
    divided,
    in_order,
    odometry_of,
    truth_of,
)
from cooploc.scenarios.recordings.text_files import LARGEST

LATEST = 2**62  # [ns] in the year 2116: later times of receipt are damaged


class Topic(NamedTuple):
    """What was received on one topic, in the order of the file."""

    type: str
    received: list[int]  # [ns]
    stamps: list[int | None]  # [ns] of the headers; empty unless the topic was asked for
    rows: list[list[Row]]  # of each message; empty unless the topic was asked for


class Content(NamedTuple):
    """What a path holds."""

    topics: dict[str, Topic]
    warnings: tuple[str, ...]


def read_content(path: Path, wanted: Collection[str] | None) -> Content:
    """All messages of the topics in `wanted`; or of all topics (None) when they were received, without their content.

    Raises:
        BadInput: there is no bag, or nothing can be read of it.

    """
    parts = [part for bag in bag_paths(path) for part in _contents(bag, wanted)]
    topics: dict[str, Topic] = {}
    for part in parts:
        for name, found in part.topics.items():
            known = topics.setdefault(name, Topic(found.type, [], [], []))
            if known.type != found.type:
                raise BadInput(f"{path}: topic {name} has type {known.type} in one bag and {found.type} in another")
            known.received.extend(found.received)
            known.stamps.extend(found.stamps)
            known.rows.extend(found.rows)
    return Content(topics, tuple(dict.fromkeys(w for part in parts for w in part.warnings)))


def _contents(bag: Path, wanted: Collection[str] | None) -> list[Content]:
    """Of one bag: as a whole, else file by file. A file without any message is told, as long as another has some."""
    try:
        return [_intact(bag, wanted)]
    except Exception as e:  # rosbags raises whatever its parsers raise on damaged files
        reason = _one_line(e, bag)
    found: list[Content] = []
    lost: list[BadInput] = []
    for file in storage_files(bag):
        try:
            found.append(_of_file(file, wanted, reason, alone=not bag.is_dir()))
        except BadInput as e:
            lost.append(e)
    if not found:
        raise lost[0]
    return [*found, Content({}, tuple(str(e) for e in lost))]


def _of_file(file: Path, wanted: Collection[str] | None, reason: str, alone: bool) -> Content:
    """Of one file: intact, if only the bag around it was not, else what can be salvaged."""
    if not alone:
        try:
            content = _intact(file, wanted)
            return content._replace(warnings=(*content.warnings, f"{file} was read by itself ({reason})"))
        except Exception as e:  # as above
            reason = _one_line(e, file)
    bag, warning = salvaged(file, reason)
    content, _ = _collect(bag, wanted)
    return content._replace(warnings=(warning, *content.warnings))


def _intact(path: Path, wanted: Collection[str] | None) -> Content:
    """By rosbags, which does not look into the log of a killed recorder."""
    for file in storage_files(path):
        if log := write_ahead_log(file):
            raise BadInput(f"{log.name} holds messages of a recorder that did not end in order")
    with opened(path) as bag:
        content, unreadable = _collect(bag, wanted)
    for name in _chosen(bag, wanted):
        there = len(content.topics[name].received) + unreadable.get(name, 0)
        if there < bag.counts[name]:
            raise BadInput(f"{name} has {there} messages where {bag.counts[name]} were recorded")
    return content


def _chosen(bag: Bag, wanted: Collection[str] | None) -> list[str]:
    """All topics, or those that are wanted and of a type that is read."""
    return [name for name, kind in bag.types.items() if wanted is None or (name in wanted and kind in KINDS)]


def _collect(bag: Bag, wanted: Collection[str] | None) -> tuple[Content, dict[str, int]]:
    """What a bag holds, and how many messages of a topic cannot be read."""
    topics = {name: Topic(kind, [], [], []) for name, kind in bag.types.items()}
    unreadable: dict[str, int] = {}
    for name, time, raw in bag.messages(_chosen(bag, wanted)):
        topic = topics[name]
        try:
            _add(topic, time, bag.decode(raw, topic.type) if wanted is not None else None)
        except Exception:  # whatever rosbags raises on a damaged message, or one of a type it does not know
            unreadable[name] = unreadable.get(name, 0) + 1
    told = (f"{name}: {n} messages cannot be read; they are left out" for name, n in unreadable.items())
    return Content(topics, tuple(told)), unreadable


def _add(topic: Topic, time: int, message: Any) -> None:
    if not 0 <= time < LATEST:
        raise ValueError
    if message is not None:
        stamp, rows = stamp_of(message), KINDS[topic.type].rows(message)
        topic.stamps.append(stamp)
        topic.rows.append(rows)
    topic.received.append(time)


def _one_line(e: Exception, bag: Path) -> str:
    """What rosbags says, without the directory, which is told beside it."""
    said = " ".join(f"{e}".split()).replace(f"{bag}/", "").replace(f"{bag.parent}/", "")
    return said[:200] or type(e).__name__


# ROS 1 bags, ROS 2 bags and MCAP, read without ROS by rosbags (https://gitlab.com/ternaris/rosbags).

SILENCE = 5.0  # mean intervals between messages, and more of them than this are a gap
MAX_STAMP_ERROR = 60.0  # [s] a header's stamp further from the time of receipt was not set by a clock of this run


class TopicInfo(NamedTuple):
    """What a topic holds, by the times of receipt."""

    name: str
    type: str
    messages: int
    first: float  # [s] since the epoch; nan where there is no message
    last: float
    rate: float  # [1/s] mean; nan with fewer than two messages
    gaps: tuple[tuple[float, float], ...]  # begin and length [s] of each silence of more than `SILENCE` intervals
    columns: tuple[str, ...]  # what `read_topics` gives; empty for a type that is not read


class TopicSeries(NamedTuple):
    """The numbers of one topic."""

    type: str
    time: Array  # (m,) does not fall [s]
    values: Array  # (m, k)
    columns: tuple[str, ...]
    clock: str  # "header" or "receipt": whose stamps `time` are
    warnings: tuple[str, ...]


def topics(path: Path) -> tuple[list[TopicInfo], tuple[str, ...]]:
    """What a bag holds, by topic, and warnings of what could not be read.

    Raises:
        BadInput: there is no bag, or nothing can be read of it.

    """
    content = read_content(path, None)
    found = [_info(name, topic.type, np.sort(topic.received) / 1e9) for name, topic in sorted(content.topics.items())]
    return found, content.warnings


def read_series(path: Path, topic: str) -> TopicSeries:
    """One topic; see `read_topics`."""
    return read_topics(path, [topic])[0][topic]


def read_topics(path: Path, names: Collection[str]) -> tuple[dict[str, TopicSeries], tuple[str, ...]]:
    """The numbers of some topics, in one pass over the bag, and warnings of what is wrong with the bag.

    Raises:
        BadInput: there is no bag or nothing can be read of it, or a topic is not there or of a type that is not read.

    """
    content = read_content(path, names)
    for name in names:
        if name not in content.topics:
            raise BadInput(f"{path}: there is no topic {name!r}; {nearest(name, list(content.topics))}")
    return _numbers(path, names, content)


def read_present(path: Path, names: Collection[str]) -> tuple[dict[str, TopicSeries], tuple[str, ...]]:
    """As `read_topics`, of the topics that are there."""
    content = read_content(path, names)
    return _numbers(path, [name for name in content.topics if name in names], content)


def _numbers(path: Path, names: Collection[str], content: Content) -> tuple[dict[str, TopicSeries], tuple[str, ...]]:
    for name in names:
        kind = content.topics[name].type
        if kind not in KINDS:
            raise BadInput(
                f"{path}: topic {name} has type {kind}, which is not read; types that are: {', '.join(KINDS)}"
            )
    shift, warnings = _clock_shift(content.topics)
    series = {name: _series(name, content.topics[name], shift) for name in names}
    told = (w for one in series.values() for w in one.warnings)
    return series, (*content.warnings, *warnings, *told)


def _clock_shift(topics: Mapping[str, Topic]) -> tuple[int, tuple[str, ...]]:
    """How far [ns] the headers' clock is behind the recorder's, if one of them was not set; and a warning."""
    behind = [np.median(_ahead(t)) for t in topics.values() if any(stamp is not None for stamp in t.stamps)]
    shift = -int(np.median(behind)) if behind else 0
    if abs(shift) <= MAX_STAMP_ERROR * 1e9:
        return 0, ()
    said = f"header stamps are {shift / 1e9:.1f} s behind the recorder's clock; that was added to all of them"
    return shift, (said,)


def _ahead(topic: Topic) -> Indices:
    """Header stamps minus times of receipt [ns], where there is a stamp."""
    pairs = zip(topic.stamps, topic.received, strict=True)
    return np.array([stamp - received for stamp, received in pairs if stamp is not None], np.int64)


def _series(name: str, topic: Topic, shift: int) -> TopicSeries:
    """By rising time. Rows with a number that cannot be a measurement are left out."""
    time, clock, warnings = _times(name, topic, shift)
    columns = KINDS[topic.type].columns
    time = np.repeat(time, [len(rows) for rows in topic.rows])
    values = np.array([row for rows in topic.rows for row in rows], float).reshape(-1, len(columns))
    # A heading is nan where the orientation was never set; nothing else may be.
    bad = ~(np.abs(values) <= LARGEST) & ~(np.isnan(values) & (np.array(columns) == "heading [rad]"))
    good = ~bad.any(1)
    if not good.all():
        warnings = (*warnings, f"{name}: {(~good).sum()} messages hold a number that is not finite; they are left out")
    order = np.argsort(time[good], kind="stable")
    return TopicSeries(topic.type, time[good][order], values[good][order], columns, clock, warnings)


def _times(name: str, topic: Topic, shift: int) -> tuple[Array, str, tuple[str, ...]]:
    """The times [s] to believe: the headers' where they are set and near the times of receipt, else those."""
    received = np.array(topic.received, np.int64)
    if all(stamp is None for stamp in topic.stamps):
        return received / 1e9, "receipt", ()
    set_ = np.array([stamp is not None for stamp in topic.stamps])
    own = np.where(set_, np.array([stamp or 0 for stamp in topic.stamps], np.int64) + shift, received)
    error = np.abs(own - received) / 1e9
    if np.median(error) > MAX_STAMP_ERROR:
        said = f"{name}: header stamps are {np.median(error):.0f} s from the times of receipt; the latter are used"
        return received / 1e9, "receipt", (said,)
    lost = ~set_ | (error > MAX_STAMP_ERROR)
    said = f"{name}: {lost.sum()} messages without a header stamp to believe; their time of receipt is used"
    return np.where(lost, received, own) / 1e9, "header", (said,) if lost.any() else ()


def _info(name: str, kind: str, time: Array) -> TopicInfo:
    first, last = (float(time[0]), float(time[-1])) if len(time) else (np.nan, np.nan)
    rate = (len(time) - 1) / (last - first) if last > first else np.nan
    silent = np.flatnonzero(np.diff(time) * rate > SILENCE)
    gaps = tuple((float(time[i]), float(time[i + 1] - time[i])) for i in silent)
    columns = KINDS[kind].columns if kind in KINDS else ()
    return TopicInfo(name, kind, len(time), first, last, rate, gaps, columns)


# One table of a description against the topics of a bag: which topics it means, and their numbers in SI units.


def topics_of(source: schema.Source, robots: Sequence[str], others: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """(topic, robot, other) of all that a source may have; other is "" where the topic does not say."""
    written: dict[str, list[str]] = {}
    for word, name in source.nodes.items():
        written.setdefault(name, []).append(word)
    for robot in robots:
        pattern = source.topics.get(robot, source.topic)
        if pattern is None:
            continue
        if "{robot}" not in pattern and robot not in source.topics and len(robots) > 1:
            raise BadInput(
                f'topic {pattern} is of which robot? Write {{robot}} in it, or topics = {{ {robot} = "..." }}'
            )
        for other in others if "{other}" in pattern else ("",):
            for a, b in product(written.get(robot, [robot]), written.get(other, [other])) if robot != other else ():
                yield pattern.replace("{robot}", a).replace("{other}", b), robot, other


def columns_of(topic: str, series: TopicSeries, names: Sequence[str], table: str) -> Array:
    """Columns of a topic by their names.

    Raises:
        BadInput: its type has not got them.

    """
    if not set(names) <= set(series.columns):
        raise BadInput(
            f"topic {topic} has {', '.join(series.columns)}, not {', '.join(names)}; correct the topic in [{table}] of "
            "log.toml"
        )
    return series.values[:, [series.columns.index(name) for name in names]]


def values_of(topic: str, table: schema.ReadingColumns, series: TopicSeries) -> tuple[Array, Array]:
    """Times and values (m, k) of one topic of measurements."""
    if isinstance(table, schema.Sightings):
        x, y, z = columns_of(topic, series, ("x [m]", "y [m]", "z [m]"), "sightings").T
        if series.type != "geometry_msgs/msg/PoseArray":
            return series.time, np.stack([np.hypot(x, y), np.arctan2(y, x)], -1)
        _, first, n = np.unique(series.time, return_index=True, return_counts=True)
        alone = first[n == 1]
        return series.time[alone], np.stack([np.hypot(x, z), np.arctan2(-x, z)], -1)[alone]
    values = series.values[:, :1].copy()
    if series.columns not in (("value",), ("range [m]",)):
        raise BadInput(f"topic {topic} has {', '.join(series.columns)}, not one number; correct the topic in log.toml")
    if isinstance(table, schema.Ranges):
        values *= UNITS["m"][table.unit]
    elif isinstance(table, schema.Rssi):
        values[values >= table.missing_from] = np.nan
    return series.time, values


# Recordings of a team in ROS bags, as `log.toml` describes them: which topic is of which robot, and of what.
#
# A pose is in metres and radians and a speed in SI units, as ROS has it (REP 103); a number (std_msgs/Float32, Float64)
# has the unit that the description says. What a camera saw (`[sightings]`) is a pose in the robot's frame, x forward
# and y left, or a geometry_msgs/PoseArray in the camera's, z forward and x right, with one detection in a message.

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
    tables: list[tuple[Kind, Sequence[schema.ReadingColumns], Sequence[str]]] = [
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
    table: schema.ReadingColumns,
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
