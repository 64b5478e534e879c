"""Recordings of a team in ROS bags (ROS 1, ROS 2, MCAP), read without ROS, as `log.toml` describes their topics.

A pose is in metres and radians and a speed in SI units, as ROS has it (REP 103); a number (std_msgs/Float32, Float64)
has the unit that the description says. What a camera saw (`[sightings]`) is a pose in the robot's frame, x forward
and y left, or a geometry_msgs/PoseArray in the camera's, z forward and x right, with one detection in a message.

Columns may be fields of messages of any type whose definition is in the bag, as those of a CSV file: `range =
"nodes.dis"`, `x = "poses.pose.position.x"` with `robot = "poses.name"`.
"""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from itertools import permutations, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput, nearest
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings import bag_storage, csv_files, schema
from cooploc.scenarios.recordings.bag_storage import KINDS, POSE, TWIST, Bag, Row
from cooploc.scenarios.recordings.schema import UNITS, TeamDescription
from cooploc.scenarios.recordings.sqlite_recovery import recover
from cooploc.scenarios.recordings.team_log import TeamLog, reading_tables
from cooploc.scenarios.recordings.text_files import LARGEST, files_below

LARGE = 10_000  # bytes of a message, such as an image, that is not compared with others
PICTURES = {f"sensor_msgs/msg/{kind}" for kind in ("Image", "CompressedImage", "PointCloud2")}  # are never read
LATEST = 2**62  # [ns] in the year 2116: later times of receipt are damaged


class Topic(NamedTuple):
    """The messages of one topic, in the order of the file."""

    type: str
    received: list[int]  # [ns]
    stamps: list[int | None]  # [ns] of the headers; empty unless the topic was asked for
    rows: list[list[Row]]  # of each message; empty unless the topic was asked for
    hashes: set[int]  # of messages, by which two recordings of one topic are known


class Fields(NamedTuple):
    """The fields that are read of a topic's messages; none for the numbers of `KINDS`."""

    numbers: tuple[str, ...] = ()
    names: tuple[str, ...] = ()  # who measured, what was measured


Content = tuple[dict[str, Topic], list[str]]  # topics by name, and warnings
Wanted = Mapping[str, Fields]  # by topic
EVERY_FIELD = Fields(("*",))
SAMPLE = 1000  # messages of a topic whose fields are looked at
MOST_KEPT = 1_000_000  # messages, of some 300 bytes each; of more, the last bag that was read
_read: ContextVar[dict[Path, list[tuple[Wanted, list[Content]]]] | None] = ContextVar("read", default=None)


@contextmanager
def keep_what_is_read() -> Iterator[None]:
    """Read a bag once for all that want the same topics of it, as the steps of an inspection do."""
    before = _read.set({})
    try:
        yield
    finally:
        _read.reset(before)


def read_content(path: Path, wanted: Wanted | None) -> Content:
    """Read all messages of the topics in `wanted`; or of all topics (None) only when they were received."""
    bags = bag_storage.bags_of_robots(path)
    if wanted is not None:
        wanted = {name.removeprefix(own): of for own in (*bags.values(), "") for name, of in wanted.items()}
    contents, warnings = dict[str, list[Mapping[str, Topic]]](), list[str]()
    for bag, own in bags.items():
        parts = _parts(bag, wanted) if wanted is None else _kept_parts(bag, wanted)
        contents.setdefault(own, []).extend(found for found, _ in parts)
        warnings += [line for _, told in parts for line in told]
    merged = {own: _merge(path, some) for own, some in contents.items()}
    return _merge(path, _distinguish_topics(merged)), list(dict.fromkeys(warnings))


def _merge(path: Path, contents: Sequence[Mapping[str, Topic]]) -> dict[str, Topic]:
    """Merge the topics of bags, or of parts of one."""
    topics: dict[str, Topic] = {}
    for name, topic in (item for content in contents for item in content.items()):
        known = topics.setdefault(name, Topic(topic.type, [], [], [], set()))
        if known.type != topic.type:
            raise BadInput(f"{path}: topic {name} has type {known.type} in one bag and {topic.type} in another")
        known.received.extend(topic.received)
        known.stamps.extend(topic.stamps)
        known.rows.extend(topic.rows)
        known.hashes.update(topic.hashes)
    return topics


