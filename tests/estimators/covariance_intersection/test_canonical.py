"""The canonical form against cvxpy itself: the numbers it computes, and what a fresh problem answers."""

import clarabel
import cvxpy as cp
import numpy as np
import pytest

from cooploc.estimators.covariance_intersection import relative_weights, weights
from cooploc.estimators.covariance_intersection_cvxpy import canonical

CRITERIA = pytest.mark.parametrize("criterion", ["det", "trace"])


def problem():
    """Least c1 + c2 with a cone, whose numbers are products and sums of the parameters."""
    c, theta = cp.Variable(2), cp.Parameter(3)
    inside = cp.SOC(theta[0] * c[0] + 3 * theta[1] * c[1] - 1, cp.hstack([theta[2] * c[0] + theta[1], c[1] - c[0]]))
    return cp.Problem(cp.Minimize(cp.sum(c)), [c >= 0, inside]), theta


def settings():
    quiet = clarabel.DefaultSettings()
    quiet.verbose = False
    return quiet


def test_the_numbers_are_those_that_cvxpy_computes():
    asked, theta = problem()
    form = canonical(asked, theta)
    values = np.random.default_rng(0).normal(size=(5, 3))
    for value, A, b in zip(values, *form.numbers(values), strict=True):
        theta.value = value
        data, _, _ = asked.get_problem_data("CLARABEL")
        np.testing.assert_allclose(A, data["A"].data, rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(b, data["b"], rtol=1e-14, atol=1e-14)


def test_problems_in_a_stack_have_the_answers_that_cvxpy_gives_each():
    asked, theta = problem()
    form = canonical(asked, theta)
    values = np.random.default_rng(1).uniform(0.5, 2, (4, 3))
    found = form.stack(4).solve(*form.numbers(values), settings())
    for value, x in zip(values, found, strict=True):
        theta.value = value
        np.testing.assert_allclose(x.sum(), asked.solve(solver="CLARABEL"), rtol=1e-6)


@pytest.mark.parametrize(("m", "d"), [(2, 2), (5, 2), (3, 3)])
@CRITERIA
def test_weights_are_those_of_a_fresh_problem_as_one_writes_it_first(m, d, criterion):
    a = np.random.default_rng(2).normal(size=(5, m, d, d))
    P = a @ a.mT + 0.1 * np.eye(d)
    for covariances, found in zip(P, weights(P, criterion, "cvxpy", groups=np.arange(5)), strict=True):
        w = cp.Variable(m, nonneg=True)
        Y = sum(w[k] * np.linalg.inv(covariances[k]) for k in range(m))
        aim = cp.Maximize(cp.log_det(Y)) if criterion == "det" else cp.Minimize(cp.tr_inv(Y))
        cp.Problem(aim, [cp.sum(w) == 1]).solve(solver="CLARABEL")
        np.testing.assert_allclose(found, w.value, atol=1e-4)


@CRITERIA
def test_relative_weights_are_those_of_a_fresh_problem(criterion):
    """n = v / (q + R v), the information of a range of variance R about a sender of variance q along it."""
    rng = np.random.default_rng(3)
    P_i, P_j = (a @ a.mT + 0.1 * np.eye(2) for a in rng.normal(size=(2, 6, 2, 2)))
    H, R = rng.normal(size=(6, 1, 2)), 0.01
    found = relative_weights(P_i, 0.1 * P_j, H, -H, np.full((1, 1), R), criterion, groups=np.arange(6))
    for f in range(6):
        q = (H[f] @ (0.1 * P_j[f]) @ H[f].T).item()
        w, n = cp.Variable(nonneg=True), cp.Variable()
        Y = w * np.linalg.inv(P_i[f]) + n * (H[f].T @ H[f])
        aim = cp.Maximize(cp.log_det(Y)) if criterion == "det" else cp.Minimize(cp.tr_inv(Y))
        cp.Problem(aim, [w <= 1, n <= 1 / R - q / R * cp.inv_pos(q + R * (1 - w))]).solve(solver="CLARABEL")
        np.testing.assert_allclose(found[f], w.value, atol=1e-4)
