"""The radio arena: what it claims of its noise, and that a trial is the same whatever is simulated with it."""

import numpy as np
import pytest
from oracles import about, corners, log_distance

import cooploc as cl
from cooploc.scenarios import seeds, simulate
from cooploc.scenarios.worlds import radio
from cooploc.scenarios.worlds.radio import Paper


@pytest.fixture(scope="module")
def paper():
    return simulate("trajectory", trials=60, seed=11)


def distances(a, b):
    return np.hypot(a[..., 0] - b[..., 0], a[..., 1] - b[..., 1])


def lag_one(noise):
    return (noise[:, 1:] * noise[:, :-1]).mean() / noise.var()


# ---------------------------------------------------------------- bits


@pytest.mark.parametrize("label", ["trajectory", "packet-drop/drop=0.5", "camera", "no-compass"])
def test_a_trial_has_the_same_bits_whatever_is_simulated_with_it(label):
    truth, stream = simulate(label, trials=6, seed=3, ticks=30)
    for which in ([0], [5, 1], range(2, 5)):
        part, some = simulate(label, trials=which, seed=3, ticks=30)
        assert some.hashes == tuple(stream.hashes[k] for k in which)
        np.testing.assert_array_equal(part.x, truth.x[list(which)])
        np.testing.assert_array_equal(some.trial, list(which))
        for name, array in some.arrays().items():
            np.testing.assert_array_equal(array, stream.arrays()[name][list(which)], err_msg=name)


def test_keys_and_generators_belong_to_trial_and_robot_or_purpose_alone():
    rows = seeds.rows(5, np.array([0, 1, 7]), 3)
    np.testing.assert_array_equal(rows.trial, [0, 0, 0, 1, 1, 1, 7, 7, 7])
    np.testing.assert_array_equal(rows.robot, [0, 1, 2] * 3)
    assert len(np.unique(rows.key, axis=0)) == 9
    np.testing.assert_array_equal(seeds.rows(5, np.array([7]), 5).key[:3], rows.key[6:])
    assert (seeds.rows(6, np.array([0]), 3).key != rows.key[:3]).any()
    drawn = [seeds.generator(5, trial, purpose).normal(size=1000) for trial in (0, 1) for purpose in seeds.Purpose]
    assert np.abs(np.corrcoef(drawn) - np.eye(len(drawn))).max() < 5 / np.sqrt(1000)


# ---------------------------------------------------------------- motion


def test_robots_are_everywhere_in_the_arena_and_step_and_turn_as_stated(paper):
    truth, stream = paper
    x = truth.x
    assert ((x >= 0) & (x <= 6)).all()
    np.testing.assert_array_equal(truth.arena, [[0, 0], [6, 6]])
    np.testing.assert_array_equal(stream.world.arena, truth.arena)
    shares = np.histogram2d(x[..., 0].ravel(), x[..., 1].ravel(), 3, [[0, 6], [0, 6]])[0] / x[..., 0].size
    assert (np.abs(shares - 1 / 9) < 0.06).all()
    move = np.diff(x, axis=1)
    step, inside = np.hypot(*np.moveaxis(move, -1, 0)), ((x[:, 1:] > 0.15) & (x[:, 1:] < 5.85)).all(-1)
    assert step.max() < 0.15 + 1e-12
    assert 0.05 - 1e-12 < step[inside].min() < 0.052
    assert step[inside].mean() == pytest.approx(0.1, abs=0.001)
    turn = np.diff(np.unwrap(np.arctan2(move[..., 1], move[..., 0]), axis=1), axis=1)
    about(turn[((x[:, 2:] > 0.4) & (x[:, 2:] < 5.6)).all(-1)], 0, 0.5)


def test_a_robot_that_does_not_turn_bounces_like_a_ball():
    """It crosses the whole arena between two bounces, instead of staying at a wall."""
    truth, _ = simulate("trajectory", trials=20, ticks=400, turn=0.0)
    move = np.diff(truth.x, axis=1)
    bounces = (np.sign(move[:, 1:]) != np.sign(move[:, :-1])).sum(1)
    assert (bounces <= np.abs(move).sum(1) / (6 - 0.3) + 2).all()
    assert bounces.max() > 4


