"""Rules that combine a belief with a reading of a teammate: other formulas, quadrature, sampled correlations."""

from itertools import pairwise

import numpy as np
import pytest
from oracles import covariances, linear_team
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar
from scipy.stats import norm

from cooploc.estimators.ekf_ci import EkfCi
from cooploc.estimators.ekf_event_ci import EkfEventCi
from cooploc.estimators.ekf_hmd import EkfHmd
from cooploc.estimators.ekf_ici import EkfIci
from cooploc.estimators.ekf_naive import EkfNaive
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Belief
from cooploc.estimators.inverse_covariance_intersection import (
    combine,
    harmonic_mean,
    intersection_at_weight,
    inverse_intersection,
)
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.run import run
from cooploc.scenarios.runner.trace import trace

inv = np.linalg.inv


def normal(x, mean, variance):
    return norm.pdf(x, mean, np.sqrt(variance))


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
    fused, C = intersection_at_weight(0.8, a, b, y)
    for i in range(20):
        C_i, common = inv(inv(a[i]) + inv(b[i]) - inv(0.2 * a[i] + 0.8 * b[i])), inv(0.2 * a[i] + 0.8 * b[i])
        np.testing.assert_allclose(C[i], C_i, atol=1e-8)
        np.testing.assert_allclose(fused[i], C_i @ (inv(b[i]) - 0.8 * common) @ y[i], atol=1e-8)
    equal, same = intersection_at_weight(0.8, a, a, y)
    np.testing.assert_allclose(same, a, atol=1e-8)  # two equally good estimates state the covariance of one
    np.testing.assert_allclose(equal, 0.2 * y, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("rule", [inverse_intersection, lambda a, b, y, _: intersection_at_weight(0.8, a, b, y)])
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
            return combine(rule, Belief(np.zeros((1, 3)), rows[0]), y[None], *rows[1:], np.inf)

        K = np.stack([after(e)[0][0] for e in np.eye(k)], 1)
        P1 = after(np.zeros(k))[1][0]
        A = np.hstack([np.eye(3) - K @ H, K])
        real = A @ np.block([[P, cross], [cross.T, N]]) @ A.T
        assert np.linalg.eigvalsh(P1 - (real + real.T) / 2).min() > -1e-9
        tight += np.trace(P1) < np.trace(P) - 1e-6
    assert tight > 60


@pytest.mark.slow
@pytest.mark.parametrize(("a", "b", "y", "v"), [(1.0, 2.0, 1.5, 0.5), (3.0, 0.4, -2.0, 0.7), (1.0, 1.0, 0.0, 0.3)])
def test_harmonic_mean_is_the_quotient_of_densities_by_quadrature(a, b, y, v):
    def mixture(x):
        return v * normal(x, y, b) + (1 - v) * normal(x, 0, a)

    centre, spread = moments(mixture)
    mean, variance = moments(lambda x: normal(x, 0, a) * normal(x, y, b) / normal(x, centre, spread))
    fused, C = harmonic_mean(v, np.array([[[a]]]), np.array([[[b]]]), np.array([[y]]))
    np.testing.assert_allclose([fused[0, 0], C[0, 0, 0]], [mean, variance], atol=1e-8)


@pytest.mark.parametrize("cls", [EkfIci, EkfHmd, EkfNaive])
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
                    elif cls is EkfNaive:
                        C = inv(inv(P[i]) + inv(N))
                        step, P[i] = C @ inv(N) @ y, C
                    else:
                        common = inv((P[i] + N) / 2 + np.outer(y, y) / 4)
                        C = inv(inv(P[i]) + inv(N) - common)
                        step, P[i] = C @ (inv(N) @ y - common @ y / 2), C
                    x[i] = x[i] + step
        np.testing.assert_allclose(got.x[0, k], x, atol=1e-8)
        np.testing.assert_allclose(got.P[0, k], P, atol=1e-8)


@pytest.mark.parametrize("label", ["robots-1-3/n=2", "camera/n=2[sight=8,view=1.5]"])
def test_a_received_covariance_that_is_none_is_named(label):
    class Liar(EkfCi):
        def send(self, s, z):
            negative = np.diag([1.0, -1e-4, 1.0][: s.x.shape[-1]])
            return super().send(s._replace(P=np.broadcast_to(negative, s.P.shape)), z)

    with pytest.raises(BadInput, match="P_j of fusion 0 is not a covariance"):
        trace("liar", Liar(), simulate(label, trials=1, ticks=60, seed=1)[1])


@pytest.mark.parametrize("label", ["packet-drop/drop=0.3", "camera/n=3", "asynchrony/samples=1"])
def test_without_a_threshold_it_is_covariance_intersection(label):
    _, stream = simulate(label, trials=2, seed=6, ticks=40)
    traces = run({"ci": EkfCi(), "event": EkfEventCi(threshold=0)}, stream).traces
    for name in ("x", "P", "bytes"):
        np.testing.assert_array_equal(getattr(traces["event"], name), getattr(traces["ci"], name))


@pytest.mark.slow
def test_the_higher_the_threshold_the_less_is_sent():
    _, stream = simulate("robots-1-3/n=3", trials=5, seed=7, ticks=80)
    rules = {t: EkfEventCi(threshold=t) for t in (0, 0.03, 0.3, 3, np.inf)}
    sent = [trace("event", rule, stream).messages.sum() for rule in rules.values()]
    assert all(a > b for a, b in pairwise(sent))
    assert sent[-1] == 5 * 3  # each robot once: nothing was sent before


def test_a_robot_that_is_asleep_does_not_take_its_news_for_sent():
    """One of the three wakes in every fourth tick: what it would say meanwhile stays to be said."""
    _, stream = simulate("asynchrony/samples=1", trials=2, seed=8, ticks=40)
    assert not (stream.senses.dt[:, 0] > 0).all()
    sent = trace("event", EkfEventCi(threshold=np.inf), stream).messages
    np.testing.assert_array_equal(sent.sum(), 2 * 3)
