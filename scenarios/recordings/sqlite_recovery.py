"""Recovery of a damaged SQLite bag (.db3): message records are found in its bytes, wherever they lie.

Bags are cut off by a power failure, or have bytes missing or changed.

A row of the table `messages` is a cell in a page: length of its payload, row number, then the record: length of its
header, a code for each column (NULL, since the row number serves as id; the topic's number; 06, an integer of eight
bytes; the blob) and the columns. The header, the length, a topic's number that exists and a time within the recording
identify a cell without any page around it, so that bytes missing further up do no harm.

Source: SQLite, "Database File Format", sections 1.5 (overflow pages), 1.6 and 2.1, https://www.sqlite.org/fileformat2.html.
"""

import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rosbags.typesys import Stores
from ruamel.yaml import YAML

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.bag_storage import KINDS, Bag, Message, decode_ros2, typestore, write_ahead_log

Buffer = bytes | mmap
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
MARGIN = 10 * 10**9  # [ns] around the span that metadata.yaml gives
DAY = 86_400 * 10**9  # [ns] around the median, where there is no metadata.yaml


class Index(NamedTuple):
    """The counts and times in the metadata.yaml of a ROS 2 bag."""

    messages: int
    first: int  # [ns]
    last: int


class Cell(NamedTuple):
    """The place of a row of `messages` in the file."""

    begin: int  # of the cell in the file
    record: int  # its header
    row: int
    topic: int
    time: int  # [ns]
    data: int  # begin of the blob
    length: int  # of the blob


def find_messages(raw: Buffer, index: Index | None) -> tuple[dict[str, str], list[Message], int]:
    """Find all messages in the bytes of a .db3 file (its write-ahead log may follow them).

    Returns:
        the type of each topic; the messages in the order of their rows; and how many there were at least.

    """
    topics = _topics(raw)
    cells = [cell for cell in _cells(raw) if cell.topic in topics]
    if cells:
        middle = int(np.median([cell.time for cell in cells]))
        first, last = (index.first - MARGIN, index.last + MARGIN) if index else (middle - DAY, middle + DAY)
        cells = [cell for cell in cells if first <= cell.time <= last]
    page = _page_size(raw)
    messages: dict[int, Message] = {}
    for cell, following in zip(cells, [*cells[1:], None], strict=True):
        name, kind = topics[cell.topic]
        data = _blob(raw, cell, page, following.begin if following else len(raw))
        if data is not None and cell.row not in messages and _is_message(data, kind):
            # Large images and clouds, which are not read, are not held in memory.
            messages[cell.row] = (name, cell.time, data if kind in KINDS else b"")
    return dict(topics.values()), [messages[row] for row in sorted(messages)], max(messages, default=0)


def _is_message(raw: bytes, kind: str) -> bool:
    """Return whether this can be a message of its type; True for types that are not standard."""
    if kind in typestore(Stores.LATEST).types:
        try:
            decode_ros2(raw, kind)
        except Exception:  # rosbags raises whatever its parsers raise
            return False
    return True


def _cells(raw: Buffer) -> Iterator[Cell]:
    for match in MESSAGE.finditer(raw):
        record = match.start()
        size, width = raw[record], WIDTHS[raw[record + 2]]
        code = _varint(raw[record + 4 : record + size])
        if code % 2 or code < 12:
            continue
        body, length = record + size, (code - 12) // 2
        topic = int.from_bytes(raw[body : body + width], "big") if width else raw[record + 2] - 8
        data = body + width + 8
        time = int.from_bytes(raw[data - 8 : data], "big")
        row = _number_before(raw, record)
        payload = _as_varint(data + length - record)
        begin = row - len(payload)
        if begin >= 0 and raw[begin:row] == payload:
            yield Cell(begin, record, _varint(raw[row:record]), topic, time, data, length)


def _blob(raw: Buffer, cell: Cell, page: int, limit: int) -> bytes | None:
    """The content of a cell, or None where it is not whole: the next cell, or the end of the file, is inside it.

    A large one continues on other pages, which are where their numbers say only if nothing is missing before them.
    """
    payload, most = cell.data + cell.length - cell.record, page - 35
    if payload <= most:
        end = cell.data + cell.length
        return raw[cell.data : end] if end <= limit else None
    least = (page - 12) * 32 // 255 - 23
    local = least + (payload - least) % (page - 4)
    end = cell.record + (local if local <= most else least)
    data, pointer = raw[cell.data : end], end
    while len(data) < cell.length:
        pointer = (int.from_bytes(raw[pointer : pointer + 4], "big") - 1) * page
        more = raw[pointer + 4 : pointer + page] if pointer > 0 else b""
        if not more:
            return None
        data += more
    return data[: cell.length]


