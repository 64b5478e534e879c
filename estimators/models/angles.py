"""Angles live in (-pi, pi] and are never averaged or subtracted raw."""

import numpy as np

from cooploc.estimators.compiled.jit import strict_kernel
from cooploc.estimators.interface import Array


def wrap(angle: Array) -> Array:
    """The same angle in (-pi, pi] [rad], any shape; nan stays nan."""
    wrapped = np.pi - np.mod(np.pi - angle, 2 * np.pi)
    return np.where(wrapped <= -np.pi, np.pi, wrapped)  # rounding may land on the open end


def wrap_heading(x: Array) -> Array:
    """States (..., d) with the heading, where there is one (d = 3), wrapped."""
    if x.shape[-1] < 3:
        return x
    x = x.copy()
    if x.dtype == np.float64:
        _wrap_headings(x.reshape(-1, x.shape[-1]))
    else:
        x[..., 2] = wrap(x[..., 2])
    return x


@strict_kernel
def wrapped(angle: float) -> float:
    """`wrap` of one number."""
    inside = np.pi - (np.pi - angle) % (2 * np.pi)
    return np.pi if inside <= -np.pi else inside


@strict_kernel
def _wrap_headings(x: Array) -> None:
    for r in range(len(x)):
        x[r, 2] = wrapped(x[r, 2])


def circular_mean(angle: Array, weight: Array) -> Array:
    """Weighted mean direction over the last axis [rad]: the angle of the sum of unit vectors."""
    mean: Array = np.arctan2((weight * np.sin(angle)).sum(-1), (weight * np.cos(angle)).sum(-1))
    return mean
