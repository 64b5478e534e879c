"""Covariance intersection: fusing estimates whose correlation is unknown.

Two robots that have talked before share errors: each estimate contains some of the other's past. A Kalman filter that
fuses the two counts the shared part twice and becomes over-confident; subtracting it needs the cross-covariance,
which no robot keeps. Covariance intersection (CI) fuses x_k, P_k, k = 1 .. m, by

    P^-1 = sum w_k P_k^-1,   P^-1 x = sum w_k P_k^-1 x_k,   w_k >= 0,   sum w_k = 1,    (1)

and P is at least the mean squared error of x, *whatever* the correlation, as long as each P_k is at least that of
x_k. For two sources: blkdiag(P_1 / w, P_2 / (1 - w)) is at least the joint covariance with any possible
cross-covariance, and fusing the two as if they were independent, with these inflated covariances, is (1). (Drawn as
ellipses, P encloses the intersection of the P_k: hence the name.) The price is caution: equal estimates fuse to
themselves, since they may be the same estimate.

The weights are free, so they minimise the determinant or the trace of P. Both are convex in w. With m = 2 and d = 2
the minimum is a closed form; if P_1 <= P_2 (nested ellipses) it is w = 1, since there is nothing to gain. The classic
example, P_1 = diag(1, 4) and P_2 = diag(4, 1), gives w = 1/2 and P = 1.6 I.

A *relative measurement* y = h(x_i, x_j) + noise of variance R, with Jacobians H_i and H_j, is used in the same way:
inflate blkdiag(P_i / w, P_j / (1 - w)), then update one's own state by the extended Kalman filter,

    P^-1 = w P_i^-1 + H_i' (H_j P_j H_j' / (1 - w) + R)^-1 H_i.    (2)

This is concave in w, so its determinant and trace are convex too. w = 1 means that the reading cannot help, as with a
range between two robots that know their positions equally well, however precise the range.

Sources: (1) S. J. Julier, J. K. Uhlmann, "A non-divergent estimation algorithm in the presence of unknown
correlations", ACC 1997. Several sources, and cheap approximate weights: W. Niehsen, "Information fusion based on fast
covariance intersection filtering", FUSION 2002. Closed forms: M. Reinhardt, B. Noack, U. D. Hanebeck, "Closed-form
optimization of covariance intersection for low-dimensional matrices", FUSION 2012. (2) L. C. Carrillo-Arce et al.,
"Decentralized multi-robot cooperative localization using covariance intersection", IROS 2013.
"""

import logging
from typing import Literal, NamedTuple, get_args

import numpy as np

from cooploc.estimators import covariance_intersection_kernels as kernels
from cooploc.estimators.compiled import readable, spread_out
from cooploc.estimators.covariance_intersection_kernels import LEAST, Whitened, complete
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.estimators.kalman import symmetric

# Covariances as they are given: what is wrong with one is named, then a call's fusions are whitened.

Criterion = Literal["det", "trace"]
CRITERIA = get_args(Criterion)

FAULTS = {
    kernels.INFINITE: "has some infinite entries; give a large finite variance, or only infinite ones if unknown",
    kernels.ASYMMETRIC: "is not symmetric; pass (P + P') / 2",
    kernels.INDEFINITE: "is not positive definite; its eigenvalues must be above zero by more than rounding",
    kernels.SINGULAR: "are too close to singular, or too different, to compute with; limit the variances' ratio",
}


class Terms(NamedTuple):
    """The information of K fusions as roots: term k of a fusion is V_k' V_k."""

    V: Array  # (K, m, d, d)  zero where a source is absent
    mix: Array  # (K, m)  shares of the terms in what is whitened
    present: Mask  # (K, m)
    sigma: Array  # (K, k)  of a relative reading, see `relative_terms`; else (K, 0)


def whiten_terms(terms: Terms, block: int, criterion: str, fusion: Indices, groups: Indices | None) -> Whitened:
    """The terms in the whitened coordinates; `fusion` (K,) numbers them in messages, `groups` (K,) in stacks.

    Raises:
        BadInput: the criterion does not exist, or double precision cannot compare the covariances.

    """
    if criterion not in CRITERIA:
        raise BadInput(f"there is no criterion {criterion!r} of covariance intersection; known are det, trace")
    V, mix, present, sigma = terms
    B, C, fault = np.empty_like(V), np.empty((len(V), *V.shape[2:])), np.zeros((len(V), 2), np.int64)
    kernels.whiten(V, mix, block, B, C, fault, (0,) * V.shape[-1])
    _refuse(fault, "the covariances of fusion {f}", fusion)
    group = np.zeros(len(V), np.int64) if groups is None else np.asarray(groups)
    return Whitened(B, C, present, sigma, fusion, group, block, criterion == "trace")


def roots(P: Array, name: str, fusion: Indices) -> tuple[Array, Mask]:
    """V with V'V proportional to P^-1 for P (K, m, d, d), zero where a source is absent, and which are present (K, m).

    Raises:
        BadInput: some P is not a covariance; `name` says which, with {f} for the fusion and {k} for the source.

    """
    V, present, fault = np.empty_like(P), np.empty(P.shape[:2], bool), np.zeros((len(P), 2), np.int64)
    kernels.roots(P, V, present, fault, (0,) * P.shape[-1])
    _refuse(fault, name, fusion)
    return V, present


