"""The files of a ROS bag, opened by rosbags.

A bag is a ROS 1 file (.bag), a ROS 2 directory with metadata.yaml, or one of its storage files (.db3, .mcap). A
directory may also hold several of them, one a robot: they are read as one.

rosbags compiles the message definitions inside a bag; bags without any are older than ROS 2 Iron, so Humble's serve.
"""

from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore
from ruamel.yaml import YAML

from cooploc.estimators.errors import BadInput

ENDINGS = (".bag", ".db3", ".mcap")
Message = tuple[str, int, bytes]  # topic, time of receipt [ns], content


class Bag(NamedTuple):
    """An open bag, or what was salvaged of one."""

    types: dict[str, str]  # topic -> message type
    counts: dict[str, int]  # topic -> number of messages
    messages: Callable[[Collection[str]], Iterable[Message]]  # of these topics
    decode: Callable[[bytes, str], Any]  # content and type; raises where it is not a message of that type


class Index(NamedTuple):
    """What metadata.yaml says of a ROS 2 bag."""

    messages: int
    first: int  # [ns]
    last: int


@cache
def typestore(store: Stores) -> Typestore:
    """Standard message types of a ROS version."""
    return get_typestore(store)


def bag_paths(path: Path) -> list[Path]:
    """The bags at a path: itself, or what a directory holds.

    Raises:
        BadInput: there is none.

    """
    if not path.exists():
        raise BadInput(f"{path}: there is no such file or directory; name a bag (.bag, .db3, .mcap or its directory)")
    if path.is_file() or (path / "metadata.yaml").exists():
        return [path]
    return _required(path, [p for p in path.iterdir() if p.suffix in ENDINGS or (p / "metadata.yaml").exists()])


def storage_files(bag: Path) -> list[Path]:
    """The files that hold the messages of one bag.

    Raises:
        BadInput: there is none, or this file is not a bag.

    """
    return _required(bag, [p for p in (bag.iterdir() if bag.is_dir() else [bag]) if p.suffix in ENDINGS])


def _required(path: Path, found: list[Path]) -> list[Path]:
    if not found:
        raise BadInput(f"{path}: no bag here; it needs files that end with .bag, .db3 or .mcap")
    return sorted(found)


@contextmanager
def opened(path: Path) -> Iterator[Bag]:
    """An intact bag. Raises whatever rosbags raises on a damaged one (it does not promise a class of its own)."""
    with AnyReader([path], default_typestore=typestore(Stores.ROS2_HUMBLE)) as reader:
        counts: dict[str, int] = {}
        for c in reader.connections:
            counts[c.topic] = counts.get(c.topic, 0) + c.msgcount

        def messages(topics: Collection[str]) -> Iterator[Message]:
            chosen = [c for c in reader.connections if c.topic in topics]
            for connection, time, raw in reader.messages(chosen) if chosen else ():
                yield connection.topic, time, raw

        yield Bag({c.topic: c.msgtype for c in reader.connections}, counts, messages, reader.deserialize)


def write_ahead_log(file: Path) -> Path | None:
    """SQLite's log of messages that are not in the file yet, as a recorder that was killed leaves it."""
    log = file.with_name(f"{file.name}-wal")
    return log if log.is_file() and log.stat().st_size else None


def read_index(bag: Path) -> Index | None:
    """What metadata.yaml in or beside a bag says, or None where it cannot be read."""
    file = (bag if bag.is_dir() else bag.parent) / "metadata.yaml"
    try:
        known = YAML(typ="safe").load(file.read_text())["rosbag2_bagfile_information"]
        first = int(known["starting_time"]["nanoseconds_since_epoch"])
        return Index(int(known["message_count"]), first, first + int(known["duration"]["nanoseconds"]))
    except Exception:  # anything may be wrong with a damaged file, and nothing depends on it
        return None
