"""The two ways to solve whitened fusions: exactly, or by cvxpy, whose weights are checked against the exact ones."""

import logging
from typing import Literal, NamedTuple, get_args

import numpy as np

from cooploc.estimators.covariance_intersection import relative_reading, several_sources
from cooploc.estimators.covariance_intersection.criterion import LEAST
from cooploc.estimators.covariance_intersection.whitening import Whitened
from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.estimators.plugins.errors import BadInput

Solver = Literal["cvxpy", "exact"]
SOLVERS = get_args(Solver)

TRUSTED = 3e-7  # the gap up to which cvxpy's weights are taken: a determinant is then within 1e-6 up to d = 3

log = logging.getLogger("cooploc")


class Solution(NamedTuple):
    """Weights, and what is known about how good they are."""

    w: Array  # (K, m), or (K,) of one's own belief in the relative form
    gap: Array  # (K,)  the trace, or the d-th root of the determinant, is at most this much above its least, relatively
    fallback: Mask  # (K,)  cvxpy failed here and the exact weight was taken instead


def solve(z: Whitened, best: Solution, solver: str) -> Solution:
    """The weights by this solver, where `best` are the exact ones.

    Raises:
        BadInput: there is no such solver.

    """
    if solver not in SOLVERS:
        raise BadInput(f"there is no solver {solver!r} of covariance intersection; known are cvxpy, exact")
    return best if solver == "exact" else _by_cvxpy(z, best)


def exact(z: Whitened) -> Solution:
    """The exact weights (K, m), or one's own (K, 1) in the relative form, with their certified gaps."""
    K = len(z.B)
    w, gap = np.empty((K, 1 if z.relative else z.B.shape[1])), np.empty(K)
    if z.relative:
        relative_reading.best(z.B, z.C, z.sigma, z.trace, z.block, w[:, 0], gap, z.axes)
    else:
        several_sources.best(z.B, z.C, z.present, z.trace, w, gap, z.axes)
    return Solution(w, gap, np.zeros(K, bool))


def _values(z: Whitened, w: Array) -> Array:
    """The criterion (K,) at weights w."""
    values = np.empty(len(w))
    if z.relative:
        relative_reading.values(z.B, z.C, z.sigma, z.trace, z.block, w[:, 0], values, z.axes)
    else:
        several_sources.values(z.B, z.C, z.trace, w, values, z.axes)
    return values


def _by_cvxpy(z: Whitened, found: Solution) -> Solution:
    """cvxpy's weights where there is a choice, held to the bound that the exact ones, `found`, certify.

    A fusion that fails in a stack is tried again alone; where this fails too the exact weights are taken.
    """
    failed = z.present.sum(1) > 1
    for stacks in (z.group, np.arange(len(z.B))):
        tried = np.flatnonzero(failed)
        if tried.size == 0:
            break
        w, gap = _attempt(z.take(tried), stacks[tried], found.w[tried], found.gap[tried])
        good = gap <= TRUSTED
        found.w[tried[good]], found.gap[tried[good]] = w[good], gap[good]
        failed[tried[good]] = False
    if failed.any():
        log.warning("cvxpy failed on fusions %s; the exact weights are used there", z.fusion[failed].tolist())
    return found._replace(fallback=failed)


def _attempt(z: Whitened, stacks: Indices, best: Array, slack: Array) -> tuple[Array, Array]:
    """cvxpy's weights, cleaned, and their gaps to the `best` weights, whose own certified gap is the slack."""
    from cooploc.estimators.covariance_intersection import cone_program

    w = cone_program.solve(z, stacks)
    if z.relative:  # test w = 1 as well: cvxpy only comes near it
        w = np.maximum(w, LEAST)
        w[(_values(z, np.ones_like(w)) <= _values(z, w)) & np.isfinite(w[:, 0])] = 1.0
    else:
        w = np.where(z.present, w, 0.0)
        w /= w.sum(1, keepdims=True)
    return w, _values(z, w) / (_values(z, best) * (1 - slack)) - 1
