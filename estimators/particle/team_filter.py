"""A robot's own particle filter in any world where teammates meet: by anchors or landmarks, by radio or camera.

`own_filter.py` weighs particles by anchors. Here they are weighed by landmarks where the world has those instead, and a
packet's reading is the camera's sighting of its sender where there are cameras, else the radio's. No reading is refused
for being unlikely: where gross outliers occur, as in MRCLAM, particles collapse on them.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, Sensor, World
from cooploc.estimators.models.sensors import TOO_NEAR_TO_RANGE, Range, Sighting
from cooploc.estimators.particle import own_filter
from cooploc.estimators.particle.mixtures import log_density


@dataclass(frozen=True)
class TeamSettings(own_filter.Settings):
    """Parameters of a robot's own filter, and which radio reading is used where no camera sees teammates."""

    reading: Literal["rssi", "range"] = "range"

    @property
    def uses(self) -> tuple[str, ...]:
        """The channels, in order of preference."""
        own = ("anchor_rssi|landmark" if channel == "anchor_rssi" else channel for channel in super().uses)
        return (*own, f"sighting|radio_{self.reading}")


def init(p: TeamSettings, prior: Belief, world: World, rows: Rows) -> own_filter.FilterState:
    """Particles drawn from the prior."""
    return own_filter.init(_own(p, world), prior, world, rows)


def predict(p: TeamSettings, s: own_filter.FilterState, z: Senses) -> own_filter.FilterState:
    """Draw from P(x_t+1 | x_t)."""
    return own_filter.predict(_own(p, s.world), s, z)


def correct(p: TeamSettings, s: own_filter.FilterState, z: Senses) -> own_filter.FilterState:
    """Weigh the particles by the readings of anchors, or of landmarks."""
    if "landmark" not in s.world.sensors:
        return own_filter.correct(p, s, z)
    s = own_filter.correct(_own(p, s.world), s, z, sends=False)
    logw = s.logw.copy()
    for sensor, place, reading in s.world.fixed(z):
        rows = np.flatnonzero(~np.isnan(reading).any(-1))
        y, _, _ = sensor.innovation(s.x[rows], place, reading[rows, None])
        logw[rows] += log_density(y, sensor.R)
    return s._replace(logw=logw, sent=None)


def readings(world: World, z: Senses, mail: Mail) -> tuple[Sensor, Array]:
    """The sensor of teammates, and its readings (r, n, k) of the senders heard; nan where absent or too near."""
    channels = {"sighting": z.sighting, "radio_rssi": mail.rssi[..., None], "radio_range": mail.range[..., None]}
    name = next(channel for channel in channels if channel in world.sensors)
    sensor, reading = world.sensors[name], channels[name]
    ranged = isinstance(sensor, Range | Sighting)
    refused = ~mail.heard[..., None] | (ranged & (reading[..., :1] < TOO_NEAR_TO_RANGE))
    return sensor, np.where(refused, np.nan, reading)


def _own(p: TeamSettings, world: World) -> TeamSettings:
    """The settings of the own filter; it has no anchors to weigh by where there are landmarks."""
    return replace(p, anchor_reading="none") if "landmark" in world.sensors else p
