"""Recovery of a damaged SQLite bag (.db3): message records are found in its bytes, wherever they lie.

Bags are cut off by a power failure, or have bytes missing or changed.

A row of the table `messages` is a cell in a page: length of its payload, row number, then the record: length of its
header, a code for each column (NULL, since the row number serves as id; the topic's number; 06, an integer of eight
bytes; the blob) and the columns. The header, the length, a topic's number that exists and a time within a day of the
others identify a cell without any page around it, so that bytes missing further up do no harm. Messages that are larger
than a page are lost.

Source: SQLite, "Database File Format", sections 1.6 and 2.1, https://www.sqlite.org/fileformat2.html.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rosbags.typesys import Stores

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.bag_storage import KINDS, Bag, Message, decode_ros2, typestore

REPAIRS = {".mcap": "mcap recover", ".bag": "rosbag reindex"}  # for the bags that are not SQLite

MESSAGE = re.compile(
    rb"(?=\x05\x00[\x01-\x04\x08\x09]\x06[\x0c-\x7f]"
    rb"|\x06\x00[\x01-\x04\x08\x09]\x06[\x80-\xff][\x00-\x7f]"
    rb"|\x07\x00[\x01-\x04\x08\x09]\x06[\x80-\xff]{2}[\x00-\x7f])"
)
# Of table `topics`: number, name, type, and the text "cdr" (code 13 + 2 * 3).
TOPIC = re.compile(rb"(?=[\x05-\x0f]\x00([\x80-\xff]?[\x00-\x7f])([\x80-\xff]?[\x00-\x7f])\x13)")
TOPIC_NAME, TYPE_NAME = re.compile(r"/[\w/~]*"), re.compile(r"\w+/(msg/)?\w+")
WIDTHS = {1: 1, 2: 2, 3: 3, 4: 4, 8: 0, 9: 0}  # bytes of an integer, by its code
DAY = 86_400 * 10**9  # [ns]


class MessageRow(NamedTuple):
    """The place of a row of `messages` in the file."""

    begin: int  # of the cell in the file
    row: int
    topic: int
    time: int  # [ns]
    data: int  # begin of the blob
    end: int  # of the blob


def recover(file: Path, reason: str) -> tuple[Bag, str]:
    """Return the messages still to be found in a storage file, and a warning of how many they are."""
    if file.suffix in REPAIRS:
        raise BadInput(f"{file}: cannot be read as a bag ({reason}); repair it by `{REPAIRS[file.suffix]}`")
    try:
        types, found, last = find_messages(file.read_bytes())
    except OSError as e:
        raise BadInput(f"{file}: cannot be read ({e.strerror}); get the file again") from None
    if not found:
        raise BadInput(f"{file}: cannot be read as a bag, and no message is found in it ({reason}); get the file again")
    warning = f"{file}: damaged: {len(found)} of {max(last, message_count(file))} messages recovered ({reason})"
    return Bag(types, {}, lambda topics: (m for m in found if m[0] in topics), decode_ros2), warning


def message_count(file: Path) -> int:
    """Return how many messages a bag had when it was closed, by its metadata; 0 where that is not known."""
    metadata = file.parent / "metadata.yaml"
    text = metadata.read_text("utf-8", "replace") if metadata.is_file() else ""
    counts = re.findall(r"^\s+message_count: (\d+)$", text, re.MULTILINE)
    return int(counts[0]) if counts and len(list(file.parent.glob("*.db3"))) == 1 else 0


def find_messages(raw: bytes) -> tuple[dict[str, str], list[Message], int]:
    """Return the type of each topic in the bytes of a .db3, the messages by row, and the number of the last row."""
    topics = _topics(raw)
    cells = [cell for cell in _rows(raw) if cell.topic in topics]
    middle = np.median([cell.time for cell in cells]) if cells else 0
    cells = [cell for cell in cells if abs(cell.time - middle) <= DAY]
    limits = [*(cell.begin for cell in cells), len(raw)][1:]  # a cell that the next one begins in is not whole
    messages: dict[int, Message] = {}
    for cell, limit in zip(cells, limits, strict=False):
        name, kind = topics[cell.topic]
        if cell.end <= limit and cell.row not in messages and _is_message(raw[cell.data : cell.end], kind):
            # Large images and clouds, which are not read, are not held in memory.
            messages[cell.row] = (name, cell.time, raw[cell.data : cell.end] if kind in KINDS else b"")
    return dict(topics.values()), [messages[row] for row in sorted(messages)], max(messages, default=0)


def _is_message(raw: bytes, kind: str) -> bool:
    """Return whether this can be a message of its type; True for types that are not standard."""
    if kind in typestore(Stores.LATEST).types:
        try:
            decode_ros2(raw, kind)
        except Exception:  # rosbags raises whatever its parsers raise
            return False
    return True


def _rows(raw: bytes) -> Iterator[MessageRow]:
    for match in MESSAGE.finditer(raw):
        record = match.start()
        size, width = raw[record], WIDTHS[raw[record + 2]]
        code = _varint(raw[record + 4 : record + size])
        if code % 2 or code < 12:
            continue
        body = record + size
        topic = int.from_bytes(raw[body : body + width], "big") if width else raw[record + 2] - 8
        data = body + width + 8
        end = data + (code - 12) // 2
        row = _begin_of_varint(raw, record)
        payload = _encode_varint(end - record)
        begin = row - len(payload)
        if begin >= 0 and raw[begin:row] == payload:
            time = int.from_bytes(raw[data - 8 : data], "big")
            yield MessageRow(begin, _varint(raw[row:record]), topic, time, data, end)


def _topics(raw: bytes) -> dict[int, tuple[str, str]]:
    """Return name and type by number, of every row of `topics` that is found."""
    topics: dict[int, tuple[str, str]] = {}
    for match in TOPIC.finditer(raw):
        at = match.start() + raw[match.start()]
        end = at + (_varint(match[1]) - 13) // 2
        stop = end + (_varint(match[2]) - 13) // 2
        name, kind = raw[at:end].decode("utf-8", "replace"), raw[end:stop].decode("utf-8", "replace")
        if TOPIC_NAME.fullmatch(name) and TYPE_NAME.fullmatch(kind) and raw[stop : stop + 3] == b"cdr":
            topics.setdefault(_varint(raw[_begin_of_varint(raw, match.start()) : match.start()]), (name, kind))
    return topics


def _begin_of_varint(raw: bytes, end: int) -> int:
    """Return the begin of the number that ends before `end`: all its bytes but the last are above 127."""
    begin = end - 1
    while begin > 0 and end - begin < 9 and raw[begin - 1] >= 0x80:
        begin -= 1
    return begin


def _varint(raw: bytes) -> int:
    """Return a number that SQLite wrote in seven bits a byte, big-endian."""
    value = 0
    for byte in raw:
        value = value << 7 | byte & 0x7F
    return value


def _encode_varint(value: int) -> bytes:
    digits = [value & 0x7F]
    while value := value >> 7:
        digits.append(value & 0x7F | 0x80)
    return bytes(reversed(digits))
