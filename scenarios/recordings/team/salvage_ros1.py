"""The records of a ROS 1 bag, one after the other: of a recorder that was killed, which left no index.

A record is a header (fields "name=value", each with its length) and data, each with its length. The data of a chunk are
records again. Where no record is where it should be, the search goes on at the next field "op".

Source: ROS wiki, "Bags/Format/2.0", http://wiki.ros.org/Bags/Format/2.0.
"""

import re
from collections.abc import Iterator, Mapping
from struct import error, unpack_from

from rosbags.rosbag1.reader import decompressors
from rosbags.typesys.msg import normalize_msgtype

from cooploc.scenarios.recordings.team.bag_files import Message
from cooploc.scenarios.recordings.team.found import Buffer, Found, kept, readable

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, CHUNK, CONNECTION = 2, 5, 7
OPERATION = re.compile(rb"\x04\x00\x00\x00op=")
LONGEST = 65_536  # bytes of a header
BACK = 256  # bytes from the begin of a header to its field "op", at most


def scan_ros1(raw: Buffer) -> Found:
    """All messages in the bytes of a .bag file."""
    connections: dict[int, tuple[str, str]] = {}  # number -> topic, type
    messages: dict[Message, None] = {}  # an ordered set
    for header, data in _records(raw, len(MAGIC)):
        try:
            if header["op"][0] == CONNECTION:
                kind = normalize_msgtype(_fields(data)["type"].decode())
                number = unpack_from("<I", header["conn"])[0]
                connections.setdefault(number, (header["topic"].decode(), kind))  # repeated at the end of the file
            elif header["op"][0] == MESSAGE:
                topic, kind = connections[unpack_from("<I", header["conn"])[0]]
                seconds, rest = unpack_from("<II", header["time"])
                if readable(data, kind, ros1=True):
                    messages[topic, seconds * 10**9 + rest, kept(data, kind)] = None
        except (error, KeyError, ValueError):  # a damaged record
            continue
    return Found(dict(connections.values()), list(messages))


def _records(raw: Buffer, at: int) -> Iterator[tuple[Mapping[str, bytes], bytes]]:
    """Header and data of every record from a place on; chunks are opened."""
    while at < len(raw):
        found = _record(raw, at)
        if not found or (found[2] < len(raw) and not _record(raw, found[2])):
            place = _next(raw, at + 1)
            if place is None:
                return
            at = place
            continue
        header, begin, at = found
        yield from _opened(header, raw[begin:at]) if header["op"][0] == CHUNK else [(header, raw[begin:at])]


def _record(raw: Buffer, at: int) -> tuple[Mapping[str, bytes], int, int] | None:
    """Header of the record at a place, begin and end of its data; None where there is no record."""
    try:
        (length,) = unpack_from("<I", raw, at)
        if length > LONGEST:
            return None
        header = _fields(raw[at + 4 : at + 4 + length])
        begin: int = at + 8 + length
        end: int = begin + unpack_from("<I", raw, begin - 4)[0]
    except (error, ValueError):
        return None
    return (header, begin, end) if len(header.get("op", b"")) == 1 and end <= len(raw) else None


def _next(raw: Buffer, at: int) -> int | None:
    """Where the next record begins: somewhat before a field "op" that makes a header with what is around it."""
    for match in OPERATION.finditer(raw, at):
        for begin in range(match.start() - 4, max(match.start() - BACK, at) - 1, -1):
            if _record(raw, begin):
                return begin
    return None


def _opened(header: Mapping[str, bytes], chunk: bytes) -> Iterator[tuple[Mapping[str, bytes], bytes]]:
    """The records of a chunk; of one that does not decompress, none."""
    try:
        content = decompressors[header["compression"].decode()](chunk)
    except Exception:  # the decompressors raise errors of their own
        return iter(())
    return _records(content, 0)


def _fields(raw: bytes) -> dict[str, bytes]:
    """Fields of a header; ValueError or struct.error where it is none."""
    fields: dict[str, bytes] = {}
    at = 0
    while at < len(raw):
        (length,) = unpack_from("<I", raw, at)
        name, mark, value = raw[at + 4 : at + 4 + length].partition(b"=")
        if not mark or at + 4 + length > len(raw):
            raise ValueError
        fields[name.decode()] = value
        at += 4 + length
    return fields
