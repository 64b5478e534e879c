"""The parameters that the Kalman filters share. Each filter repeats, as fields of its own, those that it has."""

import inspect
from dataclasses import fields
from typing import Literal, Protocol, TypeVar

import numpy as np

from cooploc.estimators.errors import require
from cooploc.estimators.interface import World
from cooploc.estimators.models import LEAST, MOST, RAW, AnchorReading, gradient_doa, inflate

EngineName = Literal["batched", "filterpy"]
RadioReading = Literal["rssi", "range", "any"]

# Squared Mahalanobis distance beyond which a reading is refused: chi-square, two degrees of freedom, 0.999.
GATE = 13.8

MEANINGS = {
    "anchor_reading": """what is used of the anchors: "doa", the direction of arrival [rad] made of the readings of four
        corner anchors, with the variance that it has where the robot is; "doa-constant", the same with one variance
        everywhere, as published; "gradient", the gradient [dB/m] that the direction is taken from; "rssi", each raw
        reading [dBm]; "any", as "rssi", and nothing where there are neither anchors nor landmarks; or "none", no
        reading of anchors, nor of landmarks: odometry and teammates alone.""",
    "gate": """squared Mahalanobis distance (no unit) beyond which a reading is refused; inf refuses none. The default
        refuses one in a thousand true readings of two numbers.""",
    "inflation": "factor, 0.01 to 100, on the standard deviation that is assumed of every reading; 1: as told.",
    "engine": '"batched" computes all rows at once; "filterpy" runs filterpy\'s filter row by row, to compare with.',
    "reading": """the radio reading that is used where no camera sees teammates: "range" [m], "rssi" [dBm], or "any",
        the first of these that there is.""",
    "both": "whether a sighting corrects the robot that was seen, too.",
}

C = TypeVar("C", bound=type)


def explain(cls: C) -> C:
    """Add `MEANINGS` of a dataclass's fields to its docstring, which `help` shows."""
    doc = inspect.cleandoc(cls.__doc__ or "")
    heading = "" if "\n\nParameters:\n" in doc else "\n\nParameters:"
    meanings = (f"\n    {one.name}: {MEANINGS[one.name]}" for one in fields(cls) if one.name in MEANINGS)
    cls.__doc__ = doc + heading + "".join(meanings)
    return cls


class Parameters(Protocol):
    """The parameters of every Kalman filter; see `MEANINGS`."""

    @property
    def anchor_reading(self) -> AnchorReading: ...

    @property
    def gate(self) -> float: ...

    @property
    def inflation(self) -> float: ...

    @property
    def engine(self) -> EngineName: ...


class TeamParameters(Parameters, Protocol):
    """The parameters of every Kalman filter that uses readings of teammates."""

    @property
    def reading(self) -> RadioReading: ...


def require_limits(p: Parameters, **limits: tuple[float, float]) -> None:
    """Refuse a gate, an inflation, or another parameter that is outside its limits.

    Raises:
        ValueError: names the parameter, its value and the limits.

    """
    require(p, gate=(0, np.inf), inflation=(LEAST, MOST), **limits)


def own_channels(p: Parameters) -> tuple[str, ...]:
    """The channels of a robot's own readings, in order of preference."""
    if p.anchor_reading == "none":
        return ("odometry",)
    return ("odometry", "anchor_rssi|landmark|anchor_range" + "?" * (p.anchor_reading == "any"))


def team_channels(p: TeamParameters) -> tuple[str, ...]:
    """The same, and that of readings of teammates."""
    radio = "radio_range|radio_rssi" if p.reading == "any" else f"radio_{p.reading}"
    return (*own_channels(p), f"sighting|{radio}")


def assumed_world(p: Parameters, world: World) -> World:
    """Return the world as a filter takes it: with its inflation.

    Raises:
        BadInput: `anchor_reading` needs four corners of a rectangle, and the world's anchors are not.

    """
    if p.anchor_reading not in (*RAW, "none") and "anchor_rssi" in world.sensors:
        gradient_doa(world)
    return inflate(world, p.inflation)
