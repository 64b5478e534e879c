"""The weights of covariance intersection by cvxpy and Clarabel: cone programs, canonicalised once for each shape.

cvxpy brings a problem into the form  min q'x  s.t.  b - A x in a product of cones.  In a disciplined parametrised
problem (DPP) the entries of A and b are affine in the parameters theta: they are read off once, at theta = 0 and at
each unit vector. After that other parameters cost a product with a sparse matrix, and the solver's own time.

Source of DPP: A. Agrawal et al., "Differentiable convex optimization layers", NeurIPS 2019.
"""

from contextlib import suppress
from functools import lru_cache
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_array, csr_array

from cooploc.estimators.interface import Array


class Canonical(NamedTuple):
    """min q'x  s.t.  b - A x in the cones, of n variables, l rows and p parameters."""

    entries: int  # of A that are not zero
    fixed: Array  # (entries + l,)  the entries of A, then b, at theta = 0
    slope: Any  # (entries + l, p)  sparse: what each parameter adds to them
    solver: Any  # Clarabel's; it keeps what depends on the shape alone, and no answer depends on the one before


# The program of one fusion: one's own weight w and v = 1 - w weigh terms B_0 and n_k B_k of the information, with
# n_k = v / (sigma_k + (1 - sigma_k) v) at w + v = 1. That is n_k = v + (1 - sigma_k) h_k with the harmonic mean
# h_k = w v / (sigma_k w + v), and a cone for h_k:
#
#     x y >= sigma h^2  with  x = w - h,  y = v - sigma h,   that is   ||(2 sqrt(sigma) h, x - y)|| <= x + y.
#
# So the information is Y(c), linear in c = (w, v, h_1 .. h_k), whose terms are B_0, sum B_k and (1 - sigma_k) B_k.
# Because Y(c) scales with c, the most information from weights that sum to one is the least sum w + v that reaches a
# given information. Of two numbers, in the whitened coordinates, that is a second-order cone program:
#
#     min w + v   s.t.   c >= 0,   X = Y(c) - C,   ||(2 X_12, 2 gamma, X_11 - X_22)|| <= X_11 + X_22,
#
# that is X >= 0 with det X >= gamma^2. The determinant has C = 0, gamma = 1: det Y >= 1. The trace has gamma^2 = det C:
# det Y >= tr(adj(C) Y), which is tr(C Y^-1) <= 1. Every fusion is a program of its own: several in one, the sum of
# theirs, take two thirds of the time, but the solver would couple them in their last bits.


def solve(B: Array, C: Array, sigma: Array, trace: bool) -> Array:
    """Return one's own weights (K,) for `_whiten`'s B, C, sigma of two numbers, to be checked; nan where none."""
    k, own, others = sigma.shape[1], B[:, :1], B[:, 1:]
    terms = np.concatenate([own, others.sum(1, keepdims=True), (1 - sigma)[..., None, None] * others], 1)
    C11, C12, C22 = C[:, 0, 0] * trace, C[:, 0, 1] * trace, C[:, 1, 1] * trace
    gamma = np.sqrt(np.maximum(C11 * C22 - C12**2, 0.0)) if trace else np.ones(len(C))
    theta = terms[..., 0, 0], terms[..., 0, 1], terms[..., 1, 1], C11, C12, C22, gamma, sigma, np.sqrt(sigma)
    program = _cone_program(k)
    entries = (program.slope @ np.column_stack(theta).T).T + program.fixed
    w: Array = np.full(len(B), np.nan)
    for i, (A, b) in enumerate(zip(*np.split(entries, [program.entries], 1), strict=True)):
        with suppress(Exception):  # a solver may raise anything; the exact weight is used then
            program.solver.update(A=A, b=b)
            x = program.solver.solve().x
            w[i] = x[0] / (x[0] + x[1])
    return np.asarray(np.clip(w, 0.0, 1.0))


@lru_cache
def _cone_program(k: int) -> Canonical:
    """Return the program for a reading of k numbers; theta is B_11, B_12, B_22 of each term, C's, gamma, and sigmas."""
    cp: Any = import_module("cvxpy")  # late, because it takes a second; type checkers do not know its atoms
    m = 2 + k
    theta, c = cp.Parameter(3 * m + 4 + 2 * k), cp.Variable(m)  # c = (w, v, h_1 .. h_k)
    constraints = [c >= 0]
    for i in range(k):
        h, sigma, root = c[2 + i], theta[3 * m + 4 + i], theta[3 * m + 4 + k + i]
        x, y = c[0] - h, c[1] - sigma * h
        constraints.append(cp.SOC(x + y, cp.hstack([2 * root * h, x - y])))
    X11, X12, X22 = (theta[i * m : (i + 1) * m] @ c - theta[3 * m + i] for i in range(3))
    constraints.append(cp.SOC(X11 + X22, cp.hstack([2 * X12, 2 * theta[3 * m + 3], X11 - X22])))
    problem = cp.Problem(cp.Minimize(cp.sum(c[:2])), constraints)

    def form(value: Array) -> tuple[dict[str, Any], Array]:
        theta.value = value
        data, _, _ = problem.get_problem_data("CLARABEL")
        return data, np.append(data["A"].data, data["b"])

    data, fixed = form(np.zeros(theta.size))
    slope = csr_array(np.stack([form(unit)[1] - fixed for unit in np.eye(theta.size)], 1))
    of_cvxpy = import_module("cvxpy.reductions.solvers.conic_solvers.clarabel_conif")
    clarabel: Any = import_module("clarabel")
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    settings.iterative_refinement_enable = False  # a third of the time, and as accurate in these coordinates
    settings.equilibrate_enable = settings.presolve_enable = False  # so that only the numbers are new
    A, cones = data["A"], of_cvxpy.dims_to_solver_cones(data["dims"])
    solver = clarabel.DefaultSolver(csc_array((m, m)), data["c"], A, data["b"], cones, settings)
    return Canonical(len(A.data), fixed, slope, solver)
