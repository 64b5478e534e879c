"""Covariance intersection against brute force in extended precision, and against what the theory promises.

The oracles work on the covariances as they come, in 80-bit floats: no whitening, no closed form, no gradient.
"""

import logging

import numpy as np
import pytest

from cooploc.estimators import covariance_intersection_cvxpy
from cooploc.estimators.covariance_intersection import solve_relative
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Belief
from cooploc.estimators.kalman import inflated_update

CRITERIA = pytest.mark.parametrize("criterion", ["det", "trace"])
SOLVERS = pytest.mark.parametrize("solver", ["exact", "cvxpy"])
Long = np.longdouble

# ---------------------------------------------------------------- oracles


def inverse(A):
    """Gauss and Jordan, without pivoting: A (..., d, d) is positive definite."""
    d = A.shape[-1]
    A = np.concatenate([A.astype(Long), np.broadcast_to(np.eye(d, dtype=Long), A.shape)], -1)
    for i in range(d):
        A[..., i, :] /= A[..., i, i, None].copy()
        for j in range(d):
            if j != i:
                A[..., j, :] -= A[..., j, i, None].copy() * A[..., i, :]
    return A[..., d:]


def size(P, criterion):
    """The trace of P (..., d, d), or the determinant by elimination."""
    if criterion == "trace":
        return np.trace(P, axis1=-2, axis2=-1)
    P, det = P.copy(), Long(1)
    for i in range(P.shape[-1]):
        det = det * P[..., i, i]
        for j in range(i + 1, P.shape[-1]):
            P[..., j, :] -= (P[..., j, i] / P[..., i, i])[..., None] * P[..., i, :]
    return det


def related(problem, w, criterion, block):
    """The criterion (K, n) after the EKF update of a belief inflated by 1/w (K, n), by a sender inflated by 1/(1-w)."""
    P_i, P_j, H_i, H_j, R = (a.astype(Long)[:, None] for a in problem)
    w = w.astype(Long)[..., None, None]
    N = inverse(H_j @ P_j @ H_j.mT + (1 - w) * R)
    P = inverse(w * inverse(P_i) + (1 - w) * H_i.mT @ N @ H_i)
    return size(P[..., :block, :block], criterion)


def scan(f, count):
    """The least that the convex f (K, n) -> (K, n) is on [1e-6, 1]: grids within grids."""
    a, b, row = np.full(count, Long(1e-6)), np.full(count, Long(1)), np.arange(count)
    for _ in range(14):
        grid = a[:, None] + (b - a)[:, None] * np.linspace(0, 1, 41, dtype=Long)
        value = f(grid)
        i = value.argmin(1)
        a, b = grid[row, np.maximum(i - 1, 0)], grid[row, np.minimum(i + 1, 40)]
    return value[row, i]


# ---------------------------------------------------------------- inputs


def random(rng, values):
    """Covariances with these eigenvalues (..., d)."""
    q, _ = np.linalg.qr(rng.normal(size=(*values.shape, values.shape[-1])))
    P = (q * values[..., None, :]) @ q.mT
    return (P + P.mT) / 2


def ordinary(rng, K, m, d):
    return random(rng, rng.uniform(0.05, 1.0, (K, m, d)))


def near_singular(rng, K, m, d):
    return random(rng, 10 ** -rng.uniform(0, 10, (K, m, d)))


def of_some_size(rng, K, m, d):
    """As far apart as three covariances may be for 80-bit floats to tell."""
    return random(rng, 10 ** -rng.uniform(0, 4, (K, m, d))) * 10 ** rng.uniform(-4, 4, (K, m, 1, 1))


def relation(rng, K, k=1, d=2, e=2, family=ordinary):
    """P_i, P_j, H_i, H_j, R of K relative measurements."""
    P_i, P_j, R = (family(rng, K, 1, n)[:, 0] for n in (d, e, k))
    return P_i, P_j, rng.normal(size=(K, k, d)), rng.normal(size=(K, k, e)), R


INFINITE = [np.diag([1.0, np.inf]), [[1.0, np.inf], [np.inf, 1.0]], np.diag([-np.inf, 1.0])]
INDEFINITE = [np.diag([1.0, -1.0]), np.ones((2, 2)), np.zeros((2, 2)), [[1.0, 2.0], [2.0, 1.0]], [[2.0, 1.0], [0, 2]]]


@pytest.mark.parametrize("bad", [*INFINITE, *INDEFINITE], ids=str)
def test_what_is_no_covariance_is_named(bad):
    problem = relation(np.random.default_rng(6), 9)
    problem[1][7] = bad
    with pytest.raises(BadInput, match=r"P_j of fusion 7 is not a covariance"):
        solve_relative(*problem)


# ---------------------------------------------------------------- alone and in company, and fallbacks


def test_cvxpys_bits_depend_on_the_fusion_alone():
    """Whatever else is in the call, and whatever its solver solved before."""
    rng = np.random.default_rng(12)
    problem = relation(rng, 150)
    everything, rows = solve_relative(*problem).w, rng.permutation(150)[:50]
    np.testing.assert_array_equal(solve_relative(*(a[rows] for a in problem)).w, everything[rows])


