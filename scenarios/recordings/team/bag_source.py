"""One table of a description against the topics of a bag: which topics it means, and their numbers in SI units."""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.logs.columns import UNITS
from cooploc.scenarios.recordings.team import schema
from cooploc.scenarios.recordings.team.bag_topics import TopicSeries


def topics_of(source: schema.Source, robots: Sequence[str], others: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """(topic, robot, other) of all that a source may have; other is "" where the topic does not say."""
    written: dict[str, list[str]] = {}
    for word, name in source.nodes.items():
        written.setdefault(name, []).append(word)
    for robot in robots:
        pattern = source.topics.get(robot, source.topic)
        if pattern is None:
            continue
        if "{robot}" not in pattern and robot not in source.topics and len(robots) > 1:
            raise BadInput(
                f'topic {pattern} is of which robot? Write {{robot}} in it, or topics = {{ {robot} = "..." }}'
            )
        for other in others if "{other}" in pattern else ("",):
            for a, b in product(written.get(robot, [robot]), written.get(other, [other])) if robot != other else ():
                yield pattern.replace("{robot}", a).replace("{other}", b), robot, other


def columns_of(topic: str, series: TopicSeries, names: Sequence[str], table: str) -> Array:
    """Columns of a topic by their names.

    Raises:
        BadInput: its type has not got them.

    """
    if not set(names) <= set(series.columns):
        raise BadInput(
            f"topic {topic} has {', '.join(series.columns)}, not {', '.join(names)}; correct the topic in [{table}] of "
            "log.toml"
        )
    return series.values[:, [series.columns.index(name) for name in names]]


def values_of(topic: str, table: schema.Readings, series: TopicSeries) -> tuple[Array, Array]:
    """Times and values (m, k) of one topic of measurements."""
    if isinstance(table, schema.Sightings):
        x, y, z = columns_of(topic, series, ("x [m]", "y [m]", "z [m]"), "sightings").T
        if series.type != "geometry_msgs/msg/PoseArray":
            return series.time, np.stack([np.hypot(x, y), np.arctan2(y, x)], -1)
        _, first, n = np.unique(series.time, return_index=True, return_counts=True)
        alone = first[n == 1]
        return series.time[alone], np.stack([np.hypot(x, z), np.arctan2(-x, z)], -1)[alone]
    values = series.values[:, :1].copy()
    if series.columns not in (("value",), ("range [m]",)):
        raise BadInput(f"topic {topic} has {', '.join(series.columns)}, not one number; correct the topic in log.toml")
    if isinstance(table, schema.Ranges):
        values *= UNITS["m"][table.unit]
    elif isinstance(table, schema.Rssi):
        values[values >= table.missing_from] = np.nan
    return series.time, values
