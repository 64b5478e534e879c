"""The Kalman steps of rows: textbook, filterpy, and every compiled step against its numpy statement; messages."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles import covariances, is_covariance, repeatable

import cooploc as cl
from cooploc.estimators import BUILTIN, make
from cooploc.estimators import kalman as steps
from cooploc.estimators.interface import Senses
from cooploc.estimators.joint_gaussian import block_diagonal, move_blocks, square
from cooploc.estimators.kalman import ENGINES, Message, assume, distance, innovation, kalman, move
from cooploc.estimators.models import Bearing, LogDistance, Range, Sighting, Unicycle
from cooploc.scenarios.runner.trace import trace

FILTERS = [name for name in BUILTIN if name.startswith(("ekf-", "ukf-"))]
UPDATES = {"numpy": kalman, **{name: engine.update for name, engine in ENGINES.items()}}
ROWS = 40


def problem(seed, rows, d, k):
    rng = np.random.default_rng(seed)
    x, y, H = rng.normal(size=(rows, d)), rng.normal(size=(rows, k)), rng.normal(size=(rows, k, d))
    return x, covariances(rng, rows, d=d), y, H, covariances(rng, rows, d=k)


def assert_near(found, wanted):
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", UPDATES)
@pytest.mark.parametrize(("d", "k"), [(2, 1), (2, 2), (3, 1), (3, 2), (6, 2)])
def test_update_is_the_textbooks(d, k, name):
    """In information form, another formula than the gain's: P'^-1 = P^-1 + H' R^-1 H."""
    x, P, y, H, R = problem(1, 20, d, k)
    x1, P1 = UPDATES[name](x, P, y, H, R, np.inf)
    want = np.linalg.inv(np.linalg.inv(P) + H.mT @ np.linalg.inv(R) @ H)
    np.testing.assert_allclose(P1, want, atol=1e-9)
    np.testing.assert_allclose(x1, x + (want @ H.mT @ np.linalg.solve(R, y[..., None]))[..., 0], atol=1e-9)


@pytest.mark.parametrize("d", [2, 3, 6])
def test_prediction_is_the_textbooks(d):
    rng = np.random.default_rng(3)
    F = rng.normal(size=(20, d, d))
    P, Q = covariances(rng, 20, d=d), covariances(rng, 20, d=d)
    for engine in ENGINES.values():
        P1 = engine.predict(P, F, Q)
        np.testing.assert_allclose(P1, [f @ p @ f.T + q for f, p, q in zip(F, P, Q, strict=True)], atol=1e-9)
        assert is_covariance(P1)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("absent", ["y", "H", "R", "a part of y", "a part of H"])
def test_rows_with_anything_absent_come_back_bit_identical(absent, engine):
    x, P, y, H, R = problem(4, 6, 3, 2)
    P = P + np.triu(np.full((3, 3), 1e-3), 1)  # not symmetric: even that must come back
    {"y": y, "H": H, "R": R, "a part of y": y[..., :1], "a part of H": H[..., 1:, 2:]}[absent][[1, 4]] = np.nan
    x1, P1 = ENGINES[engine].update(x, P, y, H, R, np.inf)
    np.testing.assert_array_equal(x1[[1, 4]], x[[1, 4]])
    np.testing.assert_array_equal(P1[[1, 4]], P[[1, 4]])
    assert (x1 != x).any(1).tolist() == [True, False, True, True, False, True]
    assert np.isfinite(P1).all()


@pytest.mark.parametrize("engine", ENGINES)
def test_gate_is_a_squared_mahalanobis_distance(engine):
    x, P, y, H, R = problem(6, 200, 3, 2)
    d2 = np.array([b @ np.linalg.inv(h @ p @ h.T + r) @ b for p, b, h, r in zip(P, y, H, R, strict=True)])
    x1, P1 = ENGINES[engine].update(x, P, y, H, R, np.median(d2))
    used = (x1 != x).any(-1)
    np.testing.assert_array_equal(used, d2 <= np.median(d2))
    np.testing.assert_array_equal(P1[~used], P[~used])
    np.testing.assert_allclose(distance(y, H @ P @ H.mT + R), d2, rtol=1e-9)


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.floats(-8, 2))
@repeatable
def test_covariance_stays_symmetric_and_definite_over_many_updates(seed, exponent):
    """From a vague prior, by readings up to a hundred million times as sharp: where P - K S K' would go negative."""
    rng = np.random.default_rng(seed)
    x, P = np.zeros((3, 3)), 1e4 * covariances(rng, 3, d=3)
    for _ in range(60):
        H, y = rng.normal(size=(3, 1, 3)), rng.normal(size=(3, 1))
        x, P = kalman(x, P, y, H, np.array([[10.0**exponent]]))
        np.testing.assert_array_equal(P, P.mT)
    assert np.linalg.eigvalsh(P).min() > 0
    assert np.isfinite(x).all()


