"""What stands between two points: walls (segments) and bodies (discs), for many lines of sight at once."""

import numpy as np

from cooploc.estimators.interface import Array, Indices, Mask


def walls_between(a: Array, b: Array, walls: Array) -> Indices:
    """How many walls (w, 2, 2) each line of sight a (..., 2) to b (..., 2) crosses; touching counts.

    Two segments cross where each one's ends lie on different sides of the other, or on it.
    """
    count = np.zeros(np.broadcast_shapes(a.shape, b.shape)[:-1], np.int64)
    for p, q in walls:
        across = (_side(p, q, a) * _side(p, q, b) <= 0) & (_side(a, b, p) * _side(a, b, q) <= 0)
        count += across & _boxes_meet(a, b, p, q)
    return count


def bodies_between(a: Array, b: Array, centre: Array, radius: float) -> Mask:
    """Which bodies (..., m, 2) each line of sight a (..., 2) to b (..., 2) touches: a mask (..., m)."""
    a, b = a[..., None, :], b[..., None, :]
    along = b - a
    length2 = np.maximum((along**2).sum(-1), np.finfo(float).tiny)
    share = np.clip(((centre - a) * along).sum(-1) / length2, 0.0, 1.0)
    nearest = a + share[..., None] * along
    touched: Mask = np.asarray(((centre - nearest) ** 2).sum(-1) <= radius**2)
    return touched


def _side(p: Array, q: Array, x: Array) -> Array:
    """Sign of the turn p, q, x: which side of the line through p and q the point x lies on."""
    u, v = q - p, x - p
    side: Array = np.sign(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
    return side


def _boxes_meet(a: Array, b: Array, p: Array, q: Array) -> Mask:
    """Whether the boxes around two segments meet; those of collinear segments that do not overlap do not."""
    low, high = np.minimum(a, b), np.maximum(a, b)
    meet: Mask = np.all((low <= np.maximum(p, q)) & (high >= np.minimum(p, q)), axis=-1)
    return meet
