"""The files of a ROS bag, opened by rosbags (https://gitlab.com/ternaris/rosbags), and the messages that are read.

A bag is a ROS 1 file (.bag), a ROS 2 directory with metadata.yaml, or one of its storage files (.db3, .mcap). A
directory may also hold several of them, parts of one recording or one of each robot: they are read as one.

ROS 1 and ROS 2 give the types that are read the same fields (REP 103: SI units, x forward, y left). A robot that drives
on a floor needs x, y and heading; z stays, as a radio or a marker sits at some height.

Source: the message definitions of std_msgs, geometry_msgs, nav_msgs and sensor_msgs,
https://github.com/ros2/common_interfaces.
"""

import dataclasses
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.text_files import NAMED_DATE, are_called_runs, files_below

METADATA = "metadata.yaml"
ENDINGS = (".bag", ".db3", ".mcap")
ODOMETRY = "nav_msgs/msg/Odometry"
EPOCH = 5 * 10**17  # [ns] in 1985: earlier stamps are of no clock of this world
NO_BAG = "{}: no bag here; it needs files that end with .bag, .db3 or .mcap"
Message = tuple[str, int, bytes]  # topic, time of receipt [ns], content
Row = tuple[Any, ...]  # numbers; of fields that log.toml names, the last may be names
POSE = ("x [m]", "y [m]", "z [m]", "heading [rad]")
TWIST = ("v [m/s]", "omega [rad/s]")


class Bag(NamedTuple):
    """An open bag, or what was recovered of one."""

    types: dict[str, str]  # topic -> message type
    counts: dict[str, int]  # topic -> number of messages that were recorded; empty where that is not known
    messages: Callable[[Collection[str]], Iterable[Message]]  # of these topics
    decode: Callable[[bytes, str], Any]  # content and type; raises where it is not a message of that type


@cache
def typestore(store: Stores) -> Typestore:
    """Return the standard message types of a ROS version."""
    return get_typestore(store)