def test_a_fusion_that_cvxpy_fails_on_is_named_and_counted(monkeypatch, caplog):
    problem = relation(np.random.default_rng(15), 30)
    problem[1][3] = np.nan
    exact = solve_relative(*problem, solver="exact")
    solve_all = covariance_intersection_cvxpy.solve

    def fails(*problem):
        return np.where(np.arange(29) == 16, np.nan, solve_all(*problem))  # the one that is absent is not handed over

    monkeypatch.setattr(covariance_intersection_cvxpy, "solve", fails)
    with caplog.at_level(logging.WARNING, "cooploc"):
        found = solve_relative(*problem)
    assert np.flatnonzero(found.fallback).tolist() == [17]
    assert "fusions [17]" in caplog.text
    assert found.w[17] == exact.w[17]
    np.testing.assert_allclose(found.w, exact.w, atol=1e-4)


@SOLVERS
@CRITERIA
def test_the_classic_pair(solver, criterion):
    """science.md: diag(1, 4) with diag(4, 1), two estimates of one state, gives w = 1/2, P = 1.6 I."""
    P_i, P_j, one, none = np.diag([1.0, 4.0])[None], np.diag([4.0, 1.0])[None], np.eye(2)[None], np.zeros((2, 2))
    w = solve_relative(P_i, P_j, one, -one, none, criterion, solver).w
    np.testing.assert_allclose(w, 0.5, atol=1e-6)
    Q = inflated_update(Belief(np.zeros((1, 2)), P_i), np.zeros((1, 2)), one, -one, P_j, none, w).P
    np.testing.assert_allclose(Q[0], 1.6 * np.eye(2), atol=1e-5)


SHAPES = pytest.mark.parametrize(
    ("d", "k", "e", "block"), [(2, 1, 2, 2), (2, 2, 2, 2), (3, 1, 2, 2), (3, 2, 3, 2), (3, 2, 2, 3)]
)


@pytest.mark.slow
@SHAPES
@pytest.mark.parametrize("family", [ordinary, near_singular, of_some_size], ids=lambda f: f.__name__)
@CRITERIA
def test_relative_weights_against_a_scan(d, k, e, block, family, criterion):
    K = 300 if d == 2 else 25
    rng = np.random.default_rng(18)
    problem = relation(rng, K, k, d, e, family)

    def f(w):
        return related(problem, w, criterion, block)

    least = scan(f, K)
    for solver in ("exact", "cvxpy") if d == 2 else ("exact",):
        found = solve_relative(*problem, criterion, solver, block)
        assert found.fallback.mean() <= 0.01
        np.testing.assert_allclose((f(found.w[:, None])[:, 0] / least).astype(float), 1, rtol=1e-6)
        assert ((found.w > 0) & (found.w <= 1)).all()


@SOLVERS
def test_rows_without_a_usable_reading_keep_their_belief(solver):
    rng = np.random.default_rng(19)
    P_i, P_j, H_i, H_j, _ = relation(rng, 8, 2)
    P_j *= 1e-3
    R = np.broadcast_to(np.eye(2) * 1e-3, (8, 2, 2)).copy()
    assert (solve_relative(P_i, P_j, H_i, H_j, R, solver=solver).w < 1).all()
    P_j[0], H_i[1, 0, 0], H_j[2, 1, 1], R[3, 0, 0], P_i[4, 0, 1] = [np.nan] * 5
    P_j[5] = np.diag([np.inf, np.inf])
    H_i[6] = 0.0
    found = solve_relative(P_i, P_j, H_i, H_j, R, solver=solver)
    assert found.w[:7].tolist() == [1.0] * 7
    assert found.w[7] < 1
    none = solve_relative(P_i, P_j, H_i[:, :0], H_j[:, :0], np.empty((0, 0)), solver=solver)
    assert none.w.tolist() == [1.0] * 8


def contraction(rng, count, rows, columns):
    """Matrices with singular values up to 1, half of them exactly 1: the extreme correlations."""
    u, _, v = np.linalg.svd(rng.normal(size=(count, rows, columns)), full_matrices=False)
    s = np.where(rng.uniform(size=(count, 1)) < 0.5, 1.0, rng.uniform(0, 1, (count, u.shape[-1])))
    return (u * s[:, None]) @ v


@CRITERIA
@SOLVERS
@pytest.mark.parametrize("k", [1, 2])
def test_no_correlation_makes_a_relative_update_optimistic(k, solver, criterion):
    """x_i' = x_i + K (y - H_i x_i - H_j x_j): 3 000 admissible cross-covariances of the two robots."""
    rng = np.random.default_rng(23)
    P_i, P_j, H_i, H_j, R = relation(rng, 3, k)
    P_j *= 0.1
    w = solve_relative(P_i, P_j, H_i, H_j, R, criterion, solver).w
    assert (w < 1).any()
    for n in range(3):
        rows = slice(n, n + 1)
        belief = Belief(np.zeros((1, 2)), P_i[rows])
        told = H_i[rows], H_j[rows], P_j[rows], R[n], w[rows]
        P = inflated_update(belief, np.zeros((1, k)), *told).P[0]
        K = np.stack([inflated_update(belief, e[None], *told).x[0] for e in np.eye(k)], 1)
        L_i, L_j = np.linalg.cholesky(P_i[n]), np.linalg.cholesky(P_j[n])
        cross = L_i @ contraction(rng, 1000, 2, 2) @ L_j.T
        A, B = np.eye(2) - K @ H_i[n], -K @ H_j[n]
        both = A @ cross @ B.T
        mse = A @ P_i[n] @ A.T + B @ P_j[n] @ B.T + both + both.mT + K @ R[n] @ K.T
        assert np.linalg.eigvalsh(P - mse).min() >= -1e-9 * np.abs(P).max()
