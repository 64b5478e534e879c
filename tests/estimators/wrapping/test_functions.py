"""A tick as functions of the state: the world's models, with angles that a library may average and subtract."""

import numpy as np
import pytest

import cooploc as cl
from cooploc.estimators.adapters import senses_of

LABELS = ("robots-1-3/n=2", "camera/n=2", "no-compass/n=2")


@pytest.fixture(params=LABELS)
def tick(request):
    """A world, what one of its robots senses in a tick, and its state, turned almost round where it has a heading."""
    _, stream = cl.simulate(request.param, trials=1, seed=4, ticks=6)
    z = senses_of(cl.Senses(*(a[0, 4] for a in stream.senses[:-1]), extra={}), 1)
    x = stream.prior.x[0, 1].copy()
    x[2:] = np.pi - 1e-3
    return stream.world, z, x


def test_a_step_is_the_motion_with_a_heading_that_goes_on(tick):
    world, z, x = tick
    z = z._replace(odometry=np.abs(z.odometry) + 0.1, dt=np.float64(1.0))
    step, (moved, F, Q) = cl.motion_of(world, z), world.motion.move(x, z.odometry, z.dt)
    np.testing.assert_allclose(np.exp(1j * step.f(x)[2:]), np.exp(1j * moved[2:]))
    np.testing.assert_array_equal(step.f(x)[:2], moved[:2])
    assert (step.f(x)[2:] > np.pi).all()  # where the model's own is below
    slopes, c, _ = step.linear(x)
    np.testing.assert_allclose(slopes @ x + c, step.f(x), atol=1e-12)
    np.testing.assert_array_equal(slopes, F)
    np.testing.assert_array_equal(step.Q(x), Q)
    np.testing.assert_allclose(step.sample(x, np.zeros(2)), step.f(x), atol=1e-12)


def test_a_reading_less_what_is_expected_is_the_innovation(tick):
    world, z, x = tick
    readings = list(cl.readings_of(world, z))
    assert readings
    for one, (sensor, q, reading) in zip(readings, world.fixed(z), strict=True):
        y, H, _ = sensor.innovation(x, q, reading)
        np.testing.assert_allclose(one.z - one.h(x), y, atol=1e-9)
        np.testing.assert_allclose(one.linear(x)[0] - H @ x, y, atol=1e-9)
        np.testing.assert_array_equal(one.H(x), H)