def _distinguish_topics(contents: Mapping[str, Mapping[str, Topic]]) -> list[dict[str, Topic]]:
    """Return the topics of bags that robots recorded at the same time, those that several share named after the bags.

    /odom in red.bag and in blue.bag is /red/odom and /blue/odom. Of one topic that was recorded several times, as the
    truth may be by each robot, the longest recording stays. `contents` are the topics of each robot's bags.
    """
    named: dict[str, dict[str, Topic]] = {own: {} for own in contents}
    for name in dict.fromkeys(name for content in contents.values() for name in content):
        there = {own: content[name] for own, content in contents.items() if name in content}
        heard = {own: topic for own, topic in there.items() if topic.received}
        by_length = sorted(heard, key=lambda own: len(heard[own].received))
        if len(heard) < 2:
            for own, topic in there.items():
                named[own][name] = topic
        elif len(heard[by_length[0]].hashes & heard[by_length[-1]].hashes) > len(heard[by_length[0]].hashes) / 2:
            named[by_length[-1]][name] = heard[by_length[-1]]
        else:
            for own, topic in heard.items():
                named[own][own + name] = topic
    return [*named.values()]


def _kept_parts(bag: Path, wanted: Wanted) -> list[Content]:
    """Return `_parts` of a bag, from what was read of it already where that is kept and has all topics."""
    if (read := _read.get()) is None:
        return _parts(bag, wanted)
    for before, parts in read.get(bag, ()):
        there = {name for topics, _ in parts for name in topics}
        if all(before.get(name) == of for name, of in wanted.items() if name in there):
            return [_select(content, wanted) for content in parts]
    parts = _parts(bag, wanted)
    contents = [content for kept in (*read.values(), [(wanted, parts)]) for _, found in kept for content in found]
    if sum(len(topic.received) for topics, _ in contents for topic in topics.values()) > MOST_KEPT:
        read.clear()
    read.setdefault(bag, []).append((wanted, parts))
    return parts


def _select(content: Content, wanted: Wanted) -> Content:
    """Return what would have been read if these topics alone had been wanted."""
    topics, warnings = content
    others = tuple(f"{name}: " for name in topics if name not in wanted)
    chosen = {n: t if n in wanted else Topic(t.type, [], [], [], set()) for n, t in topics.items()}
    return chosen, [line for line in warnings if not line.startswith(others)]


def _parts(bag: Path, wanted: Wanted | None) -> list[Content]:
    """Read one bag; of a damaged one what can be recovered, and a warning for each file without any message."""
    try:
        for log in bag.parent.glob(f"{bag.name}-wal") if bag.is_file() else bag.glob("*-wal"):
            if log.stat().st_size:
                raise BadInput(f"{log.name} has more, of a killed recorder; `sqlite3 {log.name[:-4]} vacuum` adds it")
        with bag_storage.open_bag(bag) as whole:
            return [_collect(whole, wanted)]
    except Exception as e:  # rosbags raises whatever its parsers raise on damaged files
        reason = " ".join(f"{e}".split()).replace(f"{bag}/", "").replace(f"{bag.parent}/", "")[:200] or type(e).__name__
    found, lost = list[Content](), list[str]()
    for file in bag_storage.storage_files(bag):
        try:
            recovered, warning = recover(file, reason)
            found += [_collect(recovered, wanted), ({}, [warning])]
        except BadInput as e:
            lost.append(str(e))
    if not found:
        raise BadInput(lost[0])
    return [*found, ({}, lost)]


