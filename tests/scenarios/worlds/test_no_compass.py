"""The radio arena without a compass: robots drive as their odometry says, and read what robots with a compass do."""

import numpy as np
import pytest

import cooploc as cl
from cooploc.estimators import BUILTIN
from cooploc.estimators.models import Unicycle, wrap


@pytest.fixture(scope="module")
def made():
    return cl.simulate("no-compass", trials=30, seed=4)


def test_odometry_is_the_true_drive_with_its_noise(made):
    """The drive is found again from the poses; noise of speed and turn rate has its sd, within 4 standard errors."""
    truth, stream = made
    before, after = truth.x[:, :-1], truth.x[:, 1:]
    omega = wrap(after[..., 2] - before[..., 2])
    ahead = before[..., 2] + omega / 2
    v = ((after - before)[..., :2] * np.stack([np.cos(ahead), np.sin(ahead)], -1)).sum(-1)
    drive = np.stack([v, omega], -1)
    moved, _, _ = Unicycle(0, 0, 1.0).move(before, drive, np.ones(v.shape))
    np.testing.assert_allclose(moved[..., :2], after[..., :2], atol=1e-9)
    noise = (stream.senses.odometry[:, 1:] - drive).reshape(-1, 2)
    np.testing.assert_allclose(noise.std(0), [0.02, 0.1], rtol=4 / np.sqrt(2 * len(noise)))
    assert (np.abs(noise.mean(0)) < 4 * noise.std(0) / np.sqrt(len(noise))).all()


def test_robots_stay_inside_and_move_at_their_speed(made):
    truth, _ = made
    assert 0 <= truth.x[..., :2].min() < 0.2
    assert 5.8 < truth.x[..., :2].max() <= 6
    step = np.hypot(*np.moveaxis(np.diff(truth.x[..., :2], axis=1), -1, 0))
    assert step[step > 0].min() > 0.049
    assert step.max() < 0.151


def test_the_prior_is_around_the_true_start():
    truth, stream = cl.simulate("no-compass/sd=0.3", trials=300, seed=4, ticks=1, sigma_v=1e-9, sigma_omega=1e-9)
    off = stream.prior.x - Unicycle(0, 0, 1.0).move(truth.x[:, 0], -stream.senses.odometry[:, 0], np.ones((300, 3)))[0]
    off = np.concatenate([off[..., :2], wrap(off[..., 2:])], -1).reshape(-1, 3)
    np.testing.assert_allclose(off.std(0), [0.5, 0.5, 0.3], rtol=4 / np.sqrt(2 * len(off)))
    np.testing.assert_allclose(stream.prior.P[0, 0], np.diag([0.25, 0.25, 0.09]))


def test_radio_readings_are_those_of_the_places(made):
    truth, stream = made
    x = truth.x[..., :2]
    d = np.linalg.norm(x[..., None, :] - stream.world.anchors, axis=-1)
    rssi = stream.senses.anchor_rssi + 40 + 30 * np.log10(np.maximum(d, 0.1))
    np.testing.assert_allclose(rssi.std(), np.sqrt(5), rtol=0.02)
    between = np.linalg.norm(x[:, :, :, None] - x[:, :, None], axis=-1)
    other = ~np.eye(3, dtype=bool)
    np.testing.assert_allclose((stream.air.range - between)[..., other].std(), 0.1, rtol=0.02)


def test_a_trial_is_the_same_whatever_else_is_simulated(made):
    _, stream = made
    assert cl.simulate("no-compass", trials=[7], seed=4)[1].hashes == (stream.hashes[7],)


@pytest.mark.parametrize("name", BUILTIN)
def test_every_kind_of_estimator_runs_there(name):
    _, stream = cl.simulate("no-compass", trials=2, seed=2, ticks=15)
    (trace,) = cl.run(name, stream).traces.values()
    assert trace.x.shape == (2, 15, 3, 3)
    assert np.isfinite(trace.x).all()
    assert (np.linalg.eigvalsh(trace.P) > -1e-9).all()
