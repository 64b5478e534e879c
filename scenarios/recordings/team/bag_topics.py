"""ROS 1 bags, ROS 2 bags and MCAP, read without ROS by rosbags (https://gitlab.com/ternaris/rosbags)."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput, nearest
from cooploc.estimators.interface import Array, Indices
from cooploc.scenarios.recordings.team.bag_content import Content, Topic, read_content
from cooploc.scenarios.recordings.team.messages import KINDS
from cooploc.scenarios.recordings.text_tables import LARGEST

SILENCE = 5.0  # mean intervals between messages, and more of them than this are a gap
MAX_STAMP_ERROR = 60.0  # [s] a header's stamp further from the time of receipt was not set by a clock of this run


class TopicInfo(NamedTuple):
    """What a topic holds, by the times of receipt."""

    name: str
    type: str
    messages: int
    first: float  # [s] since the epoch; nan where there is no message
    last: float
    rate: float  # [1/s] mean; nan with fewer than two messages
    gaps: tuple[tuple[float, float], ...]  # begin and length [s] of each silence of more than `SILENCE` intervals
    columns: tuple[str, ...]  # what `read_topics` gives; empty for a type that is not read


class TopicSeries(NamedTuple):
    """The numbers of one topic."""

    type: str
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
    return _numbers(path, names, content)


def read_present(path: Path, names: Collection[str]) -> tuple[dict[str, TopicSeries], tuple[str, ...]]:
    """As `read_topics`, of the topics that are there."""
    content = read_content(path, names)
    return _numbers(path, [name for name in content.topics if name in names], content)


def _numbers(path: Path, names: Collection[str], content: Content) -> tuple[dict[str, TopicSeries], tuple[str, ...]]:
    for name in names:
        kind = content.topics[name].type
        if kind not in KINDS:
            raise BadInput(
                f"{path}: topic {name} has type {kind}, which is not read; types that are: {', '.join(KINDS)}"
            )
    shift, warnings = _clock_shift(content.topics)
    series = {name: _series(name, content.topics[name], shift) for name in names}
    told = (w for one in series.values() for w in one.warnings)
    return series, (*content.warnings, *warnings, *told)


def _clock_shift(topics: Mapping[str, Topic]) -> tuple[int, tuple[str, ...]]:
    """How far [ns] the headers' clock is behind the recorder's, if one of them was not set; and a warning."""
    behind = [np.median(_ahead(t)) for t in topics.values() if any(stamp is not None for stamp in t.stamps)]
    shift = -int(np.median(behind)) if behind else 0
    if abs(shift) <= MAX_STAMP_ERROR * 1e9:
        return 0, ()
    said = f"header stamps are {shift / 1e9:.1f} s behind the recorder's clock; that was added to all of them"
    return shift, (said,)


def _ahead(topic: Topic) -> Indices:
    """Header stamps minus times of receipt [ns], where there is a stamp."""
    pairs = zip(topic.stamps, topic.received, strict=True)
    return np.array([stamp - received for stamp, received in pairs if stamp is not None], np.int64)


def _series(name: str, topic: Topic, shift: int) -> TopicSeries:
    """By rising time. Rows with a number that cannot be a measurement are left out."""
    time, clock, warnings = _times(name, topic, shift)
    columns = KINDS[topic.type].columns
    time = np.repeat(time, [len(rows) for rows in topic.rows])
    values = np.array([row for rows in topic.rows for row in rows], float).reshape(-1, len(columns))
    # A heading is nan where the orientation was never set; nothing else may be.
    bad = ~(np.abs(values) <= LARGEST) & ~(np.isnan(values) & (np.array(columns) == "heading [rad]"))
    good = ~bad.any(1)
    if not good.all():
        warnings = (*warnings, f"{name}: {(~good).sum()} messages hold a number that is not finite; they are left out")
    order = np.argsort(time[good], kind="stable")
    return TopicSeries(topic.type, time[good][order], values[good][order], columns, clock, warnings)


def _times(name: str, topic: Topic, shift: int) -> tuple[Array, str, tuple[str, ...]]:
    """The times [s] to believe: the headers' where they are set and near the times of receipt, else those."""
    received = np.array(topic.received, np.int64)
    if all(stamp is None for stamp in topic.stamps):
        return received / 1e9, "receipt", ()
    set_ = np.array([stamp is not None for stamp in topic.stamps])
    own = np.where(set_, np.array([stamp or 0 for stamp in topic.stamps], np.int64) + shift, received)
    error = np.abs(own - received) / 1e9
    if np.median(error) > MAX_STAMP_ERROR:
        said = f"{name}: header stamps are {np.median(error):.0f} s from the times of receipt; the latter are used"
        return received / 1e9, "receipt", (said,)
    lost = ~set_ | (error > MAX_STAMP_ERROR)
    said = f"{name}: {lost.sum()} messages without a header stamp to believe; their time of receipt is used"
    return np.where(lost, received, own) / 1e9, "header", (said,) if lost.any() else ()


def _info(name: str, kind: str, time: Array) -> TopicInfo:
    first, last = (float(time[0]), float(time[-1])) if len(time) else (np.nan, np.nan)
    rate = (len(time) - 1) / (last - first) if last > first else np.nan
    silent = np.flatnonzero(np.diff(time) * rate > SILENCE)
    gaps = tuple((float(time[i]), float(time[i + 1] - time[i])) for i in silent)
    columns = KINDS[kind].columns if kind in KINDS else ()
    return TopicInfo(name, kind, len(time), first, last, rate, gaps, columns)
