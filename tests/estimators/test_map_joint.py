"""Centralised maximum a posteriori: a dense Gaussian where all is linear, a full factor graph elsewhere."""

import numpy as np
import pytest
from oracles import PLACES, dense_posterior, linear_team

import cooploc as cl

TICKS = 12


@pytest.mark.parametrize("window", [1, 3, 20])
def test_where_all_is_linear_it_is_the_exact_posterior_for_any_window(window):
    _, stream = linear_team(seed=31, trials=2, robots=3, ticks=6)
    assert len(PLACES) == 2
    trace = cl.run({"map": cl.make("map-joint", window=window, iterations=1)}, stream).traces["map"]
    for k in range(6):
        for trial in range(2):
            x, P = dense_posterior(stream, trial, k, relative=True)
            np.testing.assert_allclose(trace.x[trial, k], x, atol=1e-9)
            for i in range(3):
                np.testing.assert_allclose(trace.P[trial, k, i], P[i, :, i], atol=1e-9)


@pytest.mark.slow
def test_with_the_whole_past_in_its_window_it_is_the_optimum_of_the_full_factor_graph():
    gtsam = pytest.importorskip("gtsam", reason="gtsam, the factor-graph library that is the oracle, is not installed")
    truth, stream = cl.simulate("packet-drop/drop=0.5", trials=10, seed=4, robots=3, ticks=TICKS, prior_sigma=0.3)
    trace = cl.run({"map": cl.make("map-joint", window=TICKS, iterations=60)}, stream).traces["map"]
    for trial in range(10):
        x, P = _solved(gtsam, stream, trial, truth.x[trial])
        np.testing.assert_allclose(trace.x[trial, -1], x, atol=1e-6)
        np.testing.assert_allclose(trace.P[trial, -1], P, rtol=1e-4, atol=1e-8)


def test_a_heading_may_pass_west():
    """Twenty times, and the team knows where it is in every tick."""
    truth, stream = cl.simulate("camera/n=2", trials=10, seed=3, ticks=300)
    crossings = np.abs(np.diff(truth.x[..., 2], axis=1)) > np.pi
    trace = cl.run({"map": cl.make("map-joint", window=5)}, stream).traces["map"]
    assert crossings.sum() > 20
    assert np.hypot(*np.moveaxis((trace.x - truth.x)[..., :2], -1, 0)).max() < 1


def _solved(gtsam, stream, trial, start):
    """Positions (n, 2) and covariances (n, 2, 2) at the last tick, from a factor graph over every tick."""
    graph, values, n = gtsam.NonlinearFactorGraph(), gtsam.Values(), stream.robots
    sigma = {name: float(np.sqrt(sensor.R[0, 0])) for name, sensor in stream.world.sensors.items()}
    noise = gtsam.noiseModel.Isotropic.Sigma

    def key(k, i):
        return gtsam.symbol("x", (k + 1) * n + i)

    for i in range(n):
        prior = gtsam.noiseModel.Gaussian.Covariance(stream.prior.P[trial, i])
        graph.add(gtsam.PriorFactorPoint2(key(-1, i), stream.prior.x[trial, i], prior))
        values.insert(key(-1, i), stream.prior.x[trial, i])
        for k in range(len(stream.time)):
            values.insert(key(k, i), start[k, i])
            step = noise(2, stream.world.motion.sigma)
            graph.add(gtsam.BetweenFactorPoint2(key(k - 1, i), key(k, i), stream.senses.odometry[trial, k, i], step))
            for place, reading in zip(stream.world.anchors, stream.senses.anchor_rssi[trial, k, i], strict=True):
                graph.add(_loss(gtsam, noise(1, sigma["anchor_rssi"]), reading, key(k, i), place=place))
            for j in range(n):
                if not stream.air.link[trial, k, i, j]:
                    continue
                ranged = float(stream.air.range[trial, k, i, j])
                if ranged >= 0.2:
                    graph.add(gtsam.RangeFactor2(key(k, i), key(k, j), ranged, noise(1, sigma["radio_range"])))
                back = stream.air.link[trial, k, j, i]
                if i < j or not back:  # radio is reciprocal: one reading a pair, the mean of both directions
                    both = [stream.air.rssi[trial, k, i, j], stream.air.rssi[trial, k, j, i]][: 1 + back]
                    graph.add(_loss(gtsam, noise(1, sigma["radio_rssi"]), np.mean(both), key(k, i), key(k, j)))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-15)
    parameters.setAbsoluteErrorTol(1e-15)
    parameters.setMaxIterations(300)
    best = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    marginals, last = gtsam.Marginals(graph, best), len(stream.time) - 1
    x = np.stack([best.atPoint2(key(last, i)) for i in range(n)])
    return x, np.stack([marginals.marginalCovariance(key(last, i)) for i in range(n)])


def _loss(gtsam, noise, reading, *keys, place=None):
    """-40 dBm - 30 log10 d, d at least 0.1 m."""

    def error(factor, values, jacobians):
        ends = [values.atPoint2(k) for k in factor.keys()]  # noqa: SIM118 (not a dict)
        away = ends[0] - (place if place is not None else ends[1])
        d = max(np.hypot(*away), 0.1)
        slope = -30 / np.log(10) * away / d**2 if d > 0.1 else np.zeros(2)
        if jacobians is not None:
            for k, sign in zip(range(len(ends)), (1, -1), strict=False):
                jacobians[k] = sign * slope[None]
        return np.array([-40 - 30 * np.log10(d) - reading])

    return gtsam.CustomFactor(noise, list(keys), error)
