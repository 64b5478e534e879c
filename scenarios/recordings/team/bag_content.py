"""The messages of a bag by topic: from rosbags where the bag is intact, salvaged where it is not."""

from collections.abc import Collection
from pathlib import Path
from typing import Any, NamedTuple

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.team.bag_files import Bag, bag_paths, opened, storage_files, write_ahead_log
from cooploc.scenarios.recordings.team.messages import KINDS, Row, stamp_of
from cooploc.scenarios.recordings.team.salvage import salvaged

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
