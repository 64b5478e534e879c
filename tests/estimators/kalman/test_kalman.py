"""The Kalman update against the textbook and filterpy; packets, traffic, and the parameters that filters share."""

import pydoc
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles import covariances, is_covariance, repeatable

from cooploc.estimators import BUILTIN, make
from cooploc.estimators.kalman import ENGINES, Message, assume, count, distance, kalman, no_traffic
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.run import run

FILTERS = [name for name in BUILTIN if name.startswith(("ekf-", "ukf-"))]
SIZES = pytest.mark.parametrize(("d", "k"), [(2, 1), (2, 2), (3, 1), (3, 2), (6, 2)])


def problem(seed, lead, d, k):
    rng = np.random.default_rng(seed)
    x, y, H = rng.normal(size=(*lead, d)), rng.normal(size=(*lead, k)), rng.normal(size=(*lead, k, d))
    return x, covariances(rng, *lead, d=d), y, H, covariances(rng, *lead, d=k)


def information_form(x, P, y, H, R):
    """P'^-1 = P^-1 + H' R^-1 H: another formula than the gain's."""
    P1 = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H)
    return x + P1 @ H.T @ np.linalg.inv(R) @ y, P1


@SIZES
def test_update_is_the_textbooks(d, k):
    x, P, y, H, R = problem(1, (50,), d, k)
    x1, P1 = kalman(x, P, y, H, R)
    for i in range(50):
        want = information_form(x[i], P[i], y[i], H[i], R[i])
        np.testing.assert_allclose(x1[i], want[0], atol=1e-9)
        np.testing.assert_allclose(P1[i], want[1], atol=1e-9)


@SIZES
def test_update_equals_filterpys(d, k):
    arguments = problem(2, (20,), d, k)
    for gate in (np.inf, 2.0):
        ours, theirs = (ENGINES[name].update(*arguments, gate) for name in ("batched", "filterpy"))
        np.testing.assert_allclose(ours[0], theirs[0], atol=1e-9)
        np.testing.assert_allclose(ours[1], theirs[1], atol=1e-9)


@pytest.mark.parametrize("d", [2, 3, 6])
def test_prediction_equals_filterpys_and_the_textbooks(d):
    rng = np.random.default_rng(3)
    F = rng.normal(size=(20, d, d))
    P, Q = covariances(rng, 20, d=d), covariances(rng, 20, d=d)
    for name in ENGINES:
        P1 = ENGINES[name].predict(P, F, Q)
        np.testing.assert_allclose(P1, [f @ p @ f.T + q for f, p, q in zip(F, P, Q, strict=True)], atol=1e-9)
        assert is_covariance(P1)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("absent", ["y", "H", "R", "a part of y", "a part of H"])
def test_rows_with_anything_absent_come_back_bit_identical(absent, engine):
    x, P, y, H, R = problem(4, (6,), 3, 2)
    P = P + np.triu(np.full((3, 3), 1e-3), 1)  # not symmetric: even that must come back
    {"y": y, "H": H, "R": R, "a part of y": y[..., :1], "a part of H": H[..., 1:, 2:]}[absent][[1, 4]] = np.nan
    x1, P1 = ENGINES[engine].update(x, P, y, H, R, np.inf)
    for i in (1, 4):
        np.testing.assert_array_equal(x1[i], x[i])
        np.testing.assert_array_equal(P1[i], P[i])
    for i in (0, 2, 3, 5):
        assert (x1[i] != x[i]).any()
        assert np.isfinite(P1[i]).all()


@pytest.mark.parametrize("engine", ENGINES)
def test_gate_is_a_squared_mahalanobis_distance(engine):
    x, P, y, H, R = problem(6, (200,), 3, 2)
    y = 4 * y
    d2 = np.array([b @ np.linalg.inv(h @ p @ h.T + r) @ b for p, b, h, r in zip(P, y, H, R, strict=True)])
    gate = np.median(d2)
    x1, P1 = ENGINES[engine].update(x, P, y, H, R, gate)
    used = (x1 != x).any(-1)
    np.testing.assert_array_equal(used, d2 <= gate)
    np.testing.assert_array_equal(P1[~used], P[~used])
    np.testing.assert_allclose(distance(y, H @ P @ H.mT + R), d2, rtol=1e-9)


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


@pytest.mark.parametrize("teammates", [0, 4])
@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("d", [2, 3])
def test_a_message_comes_out_as_it_went_in(d, parts, teammates):
    rng = np.random.default_rng(1)
    sent = Message(
        rng.normal(size=(5, d)),
        tuple(covariances(rng, 5, d=d) for _ in range(parts)),
        rng.normal(size=(5, teammates, 2)),
    )
    packets = sent.pack()
    assert packets.shape == (5, d + parts * d * (d + 1) // 2 + 2 * teammates)
    got = Message.unpack(packets, d, parts)
    for a, b in zip((got.x, *got.P, got.sightings), (sent.x, *sent.P, sent.sightings), strict=True):
        np.testing.assert_array_equal(a, b)


def test_messages_are_counted_with_a_header_where_they_were_sent():
    sent = no_traffic(np.zeros((2, 3, 2)))
    count(sent, 1, np.array([True, False]), 5)
    count(sent, 1, np.array([True, True]), 0)
    np.testing.assert_array_equal(sent.messages, [[0, 2, 0], [0, 1, 0]])
    np.testing.assert_array_equal(sent.bytes, [[0, 8 + 40 + 8, 0], [0, 8, 0]])


@pytest.mark.parametrize("name", FILTERS)
def test_help_explains_every_parameter(name):
    shown = pydoc.render_doc(make(name), renderer=pydoc.plaintext)
    for field in fields(make(name)):
        assert f" {field.name}: " in shown.partition("Parameters:")[2].partition("Method resolution order")[0]


@pytest.mark.parametrize("name", FILTERS)
def test_a_direction_of_arrival_without_four_corners_is_refused(name):
    _, stream = simulate("anchors/a=5", ticks=2)
    with pytest.raises(ValueError, match="needs four corner anchors"):
        assume(make(name), stream.world)
    for reading in ("rssi", "none"):
        assume(make(name, anchor_reading=reading), stream.world)


@pytest.mark.parametrize("name", ["ekf-local", "ekf-joint", "ekf-ci", "ukf-joint", "map-joint"])
@pytest.mark.parametrize("scenario", ["robots-1-3/n=2", "camera/n=2"])
def test_without_anchors_and_teammates_every_filter_is_dead_reckoning(name, scenario):
    _, stream = simulate(scenario, trials=2, ticks=10, drop=1.0)
    alone = stream.replace_arrays({"senses.sighting": np.full_like(stream.senses.sighting, np.nan)})
    made = {"none": make(name, anchor_reading="none"), "dead": make("dead-reckoning")}
    traces = run(made, alone).traces
    np.testing.assert_allclose(traces["none"].x, traces["dead"].x, atol=1e-9 if name != "ukf-joint" else 1e-3)
    np.testing.assert_allclose(traces["none"].P, traces["dead"].P, atol=1e-9 if name != "ukf-joint" else 1e-3)
