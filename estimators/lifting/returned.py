"""What a plain object believes: what its `estimate()` returns, or its own `x` and `P`, made fit for a run.

Libraries let a heading grow beyond pi, keep states as columns, and leave a covariance unsymmetric by rounding. None of
this is worth a line in every plug-in; whatever is more than rounding stays as it is, and is refused where it is wrong.
"""

from typing import Any

import numpy as np

from cooploc.estimators.interface import Array, Belief

ROUNDING = 1e-9  # of the largest entry


def believed(one: Any, columns: bool = True) -> Belief:
    """Its belief: headings in (-pi, pi], P symmetric; with `columns`, a state (d, 1) is one (d,).

    Raises:
        AttributeError: it has neither `estimate()` nor `x` and `P`.
        ValueError: `estimate()` returned something else than x and P.

    """
    if not hasattr(one, "estimate"):
        if not (hasattr(one, "x") and hasattr(one, "P")):
            raise AttributeError(
                f"{type(one).__name__} has neither estimate() nor x and P: return cl.Belief(x, P), or set both"
            )
        found = one.x, one.P
    else:
        found = one.estimate()
    if not (isinstance(found, tuple | list) and len(found) == 2):
        raise ValueError(f"estimate() returned {type(found).__name__}; it must be cl.Belief(x, P), or x, P")
    x, P = (np.asarray(part, float) for part in found)
    if columns and x.ndim == 2 and x.shape[1] == 1:
        x = x[:, 0]
    return Belief(_in_turn(x), _symmetric(P))


def _in_turn(x: Array) -> Array:
    """States (..., d) with the heading in (-pi, pi]; those that are, bit by bit as they were."""
    heading = x[..., 2:]
    if not (np.abs(heading) > np.pi).any():
        return x
    return np.concatenate([x[..., :2], np.arctan2(np.sin(heading), np.cos(heading))], -1)


def _symmetric(P: Array) -> Array:
    """P (..., d, d) without the asymmetry that rounding makes; any other is left for the run to refuse."""
    if P.ndim < 2 or P.shape[-1] != P.shape[-2] or np.array_equal(P, P.mT, equal_nan=True):
        return P
    off, scale = np.abs(P - P.mT).max(), np.abs(P).max()
    return (P + P.mT) / 2 if off <= ROUNDING * scale else P
