"""Variations of a stream that an honest estimator must not notice: readings shaken or hidden, links cut, and so on.

Hidden readings find what shaken ones cannot: an estimator that branches on whether *anybody* sensed something.
"""

from copy import deepcopy
from dataclasses import replace
from typing import Literal

import numpy as np

from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.models.angles import wrap, wrap_heading
from cooploc.scenarios.stream import Air, Stream

How = Literal["shaken", "hidden"]
HOW: tuple[How, How] = ("shaken", "hidden")

# Never hidden: a filter may do without a correction, but hardly without a prior or a clock.
KEPT = ("prior.x", "prior.P", "senses.dt", "senses.odometry")


def own(stream: Stream) -> Stream:
    """A copy that shares no memory with the stream."""
    world = stream.world
    told = {name: getattr(world, name).copy() for name in ("arena", "anchors", "landmarks")}
    world = replace(world, **told, sensors=deepcopy(dict(world.sensors)), motion=deepcopy(world.motion))
    return replace(stream.map(np.copy), world=world, time=stream.time.copy(), trial=stream.trial.copy())


def thinned(stream: Stream, rng: np.random.Generator) -> Stream:
    """Two in five readings gone in every third tick, and nothing sensed at all in tick 4: absence has to happen."""
    tick = np.arange(len(stream.time))[None, :, None]
    changed = {}
    for name, array in stream.arrays().items():
        if _is_reading(name) and name not in KEPT:
            gone = (tick[..., None] % 3 == 1) & (rng.uniform(size=array.shape[:4]) < 0.4) | (tick[..., None] == 4)
            changed[name] = np.where(_over(gone, array), np.nan, array)
    return stream.with_arrays(changed)


def disturbed(stream: Stream, how: How, rng: np.random.Generator, robot: int | None = None, since: int = 0) -> Stream:
    """What `robot` (None: everybody) senses at tick `since` and after, and with since=0 its prior, shaken or hidden.

    A robot's readings of radio signals are among its senses. Priors, clocks and odometry are shaken either way.
    """
    who = np.ones(stream.robots, bool) if robot is None else np.arange(stream.robots) == robot
    when = np.arange(len(stream.time)) >= since
    changed = {}
    for name, array in stream.arrays().items():
        other = _changed(name, array, how, rng)
        if name.startswith("prior."):
            changed[name] = np.where(_over(who[None] & (since == 0), array), other, array)
        elif _is_reading(name):
            changed[name] = np.where(_over(when[None, :, None] & who, array), other, array)
    return stream.with_arrays(changed)


def silent(stream: Stream, sender: int | None = None, since: int = 0) -> Stream:
    """No packet of `sender` (None: of anybody) arrives at tick `since` or after."""
    link = stream.air.link.copy()
    link[:, since:, :, slice(None) if sender is None else sender] = False
    return _with_air(stream, stream.air._replace(link=link))


def relinked(stream: Stream, how: How, rng: np.random.Generator, since: int) -> Stream:
    """Other links from tick `since` on: drawn anew, or none."""
    if how == "hidden":
        return silent(stream, since=since)
    link = stream.air.link.copy()
    drawn: Mask = rng.uniform(size=link[:, since:].shape) < 0.5
    link[:, since:] = drawn & ~np.eye(stream.robots, dtype=bool)
    return _with_air(stream, stream.air._replace(link=link))


def deaf_radio(stream: Stream, how: How, rng: np.random.Generator) -> Stream:
    """Radio readings of packets that did not arrive, shaken or hidden."""
    air = {}
    for name in ("rssi", "range"):
        array = getattr(stream.air, name)
        if array.shape[-1]:
            air[name] = np.where(stream.air.link, array, _changed(f"air.{name}", array, how, rng))
    return _with_air(stream, stream.air._replace(**air))


def _is_reading(name: str) -> bool:
    return not name.startswith("prior.") and name != "air.link"


def _changed(name: str, array: Array, how: How, rng: np.random.Generator) -> Array:
    if array.dtype.kind != "f":
        return array
    if how == "hidden" and name not in KEPT:
        return np.full_like(array, np.nan)
    if name in ("prior.P", "senses.dt"):  # stays a covariance, stays positive
        return array * _over(rng.uniform(0.8, 1.2, array.shape[: 2 if name == "prior.P" else 3]), array)
    # Small changes pass every gate, large ones cross every threshold.
    changed: Array = array + 10.0 ** rng.uniform(-2, 0.5, array.shape) * rng.normal(size=array.shape)
    return _possible(name, changed)


def _possible(name: str, array: Array) -> Array:
    """No negative distances, no angles beyond pi: what no sensor reads, an honest estimator need not expect."""
    if name == "air.range":
        return np.abs(array)
    if name in ("senses.landmark", "senses.sighting"):
        return np.stack([np.abs(array[..., 0]), wrap(array[..., 1])], -1)
    return wrap_heading(array) if name == "prior.x" else array


def _over(lead: Array | Mask, array: Array) -> Array | Mask:
    """`lead` with axes of one behind, so that it broadcasts over `array`."""
    return lead.reshape(*lead.shape, *(1,) * (array.ndim - lead.ndim))


def _with_air(stream: Stream, air: Air) -> Stream:
    return stream.with_arrays({f"air.{name}": array for name, array in air._asdict().items()})
