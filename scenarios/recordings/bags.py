"""Recordings of a team in ROS bags (ROS 1, ROS 2, MCAP), read without ROS, as `log.toml` describes their topics.

A pose is in metres and radians and a speed in SI units, as ROS has it (REP 103); a number (std_msgs/Float32, Float64)
has the unit that the description says. What a camera saw (`[sightings]`) is a pose in the robot's frame, x forward
and y left, or a geometry_msgs/PoseArray in the camera's, z forward and x right, with one detection in a message.
"""

from collections.abc import Collection, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput, nearest
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings import schema
from cooploc.scenarios.recordings.bag_storage import (
    ENDINGS,
    KINDS,
    POSE,
    TWIST,
    Bag,
    Row,
    bag_paths,
    open_bag,
    stamp_of,
    storage_files,
)
from cooploc.scenarios.recordings.schema import UNITS, TeamDescription
from cooploc.scenarios.recordings.sqlite_recovery import recover
from cooploc.scenarios.recordings.team_log import Measured, Series, TeamLog, build_log, order_series, reading_tables
from cooploc.scenarios.recordings.text_files import LARGEST

LATEST = 2**62  # [ns] in the year 2116: later times of receipt are damaged


class Topic(NamedTuple):
    """The messages of one topic, in the order of the file."""

    type: str
    received: list[int]  # [ns]
    stamps: list[int | None]  # [ns] of the headers; empty unless the topic was asked for
    rows: list[list[Row]]  # of each message; empty unless the topic was asked for


class Content(NamedTuple):
    """The topics of the bags at a path."""

    topics: dict[str, Topic]
    warnings: tuple[str, ...]


def read_content(path: Path, wanted: Collection[str] | None) -> Content:
    """Read all messages of the topics in `wanted`; or of all topics (None) only when they were received."""
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
    """Read one bag; of a damaged one what can be recovered, and a warning for each file without any message."""
    try:
        for log in bag.parent.glob(f"{bag.name}-wal") if bag.is_file() else bag.glob("*-wal"):
            if log.stat().st_size:
                raise BadInput(f"{log.name} has more, of a killed recorder; `sqlite3 {log.name[:-4]} vacuum` adds it")
        with open_bag(bag) as whole:
            return [_collect(whole, wanted)]
    except Exception as e:  # rosbags raises whatever its parsers raise on damaged files
        reason = " ".join(f"{e}".split()).replace(f"{bag}/", "").replace(f"{bag.parent}/", "")[:200] or type(e).__name__
    found: list[Content] = []
    lost: list[BadInput] = []
    for file in storage_files(bag):
        try:
            recovered, warning = recover(file, reason)
            found += [_collect(recovered, wanted), Content({}, (warning,))]
        except BadInput as e:
            lost.append(e)
    if not found:
        raise lost[0]
    return [*found, Content({}, tuple(str(e) for e in lost))]


def _collect(bag: Bag, wanted: Collection[str] | None) -> Content:
    """Return the messages of a bag: of all topics, or those that are wanted and of a type that is read."""
    topics = {name: Topic(kind, [], [], []) for name, kind in bag.types.items()}
    names = [name for name, kind in bag.types.items() if wanted is None or (name in wanted and kind in KINDS)]
    unreadable = dict.fromkeys(names, 0)
    for name, time, raw in bag.messages(names):
        topic = topics[name]
        try:
            if not 0 <= time < LATEST:
                raise ValueError
            if wanted is not None:
                message = bag.decode(raw, topic.type)
                stamp, rows = stamp_of(message), KINDS[topic.type].rows(message)
                topic.stamps.append(stamp)
                topic.rows.append(rows)
            topic.received.append(time)
        except Exception:  # whatever rosbags raises on a damaged message, or one of a type it does not know
            unreadable[name] += 1
    for name in names:
        there, recorded = len(topics[name].received) + unreadable[name], bag.counts.get(name, 0)
        if there < recorded:
            raise BadInput(f"{name} has {there} messages where {recorded} were recorded")
    left_out = (f"{name}: {n} messages cannot be read; they are left out" for name, n in unreadable.items() if n)
    return Content(topics, tuple(left_out))


