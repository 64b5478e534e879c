"""Covariance intersection: fusing estimates whose correlation is unknown.

Two robots that have talked before share errors: each estimate contains some of the other's past. A Kalman filter that
fuses the two counts the shared part twice and becomes over-confident; subtracting it needs the cross-covariance, which
no robot keeps. Covariance intersection (CI) fuses x_k, P_k, k = 1 .. m, by

    P^-1 = sum w_k P_k^-1,   P^-1 x = sum w_k P_k^-1 x_k,   w_k >= 0,   sum w_k = 1,                                (1)

and P is at least the mean squared error of x, *whatever* the correlation, as long as each P_k is at least that of x_k.
For two sources: blkdiag(P_1 / w, P_2 / (1 - w)) is at least the joint covariance with any possible cross-covariance,
and fusing the two as if they were independent, with these inflated covariances, is (1). (Drawn as ellipses, P encloses
the intersection of the P_k: hence the name.) The price is caution: equal estimates fuse to themselves, since they may
be the same estimate.

The weights are free, so they minimise the determinant or the trace of P. Both are convex in w. With m = 2 and d = 2 the
minimum is a closed form; if P_1 <= P_2 (nested ellipses) it is w = 1, since there is nothing to gain. The classic
example, P_1 = diag(1, 4) and P_2 = diag(4, 1), gives w = 1/2 and P = 1.6 I.

A *relative measurement* y = h(x_i, x_j) + noise of variance R, with Jacobians H_i and H_j, is used in the same way:
inflate blkdiag(P_i / w, P_j / (1 - w)), then update one's own state by the extended Kalman filter,

    P^-1 = w P_i^-1 + H_i' (H_j P_j H_j' / (1 - w) + R)^-1 H_i.                                                     (2)

This is concave in w, so its determinant and trace are convex too. w = 1 means that the reading cannot
help, as with a range between two robots that know their positions equally well, however precise the range.

Sources: (1) S. J. Julier, J. K. Uhlmann, "A non-divergent estimation algorithm in the presence of unknown
correlations", ACC 1997. Several sources, and cheap approximate weights: W. Niehsen, "Information fusion based on fast
covariance intersection filtering", FUSION 2002. Closed forms: M. Reinhardt, B. Noack, U. D. Hanebeck, "Closed-form
optimization of covariance intersection for low-dimensional matrices", FUSION 2012. (2) L. C. Carrillo-Arce et al.,
"Decentralized multi-robot cooperative localization using covariance intersection", IROS 2013.
"""

import numpy as np

from cooploc.estimators.compiled.jit import readable, spread_out
from cooploc.estimators.covariance_intersection import scalar_readings, solvers
from cooploc.estimators.covariance_intersection.solvers import Solution, Solver
from cooploc.estimators.covariance_intersection.sources import Criterion, Terms, relative_terms, roots, whitened
from cooploc.estimators.covariance_intersection.whitening import complete
from cooploc.estimators.interface import Array, Indices
from cooploc.estimators.kalman.update import symmetric
from cooploc.estimators.plugins.errors import BadInput


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
    z = whitened(Terms(V, mix, present, np.empty((len(P), 0))), P.shape[-1], criterion, fusion, groups)
    found = solvers.solve(z, solvers.exact(z), solver)
    return found._replace(w=_shared(found.w, z.B))


def _shared(w: Array, B: Array) -> Array:
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
    z = whitened(relative_terms(P, H, U, R, rows), block, criterion, rows, groups)
    best, easy = solvers.exact(z), scalar_readings.scalar(H, block)
    if easy.any():
        best.w[easy, 0], best.gap[easy] = scalar_readings.weights(P[easy], H[easy], U[easy], R[easy], criterion)
    part = solvers.solve(z, best, solver)
    found.w[rows], found.gap[rows], found.fallback[rows] = part.w[:, 0], part.gap, part.fallback
    return found