def _collect(bag: Bag, wanted: Wanted | None) -> Content:
    """Return the messages of a bag: of all topics, or those that are wanted and of a type that is read."""
    topics = {name: Topic(kind, [], [], [], set()) for name, kind in bag.types.items()}
    fields, names = wanted or {}, [name for name, kind in bag.types.items() if kind not in PICTURES]
    if wanted is not None:
        names = [n for n, kind in bag.types.items() if n in wanted and (kind in KINDS or wanted[n].numbers)]
    unreadable, unsampled = dict.fromkeys(names, 0), {*names}
    for name, time, raw in bag.messages(names):
        topic = topics[name]
        try:
            if not 0 <= time < LATEST:
                raise ValueError
            if wanted is not None:
                if (of := fields[name]) == EVERY_FIELD:
                    if len(raw) < LARGE and len(topic.rows) < SAMPLE:
                        topic.rows.append([tuple(bag_storage.fields_of(bag.decode(raw, topic.type)).items())])
                    elif len(topic.rows) == SAMPLE:  # which is enough
                        unsampled.discard(name)
                else:
                    message = bag.decode(raw, topic.type)
                    of_fields = bag_storage.field_rows(message, [*of.numbers, *of.names]) if of.numbers else None
                    rows = KINDS[topic.type].rows(message) if of_fields is None else of_fields
                    topic.stamps.append(bag_storage.stamp_of(message))
                    topic.rows.append(rows)
            topic.received.append(time)
            if len(raw) < LARGE:
                topic.hashes.add(hash(bytes(raw)))
        except Exception:  # whatever rosbags raises on a damaged message, or one of a type it does not know
            unreadable[name] += 1
        if not unsampled:
            break
    else:
        for name in names:
            there, recorded = len(topics[name].received) + unreadable[name], bag.counts.get(name, 0)
            if there < recorded:
                raise BadInput(f"{name} has {there} messages where {recorded} were recorded")
    return topics, [f"{name}: {n} messages cannot be read; they are left out" for name, n in unreadable.items() if n]


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

    name: str
    type: str
    time: Array  # (m,) does not fall [s]
    values: Array  # (m, k)
    columns: tuple[str, ...]
    clock: str  # "header" or "receipt": whose stamps `time` are
    names: Sequence[tuple[str, ...]] = ()  # (m,) of fields that hold names: who measured, what was measured

    def select(self, *names: str, table: str = "odometry") -> Array:
        """Return columns (m, k) by name, for a table of log.toml."""
        if not {*names} <= {*self.columns}:
            there, lacking = ", ".join(self.columns), ", ".join(names)
            raise BadInput(f"topic {self.name} has {there}, not {lacking}; correct the topic in [{table}] of log.toml")
        return self.values[:, [self.columns.index(name) for name in names]]


def topics(path: Path) -> tuple[list[TopicInfo], list[str]]:
    """Return a summary of each topic of a bag, and warnings of what could not be read."""
    (content, warnings), found = read_content(path, None), []
    for name, topic in sorted(content.items()):
        time = np.sort(topic.received) / 1e9
        first, last = (float(time[0]), float(time[-1])) if len(time) else (np.nan, np.nan)
        rate = (len(time) - 1) / (last - first) if last > first else np.nan
        columns = KINDS[topic.type].columns if topic.type in KINDS else ()
        found.append(TopicInfo(name, topic.type, len(time), first, last, rate, columns))
    return found, warnings


