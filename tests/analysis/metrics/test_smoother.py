"""The smoother: a dense Gaussian where all is linear, an optimum elsewhere, and no estimator."""

from dataclasses import replace

import numpy as np
import pytest
from oracles import dense_path, linear_team

import cooploc as cl
from cooploc.estimators import BUILTIN


@pytest.mark.parametrize("relative", [True, False])
def test_where_all_is_linear_it_is_the_mean_of_the_whole_path_given_all_readings(relative):
    _, stream = linear_team(seed=32, trials=2, robots=3, ticks=7, relative=relative)
    found = cl.smoother(stream)
    for trial in range(2):
        np.testing.assert_allclose(found[trial], dense_path(stream, trial, 6, relative)[0], atol=1e-9)


@pytest.mark.parametrize("relative", [True, False])
def test_its_covariances_are_those_of_the_whole_path_given_all_readings(relative):
    _, stream = linear_team(seed=32, trials=2, robots=3, ticks=7, relative=relative)
    found = cl.run({"hindsight": cl.Smoother()}, stream, isolate=False).traces["hindsight"].P
    for trial in range(2):
        dense = dense_path(stream, trial, 6, relative)[1].reshape(8, 3, 2, 8, 3, 2)
        for k, i in np.ndindex(7, 3):
            np.testing.assert_allclose(found[trial, k, i], dense[k + 1, i, :, k + 1, i], atol=1e-9)


def test_elsewhere_no_path_beside_it_is_more_probable(rng):
    """By the density written down again: odometry, anchors, ranges, and each pair's RSSI once."""
    _, stream = cl.simulate("packet-drop/drop=0.5", trials=3, seed=4, robots=3, ticks=10, prior_sigma=0.3)
    found = cl.smoother(stream)
    for trial in range(3):
        least = _cost(stream, trial, found[trial])
        for scale in (1e-3, 1e-2, 0.1):
            beside = found[trial] + scale * rng.normal(size=(20, *found[trial].shape))
            assert min(_cost(stream, trial, x) for x in beside) > least


def test_at_the_last_tick_there_is_no_future():
    """It is then what map-joint finds with the whole past in its window."""
    _, stream = cl.simulate("trajectory", trials=4, seed=6, ticks=9, prior_sigma=0.3)
    causal = cl.run({"map": cl.make("map-joint", window=20, iterations=40)}, stream).traces["map"].x
    np.testing.assert_allclose(cl.smoother(stream)[:, -1], causal[:, -1], atol=1e-6)


def test_what_is_read_later_changes_it():
    _, stream = cl.simulate("trajectory", trials=2, seed=6, ticks=9)
    unread = stream.senses.anchor_rssi.copy()
    unread[:, 5:] = np.nan
    other = replace(stream, senses=stream.senses._replace(anchor_rssi=unread))
    assert np.abs(cl.smoother(stream)[:, :5] - cl.smoother(other)[:, :5]).max(axis=(1, 2, 3)).min() > 1e-3


def test_it_is_no_filter_that_a_study_ranks():
    assert not [name for name in BUILTIN if "smooth" in name]
    with pytest.raises(cl.BadInput, match="there is no estimator 'smoother'"):
        cl.make("smoother")


def _cost(stream, trial, x):
    """-2 log density of a path (T, n, 2), the start at its best."""
    z, air, n = stream.senses, stream.air, stream.robots
    Q, P, anchors = stream.world.motion.sigma**2, stream.prior.P[trial, 0, 0, 0], stream.world.anchors
    first = x[0] - stream.prior.x[trial] - z.odometry[trial, 0]
    total = (first**2).sum() / (P + Q) + ((np.diff(x, axis=0) - z.odometry[trial, 1:]) ** 2).sum() / Q
    d = np.linalg.norm(x[:, :, None] - anchors, axis=-1)
    total += ((z.anchor_rssi[trial] + 40 + 30 * np.log10(np.maximum(d, 0.1))) ** 2).sum() / 5
    for k in range(len(x)):
        for i in range(n):
            for j in np.flatnonzero(air.link[trial, k, i]):
                d, back = np.linalg.norm(x[k, i] - x[k, j]), air.link[trial, k, j, i]
                ranged = air.range[trial, k, i, j]
                total += (ranged - d) ** 2 / 0.1**2 * (ranged >= 0.2)
                if i < j or not back:
                    heard = [air.rssi[trial, k, i, j], air.rssi[trial, k, j, i]][: 1 + back]
                    total += (np.mean(heard) + 40 + 30 * np.log10(max(d, 0.1))) ** 2 / 5
    return total
