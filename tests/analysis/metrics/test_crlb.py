"""The posterior Cramer-Rao floor: the Kalman covariance where all is linear, closed forms, where it does not hold."""

import numpy as np
import pytest
from oracles import dense_posterior, linear_team

import cooploc as cl
from cooploc.analysis.metrics.crlb import covariances, floor, floors, why_not

CHANNELS = ("anchor_rssi", "radio_range")


@pytest.mark.parametrize("relative", [True, False])
def test_in_a_linear_gaussian_world_it_is_the_covariance_of_the_exact_posterior(relative):
    x, stream = linear_team(seed=3, trials=1, robots=3, ticks=5, relative=relative)
    P = covariances(x, stream, ["landmark", "sighting"])
    for k in range(5):
        _, exact = dense_posterior(stream, 0, k, relative)
        np.testing.assert_allclose(P[k], exact.reshape(6, 6), rtol=1e-9, atol=1e-12)


def test_without_readings_it_is_the_spread_of_dead_reckoning():
    truth, stream = cl.simulate("trajectory", trials=2, seed=1, ticks=5)
    spread = np.sqrt(2 * (0.5**2 + 0.02**2 * np.arange(1, 6)))
    np.testing.assert_allclose(floor(truth, stream, []), spread)


def test_anchors_inform_as_the_slope_of_the_path_loss_says():
    """(10 eta / (sigma ln 10))^2 u u' / d^2 of every anchor, by hand."""
    truth, stream = cl.simulate("robots-1-3/n=1", trials=1, seed=1, ticks=1)
    away = truth.x[0, 0, 0] - stream.world.anchors
    d2 = (away**2).sum(1)
    gain = (10 * 3 / np.log(10)) ** 2 / 5 / d2**2
    J = np.eye(2) / (0.5**2 + 0.02**2) + np.einsum("a,ai,aj->ij", gain, away, away)
    np.testing.assert_allclose(floor(truth, stream, ["anchor_rssi"]), np.sqrt(np.trace(np.linalg.inv(J))))


def test_more_channels_and_fewer_drops_lower_it():
    def mean(label, channels):
        return floor(*cl.simulate(label, trials=4, seed=1, ticks=30), channels).mean()

    alone, team = (mean("packet-drop/drop=0", c) for c in (["anchor_rssi"], CHANNELS))
    assert team < mean("packet-drop/drop=0.7", CHANNELS) < alone
    assert mean("packet-drop/drop=1", CHANNELS) == pytest.approx(alone)


@pytest.mark.parametrize(
    "name",
    [
        "ekf-local[anchor_reading=rssi]",
        "ekf-joint[anchor_reading=rssi]",
        "rssi-pf",
        "mrsl-distance[anchor_reading=rssi]",
    ],
)
def test_no_estimator_stays_below_it(name):
    """Up to 4 standard errors of its mean squared error over trials."""
    truth, stream = cl.simulate("trajectory", trials=60, seed=1, ticks=60)
    trace = cl.run({name: cl.make(name)}, stream).traces[name]
    mse = ((trace.x - truth.x) ** 2).sum(-1).mean((1, 2))
    least = (floor(truth, stream, CHANNELS) ** 2).mean()
    assert mse.mean() + 4 * mse.std(ddof=1) / np.sqrt(60) > least


@pytest.mark.parametrize(
    ("label", "reason"),
    [
        ("nlos", "things stand in the way"),
        ("body-blocking", "things stand in the way"),
        ("hardware", "its shadowing has memory; its readings are rounded"),
        ("radio-range/r=4", "a packet that is not heard carries information"),
        ("asynchrony/samples=4", "its readings are averaged over a tick"),
        ("camera/n=2", "another world than the paper's"),
    ],
)
def test_where_it_does_not_hold_it_says_why(label, reason):
    truth, stream = cl.simulate(label, trials=1, seed=1, ticks=3)
    with pytest.raises(cl.BadInput, match=reason):
        floor(truth, stream, CHANNELS)


def test_a_team_that_is_told_another_world_has_no_floor():
    truth, stream = cl.simulate("trajectory", trials=1, seed=1, ticks=3, assumed={"eta": 2.0})
    with pytest.raises(cl.BadInput, match="assumes another world"):
        floor(truth, stream, CHANNELS)


def test_sleep_and_drops_do_have_a_floor():
    for label in ("asynchrony", "packet-drop/drop=0.7", "arena-60m", "anchors/a=3"):
        assert why_not(cl.simulate(label, trials=1, seed=1, ticks=3)[1]) == ""
        assert np.isfinite(floor(*cl.simulate(label, trials=2, seed=1, ticks=9), CHANNELS)).all()


def test_truth_of_another_stream_is_refused():
    truth, _ = cl.simulate("trajectory", trials=1, seed=2, ticks=3)
    with pytest.raises(cl.BadInput, match="different trials"):
        floor(truth, cl.simulate("trajectory", trials=1, seed=1, ticks=3)[1], CHANNELS)


def test_floors_by_name_are_pooled_over_ticks_and_nan_where_none_holds():
    found = floors(["robots-1-3/n=2[ticks=30]", "nlos", "wifi/all", "scalability/n=5"], seed=1, most=3)
    truth, stream = cl.simulate("robots-1-3/n=2[ticks=30]", trials=20, seed=1)
    pooled = np.sqrt((floor(truth, stream, (*CHANNELS, "radio_rssi")) ** 2).mean())
    np.testing.assert_allclose(list(found.values()), [pooled, np.nan, np.nan, np.nan])