def relative_terms(P_i: Array, H_i: Array, U: Array, R: Array, fusion: Indices) -> Terms:
    """The information after a relative reading, (2) of weights.py, as w A + sum n_l h_l h_l': the terms are A, h_1, ...

    U = H_j P_j H_j' and R are diagonal in common coordinates, sigma and 1 - sigma, in which U / v + R is inverted entry
    by entry: n = v / (sigma + (1 - sigma) v).
    """
    if not kernels.diagonal(readable(R)):
        least = np.linalg.eigvalsh(R)
        wrong = np.flatnonzero(least[:, 0] < -1e-12 * np.abs(least[:, -1]))
        if wrong.size:
            raise BadInput(
                f"the noise R of fusion {fusion[wrong[0]]} has a negative eigenvalue; it must be a covariance"
            )
    V = roots(P_i[:, None], "P_i of fusion {f}", fusion)[0]
    L = roots((U + R)[:, None], "H_j P_j H_j' + R of fusion {f}", fusion)[0][:, 0]
    L = L / np.sqrt((L @ (U + R) @ L.mT)[:, :1, :1])
    sigma, axes = np.linalg.eigh(symmetric(L @ U @ L.mT))
    scale = np.sqrt(P_i.diagonal(axis1=1, axis2=2).max(-1, initial=0.0))
    h = np.zeros((*H_i.shape[:2], *P_i.shape[1:]))
    h[:, :, 0] = scale[:, None, None] * (axes.mT @ L @ H_i)
    sigma = np.minimum(np.maximum(sigma, 1e-15), 1.0)
    mix = np.concatenate([np.full((len(P_i), 1), 0.5), 1 / (1 + sigma)], 1)  # the information at w = 1/2
    return Terms(np.concatenate([V, h], 1), mix, np.ones(mix.shape, bool), sigma)


def _refuse(fault: Indices, name: str, fusion: Indices) -> None:
    if fault.any():
        f = fault[:, 0].nonzero()[0][0]
        what, k = fault[f]
        raise BadInput(f"{name.format(f=fusion[f], k=k)} {FAULTS[int(what)]}")


# The two ways to solve whitened fusions: exactly, or by cvxpy, whose weights are checked against the exact ones.

Solver = Literal["cvxpy", "exact"]
SOLVERS = get_args(Solver)

TRUSTED = 3e-7  # the gap up to which cvxpy's weights are taken: a determinant is then within 1e-6 up to d = 3

log = logging.getLogger("cooploc")


class Solution(NamedTuple):
    """Weights, and what is known about how good they are."""

    w: Array  # (K, m), or (K,) of one's own belief in the relative form
    gap: Array  # (K,)  the trace, or the d-th root of the determinant, is at most this much above its least, relatively
    fallback: Mask  # (K,)  cvxpy failed here and the exact weight was taken instead


def solve_whitened(z: Whitened, best: Solution, solver: str) -> Solution:
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
        kernels.best_relative(z.B, z.C, z.sigma, z.trace, z.block, w[:, 0], gap, z.axes)
    else:
        kernels.best_of_several(z.B, z.C, z.present, z.trace, w, gap, z.axes)
    return Solution(w, gap, np.zeros(K, bool))


def _values(z: Whitened, w: Array) -> Array:
    """The criterion (K,) at weights w."""
    values = np.empty(len(w))
    if z.relative:
        kernels.values_relative(z.B, z.C, z.sigma, z.trace, z.block, w[:, 0], values, z.axes)
    else:
        kernels.values_of_several(z.B, z.C, z.trace, w, values, z.axes)
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
    from cooploc.estimators import covariance_intersection_cvxpy

    w = covariance_intersection_cvxpy.solve(z, stacks)
    if z.relative:  # test w = 1 as well: cvxpy only comes near it
        w = np.maximum(w, LEAST)
        w[(_values(z, np.ones_like(w)) <= _values(z, w)) & np.isfinite(w[:, 0])] = 1.0
    else:
        w = np.where(z.present, w, 0.0)
        w /= w.sum(1, keepdims=True)
    return w, _values(z, w) / (_values(z, best) * (1 - slack)) - 1


def weights(P: Array, criterion: Criterion = "det", solver: Solver = "cvxpy", groups: Indices | None = None) -> Array:
    """The weights (K, m) of K independent fusions of m covariances P (K, m, d, d), as `solve` finds them."""
    return solve(P, criterion, solver, groups).w