def _page_size(raw: Buffer) -> int:
    """As the file says (reserved bytes are never used by ROS), else SQLite's default."""
    size = int.from_bytes(raw[16:18], "big")
    return size if size in {2**k for k in range(9, 16)} else 65536 if size == 1 else 4096


def _topics(raw: Buffer) -> dict[int, tuple[str, str]]:
    """Number -> name and type, of every row of `topics` that is found."""
    topics: dict[int, tuple[str, str]] = {}
    for match in TOPIC.finditer(raw):
        at = match.start() + raw[match.start()]
        end = at + (_varint(match[1]) - 13) // 2
        stop = end + (_varint(match[2]) - 13) // 2
        name, kind = raw[at:end].decode("utf-8", "replace"), raw[end:stop].decode("utf-8", "replace")
        if TOPIC_NAME.fullmatch(name) and TYPE_NAME.fullmatch(kind) and raw[stop : stop + 3] == b"cdr":
            topics.setdefault(_varint(raw[_number_before(raw, match.start()) : match.start()]), (name, kind))
    return topics


def _number_before(raw: Buffer, end: int) -> int:
    """Return the begin of the number that ends before `end`: all its bytes but the last are above 127."""
    begin = end - 1
    while begin > 0 and end - begin < 9 and raw[begin - 1] >= 0x80:
        begin -= 1
    return begin


def _varint(raw: bytes) -> int:
    """SQLite's big-endian numbers of seven bits a byte."""
    value = 0
    for byte in raw:
        value = value << 7 | byte & 0x7F
    return value


def _as_varint(value: int) -> bytes:
    digits = [value & 0x7F]
    while value := value >> 7:
        digits.append(value & 0x7F | 0x80)
    return bytes(reversed(digits))


def recover(file: Path, reason: str) -> tuple[Bag, str]:
    """Return the messages still to be found in a storage file, and a warning of how many they are.

    Raises:
        BadInput: no message was found, or another tool repairs this kind of bag.

    """
    if file.suffix in REPAIRS:
        raise BadInput(f"{file}: cannot be read as a bag ({reason}); repair it by `{REPAIRS[file.suffix]}`")
    index = _read_index(file)
    with _bytes_of(file, reason) as raw:
        types, found, known = find_messages(raw, index)
    if not found:
        raise BadInput(f"{file}: cannot be read as a bag, and no message is found in it ({reason}); get the file again")
    counts = dict.fromkeys(types, 0)
    for topic, _, _ in found:
        counts[topic] += 1

    def messages(topics: Collection[str]) -> Iterator[Message]:
        return (m for m in found if m[0] in topics)

    total = max(index.messages if index else known, len(found))
    warning = f"{file}: damaged: {len(found)} of {total} messages recovered ({reason})"
    return Bag(types, counts, messages, decode_ros2), warning


def _read_index(file: Path) -> Index | None:
    """Return what metadata.yaml beside a file says, or None where it cannot be read."""
    try:
        known = YAML(typ="safe").load((file.parent / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        first = int(known["starting_time"]["nanoseconds_since_epoch"])
        return Index(int(known["message_count"]), first, first + int(known["duration"]["nanoseconds"]))
    except Exception:  # anything may be wrong with a damaged file, and nothing depends on it
        return None


@contextmanager
def _bytes_of(file: Path, reason: str) -> Iterator[Buffer]:
    """A file's bytes, mapped rather than loaded: bags are large."""
    try:
        log = write_ahead_log(file)
        if log:
            yield file.read_bytes() + log.read_bytes()
            return
        with file.open("rb") as f, mmap(f.fileno(), 0, access=ACCESS_READ) as raw:
            yield raw
    except (OSError, ValueError):  # mmap's word for an empty file
        raise BadInput(f"{file}: empty, or cannot be read ({reason}); get the file again") from None
