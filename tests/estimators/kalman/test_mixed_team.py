"""Teams whose robots do not all sense the same: both engines, slopes, and limits in which options coincide."""

from dataclasses import replace

import numpy as np
import pytest
from oracles import slope

import cooploc as cl
from cooploc.estimators.models import Orientation

WORLD = "camera/n=3[ticks=40,sigma_orientation=0.1,without_odometry=1]"
OPTIONS = [
    {"sighting": "range"},
    {"sighting": "bearing"},
    {"sighting": "none", "orientation": True},
    {"sighting": "bearing", "orientation": True},
    {"absent_odometry": "random"},
    {"absent_odometry": "random", "sighting": "range", "orientation": True},
]


@pytest.mark.parametrize("update", ["batch", "sequential"])
@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_both_engines_agree(options, update):
    _, stream = cl.simulate(WORLD, trials=2, seed=4)
    made = {e: cl.make("ekf-joint", engine=e, update=update, **options) for e in ("batched", "filterpy")}
    a, b = cl.run(made, stream).traces.values()
    np.testing.assert_allclose(a.x, b.x, atol=1e-9)
    np.testing.assert_allclose(a.P, b.P, atol=1e-9)


def test_an_orientation_has_the_slopes_of_the_difference_of_two_headings(rng):
    x, x_j, z = rng.normal(size=(4, 3)), rng.normal(size=(4, 3)), rng.normal(0, 2, (4, 1))
    y, H, H_j = Orientation().between(x, x_j, z)
    np.testing.assert_allclose(np.exp(1j * y), np.exp(1j * (z - x_j[:, 2:] + x[:, 2:])), atol=1e-12)
    np.testing.assert_allclose(H, -slope(lambda x: Orientation().between(x, x_j, z)[0], x), atol=1e-6)
    np.testing.assert_allclose(H_j, -slope(lambda x_j: Orientation().between(x, x_j, z)[0], x_j), atol=1e-6)


@pytest.mark.parametrize("blind", [0, 1, 2])
def test_robots_without_odometry_stay_where_they_were_and_grow_uncertain(blind):
    _, stream = cl.simulate(f"camera/n=2[ticks=30,landmarks=1,without_odometry={blind}]", trials=2, seed=4)
    random = {"absent_odometry": "random", "speed": 0.4, "turn_rate": 0.2, "hold": 1.5}
    ekf = cl.make("ekf-joint", **random, sighting="none", anchor_reading="none")
    a, b = cl.run({"ekf": ekf, "dead": cl.make("dead-reckoning")}, stream).traces.values()
    np.testing.assert_allclose(a.x, b.x, atol=1e-12)
    np.testing.assert_allclose(a.P[:, :, : 2 - blind], b.P[:, :, : 2 - blind], atol=1e-12)
    grown = 30 * 0.1 * 1.5 * np.array([0.4, 0.4, 0.2]) ** 2
    P = stream.prior.P + np.diag(grown)
    np.testing.assert_allclose(a.P[:, -1, 2 - blind :], P[:, 2 - blind :], rtol=1e-12)


@pytest.mark.slow
def test_orientations_have_their_noise_and_leave_all_other_readings_as_they_were():
    label = "camera/n=3[ticks=400,view=3.0,sigma_orientation=0.1]"
    truth, stream = cl.simulate(label, trials=5, seed=4)
    _, without = cl.simulate("camera/n=3[ticks=400,view=3.0]", trials=5, seed=4)
    for name in ("odometry", "landmark", "sighting"):
        np.testing.assert_array_equal(getattr(stream.senses, name), getattr(without.senses, name))
    seen = stream.senses.extra["orientation"][..., 0]
    np.testing.assert_array_equal(np.isnan(seen), np.isnan(stream.senses.sighting[..., 0]))
    heading = truth.x[..., 2]
    off = np.angle(np.exp(1j * (seen - (heading[:, :, None] - heading[..., None]))))[~np.isnan(seen)]
    assert len(off) > 1000
    assert abs(off.std() / 0.1 - 1) < 4 / np.sqrt(2 * len(off))
    assert abs(off.mean()) < 4 * 0.1 / np.sqrt(len(off))


def test_a_world_without_orientations_and_a_sighting_that_has_no_parts_are_refused():
    _, stream = cl.simulate("camera/n=2[ticks=3]", trials=1, seed=4)
    with pytest.raises(cl.BadInput, match="needs channel 'orientation'"):
        cl.run({"ekf": cl.make("ekf-joint", orientation=True)}, stream)
    sensors = {**stream.world.sensors, "sighting": Orientation()}
    senses = stream.senses._replace(sighting=stream.senses.sighting[..., 1:])
    odd = replace(stream, world=replace(stream.world, sensors=sensors), senses=senses)
    with pytest.raises(cl.BadInput, match="needs sightings of range and bearing"):
        cl.run({"ekf": cl.make("ekf-joint", sighting="range")}, odd)
