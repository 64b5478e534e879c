"""Variations of a stream, by which the conformance checks see what an estimator depends on.

Hidden readings find what perturbed ones cannot: an estimator that branches on whether *any* robot sensed something.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from cooploc.estimators.interface import Array, Belief, Mask
from cooploc.estimators.models import Displacement, wrap, wrap_heading
from cooploc.scenarios.runner.tick import SENSED
from cooploc.scenarios.stream import Stream

MODES = ("perturbed", "hidden")
# Perturbed where others are hidden: a filter can do without a correction, but hardly without a prior or a clock.
NEVER_HIDDEN = ("prior.x", "prior.P", "senses.dt", "senses.odometry")
SHIFT = np.array([3.0, -7.0])  # [m]
QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])  # an arena has sides along the axes: it turns by right angles


def name_of_array(channel: str) -> str:
    """Return the name that a channel's readings have in `Stream.arrays`."""
    if channel.startswith("radio_"):
        return channel.replace("radio_", "air.")
    return f"senses.{channel}" if channel in SENSED else f"extra.{channel}"


def hide(stream: Stream, *names: str) -> Stream:
    """Hide every reading of these arrays."""
    return stream.replace_arrays({name: np.full_like(stream.arrays()[name], np.nan) for name in names})


def can_be_absent(stream: Stream) -> dict[str, Array]:
    """Return the arrays of a stream that a filter can do without: nan is absent."""
    floats = {name: array for name, array in stream.arrays().items() if array.dtype.kind == "f"}
    return {name: array for name, array in floats.items() if name not in NEVER_HIDDEN}


def drop_readings(stream: Stream, rng: np.random.Generator) -> Stream:
    """Hide two in five readings in every third tick, and all in tick 4: the checks need absent readings."""
    ticks, changed = np.arange(len(stream.time)), {}
    for name, array in can_be_absent(stream).items():
        drawn = rng.uniform(size=array.shape[:4])
        tick = ticks.reshape(1, -1, *(1,) * (drawn.ndim - 2))
        gone = (tick % 3 == 1) & (drawn < 0.4) | (tick == 4)
        changed[name] = np.where(_expand(gone, array), np.nan, array)
    return stream.replace_arrays(changed)


def perturb_readings(
    stream: Stream, mode: str, rng: np.random.Generator, robot: int | None = None, since: int = 0
) -> Stream:
    """Perturb or hide what `robot` (None: every robot) senses from tick `since` on, and with since=0 its prior too."""
    robots = np.ones(stream.robots, bool) if robot is None else np.arange(stream.robots) == robot
    ticks = np.arange(len(stream.time)) >= since
    changed = {}
    for name, array in stream.arrays().items():
        if array.dtype.kind == "f":
            where = robots[None] & (since == 0) if name.startswith("prior.") else ticks[None, :, None] & robots
            changed[name] = np.where(_expand(where, array), _perturb(name, array, mode, rng), array)
    return stream.replace_arrays(changed)


def _perturb(name: str, array: Array, mode: str, rng: np.random.Generator) -> Array:
    """Return other readings: no negative distances and no angles beyond pi, as no sensor reads them."""
    if mode == "hidden" and name not in NEVER_HIDDEN:
        return np.full_like(array, np.nan)
    if name in ("prior.P", "senses.dt"):  # stays a covariance, stays positive
        return array * _expand(rng.uniform(0.8, 1.2, array.shape[: 2 if name == "prior.P" else 3]), array)
    # Small changes pass every gate, large ones cross every threshold.
    changed: Array = array + 10.0 ** rng.uniform(-2, 0.5, array.shape) * rng.normal(size=array.shape)
    if name in ("senses.landmark", "senses.sighting"):
        return np.stack([np.abs(changed[..., 0]), wrap(changed[..., 1])], -1)
    return np.abs(changed) if name == "air.range" else wrap_heading(changed) if name == "prior.x" else changed


def drop_packets(stream: Stream, sender: int | None = None, since: int = 0) -> Stream:
    """Drop every packet of `sender` (None: of any robot) from tick `since` on."""
    link: Any = stream.air.link.copy()
    link[:, since:, :, slice(None) if sender is None else sender] = False
    return stream.replace_arrays({"air.link": link})


def _expand(lead: Array | Mask, array: Array) -> Array | Mask:
    """Return `lead` with trailing axes of length one, so that it broadcasts over `array`."""
    return lead.reshape(*lead.shape, *(1,) * (array.ndim - lead.ndim))


def move_world(stream: Stream, turn: Array, roll: int) -> Stream:
    """Return the same readings in a world that is turned, then shifted; its anchors are renumbered by `roll`."""
    (x, P), senses, w = move_belief(stream.prior, turn), stream.senses, stream.world
    of_anchors = {name: a for name, a in stream.arrays().items() if name.rpartition(".")[2].startswith("anchor_")}
    changed = {"prior.x": x, "prior.P": P} | {name: np.roll(a, -roll, axis=-1) for name, a in of_anchors.items()}
    if isinstance(w.motion, Displacement):
        changed["senses.odometry"] = senses.odometry @ turn.T
    if x.shape[-1] == 2:  # a compass: a bearing is against the x axis
        for name in ("landmark", "sighting"):
            z = getattr(senses, name)
            changed[f"senses.{name}"] = np.stack([z[..., 0], wrap(z[..., 1] + _angle(turn))], -1)
    corners, anchors, landmarks = (places @ turn.T + SHIFT for places in (w.arena, w.anchors, w.landmarks))
    arena, anchors = np.array([corners.min(0), corners.max(0)]), np.roll(anchors, -roll, axis=0)
    return replace(stream.replace_arrays(changed), world=replace(w, arena=arena, anchors=anchors, landmarks=landmarks))


def move_belief(belief: Belief, turn: Array) -> Belief:
    """Return a belief in a world that is turned, then shifted."""
    x, J = belief.x.copy(), np.eye(belief.x.shape[-1])
    x[..., :2] = x[..., :2] @ turn.T + SHIFT
    x[..., 2:] = wrap(x[..., 2:] + _angle(turn))
    J[:2, :2] = turn
    return Belief(x, J @ belief.P @ J.T)


def _angle(turn: Array) -> Any:
    return np.arctan2(turn[1, 0], turn[0, 0])
