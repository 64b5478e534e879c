"""The worked examples pass every check, and the plain filterpy loop is the oracle of the others."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

import cooploc as cl
from cooploc.estimators import make
from cooploc.estimators.interface import Belief, Senses
from cooploc.estimators.models import LogDistance
from cooploc.scenarios import simulate
from cooploc.scenarios.conformance import CHECKS, check_estimator
from cooploc.scenarios.runner.trace import trace
from cooploc.scenarios.variations import drop_readings

FOLDER = Path(__file__).resolve().parents[2] / "examples"
COMPILED = pytest.param("numba_kernel.py:Compiled", marks=pytest.mark.slow)
NAMES = ("filterpy_loop.py:loop", "batched_numpy.py:Batched", COMPILED, "jax_traced.py:Traced")
WIDE = ("constant_velocity.py:ConstantVelocity", "range_bias.py:RangeBias")
BASELINES = (
    "multilateration.py:Multilateration",
    "weighted_centroid.py:WeightedCentroid",
    "differential_rss.py:DifferentialRss",
    "markov_grid.py:MarkovGrid",
)


def example(name):
    """The plug-in; where its library is not installed, the test is skipped with that reason."""
    try:
        return make(f"{FOLDER}/{name}")
    except cl.BadInput as e:
        if "ModuleNotFoundError" in str(e):
            pytest.skip(str(e))
        raise


@pytest.mark.parametrize("name", [*NAMES, *WIDE, *BASELINES, "learned_range.py:LearnedRange"])
@pytest.mark.slow
def test_an_example_passes_every_check(name, short_streams):
    report = check_estimator(example(name), name, isolate=False)
    assert report.passed, report.table()
    assert name not in NAMES or report.ran == len(CHECKS)


@pytest.mark.slow
@pytest.mark.parametrize("label", ["robots-1-3/n=3", "packet-drop/drop=0.5", "asynchrony"])
@pytest.mark.parametrize("name", NAMES[1:])
def test_the_others_compute_what_the_loop_computes(name, label):
    _, stream = simulate(label, trials=2, seed=4, ticks=40)
    for one in (stream, drop_readings(stream, np.random.default_rng(2))):
        loop, other = trace("loop", example(NAMES[0]), one), trace("other", example(name), one)
        np.testing.assert_allclose(other.x, loop.x, atol=1e-9)
        np.testing.assert_allclose(other.P, loop.P, atol=1e-9)
        np.testing.assert_array_equal(other.bytes, loop.bytes)


@pytest.mark.slow
def test_learning_is_repeatable_and_the_learned_signal_of_the_path_loss_law_is_the_law(rng):
    learned = runpy.run_path(str(FOLDER / "learned_range.py"))
    with np.load(FOLDER / "learned_range.npz") as kept:
        for name, again in learned["learn"]().items():
            np.testing.assert_allclose(again, kept[name], rtol=1e-6)
    law, u = LogDistance(), rng.uniform(-0.5, 1, 4000)
    mean = learned["ridge"](u, law.A - 10 * law.eta * u)
    sensor = learned["LearnedSignal"](tuple(mean), (0.0, 0.3, 1.2))
    x, q, z = rng.uniform(1, 5, (6, 2)), np.zeros(2), rng.normal(-50, 3, (6, 1))
    y, H, _ = sensor.innovation(x, q, z)
    spread = sensor.spread(np.hypot(*x.T))[:, None]
    exact, slopes, _ = law.innovation(x, q, z)
    np.testing.assert_allclose(y * spread, exact, atol=0.2)
    np.testing.assert_allclose(H * spread[..., None], slopes, rtol=0.05, atol=0.05)


def test_a_constant_velocity_filter_learns_the_velocity_from_anchors_alone():
    _, stream = simulate("robots-1-3/n=1", ticks=1)
    world, start, v = stream.world, np.array([1.0, 2.0]), np.array([0.06, -0.03])
    loop = example(WIDE[0]).make(Belief(start, np.eye(2)), world, 0, None, speed=0.3, jerk=0.001)
    rssi = world.sensors["anchor_rssi"]
    for k in range(1, 41):
        levels = rssi.level(start + k * v, world.anchors)
        z = Senses(np.zeros(0), np.array(1.0), levels, np.zeros((0, 2)), np.zeros((1, 2)), {})
        loop.predict(z)
        loop.correct(z)
    np.testing.assert_allclose(loop.x[2:], v, atol=0.01)


def test_a_range_bias_is_found_where_there_is_one():
    _, stream = simulate("robots-1-3/n=3", trials=2, seed=4, ticks=60)
    biased = stream.replace_arrays({"air.range": stream.air.range + 0.8})
    states = []

    def watch(method, tick, arguments, call):
        states.append(arguments[0] if method == "estimate" else None)
        return call(*arguments)

    trace("it", example(WIDE[1]).with_parameters(bias=1.0), biased, watch)
    found = [robot.x[-1] for robot in states[-1].objects]
    np.testing.assert_allclose(found, 0.8, atol=0.25)


def robot_of(name, **parameters):
    """A baseline's object for one robot, its world, and readings without noise at a place, raised by so many dB."""
    _, stream = simulate("robots-1-3/n=1", ticks=1)
    world = stream.world

    def read(place, offset=0.0):
        levels = world.sensors["anchor_rssi"].level(np.array(place), world.anchors) + offset
        return Senses(np.array([0.1, 0.25]), np.array(1.0), levels, np.zeros((0, 2)), np.zeros((1, 2)), {})

    return example(name).make(Belief(np.array([2.0, 2.0]), np.eye(2)), world, 0, None, **parameters), world, read