def standard_types() -> Collection[str]:
    """Return the names of the message types that come with ROS."""
    return typestore(Stores.ROS2_HUMBLE).fielddefs


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag, by its ending or its metadata; whatever compressed its files, they end so."""
    return (path.is_file() and path.suffix.lower() in ENDINGS) or (path / METADATA).is_file()


def _overlap_in_time(groups: Collection[Sequence[Path]]) -> bool:
    """Return whether several intact bags, or parts of such, were recorded at the same time, as by each robot of a team.

    Clocks of a simulation begin at zero in each of its runs, and say nothing; nor do those of robots that do not know
    the date, but a robot's own bag does not have the odometry of two.
    """
    spans, odometry = [], list[set[str]]()
    for bags in groups if len(groups) > 1 else ():
        try:
            with AnyReader(bags, default_typestore=typestore(Stores.ROS2_HUMBLE)) as reader:
                spans.append((reader.start_time, reader.end_time))
                odometry.append({c.topic for c in reader.connections if c.msgtype == ODOMETRY})
        except Exception:  # rosbags raises whatever its parsers raise
            return False
    together = bool(spans) and EPOCH < max(begin for begin, _ in spans) < min(end for _, end in spans)
    return together and len(set.intersection(*odometry)) < 2


def bag_paths(path: Path) -> list[Path]:
    """Return the bags at a path: itself, or those in a directory, or else in its directories."""
    if not path.exists():
        raise BadInput(f"{path}: there is no such file or directory; name a bag (.bag, .db3, .mcap or its directory)")
    if path.is_file() or is_bag(path):
        return [path]
    inside = sorted(path.iterdir())
    found = [p for p in inside if is_bag(p)] or [bag for p in inside if p.is_dir() for bag in _bags_below(p)]
    if not found:
        raise BadInput(NO_BAG.format(path))
    return found


def _bags_below(folder: Path) -> list[Path]:
    if is_bag(folder):
        return [folder]
    there = sorted({at for file in files_below(folder) for at in (file, file.parent) if is_bag(at)})
    return [bag for bag in there if bag.parent not in there]


def bags_of_robots(path: Path) -> dict[Path, str]:
    """Return the bags at a path, each with the first part of the topics' names if each robot recorded its own.

    That part is the name of the bag, or of the directory in which the robot's bags are, without a date; where red_0 and
    red_1 are parts of one recording, without their numbers. It is "" of bags that do not overlap in time.
    """
    bags = bag_paths(path)
    tops = [bag.relative_to(path).parts[0] if bag != path else "" for bag in bags]
    names = [Path(top).stem if Path(top).suffix.lower() in ENDINGS else top for top in tops]
    groups: dict[str, list[Path]] = {}
    for number in ("$", r"[-_]\d+$"):
        groups = {}
        for bag, name in zip(bags, names, strict=True):
            groups.setdefault(re.sub(number, "", name), []).append(bag)
        of_runs = are_called_runs(groups) and not all(map(NAMED_DATE.fullmatch, groups))
        if not of_runs and _overlap_in_time(groups.values()):  # clocks of run1 and run2 may begin alike
            break
    else:
        return dict.fromkeys(bags, "")
    undated = {name: NAMED_DATE.sub("", name).replace("rosbag2", "").strip("-_. ") for name in groups}
    own = undated if len({*undated.values()} - {""}) == len(groups) else {name: name for name in groups}
    return {bag: "/" + re.sub(r"[^\w.-]+", "_", own[name]) for name, some in groups.items() for bag in some}


def storage_files(bag: Path) -> list[Path]:
    """Return the files that hold the messages of one bag."""
    found = sorted(p for p in (bag.iterdir() if bag.is_dir() else [bag]) if p.suffix in ENDINGS)
    if not found:
        raise BadInput(NO_BAG.format(bag))
    return found


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open an intact bag. Raises whatever rosbags raises on a damaged one (it does not promise a class of its own).

    rosbags compiles the message definitions inside a bag; bags without any are older than ROS 2 Iron: Humble's serve.
    """
    with AnyReader([path], default_typestore=typestore(Stores.ROS2_HUMBLE)) as reader:
        counts: dict[str, int] = {}
        for c in reader.connections:
            counts[c.topic] = counts.get(c.topic, 0) + c.msgcount

        def messages(topics: Collection[str]) -> Iterator[Message]:
            chosen = [c for c in reader.connections if c.topic in topics]
            for connection, time, raw in reader.messages(chosen) if chosen else ():
                yield connection.topic, time, raw

        yield Bag({c.topic: c.msgtype for c in reader.connections}, counts, messages, reader.deserialize)


def _pose(place: Any, q: Any) -> Row:
    """Return x, y, z, and the angle about z of a quaternion; nan where its fields are zero, as never set."""
    if not (q.x or q.y or q.z or q.w):
        return (place.x, place.y, place.z, np.nan)
    heading = np.arctan2(2 * (q.w * q.z + q.x * q.y), q.w**2 + q.x**2 - q.y**2 - q.z**2)
    return (place.x, place.y, place.z, float(heading))


NUMBERS = [f"std_msgs/msg/{kind}{bits}" for kind in ("Float", "Int", "UInt") for bits in (8, 16, 32, 64)]


class MessageKind(NamedTuple):
    """The numbers that are read of one type of message."""

    columns: tuple[str, ...]
    rows: Callable[[Any], list[Row]]  # of one message; one row, except of arrays


def _speeds(twist: Any) -> Row:
    return (twist.linear.x, twist.angular.z)


