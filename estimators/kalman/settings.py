"""The parameters that the Kalman filters share, and what follows from them alone."""

import inspect
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from cooploc.estimators.interface import World
from cooploc.estimators.kalman.update import GATE, EngineName
from cooploc.estimators.models.anchor_readings import RAW, AnchorReading
from cooploc.estimators.models.gradient_doa import gradient_doa
from cooploc.estimators.models.inflation import LEAST, MOST, inflated
from cooploc.estimators.plugins.bounds import require
from cooploc.estimators.plugins.tunable import tunable


@dataclass(frozen=True)
class Settings:
    """Parameters of every Kalman filter.

    Parameters:
        anchor_reading: what is used of the anchors: "doa", the direction of arrival [rad] made of the readings of four
            corner anchors, with the variance that it has where the robot is; "doa-constant", the same with one variance
            everywhere, as published; "gradient", the gradient [dB/m] that the direction is taken from; "rssi", each raw
            reading [dBm]; "any", as "rssi", and nothing where there are neither anchors nor landmarks; or "none", no
            reading of anchors, nor of landmarks: odometry and teammates alone.
        gate: squared Mahalanobis distance (no unit) beyond which a reading is refused; inf refuses none. The default
            refuses one in a thousand true readings of two numbers.
        inflation: factor, 0.01 to 100, on the standard deviation that is assumed of every reading; 1: as told.
        engine: "batched" computes all rows at once; "filterpy" runs filterpy's filter row by row, to compare with.

    """

    api: ClassVar[int] = 1
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    engine: EngineName = "batched"

    def __post_init__(self) -> None:
        require(self, gate=(0, np.inf), inflation=(LEAST, MOST))

    def __init_subclass__(cls) -> None:
        """Add the inherited parameters to the docstring, so that `help` shows all of a filter's in one place."""
        own, inherited = (inspect.cleandoc(c.__doc__ or "") for c in (cls, cls.__mro__[1]))
        _, heading, parameters = inherited.partition("\n\nParameters:\n")
        cls.__doc__ = f"{own}{chr(10) if heading in own else heading}{parameters}"

    @property
    def uses(self) -> tuple[str, ...]:
        """The channels, in order of preference."""
        if self.anchor_reading == "none":
            return ("odometry",)
        return ("odometry", "anchor_rssi|landmark|anchor_range" + "?" * (self.anchor_reading == "any"))

    def assumed(self, world: World) -> World:
        """The world as this filter takes it: with `inflation`.

        Raises:
            BadInput: as `require_corners`.

        """
        self.require_corners(world)
        return inflated(world, self.inflation)

    def require_corners(self, world: World) -> None:
        """Refuse, before anything runs, a world in which no direction of arrival can be made of the anchors.

        Raises:
            BadInput: `anchor_reading` needs four corners of a rectangle, and the world's anchors are not.

        """
        if self.anchor_reading not in (*RAW, "none") and "anchor_rssi" in world.sensors:
            gradient_doa(world)


@dataclass(frozen=True)
class TeamSettings(Settings):
    """Parameters of every Kalman filter that uses readings of teammates.

    Parameters:
        reading: the radio reading that is used where no camera sees teammates: "range" [m], "rssi" [dBm], or "any", the
            first of these that there is.
    """

    reading: Literal["rssi", "range", "any"] = "range"

    @property
    def uses(self) -> tuple[str, ...]:
        """The channels, in order of preference."""
        radio = "radio_range|radio_rssi" if self.reading == "any" else f"radio_{self.reading}"
        return (*super().uses, f"sighting|{radio}")