def read_topics(path: Path, names: Collection[str], all_there: bool = True) -> tuple[dict[str, TopicSeries], list[str]]:
    """Read the numbers of topics, and warnings of what is wrong; without `all_there`, of the topics that exist.

    `names` may be a mapping to the fields of messages that are read.
    """
    wanted = names if isinstance(names, Mapping) else dict.fromkeys(names, Fields())
    content, warnings = read_content(path, wanted)
    if all_there and (lost := next((name for name in names if name not in content), None)):
        raise BadInput(f"{path}: there is no topic {lost!r}; {nearest(lost, list(content))}")
    for name, fields in wanted.items():
        if fields.numbers and name in content and not any(content[name].rows):
            there = read_fields(path, [name]).get(name, {})
            empty = {array for array in there if not there[array] and not any(k.startswith(f"{array}.") for k in there)}
            named = (*fields.numbers, *fields.names)
            absent = [field for field in named if field not in there and field.split(".")[0] not in empty]
            if there and absent:
                known = nearest(absent[0], list(there))
                raise BadInput(f"{path}: messages of {name} have no field {absent[0]!r}; {known}")
    # How far [ns] headers are behind the recorder's clock, if one of the two was not set.
    behind = [
        np.median(late)
        for topic in content.values()
        if (late := [at - own for own, at in zip(topic.stamps, topic.received, strict=False) if own is not None])
    ]
    shift = int(np.median(behind)) if behind else 0
    if abs(shift) <= MAX_STAMP_ERROR * 1e9:
        shift = 0
    else:
        told = f"header stamps are {shift / 1e9:.1f} s behind the recorder's clock; that was added to all of them"
        warnings.append(told)
    series = {n: _series(path, n, content[n], shift, warnings, wanted[n]) for n in content if n in wanted}
    return series, warnings


def read_fields(path: Path, names: Collection[str]) -> dict[str, dict[str, list[Any]]]:
    """Return what the messages of topics hold, whatever their type: topic -> field -> numbers or words."""
    found: dict[str, dict[str, list[Any]]] = {}
    for name, topic in read_content(path, dict.fromkeys(names, EVERY_FIELD))[0].items():
        for field, values in (item for rows in topic.rows for row in rows for item in row):
            found.setdefault(name, {}).setdefault(field, []).extend(values)
    return found


def _series(path: Path, name: str, topic: Topic, shift: int, warnings: list[str], fields: Fields) -> TopicSeries:
    """By rising time. Rows with a number that cannot be a measurement are left out.

    The times are the headers' where they are set and near the times of receipt, else those.
    """
    if topic.type not in KINDS and not fields.numbers:
        known = ", ".join(kind for kind in KINDS if kind not in bag_storage.NUMBERS)
        remedy = f'name its fields, such as range = "FIELD"; types that need none: numbers of std_msgs, {known}'
        raise BadInput(f"{path}: topic {name} has type {topic.type}, which is not known; {remedy}")
    received, clock = np.array(topic.received, np.int64), "receipt"
    time, is_set = received / 1e9, np.array([stamp is not None for stamp in topic.stamps], bool)
    if is_set.any():
        own = np.where(is_set, np.array([stamp or 0 for stamp in topic.stamps], np.int64) + shift, received)
        error = np.abs(own - received) / 1e9
        lost, usual = ~is_set | (error > MAX_STAMP_ERROR), np.median(error)
        if usual > MAX_STAMP_ERROR:
            warnings.append(f"{name}: header stamps are {usual:.0f} s from the times of receipt; the latter are used")
        else:
            time, clock = np.where(lost, received, own) / 1e9, "header"
            if n := int(lost.sum()):
                warnings.append(
                    f"{name}: {n} messages without a header stamp to believe; their time of receipt is used"
                )
    columns = fields.numbers or KINDS[topic.type].columns
    time, rows = np.repeat(time, [len(rows) for rows in topic.rows]), [row for rows in topic.rows for row in rows]
    values = np.array([row[: len(columns)] for row in rows], float).reshape(-1, len(columns))
    # A heading is nan where the orientation was never set; nothing else may be.
    bad = ~(np.abs(values) <= LARGEST) & ~(np.isnan(values) & (np.array(columns) == "heading [rad]"))
    good = ~bad.any(1)
    if not good.all():
        warnings.append(f"{name}: {(~good).sum()} messages hold a number that is not finite; they are left out")
    order = np.argsort(time[good], kind="stable")
    rows = [rows[k] for k in np.flatnonzero(good)[order].tolist()] if fields.names else []
    names = [tuple(map(str, row[len(columns) :])) for row in rows]
    return TopicSeries(name, topic.type, time[good][order], values[good][order], columns, clock, names)


