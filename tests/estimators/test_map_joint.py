"""Centralised maximum a posteriori: a dense Gaussian where all is linear, scipy's least squares elsewhere."""

import numpy as np
import pytest
from oracles import PLACES, dense_posterior, linear_team, measure_anchor_ranges, path_residuals
from scipy.optimize import least_squares

import cooploc as cl
from cooploc.estimators import kalman_window

TICKS = 8


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
@pytest.mark.parametrize("anchors", ["rssi", "range"])
def test_with_the_whole_past_in_its_window_it_is_the_least_squares_of_the_whole_path(anchors, monkeypatch):
    """Every misfit written down, and minimised by scipy from the truth; their squares add up to what is minimised."""
    cost, windows = kalman_window.cost, []
    monkeypatch.setattr(kalman_window, "cost", lambda s: windows.append(s) or cost(s))
    truth, stream = cl.simulate("packet-drop/drop=0.5", trials=2, seed=4, robots=3, ticks=TICKS, prior_sigma=0.3)
    stream = measure_anchor_ranges(truth, stream) if anchors == "range" else stream
    trace = cl.run({"map": cl.make("map-joint", window=TICKS, iterations=60)}, stream).traces["map"]
    for trial in range(2):

        def misfits(x, trial=trial):
            return path_residuals(stream, trial, x.reshape(TICKS, 3, 2))

        exact = {"jac": "3-point", "xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-12}
        found = least_squares(misfits, truth.x[trial].ravel(), **exact)
        P = np.linalg.inv(found.jac.T @ found.jac)[-6:, -6:].reshape(3, 2, 3, 2)
        np.testing.assert_allclose(trace.x[trial, -1], found.x.reshape(TICKS, 3, 2)[-1], atol=1e-6)
        np.testing.assert_allclose(trace.P[trial, -1], np.einsum("iaib->iab", P), rtol=1e-4, atol=1e-8)
    moved = windows[-1]._replace(x=windows[-1].x + np.random.default_rng(5).normal(0, 0.5, truth.x.shape))
    sums = [[np.sum(path_residuals(stream, k, s.x[k]) ** 2) for k in range(2)] for s in (windows[-1], moved)]
    np.testing.assert_allclose(cost(moved) - cost(windows[-1]), np.diff(sums, axis=0)[0])


@pytest.mark.slow
def test_a_heading_may_pass_west():
    """Twenty times, and the team knows where it is in every tick."""
    truth, stream = cl.simulate("camera/n=2", trials=10, seed=3, ticks=300)
    crossings = np.abs(np.diff(truth.x[..., 2], axis=1)) > np.pi
    trace = cl.run({"map": cl.make("map-joint", window=5)}, stream).traces["map"]
    assert crossings.sum() > 20
    assert np.hypot(*np.moveaxis((trace.x - truth.x)[..., :2], -1, 0)).max() < 1