# ---- Topics as series of numbers

MAX_STAMP_ERROR = 60.0  # [s] a header's stamp further from the time of receipt was not set by a clock of this run


class TopicInfo(NamedTuple):
    """Summary of a topic, by the times of receipt."""

    name: str
    type: str
    messages: int
    first: float  # [s] since the epoch; nan where there is no message
    last: float
    rate: float  # [1/s] mean; nan with fewer than two messages
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
    """Return a summary of each topic of a bag, and warnings of what could not be read."""
    content, found = read_content(path, None), []
    for name, topic in sorted(content.topics.items()):
        time = np.sort(topic.received) / 1e9
        first, last = (float(time[0]), float(time[-1])) if len(time) else (np.nan, np.nan)
        rate = (len(time) - 1) / (last - first) if last > first else np.nan
        columns = KINDS[topic.type].columns if topic.type in KINDS else ()
        found.append(TopicInfo(name, topic.type, len(time), first, last, rate, columns))
    return found, content.warnings


def read_topics(
    path: Path, names: Collection[str], all_there: bool = True
) -> tuple[dict[str, TopicSeries], tuple[str, ...]]:
    """Read the numbers of topics, and warnings of what is wrong; without `all_there`, of the topics that exist."""
    content = read_content(path, names)
    for name in names if all_there else ():
        if name not in content.topics:
            raise BadInput(f"{path}: there is no topic {name!r}; {nearest(name, list(content.topics))}")
    topics = {name: content.topics[name] for name in content.topics if name in names}
    for name, topic in topics.items():
        if topic.type not in KINDS:
            known = ", ".join(KINDS)
            raise BadInput(f"{path}: topic {name} has type {topic.type}, which is not read; types that are: {known}")
    # How far [ns] headers are behind the recorder's clock, if one of the two was not set.
    both = [list(zip(topic.stamps, topic.received, strict=True)) for topic in content.topics.values()]
    behind = [np.median([received - own for own, received in pairs if own is not None])
              for pairs in both if any(own is not None for own, _ in pairs)]  # fmt: skip
    shift, warnings = int(np.median(behind)) if behind else 0, list(content.warnings)
    if abs(shift) <= MAX_STAMP_ERROR * 1e9:
        shift = 0
    else:
        warnings.append(
            f"header stamps are {shift / 1e9:.1f} s behind the recorder's clock; that was added to all of them"
        )
    series = {name: _series(name, topic, shift) for name, topic in topics.items()}
    return series, (*warnings, *(warning for one in series.values() for warning in one.warnings))


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


# ---- The topics that a table of a description means, and their numbers in SI units


