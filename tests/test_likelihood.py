"""The compiled sums over links against the sensors' own numpy, and what absence means to them."""

from dataclasses import dataclass

import numpy as np
import pytest

from cooploc.estimators import kernels, likelihood, particles
from cooploc.estimators.doa import GradientDoa
from cooploc.estimators.interface import Belief
from cooploc.estimators.likelihood import Heard
from cooploc.estimators.models import Displacement, LogDistance, Range, Unicycle

ROWS, SIDE = 5, 6.0
sizes = pytest.mark.parametrize("n", [2, 500, 1100])  # within a block, a common number, three blocks
links = pytest.mark.parametrize("team", [0, 1, 2, 3, 4, 7, 11])  # every way to part them in fours, twos and ones
wide = pytest.mark.parametrize("d", [2, 3])


def cloud(n, d=2, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, SIDE, (ROWS, n, d)), rng.normal(size=(ROWS, n))


def heard(sensor, team, integrate=True, absent=0.3):
    """Packets and readings, some missing; the first sender stands where particles are within the clamp."""
    rng = np.random.default_rng(team)
    L = rng.normal(0, 0.4, (ROWS, team, 2, 2))
    P = L @ L.mT
    x = rng.uniform(0, SIDE, (ROWS, team, 2))
    packets = np.concatenate([x, P[..., :1, 0], P[..., :1, 1], P[..., 1:, 1]], -1)
    mean = rng.uniform(0.1, 4, (ROWS, team)) if isinstance(sensor, Range) else rng.normal(-50, 8, (ROWS, team))
    gone = rng.uniform(size=(ROWS, team)) < absent
    return Heard(sensor, np.where(gone[..., None], np.nan, packets), np.where(gone, np.nan, mean), integrate)


def assert_close(a, b):
    np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-11)


@sizes
@links
@wide
@pytest.mark.parametrize("integrate", [True, False])
@pytest.mark.parametrize("sensor", [LogDistance(), LogDistance(-30.0, 1.7, 0.4), Range(), Range(0.5)], ids=str)
def test_teammates_are_the_sensors_own_numpy(sensor, integrate, d, team, n):
    x, logw = cloud(n, d)
    told = heard(sensor, team, integrate)
    if team:
        x[:, 0, :2] = np.nan_to_num(told.packets[:, 0, :2], nan=1.0) + np.array([0.03, 0.02])
    assert_close(likelihood.teammates(told, x, logw), likelihood.teammates_reference(told, x, logw))


@sizes
@links
@wide
def test_anchors_are_the_sensors_own_numpy(d, team, n):
    x, logw = cloud(n, d)
    sensor, rng = LogDistance(-35.0, 2.5, 3.0), np.random.default_rng(1)
    z = np.where(rng.uniform(size=(ROWS, team)) < 0.3, np.nan, rng.normal(-50, 5, (ROWS, team)))
    fixed = [(sensor, rng.uniform(0, SIDE, 2), z[:, a, None]) for a in range(team)]
    x[0, 0, :2] = fixed[0][1] + 0.02 if fixed else 0
    assert_close(likelihood.anchors(fixed, x, logw), likelihood.anchors_reference(fixed, x, logw))


@sizes
@pytest.mark.parametrize("motion", [Displacement(), Unicycle()], ids=["compass", "heading"])
@pytest.mark.parametrize("density", ["constant", "exact"])
def test_window_is_the_density_in_numpy(density, motion, n):
    d = 2 if isinstance(motion, Displacement) else 3
    x, logw = cloud(n, d)
    rng = np.random.default_rng(2)
    doa = GradientDoa(LogDistance(), (1.0, -2.0), (6.0, 4.0))
    angles = np.where(rng.uniform(size=(ROWS, 4)) < 0.3, np.nan, rng.uniform(-np.pi, np.pi, (ROWS, 4)))
    told = doa, motion, x, logw, angles, rng.normal(0, 0.3, (ROWS, 4, 2)), density, 0.2
    assert_close(likelihood.window(*told), likelihood.window_reference(*told))


@dataclass(frozen=True)
class Plugin(LogDistance):
    """A plug-in sensor that differs from the one it is made of."""

    def expect(self, x, q):
        return super().expect(x, q) + 7.0


