"""Random walks in a square, reflected at its sides: how robots and wandering obstacles move."""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array


class Steps(NamedTuple):
    """What a walk of n bodies over T ticks is made of."""

    start: Array  # (n, 2) [m]
    heading: Array  # (n,) [rad] before the first tick
    length: Array  # (T, n) [m]
    turn: Array  # (T, n) [rad]


def draw(rng: np.random.Generator, ticks: int, n: int, side: float, step: float, turn: float) -> Steps:
    """Uniform starts and headings, lengths of 0.5 to 1.5 `step`, normal turns of sd `turn`."""
    return Steps(
        rng.uniform(0, side, (n, 2)),
        rng.uniform(-np.pi, np.pi, n),
        step * rng.uniform(0.5, 1.5, (ticks, n)),
        rng.normal(0, turn, (ticks, n)),
    )


def walk(draws: list[Steps], side: float) -> tuple[Array, Array]:
    """Starts (t, n, 2) and positions (t, T, n, 2) of several trials' walks."""
    start, heading, length, turn = (np.stack(part) for part in zip(*draws, strict=True))
    x, path = start, np.empty((*length.shape, 2))
    for k in range(length.shape[1] if path.size else 0):  # most worlds have no obstacles
        heading = heading + turn[:, k]
        x = x + length[:, k, :, None] * np.stack([np.cos(heading), np.sin(heading)], -1)
        out = (x < 0) | (x > side)
        x = side - np.abs(side - np.abs(x))
        heading = np.where(out[..., 0], np.pi - heading, heading)
        heading = np.where(out[..., 1], -heading, heading)
        path[:, k] = x
    return start, path
