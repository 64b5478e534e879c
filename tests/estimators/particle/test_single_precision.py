"""precision="single": the same filters on half the bits, as good to within rounding."""

import numpy as np
import pytest

from cooploc.estimators import make, particle_likelihood
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Belief, Rows
from cooploc.estimators.models import LogDistance, Range
from cooploc.estimators.particle_likelihood import ReceivedPackets
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.trace import trace

ANYWHERE = "cmrl[", "reciprocal-pf[", "channel-pf["
OTHERS = "arl[", "rssi-pf[", "mrsl-distance[", "ctrn[weights=exact,", "mrsl-rssi[neighbour_samples=M,", *ANYWHERE


pytestmark = pytest.mark.slow  # its loops are compiled apart


def in_both(name, scenario, **options):
    _, stream = simulate(scenario, seed=5, **options)
    return [trace(name, make(f"{name}precision={precision}]"), stream) for precision in ("double", "single")]


@pytest.mark.parametrize("name", ["mrsl-rssi[", *OTHERS])
def test_single_precision_estimates_what_double_does(name):
    """But for particles that resampling chose differently: less than a quarter of what sampling itself leaves."""
    double, single = in_both(name, "robots-1-3/n=3", trials=4, ticks=12)
    sampling = np.sqrt(np.trace(double.P, axis1=-2, axis2=-1) / 200)
    apart = np.linalg.norm(double.x - single.x, axis=-1)
    assert 0 < np.median(apart / sampling) < 0.25
    np.testing.assert_allclose(single.x[:, 0], double.x[:, 0], atol=0.02)


@pytest.mark.parametrize("name", ANYWHERE)
def test_single_precision_with_headings_and_cameras(name):
    double, single = in_both(name, "camera/n=3", trials=2, ticks=6)
    np.testing.assert_allclose(single.x[:, 0, :, :2], double.x[:, 0, :, :2], atol=0.05)


@pytest.mark.parametrize("side", [30.0, 0.5], ids=["near links", "far links"])
@pytest.mark.parametrize("variance", [0.0, 0.3, 1e4, 1e30], ids=["sure", "usual", "vague", "absurd"])
@pytest.mark.parametrize("sensor", [LogDistance(), Range()], ids=str)
def test_eight_links_at_once_neither_overflow_nor_vanish(sensor, variance, side):
    """What log-weights have in common does not matter."""
    rng = np.random.default_rng(0)
    x, logw = rng.uniform(0, side, (2, 300, 2)), rng.normal(size=(2, 300))
    q, z = rng.uniform(0, 30, (2, 19, 2)), np.zeros((2, 19))
    q[:, 0] = x[:, 0]  # within the clamp
    for j in range(19):
        expected = 1 - sensor.innovation(x.mean(1), q[:, j], np.ones((2, 1)))[0][:, 0]
        z[:, j] = expected + rng.normal(0, np.sqrt(sensor.R[0, 0]), 2)
    heard = ReceivedPackets(sensor, np.concatenate([q, np.tile([variance, 0, variance], (2, 19, 1))], -1), z, True)
    one, two = (particle_likelihood.teammates(heard, x.astype(t), logw.astype(t)) for t in (np.float64, np.float32))
    one, two = (each - each[:, :1] for each in (one, two.astype(float)))
    assert np.isfinite([one, two]).all()
    if variance < 1e30:
        np.testing.assert_allclose(two, one, atol=2e-3, rtol=1e-4)


def test_an_arena_beyond_seven_digits_is_refused():
    _, stream = simulate("robots-1-3/n=2", trials=1, seed=0, ticks=1)
    prior, far = Belief(*(part[0] for part in stream.prior)), dict(vars(stream.world), arena=stream.world.arena + 5e5)
    rows = Rows(np.zeros(2, int), np.arange(2), np.array([[1, 2], [3, 4]], np.uint32))
    with pytest.raises(BadInput, match="put the origin within 10000 m"):
        make("rssi-pf", precision="single").init(prior, type(stream.world)(**far), rows)
