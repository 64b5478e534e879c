"""Rules that combine a belief with a reading of a teammate: other formulas, quadrature, sampled correlations."""

from itertools import pairwise

import cvxpy
import numpy as np
import pytest
from oracles import covariances, linear_team
from scipy.integrate import quad
from scipy.linalg import block_diag
from scipy.optimize import brentq, minimize_scalar

from cooploc.estimators.covariance_intersection import relative_weights
from cooploc.estimators.ekf_ci import EkfCi
from cooploc.estimators.ekf_event_ci import EkfEventCi, divergence
from cooploc.estimators.ekf_hmd import EkfHmd
from cooploc.estimators.ekf_ici import EkfIci
from cooploc.estimators.interface import Belief
from cooploc.estimators.inverse_covariance_intersection import (
    combined,
    harmonic_mean,
    inverse_intersection,
    weighed_intersection,
)
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.run import run
from cooploc.scenarios.runner.trace import trace

inv = np.linalg.inv


def normal(x, mean, variance):
    return np.exp(-((x - mean) ** 2) / (2 * variance)) / np.sqrt(2 * np.pi * variance)


def moments(density):
    """Mean and variance of a density of one number that need not be normalised."""
    total, first = (quad(lambda x, k=k: x**k * density(x), -30, 30, epsabs=1e-13, limit=500)[0] for k in (0, 1))
    mean = first / total
    return mean, quad(lambda x: (x - mean) ** 2 * density(x), -30, 30, epsabs=1e-13, limit=500)[0] / total


def ici(a, b, y, M):
    """Inverse covariance intersection with the published gains, the weight where the slope of tr(M C) is zero."""

    def fused(w):
        common = inv(w * a + (1 - w) * b)
        C = inv(inv(a) + inv(b) - common)
        return C, C @ (inv(b) - (1 - w) * common) @ y

    def slope(w):
        G, C = inv(w * a + (1 - w) * b), fused(w)[0]
        return -np.trace(M @ C @ G @ (a - b) @ G @ C)

    w = 0.0 if slope(0) >= 0 else 1.0 if slope(1) <= 0 else brentq(slope, 0, 1, xtol=1e-15)
    return *fused(w), w


def sharing(rng, k):
    """Two covariances (k, k) and their cross-covariance, independent but for information that both have."""
    shared = covariances(rng, d=k) * rng.uniform(0, 3)
    a, b = inv(inv(covariances(rng, d=k)) + shared), inv(inv(covariances(rng, d=k)) + shared)
    return a, b, a @ shared @ b


def real_error(A, B, P, N, cross):
    """The covariance of A e + B v, where e has P, v has N, and E[e v'] = cross."""
    both = A @ cross @ B.T
    return A @ P @ A.T + B @ N @ B.T + both + both.T


def least_eigenvalue(P):
    return np.linalg.eigvalsh((P + P.T) / 2).min()


@pytest.mark.parametrize("k", [1, 2, 3])
def test_inverse_intersection_is_the_published_formula_at_the_weight_of_least_trace(k):
    rng = np.random.default_rng(1)
    a, b, M, y = *covariances(rng, 3, 60, d=k), rng.normal(size=(60, k))
    a[:5] *= 100  # nested covariances, of which one is best
    b[5:10] *= 100
    fused, C = inverse_intersection(a, b, y, M)
    weights = []
    for i in range(60):
        C_i, y_i, w = ici(a[i], b[i], y[i], M[i])
        weights.append(w)
        np.testing.assert_allclose(C[i], C_i, atol=1e-8)
        np.testing.assert_allclose(fused[i], y_i, atol=1e-8)
        scan = minimize_scalar(
            lambda w, i=i: np.trace(M[i] @ inv(inv(a[i]) + inv(b[i]) - inv(w * a[i] + (1 - w) * b[i]))),
            bounds=(0, 1),
            method="bounded",
        )
        assert np.trace(M[i] @ C[i]) <= scan.fun + 1e-9
    assert {0.0, 1.0} < set(weights) or k == 1


