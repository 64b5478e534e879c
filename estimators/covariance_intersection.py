"""Covariance intersection: fusing estimates whose correlation is unknown.

Two robots that have talked before share errors: each estimate contains some of the other's past. A Kalman filter that
fuses the two counts the shared part twice and becomes over-confident; subtracting it needs the cross-covariance,
which no robot keeps. Covariance intersection inflates both covariances, P_i / w and P_j / (1 - w) with 0 < w < 1: their
block diagonal matrix is at least the joint covariance with *any* possible cross-covariance, and so the two may then be
fused as if they were independent. The price is caution: equal estimates fuse to themselves.

A *relative measurement* y = h(x_i, x_j) + noise of variance R, with Jacobians H_i and H_j, updates one's own state by
the extended Kalman filter after both covariances were inflated,

    P^-1 = w P_i^-1 + H_i' (H_j P_j H_j' / (1 - w) + R)^-1 H_i.    (1)

This is concave in w, so the determinant and the trace of P are convex, and the w that minimises one of them is found
exactly, or by cvxpy. With H_i = I, H_j = -I and R = 0 it is the fusion of two estimates of the same state: diag(1, 4)
with diag(4, 1) gives w = 1/2 and P = 1.6 I. w = 1 means that the reading cannot help, as with a range between two
robots that know their positions equally well, however precise the range.

Sources: S. J. Julier, J. K. Uhlmann, "A non-divergent estimation algorithm in the presence of unknown correlations",
ACC 1997. (1) L. C. Carrillo-Arce et al., "Decentralized multi-robot cooperative localization using covariance
intersection", IROS 2013.
"""

import logging
from typing import Literal, NamedTuple, get_args

import numpy as np

from cooploc.estimators import covariance_intersection_kernels as kernels
from cooploc.estimators.compiled import readable, spread_out
from cooploc.estimators.covariance_intersection_kernels import LEAST, Whitened
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.estimators.kalman import symmetric

Criterion = Literal["det", "trace"]
Solver = Literal["cvxpy", "exact"]

FAULTS = {
    kernels.INFINITE: "has some infinite entries; give a large finite variance, or only infinite ones if unknown",
    kernels.ASYMMETRIC: "is not symmetric; pass (P + P') / 2",
    kernels.INDEFINITE: "is not positive definite; its eigenvalues must be above zero by more than rounding",
    kernels.SINGULAR: "are too close to singular, or too different, to compute with; limit the variances' ratio",
}
TRUSTED = 3e-7  # the gap up to which cvxpy's weights are taken: a determinant is then within 1e-6 up to d = 3

log = logging.getLogger("cooploc")


class Solution(NamedTuple):
    """Weights, and what is known about how good they are."""

    w: Array  # (K,)  of one's own belief
    gap: Array  # (K,)  the trace, or the d-th root of the determinant, is at most this much above its least, relatively
    fallback: Mask  # (K,)  cvxpy failed here and the exact weight was taken instead


def solve_relative(
    P_i: Array,
    P_j: Array,
    H_i: Array,
    H_j: Array,
    R: Array,
    criterion: Criterion = "trace",
    solver: Solver = "cvxpy",
    block: int = 2,
    groups: Indices | None = None,
) -> Solution:
    """Find the best w of (1) for own P_i (K, d, d), received P_j (K, e, e), H_i (K, k, d), H_j (K, k, e), R (k, k).

    w is in [LEAST, 1]. It is 1, which leaves the belief as it is, where anything is nan, where the sender knows nothing
    (every variance infinite), and where the reading cannot help.

    Args:
        P_i, P_j, H_i, H_j, R: the two covariances, and the linearised reading with the covariance of its noise.
        criterion: what is minimised.
        solver: "exact" takes every fusion by itself; "cvxpy" stacks fusions into one cone program.
        block: the criterion is about so many leading states: by default the position, because the trace of a whole pose
            adds m^2 to rad^2, so that its minimum depends on the unit of length. States that a reading says nothing
            about are inflated by 1 / w all the same; a heading is safe only in a criterion that counts it.
        groups: (K,) fusions that cvxpy may stack, those with the same number; None: all may. Stacked fusions change
            one another in the last bits, so the numbers must tell trials apart, and robots where that matters.

    Raises:
        BadInput: there is no such criterion or solver, or a covariance is none, or only in part infinite; says which.

    """
    for kind, name, known in (("criterion", criterion, Criterion), ("solver", solver, Solver)):
        if name not in get_args(known):
            raise BadInput(
                f"there is no {kind} {name!r} of covariance intersection; known are {', '.join(get_args(known))}"
            )
    P_i, P_j = np.array(P_i, float, order="C"), np.array(P_j, float, order="C")
    R = spread_out(np.asarray(R, float), (len(P_i), H_i.shape[1], H_i.shape[1]))
    if not 1 <= block <= P_i.shape[-1]:
        raise BadInput(f"the criterion is about the first {block} states; there are {P_i.shape[-1]}")
    if np.isinf(P_i).any():
        raise BadInput("one's own covariance has infinite entries; give a large finite variance")
    found = Solution(np.ones(len(P_i)), np.zeros(len(P_i)), np.zeros(len(P_i), bool))
    present = _roots(P_j, "P_j of fusion {f}", np.arange(len(P_j)))[1]
    kernels.complete((readable(P_i), readable(H_i), readable(H_j), R), present)
    (rows,) = present.nonzero()
    if rows.size == 0 or R.shape[-1] == 0:
        return found
    P, H, R, U = P_i[rows], H_i[rows], R[rows], symmetric(H_j @ P_j @ H_j.mT)[rows]
    group = np.zeros(len(rows), np.int64) if groups is None else np.asarray(groups)[rows]
    z = _whiten(P, H, U, R, block, criterion, rows, group)
    best = _exact(z, P, H, U, R)
    part = best if solver == "exact" else _by_cvxpy(z, best)
    for all_rows, some in zip(found, part, strict=True):
        all_rows[rows] = some
    return found


