"""Every compiled step of a row against the numpy statement of it, to 1e-12; a row's bits depend on no other row."""

import numpy as np
import pytest
from oracles import covariances

import cooploc as cl
from cooploc.estimators import kalman as steps
from cooploc.estimators.compiled import spread_out
from cooploc.estimators.interface import Senses
from cooploc.estimators.joint_gaussian import block_diagonal, move_blocks, square
from cooploc.estimators.kalman import ENGINES, innovation, kalman, move, predict
from cooploc.estimators.models import Bearing, LogDistance, Range, Sighting, Unicycle
from cooploc.scenarios.runner.trace import trace

ROWS = 40


def near(found, wanted):
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12)


def beliefs(seed, d):
    rng = np.random.default_rng(seed)
    return rng, rng.uniform(-3, 3, (ROWS, d)), covariances(rng, ROWS, d=d)


def sensed(odometry, dt):
    empty = np.zeros((*dt.shape, 0))
    return Senses(odometry, dt, empty, np.zeros((*dt.shape, 0, 2)), np.zeros((*dt.shape, 0, 2)), {})


@pytest.mark.parametrize("gate", [np.inf, 3.0])
@pytest.mark.parametrize(("d", "k"), [(2, 1), (2, 2), (3, 1), (3, 2), (7, 3)])
def test_compiled_updates_are_the_numpy_ones(d, k, gate):
    rng, x, P = beliefs(1, d)
    y, H, R = 2 * rng.normal(size=(ROWS, k)), rng.normal(size=(ROWS, k, d)), covariances(rng, ROWS, d=k)
    y[3], H[4, 0, 1], R[5, 0, 0] = np.nan, np.nan, np.nan
    found, wanted = ENGINES["batched"].update(x, P, y, H, R, gate), kalman(x, P, y, H, R, gate)
    for mine, theirs, before in zip(found, wanted, (x, P), strict=True):
        near(mine, theirs)
        same = np.asarray((theirs == before).reshape(ROWS, -1).all(1))
        assert same.sum() >= 3
        np.testing.assert_array_equal(mine[same], before[same])
    alone = ENGINES["batched"].update(x[[7]], P[[7]], y[[7]], H[[7]], R[[7]], gate)
    np.testing.assert_array_equal(alone[0][0], found[0][7])
    np.testing.assert_array_equal(alone[1][0], found[1][7])


def test_a_team_is_moved_block_by_block_as_by_one_matrix():
    rng = np.random.default_rng(3)
    P, F, Q = covariances(rng, 6, d=12), rng.normal(size=(6, 4, 3, 3)), covariances(rng, 24, d=3).reshape(6, 4, 3, 3)
    wanted = predict(P, square(block_diagonal(F)), square(block_diagonal(Q)))
    found = move_blocks(P, F, Q)
    near(found, wanted)
    np.testing.assert_array_equal(found, found.mT)


@pytest.mark.parametrize("lead", [(ROWS,), (5, 8)])
def test_compiled_wheels_are_the_numpy_ones(lead):
    rng, x, _ = beliefs(4, 3)
    u, dt = rng.normal(size=(ROWS, 2)), rng.uniform(0, 2, ROWS)
    u[2], u[3, 0], u[4, 1], dt[5] = np.nan, np.nan, np.nan, 0.0
    x, u, dt = x.reshape(*lead, 3), u.reshape(*lead, 2), dt.reshape(lead)
    wheels = Unicycle(sigma_v=0.3, sigma_omega=0.2)
    for mine, theirs in zip(move(wheels, x, sensed(u, dt)), wheels.move(x, u, dt), strict=True):
        assert mine.shape == theirs.shape
        near(mine, theirs)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("sensor", [Range(), LogDistance(), Sighting(), Bearing()], ids=lambda s: type(s).__name__)
def test_compiled_innovations_are_the_numpy_ones(sensor, d):
    rng, x, _ = beliefs(6, d)
    k = 2 if isinstance(sensor, Sighting) else 1
    q, z = rng.uniform(-3, 3, (ROWS, 2)), rng.uniform(-6, 6, (ROWS, k))
    z[0], z[1, 0], q[2], q[3] = np.nan, 0.1, x[2, :2], x[3, :2] + 0.05  # absent, too near, at the same place, nearly
    for place in (q, q[9]):
        found, wanted = innovation(sensor, x, place, z), sensor.innovation(x, place, z)
        for mine, theirs in zip(found, wanted, strict=True):
            near(mine, theirs)
    team = innovation(sensor, x[:, None], q[None], np.broadcast_to(z[:, None], (ROWS, ROWS, k)))
    near(team[0][4], sensor.innovation(x[4], q, z[4])[0])


@pytest.mark.parametrize("name", ["ekf-local", "ekf-split-ci[form=conservative]", "ekf-joint[gate=3.0]", "ekf-interim"])
def test_landmarks_in_one_loop_change_no_bit(name, monkeypatch):
    _, stream = cl.simulate("camera/n=3", trials=2, seed=1, ticks=15)
    together = trace(name, cl.make(name), stream)
    monkeypatch.setattr(steps, "landmarks_alone", lambda *_: None)
    in_turn = trace(name, cl.make(name), stream)
    for what in ("x", "P", "messages", "bytes"):
        assert (getattr(together, what) == getattr(in_turn, what)).all()


def test_an_array_spread_out_is_broadcast_and_cannot_be_written():
    spread = spread_out(np.arange(3.0), (2, 4, 3))
    assert (spread == np.broadcast_to(np.arange(3.0), (2, 4, 3))).all()
    assert spread.flags.c_contiguous
    assert not spread.flags.writeable
