"""The simulated worlds: what they claim of their noise, and that a trial is the same whatever is simulated with it."""

import numpy as np
import pytest
from oracles import corners, log_distance

from cooploc.scenarios import seeds, simulate
from cooploc.scenarios.worlds import radio

MANY = 60  # trials of 200 ticks


@pytest.fixture(scope="module")
def paper():
    return simulate("trajectory", trials=MANY, seed=11)


@pytest.fixture(scope="module")
def camera():
    return simulate("camera", trials=20, seed=12)


def about(values, mean, sd, sds=4.5):
    """The sample's mean and sd lie within so many standard errors of what they should be."""
    values = np.ravel(values)
    n = len(values)
    assert abs(values.mean() - mean) < sds * sd / np.sqrt(n)
    assert abs(values.std() - sd) < sds * sd / np.sqrt(2 * n)


def distances(a, b):
    return np.hypot(a[..., 0] - b[..., 0], a[..., 1] - b[..., 1])


def equal_bits(one, other):
    for name, array in one.arrays().items():
        np.testing.assert_array_equal(array, other.arrays()[name], err_msg=name)


# ---------------------------------------------------------------- the paper's world


@pytest.mark.parametrize("label", ["trajectory[robots=5]", "trajectory[shadow_correlation=0.5]", "uwb"])
def test_readings_drawn_a_few_ticks_at_a_time_are_the_same(label, monkeypatch):
    """A large team is drawn in blocks of ticks, which must not show."""
    _, whole = simulate(label, trials=1, seed=3, ticks=23, drop=0.3)
    monkeypatch.setattr(radio, "PAIRS", 60)
    _, parts = simulate(label, trials=1, seed=3, ticks=23, drop=0.3)
    equal_bits(whole, parts)


def test_robots_stay_in_the_arena_and_everywhere_in_it(paper):
    truth, stream = paper
    x = truth.x
    assert ((x >= 0) & (x <= 6)).all()
    np.testing.assert_array_equal(truth.arena, [[0, 0], [6, 6]])
    np.testing.assert_array_equal(stream.world.arena, truth.arena)
    shares = np.histogram2d(x[..., 0].ravel(), x[..., 1].ravel(), 3, [[0, 6], [0, 6]])[0] / x[..., 0].size
    assert (np.abs(shares - 1 / 9) < 0.06).all()


def test_steps_have_their_length_except_at_the_walls(paper):
    truth, _ = paper
    step = distances(truth.x[:, 1:], truth.x[:, :-1])
    inside = ((truth.x[:, 1:] > 0.15) & (truth.x[:, 1:] < 5.85)).all(-1)
    assert ((step[inside] > 0.05 - 1e-12) & (step[inside] < 0.15 + 1e-12)).all()
    assert step[inside].min() < 0.052
    assert step[inside].max() > 0.148
    assert step[inside].mean() == pytest.approx(0.1, abs=0.001)
    assert step.max() < 0.15 + 1e-12
    assert 0.7 < inside.mean() < 0.95


def test_directions_turn_by_half_a_radian(paper):
    truth, _ = paper
    move = np.diff(truth.x, axis=1)
    turn = np.diff(np.unwrap(np.arctan2(move[..., 1], move[..., 0]), axis=1), axis=1)
    inside = ((truth.x[:, 2:] > 0.4) & (truth.x[:, 2:] < 5.6)).all(-1)
    about(turn[inside], 0, 0.5)


def test_a_robot_that_does_not_turn_bounces_like_a_ball():
    """It crosses the whole arena between two bounces, instead of staying at a wall."""
    truth, _ = simulate("trajectory", trials=20, ticks=400, turn=0.0)
    move = np.diff(truth.x, axis=1)
    bounces = (np.sign(move[:, 1:]) != np.sign(move[:, :-1])).sum(1)
    crossings = np.abs(move).sum(1) / (6 - 0.3)
    assert (bounces <= crossings + 2).all()
    assert bounces.max() > 4