def test_a_fixed_weight_is_the_published_formula_with_that_weight():
    rng = np.random.default_rng(11)
    a, b, y = *covariances(rng, 2, 20, d=2), rng.normal(size=(20, 2))
    fused, C = weighed_intersection(0.8, a, b, y)
    for i in range(20):
        C_i, common = inv(inv(a[i]) + inv(b[i]) - inv(0.2 * a[i] + 0.8 * b[i])), inv(0.2 * a[i] + 0.8 * b[i])
        np.testing.assert_allclose(C[i], C_i, atol=1e-8)
        np.testing.assert_allclose(fused[i], C_i @ (inv(b[i]) - 0.8 * common) @ y[i], atol=1e-8)
    equal, same = weighed_intersection(0.8, a, a, y)
    np.testing.assert_allclose(same, a, atol=1e-8)  # two equally good estimates state the covariance of one
    np.testing.assert_allclose(equal, 0.2 * y, atol=1e-8)


def test_of_one_number_inverse_intersection_keeps_the_better_estimate():
    a, b = np.array([4.0, 4.0, 4.0])[:, None, None], np.array([1.0, 4.0, 9.0])[:, None, None]
    fused, C = inverse_intersection(a, b, np.ones((3, 1)), np.ones((3, 1, 1)))
    np.testing.assert_allclose(C[:, 0, 0], [1, 4, 4])
    np.testing.assert_allclose(fused[[0, 2], 0], [1, 0])


@pytest.mark.parametrize("rule", [inverse_intersection, lambda a, b, y, _: weighed_intersection(0.8, a, b, y)])
@pytest.mark.parametrize("k", [1, 2])
def test_no_shared_information_makes_inverse_intersection_optimistic(k, rule):
    """A state of three numbers, a reading of k of them: 200 amounts of shared information about what is read."""
    rng = np.random.default_rng(2)
    tight = 0
    for _ in range(200):
        H, shared = rng.normal(size=(k, 3)), covariances(rng, d=k) * rng.uniform(0, 3)
        P, N = inv(inv(covariances(rng, d=3)) + H.T @ shared @ H), inv(inv(covariances(rng, d=k)) + shared)
        cross = P @ H.T @ shared @ N
        rows = [part[None] for part in (P, H, N)]

        def after(y, rows=rows):
            return combined(rule, np.zeros((1, 3)), rows[0], y[None], *rows[1:], np.inf)

        K = np.stack([after(e)[0][0] for e in np.eye(k)], 1)
        P1 = after(np.zeros(k))[1][0]
        assert least_eigenvalue(P1 - real_error(np.eye(3) - K @ H, K, P, N, cross)) > -1e-9
        tight += np.trace(P1) < np.trace(P) - 1e-6
    assert tight > 60


def test_correlation_of_another_kind_can_make_inverse_intersection_optimistic():
    """So it promises less than covariance intersection, and the test above can fail."""
    rng = np.random.default_rng(3)
    worst = np.inf
    for _ in range(300):
        a, b, _ = sharing(rng, 2)
        fused, C = inverse_intersection(
            *(np.stack([part] * 2) for part in (a, b)), np.eye(2), np.stack([np.eye(2)] * 2)
        )
        K = fused.T
        cross = np.linalg.cholesky(a) @ np.linalg.qr(rng.normal(size=(2, 2)))[0] @ np.linalg.cholesky(b).T
        worst = min(worst, least_eigenvalue(C[0] - real_error(np.eye(2) - K, K, a, b, cross)))
    assert worst < -0.01


def test_inverse_intersection_is_never_worse_than_covariance_intersection():
    rng = np.random.default_rng(4)
    for _ in range(50):
        a, b, _ = sharing(rng, 2)
        _, C = inverse_intersection(a[None], b[None], np.zeros((1, 2)), np.eye(2)[None])
        for w in np.linspace(0, 1, 21):
            assert np.trace(C[0]) <= np.trace(inv(w * inv(a) + (1 - w) * inv(b))) + 1e-9


@pytest.mark.parametrize(("a", "b", "y", "v"), [(1.0, 2.0, 1.5, 0.5), (3.0, 0.4, -2.0, 0.7), (1.0, 1.0, 0.0, 0.3)])
def test_harmonic_mean_is_the_quotient_of_densities_by_quadrature(a, b, y, v):
    def mixture(x):
        return v * normal(x, y, b) + (1 - v) * normal(x, 0, a)

    centre, spread = moments(mixture)
    mean, variance = moments(lambda x: normal(x, 0, a) * normal(x, y, b) / normal(x, centre, spread))
    fused, C = harmonic_mean(v, np.array([[[a]]]), np.array([[[b]]]), np.array([[y]]))
    np.testing.assert_allclose([fused[0, 0], C[0, 0, 0]], [mean, variance], atol=1e-8)