@pytest.mark.parametrize("place", [(3.0, 3.0), (1.3, 4.2), (5.5, 0.7)])
def test_without_noise_a_baseline_finds_the_place_and_differences_do_so_for_any_power(place):
    by_ranges, _, read = robot_of(BASELINES[0])
    by_ranges.correct(read(place))
    np.testing.assert_allclose(by_ranges.estimate().x, place, atol=1e-5)
    by_differences = robot_of(BASELINES[2])[0]
    by_differences.correct(read(place, offset=7.0))
    np.testing.assert_allclose(by_differences.estimate().x, place, atol=0.051)  # half a cell


def test_a_weighted_centroid_divides_two_anchors_by_their_ranges_whatever_the_power():
    robot, world, read = robot_of(BASELINES[1])
    q, r = world.anchors, np.hypot(*(world.anchors - (1.5, 0.5)).T)
    z = read((1.5, 0.5), offset=-9.0)
    z.anchor_rssi[2:] = np.nan
    robot.correct(z)
    np.testing.assert_allclose(robot.estimate().x, (r[1] * q[0] + r[0] * q[1]) / (r[0] + r[1]), atol=1e-9)


def test_a_markov_grid_is_the_dense_bayes_recursion_over_its_cells():
    n, m = 8, 400
    robot, world, read = robot_of(BASELINES[3], cells=n)
    p, sigma, rssi = robot.p / robot.p.sum(), world.motion.sigma, world.sensors["anchor_rssi"]
    edges = np.linspace(0, 6, n + 1)
    inside = edges[:-1, None] + (np.arange(m) + 0.5) * 6 / n / m  # places of each cell
    east, north = (
        np.diff(norm.cdf(edges[:, None, None], inside + u, sigma).mean(-1), axis=0) for u in read((0, 0)).odometry
    )
    centres = np.array([(x, y) for x in edges[:-1] + 3 / n for y in edges[:-1] + 3 / n])
    for place in ((2.1, 2.4), (2.2, 2.7), (2.2, 2.9)):
        z = read(place, offset=1.0)
        robot.predict(z)
        robot.correct(z)
        chance = [norm.pdf(z.anchor_rssi, rssi.level(c, world.anchors), rssi.sigma).prod() for c in centres]
        p = np.kron(east, north) @ p * chance
        p /= p.sum()
        np.testing.assert_allclose(robot.p / robot.p.sum(), p, atol=1e-4)
        np.testing.assert_allclose(robot.estimate()[0], p @ centres, atol=1e-3)
