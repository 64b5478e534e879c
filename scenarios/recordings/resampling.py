"""Values at the stamps of a recording, brought onto the times or intervals of a tick grid."""

import numpy as np

from cooploc.estimators.interface import Array


def interpolate(stamps: Array, values: Array, at: Array, max_gap: float) -> Array:
    """Linear interpolation between the stamps before and after.

    Args:
        stamps: (m,) rising [s].
        values: (m, k); angles unwrapped.
        at: (T,) times [s].
        max_gap: [s] no interpolation across longer gaps.

    Returns:
        (T, k); nan outside the stamps and in gaps longer than `max_gap`.

    """
    after = np.searchsorted(stamps, at)
    inside = (after < len(stamps)) & (at >= stamps[0])
    after = np.minimum(after, len(stamps) - 1)
    gap = stamps[after] - stamps[np.maximum(after - 1, 0)]
    known = inside & ((gap <= max_gap) | (stamps[after] == at))
    line = np.stack([np.interp(at, stamps, column) for column in values.T], -1)
    return np.where(known[:, None], line, np.nan)


def mean_held(stamps: Array, values: Array, edges: Array) -> Array:
    """Mean over each interval of a signal that holds every value until the next stamp (zero-order hold).

    Args:
        stamps: (m,) rising [s].
        values: (m, k).
        edges: (T + 1,) of the intervals [s].

    Returns:
        (T, k); nan where an interval begins before the first stamp or after the last, as what held there is unknown.

    """
    knots = np.append(stamps, max(stamps[-1], edges[-1]))
    integral = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values * np.diff(knots)[:, None]]), axis=0)
    at_edges = np.stack([np.interp(edges, knots, column) for column in integral.T], -1)
    known = (edges[:-1] >= stamps[0]) & (edges[:-1] <= stamps[-1])
    return np.where(known[:, None], np.diff(at_edges, axis=0) / np.diff(edges)[:, None], np.nan)
