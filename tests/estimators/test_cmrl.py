"""CMRL against Bayes' rule on a grid, and its rule that a detection counts once per meeting."""

import numpy as np
import pytest
from oracles import log_distance

from cooploc.estimators import make
from cooploc.estimators.interface import Belief, Mail, Rows, Senses, World
from cooploc.estimators.models import Displacement, LogDistance, Range
from cooploc.estimators.particles import weights

PRIOR = Belief(np.array([[2.0, 2.0], [3.5, 4.0]]), np.array([[[0.36, 0.1], [0.1, 0.25]], [[0.5, -0.2], [-0.2, 0.3]]]))
WORLD = World(
    robots=2,
    tick=1.0,
    arena=np.array([[0.0, 0.0], [6.0, 6.0]]),
    motion=Displacement(0.0),
    sensors={"radio_range": Range(0.1)},
)
ROWS = Rows(np.zeros(2, int), np.arange(2), np.array([[1, 2], [3, 4]], np.uint32))


def tick(estimator, s, reading, step=0.0):
    """One tick in which both robots move east, and hear each other with the same reading (range or RSSI)."""
    nothing = np.empty((2, 0))
    z = Senses(np.array([[step, 0.0]] * 2), np.ones(2), nothing, nothing[..., None], nothing[..., None], {})
    s = estimator.correct(estimator.predict(s, z), z)
    heard = ~np.eye(2, dtype=bool)
    packets, both = np.where(heard[..., None], estimator.send(s, z), np.nan), np.where(heard, reading, np.nan)
    return estimator.fuse(s, z, Mail(heard, packets, both, both))


def grid_bayes(log_likelihood):
    """Mean and covariance of robot 0 by sums over both robots' places, 48 steps a side; nothing is linearised."""
    side = np.linspace(-1.5, 7.5, 48)
    cells = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)

    def prior(i):
        e = cells - PRIOR.x[i]
        return np.exp(-0.5 * (e @ np.linalg.inv(PRIOR.P[i]) * e).sum(-1))

    d = np.linalg.norm(cells[:, None] - cells, axis=-1)
    p = prior(0) * (np.exp(log_likelihood(d)) @ prior(1))
    mean = p @ cells / p.sum()
    return mean, np.einsum("c,ci,cj->ij", p, cells - mean, cells - mean) / p.sum()


CASES = {
    "range": (Range(0.3), 1.6, lambda d: -((1.6 - d) ** 2) / (2 * 0.3**2)),
    "rssi": (LogDistance(), -46.0, lambda d: -((-46.0 - log_distance(np.maximum(d, 0.1))) ** 2) / (2 * 5)),
}


@pytest.mark.slow
@pytest.mark.parametrize("reading", CASES)
def test_one_detection_is_bayes_rule_on_a_grid(reading):
    sensor, z, log_likelihood = CASES[reading]
    world = World(2, 1.0, WORLD.arena, WORLD.motion, {f"radio_{reading}": sensor})
    estimator = make("cmrl", reading=reading, anchor_reading="none", particles=10_000, samples=1000)
    belief = estimator.estimate(tick(estimator, estimator.init(PRIOR, world, ROWS), z))
    mean, P = grid_bayes(log_likelihood)
    np.testing.assert_allclose(belief.x[0], mean, atol=0.03)
    np.testing.assert_allclose(belief.P[0], P, atol=0.03)
    assert np.linalg.norm(mean - PRIOR.x[0]) > 0.1  # or else the agreement would say nothing


def used(estimator, steps):
    """Whether robot 0 used the detection of each tick: the distance since then starts again."""
    s, found = estimator.init(PRIOR, WORLD, ROWS), []
    for step in steps:
        s, before = tick(estimator, s, 2.5, step), s
        found.append(not np.allclose(weights(s.own.logw)[0], weights(before.own.logw)[0], atol=1e-12))
    return found


def test_a_detection_of_a_teammate_counts_once_until_the_robot_has_travelled():
    once = make("cmrl", anchor_reading="none", apart=2.5)
    assert used(once, [0.0, 0.0, 1.0, 1.0, 1.0, 0.0]) == [True, False, False, False, True, False]
    assert used(make("cmrl", anchor_reading="none", apart=0.0), [0.0, 0.0, 1.0]) == [True, True, True]