def test_odometry_is_the_true_move_with_its_noise(paper):
    truth, stream = paper
    error = stream.senses.odometry[:, 1:] - np.diff(truth.x, axis=1)
    about(error, 0, 0.02)
    assert abs(np.corrcoef(error[:, 1:].ravel(), error[:, :-1].ravel())[0, 1]) < 5 / np.sqrt(error.size)


def test_prior_is_the_true_start_with_its_noise():
    truth, stream = simulate("trajectory", trials=3000, ticks=1, odometry_sigma=0.0)
    about(stream.prior.x - (truth.x[:, 0] - stream.senses.odometry[:, 0]), 0, 0.5)
    np.testing.assert_array_equal(stream.prior.P, np.broadcast_to(0.25 * np.eye(2), (3000, 3, 2, 2)))


def test_anchor_rssi_is_path_loss_with_independent_noise(paper):
    truth, stream = paper
    np.testing.assert_array_equal(stream.world.anchors, corners(6))
    places = np.array(corners(6), float)
    noise = stream.senses.anchor_rssi - log_distance(distances(truth.x[..., None, :], places))
    about(noise, 0, np.sqrt(5))
    C = np.corrcoef(noise.reshape(-1, 4).T)
    assert np.abs(C - np.eye(4)).max() < 5 / np.sqrt(noise.size / 4)
    lag = np.corrcoef(noise[:, 1:].ravel(), noise[:, :-1].ravel())[0, 1]
    assert abs(lag) < 5 / np.sqrt(noise.size)


def test_robot_rssi_shares_its_shadowing_and_not_its_fast_noise(paper):
    truth, stream = paper
    x = truth.x
    noise = stream.air.rssi - log_distance(distances(x[..., None, :], x[..., None, :, :]))
    pairs = [(0, 1), (0, 2), (1, 2)]
    there = np.stack([noise[..., i, j] for i, j in pairs])
    back = np.stack([noise[..., j, i] for i, j in pairs])
    about(there, 0, np.sqrt(5))
    about(back, 0, np.sqrt(5))
    n = there.size
    assert (there * back).mean() == pytest.approx(4, abs=4.5 * np.sqrt((25 + 16) / n))
    assert abs(np.corrcoef(there.reshape(3, -1))[0, 1]) < 5 / np.sqrt(n / 3)


def test_range_is_the_distance_with_its_noise(paper):
    truth, stream = paper
    x = truth.x
    noise = stream.air.range - distances(x[..., None, :], x[..., None, :, :])
    about(noise[..., ~np.eye(3, dtype=bool)], 0, 0.1)


@pytest.mark.parametrize("drop", [0.0, 0.3, 0.7, 1.0])
def test_dropped_share_is_that_of_each_directed_link(drop):
    _, stream = simulate(f"packet-drop/drop={drop}", trials=20, ticks=100)
    link = stream.air.link[..., ~np.eye(5, dtype=bool)]
    n = link.size
    assert abs((1 - link.mean()) - drop) <= 4.5 * np.sqrt(drop * (1 - drop) / n)
    one = stream.air.link[..., 0, 1]
    others = {
        "the way back": stream.air.link[..., 1, 0],
        "another receiver": stream.air.link[..., 2, 1],
        "another sender": stream.air.link[..., 0, 2],
        "the tick before": np.roll(one, 1, axis=1),
        "another trial": np.roll(one, 1, axis=0),
    }
    for what, other in others.items():
        assert (one != other).mean() == pytest.approx(2 * drop * (1 - drop), abs=0.05), what


def test_dropping_changes_nothing_but_the_links():
    _, all_there = simulate("packet-drop/drop=0", trials=2, ticks=20)
    _, some = simulate("packet-drop/drop=0.7", trials=2, ticks=20)
    for name, array in some.arrays().items():
        if name != "air.link":
            np.testing.assert_array_equal(array, all_there.arrays()[name])
    assert not (some.air.link & ~all_there.air.link).any()