KINDS: Mapping[str, MessageKind] = {
    ODOMETRY: MessageKind(
        POSE + TWIST, lambda m: [_pose(m.pose.pose.position, m.pose.pose.orientation) + _speeds(m.twist.twist)]
    ),
    "geometry_msgs/msg/PoseStamped": MessageKind(POSE, lambda m: [_pose(m.pose.position, m.pose.orientation)]),
    "geometry_msgs/msg/PoseWithCovarianceStamped": MessageKind(
        POSE, lambda m: [_pose(m.pose.pose.position, m.pose.pose.orientation)]
    ),
    "geometry_msgs/msg/TransformStamped": MessageKind(
        POSE, lambda m: [_pose(m.transform.translation, m.transform.rotation)]
    ),
    "geometry_msgs/msg/Pose": MessageKind(POSE, lambda m: [_pose(m.position, m.orientation)]),
    "geometry_msgs/msg/Pose2D": MessageKind(POSE, lambda m: [(m.x, m.y, 0.0, m.theta)]),
    "geometry_msgs/msg/PointStamped": MessageKind(POSE, lambda m: [(m.point.x, m.point.y, m.point.z, np.nan)]),
    "geometry_msgs/msg/Twist": MessageKind(TWIST, lambda m: [_speeds(m)]),
    "geometry_msgs/msg/TwistStamped": MessageKind(TWIST, lambda m: [_speeds(m.twist)]),
    "geometry_msgs/msg/TwistWithCovarianceStamped": MessageKind(TWIST, lambda m: [_speeds(m.twist.twist)]),
    "geometry_msgs/msg/PoseArray": MessageKind(POSE, lambda m: [_pose(p.position, p.orientation) for p in m.poses]),
    "sensor_msgs/msg/Range": MessageKind(("range [m]",), lambda m: [(m.range,)]),
    **{name: MessageKind(("value",), lambda m: [(m.data,)]) for name in NUMBERS},
}


def field_rows(message: Any, fields: Sequence[str]) -> list[Row]:
    """Return fields of a message of any type: a row, or one for each element of an array (nodes.id, nodes.dis).

    Of one element of an array its number from 0 is the field (data.0).
    """
    columns = [_field_values(message, field.split(".")) for field in fields]
    m = max(map(len, columns))
    return list(zip(*(column * m if len(column) == 1 else column for column in columns), strict=True))


def _field_values(value: Any, path: Sequence[str]) -> list[Any]:
    if isinstance(value, list | tuple | np.ndarray):
        if path and path[0].isdigit():
            return _field_values(value[int(path[0])], path[1:])
        return [found for element in value for found in _field_values(element, path)]
    return _field_values(getattr(value, path[0]), path[1:]) if path else [value]


def fields_of(message: Any) -> dict[str, list[Any]]:
    """Return the numbers and words in a message by its fields, without constants; of headers the frame alone."""
    found: dict[str, list[Any]] = {}
    for name in (f.name for f in dataclasses.fields(message) if f.name != "__msgtype__" and not f.name.isupper()):
        value = getattr(message, name)
        if name == "header":
            found["header.frame_id"] = [value.frame_id]
            continue
        if isinstance(value, list | tuple | np.ndarray) and not len(value):
            found[name] = []
        for element in value[:64] if isinstance(value, list | tuple | np.ndarray) else [value]:
            inner = fields_of(element) if dataclasses.is_dataclass(element) else {"": [element]}
            for below, values in inner.items():
                found.setdefault(f"{name}.{below}".rstrip("."), []).extend(values)
    return found


def stamp_of(message: Any) -> int | None:
    """Return a message's own stamp [ns], or None where its type has no header or the stamp was never set."""
    first = next(iter(getattr(message, "transforms", ())), None)  # of tf2_msgs/TFMessage
    header = getattr(message, "header", None) or getattr(first, "header", None)
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec) or None if header else None


def decode_ros2(raw: bytes, kind: str) -> Any:
    """Return a message of ROS 2 by the definitions of Humble, or of today (sensor_msgs/Range got a field)."""
    try:
        return typestore(Stores.ROS2_HUMBLE).deserialize_cdr(raw, kind)
    except Exception:  # rosbags raises whatever its parsers raise
        return typestore(Stores.LATEST).deserialize_cdr(raw, kind)