# ---- The recordings of a team

ODOMETRY = {"velocity": TWIST, "pose": (POSE[0], POSE[1], POSE[3])}


def find_runs(data: Path, _: TeamDescription | None = None) -> dict[str, Path]:
    """Return the runs in a directory: itself, if it is a ROS 2 bag, else each bag in it, and each directory of bags.

    A directory of bags is one run, which was recorded in parts or by each robot; so are bags of the same time, or
    directories of such.
    """
    inside, found = sorted(data.iterdir()), dict[str, Path]()
    with suppress(BadInput):  # where there is no bag
        if bag_storage.is_bag(data) or any(bag_storage.bags_of_robots(data).values()):
            return {data.resolve().name: data}
    for path in inside:
        below = {at for file in files_below(path) for at in (file, file.parent)} if path.is_dir() else set()
        if path.is_file() and bag_storage.is_bag(path):
            found[path.name if path.stem in found else path.stem] = path
        elif any(map(bag_storage.is_bag, below)):
            found[path.name] = path
    if not found:
        raise BadInput(f"{data}: no bag here; it needs files that end with {', '.join(bag_storage.ENDINGS)}")
    return found


def text_folders(run: Path) -> list[Path]:
    """Return the directories that may hold text files of a run of bags: its own, and that above."""
    return [run, run.parent] if run.is_dir() else [run.parent]


