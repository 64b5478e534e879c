"""Covariance intersection: fusing estimates whose correlation nobody knows.

Two robots that have talked before share errors: each carries some of the other's past. Who fuses their estimates by the
Kalman filter counts the shared part twice and becomes over-confident; who wants to subtract it has to know the
cross-covariance, which no robot keeps. Covariance intersection (CI) fuses x_k, P_k, k = 1 .. m, by

    P^-1 = sum w_k P_k^-1,   P^-1 x = sum w_k P_k^-1 x_k,   w_k >= 0,   sum w_k = 1,                                (1)

and P is at least the mean squared error of x, *whatever* the correlation, as long as each P_k is at least that of x_k.
For two sources: blkdiag(P_1 / w, P_2 / (1 - w)) is at least the joint covariance with any cross-covariance that is
possible, and to fuse what this inflated joint calls independent is (1). (Drawn as ellipses, P encloses the intersection
of the P_k: hence the name.) The price is caution: equal estimates fuse to themselves, for they may be one and the same.

The weights are free, so they minimise the determinant or the trace of P. Both are convex in w. With m = 2 and d = 2 the
minimum is a closed form; if P_1 <= P_2 (nested ellipses) it is w = 1, since there is nothing to gain. The classic
example, P_1 = diag(1, 4) and P_2 = diag(4, 1), gives w = 1/2 and P = 1.6 I.

A *relative measurement* y = h(x_i, x_j) + noise of variance R, with Jacobians H_i and H_j, is used in the same way:
inflate blkdiag(P_i / w, P_j / (1 - w)), then update one's own state by the extended Kalman filter,

    P^-1 = w P_i^-1 + H_i' (H_j P_j H_j' / (1 - w) + R)^-1 H_i.                                                     (2)

This is concave in w, so its determinant and trace are convex too. w = 1 means that the reading cannot help: so it is
for a range between two robots that know their positions equally well, however precise the range.

Sources: (1) S. J. Julier, J. K. Uhlmann, "A non-divergent estimation algorithm in the presence of unknown
correlations", ACC 1997. Several sources, and cheap approximate weights: W. Niehsen, "Information fusion based on fast
covariance intersection filtering", FUSION 2002. Closed forms: M. Reinhardt, B. Noack, U. D. Hanebeck, "Closed-form
optimization of covariance intersection for low-dimensional matrices", FUSION 2012. (2) L. C. Carrillo-Arce et al.,
"Decentralized multi-robot cooperative localization using covariance intersection", IROS 2013.
"""

import logging
from typing import Literal, NamedTuple, get_args

import numpy as np

from cooploc.estimators.covariance_intersection import exact_kernels as exact
from cooploc.estimators.covariance_intersection import scalar_readings
from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.estimators.kalman.update import symmetric
from cooploc.estimators.plugins.errors import BadInput

Criterion = Literal["det", "trace"]
Solver = Literal["cvxpy", "exact"]

TRUSTED = 3e-7  # the gap up to which cvxpy's weights are taken: a determinant is then within 1e-6 up to d = 3

FAULTS = {
    exact.INFINITE: "has some infinite entries; give a large finite variance, or only infinite ones for no knowledge",
    exact.ASYMMETRIC: "is not symmetric; pass (P + P') / 2",
    exact.INDEFINITE: "is not positive definite; its eigenvalues must be above zero by more than rounding",
    exact.SINGULAR: "are too close to singular, or too different, to compute with; limit the ratio of the variances",
}

log = logging.getLogger("cooploc")


class Solution(NamedTuple):
    """Weights, and what is known about how good they are."""

    w: Array  # (K, m), or (K,) of one's own belief in the relative form
    gap: Array  # (K,)  the trace, or the d-th root of the determinant, is at most this much above its least, relatively
    fallback: Mask  # (K,)  cvxpy failed here and the exact method stood in


def weights(P: Array, criterion: Criterion = "det", solver: Solver = "cvxpy", groups: Indices | None = None) -> Array:
    """The weights (K, m) of K independent fusions of m covariances P (K, m, d, d), as `solve` finds them."""
    return solve(P, criterion, solver, groups).w