def _roots(P: Array, name: str, fusion: Indices) -> tuple[Array, Mask]:
    """V with V'V proportional to P^-1 for P (K, d, d), zero where P is absent, and which are present (K,).

    Raises:
        BadInput: some P is not a covariance; `name` says which, with {f} for the fusion.

    """
    V, fault = np.empty_like(P), np.empty(len(P), np.int64)
    kernels.roots(P, V, fault, (0,) * P.shape[-1])
    _refuse(np.where(fault == kernels.ABSENT, kernels.FINE, fault), name, fusion)
    return V, fault == kernels.FINE


def _refuse(fault: Indices, name: str, fusion: Indices) -> None:
    if fault.any():
        f = fault.nonzero()[0][0]
        raise BadInput(f"{name.format(f=fusion[f])} {FAULTS[int(fault[f])]}")


def _whiten(
    P: Array, H: Array, U: Array, R: Array, block: int, criterion: str, fusion: Indices, group: Indices
) -> Whitened:
    """The information (1) as w A + sum n_l h_l h_l', whitened: the terms are A, h_1, ..., each as a root V with V' V.

    U = H_j P_j H_j' and R are diagonal in common coordinates, sigma and 1 - sigma, in which U / v + R is inverted entry
    by entry: n = v / (sigma + (1 - sigma) v) with v = 1 - w.

    Raises:
        BadInput: P or R is not a covariance, or double precision cannot compare them.

    """
    if not kernels.diagonal(readable(R)):
        least = np.linalg.eigvalsh(R)
        wrong = np.flatnonzero(least[:, 0] < -1e-12 * np.abs(least[:, -1]))
        if wrong.size:
            raise BadInput(
                f"the noise R of fusion {fusion[wrong[0]]} has a negative eigenvalue; it must be a covariance"
            )
    own = _roots(P, "P_i of fusion {f}", fusion)[0]
    L = _roots(U + R, "H_j P_j H_j' + R of fusion {f}", fusion)[0]
    L = L / np.sqrt((L @ (U + R) @ L.mT)[:, :1, :1])
    sigma, axes = np.linalg.eigh(symmetric(L @ U @ L.mT))
    scale = np.sqrt(P.diagonal(axis1=1, axis2=2).max(-1, initial=0.0))
    h = np.zeros((*H.shape[:2], *P.shape[1:]))
    h[:, :, 0] = scale[:, None, None] * (axes.mT @ L @ H)
    sigma = np.minimum(np.maximum(sigma, 1e-15), 1.0)
    V = np.concatenate([own[:, None], h], 1)
    mix = np.concatenate([np.full((len(P), 1), 0.5), 1 / (1 + sigma)], 1)  # the information at w = 1/2
    B, C, fault = np.empty_like(V), np.empty_like(P), np.zeros(len(V), np.int64)
    kernels.whiten(V, mix, block, B, C, fault, (0,) * P.shape[-1])
    _refuse(fault, "the covariances of fusion {f}", fusion)
    return Whitened(B, C, sigma, fusion, group, block, criterion == "trace")


def _exact(z: Whitened, P: Array, H: Array, U: Array, R: Array) -> Solution:
    """The exact weights with their certified gaps: a search, but Newton's method for one number about the position."""
    w, gap = np.empty((2, len(P)))
    kernels.best_relative(z.B, z.C, z.sigma, z.trace, z.block, w, gap, z.axes)
    easy = kernels.is_scalar(H, z.block)
    if easy.any():
        w[easy], gap[easy] = kernels.scalar_weights(P[easy], H[easy], U[easy], R[easy], z.trace)
    return Solution(w, gap, np.zeros(len(P), bool))


def _values(z: Whitened, w: Array) -> Array:
    """The criterion (K,) at weights w (K,)."""
    values = np.empty(len(w))
    kernels.values_relative(z.B, z.C, z.sigma, z.trace, z.block, w, values, z.axes)
    return values


def _by_cvxpy(z: Whitened, best: Solution) -> Solution:
    """cvxpy's weights, held to the bound that the exact ones, `best`, certify.

    A fusion that fails in a stack is tried again alone; where this fails too the exact weight is taken.
    """
    w, gap, failed = best.w.copy(), best.gap.copy(), np.ones(len(best.w), bool)
    for stacks in (z.group, np.arange(len(w))):
        tried = np.flatnonzero(failed)
        if tried.size == 0:
            break
        found, above = _attempt(z.take(tried), stacks[tried], best.w[tried], best.gap[tried])
        good = above <= TRUSTED
        w[tried[good]], gap[tried[good]] = found[good], above[good]
        failed[tried[good]] = False
    if failed.any():
        log.warning("cvxpy failed on fusions %s; the exact weights are used there", z.fusion[failed].tolist())
    return Solution(w, gap, failed)


def _attempt(z: Whitened, stacks: Indices, best: Array, slack: Array) -> tuple[Array, Array]:
    """cvxpy's weights, and their gaps to the `best` weights, whose own certified gap is the slack."""
    from cooploc.estimators import covariance_intersection_cvxpy

    w = np.maximum(covariance_intersection_cvxpy.solve(z, stacks), LEAST)
    w[(_values(z, np.ones_like(w)) <= _values(z, w)) & np.isfinite(w)] = 1.0  # cvxpy only comes near 1
    return w, _values(z, w) / (_values(z, best) * (1 - slack)) - 1
