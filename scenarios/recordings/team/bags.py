"""ROS 1 bags, ROS 2 bags and MCAP, read without ROS by rosbags (https://gitlab.com/ternaris/rosbags)."""

from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Indices
from cooploc.estimators.plugins.errors import BadInput, nearest
from cooploc.scenarios.recordings.team.bag_content import Topic, read_content
from cooploc.scenarios.recordings.team.messages import KINDS
from cooploc.scenarios.recordings.text_tables import LARGEST

SILENCE = 5.0  # mean intervals between messages, and more of them than this are a gap
MAX_STAMP_ERROR = 60.0  # [s] a header's stamp further from the time of receipt was not set by a clock of this run


class TopicInfo(NamedTuple):
    """What a topic holds, by the times of receipt."""

    name: str
    type: str
    count: int
    first: float  # [s] since the epoch; nan where there is no message
    last: float
    rate: float  # [1/s] mean; nan with fewer than two messages
    gaps: tuple[tuple[float, float], ...]  # begin and length [s] of each silence of more than `SILENCE` intervals
    columns: tuple[str, ...]  # what `read_topics` gives; empty for a type that is not read


class TopicSeries(NamedTuple):
    """The numbers of one topic."""

    time: Array  # (m,) does not fall [s]
    values: Array  # (m, k)
    columns: tuple[str, ...]
    clock: str  # "header" or "receipt": whose stamps `time` are
    warnings: tuple[str, ...]


def topics(path: Path) -> tuple[list[TopicInfo], tuple[str, ...]]:
    """What a bag holds, by topic, and warnings of what could not be read.

    Raises:
        BadInput: there is no bag, or nothing can be read of it.

    """
    content = read_content(path, None)
    found = [_info(name, topic.type, np.sort(topic.received) / 1e9) for name, topic in sorted(content.topics.items())]
    return found, content.warnings


def read_series(path: Path, topic: str) -> TopicSeries:
    """One topic; see `read_topics`."""
    return read_topics(path, [topic])[0][topic]


def read_topics(path: Path, names: Collection[str]) -> tuple[dict[str, TopicSeries], tuple[str, ...]]:
    """The numbers of some topics, in one pass over the bag, and warnings of what is wrong with the bag.

    Raises:
        BadInput: there is no bag or nothing can be read of it, or a topic is not there or of a type that is not read.

    """
    content = read_content(path, names)
    for name in names:
        if name not in content.topics:
            raise BadInput(f"{path}: there is no topic {name!r}; {nearest(name, list(content.topics))}")
        kind = content.topics[name].type
        if kind not in KINDS:
            raise BadInput(f"{path}: topic {name} has type {kind}, which is not read; types that are: {', '.join(KINDS)}")
    return {name: _series(name, content.topics[name]) for name in names}, content.warnings


def _series(name: str, topic: Topic) -> TopicSeries:
    """By rising time. Rows with a number that cannot be a measurement are left out."""
    received = np.array(topic.received, np.int64)
    time, clock, warnings = _clock(name, received, topic.stamps)
    columns = KINDS[topic.type].columns
    time = np.repeat(time, [len(rows) for rows in topic.rows])
    values = np.array([row for rows in topic.rows for row in rows], float).reshape(-1, len(columns))
    # A heading is nan where the orientation was never set; nothing else may be.
    bad = ~(np.abs(values) <= LARGEST) & ~(np.isnan(values) & (np.array(columns) == "heading [rad]"))
    good = ~bad.any(1)
    if not good.all():
        warnings = (*warnings, f"{name}: {(~good).sum()} messages hold a number that is not finite; they are left out")
    order = np.argsort(time[good], kind="stable")
    return TopicSeries(time[good][order], values[good][order], columns, clock, warnings)


def _clock(name: str, received: Indices, stamps: list[int | None]) -> tuple[Array, str, tuple[str, ...]]:
    """The times [s] to believe: the headers' where they are set and near the times of receipt, else those."""
    own = np.array([time if stamp is None else stamp for time, stamp in zip(received, stamps, strict=True)], np.int64)
    error = np.abs(own - received) / 1e9
    if all(stamp is None for stamp in stamps):
        return received / 1e9, "receipt", ()
    if np.median(error) > MAX_STAMP_ERROR:
        said = f"{name}: header stamps are {np.median(error):.0f} s from the times of receipt; the latter are used"
        return received / 1e9, "receipt", (said,)
    lost = (error > MAX_STAMP_ERROR) | np.array([stamp is None for stamp in stamps])
    said = (f"{name}: {lost.sum()} messages without a header stamp to believe; their time of receipt is used",)
    return np.where(lost, received, own) / 1e9, "header", said if lost.any() else ()


def _info(name: str, kind: str, time: Array) -> TopicInfo:
    first, last = (float(time[0]), float(time[-1])) if len(time) else (np.nan, np.nan)
    rate = (len(time) - 1) / (last - first) if last > first else np.nan
    silent = np.flatnonzero(np.diff(time) * rate > SILENCE)
    gaps = tuple((float(time[i]), float(time[i + 1] - time[i])) for i in silent)
    columns = KINDS[kind].columns if kind in KINDS else ()
    return TopicInfo(name, kind, len(time), first, last, rate, gaps, columns)