def topics_of(source: schema.Source, robots: Sequence[str], others: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Yield (topic, robot, other) of all topics that a source may have; other is "" where the topic does not say."""
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
    """Return columns of a topic by their names."""
    if not set(names) <= set(series.columns):
        raise BadInput(
            f"topic {topic} has {', '.join(series.columns)}, not {', '.join(names)}; correct the topic in [{table}] of "
            "log.toml"
        )
    return series.values[:, [series.columns.index(name) for name in names]]


def values_of(topic: str, table: schema.ReadingColumns, series: TopicSeries) -> tuple[Array, Array]:
    """Return times and values (m, k) of one topic of measurements."""
    if isinstance(table, schema.SightingsTable):
        x, y, z = columns_of(topic, series, ("x [m]", "y [m]", "z [m]"), "sightings").T
        if series.type != "geometry_msgs/msg/PoseArray":
            return series.time, np.stack([np.hypot(x, y), np.arctan2(y, x)], -1)
        _, first, n = np.unique(series.time, return_index=True, return_counts=True)
        alone = first[n == 1]
        return series.time[alone], np.stack([np.hypot(x, z), np.arctan2(-x, z)], -1)[alone]
    values = series.values[:, :1].copy()
    if series.columns not in (("value",), ("range [m]",)):
        raise BadInput(f"topic {topic} has {', '.join(series.columns)}, not one number; correct the topic in log.toml")
    if isinstance(table, schema.RangesTable):
        values *= UNITS["m"][table.unit]
    elif isinstance(table, schema.RssiTable):
        values[values >= table.missing_from] = np.nan
    return series.time, values


# ---- The recordings of a team

ODOMETRY = {"velocity": TWIST, "pose": (POSE[0], POSE[1], POSE[3])}


def find_runs(data: Path, description: TeamDescription) -> dict[str, Path]:
    """Return the runs in a directory: itself, if it is a ROS 2 bag, else each bag in it, and each directory of bags.

    A directory of bags is one run, which was recorded in parts or by each robot.
    """
    if (data / "metadata.yaml").exists():
        return {data.resolve().name: data}
    found: dict[str, Path] = {}
    for path in sorted(data.iterdir()):
        holds = path.is_dir() and any(inside.suffix in ENDINGS for inside in path.rglob("*"))
        if holds or (path.is_file() and path.suffix in ENDINGS):
            found[path.name if holds or path.stem in found else path.stem] = path
    if not found:
        raise BadInput(f"{data}: no bag here; it needs files that end with {', '.join(ENDINGS)}")
    return found


def read_run(place: Path, name: str, description: TeamDescription) -> TeamLog:
    """Read one run; BadInput where a topic is of another type than its table needs."""
    d = description
    moves, poses = d.odometry_and_truth
    if moves.kind not in ODOMETRY:
        raise BadInput(f"{place}: a bag has odometry of kind {' or '.join(ODOMETRY)}, not {moves.kind!r}; correct kind")
    tables = [(kind, several, (*d.robots, *fixed.names)) for kind, several, fixed in reading_tables(d)]
    sources: list[tuple[schema.Source, Sequence[str]]] = [(moves, ()), (poses, ())]
    sources += [(source, others) for _, several, others in tables for source in several]
    wanted = {topic for source, others in sources for topic, _, _ in topics_of(source, d.robots, others)}
    found, told = read_topics(place, wanted, all_there=False)
    warnings = list(told)

    def by_robot(table: schema.Source, columns: Sequence[str], named: str) -> dict[str, Series]:
        ordered: dict[str, Series] = {}
        for topic, robot, _ in topics_of(table, d.robots, ()):
            if topic in found and len(found[topic].time):
                if robot in ordered:
                    both = f"{ordered[robot].source} and {topic}"
                    raise BadInput(f"robot {robot!r} has two topics in [{named}], {both}; choose")
                values = columns_of(topic, found[topic], columns, named)
                ordered[robot], notes = order_series(found[topic].time + table.clock_offset, values, topic)
                warnings.extend(notes)
        return ordered

    def measurements(table: schema.ReadingColumns, others: Sequence[str]) -> list[Measured]:
        """Without {other} in the topic, a robot measures its only teammate."""
        measured = []
        for topic, robot, other in topics_of(table, d.robots, others):
            if topic not in found:
                continue
            if not other and len(d.robots) != 2:
                raise BadInput(f"topic {topic} does not say what was measured; write it with {{other}} in log.toml")
            time, values = values_of(topic, table, found[topic])
            mate, m = other or next(name for name in d.robots if name != robot), len(time)
            measured.append(Measured(time + table.clock_offset, [robot] * m, [mate] * m, values, topic))
        if not measured:
            names = table.topic or ", ".join(table.topics.values())
            warnings.append(f"{place}: none of the topics {names} is in the bag")
        return measured

    odometry, truth = by_robot(moves, ODOMETRY[moves.kind], "odometry"), by_robot(poses, ODOMETRY["pose"], "truth")
    readings = {kind: [m for table in several for m in measurements(table, others)] for kind, several, others in tables}
    return build_log(place, name, d, odometry, truth, readings, warnings)