def test_the_harmonic_mean_of_equal_densities_is_that_density_and_else_near_it():
    """The mixture itself, not the Gaussian that stands for it, in the denominator."""
    for b, y, tolerance in ((1.0, 0.0, 1e-8), (1.3, 0.3, 0.01), (2.0, 1.0, 0.15)):
        exact = moments(lambda x, b=b, y=y: 1 / (0.5 / normal(x, 0, 1.0) + 0.5 / normal(x, y, b)))
        fused, C = harmonic_mean(0.5, np.ones((1, 1, 1)), np.full((1, 1, 1), b), np.array([[y]]))
        np.testing.assert_allclose([fused[0, 0], C[0, 0, 0]], exact, atol=tolerance)


@pytest.mark.parametrize("rule", [EkfIci(), EkfIci(form="fixed"), EkfHmd()])
def test_robots_that_believe_to_be_at_one_place_learn_nothing_of_their_distance(rule):
    x, P, R = np.zeros((2, 2)), np.stack([np.eye(2)] * 2), np.full((2, 1, 1), 0.04)
    H = np.array([[[0.0, 0.0]], [[1.0, 0.0]]])  # the range of the first has no slope
    after, covariance = rule.combine(x, P, np.full((2, 1), 0.3), H, H @ P @ H.mT * 0.1 + R)
    np.testing.assert_array_equal(after[0], x[0])
    np.testing.assert_array_equal(covariance[0], P[0])
    assert covariance[1, 0, 0] < 0.9


def test_a_teammate_who_knows_less_takes_something_from_the_harmonic_mean_and_one_who_knows_nothing_does_not():
    b = np.array([1.0, 2.414, 1e6])[:, None, None]
    _, C = harmonic_mean(0.5, np.ones_like(b), b, np.zeros((3, 1)))
    np.testing.assert_allclose(C[:, 0, 0], [1, 1.2071, 1], atol=1e-4)


def test_the_weight_of_a_reading_of_part_of_the_state_is_that_of_least_trace_of_the_whole(rng):
    P, N, H = covariances(rng, 30, d=3), covariances(rng, 30, d=2), rng.normal(size=(30, 2, 3))
    H[:, 1] *= 5
    rows = np.zeros((30, 3)), P, np.zeros((30, 2)), H, N

    def trace_after(rule):
        return np.trace(rule.combine(*rows)[1], axis1=1, axis2=2)

    least = np.min([trace_after(EkfIci(form="fixed", weight=v)) for v in np.linspace(0, 1, 101)], 0)
    assert (trace_after(EkfIci()) <= least + 1e-9).all()


@pytest.mark.parametrize("rule", [EkfIci(), EkfIci(form="fixed"), EkfHmd()])
def test_a_reading_beyond_twice_the_gate_changes_nothing(rule):
    y = np.sqrt(2 * rule.gate * 2) * np.array([[1.001], [0.999]])  # S = 1 + 1
    x, P, H = np.zeros((2, 2)), np.stack([np.diag([1.0, 2.0])] * 2), np.stack([np.eye(1, 2)] * 2)
    after, covariance = rule.combine(x, P, y, H, np.full((2, 1, 1), 1.0 - 1e-9))
    np.testing.assert_array_equal(after[0], x[0])
    np.testing.assert_array_equal(covariance[0], P[0])
    assert after[1, 0] > 0.1


