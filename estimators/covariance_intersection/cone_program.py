"""The weights of covariance intersection by cvxpy and Clarabel: cone programs that are compiled once for each shape.

With d = 2 the fusions of one group are one second-order cone program. In the coordinates of whitening.py, and
because Y(w) scales with w, the most information from weights that sum to one is the least sum of weights that reach a
given information:

    min sum w   s.t.   w >= 0,   X = Y(w) - C,   ||(2 X_12, 2 gamma, X_11 - X_22)|| <= X_11 + X_22,

that is X >= 0 with det X >= gamma^2. The determinant has C = 0, gamma = 1: det Y >= 1. The trace has gamma^2 = det C:
det Y >= tr(adj(C) Y), which is tr(C Y^-1) <= 1. The sum is over fusions too, so that stacking them changes no minimum.
In other dimensions cvxpy's log_det and matrix_frac (which is tr_inv with C) take one fusion at a time.

A relative measurement adds to B_0, one's own, of weight w, terms n_k B_k with n_k = v / (sigma_k + (1 - sigma_k) v) at
w + v = 1. That is n_k = v + (1 - sigma_k) h_k with the harmonic mean h_k = w v / (sigma_k w + v), and a cone for h_k:

    x y >= sigma h^2  with  x = w - h,  y = v - sigma h,   that is   ||(2 sqrt(sigma) h, x - y)|| <= x + y.

So it is a program of the terms B_0 (w), sum B_k (v) and (1 - sigma_k) B_k (h_k), in which only w + v is minimised.

The solver couples the fusions of one program in their last bits. So a program never holds fusions of two groups, never
starts from an earlier solution, and lists its fusions in an order that only their values give.
"""

import threading
import warnings
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.covariance_intersection.whitening import Whitened
from cooploc.estimators.interface import Array, Indices

STACK = 128  # fusions in one program, at most: compiling grows faster than solving
COMPILED = 64  # programs held in memory, at most
TOLERANCE = 1e-10
SETTINGS = {
    "tol_gap_abs": TOLERANCE,
    "tol_gap_rel": TOLERANCE,
    "tol_feas": TOLERANCE,
    "iterative_refinement_enable": False,  # a third of the time, and no more accurate in these coordinates
    "accept_unknown": True,  # the caller checks every answer by its gap
}

_one_at_a_time = threading.Lock()  # a compiled program holds the values of its parameters


class Program(NamedTuple):
    """A compiled problem, its parameters and its variables."""

    problem: Any
    parameters: dict[str, Any]
    c: Any  # (size, m) w, or w, v, h_1 .. h_k
    total: Any  # (size,) sum w, or w + v


def solve(z: Whitened, groups: Indices) -> Array:
    """Weights (K, m), or own weights (K, 1) of the relative form, for the caller to check; nan where there are none."""
    w = np.full((len(z.B), 1 if z.sigma.shape[1] else z.B.shape[1]), np.nan)
    order = np.lexsort((*z.sigma.T, *z.C.T.reshape(-1, len(w)), *z.B.T.reshape(-1, len(w)), groups))
    most = STACK if z.B.shape[-1] == z.block == 2 else 1
    for group in np.split(order, np.flatnonzero(np.diff(groups[order])) + 1):
        for i in range(0, len(group), most):
            w[group[i : i + most]] = _solve(z.take(group[i : i + most]))
    return w


def _solve(z: Whitened) -> Array:
    """One program."""
    K, k = len(z.B), z.sigma.shape[1]
    z = z.take(np.minimum(np.arange(_size(K)), K - 1))  # the last one again, up to a size that is compiled
    B = _terms(z)
    size, m, d, _ = B.shape
    cone = d == z.block == 2
    values = {**(_cone_values(B, z) if cone else _matrix_values(B, z)), **_harmonic_values(z.sigma)}
    with _one_at_a_time, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "may be inaccurate": the caller checks that
        program = _cone_program(size, m, k) if cone else _matrix_program(m, d, z.block, k, z.trace)
        for name, value in values.items():
            program.parameters[name].value = value
        try:
            program.problem.solve(solver="CLARABEL", warm_start=False, **SETTINGS)
        except Exception:  # a solver may raise anything; the exact weights are used then
            return np.full((K, 1 if k else m), np.nan)
        if program.c.value is None:
            return np.full((K, 1 if k else m), np.nan)
        w: Array = program.c.value / program.total.value[:, None]
    return np.clip(w[:K, : 1 if k else m], 0.0, 1.0)


