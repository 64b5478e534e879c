"""Variations of a stream that a correct estimator must not notice: readings perturbed or hidden, packets dropped.

Hidden readings find what perturbed ones cannot: an estimator that branches on whether *any* robot sensed something.
"""

from copy import deepcopy
from dataclasses import replace
from typing import Literal

import numpy as np

from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.models import wrap, wrap_heading
from cooploc.scenarios.stream import Air, Stream

Mode = Literal["perturbed", "hidden"]
MODES: tuple[Mode, Mode] = ("perturbed", "hidden")

# Perturbed where others are hidden: a filter can do without a correction, but hardly without a prior or a clock.
NEVER_HIDDEN = ("prior.x", "prior.P", "senses.dt", "senses.odometry")


def deep_copy(stream: Stream) -> Stream:
    """A copy that shares no memory with the stream."""
    world = stream.world
    places = {name: getattr(world, name).copy() for name in ("arena", "anchors", "landmarks")}
    world = replace(world, **places, sensors=deepcopy(dict(world.sensors)), motion=deepcopy(world.motion))
    return replace(stream.map(np.copy), world=world, time=stream.time.copy(), trial=stream.trial.copy())


def drop_readings(stream: Stream, rng: np.random.Generator) -> Stream:
    """Two in five readings absent in every third tick, and all absent in tick 4: the checks need absent readings."""
    tick = np.arange(len(stream.time))[None, :, None]
    changed = {}
    for name, array in stream.arrays().items():
        if _is_reading(name) and name not in NEVER_HIDDEN:
            gone = (tick[..., None] % 3 == 1) & (rng.uniform(size=array.shape[:4]) < 0.4) | (tick[..., None] == 4)
            changed[name] = np.where(_expand(gone, array), np.nan, array)
    return stream.with_arrays(changed)


def perturb_readings(
    stream: Stream, mode: Mode, rng: np.random.Generator, robot: int | None = None, since: int = 0
) -> Stream:
    """Perturb or hide what `robot` (None: every robot) senses from tick `since` on, and with since=0 its prior too.

    A robot's readings of radio signals are among its senses. Priors, clocks and odometry are perturbed in either mode.
    """
    robots = np.ones(stream.robots, bool) if robot is None else np.arange(stream.robots) == robot
    ticks = np.arange(len(stream.time)) >= since
    changed = {}
    for name, array in stream.arrays().items():
        other = _perturbed(name, array, mode, rng)
        if name.startswith("prior."):
            changed[name] = np.where(_expand(robots[None] & (since == 0), array), other, array)
        elif _is_reading(name):
            changed[name] = np.where(_expand(ticks[None, :, None] & robots, array), other, array)
    return stream.with_arrays(changed)


def drop_packets(stream: Stream, sender: int | None = None, since: int = 0) -> Stream:
    """No packet of `sender` (None: of any robot) arrives from tick `since` on."""
    link = stream.air.link.copy()
    link[:, since:, :, slice(None) if sender is None else sender] = False
    return _with_air(stream, stream.air._replace(link=link))


def perturb_links(stream: Stream, mode: Mode, rng: np.random.Generator, since: int) -> Stream:
    """Other links from tick `since` on: drawn again, or none."""
    if mode == "hidden":
        return drop_packets(stream, since=since)
    link = stream.air.link.copy()
    drawn: Mask = rng.uniform(size=link[:, since:].shape) < 0.5
    link[:, since:] = drawn & ~np.eye(stream.robots, dtype=bool)
    return _with_air(stream, stream.air._replace(link=link))


def perturb_dropped_radio(stream: Stream, mode: Mode, rng: np.random.Generator) -> Stream:
    """Perturb or hide the radio readings of packets that did not arrive."""
    air = {}
    for name in ("rssi", "range"):
        array = getattr(stream.air, name)
        if array.shape[-1]:
            air[name] = np.where(stream.air.link, array, _perturbed(f"air.{name}", array, mode, rng))
    return _with_air(stream, stream.air._replace(**air))


def _is_reading(name: str) -> bool:
    return not name.startswith("prior.") and name != "air.link"


def _perturbed(name: str, array: Array, mode: Mode, rng: np.random.Generator) -> Array:
    if array.dtype.kind != "f":
        return array
    if mode == "hidden" and name not in NEVER_HIDDEN:
        return np.full_like(array, np.nan)
    if name in ("prior.P", "senses.dt"):  # stays a covariance, stays positive
        return array * _expand(rng.uniform(0.8, 1.2, array.shape[: 2 if name == "prior.P" else 3]), array)
    # Small changes pass every gate, large ones cross every threshold.
    changed: Array = array + 10.0 ** rng.uniform(-2, 0.5, array.shape) * rng.normal(size=array.shape)
    return _physical(name, changed)


def _physical(name: str, array: Array) -> Array:
    """No negative distances, no angles beyond pi: no sensor reads them, so an estimator need not expect them."""
    if name == "air.range":
        return np.abs(array)
    if name in ("senses.landmark", "senses.sighting"):
        return np.stack([np.abs(array[..., 0]), wrap(array[..., 1])], -1)
    return wrap_heading(array) if name == "prior.x" else array


def _expand(lead: Array | Mask, array: Array) -> Array | Mask:
    """`lead` with trailing axes of length one, so that it broadcasts over `array`."""
    return lead.reshape(*lead.shape, *(1,) * (array.ndim - lead.ndim))


def _with_air(stream: Stream, air: Air) -> Stream:
    return stream.with_arrays({f"air.{name}": array for name, array in air._asdict().items()})
