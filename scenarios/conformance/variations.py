"""Variations of a stream that a correct estimator must not notice, or must follow.

Readings are perturbed or hidden, packets dropped. Hidden readings find what perturbed ones cannot: an estimator that
branches on whether *any* robot sensed something. Or the world is shifted, turned, its robots renumbered.
"""

from copy import deepcopy
from dataclasses import replace
from typing import Literal

import numpy as np

from cooploc.estimators.interface import Array, Belief, Mask, World
from cooploc.estimators.models import Displacement, wrap, wrap_heading
from cooploc.scenarios.stream import Air, Stream

Mode = Literal["perturbed", "hidden"]
MODES: tuple[Mode, Mode] = ("perturbed", "hidden")

# Perturbed where others are hidden: a filter can do without a correction, but hardly without a prior or a clock.
NEVER_HIDDEN = ("prior.x", "prior.P", "senses.dt", "senses.odometry")


def deep_copy(stream: Stream) -> Stream:
    """Return a copy that shares no memory with the stream."""
    world = stream.world
    places = {name: getattr(world, name).copy() for name in ("arena", "anchors", "landmarks")}
    world = replace(world, **places, sensors=deepcopy(dict(world.sensors)), motion=deepcopy(world.motion))
    return replace(stream.map(np.copy), world=world, time=stream.time.copy(), trial=stream.trial.copy())


def drop_readings(stream: Stream, rng: np.random.Generator) -> Stream:
    """Hide two in five readings in every third tick, and all in tick 4: the checks need absent readings."""
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
    """Drop every packet of `sender` (None: of any robot) from tick `since` on."""
    link = stream.air.link.copy()
    link[:, since:, :, slice(None) if sender is None else sender] = False
    return _with_air(stream, stream.air._replace(link=link))


def perturb_links(stream: Stream, mode: Mode, rng: np.random.Generator, since: int) -> Stream:
    """Draw the links from tick `since` on again, or cut them all."""
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


def only_odometry(stream: Stream) -> Stream:
    """Hide every reading but odometry, and drop every packet."""
    hidden = {
        name: np.full_like(array, np.nan)
        for name, array in stream.arrays().items()
        if array.dtype.kind == "f" and name not in NEVER_HIDDEN
    }
    return drop_packets(stream.with_arrays(hidden))


def make_first_certain(stream: Stream) -> Stream:
    """Let the first robot start with a hundredth of its standard deviation."""
    P = stream.prior.P.copy()
    P[:, 0] *= 1e-4
    return stream.with_arrays({"prior.P": P})


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


# The same world with other axes

SHIFT = np.array([3.0, -7.0])  # [m]
QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])  # an arena has sides along the axes: it turns by right angles


def shifted(stream: Stream) -> Stream:
    """Return the same readings in a world with its origin elsewhere."""
    x, w = shift_belief(stream.prior).x, stream.world
    world = replace(w, arena=w.arena + SHIFT, anchors=w.anchors + SHIFT, landmarks=w.landmarks + SHIFT)
    return replace(stream.with_arrays({"prior.x": x}), world=world)


def turned(stream: Stream, roll: int) -> Stream:
    """Return the same readings in a world turned by 90 degrees, its anchors renumbered by `roll`.

    With roll=1, the numbers of four corners begin at the lower left again.
    """
    x, P = turn_belief(stream.prior)
    senses, compass = stream.senses, x.shape[-1] == 2
    changed = {"prior.x": x, "prior.P": P, "senses.anchor_rssi": np.roll(senses.anchor_rssi, -roll, axis=-1)}
    if isinstance(stream.world.motion, Displacement):
        changed["senses.odometry"] = senses.odometry @ QUARTER.T
    if compass:  # a bearing is against the x axis
        for name in ("landmark", "sighting"):
            z = getattr(senses, name)
            changed[f"senses.{name}"] = np.stack([z[..., 0], wrap(z[..., 1] + np.pi / 2)], -1)
    return replace(stream.with_arrays(changed), world=_turn_world(stream.world, roll))


def renumbered(stream: Stream, order: list[int]) -> Stream:
    """Return the same readings where robot `order[i]` has number i."""
    changed = {}
    for name, array in stream.arrays().items():
        rows = array[:, order] if name.startswith("prior.") else array[:, :, order]
        pairs = name.startswith("air.") or name == "senses.sighting"
        changed[name] = rows[:, :, :, order] if pairs and rows.shape[3] else rows
    return stream.with_arrays(changed)


def in_turn(stream: Stream) -> Stream:
    """Return a stream in which one pair of robots meets in each tick, and one of them measures.

    So the order of teammates makes no difference.
    """
    n, T = stream.robots, len(stream.time)
    pair, reads = np.zeros((T, n, n), bool), np.zeros((T, n, n), bool)
    for k in range(T):
        i, j = k % n, (k + 1 + k // n % (n - 1)) % n
        pair[k, i, j] = pair[k, j, i] = reads[k, i, j] = True
    changed: dict[str, Array | Mask] = {}
    for name in ("air.link", "air.rssi", "air.range", "senses.sighting"):
        array = stream.arrays()[name]
        if name == "air.link":
            changed[name] = np.logical_and(np.logical_and(array, array.swapaxes(-1, -2)), pair)
        elif array.shape[3]:
            keep = reads[..., None] if array.ndim == 5 else reads
            changed[name] = np.where(keep, array, np.nan)
    return stream.with_arrays(changed)


def shift_belief(belief: Belief) -> Belief:
    """Return a belief in a world with its origin elsewhere."""
    x = belief.x.copy()
    x[..., :2] += SHIFT
    return belief._replace(x=x)


def turn_belief(belief: Belief) -> Belief:
    """Return a belief in a world turned by 90 degrees."""
    x, d = belief.x.copy(), belief.x.shape[-1]
    x[..., :2] = x[..., :2] @ QUARTER.T
    if d > 2:
        x[..., 2] = wrap(x[..., 2] + np.pi / 2)
    J = np.eye(d)
    J[:2, :2] = QUARTER
    return Belief(x, J @ belief.P @ J.T)


def _turn_world(world: World, roll: int) -> World:
    corners = world.arena @ QUARTER.T
    arena = np.array([corners.min(0), corners.max(0)])
    anchors = np.roll(world.anchors @ QUARTER.T, -roll, axis=0)
    return replace(world, arena=arena, anchors=anchors, landmarks=world.landmarks @ QUARTER.T)
