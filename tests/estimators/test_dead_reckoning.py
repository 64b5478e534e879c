"""What every filter is compared with: odometry alone, and a place that never changes."""

import numpy as np
import pytest

import cooploc as cl
from cooploc.scenarios.runner.trace import trace


def test_displacements_and_their_variances_add_up():
    _, stream = cl.simulate("trajectory", trials=2, seed=3, ticks=9)
    found, sigma = trace("odometry", cl.make("dead-reckoning"), stream), stream.world.motion.sigma
    np.testing.assert_allclose(found.x, stream.prior.x[:, None] + stream.senses.odometry.cumsum(1))
    elapsed = (stream.senses.dt / stream.world.motion.tick).cumsum(1)[..., None, None]
    np.testing.assert_allclose(found.P, stream.prior.P[:, None] + elapsed * sigma**2 * np.eye(2))


@pytest.mark.parametrize(("label", "heading"), [("trajectory", []), ("camera/n=2", [np.pi**2 / 3])])
def test_a_constant_is_anywhere_between_what_is_fixed(label, heading):
    """Against draws of a place and a heading that may be any."""
    _, stream = cl.simulate(label, trials=1, seed=3, ticks=3)
    found = trace("constant", cl.make("constant"), stream)
    fixed = np.concatenate([stream.world.anchors, stream.world.landmarks])
    drawn = np.random.default_rng(1).uniform(fixed.min(0), fixed.max(0), (100_000, 2))
    np.testing.assert_allclose(found.x[..., :2], drawn.mean(0) + 0 * found.x[..., :2], atol=0.05)
    np.testing.assert_allclose(found.P[0, -1, 0], np.diag([*drawn.var(0), *heading]), rtol=0.02)
