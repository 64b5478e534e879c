"""The records of an MCAP file, one after the other: without index or footer, and past bytes that are missing.

A record is a code, the length of its content in eight bytes, and the content. Where the next record is not where it
should be, the search goes on byte by byte; the records in a damaged chunk are found so too, unless it is compressed.

Source: the MCAP format specification, https://mcap.dev/spec.
"""

import re
from collections.abc import Iterator
from struct import error, unpack_from

from rosbags.rosbag2.storage_mcap import decompress

from cooploc.scenarios.recordings.team.bag_files import Message
from cooploc.scenarios.recordings.team.found import Buffer, Found, kept, readable

MAGIC = 8  # bytes at the begin, and again at the end
SCHEMA, CHANNEL, MESSAGE, CHUNK, LAST = 3, 4, 5, 6, 15
RECORD = re.compile(rb"(?=[\x01-\x0f].{4}\x00{4})", re.DOTALL)  # a code, and a length of less than 4 GB


def scan_mcap(raw: Buffer) -> Found:
    """All messages in the bytes of an .mcap file."""
    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}  # number -> topic, type
    messages: dict[Message, None] = {}  # an ordered set
    for code, content in _records(raw, MAGIC):
        try:
            if code == SCHEMA:
                schemas[unpack_from("<H", content)[0]] = _text(content, 2)
            elif code == CHANNEL:
                number, schema = unpack_from("<HH", content)
                channels.setdefault(number, (_text(content, 4), schemas[schema]))  # repeated at the end of the file
            elif code == MESSAGE:
                number, _, time, _ = unpack_from("<HIQQ", content)
                topic, kind = channels[number]
                if readable(content[22:], kind):
                    messages[topic, time, kept(content[22:], kind)] = None
        except (error, KeyError, UnicodeDecodeError):  # a damaged record
            continue
    return Found(dict(channels.values()), list(messages))


def _records(raw: Buffer, at: int) -> Iterator[tuple[int, bytes]]:
    """Code and content of every record from a place on; chunks are opened."""
    while at + 9 <= len(raw):
        end = _end(raw, at)
        if end is None or (_end(raw, end) is None and end < len(raw) - MAGIC):
            found = RECORD.search(raw, at + 1)
            if not found:
                return
            at = found.start()
            continue
        content = raw[at + 9 : end]
        yield from _opened(content) if raw[at] == CHUNK else [(raw[at], content)]
        at = end


def _end(raw: Buffer, at: int) -> int | None:
    """Where the record at a place ends, or None where there is no record."""
    if at + 9 > len(raw) or not 1 <= raw[at] <= LAST:
        return None
    end: int = at + 9 + unpack_from("<Q", raw, at + 1)[0]
    return end if end <= len(raw) else None


def _opened(chunk: bytes) -> Iterator[tuple[int, bytes]]:
    """The records of a chunk; of one that does not decompress, none."""
    try:
        size, crc = unpack_from("<QI", chunk, 16)
        compression = _text(chunk, 28)
        content = chunk[40 + len(compression) :]
        content = decompress(content, compression, size, crc) if compression else content
    except Exception:  # the decompressors raise errors of their own
        return iter(())
    return _records(content, 0)


def _text(content: bytes, at: int) -> str:
    (length,) = unpack_from("<I", content, at)
    return content[at + 4 : at + 4 + length].decode()