@pytest.mark.parametrize("cls", [EkfIci, EkfHmd])
def test_a_run_is_the_published_fusion_of_whole_states(cls):
    """A reading of the whole state makes a pseudo-estimate of it, so that nothing has to be carried anywhere."""
    _, stream = linear_team(seed=5, trials=1, robots=3, ticks=8)
    got = trace("rule", cls(both=False, gate=np.inf), stream)
    z, R, Q = stream.senses, np.asarray(stream.world.sensors["sighting"].R), 0.3**2 / 0.5
    x, P = stream.prior.x[0].copy(), stream.prior.P[0].copy()
    for k in range(8):
        for i in range(3):
            x[i], P[i] = x[i] + z.odometry[0, k, i], P[i] + Q * z.dt[0, k, i] * np.eye(2)
            for place, reading in zip(stream.world.landmarks, z.landmark[0, k, i], strict=True):
                if np.isfinite(reading).all():
                    K = P[i] @ inv(P[i] + R)
                    x[i], P[i] = x[i] + K @ (reading + place - x[i]), (np.eye(2) - K) @ P[i]
        sent = x.copy(), P.copy()
        for i in range(3):
            for j in range(3):
                reading = z.sighting[0, k, i, j]
                if np.isfinite(reading).all():
                    y, N = reading + sent[0][j] - x[i], sent[1][j] + R
                    if cls is EkfIci:
                        P[i], step, _ = ici(P[i], N, y, np.eye(2))
                    else:
                        common = inv((P[i] + N) / 2 + np.outer(y, y) / 4)
                        C = inv(inv(P[i]) + inv(N) - common)
                        step, P[i] = C @ (inv(N) @ y - common @ y / 2), C
                    x[i] = x[i] + step
        np.testing.assert_allclose(got.x[0, k], x, atol=1e-8)
        np.testing.assert_allclose(got.P[0, k], P, atol=1e-8)


# ---------------------------------------------------------------- sent only when there is news


def test_without_a_threshold_it_is_covariance_intersection():
    for label in ("packet-drop/drop=0.3", "camera/n=3"):
        _, stream = simulate(label, trials=2, seed=6, ticks=40)
        traces = run({"ci": EkfCi(), "event": EkfEventCi(threshold=0)}, stream).traces
        for name in ("x", "P", "bytes"):
            np.testing.assert_array_equal(getattr(traces["event"], name), getattr(traces["ci"], name))


def test_the_higher_the_threshold_the_less_is_sent():
    _, stream = simulate("robots-1-3/n=3", trials=5, seed=7, ticks=80)
    rules = {t: EkfEventCi(threshold=t) for t in (0, 0.03, 0.3, 3, np.inf)}
    sent = [trace("event", rule, stream).messages.sum() for rule in rules.values()]
    assert all(a > b for a, b in pairwise(sent))
    assert sent[-1] == 5 * 3  # each robot once: nothing was sent before


def test_robots_that_learn_from_each_other_alone_do_not_fall_silent():
    _, stream = simulate("camera", trials=2, seed=8, ticks=300)
    stream = stream.with_arrays({"senses.landmark": np.full_like(stream.senses.landmark, np.nan)})
    assert trace("event", EkfEventCi(threshold=1), stream).messages.sum() > 4 * 2 * 3


def test_a_robot_that_is_asleep_does_not_take_its_news_for_sent():
    """One of the three wakes in every fourth tick: what it would say meanwhile stays to be said."""
    _, stream = simulate("asynchrony/samples=1", trials=2, seed=8, ticks=40)
    assert not (stream.senses.dt[:, 0] > 0).all()
    sent = trace("event", EkfEventCi(threshold=np.inf), stream).messages
    np.testing.assert_array_equal(sent.sum(), 2 * 3)
    every = run({"ci": EkfCi(), "event": EkfEventCi(threshold=0)}, stream).traces
    np.testing.assert_array_equal(every["event"].x, every["ci"].x)
    np.testing.assert_array_equal(every["event"].bytes, every["ci"].bytes)


def test_driving_on_is_no_news_where_odometry_has_no_error():
    """What was sent is moved by the same odometry; each robot speaks once."""
    _, stream = simulate("robots-1-3/n=3", trials=2, seed=8, ticks=60, odometry_sigma=1e-5, drop=1.0)
    moved = np.nansum(stream.senses.odometry, 1)
    assert np.linalg.norm(moved, axis=-1).max() > 0.5  # a standard deviation of the prior
    event = EkfEventCi(threshold=0.1, anchor_reading="none")
    assert trace("event", event, stream).messages.sum() == 2 * 3