def solve(P: Array, criterion: Criterion = "det", solver: Solver = "cvxpy", groups: Indices | None = None) -> Solution:
    """The weights that make the fused covariance's determinant or trace least.

    A source with a nan in it is absent: weight 0. So is one that knows nothing, all its variances being infinite. Where
    every source is absent all weights are 0. Sources that are equal bit for bit share their weight equally.

    `groups` (K,) says which fusions cvxpy may stack into one program: those with the same number. Only these can change
    one another, in the last bits; so it must tell trials apart, and robots where that matters. None: all may. The exact
    method takes every fusion by itself.

    Raises:
        BadInput: a covariance is not symmetric and positive definite, or only in part infinite; says which.

    """
    P = np.array(P, float, order="C")
    if P.ndim != 4 or P.shape[-1] != P.shape[-2] or P.shape[-1] == 0:
        raise BadInput(f"P has the shape {P.shape}; covariance intersection takes (fusions, sources, d, d)")
    V, there = _roots(P, "source {k} of fusion {f}")
    mix = there / np.maximum(there.sum(1, keepdims=True), 1)
    rows = np.arange(len(P))
    z = _prepare(V, mix, there, np.empty((len(P), 0)), P.shape[-1], criterion, rows)
    found = _solve(z, _exact(z), solver, groups, rows)
    exact.share(z.B, found.w, _axes(z))
    return found


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
    What a reading says nothing of is inflated by 1 / w all the same; a heading that it does not depend on is safe only
    in a criterion that counts it.

    w is in [LEAST, 1]. It is 1, leave your belief alone, where anything is nan, where the sender knows nothing (every
    variance infinite), and where the reading cannot help. `groups` and errors are as in `solve`.
    """
    P_i, P_j = np.array(P_i, float, order="C"), np.array(P_j, float, order="C")
    R = np.broadcast_to(R, (len(P_i), H_i.shape[1], H_i.shape[1]))
    if not 1 <= block <= P_i.shape[-1]:
        raise BadInput(f"the criterion is about the first {block} states; there are {P_i.shape[-1]}")
    if np.isinf(P_i).any():
        raise BadInput("one's own covariance has infinite entries; give a large finite variance")
    found = Solution(np.ones(len(P_i)), np.zeros(len(P_i)), np.zeros(len(P_i), bool))
    there = _roots(P_j[:, None], "P_j of fusion {f}")[1][:, 0]
    rows = np.flatnonzero(there & ~np.logical_or.reduce([np.isnan(a).any((1, 2)) for a in (P_i, H_i, H_j, R)]))
    if rows.size == 0 or R.shape[-1] == 0:
        return found
    U = _inflation(P_j, H_j)[rows]
    V, sigma = _terms(P_i[rows], H_i[rows], U, R[rows], rows)
    mix = np.concatenate([np.full((len(rows), 1), 0.5), 1 / (1 + sigma)], 1)  # Y at w = 1/2
    z = _prepare(V, mix, np.ones(mix.shape, bool), sigma, block, criterion, rows)
    best, easy = _exact(z), scalar_readings.scalar(H_i[rows], block)
    P, H, q, r = (a[easy] for a in (P_i[rows], H_i[rows], U, R[rows]))
    best.w[easy, 0], best.gap[easy] = scalar_readings.weights(P, H, q, r, criterion)
    part = _solve(z, best, solver, None if groups is None else np.asarray(groups)[rows], rows)
    found.w[rows], found.gap[rows], found.fallback[rows] = part.w[:, 0], part.gap, part.fallback
    return found


# ---------------------------------------------------------------- towards the two solvers


def _inflation(P_j: Array, H_j: Array) -> Array:
    return symmetric(H_j @ P_j @ H_j.mT)


def _roots(P: Array, name: str, rows: Indices | None = None) -> tuple[Array, Mask]:
    """V with V'V proportional to P^-1, zero where a source is absent, and which are there."""
    V, there, fault = np.empty_like(P), np.empty(P.shape[:2], bool), np.zeros((len(P), 2), np.int64)
    exact.roots(P, V, there, fault, (0,) * P.shape[-1])
    _raise(fault, name, rows)
    return V, there


def _raise(fault: Indices, name: str, rows: Indices | None) -> None:
    wrong = np.flatnonzero(fault[:, 0])
    if wrong.size:
        f, (what, k) = wrong[0], fault[wrong[0]]
        raise BadInput(f"{name.format(f=f if rows is None else rows[f], k=k)} {FAULTS[int(what)]}")


def _prepare(
    V: Array, mix: Array, there: Mask, sigma: Array, block: int, criterion: str, rows: Indices
) -> exact.Prepared:
    if criterion not in get_args(Criterion):
        raise BadInput(f"there is no criterion {criterion!r} of covariance intersection; known are det, trace")
    K, d = len(V), V.shape[-1]
    B, C, fault = np.empty_like(V), np.empty((K, d, d)), np.zeros((K, 2), np.int64)
    exact.whiten(V, mix, block, B, C, fault, (0,) * d)
    _raise(fault, "the covariances of fusion {f}", rows)
    return exact.Prepared(B, C, there, sigma, block, criterion == "trace")