def _terms(z: Whitened) -> Array:
    """The matrices that the variables multiply (K, m, d, d)."""
    if not z.sigma.shape[1]:
        return z.B
    return np.concatenate(
        [z.B[:, :1], z.B[:, 1:].sum(1, keepdims=True), (1 - z.sigma)[..., None, None] * z.B[:, 1:]], 1
    )


def _size(K: int) -> int:
    """K rounded up to three binary digits, so that few sizes are compiled and few fusions are idle."""
    step = 1 << max(K.bit_length() - 3, 0)
    return -(-K // step) * step


def _cone_values(B: Array, z: Whitened) -> dict[str, Array]:
    C = z.C if z.trace else np.zeros_like(z.C)
    gamma = np.sqrt(np.maximum(C[:, 0, 0] * C[:, 1, 1] - C[:, 0, 1] ** 2, 0.0)) if z.trace else np.ones(len(C))
    entries = {f"{name}{i}{j}": X[..., i, j] for name, X in (("B", B), ("C", C)) for i, j in ((0, 0), (0, 1), (1, 1))}
    return {**entries, "gamma": gamma}


def _matrix_values(B: Array, z: Whitened) -> dict[str, Array]:
    values = {f"B{k}": B[0, k] for k in range(B.shape[1])}
    if z.trace:
        scale, axes = np.linalg.eigh(z.C[0, : z.block, : z.block])
        values["F"] = axes * np.sqrt(np.maximum(scale, 0.0))
    return values


def _harmonic_values(sigma: Array) -> dict[str, Array]:
    named = {"sigma": sigma, "root": np.sqrt(sigma)}
    return {f"{name}{i}": value[:, i] for name, value in named.items() for i in range(sigma.shape[1])}


@lru_cache(COMPILED)
def _cone_program(size: int, m: int, k: int) -> Program:
    """The second-order cone program of `size` fusions of m terms, k of which are of a relative measurement; d = 2."""
    cp = _cvxpy()

    c, total, constraints, parameters = _shares(size, m, k)
    X = []
    for ij in ("00", "01", "11"):
        parameters["B" + ij], parameters["C" + ij] = B, C = cp.Parameter((size, m)), cp.Parameter(size)
        X.append(cp.sum(cp.multiply(B, c), axis=1) - C)
    gamma = parameters["gamma"] = cp.Parameter(size)
    constraints.append(cp.SOC(X[0] + X[2], cp.vstack([2 * X[1], 2 * gamma, X[0] - X[2]]), axis=0))
    return Program(cp.Problem(cp.Minimize(cp.sum(total)), constraints), parameters, c, total)


@lru_cache(COMPILED)
def _matrix_program(m: int, d: int, block: int, k: int, trace: bool) -> Program:
    """One fusion in any dimension. X is Y, or what a block of it keeps when the other states are marginalised out."""
    cp = _cvxpy()

    c, total, constraints, parameters = _shares(1, m, k)
    B = {f"B{i}": cp.Parameter((d, d), symmetric=True) for i in range(m)}
    X = Y = sum(c[0, i] * B[f"B{i}"] for i in range(m))
    if block < d:
        X = cp.Variable((block, block), symmetric=True)
        E = np.eye(d)[:, :block]
        constraints.append(Y - E @ X @ E.T >> 0)
    if trace:
        parameters["F"] = cp.Parameter((block, block))
        constraints.append(cp.matrix_frac(parameters["F"], X) <= 1)
    else:
        constraints.append(cp.log_det(X) >= 0)
    return Program(cp.Problem(cp.Minimize(cp.sum(total)), constraints), {**parameters, **B}, c, total)


def _shares(size: int, m: int, k: int) -> tuple[Any, Any, list[Any], dict[str, Any]]:
    """The variables c, what is minimised, and the harmonic means of a relative measurement with their parameters."""
    cp = _cvxpy()
    c = cp.Variable((size, m), nonneg=True)
    if k == 0:
        return c, cp.sum(c, axis=1), [], {}
    constraints: list[Any] = []
    parameters: dict[str, Any] = {}
    for i in range(k):
        sigma, root = parameters[f"sigma{i}"], parameters[f"root{i}"] = cp.Parameter(size), cp.Parameter(size)
        h = c[:, 2 + i]
        x, y = c[:, 0] - h, c[:, 1] - cp.multiply(sigma, h)
        constraints.append(cp.SOC(x + y, cp.vstack([2 * cp.multiply(root, h), x - y]), axis=0))
    return c, c[:, 0] + c[:, 1], constraints, parameters


def _cvxpy() -> Any:
    """Imported late, because it takes a second; its atoms are not visible to type checkers."""
    import cvxpy

    return cvxpy
