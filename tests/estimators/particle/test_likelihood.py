"""The compiled sums over links against the sensors' own numpy, and what absence means to them."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from oracles import normals

from cooploc.estimators import particle_likelihood, particles, random_numbers
from cooploc.estimators.interface import Senses
from cooploc.estimators.models import Displacement, GradientDoa, LogDistance, Range, Unicycle
from cooploc.estimators.particle_likelihood import ReceivedPackets

ROWS, SIDE = 5, 6.0
sizes = pytest.mark.parametrize("n", [2, 500, 1100])  # fewer than a vector, a common number, more
links = pytest.mark.parametrize("team", [0, 1, 2, 3, 7, 11, 29])  # every way to part them in eights, fours, twos, ones
clouds = pytest.mark.parametrize("side", [6.0, 0.4])  # all links are near; most are far
wide = pytest.mark.parametrize("d", [2, 3])


def cloud(n, d=2, side=SIDE):
    rng = np.random.default_rng(0)
    return (SIDE - side) / 3 + rng.uniform(0, side, (ROWS, n, d)), rng.normal(size=(ROWS, n))


def hear(sensor, team, integrate=True, absent=0.3):
    """Packets and readings, some missing; the first sender stands where particles are within the clamp."""
    rng = np.random.default_rng(team)
    L = rng.normal(0, 0.4, (ROWS, team, 2, 2))
    P = L @ L.mT
    x = rng.uniform(0, SIDE, (ROWS, team, 2))
    packets = np.concatenate([x, P[..., :1, 0], P[..., :1, 1], P[..., 1:, 1]], -1)
    mean = rng.uniform(0.1, 4, (ROWS, team)) if isinstance(sensor, Range) else rng.normal(-50, 8, (ROWS, team))
    gone = rng.uniform(size=(ROWS, team)) < absent
    return ReceivedPackets(sensor, np.where(gone[..., None], np.nan, packets), np.where(gone, np.nan, mean), integrate)


def read_anchors(team, sigma):
    rng = np.random.default_rng(1)
    z = np.where(rng.uniform(size=(ROWS, team)) < 0.3, np.nan, rng.normal(-50, 5, (ROWS, team)))
    sensor = LogDistance(-35.0, 2.5, sigma)
    return [(sensor, rng.uniform(0, SIDE, 2), z[:, a, None]) for a in range(team)]


def assert_close(a, b):
    np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-11)


@sizes
@links
@wide
@clouds
@pytest.mark.parametrize("integrate", [True, False])
@pytest.mark.parametrize("sensor", [LogDistance(), LogDistance(-30.0, 1.7, 0.4), Range(), Range(0.5)], ids=str)
def test_teammates_are_the_sensors_own_numpy(sensor, integrate, side, d, team, n):
    x, logw = cloud(n, d, side=side)
    heard = hear(sensor, team, integrate)
    if team and side == SIDE:
        x[:, 0, :2] = np.nan_to_num(heard.packets[:, 0, :2], nan=1.0) + np.array([0.03, 0.02])
    assert_close(particle_likelihood.teammates(heard, x, logw), particle_likelihood.teammates_reference(heard, x, logw))


@sizes
@links
@wide
@clouds
def test_anchors_are_the_sensors_own_numpy(side, d, team, n):
    x, logw = cloud(n, d, side=side)
    fixed = read_anchors(team, 3.0)
    if fixed and side == SIDE:
        x[0, 0, :2] = fixed[0][1] + 0.02
    assert_close(particle_likelihood.anchors(fixed, x, logw), particle_likelihood.anchors_reference(fixed, x, logw))


@sizes
@pytest.mark.parametrize("motion", [Displacement(), Unicycle()], ids=["compass", "heading"])
@pytest.mark.parametrize("form", ["wrapped", "sum", "corners", "exact"])
def test_window_is_the_density_in_numpy(form, motion, n):
    x, logw = cloud(n, 2 if isinstance(motion, Displacement) else 3)
    rng = np.random.default_rng(2)
    doa = GradientDoa(LogDistance(), (1.0, -2.0), (6.0, 4.0))
    angles = np.where(rng.uniform(size=(ROWS, 4)) < 0.3, np.nan, rng.uniform(-np.pi, np.pi, (ROWS, 4)))
    directions = doa, motion, x, logw, angles, rng.normal(0, 0.3, (ROWS, 4, 2)), form, 0.2
    assert_close(particle_likelihood.window(*directions), particle_likelihood.window_reference(*directions))


@sizes
@wide
def test_the_gradients_loop_is_its_density_in_numpy(d, n):
    x, logw = cloud(n, d)
    x[0, 0, :2] = 1.01, -1.98  # within the clamp of a corner
    doa = GradientDoa(LogDistance(-35.0, 2.5, 3.0), (1.0, -2.0), (6.0, 4.0))
    g = np.random.default_rng(3).normal(0, 2, (ROWS, 2))
    g[2, 0], g[3] = np.nan, np.nan
    got = particle_likelihood.gradient(doa, x, logw, g)
    there = [0, 1, 4]
    assert_close(got[there], logw[there] + doa.log_gradient(x, g[:, None])[there])
    np.testing.assert_array_equal(got[2:4], logw[2:4])


@dataclass(frozen=True)
class Plugin(LogDistance):
    """A plug-in sensor that differs from the one it is made of, and has no loop."""

    def level(self, x, q):
        return super().level(x, q) + 7.0


def test_plugin_sensors_are_asked_themselves():
    x, logw = cloud(50)
    heard = hear(Plugin(), 3, absent=0.0)
    raised = heard._replace(sensor=LogDistance(), readings=heard.readings - 7.0)
    assert_close(particle_likelihood.teammates(heard, x, logw), particle_likelihood.teammates(raised, x, logw))
    z = np.full((ROWS, 1), -50.0)
    one, other = ([(s, np.ones(2), reading)] for s, reading in ((Plugin(), z), (LogDistance(), z - 7.0)))
    assert_close(particle_likelihood.anchors(one, x, logw), particle_likelihood.anchors(other, x, logw))


@pytest.mark.parametrize("motion", [Displacement(), Unicycle()], ids=["compass", "heading"])
def test_past_packets_of_a_sensor_without_a_loop_weigh_the_same(motion, rng):
    x, logw = cloud(40, 2 if isinstance(motion, Displacement) else 3)
    packets, samples = hear(LogDistance(), 12), 3
    past = particles.PastPackets(
        packets.packets.reshape(ROWS, 4, samples, 5),
        packets.readings.reshape(ROWS, 4, samples),
        rng.normal(0, 0.3, (ROWS, 4, samples, 2)),
    )
    heard = packets._replace(readings=past.readings[:, :, 0])
    one = particles.weigh_past_packets(past, heard, motion, x, logw, 0.25)
    raised = past._replace(readings=past.readings + 7.0)
    other = particles.weigh_past_packets(raised, heard._replace(sensor=Plugin()), motion, x, logw, 0.25)
    np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)
    assert np.ptp(one - logw) > 0.1


# ---------------------------------------------------------------- a tick in two passes


def advance(x, logw, due, u, dt, key, fixed):
    nothing = np.empty((len(dt), 0))
    z = Senses(u, dt, nothing, nothing, nothing, {})
    world = SimpleNamespace(motion=Displacement(0.3, 0.5))
    return particles.advance(SimpleNamespace(world=world, x=x, logw=logw, due=due, key=key), z, 9, fixed, sends=True)


@sizes
@pytest.mark.parametrize("team", [0, 3])
def test_a_tick_ends_with_moments_in_numpy_and_says_which_rows_are_poor(n, team):
    x, logw = cloud(n)
    logw[0] *= 9
    logw[1] *= 1e-3
    logw[2] = -np.inf  # starts again
    heard = hear(LogDistance(sigma=30.0), team)
    weighed = particle_likelihood.teammates_reference(heard, x, logw)
    belief, logw_new, due = particles.posterior_summary(x, logw, heard)
    w = particles.weights(weighed)
    for a, b in zip((*belief, *particles.summary(x, weighed)), (*particles.moments(x, w),) * 2, strict=True):
        assert_close(a, b)
    assert_close(logw_new, particles.restart_weights(weighed))
    np.testing.assert_array_equal(due, particles.poor(w))
    if n > 2:
        assert due[0]
        assert not due[1:3].any()


@sizes
@links
@clouds
def test_a_tick_begins_with_renewal_motion_and_anchors_in_numpy(side, team, n):
    x, logw = cloud(n, side=side)
    logw *= np.array([9.0, 0.1, 9.0, 0.0, 9.0])[:, None]
    rng = np.random.default_rng(3)
    u, dt = rng.normal(size=(ROWS, 2)), rng.uniform(0, 2, ROWS)
    u[1], u[2, 0] = np.nan, np.nan
    key, fixed = rng.integers(0, 2**32, (ROWS, 2), np.uint32), read_anchors(team, 30.0)
    new, weighed, sent = advance(x, logw, particles.poor(particles.weights(logw)), u, dt, key, fixed)
    there, flat = particles.resample(x, logw, key, 8)
    there = Displacement(0.3, 0.5).sample(there, u[:, None], dt[:, None], normals(key, 8 * 9 + random_numbers.MOVE, n))
    assert_close(new, there)
    want = particle_likelihood.anchors_reference(fixed, there, flat)
    np.testing.assert_allclose(weighed, want, rtol=1e-11, atol=1e-10)
    for a, b in zip(sent, particles.moments(new, particles.weights(weighed)), strict=True):
        assert_close(a, b)
