"""Readings that an estimator trusts less, or more, than it is told: the first thing that a user of a filter tunes."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from cooploc.estimators.interface import Sensor, World

LEAST, MOST = 0.01, 100.0


def inflated(world: World, factor: float) -> World:
    """The world with every sensor's standard deviations multiplied by `factor`; at 1 it is the same object.

    What is told to the team stays as it is: this is one estimator's choice. A sensor that is not built in is inflated
    where it is a dataclass with fields whose names begin with "sigma".
    """
    if factor == 1:
        return world
    sensors: Mapping[str, Sensor] = {name: _inflated(one, factor) for name, one in world.sensors.items()}
    return replace(world, sensors=sensors)


def _inflated(sensor: Any, factor: float) -> Any:
    if not is_dataclass(sensor) or isinstance(sensor, type):
        return sensor
    sigmas = [one.name for one in fields(sensor) if one.init and one.name.startswith("sigma")]
    return replace(sensor, **{name: factor * getattr(sensor, name) for name in sigmas})