def test_odometry_is_the_true_move_with_its_noise(paper):
    truth, stream = paper
    error = stream.senses.odometry[:, 1:] - np.diff(truth.x, axis=1)
    about(error, 0, 0.02)
    assert abs(lag_one(error)) < 5 / np.sqrt(error.size)


@pytest.mark.slow
def test_prior_is_the_true_start_with_its_noise():
    truth, stream = simulate("trajectory", trials=3000, ticks=1, odometry_sigma=0.0)
    about(stream.prior.x - (truth.x[:, 0] - stream.senses.odometry[:, 0]), 0, 0.5)
    np.testing.assert_array_equal(stream.prior.P, np.broadcast_to(0.25 * np.eye(2), (3000, 3, 2, 2)))


# ---------------------------------------------------------------- radio


def test_anchor_rssi_is_path_loss_with_independent_noise(paper):
    truth, stream = paper
    places = np.array(corners(6), float)
    np.testing.assert_array_equal(stream.world.anchors, places)
    noise = stream.senses.anchor_rssi - log_distance(distances(truth.x[..., None, :], places))
    about(noise, 0, np.sqrt(5))
    assert np.abs(np.corrcoef(noise.reshape(-1, 4).T) - np.eye(4)).max() < 5 / np.sqrt(noise.size / 4)
    assert abs(lag_one(noise)) < 5 / np.sqrt(noise.size)


def test_robot_rssi_shares_its_shadowing_and_not_its_fast_noise_and_ranges_have_their_noise(paper):
    truth, stream = paper
    d = distances(truth.x[..., None, :], truth.x[..., None, :, :])
    noise, (i, j) = stream.air.rssi - log_distance(d), np.triu_indices(3, 1)
    there, back = noise[..., i, j], noise[..., j, i]
    about(there, 0, np.sqrt(5))
    about(back, 0, np.sqrt(5))
    assert (there * back).mean() == pytest.approx(4, abs=4.5 * np.sqrt((25 + 16) / there.size))
    assert np.abs(np.corrcoef(there.reshape(-1, 3).T) - np.eye(3)).max() < 5 / np.sqrt(there.size / 3)
    about((stream.air.range - d)[..., ~np.eye(3, dtype=bool)], 0, 0.1)


@pytest.mark.parametrize("drop", [0.0, 0.7, 1.0])
def test_each_directed_link_loses_its_share_of_packets_by_itself(drop):
    _, stream = simulate(f"packet-drop/drop={drop}", trials=20, ticks=100)
    link = stream.air.link[..., ~np.eye(5, dtype=bool)]
    assert abs((1 - link.mean()) - drop) <= 4.5 * np.sqrt(drop * (1 - drop) / link.size)
    one, link = stream.air.link[..., 0, 1], stream.air.link
    others = [link[..., 1, 0], link[..., 2, 1], link[..., 0, 2], np.roll(one, 1, axis=1), np.roll(one, 1, axis=0)]
    for other in others:  # the way back, another receiver, another sender, the tick before, another trial
        assert (one != other).mean() == pytest.approx(2 * drop * (1 - drop), abs=0.05)


def test_dropping_changes_nothing_but_the_links():
    whole, some = (simulate(f"packet-drop/drop={drop}", trials=2, ticks=20)[1] for drop in (0, 0.7))
    for name, array in some.arrays().items():
        if name != "air.link":
            np.testing.assert_array_equal(array, whole.arrays()[name])
    assert not (some.air.link & ~whole.air.link).any()


def test_hardware_has_the_noise_of_the_real_logs():
    truth, stream = simulate("hardware/n=3", trials=30, seed=7)
    rssi, model = stream.senses.anchor_rssi, stream.world.sensors["anchor_rssi"]
    noise = rssi - np.stack([model.level(truth.x, q) for q in stream.world.anchors], -1)
    assert noise.std() == pytest.approx(4.4, abs=0.1)
    assert lag_one(noise) == pytest.approx(0.55, abs=0.03)
    np.testing.assert_array_equal(rssi, np.round(rssi))
    assert (model.sigma, model.eta) == (pytest.approx(4.4, abs=0.01), 1.4)