def test_sleepers_odometry_noise_grows_with_the_time_it_covers():
    truth, stream = simulate("asynchrony", trials=300, ticks=40, prior_sigma=0.0)
    for robot, every in ((0, 1), (1, 2), (2, 4)):
        at = np.flatnonzero(truth.valid[0, :, robot])
        error = stream.senses.odometry[:, at[1:], robot] - np.diff(truth.x[:, at, robot], axis=1)
        about(error, 0, 0.02 * np.sqrt(every))


# ---------------------------------------------------------------- bits


@pytest.mark.parametrize("label", ["trajectory", "packet-drop/drop=0.5", "camera"])
def test_a_trial_is_the_same_whatever_is_simulated_with_it(label):
    truth, stream = simulate(label, trials=6, seed=3, ticks=30)
    for which in ([0], [3], [5, 1], range(2, 5)):
        part, some = simulate(label, trials=which, seed=3, ticks=30)
        assert some.hashes == tuple(stream.hashes[k] for k in which)
        np.testing.assert_array_equal(part.x, truth.x[list(which)])
        np.testing.assert_array_equal(some.trial, list(which))
        for name, array in some.arrays().items():
            np.testing.assert_array_equal(array, stream.arrays()[name][list(which)], err_msg=name)


def test_keys_belong_to_trial_and_robot_alone():
    rows = seeds.rows(5, np.array([0, 1, 7]), 3)
    np.testing.assert_array_equal(rows.trial, [0, 0, 0, 1, 1, 1, 7, 7, 7])
    np.testing.assert_array_equal(rows.robot, [0, 1, 2] * 3)
    assert len(np.unique(rows.key, axis=0)) == 9
    np.testing.assert_array_equal(seeds.rows(5, np.array([7]), 5).key[:3], rows.key[6:])
    assert (seeds.rows(6, np.array([0]), 3).key != rows.key[:3]).any()


# ---------------------------------------------------------------- what is told, and what is asked for


@pytest.mark.parametrize(
    ("label", "given", "says"),
    [
        ("trajectry", {}, "'trajectry'.*'trajectory'"),
        ("trajectory", {"robotz": 3}, "'robotz'.*'robots'"),
        ("trajectory", {"assumed": {"shadowin": 3}}, "'shadowin'.*'shadowing'"),
        ("trajectory[tics=3]", {}, "'tics'.*'ticks'"),
        ("packet-drop/loss=0.7", {}, "'loss=0.7'.*drop="),
        ("trajectory/n=3", {}, "'n=3'"),
        ("trajectory[", {}, "trajectory"),
        ("trajectory", {"trials": 0}, "trials is 0"),
        ("trajectory", {"trials": []}, "at least 1"),
        ("trajectory", {"trials": 2.5}, "whole number"),
        ("trajectory", {"trials": [0, -1]}, "trials"),
        ("trajectory", {"trials": [3, 3]}, "name each trial once"),
        ("trajectory", {"seed": -1}, "seed is -1"),
        ("trajectory", {"seed": 1.5}, "seed is 1.5; it must be a whole number"),
        ("packet-drop/drop=2", {}, "drop"),
        ("packet-drop/drop=often", {}, "drop"),
        ("trajectory", {"robots": 0}, "robots"),
        ("trajectory", {"side": -6.0}, "side"),
        ("trajectory", {"side": np.inf}, "side"),
        ("trajectory", {"shadowing": np.nan}, "shadowing"),
        ("trajectory", {"step": 30.0}, "make step at most side / 1.5"),
        ("mrclam/all", {}, "data"),
    ],
)
def test_bad_input_is_refused_in_one_line_that_helps(label, given, says):
    with pytest.raises(ValueError, match=says) as caught:
        simulate(label, **given)
    assert "\n" not in str(caught.value)