def topics_of(source: schema.Source, robots: Sequence[str], others: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Yield (topic, robot, other) of all topics that a source may have; other is "" where the topic does not say."""
    written = {
        name: list(dict.fromkeys([*(word for word, of in source.nodes.items() if of == name), name]))
        for name in (*robots, *others, "")
    }
    for robot in robots:
        pattern = source.topics.get(robot, source.topic)
        if pattern is None:
            continue
        if source.robot is not None and "{robot}" not in pattern:  # its messages say who measured
            yield pattern, "", ""
            return
        if "{robot}" not in pattern and robot not in source.topics and len(robots) > 1:
            raise BadInput(
                f'topic {pattern} is of which robot? Write {{robot}} in it, or topics = {{ {robot} = "..." }}'
            )
        for other in others if "{other}" in pattern else ("",):
            for a, b in product(written[robot], written[other]) if robot != other else ():
                yield pattern.replace("{robot}", a).replace("{other}", b), robot, other


def fields_named(table: schema.Source) -> Fields:
    """Return the fields of messages that a table names."""
    names = (table.robot, getattr(table, "other", None))
    numbers = tuple(field for column in csv_files.columns_of(table) if column for field in column.columns)
    return Fields(numbers, tuple(name.column for name in names if name)) if numbers else Fields()


def values_of(
    table: schema.Source, series: TopicSeries, columns: Sequence[schema.LogColumn | None]
) -> tuple[Array, Array]:
    """Return times and values (m, k) of one topic in SI units: of the fields that are named, or of its usual type."""
    if any(columns):
        return series.time, csv_files.in_si(series.values, columns)
    if isinstance(table, schema.SightingsTable):
        x, y, z = series.select("x [m]", "y [m]", "z [m]", table="sightings").T
        if series.type != "geometry_msgs/msg/PoseArray":
            return series.time, np.stack([np.hypot(x, y), np.arctan2(y, x)], -1)
        _, first, n = np.unique(series.time, return_index=True, return_counts=True)
        alone = first[n == 1]
        return series.time[alone], np.stack([np.hypot(x, z), np.arctan2(-x, z)], -1)[alone]
    if not isinstance(table, schema.ReadingColumns):
        name = "odometry" if isinstance(table, schema.Odometry) else "truth"
        return series.time, series.select(*ODOMETRY[getattr(table, "kind", "pose")], table=name)
    if series.columns not in (("value",), ("range [m]",)):
        there = ", ".join(series.columns)
        raise BadInput(f"topic {series.name} has {there}, not one number; correct the topic in log.toml")
    return series.time, series.values * (UNITS["m"][table.unit] if isinstance(table, schema.RangesTable) else 1.0)


def read_run(place: Path, name: str, description: TeamDescription) -> TeamLog:
    """Read one run; BadInput where a topic is of another type than its table needs."""
    return csv_files.read_tables(place, run_files(place, name, description))


def run_files(place: Path, name: str, description: TeamDescription) -> csv_files.RunFiles:
    """Return what gives the rows of each table of a run: of its topics, and of the text files beside."""
    d = description
    if d.moves.kind not in ODOMETRY and not d.moves.in_files and not fields_named(d.moves).numbers:
        kinds = " or ".join(ODOMETRY)
        raise BadInput(f"{place}: a bag has odometry of kind {kinds}, not {d.moves.kind!r}; correct kind")
    motion = [table for table in (d.odometry, d.turns, d.truth) if table]
    sources: list[tuple[schema.Source, Sequence[str]]] = [(table, ()) for table in motion]
    sources += [(table, (*d.robots, *fixed.names)) for _, tables, fixed in reading_tables(d) for table in tables]
    wanted: dict[Fields, dict[str, Fields]] = {Fields(): {}}
    for source, others in (pair for pair in sources if not pair[0].in_files):
        fields = fields_named(source)
        wanted.setdefault(fields, {}).update((t, fields) for t, _, _ in topics_of(source, d.robots, others))
    read = {fields: read_topics(place, topics, all_there=False) for fields, topics in wanted.items()}
    warnings = list(dict.fromkeys(line for _, lines in read.values() for line in lines))
    patterns = [re.sub(r"\{\w+\}", "*", (one.file or "").replace("[", "[[]")) for one, _ in sources if one.in_files]
    homes = [folder for folder in text_folders(place) if any(any(folder.glob(pattern)) for pattern in patterns)]
    mates = dict(permutations(d.robots, 2))  # of two, the only one

    def rows_of_topics(
        source: schema.Source, columns: Sequence[schema.LogColumn | None], others: Sequence[str]
    ) -> Iterator[csv_files.CsvRows]:
        fields, seen = fields_named(source), dict[str, str]()
        heard, is_reading = read[fields][0], isinstance(source, schema.ReadingColumns)
        for topic, robot, other in topics_of(source, d.robots, others):
            if topic not in heard or not (is_reading or len(heard[topic].time)):
                continue
            if robot in seen and not is_reading:
                raise BadInput(f"robot {robot!r} has two topics, {seen[robot]} and {topic}; choose in log.toml")
            seen[robot], series = topic, heard[topic]
            things = {**source.nodes, **getattr(source, "others", {})}
            named = source.robot is not None, getattr(source, "other", None) is not None
            if is_reading and not other and not named[1] and len(d.robots) != 2:
                raise BadInput(f"topic {topic} does not say what was measured; write it with {{other}} in log.toml")
            time, values = values_of(source, series, columns)
            who = [source.nodes.get(w[0], w[0]) for w in series.names] if named[0] else [robot] * len(time)
            what = [other or mates.get(one, "") for one in who]
            what = [things.get(w[-1], w[-1]) for w in series.names] if named[1] else what
            yield csv_files.CsvRows(
                topic, time[:, None], time + schema.values_of(source.clock_offset, who), who, what, values
            )
        first: dict[str, str] = {}  # robot -> the first of the topics that it may have, where none was heard
        for topic, robot, _ in topics_of(source, d.robots, others):
            if topic not in heard and robot not in seen:
                first.setdefault(robot, topic)
        absent = [*first.values()][:1] * (not seen) if is_reading else [*first.values()]
        there = [info.name for info in topics(place)[0]] if absent else []
        warnings.extend(f"{place}: there is no topic {topic!r}; {nearest(topic, there)}" for topic in absent)

    home = homes[0] if homes else place.parent
    return csv_files.RunFiles(home, name, d, warnings, rows_of_topics)
