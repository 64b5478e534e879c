"""What can be saved of a bag that rosbags refuses: cut off by a power failure, with bytes missing or changed."""

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from mmap import ACCESS_READ, mmap
from pathlib import Path

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.team.bag_files import Bag, Index, Message, read_index, write_ahead_log
from cooploc.scenarios.recordings.team.found import Buffer, Found, decode_ros1, decode_ros2
from cooploc.scenarios.recordings.team.salvage_mcap import scan_mcap
from cooploc.scenarios.recordings.team.salvage_ros1 import scan_ros1
from cooploc.scenarios.recordings.team.salvage_sqlite import carve

SEARCHES: Mapping[str, Callable[[Buffer, Index | None], Found]] = {
    ".db3": carve,
    ".mcap": lambda raw, _: scan_mcap(raw),
    ".bag": lambda raw, _: scan_ros1(raw),
}


def salvaged(file: Path, reason: str) -> tuple[Bag, str]:
    """The messages still to be found in a storage file, and a warning of how many they are.

    Raises:
        BadInput: no message was found.

    """
    index = read_index(file)
    with _content(file, reason) as raw:
        found = SEARCHES[file.suffix](raw, index)
    if not found.messages:
        raise BadInput(f"{file}: cannot be read as a bag, and no message is found in it ({reason}); get the file again")
    counts = dict.fromkeys(found.types, 0)
    for topic, _, _ in found.messages:
        counts[topic] += 1

    def messages(topics: Collection[str]) -> Iterator[Message]:
        return (m for m in found.messages if m[0] in topics)

    total = max(index.messages if index else found.known, len(found.messages))
    of = f"{len(found.messages)} of {total}" if index or found.known else f"{len(found.messages)}"
    warning = f"{file}: damaged: {of} messages recovered ({reason})"
    return Bag(found.types, counts, messages, decode_ros1 if file.suffix == ".bag" else decode_ros2), warning


@contextmanager
def _content(file: Path, reason: str) -> Iterator[Buffer]:
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