def test_plugin_sensors_are_asked_themselves():
    x, logw = cloud(50)
    told = heard(Plugin(), 3, absent=0.0)
    raised = told._replace(sensor=LogDistance(), readings=told.readings - 7.0)
    assert_close(likelihood.teammates(told, x, logw), likelihood.teammates(raised, x, logw))
    z = np.full((ROWS, 1), -50.0)
    one, other = ([(s, np.ones(2), reading)] for s, reading in ((Plugin(), z), (LogDistance(), z - 7.0)))
    assert_close(likelihood.anchors(one, x, logw), likelihood.anchors(other, x, logw))


@pytest.mark.parametrize("sensor", [LogDistance(), Range()], ids=str)
def test_what_was_not_heard_leaves_every_bit(sensor):
    x, logw = cloud(700)
    told = heard(sensor, 3, absent=0.0)
    told.readings[1:3] = np.nan
    got = likelihood.teammates(told, x, logw)
    np.testing.assert_array_equal(got[1:3], logw[1:3])
    assert (got[[0, 3, 4]] != logw[[0, 3, 4]]).all()


def test_ranges_too_short_are_refused():
    x, logw = cloud(50)
    told = heard(Range(), 1, absent=0.0)
    told.readings[:] = 0.19
    np.testing.assert_array_equal(likelihood.teammates(told, x, logw), logw)


@links
def test_bits_do_not_depend_on_the_rows_beside(team):
    x, logw = cloud(1100)
    told, key = heard(LogDistance(), team), np.arange(2 * ROWS, dtype=np.uint32).reshape(-1, 2)
    together = particles.conclude(x, logw, key, 3, told)
    for r in range(ROWS):
        row = slice(r, r + 1)
        mine = told._replace(packets=told.packets[row], readings=told.readings[row])
        alone = particles.conclude(x[row], logw[row], key[row], 3, mine)
        for a, b in zip((*alone[0], *alone[1:]), (*together[0], *together[1:]), strict=True):
            np.testing.assert_array_equal(a[0], b[r])


# ---------------------------------------------------------------- particles' own loops


@sizes
def test_walk_is_the_motion_with_the_generators_noise(n):
    x, _ = cloud(n)
    rng = np.random.default_rng(3)
    u, dt = rng.normal(size=(ROWS, 2)), rng.uniform(0, 2, ROWS)
    u[1], u[2, 0] = np.nan, np.nan
    key, motion = rng.integers(0, 2**32, (ROWS, 2), np.uint32), Displacement(0.3, 0.5)
    noise = kernels.normals_reference(key, 9, kernels.MOVE, n)
    assert_close(particles.walk(motion, x, u, dt, key, 9), motion.sample(x, u[:, None], dt[:, None], noise))


@sizes
@pytest.mark.parametrize("team", [0, 3])
def test_conclusion_is_moments_and_renewal_in_numpy(n, team):
    x, logw = cloud(n)
    logw[0] *= 9  # renewed
    logw[1] *= 1e-3  # kept
    logw[2] = -np.inf  # starts again
    key, told = np.random.default_rng(4).integers(0, 2**32, (ROWS, 2), np.uint32), heard(LogDistance(sigma=30.0), team)
    weighed = likelihood.teammates_reference(told, x, logw)
    belief, new, logw_new = particles.conclude(x, logw, key, 5, told)
    want = particles.moments(x, particles.weights(weighed))
    for a, b in zip((*belief, new), (*want, particles.renew(x, weighed, key, 5)[0]), strict=True):
        assert_close(a, b)
    np.testing.assert_allclose(logw_new, particles.renew(x, weighed, key, 5)[1], atol=1e-11)
    assert_close(
        np.concatenate([a.ravel() for a in particles.summary(x, weighed)]), np.concatenate([a.ravel() for a in want])
    )
    if n > 2:
        assert (new[0] != x[0]).any()
        np.testing.assert_array_equal(new[1], x[1])


def test_conclusion_of_rows_with_nan_is_nan_there_alone():
    x, logw = cloud(300)
    key = np.zeros((ROWS, 2), np.uint32)
    clean = particles.conclude(x, logw, key, 5)
    x[1, 4], logw[2, 7] = np.nan, np.nan
    dirty = particles.conclude(x, logw, key, 5)
    assert isinstance(dirty[0], Belief)
    for r in (1, 2):
        assert np.isnan(dirty[0].x[r]).any()
    for r in (0, 3, 4):
        np.testing.assert_array_equal(dirty[0].P[r], clean[0].P[r])
        np.testing.assert_array_equal(dirty[1][r], clean[1][r])