# ---------------------------------------------------------------- the camera world


def test_camera_readings_are_the_true_geometry_with_their_noise(camera):
    truth, stream = camera
    x = truth.x
    places = {
        "landmark": np.broadcast_to(stream.world.landmarks, (*x.shape[:2], 6, 2)),
        "sighting": x[..., :2],
    }
    for channel, q in places.items():
        z = getattr(stream.senses, channel)
        delta = q[:, :, None] - x[:, :, :, None, :2]
        d = np.hypot(delta[..., 0], delta[..., 1])
        bearing = np.angle(np.exp(1j * (np.arctan2(delta[..., 1], delta[..., 0]) - x[..., None, 2])))
        visible = (d < 4.0) & (np.abs(bearing) < 0.6)
        if channel == "sighting":
            visible &= ~np.eye(3, dtype=bool)
        np.testing.assert_array_equal(np.isfinite(z).all(-1), visible)
        np.testing.assert_array_equal(np.isnan(z).any(-1), ~visible)
        assert visible.sum() > 1000
        about((z[..., 0] - d)[visible], 0, 0.15)
        about(np.angle(np.exp(1j * (z[..., 1] - bearing)))[visible], 0, 0.02)


def test_camera_robots_stay_inside_and_turn_at_the_walls(camera):
    truth, _ = camera
    x = truth.x
    assert ((x[..., :2] >= 0) & (x[..., :2] <= 8)).all()
    assert (np.abs(x[..., 2]) <= np.pi).all()
    step = distances(x[:, 1:], x[:, :-1])
    still = step < 1e-12
    np.testing.assert_allclose(step[~still], 0.05, atol=1e-9)
    assert 0 < still.mean() < 0.3


def test_camera_odometry_is_the_true_drive_with_its_noise(camera):
    truth, stream = camera
    x, u = truth.x, stream.senses.odometry[:, 1:]
    turned = np.angle(np.exp(1j * np.diff(x[..., 2], axis=1)))
    about(u[..., 0] - distances(x[:, 1:], x[:, :-1]) / 0.1, 0, 0.04)
    about(u[..., 1] - turned / 0.1, 0, 0.15)
    np.testing.assert_array_equal(stream.senses.dt, 0.1)


def test_camera_prior_and_told_models():
    truth, stream = simulate("camera", trials=400, ticks=1, sigma_v=1e-9, sigma_omega=1e-9)
    u = stream.senses.odometry[:, 0]
    heading = truth.x[:, 0, :, 2] - 0.1 * u[..., 1]
    middle = heading + 0.05 * u[..., 1]
    start = truth.x[:, 0, :, :2] - 0.1 * u[..., :1] * np.stack([np.cos(middle), np.sin(middle)], -1)
    about(stream.prior.x[..., :2] - start, 0, 0.1)
    about(np.angle(np.exp(1j * (stream.prior.x[..., 2] - heading))), 0, 0.05)
    np.testing.assert_allclose(stream.prior.P[0, 0], np.diag([0.01, 0.01, 0.0025]))
    assert set(stream.world.sensors) == {"landmark", "sighting"}
    assert stream.channels() == {"odometry", "landmark", "sighting"}
    assert (np.abs(stream.prior.x[..., 2]) <= np.pi).all()


def test_a_camera_that_sees_all_around_reads_wrapped_bearings():
    truth, stream = simulate("camera", trials=5, view=4.0, sight=20.0, sigma_bearing=0.3)
    z, x = stream.senses.landmark, truth.x
    assert np.isfinite(z).all()
    assert (np.abs(z[..., 1]) <= np.pi).all()
    delta = stream.world.landmarks - x[..., None, :2]
    bearing = np.arctan2(delta[..., 1], delta[..., 0]) - x[..., None, 2]
    about(np.angle(np.exp(1j * (z[..., 1] - bearing))), 0, 0.3)
