"""What radio does: path loss, shadowing with memory, and what stands in the way."""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Indices
from cooploc.scenarios.worlds.line_of_sight import bodies_between, walls_between


class Scene(NamedTuple):
    """One trial's true surroundings: what blocks which link. Estimators never see it."""

    walls: Array  # (w, 2, 2) [m]
    obstacles: Array  # (T, m, 2) [m]
    radius: float  # of obstacles, and of robots that block [m]
    anchor_blockers: Indices  # (T, n, a) things between a robot and an anchor
    robot_blockers: Indices  # (T, n, n) things between two robots


def scene(path: Array, anchors: Array, walls: Array, obstacles: Array, radius: float, robots_block: bool) -> Scene:
    """Count what stands between robots (T, n, 2), anchors (a, 2) and each other."""
    here, teammate = path[:, :, None], path[:, None]
    to_anchors, to_robots = walls_between(here, anchors, walls), walls_between(here, teammate, walls)
    if obstacles.shape[1]:
        bodies = obstacles[:, None, None]
        to_anchors = to_anchors + bodies_between(here, anchors, bodies, radius).sum(-1)
        to_robots = to_robots + bodies_between(here, teammate, bodies, radius).sum(-1)
    if robots_block:
        n = path.shape[1]
        own = np.eye(n, dtype=bool)
        third = ~(own[:, None] | own[None])  # (n, n, n): neither the one nor the other
        bodies = path[:, None, None]
        to_anchors = to_anchors + (bodies_between(here, anchors, bodies, radius) & ~own[:, None]).sum(-1)
        to_robots = to_robots + (bodies_between(here, teammate, bodies, radius) & third).sum(-1)
    return Scene(walls, obstacles, radius, to_anchors, to_robots)


def correlated(white: Array, correlation: float) -> Array:
    """White noise (T, ...) to a stationary AR(1) process of the same variance and this lag-1 correlation."""
    if correlation == 0:
        return white
    out, fresh = white.copy(), np.sqrt(1 - correlation**2)
    for k in range(1, len(white)):
        out[k] = correlation * out[k - 1] + fresh * white[k]
    return out


def rounded(reading: Array, unit: float) -> Array:
    """Readings in whole multiples of `unit`; 0 leaves them as they are."""
    return np.round(reading / unit) * unit if unit else reading


def distance(a: Array, b: Array) -> Array:
    """Euclidean distance of places (..., 2): by components, as numpy is slow at a sum over two."""
    dx, dy = a[..., 0] - b[..., 0], a[..., 1] - b[..., 1]
    d: Array = np.sqrt(dx**2 + dy**2)
    return d
