"""Worlds with headings: the camera world, and the radio arena without a compass."""

import numpy as np
import pytest
from oracles import about

import cooploc as cl
from cooploc.estimators.models import Unicycle, wrap


@pytest.fixture(scope="module")
def camera():
    return cl.simulate("camera", trials=20, seed=12)


@pytest.fixture(scope="module")
def arena():
    return cl.simulate("no-compass", trials=30, seed=4)


def true_drive(truth, tick):
    """Speed and turn rate (t, T - 1, n, 2) by the poses, which the motion model leads along."""
    before, after = truth.x[:, :-1], truth.x[:, 1:]
    omega = wrap(after[..., 2] - before[..., 2])
    ahead = before[..., 2] + omega / 2
    v = ((after - before)[..., :2] * np.stack([np.cos(ahead), np.sin(ahead)], -1)).sum(-1)
    drive = np.stack([v, omega], -1) / tick
    moved, _, _ = Unicycle(0, 0, tick).move(before, drive, np.full(v.shape, tick))
    np.testing.assert_allclose(moved[..., :2], after[..., :2], atol=1e-9)
    return drive


@pytest.mark.slow
@pytest.mark.parametrize(("label", "tick", "sd"), [("camera", 0.1, (0.04, 0.15)), ("no-compass", 1.0, (0.02, 0.1))])
def test_odometry_is_the_true_drive_with_its_noise(label, tick, sd):
    truth, stream = cl.simulate(label, trials=20, seed=4)
    noise = stream.senses.odometry[:, 1:] - true_drive(truth, tick)
    about(noise[..., 0], 0, sd[0])
    about(noise[..., 1], 0, sd[1])
    np.testing.assert_array_equal(stream.senses.dt, tick)


@pytest.mark.parametrize(
    ("label", "tick", "sd"), [("camera", 0.1, [0.1, 0.1, 0.05]), ("no-compass/sd=0.3", 1.0, [0.5, 0.5, 0.3])]
)
def test_the_prior_is_around_the_true_start(label, tick, sd):
    truth, stream = cl.simulate(label, trials=300, seed=4, ticks=1, sigma_v=1e-9, sigma_omega=1e-9)
    start = Unicycle(0, 0, tick).move(truth.x[:, 0], -stream.senses.odometry[:, 0], np.full((300, 3), tick))[0]
    off = stream.prior.x - start
    for k in range(3):
        about(wrap(off[..., k]) if k == 2 else off[..., k], 0, sd[k])
    np.testing.assert_allclose(stream.prior.P[0, 0], np.diag(np.square(sd)))
    assert (np.abs(stream.prior.x[..., 2]) <= np.pi).all()


def test_camera_readings_are_the_true_geometry_with_their_noise_in_the_field_of_view(camera):
    truth, stream = camera
    x = truth.x
    assert stream.channels() == {"odometry", "landmark", "sighting"} == {"odometry", *stream.world.sensors}
    places = {"landmark": np.broadcast_to(stream.world.landmarks, (*x.shape[:2], 6, 2)), "sighting": x[..., :2]}
    for channel, q in places.items():
        z = getattr(stream.senses, channel)
        delta = q[:, :, None] - x[:, :, :, None, :2]
        d = np.hypot(delta[..., 0], delta[..., 1])
        bearing = wrap(np.arctan2(delta[..., 1], delta[..., 0]) - x[..., None, 2])
        visible = (d < 4.0) & (np.abs(bearing) < 0.6)
        if channel == "sighting":
            visible &= ~np.eye(3, dtype=bool)
        np.testing.assert_array_equal(np.isfinite(z).all(-1), visible)
        np.testing.assert_array_equal(np.isnan(z).any(-1), ~visible)
        assert visible.sum() > 1000
        about((z[..., 0] - d)[visible], 0, 0.15)
        about(wrap(z[..., 1] - bearing)[visible], 0, 0.02)


def test_a_camera_that_sees_all_around_reads_wrapped_bearings():
    truth, stream = cl.simulate("camera", trials=5, view=4.0, sight=20.0, sigma_bearing=0.3)
    z, x = stream.senses.landmark, truth.x
    assert np.isfinite(z).all()
    assert (np.abs(z[..., 1]) <= np.pi).all()
    delta = stream.world.landmarks - x[..., None, :2]
    about(wrap(z[..., 1] - np.arctan2(delta[..., 1], delta[..., 0]) + x[..., None, 2]), 0, 0.3)


def test_robots_stay_inside_at_their_speed_and_turn_at_the_walls(camera, arena):
    for (truth, _), side, slowest, fastest in ((camera, 8, 0.05, 0.05), (arena, 6, 0.05, 0.15)):
        assert ((truth.x[..., :2] >= 0) & (truth.x[..., :2] <= side)).all()
        assert (np.abs(truth.x[..., 2]) <= np.pi).all()
        step = np.hypot(*np.moveaxis(np.diff(truth.x[..., :2], axis=1), -1, 0))
        still = step < 1e-9
        assert slowest - 1e-3 < step[~still].min() <= step.max() < fastest + 1e-3
        assert 0 < still.mean() < 0.3


@pytest.mark.slow
def test_radio_readings_without_a_compass_are_those_of_the_places(arena):
    truth, stream = arena
    x = truth.x[..., :2]
    d = np.linalg.norm(x[..., None, :] - stream.world.anchors, axis=-1)
    rssi = stream.senses.anchor_rssi + 40 + 30 * np.log10(np.maximum(d, 0.1))
    np.testing.assert_allclose(rssi.std(), np.sqrt(5), rtol=0.02)
    between = np.linalg.norm(x[:, :, :, None] - x[:, :, None], axis=-1)
    np.testing.assert_allclose((stream.air.range - between)[..., ~np.eye(3, dtype=bool)].std(), 0.1, rtol=0.02)
