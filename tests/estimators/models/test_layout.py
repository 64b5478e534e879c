"""States wider than a pose, and all readings of a tick as one vector."""

import numpy as np
import pytest

import cooploc as cl
from cooploc.estimators.interface import Belief, Senses
from cooploc.estimators.kalman import kalman

CASES = [("robots-1-3/n=3", None, 4), ("camera/n=3", 4, 5)]


def a_tick(label):
    _, stream = cl.simulate(
        label, trials=2, ticks=4, **({"sight": 30.0, "view": 3.1} if label.startswith("camera") else {})
    )
    arrays = {
        name: getattr(stream.senses, name)[:, 3].reshape(6, *getattr(stream.senses, name).shape[3:])
        for name in Senses._fields[:-1]
    }
    prior = Belief(*(a.reshape(6, *a.shape[2:]) for a in stream.prior))
    return stream.world, Senses(**arrays, extra={}), prior


@pytest.mark.parametrize(("label", "heading", "width"), CASES)
def test_the_models_of_a_wider_state_are_those_of_its_pose(label, heading, width):
    world, z, prior = a_tick(label)
    layout = cl.Layout(width, heading)
    wide, told = layout.world(world), layout.prior(prior, np.full(width - len(layout.pose), 0.5))
    np.testing.assert_array_equal(layout.estimate(*told).x, prior.x)
    np.testing.assert_array_equal(layout.estimate(*told).P, prior.P)
    (x, F, Q), (x_w, F_w, Q_w) = (w.motion.move(b.x, z.odometry, z.dt) for w, b in ((world, prior), (wide, told)))
    P, P_w = F @ prior.P @ F.mT + Q, F_w @ told.P @ F_w.mT + Q_w
    for (one, q, reading), (other, _, _) in zip(world.fixed(z), wide.fixed(z), strict=True):
        x, P = kalman(x, P, *one.innovation(x, q, reading)[:2], one.R)
        x_w, P_w = kalman(x_w, P_w, *other.innovation(x_w, q, reading)[:2], other.R)
    found = layout.estimate(x_w, P_w)
    np.testing.assert_allclose(found.x, x, atol=1e-12)
    np.testing.assert_allclose(found.P, P, atol=1e-12)


@pytest.mark.parametrize("label", ["robots-1-3/n=3", "camera/n=3"])
def test_one_vector_a_tick_has_the_information_of_its_readings(label):
    world, z, prior = a_tick(label)
    y, H, R = world.stack(prior.x, z)
    for r in range(6):
        there, information = np.isfinite(y[r]), np.zeros((prior.x.shape[-1],) * 2)
        for sensor, q, reading in world.fixed(z):
            _, h, _ = sensor.innovation(prior.x[r], q, reading[r])
            information += h.T @ np.linalg.inv(sensor.R) @ h * np.isfinite(reading[r]).all()
        h = H[r, there]
        np.testing.assert_allclose(h.T @ np.linalg.inv(R[r][np.ix_(there, there)]) @ h, information, atol=1e-9)
        assert there.sum() > 3