def test_shadowing_with_memory_is_stationary_and_reciprocal():
    truth, stream = simulate("trajectory", trials=60, seed=8, shadow_correlation=0.8, fast=0.0)
    noise = stream.air.rssi - log_distance(distances(truth.x[..., None, :], truth.x[..., None, :, :]))
    noise, back = noise[..., *np.triu_indices(3, 1)], noise.swapaxes(-1, -2)[..., *np.triu_indices(3, 1)]
    np.testing.assert_allclose(noise, back, atol=1e-9)
    for tick in (0, 1, 50, 199):  # standard error of a standard deviation of 180 values: 0.1
        assert noise[:, tick].std() == pytest.approx(2.0, abs=0.4)
    assert lag_one(noise) == pytest.approx(0.8, abs=0.03)


def test_averaging_a_window_thins_the_fast_noise_alone():
    for samples in (1, 4):
        truth, stream = simulate("trajectory", trials=20, seed=9, samples=samples, step=1e-6, shadowing=0.0)
        noise = stream.senses.anchor_rssi - log_distance(distances(truth.x[..., None, :], stream.world.anchors))
        assert noise.std() == pytest.approx(1 / np.sqrt(samples), rel=0.03)
        assert stream.world.sensors["anchor_rssi"].sigma == pytest.approx(1 / np.sqrt(samples))


def test_nothing_is_heard_beyond_the_radio_range():
    truth, stream = simulate("radio-range/r=3", trials=4, seed=10)
    to_anchor = distances(truth.x[..., None, :], stream.world.anchors)
    np.testing.assert_array_equal(np.isfinite(stream.senses.anchor_rssi), to_anchor <= 3)
    d = distances(truth.x[..., None, :], truth.x[..., None, :, :])
    np.testing.assert_array_equal(stream.air.link, (d <= 3) & ~np.eye(3, dtype=bool))
    assert not np.isfinite(stream.air.range[d > 3]).any()


@pytest.mark.parametrize("count", range(1, 9))
def test_anchors_stand_evenly_along_the_rim(count):
    places = Paper(anchors=count).places()
    assert places.shape == (count, 2)
    assert ((places == 0) | (places == 6)).any(-1).all()
    assert ((places >= 0) & (places <= 6)).all()
    np.testing.assert_array_equal(places[0], [0, 0])
    assert len(np.unique(places.round(9), axis=0)) == count


# ---------------------------------------------------------------- sleep


def test_robots_wake_at_their_rate_evenly_and_by_phase():
    woke = radio.wake_mask(400, np.array([1.0, 0.5, 0.5, 0.3]), np.array([0.0, 0.0, 0.5, 0.0]))
    np.testing.assert_allclose(woke.mean(0), [1, 0.5, 0.5, 0.3], atol=0.003)
    assert (woke[:, 1] ^ woke[:, 2]).all()  # half a phase apart: they take turns
    assert set(np.diff(np.flatnonzero(woke[:, 3]))) <= {3, 4}


def test_odometry_and_dt_cover_the_time_asleep():
    whole, sleepy = (simulate("trajectory", trials=2, seed=12, rate=rate)[1] for rate in ((1.0,), (0.25,)))
    woke = sleepy.senses.dt > 0
    np.testing.assert_array_equal(np.flatnonzero(woke[0, :, 0]), np.arange(3, 200, 4))
    assert set(np.unique(sleepy.senses.dt)) == {0.0, 4.0}
    total = whole.senses.odometry[:, :4].sum(1)  # the same noise, summed: variance in proportion to dt
    np.testing.assert_allclose(sleepy.senses.odometry[:, 3], total, atol=1e-12)
    assert np.isnan(sleepy.senses.odometry[~woke]).all()
    assert np.isnan(sleepy.senses.anchor_rssi[~woke]).all()


def test_sleepers_hear_nothing_send_nothing_and_are_not_judged():
    truth, stream = simulate("asynchrony", trials=2, seed=13, ticks=40)
    woke = stream.senses.dt > 0
    np.testing.assert_array_equal(truth.valid, woke)
    assert not stream.air.link[~woke].any()  # as receivers
    assert not stream.air.link.swapaxes(2, 3)[~woke].any()  # as senders
    trace = cl.run("mrsl-rssi[particles=20]", stream).traces["mrsl-rssi[particles=20]"]
    np.testing.assert_array_equal(trace.messages, woke.sum(1))