@pytest.mark.parametrize("gate", [np.inf, 3.0])
@pytest.mark.parametrize(("d", "k"), [(2, 1), (3, 2), (7, 3)])
def test_compiled_updates_are_the_numpy_ones_and_a_row_depends_on_no_other(d, k, gate):
    x, P, y, H, R = problem(1, ROWS, d, k)
    y *= 2
    y[3], H[4, 0, 1], R[5, 0, 0] = np.nan, np.nan, np.nan
    update = ENGINES["batched"].update
    found = update(x, P, y, H, R, gate)
    alone = update(x[[7]], P[[7]], y[[7]], H[[7]], R[[7]], gate)
    for mine, theirs, single in zip(found, kalman(x, P, y, H, R, gate), alone, strict=True):
        assert_near(mine, theirs)
        np.testing.assert_array_equal(single[0], mine[7])


def test_a_team_is_moved_block_by_block_as_by_one_matrix():
    rng = np.random.default_rng(3)
    P, F, Q = covariances(rng, 6, d=12), rng.normal(size=(6, 4, 3, 3)), covariances(rng, 24, d=3).reshape(6, 4, 3, 3)
    found = move_blocks("batched", P, F, Q)
    F, Q = square(block_diagonal(F)), square(block_diagonal(Q))
    assert_near(found, F @ P @ F.mT + Q)
    np.testing.assert_array_equal(found, found.mT)


@pytest.mark.parametrize("lead", [(ROWS,), (5, 8)])
def test_compiled_wheels_are_the_numpy_ones(lead):
    rng = np.random.default_rng(4)
    x, u, dt = rng.uniform(-3, 3, (ROWS, 3)), rng.normal(size=(ROWS, 2)), rng.uniform(0, 2, ROWS)
    u[2], u[3, 0], u[4, 1], dt[5] = np.nan, np.nan, np.nan, 0.0
    x, u, dt = x.reshape(*lead, 3), u.reshape(*lead, 2), dt.reshape(lead)
    wheels, none = Unicycle(sigma_v=0.3, sigma_omega=0.2), np.zeros((*lead, 0))
    for mine, theirs in zip(move(wheels, x, Senses(u, dt, none, none, none, {})), wheels.move(x, u, dt), strict=True):
        assert mine.shape == theirs.shape
        assert_near(mine, theirs)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("sensor", [Range(), LogDistance(), Sighting(), Bearing()], ids=lambda s: type(s).__name__)
def test_compiled_innovations_are_the_numpy_ones(sensor, d):
    rng, k = np.random.default_rng(6), 2 if isinstance(sensor, Sighting) else 1
    x, q, z = rng.uniform(-3, 3, (ROWS, d)), rng.uniform(-3, 3, (ROWS, 2)), rng.uniform(-6, 6, (ROWS, k))
    z[0], z[1, 0], q[2], q[3] = np.nan, 0.1, x[2, :2], x[3, :2] + 0.05  # absent, too near, at the same place, nearly
    for place in (q, q[9]):
        for mine, theirs in zip(innovation(sensor, x, place, z), sensor.innovation(x, place, z), strict=True):
            assert_near(mine, theirs)
    team = innovation(sensor, x[:, None], q[None], np.broadcast_to(z[:, None], (ROWS, ROWS, k)))
    assert_near(team[0][4], sensor.innovation(x[4], q, z[4])[0])


@pytest.mark.parametrize("name", ["ekf-local", "ekf-split-ci[form=conservative]", "ekf-joint[gate=3.0]", "ekf-interim"])
def test_landmarks_in_one_loop_change_no_bit(name, monkeypatch):
    _, stream = cl.simulate("camera/n=3", trials=2, seed=1, ticks=15)
    together = trace(name, make(name), stream)
    monkeypatch.setattr(steps, "landmarks_alone", lambda *_: None)
    in_turn = trace(name, make(name), stream)
    for column in ("x", "P", "messages", "bytes"):
        assert (getattr(together, column) == getattr(in_turn, column)).all()


@pytest.mark.parametrize(("teammates", "numbers"), [(0, 2), (4, 2), (4, 1)])
@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("d", [2, 3])
def test_a_message_comes_out_as_it_went_in(d, parts, teammates, numbers):
    rng = np.random.default_rng(1)
    P = tuple(covariances(rng, 4, d=d) for _ in range(parts))
    sent = Message(rng.normal(size=(4, d)), P, rng.normal(size=(4, teammates, numbers)))
    packets = sent.pack()
    assert packets.shape == (4, d + parts * d * (d + 1) // 2 + numbers * teammates)
    got = Message.unpack(packets, d, parts)
    for a, b in zip((got.x, *got.P, got.sightings), (sent.x, *P, sent.sightings), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", FILTERS)
def test_a_direction_of_arrival_without_four_corners_is_refused(name):
    _, stream = cl.simulate("anchors/a=5", ticks=2)
    with pytest.raises(ValueError, match="needs four corner anchors"):
        assume(make(name), stream.world)
    for reading in ("rssi", "none"):
        assume(make(name, anchor_reading=reading), stream.world)
