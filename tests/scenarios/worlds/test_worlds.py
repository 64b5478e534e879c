"""The worlds of the paper, each by a statistic of its own, and the physics all of them keep."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import cooploc as cl
from cooploc import scenarios
from cooploc.scenarios.worlds import radio
from cooploc.scenarios.worlds.radio import Paper

SIMULATED = [
    *(
        "robots-1-3/n=1",
        "robots-1-3/n=2",
        "trajectory",
        "scalability/n=11",
        "nlos",
        "nlos/bias=0.5",
        "packet-drop/drop=0.98",
    ),
    "arena-28m/r=20",
    *("arena-60m/sd=0.5", "arena-60m/sd=5", "asynchrony", "asynchrony/samples=5", "anchors/a=3", "anchors/a=8"),
    *("radio-range/r=3", "hardware/n=3", "body-blocking/n=10", "camera/n=2", "uwb/removed"),
]


def residuals(stream, truth, sensor="anchor_rssi"):
    """Anchor readings minus what path loss alone would give (t, T, n, a)."""
    model = stream.world.sensors[sensor]
    return stream.senses.anchor_rssi - np.stack([model.level(truth.x, q) for q in stream.world.anchors], -1)


def pair_residuals(stream, truth):
    """Readings between robots minus path loss (t, T, receiver, sender)."""
    return stream.air.rssi - stream.world.sensors["radio_rssi"].level(truth.x[:, :, :, None], truth.x[:, :, None])


@pytest.mark.parametrize("label", SIMULATED)
def test_every_world_simulates_runs_and_draws(label):
    truth, stream = cl.simulate(label, trials=2, seed=1, ticks=12)
    assert ((truth.x[..., :2] >= truth.arena[0]) & (truth.x[..., :2] <= truth.arena[1])).all()
    corners = len(stream.world.anchors) in (0, 4)
    team = {name: cl.make(name if corners else f"{name}[anchor_reading=rssi]") for name in ("ekf-joint", "ekf-ci")}
    if not label.startswith("camera"):
        filters = ("arl", "mrsl-rssi", "mrsl-distance")
        team |= {name: cl.make(name if corners else f"{name}[anchor_reading=rssi]") for name in filters}
        ctrn = "ctrn[weights=exact]" if corners else "ctrn[weights=exact,anchor_reading=rssi]"
        team |= {fusion: cl.make(ctrn, fusion=fusion) for fusion in ("moments", "received")}
    run = cl.run(team, stream)
    assert np.isfinite(cl.errors(truth, run)["rmse"]).all()
    ax = cl.plot.world(label, ticks=12)
    assert label.partition("/")[0] in ax.get_title(loc="left")
    plt.close("all")


def test_robots_walk_the_same_paths_whatever_stands_in_the_way():
    plain, _ = cl.simulate("trajectory", trials=3, seed=2)
    for label in ("nlos", "hardware/n=3", "body-blocking/n=3", "radio-range/r=2", "asynchrony"):
        np.testing.assert_array_equal(cl.simulate(label, trials=3, seed=2)[0].x, plain.x)


# ------------------------------------------------------------------ what stands in the way


def test_a_wall_costs_exactly_its_decibels():
    open_, walled = (cl.simulate("trajectory", trials=4, seed=3, walls=w)[1] for w in ((), ((2, 1, 2, 3.5),)))
    lost = open_.senses.anchor_rssi - walled.senses.anchor_rssi
    assert set(np.unique(lost.round(9))) == {0.0, 10.0}
    truth, _ = cl.simulate("trajectory", trials=4, seed=3)
    x, y = truth.x[..., 0], truth.x[..., 1]
    crosses = x * 0 + np.where(
        x > 2, 2 * y / np.maximum(x, 1e-9), np.nan
    )  # height at which the sight to (0, 0) meets x = 2
    np.testing.assert_array_equal(lost[..., 0] > 5, (crosses >= 1) & (crosses <= 3.5))


def test_pairs_lose_as_many_decibels_as_things_stand_between_them_in_both_directions():
    _, open_ = cl.simulate("trajectory", trials=3, seed=4)
    truth, blocked = cl.simulate("nlos", trials=3, seed=4)
    lost = open_.air.rssi - blocked.air.rssi
    pairs = np.nan_to_num(lost)
    np.testing.assert_allclose(pairs, pairs.swapaxes(2, 3), atol=1e-9)
    made = scenarios.resolve("nlos").model
    counts = np.stack([made.scene(4, k, truth.x[k]).robot_blockers for k in range(3)])
    np.testing.assert_allclose(pairs, np.where(np.eye(3, dtype=bool), 0, 10 * counts), atol=1e-9)
    assert 0.05 < (counts > 0).mean() < 0.6
    assert (counts >= 2).any()


def test_obstacles_wander_inside_the_arena_and_differ_by_trial():
    made = Paper(obstacles=3)
    path = cl.simulate("trajectory", trials=1)[0].x[0]
    one, other = made.scene(1, 0, path).obstacles, made.scene(1, 1, path).obstacles
    assert one.shape == (200, 3, 2)
    assert ((one >= 0) & (one <= 6)).all()
    assert 0.05 - 1e-9 <= np.linalg.norm(np.diff(one, axis=0), axis=-1).max() <= 0.15 + 1e-9
    assert (one != other).all()


def test_ranges_are_biased_only_without_line_of_sight():
    _, plain = cl.simulate("nlos", trials=2, seed=5)
    truth, biased = cl.simulate("nlos/bias=0.5", trials=2, seed=5)
    counts = np.stack([scenarios.resolve("nlos").model.scene(5, k, truth.x[k]).robot_blockers for k in range(2)])
    off = ~np.eye(3, dtype=bool)
    np.testing.assert_allclose((biased.air.range - plain.air.range)[..., off], 0.5 * (counts > 0)[..., off], atol=1e-12)


def test_a_team_blocks_the_links_of_third_robots_but_not_its_own():
    """Three robots in a row: only the outer pair, and what lies behind a teammate, is blocked."""
    path = np.array([[[1.0, 1.0], [3.0, 1.0], [5.0, 1.0]]])
    scene = radio.find_blockers(
        path, np.array([[0.0, 1.0]]), np.zeros((0, 2, 2)), np.zeros((1, 0, 2)), 0.2, robots_block=True
    )
    np.testing.assert_array_equal(scene.robot_blockers[0], [[0, 0, 1], [0, 0, 0], [1, 0, 0]])
    np.testing.assert_array_equal(scene.anchor_blockers[0, :, 0], [0, 1, 2])


# ------------------------------------------------------------------ radio


def test_hardware_has_the_noise_of_the_real_logs():
    truth, stream = cl.simulate("hardware/n=3", trials=30, seed=7)
    noise = residuals(stream, truth)
    assert noise.std() == pytest.approx(4.4, abs=0.1)
    assert (noise[:, 1:] * noise[:, :-1]).mean() / noise.var() == pytest.approx(0.55, abs=0.03)
    np.testing.assert_array_equal(stream.senses.anchor_rssi, np.round(stream.senses.anchor_rssi))
    assert stream.world.sensors["anchor_rssi"].sigma == pytest.approx(4.4, abs=0.01)
    assert stream.world.sensors["anchor_rssi"].eta == 1.4


def test_shadowing_with_memory_is_stationary_and_reciprocal():
    truth, stream = cl.simulate("trajectory", trials=60, seed=8, shadow_correlation=0.8, fast=0.0)
    there, back = (pair_residuals(stream, truth)[:, :, i, j] for i, j in ((0, 1), (1, 0)))
    np.testing.assert_allclose(there, back, atol=1e-9)
    for tick in (0, 1, 50, 199):  # standard error of a standard deviation of 180 values: 0.1
        assert pair_residuals(stream, truth)[:, tick][:, *np.triu_indices(3, 1)].std() == pytest.approx(2.0, abs=0.4)
    assert (there[:, 1:] * there[:, :-1]).mean() / there.var() == pytest.approx(0.8, abs=0.03)


def test_averaging_a_window_thins_the_fast_noise_alone():
    for samples in (1, 4):
        truth, stream = cl.simulate("trajectory", trials=20, seed=9, samples=samples, step=1e-6, shadowing=0.0)
        assert residuals(stream, truth).std() == pytest.approx(1 / np.sqrt(samples), rel=0.03)
        assert stream.world.sensors["anchor_rssi"].sigma == pytest.approx(1 / np.sqrt(samples))


def test_nothing_is_heard_beyond_the_radio_range():
    truth, stream = cl.simulate("radio-range/r=3", trials=4, seed=10)
    to_anchor = np.linalg.norm(truth.x[:, :, :, None] - stream.world.anchors, axis=-1)
    np.testing.assert_array_equal(np.isfinite(stream.senses.anchor_rssi), to_anchor <= 3)
    d = np.linalg.norm(truth.x[:, :, :, None] - truth.x[:, :, None], axis=-1)
    np.testing.assert_array_equal(stream.air.link, (d <= 3) & ~np.eye(3, dtype=bool))
    assert not np.isfinite(stream.air.range[d > 3]).any()


# ------------------------------------------------------------------ anchors


@pytest.mark.parametrize("count", range(1, 9))
def test_anchors_stand_evenly_along_the_rim(count):
    places = Paper(anchors=count).places()
    assert places.shape == (count, 2)
    assert (((places == 0) | (places == 6)).any(-1)).all()
    assert ((places >= 0) & (places <= 6)).all()
    np.testing.assert_array_equal(places[0], [0, 0])
    assert len(np.unique(places.round(9), axis=0)) == count


def test_a_direction_of_arrival_without_four_corners_is_refused_before_anything_runs():
    _, stream = cl.simulate("anchors/a=5", ticks=2)
    for name in ("arl", "mrsl-rssi", "ekf-local", "ekf-joint"):
        with pytest.raises(cl.IncompatibleEstimator, match=r"needs four corner anchors.*use anchor_reading='rssi'"):
            cl.run({name: cl.make(name)}, stream)


# ------------------------------------------------------------------ sleep


def test_robots_wake_at_their_rate_evenly_and_by_phase():
    woke = radio.wake_mask(400, np.array([1.0, 0.5, 0.5, 0.3]), np.array([0.0, 0.0, 0.5, 0.0]))
    np.testing.assert_allclose(woke.mean(0), [1, 0.5, 0.5, 0.3], atol=0.003)
    assert (woke[:, 1] ^ woke[:, 2]).all()  # half a phase apart: they take turns
    gaps = np.diff(np.flatnonzero(woke[:, 3]))
    assert set(gaps) <= {3, 4}


def test_odometry_and_dt_cover_the_time_asleep():
    whole, sleepy = (cl.simulate("trajectory", trials=2, seed=12, rate=rate)[1] for rate in ((1.0,), (0.25,)))
    woke = sleepy.senses.dt > 0
    np.testing.assert_array_equal(np.flatnonzero(woke[0, :, 0]), np.arange(3, 200, 4))
    assert set(np.unique(sleepy.senses.dt)) == {0.0, 4.0}
    total = whole.senses.odometry[:, :4].sum(1)  # the same noise, summed: variance in proportion to dt
    np.testing.assert_allclose(sleepy.senses.odometry[:, 3], total, atol=1e-12)
    assert np.isnan(sleepy.senses.odometry[~woke]).all()
    assert np.isnan(sleepy.senses.anchor_rssi[~woke]).all()


def test_sleepers_hear_nothing_send_nothing_and_are_not_judged():
    truth, stream = cl.simulate("asynchrony", trials=2, seed=13, ticks=40)
    woke = stream.senses.dt > 0
    np.testing.assert_array_equal(truth.valid, woke)
    assert not stream.air.link[~woke].any()  # as receivers
    assert not stream.air.link.swapaxes(2, 3)[~woke].any()  # as senders
    trace = cl.run({"m": cl.make("mrsl-rssi", particles=20)}, stream).traces["m"]
    np.testing.assert_array_equal(trace.messages, woke.sum(1))
    asleep_twice = ~woke[:, 1:] & ~woke[:, :-1]
    still = (trace.x[:, 1:] == trace.x[:, :-1]).all(-1)
    assert still[asleep_twice].mean() > 0.99


# ------------------------------------------------------------------ what the team is told


@pytest.mark.parametrize("wrong", [{"robots": 4}, {"tick": 2.0}, {"side": 7.0}, {"anchors": 5}])
def test_what_readings_show_cannot_be_assumed_away(wrong):
    with pytest.raises(cl.BadInput, match="make it an override"):
        cl.simulate("trajectory", ticks=2, assumed=wrong)
