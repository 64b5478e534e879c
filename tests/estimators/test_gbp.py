"""Gaussian belief propagation: a dense Gaussian where the graph is a tree, `map-joint` where it has loops."""

from dataclasses import replace

import numpy as np
import pytest
from oracles import covariances, dense_posterior, linear_team, measure_anchor_ranges
from scipy.special import huber

import cooploc as cl
from cooploc.estimators.gbp import HUBER, weigh
from cooploc.scenarios.runner.tick import make_loop

TICKS = 6
TREE = [(1, 0, 1), (3, 2, 1), (4, 3, 0)]  # tick, who reads, who is read: two robots never meet twice


def _settled(estimator, stream, rounds, kept=None):
    """The last tick's belief (t, n, ...) after so many further exchanges; `kept` (rounds, t, n, n) links hold."""
    running = make_loop("gbp", estimator, stream)
    running.start()
    for k in range(len(stream.time)):
        running.tick(k)
    z = running.senses(k)
    for once in range(rounds):
        mail, _ = running.carry(k, estimator.send(running.state, z))
        if kept is not None:
            holds = kept[once].reshape(mail.heard.shape)
            mail = mail._replace(heard=mail.heard & holds, packets=np.where(holds[..., None], mail.packets, np.nan))
        running.state = estimator.fuse(running.state, z, mail)
    t, n, d = stream.prior.x.shape
    x, P = estimator.estimate(running.state)
    return x.reshape(t, n, d), P.reshape(t, n, d, d)


def _tree(seed):
    _, stream = linear_team(seed=seed, trials=2, robots=4, ticks=TICKS, share=1.0)
    sighting = np.full_like(stream.senses.sighting, np.nan)
    for k, i, j in TREE:
        sighting[:, k, i, j] = stream.senses.sighting[:, k, i, j]
    return replace(stream, senses=stream.senses._replace(sighting=sighting))


@pytest.mark.parametrize("lost", [0.0, 0.7])
def test_on_a_linear_tree_it_becomes_the_exact_posterior_although_packets_are_lost(lost, rng):
    stream = _tree(seed=5)
    kept = rng.uniform(size=(60, 2, 4, 4)) >= lost
    x, P = _settled(cl.make("gbp", window=TICKS + 1, loss="none"), stream, 60 if lost else 8, kept)
    for trial in range(2):
        mean, covariance = dense_posterior(stream, trial, TICKS - 1, relative=True)
        np.testing.assert_allclose(x[trial], mean, atol=1e-8)
        np.testing.assert_allclose(P[trial], [covariance[i, :, i] for i in range(4)], atol=1e-8)


@pytest.mark.slow
def test_on_a_linear_graph_with_loops_the_means_become_exact_and_covariances_too_small():
    _, stream = linear_team(seed=8, trials=2, robots=3, ticks=TICKS)
    x, P = _settled(cl.make("gbp", window=TICKS + 1, loss="none"), stream, 300)
    for trial in range(2):
        mean, covariance = dense_posterior(stream, trial, TICKS - 1, relative=True)
        np.testing.assert_allclose(x[trial], mean, atol=1e-7)
        assert all(np.linalg.det(P[trial, i]) < np.linalg.det(covariance[i, :, i]) for i in range(3))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("label", "rounds"),
    [("robots-1-3/n=3[ticks=6,prior_sigma=0.1]", 200), ("camera/n=3[ticks=6,prior_position=0.02]", 100)],
)
def test_on_ranges_and_sightings_the_means_become_those_of_map_joint(label, rounds):
    """To a micrometre: both find the most probable window, and neither has lost a pose of it."""
    _, stream = cl.simulate(label, trials=5, seed=2)
    best = cl.make("map-joint", window=TICKS + 1, iterations=30, reading="range")
    x, _ = _settled(cl.make("gbp", window=TICKS + 1, loss="none"), stream, rounds)
    np.testing.assert_allclose(x, cl.run({"map": best}, stream).traces["map"].x[:, -1], atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("window", "anchors"), [(1, "rssi"), (4, "rssi"), (4, "range"), (30, "rssi")])
def test_alone_it_is_map_joint_for_any_window(window, anchors):
    truth, stream = cl.simulate("robots-1-3/n=1[ticks=20,prior_sigma=0.1]", trials=3, seed=2)
    stream = measure_anchor_ranges(truth, stream) if anchors == "range" else stream
    gbp = cl.make("gbp", window=window, loss="none", iterations=19)
    run = cl.run({"gbp": gbp, "map": cl.make("map-joint", window=window, iterations=20)}, stream)
    np.testing.assert_allclose(run.traces["gbp"].x, run.traces["map"].x, atol=1e-9)
    np.testing.assert_allclose(run.traces["gbp"].P, run.traces["map"].P, atol=1e-9)


def test_half_the_weighted_square_is_hubers_loss_and_an_absent_reading_has_none(rng):
    y, R = 4 * rng.normal(size=(60, 2)), covariances(rng, 60, d=2)
    y[7, 0] = np.nan
    whitened, noise, _ = weigh(y, R, "huber")
    squares = [(one * np.linalg.solve(R_w, one)).sum() for one, R_w in zip(whitened, noise, strict=True)]
    distance = np.sqrt([(one * np.linalg.solve(R_one, one)).sum() for one, R_one in zip(y, R, strict=True)])
    assert 10 < (distance > HUBER).sum() < 50
    np.testing.assert_allclose(np.array(squares) / 2, np.nan_to_num(huber(HUBER, distance)))


def test_it_sends_five_numbers_to_each_teammate_and_five_or_ten_more_for_each_older_pose():
    """Five of the newest pose; of the one before, what the own reading says; of older ones, what both have asked."""
    _, stream = cl.simulate("robots-1-3/n=3[ticks=8]", trials=2, seed=2)
    sent = cl.run({"gbp": cl.make("gbp", window=4)}, stream).traces["gbp"].bytes
    numbers = [5, 5 + 5, 5 + 5 + 10] + 5 * [5 + 5 + 10 + 10]
    np.testing.assert_array_equal(sent, 2 * (8 * 8 + 8 * sum(numbers)))
