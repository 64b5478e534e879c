"""Teams whose robots do not all sense the same: which odometry there is, and what is used of a sighting.

Sources: R. Madhavan, K. Fregene, L. Parker, "Distributed heterogeneous outdoor multi-robot localization", ICRA 2002,
and "Distributed cooperative outdoor multirobot localization and mapping", Autonomous Robots 17, 2004 (some robots lack
sensors that others have); A. Martinelli, F. Pont, R. Siegwart, "Multi-robot localization using relative observations",
ICRA 2005 (bearing, distance and orientation of a teammate, alone or together). Of these we know the abstracts: the
options follow them, and how a robot without odometry moves is ours.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from cooploc.estimators.interface import Array, Mail, Senses, Sensor, World
from cooploc.estimators.kalman.linearised import move
from cooploc.estimators.kalman.settings import TeamSettings
from cooploc.estimators.kalman.team_readings import table
from cooploc.estimators.models.sensors import Bearing, Range, Sighting
from cooploc.estimators.plugins.bounds import require
from cooploc.estimators.plugins.errors import BadInput


@dataclass(frozen=True)
class MixedTeamSettings(TeamSettings):
    """Parameters of a filter for a team whose robots do not all sense the same.

    Parameters:
        sighting: what is used of a camera's sighting of a teammate: "both" its range [m] and bearing [rad], "range",
            "bearing", or "none"; with "none" no radio reading of teammates is used either.
        orientation: whether readings of a teammate's heading relative to the own are used, in worlds that have them.
        absent_odometry: what a robot does that has no reading of odometry: it stands "still", or it moves at "random".
        speed: standard deviation of a random velocity along each axis [m/s].
        turn_rate: standard deviation of a random turn rate [rad/s].
        hold: how long a random velocity lasts before another one [s].
    """

    sighting: Literal["both", "range", "bearing", "none"] = "both"
    orientation: bool = False
    absent_odometry: Literal["still", "random"] = "still"
    speed: float = 0.5
    turn_rate: float = 0.5
    hold: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, speed=(0, 1000), turn_rate=(0, 1000), hold=(0, 1000))

    @property
    def uses(self) -> tuple[str, ...]:
        """The channels, in order of preference."""
        channels = super().uses[: -1 if self.sighting == "none" else None]
        return (*channels, "orientation") if self.orientation else channels

    def moved(self, world: World, x: Array, z: Senses) -> tuple[Array, Array, Array]:
        """x', F, Q of states x (t, n, d).

        At random x' = x, F = I, Q = diag(speed^2, speed^2, turn_rate^2) hold dt, as the steps of a random walk.
        """
        x_moved, F, Q = move(world.motion, x, z)
        if self.absent_odometry == "random":
            blind = np.asarray(np.isnan(z.odometry).any(-1))[..., None, None]
            anyhow = np.diag([self.speed**2, self.speed**2, self.turn_rate**2][: x.shape[-1]])
            Q = np.where(blind, anyhow * self.hold * z.dt[..., None, None], Q)
        return x_moved, F, Q

    def team_readings(self, world: World, z: Senses, air: Mail) -> Iterator[tuple[Sensor, Array]]:
        """Those readings of teammates that are used, by sensor: (t, receiver, sender, k), as `table` gives them."""
        yield from table(*self._part(world, z), air)
        if self.orientation and not np.isnan(readings := z.extra["orientation"]).all():
            yield world.sensors["orientation"], readings

    def _part(self, world: World, z: Senses) -> tuple[World, Senses]:
        """Of each sighting the part that is used, with a sensor that reads it alone."""
        camera = world.sensors.get("sighting")
        if camera is None or self.sighting == "both":
            return world, z
        if not isinstance(camera, Sighting):
            raise BadInput(f"sighting={self.sighting!r} needs sightings of range and bearing, not those of {camera!r}")
        ranged = self.sighting == "range"
        part: Sensor = Range(camera.sigma_range) if ranged else Bearing(camera.sigma_bearing)
        numbers = z.sighting[..., :1] if ranged else z.sighting[..., 1:]
        return replace(world, sensors={**world.sensors, "sighting": part}), z._replace(sighting=numbers)
