"""What readings are off by after the models of a run: residuals, where they were fitted and where they are judged."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.estimators.models import NEAR, LogDistance, Range, Sighting
from cooploc.scenarios.recordings.team.models import SENSED, How, TeamModels
from cooploc.scenarios.recordings.team.residuals import Part, residuals
from cooploc.scenarios.recordings.team.team_log import Channel, TeamLog


class Leftover(NamedTuple):
    """Readings of one link, less what the model expects."""

    what: str  # such as "range" or "landmark bearing"
    unit: str
    link: str  # such as "red - blue"
    fitted: bool  # whether the models were fitted on them; else they are of the part that is judged
    distance: Array  # (m,)  true [m]
    residual: Array  # (m,)
    sigma: float  # that filters are told


def leftovers(log: TeamLog, parts: Sequence[Part], judged: Part, models: TeamModels, how: How) -> Iterator[Leftover]:
    """Residuals by channel, part and link; sightings as range and as bearing."""
    for channel in log.readings:
        for fitted, of in ((True, parts), (False, [judged])):
            r = residuals(of, channel, log.robots, how.tick, how.gaps)
            for what, unit, e, sigma in _errors(channel, r.distance, r.z, models):
                for link in np.unique(r.link):
                    mine = (r.link == link) & np.isfinite(e)
                    i, j, name = _link(log, channel, int(link))
                    bias = models.bias[channel][i, j] if channel in models.bias else 0.0
                    yield Leftover(what, unit, name, fitted, r.distance[mine], e[mine] - bias, sigma)


def _errors(channel: Channel, distance: Array, z: Array, models: TeamModels) -> Iterator[tuple[str, str, Array, float]]:
    """(what, unit, residuals (m,), sigma) before any bias."""
    name, sensor = channel.replace("_", " "), models.sensors[SENSED.get(channel, channel)]
    if isinstance(sensor, Range):
        yield name, "m", z[:, 0] - distance, sensor.sigma
    elif isinstance(sensor, LogDistance):
        expected = sensor.A - 10 * sensor.eta * np.log10(np.maximum(distance, NEAR))
        yield name.replace("rssi", "RSSI"), "dB", z[:, 0] - expected, sensor.sigma
    elif isinstance(sensor, Sighting):
        yield f"{name} range", "m", z[:, 0] - distance, sensor.sigma_range
        yield f"{name} bearing", "rad", z[:, 1], sensor.sigma_bearing


def _link(log: TeamLog, channel: Channel, link: int) -> tuple[int, int, str]:
    """Robot, other, and both names."""
    fixed = {"landmark": log.landmarks, "anchor_rssi": log.anchors, "anchor_range": log.anchors}.get(channel)
    others = log.robots if fixed is None else fixed.names
    i, j = divmod(link, max(len(log.robots), len(others)))
    return i, j, f"{log.robots[i]} - {others[j]}"
