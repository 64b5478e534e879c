"""A cvxpy problem as the solver takes it, canonicalised once: afterwards only its numbers change.

cvxpy brings a problem into the form  min q'x  s.t.  b - A x in a product of cones.  In a disciplined parametrised
problem (DPP) the entries of A and b are affine in the parameters theta. So they are read off once, at theta = 0 and at
each unit vector, and every other theta costs a product with a sparse matrix, and the solver's own time: cvxpy's way
from a problem to its solver takes twenty times as long as the solver does.

Source of DPP: A. Agrawal et al., "Differentiable convex optimization layers", NeurIPS 2019.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_array, csr_array

from cooploc.estimators.interface import Array, Indices


class Canonical(NamedTuple):
    """min q'x  s.t.  b - A x in the cones, of n variables, l rows and p parameters."""

    q: Array  # (n,)
    rows: Indices  # (nonzeros,)  of A, column by column
    starts: Indices  # (n + 1,)  where each column starts
    fixed: Array  # (nonzeros + l,)  the entries of A, then b, at theta = 0
    slope: Any  # (nonzeros + l, p)  sparse: what each parameter adds to them
    cones: list[Any]

    def numbers(self, theta: Array) -> tuple[Array, Array]:
        """The entries of A (K, nonzeros) and b (K, l) for parameters theta (K, p)."""
        both = (self.slope @ theta.T).T + self.fixed
        return both[:, : len(self.rows)], both[:, len(self.rows) :]

    def stacked(self, K: int) -> "Stack":
        """The sum of K such problems, one after the other, without their numbers."""
        n, b = len(self.q), len(self.fixed) - len(self.rows)
        copy = np.arange(K)[:, None]
        starts = np.append(self.starts[:-1] + copy * len(self.rows), K * len(self.rows))
        pattern = np.zeros(K * len(self.rows)), (self.rows + b * copy).ravel(), starts
        nothing = csc_array((K * n, K * n))
        return Stack(np.tile(self.q, K), nothing, csc_array(pattern, shape=(K * b, K * n)), self.cones * K)


class Stack(NamedTuple):
    """K problems as one."""

    q: Array  # (K n,)
    P: Any  # (K n, K n)  sparse: the quadratic objective that Clarabel asks for; zero
    A: Any  # (K l, K n)  sparse
    cones: list[Any]

    def solve(self, A: Array, b: Array, settings: Any) -> Array:
        """What the solver ends with, x (K, n), for the numbers A (K, nonzeros) and b (K, l)."""
        import clarabel

        self.A.data = A.ravel()
        solver = clarabel.DefaultSolver(self.P, self.q, self.A, b.ravel(), self.cones, settings)
        return np.reshape(solver.solve().x, (len(A), -1))


def canonical(problem: Any, theta: Any) -> Canonical:
    """The canonical form of a cvxpy problem with one parameter, the vector theta.

    Raises:
        ValueError: the problem is not DPP, or has a quadratic objective: its form is not affine in theta.

    """
    from cvxpy.reductions.solvers.conic_solvers.clarabel_conif import dims_to_solver_cones

    if not problem.is_dpp():
        raise ValueError("the problem is not affine in its parameter; write it by cvxpy's DPP rules")

    def form(value: Array) -> tuple[dict[str, Any], Array]:
        theta.value = value
        data, _, _ = problem.get_problem_data("CLARABEL")
        return data, np.append(data["A"].data, data["b"])

    data, fixed = form(np.zeros(theta.size))
    if "P" in data:
        raise ValueError("the problem has a quadratic objective; write it as a linear one with a cone")
    slope = np.stack([form(unit)[1] - fixed for unit in np.eye(theta.size)], 1)
    return Canonical(
        data["c"], data["A"].indices, data["A"].indptr, fixed, csr_array(slope), dims_to_solver_cones(data["dims"])
    )