def test_the_divergence_is_that_of_the_densities():
    p, q = (0.3, 0.5), (-0.4, 1.5)
    exact = quad(lambda x: normal(x, *p) * np.log(normal(x, *p) / normal(x, *q)), -20, 20)[0]
    made = [Belief(np.array([[m]]), np.array([[[v]]])) for m, v in (p, q)]
    np.testing.assert_allclose(divergence(*made), exact, atol=1e-8)


# ---------------------------------------------------------------- ranges, and overlapping covariance intersection


@pytest.mark.parametrize("criterion", ["trace", "det"])
def test_a_range_helps_at_most_one_of_two_robots_and_whom_is_known_in_advance(criterion):
    """hal-04039619. The trace falls where h'P_i^2 h > tr(P_i) h'P_j h, the determinant where h'P_i h > 2 h'P_j h."""
    rng = np.random.default_rng(9)
    P_i, P_j, h = *covariances(rng, 2, 2000, d=2), rng.normal(size=(2000, 1, 2))
    R = np.full((1, 1), 0.05)

    def gains(A, B):
        return relative_weights(A, B, h, -h, R, criterion, "exact") < 1

    def expected(A, B):
        along, other = (np.squeeze(h @ P @ h.mT) for P in (A, B))
        if criterion == "det":
            return along > 2 * other
        return np.squeeze(h @ A @ A @ h.mT) > np.trace(A, axis1=1, axis2=2) * other

    first, second = gains(P_i, P_j), gains(P_j, P_i)
    np.testing.assert_array_equal(first, expected(P_i, P_j))
    np.testing.assert_array_equal(second, expected(P_j, P_i))
    assert not (first & second).any()
    assert first.any()
    assert not (first | second).all()


def overlapping(P_i, P_j, H, N, R):
    """The bound of overlapping covariance intersection on x_i by its semidefinite program, of least trace.

    Known are o = A x + C e + v: a belief o_1 = x + e_i + v_1 and a reading o_2 = H x - H e_j + v_2, where v_1 and v_2
    have N and R, and E[e e']^-1 >= Y for every Y between blkdiag(P_i^-1, 0) and blkdiag(0, P_j^-1).
    """
    zero = np.zeros((2, 2))
    A, C = np.vstack([np.eye(2), H]), block_diag(np.eye(2), -H)
    G = inv(block_diag(N, R))
    U, B, w = *(cvxpy.Variable((2, 2), symmetric=True) for _ in range(2)), cvxpy.Variable()
    Y = w * block_diag(inv(P_i), zero) + (1 - w) * block_diag(zero, inv(P_j))
    held = [
        cvxpy.bmat([[U, A.T @ G @ C], [C.T @ G @ A, Y + C.T @ G @ C]]) >> 0,
        cvxpy.bmat([[B, np.eye(2)], [np.eye(2), A.T @ G @ A - U]]) >> 0,
        w >= 0,
        w <= 1,
    ]
    return cvxpy.Problem(cvxpy.Minimize(cvxpy.trace(B)), held).solve(solver="CLARABEL")


@pytest.mark.parametrize("k", [1, 2])
def test_the_relative_update_is_overlapping_covariance_intersection_of_a_pair(k):
    """The program needs some noise N on the belief; without it, the formula is that of `relative_weights`."""
    rng = np.random.default_rng(10)
    N = 0.05 * np.eye(2)
    for _ in range(5):
        P_i, P_j, R = 4 * covariances(rng, d=2), 0.2 * covariances(rng, d=2), 0.1 * covariances(rng, d=k)
        H = rng.normal(size=(k, 2))

        def formula(w, noise, P_i=P_i, P_j=P_j, H=H, R=R):
            return np.trace(inv(inv(P_i / w + noise) + H.T @ inv(H @ P_j @ H.T / (1 - w) + R) @ H))

        def least(noise, formula=formula):
            return minimize_scalar(formula, bounds=(1e-9, 1 - 1e-9), args=(noise,), method="bounded").fun

        w = relative_weights(*(part[None] for part in (P_i, P_j, H, -H)), R, "trace", "exact")[0]
        assert formula(min(w, 1 - 1e-9), 0 * N) <= least(0 * N) * (1 + 1e-7)
        assert overlapping(P_i, P_j, H, N, R) == pytest.approx(least(N), rel=1e-5)