def solve(P: Array, criterion: Criterion = "det", solver: Solver = "cvxpy", groups: Indices | None = None) -> Solution:
    """The weights that minimise the determinant or the trace of the fused covariance.

    A source with a nan in it is absent: weight 0. So is one that knows nothing, all its variances being infinite. Where
    every source is absent all weights are 0. Sources that are equal bit for bit share their weight equally.

    Args:
        P: covariances (K, m, d, d).
        criterion: what is minimised.
        solver: "exact" takes every fusion by itself; "cvxpy" stacks fusions into one program.
        groups: (K,) fusions that cvxpy may stack, those with the same number; None: all may. Stacked fusions change
            one another in the last bits, so the numbers must tell trials apart, and robots where that matters.

    Raises:
        BadInput: a covariance is not symmetric and positive definite, or only in part infinite; says which.

    """
    P = np.array(P, float, order="C")
    if P.ndim != 4 or P.shape[-1] != P.shape[-2] or P.shape[-1] == 0:
        raise BadInput(f"P has the shape {P.shape}; covariance intersection takes (fusions, sources, d, d)")
    fusion = np.arange(len(P))
    V, present = roots(P, "source {k} of fusion {f}", fusion)
    mix = present / np.maximum(present.sum(1, keepdims=True), 1)
    z = whiten_terms(Terms(V, mix, present, np.empty((len(P), 0))), P.shape[-1], criterion, fusion, groups)
    found = solve_whitened(z, exact(z), solver)
    return found._replace(w=_share_equally(found.w, z.B))


def _share_equally(w: Array, B: Array) -> Array:
    """Sources (K, m) whose information is the same, bit for bit, share their weight equally."""
    same = (B[:, :, None] == B[:, None]).all((-2, -1))
    total = sum((same[:, :, j] * w[:, j, None] for j in range(w.shape[1])), np.zeros_like(w))  # in order, for the bits
    return np.asarray(total / same.sum(-1))


def intersect(x: Array, P: Array, w: Array) -> tuple[Array, Array]:
    """Equation (1): x (K, m, d), P (K, m, d, d), w (K, m) fused to (K, d), (K, d, d); nan where every weight is 0."""
    used = w > 0
    A = w[..., None, None] * np.linalg.inv(np.where(used[..., None, None], P, np.eye(P.shape[-1])))
    nothing = np.asarray(~used.any(-1))
    fused = symmetric(np.linalg.inv(np.where(nothing[:, None, None], np.eye(P.shape[-1]), A.sum(1))))
    fused[nothing] = np.nan
    y = (A @ np.where(used[..., None], x, 0.0)[..., None]).sum(1)
    return (fused @ y)[..., 0], fused


def relative_weights(
    P_i: Array,
    P_j: Array,
    H_i: Array,
    H_j: Array,
    R: Array,
    criterion: Criterion = "trace",
    solver: Solver = "cvxpy",
    block: int = 2,
    groups: Indices | None = None,
) -> Array:
    """The weights (K,) of one's own belief in K updates by a relative measurement, as `solve_relative` finds them."""
    return solve_relative(P_i, P_j, H_i, H_j, R, criterion, solver, block, groups).w


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
    """The w of equation (2) for own P_i (K, d, d), received P_j (K, e, e), H_i (K, k, d), H_j (K, k, e), R (k, k).

    The criterion is about the first `block` states: by default the position, because the trace of a whole pose adds m^2
    to rad^2, so that its minimum depends on the unit of length. With block = d the determinant has no such trouble.
    States that a reading says nothing about are inflated by 1 / w all the same; a heading that the reading does not
    depend on is safe only in a criterion that counts it.

    w is in [LEAST, 1]. It is 1, which leaves the belief as it is, where anything is nan, where the sender knows nothing
    (every variance infinite), and where the reading cannot help. `groups` and errors are as in `solve`.
    """
    P_i, P_j = np.array(P_i, float, order="C"), np.array(P_j, float, order="C")
    R = spread_out(np.asarray(R, float), (len(P_i), H_i.shape[1], H_i.shape[1]))
    if not 1 <= block <= P_i.shape[-1]:
        raise BadInput(f"the criterion is about the first {block} states; there are {P_i.shape[-1]}")
    if np.isinf(P_i).any():
        raise BadInput("one's own covariance has infinite entries; give a large finite variance")
    found = Solution(np.ones(len(P_i)), np.zeros(len(P_i)), np.zeros(len(P_i), bool))
    present = roots(P_j[:, None], "P_j of fusion {f}", np.arange(len(P_j)))[1][:, 0]
    complete((readable(P_i), readable(H_i), readable(H_j), R), present)
    (rows,) = present.nonzero()
    if rows.size == 0 or R.shape[-1] == 0:
        return found
    P, H, R, U = P_i[rows], H_i[rows], R[rows], symmetric(H_j @ P_j @ H_j.mT)[rows]
    groups = None if groups is None else np.asarray(groups)[rows]
    z = whiten_terms(relative_terms(P, H, U, R, rows), block, criterion, rows, groups)
    best, easy = exact(z), kernels.is_scalar(H, block)
    if easy.any():
        best.w[easy, 0], best.gap[easy] = kernels.scalar_weights(P[easy], H[easy], U[easy], R[easy], criterion)
    part = solve_whitened(z, best, solver)
    found.w[rows], found.gap[rows], found.fallback[rows] = part.w[:, 0], part.gap, part.fallback
    return found
