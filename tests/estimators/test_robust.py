"""Losses: a far reading counts less, in every Kalman and particle filter, and without one nothing changes."""

from dataclasses import fields

import numpy as np
import pytest
from scipy.special import huber
from scipy.stats import chi2, norm, t

import cooploc as cl
from cooploc.estimators import models, particle_likelihood, robust
from cooploc.estimators.kalman import kalman, soften

LABELS = [
    name
    for name in cl.list_estimators()["name"]
    if name != "gbp" and any(f.name == "loss" for f in fields(cl.make(name)))
]
KALMAN = [name for name in LABELS if "ekf" in name or "ukf" in name]


def positions(stream, label, **parameters):
    """Estimates of one estimator, with raw readings where it has a choice."""
    names = {field.name for field in fields(cl.make(label))}
    raw = {"anchor_reading": "rssi"} if "anchor_reading" in names else {}
    trace = cl.run({label: cl.make(label, **raw, **parameters)}, stream, jobs=1).traces[label]
    return np.asarray(trace.x)


@pytest.fixture(scope="module")
def stream():
    return cl.simulate("robots-1-3/n=3", ticks=8, trials=2, seed=3)[1]


def test_thresholds_are_exceeded_as_often_by_one_number_as_by_two():
    one, two = (chi2.sf(robust.THRESHOLD[k] ** 2, k) for k in (1, 2))
    assert one == pytest.approx(two, rel=2e-3)
    c, inside = robust.THRESHOLD[1], norm.cdf(robust.THRESHOLD[1]) - norm.cdf(-robust.THRESHOLD[1])
    below = inside - 2 * c * norm.pdf(c)
    assert inside**2 / (below + c**2 * (1 - inside)) == pytest.approx(0.95, abs=1e-3)  # Huber 1964: the efficiency


def test_log_likelihoods_are_those_of_scipy_up_to_a_constant():
    y, v = np.array([0.0, 0.5, -2.0, 7.0, np.nan]), 0.8
    losses, S = ("student", "huber"), np.full((len(y), 1, 1), v)
    student, hubers = (particle_likelihood.log_density(y[:, None], S, loss) for loss in losses)
    expected = t.logpdf(y[:4], robust.DEGREES, scale=v**0.5)
    np.testing.assert_allclose(student[:4] - student[0], expected - expected[0], rtol=1e-12)
    np.testing.assert_allclose(hubers[:4] - hubers[0], -huber(robust.THRESHOLD[1], y[:4] / v**0.5), rtol=1e-12)
    assert student[4] == hubers[4] == 0


@pytest.mark.parametrize("loss", ["huber", "student"])
def test_a_reading_is_weighed_as_by_plain_numpy(loss):
    rng = np.random.default_rng(0)
    A = rng.normal(size=(3, 3))
    x, P, y, H, R = rng.normal(size=3), A @ A.T, 3 * rng.normal(size=2), rng.normal(size=(2, 3)), np.diag([0.3, 0.02])
    S = H @ P @ H.T + R
    d = np.sqrt(y @ np.linalg.inv(S) @ y)
    w = min(1.0, 1.855 / d) if loss == "huber" else min(1.0, (4 + 2) / (4 + d**2))
    K = P @ H.T @ np.linalg.inv(S / w)
    sensor = models.Sighting(0.3**0.5, 0.02**0.5, loss)
    softened = soften(sensor, P[None], y[None], H[None])
    x1, P1 = kalman(x[None], P[None], *softened, sensor.R)
    np.testing.assert_allclose(x1[0], x + K @ y, rtol=1e-9)
    np.testing.assert_allclose(P1[0], P - K @ (S / w) @ K.T, rtol=1e-9)
    assert w < 1


# `reciprocal-pf` draws particles by a sensor's error: at a hundred times that, some are far from every reading.
@pytest.mark.slow
@pytest.mark.parametrize("label", sorted({*LABELS} - {"reciprocal-pf"}))
def test_readings_that_agree_are_used_as_without_a_loss(stream, label):
    """At a hundred times the standard deviation every innovation is near: another path, the same numbers."""
    without, hubers = (positions(stream, label, inflation=100.0, loss=loss) for loss in ("none", "huber"))
    np.testing.assert_allclose(hubers, without, rtol=1e-6, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("label", LABELS)
def test_late_signals_move_an_estimate_less(stream, label):
    """In the last tick the readings of anchors, and of teammates, are of a place far away."""
    arrays = {"senses.anchor_rssi": stream.senses.anchor_rssi.copy(), "air.range": stream.air.range.copy()}
    arrays |= {"air.rssi": stream.air.rssi.copy()}
    for name, late in (("senses.anchor_rssi", -25.0), ("air.range", 30.0), ("air.rssi", -25.0)):
        arrays[name][:, -1] += late
    far = stream.replace_arrays(arrays)
    gate = {"gate": np.inf} if label in KALMAN else {}

    def moved(loss):
        return np.linalg.norm(positions(far, label, loss=loss, **gate) - positions(stream, label, loss=loss, **gate))

    none, hubers, student = map(moved, ("none", "huber", "student"))
    assert hubers < none
    assert student < none