def _terms(P_i: Array, H_i: Array, U: Array, R: Array, rows: Indices) -> tuple[Array, Array]:
    """The information (2) as w A + sum n_l h_l h_l': roots of A and of the terms (K, 1 + k, d, d), and sigma (K, k).

    U = H_j P_j H_j' and R are diagonal in common coordinates, sigma and 1 - sigma, in which U / v + R is inverted entry
    by entry: n = v / (sigma + (1 - sigma) v).
    """
    least = np.linalg.eigvalsh(R)
    wrong = np.flatnonzero(least[:, 0] < -1e-12 * np.abs(least[:, -1]))
    if wrong.size:
        raise BadInput(f"the noise R of fusion {rows[wrong[0]]} has a negative eigenvalue; it must be a covariance")
    V = _roots(P_i[:, None], "P_i of fusion {f}", rows)[0]
    L = _roots((U + R)[:, None], "H_j P_j H_j' + R of fusion {f}", rows)[0][:, 0]
    L = L / np.sqrt((L @ (U + R) @ L.mT)[:, :1, :1])
    sigma, axes = np.linalg.eigh(symmetric(L @ U @ L.mT))
    scale = np.sqrt(P_i.diagonal(axis1=1, axis2=2).max(-1, initial=0.0))
    h = np.zeros((*H_i.shape[:2], *P_i.shape[1:]))
    h[:, :, 0] = scale[:, None, None] * (axes.mT @ L @ H_i)
    return np.concatenate([V, h], 1), np.clip(sigma, 1e-15, 1.0)


def _axes(z: exact.Prepared) -> tuple[int, ...]:
    d: int = z.B.shape[-1]
    return (0,) * d


def _solve(z: exact.Prepared, best: Solution, solver: str, groups: Indices | None, rows: Indices) -> Solution:
    if solver not in get_args(Solver):
        raise BadInput(f"there is no solver {solver!r} of covariance intersection; known are cvxpy, exact")
    return best if solver == "exact" else _cvxpy(z, best, groups, rows)


def _exact(z: exact.Prepared) -> Solution:
    K, relative = len(z.B), z.sigma.shape[1] > 0
    w, gap = np.empty((K, 1 if relative else z.B.shape[1])), np.empty(K)
    if relative:
        exact.best_relative(z.B, z.C, z.sigma, z.trace, z.block, w[:, 0], gap, _axes(z))
    else:
        exact.best(z.B, z.C, z.present, z.trace, w, gap, _axes(z))
    return Solution(w, gap, np.zeros(K, bool))


def _value(z: exact.Prepared, w: Array) -> Array:
    value = np.empty(len(w))
    if z.sigma.shape[1]:
        exact.relative_values(z.B, z.C, z.sigma, z.trace, z.block, w[:, 0], value, _axes(z))
    else:
        exact.values(z.B, z.C, z.trace, w, value, _axes(z))
    return value


def _cvxpy(z: exact.Prepared, found: Solution, groups: Indices | None, rows: Indices) -> Solution:
    """cvxpy's weights where there is a choice, held to the bound that the exact method's, `found`, certify.

    What fails that in a stack is tried again alone; where this fails too the exact method stands in.
    """
    groups = np.zeros(len(z.B), np.int64) if groups is None else np.asarray(groups)
    failed = z.present.sum(1) > 1
    for stacks in (groups, np.arange(len(groups))):
        tried = np.flatnonzero(failed)
        if tried.size == 0:
            break
        w, gap = _try(z.take(tried), stacks[tried], found.w[tried], found.gap[tried])
        good = gap <= TRUSTED
        found.w[tried[good]], found.gap[tried[good]] = w[good], gap[good]
        failed[tried[good]] = False
    if failed.any():
        log.warning("cvxpy failed on fusions %s; the exact method stood in", rows[failed].tolist())
    return found._replace(fallback=failed)


def _try(z: exact.Prepared, groups: Indices, best: Array, slack: Array) -> tuple[Array, Array]:
    """cvxpy's weights, tidied up, and their gaps to weights whose own gap, the slack, is certified."""
    from cooploc.estimators.covariance_intersection import cone_program

    w = cone_program.solve(z, groups)
    if z.sigma.shape[1]:  # test w = 1 as well: cvxpy only comes near it
        w = np.maximum(w, exact.LEAST)
        w[(_value(z, np.ones_like(w)) <= _value(z, w)) & np.isfinite(w[:, 0])] = 1.0
    else:
        w = np.where(z.present, w, 0.0)
        w /= w.sum(1, keepdims=True)
    return w, _value(z, w) / (_value(z, best) * (1 - slack)) - 1
