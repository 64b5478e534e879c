"""Walls, obstacles and robots in the way of a signal; and every world simulates, runs and draws."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import cooploc as cl
from cooploc import scenarios
from cooploc.scenarios.worlds import radio
from cooploc.scenarios.worlds.radio import Paper, bodies_between, walls_between

SIMULATED = "robots-1-3/n=1 trajectory scalability/n=11 nlos/bias=0.5 packet-drop/drop=0.98 arena-28m/r=20 "
SIMULATED += "arena-60m/sd=5 asynchrony/samples=5 anchors/a=3 anchors/a=8 radio-range/r=3 hardware/n=3 "
SIMULATED += "body-blocking/n=10 camera/n=2 uwb/removed"


@pytest.mark.parametrize("label", SIMULATED.split())
def test_every_world_simulates_runs_and_draws(label):
    truth, stream = cl.simulate(label, trials=2, seed=1, ticks=12)
    assert ((truth.x[..., :2] >= truth.arena[0]) & (truth.x[..., :2] <= truth.arena[1])).all()
    options = "" if len(stream.world.anchors) in (0, 4) else "[anchor_reading=rssi]"
    team = ("ekf-joint", "ekf-ci") + ("arl", "mrsl-rssi", "mrsl-distance", "ctrn") * (not label.startswith("camera"))
    run = cl.run([name + options for name in team], stream)
    assert np.isfinite(cl.errors(truth, run)["rmse"]).all()
    ax = cl.plot.world(label, ticks=12)
    assert label.partition("/")[0] in ax.get_title(loc="left")
    plt.close("all")


# ---------------------------------------------------------------- lines of sight, against shapely

A, B = np.random.default_rng(0).uniform(0, 6, (2, 500, 2))
WALLS = np.random.default_rng(1).uniform(0, 6, (7, 2, 2))
coordinate = st.integers(-3, 3).map(float)  # a small grid, so that points touch and align
point = st.tuples(coordinate, coordinate)


def test_walls_are_counted_as_shapely_counts_them():
    sights = shapely.linestrings(np.stack([A, B], 1))
    expected = sum(shapely.intersects(sights, wall).astype(int) for wall in shapely.linestrings(WALLS))
    np.testing.assert_array_equal(walls_between(A, B, WALLS), expected)
    assert len(np.unique(expected)) > 3


@pytest.mark.slow
@given(point, point, point, point)
@settings(max_examples=400)
def test_touching_and_collinear_walls_too(a, b, p, q):
    assume(a != b and p != q)  # a LineString has a length
    expected = shapely.intersects(shapely.LineString([a, b]), shapely.LineString([p, q]))
    assert walls_between(np.array(a), np.array(b), np.array([[p, q]])) == expected


def test_bodies_are_those_within_their_radius_of_the_line_of_sight(rng):
    centres = rng.uniform(0, 6, (500, 4, 2))
    sights = shapely.linestrings(np.stack([A, B], 1))
    expected = shapely.distance(sights[:, None], shapely.points(centres)) <= 0.3
    np.testing.assert_array_equal(bodies_between(A, B, centres, 0.3), expected)
    assert 0.01 < expected.mean() < 0.5


# ---------------------------------------------------------------- what they cost


def test_robots_walk_the_same_paths_whatever_stands_in_the_way():
    plain, _ = cl.simulate("trajectory", trials=3, seed=2)
    for label in ("nlos", "hardware/n=3", "body-blocking/n=3", "radio-range/r=2", "asynchrony"):
        np.testing.assert_array_equal(cl.simulate(label, trials=3, seed=2)[0].x, plain.x)


def test_a_wall_costs_exactly_its_decibels():
    truth, clear = cl.simulate("trajectory", trials=4, seed=3)
    blocked = cl.simulate("trajectory", trials=4, seed=3, walls=((2, 1, 2, 3.5),))[1]
    lost = clear.senses.anchor_rssi - blocked.senses.anchor_rssi
    assert set(np.unique(lost.round(9))) == {0.0, 10.0}
    x, y = truth.x[..., 0], truth.x[..., 1]
    crosses = np.where(x > 2, 2 * y / np.maximum(x, 1e-9), np.nan)  # where the sight to (0, 0) meets x = 2
    np.testing.assert_array_equal(lost[..., 0] > 5, (crosses >= 1) & (crosses <= 3.5))


def test_pairs_lose_decibels_and_ranges_grow_by_what_stands_between_them_in_both_directions():
    _, clear = cl.simulate("trajectory", trials=3, seed=4)
    truth, blocked = cl.simulate("nlos", trials=3, seed=4)
    lost = np.nan_to_num(clear.air.rssi - blocked.air.rssi)
    model = scenarios.resolve("nlos").model
    counts = np.stack([model.scene(4, k, truth.x[k]).robot_blockers for k in range(3)])
    np.testing.assert_allclose(lost, np.where(np.eye(3, dtype=bool), 0, 10 * counts), atol=1e-9)
    np.testing.assert_array_equal(counts, counts.swapaxes(2, 3))
    assert 0.05 < (counts > 0).mean() < 0.6
    assert (counts >= 2).any()
    longer = cl.simulate("nlos/bias=0.5", trials=3, seed=4)[1].air.range - blocked.air.range
    off = ~np.eye(3, dtype=bool)
    np.testing.assert_allclose(longer[..., off], 0.5 * (counts > 0)[..., off], atol=1e-12)


def test_obstacles_wander_inside_the_arena_and_differ_by_trial():
    path = cl.simulate("trajectory", trials=1)[0].x[0]
    one, other = (Paper(obstacles=3).scene(1, trial, path).obstacles for trial in (0, 1))
    assert one.shape == (200, 3, 2)
    assert ((one >= 0) & (one <= 6)).all()
    assert 0.05 - 1e-9 <= np.linalg.norm(np.diff(one, axis=0), axis=-1).max() <= 0.15 + 1e-9
    assert (one != other).all()


def test_a_team_blocks_the_links_of_third_robots_but_not_its_own():
    """Three robots in a row: only the outer pair, and what lies behind a teammate, is blocked."""
    path, nothing = np.array([[[1.0, 1.0], [3.0, 1.0], [5.0, 1.0]]]), np.zeros((1, 0, 2))
    scene = radio.find_blockers(path, np.array([[0.0, 1.0]]), np.zeros((0, 2, 2)), nothing, 0.2, robots_block=True)
    np.testing.assert_array_equal(scene.robot_blockers[0], [[0, 0, 1], [0, 0, 0], [1, 0, 0]])
    np.testing.assert_array_equal(scene.anchor_blockers[0, :, 0], [0, 1, 2])
