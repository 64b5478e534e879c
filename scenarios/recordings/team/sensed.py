"""What a team sensed, on the grid of ticks, as estimators get it."""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Mask
from cooploc.scenarios.recordings.team.sampling import Grid, cells, in_turn
from cooploc.scenarios.recordings.team.team_log import READING_COLUMNS, Channel, TeamLog
from cooploc.scenarios.stream import Air


class Sensed(NamedTuple):
    """Readings of every channel, (1, T, n, ...); width 0 where a channel does not exist."""

    anchor_rssi: Array
    landmark: Array
    sighting: Array
    extra: dict[str, Array]  # anchor_range (1, T, n, a) [m]
    air: Air
    counts: dict[str, Any]  # by channel


def sensed(
    log: TeamLog,
    grid: Grid,
    bias: Mapping[Channel, Array],
    ranges_go_to: Literal["both", "measurer"],
    packets: Literal["every tick", "with a reading"],
) -> Sensed:
    """Readings at the tick nearest to their stamps, ranges less their `bias` (n, others) [m]."""
    n, tables = len(log.robots), {}
    counts: dict[str, Any] = {}
    for channel, readings in log.readings.items():
        others = _others(log, channel)
        given = in_turn(readings) if channel == "range" and ranges_go_to == "both" else readings
        if channel in bias:
            given = given._replace(values=given.values - bias[channel][given.robot, given.other][:, None])
        tables[channel], counts[channel] = cells(given, grid, n, others)

    def table(channel: Channel) -> Array:
        nothing = np.empty((grid.ticks, n, 0, len(READING_COLUMNS[channel])))
        return tables.get(channel, nothing)[None]

    ranges, rssi = table("range")[..., 0], table("rssi")[..., 0]
    link = np.broadcast_to(~np.eye(n, dtype=bool), (1, grid.ticks, n, n)).copy()
    if packets == "with a reading":
        link &= _measured(ranges, link) | _measured(rssi, link)
    extra = {"anchor_range": table("anchor_range")[..., 0]} if "anchor_range" in tables else {}
    anchor_rssi = table("anchor_rssi")[..., 0]
    return Sensed(anchor_rssi, table("landmark"), table("sighting"), extra, Air(link, rssi, ranges), counts)


def _others(log: TeamLog, channel: Channel) -> int:
    """How many things a channel can be a reading of."""
    fixed = {"landmark": log.landmarks, "anchor_rssi": log.anchors, "anchor_range": log.anchors}.get(channel)
    return len(log.robots) if fixed is None else len(fixed.names)


def _measured(table: Array, link: Mask) -> Mask:
    """Where a channel has a reading; nowhere if it does not exist."""
    return np.isfinite(table) if table.shape[-1] else np.zeros_like(link)
