"""What a search through the bytes of a damaged bag gives, and which messages count as found."""

from mmap import mmap
from typing import Any, NamedTuple

from rosbags.typesys import Stores

from cooploc.scenarios.recordings.team.bag_files import Message, typestore
from cooploc.scenarios.recordings.team.messages import KINDS

Buffer = bytes | mmap


class Found(NamedTuple):
    """Messages in the order of the file, each once."""

    types: dict[str, str]  # topic -> message type
    messages: list[Message]
    known: int = 0  # messages that there were at least; 0 where the file does not say


def decode_ros1(raw: bytes, kind: str) -> Any:
    """A message of ROS 1."""
    return typestore(Stores.ROS1_NOETIC).deserialize_ros1(raw, kind)


def decode_ros2(raw: bytes, kind: str) -> Any:
    """A message of ROS 2 by the definitions of Humble, or of today (sensor_msgs/Range got a field in between)."""
    try:
        return typestore(Stores.ROS2_HUMBLE).deserialize_cdr(raw, kind)
    except Exception:  # rosbags raises whatever its parsers raise
        return typestore(Stores.LATEST).deserialize_cdr(raw, kind)


def readable(raw: bytes, kind: str, ros1: bool = False) -> bool:
    """Whether this is a message of its type; of types that are not standard, nobody can say that it is not."""
    if kind not in typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST).types:
        return True
    try:
        (decode_ros1 if ros1 else decode_ros2)(raw, kind)
    except Exception:  # as above
        return False
    return True


def kept(raw: bytes, kind: str) -> bytes:
    """The content of a message, if its type is read; large images and clouds are not held in memory."""
    return raw if kind in KINDS else b""
