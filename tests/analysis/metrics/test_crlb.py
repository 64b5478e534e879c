"""The posterior Cramer-Rao floor: the Kalman covariance where all is linear, closed forms, where it does not hold."""

import numpy as np
import pytest
from oracles import dense_posterior, linear_team, slope

import cooploc as cl
from cooploc.analysis.metrics.crlb import DirectionAlone, covariances, floor, floors
from cooploc.estimators.models import gradient_doa

CHANNELS = ("anchor_rssi", "radio_range")


@pytest.mark.parametrize("relative", [True, False])
def test_in_a_linear_gaussian_world_it_is_the_covariance_of_the_exact_posterior(relative):
    """Trial by trial, and wherever the paths lie."""
    x, stream = linear_team(seed=3, trials=2, robots=3, ticks=5, relative=relative)
    drawn = x[:, None] + np.random.default_rng(1).normal(size=(2, 7, *x.shape[1:]))
    P = covariances(drawn, stream, ["landmark", "sighting"])
    for trial in range(2):
        for k in range(5):
            _, exact = dense_posterior(stream, trial, k, relative)
            np.testing.assert_allclose(P[k, trial], exact.reshape(6, 6), rtol=1e-9, atol=1e-12)


def test_without_readings_it_is_the_spread_of_dead_reckoning():
    _, stream = cl.simulate("trajectory", trials=2, seed=1, ticks=5)
    spread = np.sqrt(2 * (0.5**2 + 0.02**2 * np.arange(1, 6)))
    np.testing.assert_allclose(floor(stream, []), spread)


SHARP = {"prior_sigma": 1e-3, "odometry_sigma": 1e-3, "range_sigma": 1e-3, "shadowing": 0.0, "fast": 0.005}


CORNERS = np.array([[-1, -1, 1, 1], [-1, 1, 1, -1]]) / 12


@pytest.mark.parametrize(("robots", "channels"), [(3, CHANNELS), (1, ("anchor_gradient",))])
def test_with_one_trial_and_a_sharp_prior_it_is_the_bound_at_the_true_path(robots, channels):
    """J' = (J^-1 + Q)^-1 + H' R^-1 H at the truth, by finite differences; all that is drawn lies beside the truth."""
    truth, stream = cl.simulate(f"robots-1-3/n={robots}", trials=1, seed=1, ticks=8, **SHARP)
    P, want = 1e-6 * np.eye(2 * robots), []
    whiten = np.linalg.inv(np.linalg.cholesky(CORNERS @ CORNERS.T)) @ CORNERS

    def read(x):
        """What is read of the places (2n,), in standard deviations."""
        at = x.reshape(robots, 2)
        rssi = -30 * np.log10(np.linalg.norm(at[:, None] - stream.world.anchors, axis=-1)) / 0.005
        if robots == 1:
            return whiten @ rssi[0]
        return np.append(rssi, np.linalg.norm(at[:, None] - at, axis=-1)[~np.eye(3, dtype=bool)] / 1e-3)

    for k in range(8):
        H = slope(read, truth.x[0, k].ravel())
        P = np.linalg.inv(np.linalg.inv(P + 1e-6 * np.eye(2 * robots)) + H.T @ H)
        want.append(np.sqrt(np.trace(P) / robots))
    np.testing.assert_allclose(floor(stream, channels), want, rtol=0.003)
    assert want[-1] < 0.7 * floor(stream, [])[-1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "channels"),
    [
        ("ekf-local[anchor_reading=rssi]", CHANNELS),
        ("ekf-joint[anchor_reading=rssi]", CHANNELS),
        ("rssi-pf", CHANNELS),
        ("mrsl-distance[anchor_reading=rssi]", CHANNELS),
        ("map-joint", (*CHANNELS, "radio_rssi")),
        ("arl[anchor_reading=gradient]", ("anchor_gradient",)),
        ("arl[density=exact,M=1,K=1]", ("anchor_doa",)),
        ("map-joint[anchor_reading=none,reading=range]", ("radio_range",)),
    ],
)
def test_no_estimator_stays_below_it(name, channels):
    """Up to 4 standard errors of its mean squared error over trials."""
    truth, stream = cl.simulate("trajectory", trials=60, seed=1, ticks=60)
    trace = cl.run({name: cl.make(name)}, stream).traces[name]
    mse = ((trace.x - truth.x) ** 2).sum(-1).mean((1, 2))
    assert mse.mean() + 4 * mse.std(ddof=1) / np.sqrt(60) > (floor(stream, channels) ** 2).mean()


@pytest.mark.parametrize(
    ("label", "reason"),
    [
        ("nlos", "things stand in the way"),
        ("body-blocking", "things stand in the way"),
        ("hardware", "its shadowing has memory; its readings are rounded"),
        ("radio-range/r=4", "a packet that is not heard carries information"),
        ("asynchrony/samples=4", "its readings are averaged over a tick"),
        ("camera/n=2", "another world than the paper's"),
        ("trajectory", "anchor_rssi and anchor_doa are made of the same readings"),
    ],
)
def test_where_it_does_not_hold_it_says_why(label, reason):
    with pytest.raises(cl.BadInput, match=reason):
        floor(cl.simulate(label, trials=1, seed=1, ticks=2)[1], (*CHANNELS, "anchor_doa"))


@pytest.mark.slow
def test_floors_by_name_are_pooled_over_ticks_and_nan_where_none_holds():
    found = floors(["robots-1-3/n=2[ticks=30]", "nlos", "wifi/all", "scalability/n=5"], seed=1, most=3)
    _, stream = cl.simulate("robots-1-3/n=2[ticks=30]", trials=20, seed=1)
    pooled = np.sqrt((floor(stream, (*CHANNELS, "radio_rssi")) ** 2).mean())
    np.testing.assert_allclose(list(found.values()), [pooled, np.nan, np.nan, np.nan])


@pytest.mark.parametrize("place", [(3.05, 2.9), (2.2, 3.7), (0.8, 4.9), (5.6, 5.5)])
def test_the_angle_informs_as_its_density_says(place, rng):
    """Brute force: angles of simulated RSSI, and the spread of the score of their density by finite differences."""
    doa = gradient_doa(cl.simulate("trajectory", trials=1, ticks=1)[1].world)
    x, h = np.array(place), 1e-4
    rssi = doa.rssi.level(x, doa.anchors) + doa.rssi.sigma * rng.normal(size=(60_000, 4))
    angle = doa.measure(rssi)
    score = [doa.log_exact(x + h * e, angle) - doa.log_exact(x - h * e, angle) for e in np.eye(2)]
    score = np.stack(score, -1) / (2 * h)
    products = score[:, :, None] * score[:, None]
    _, H, _ = DirectionAlone(doa).innovation(x, x, np.zeros(2))
    error = products.std(0) / np.sqrt(len(score))
    assert (np.abs(products.mean(0) - H.T @ H) < 5 * error).all()


def test_no_bit_depends_on_how_many_ticks_are_computed_at_once(monkeypatch):
    _, stream = cl.simulate("packet-drop/drop=0.5", trials=2, seed=3, ticks=7)
    at_once = floor(stream, CHANNELS, samples=4)
    monkeypatch.setattr("cooploc.analysis.metrics.crlb.TOGETHER", 1)
    assert np.array_equal(floor(stream, CHANNELS, samples=4), at_once)
