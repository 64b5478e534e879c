"""A team's recordings as a scenario: from log.toml to a table."""

from itertools import pairwise

import numpy as np
import pytest
from made_team import (
    ANCHORS,
    ARENA,
    BIAS,
    LENGTH_SCALE,
    ROBOTS,
    SIGMA_OMEGA,
    SIGMA_RANGE,
    SIGMA_V,
    TICK,
    TURN_SCALE,
    describe,
    write,
)

import cooploc as cl
from cooploc.estimators.ekf_local import EkfLocal
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Belief, Senses, World
from cooploc.estimators.models import Range, Unicycle, wrap
from cooploc.scenarios import resolve
from cooploc.scenarios.recordings.fit import team_models
from cooploc.scenarios.recordings.fit_choice import HeldOut, held_out_error
from cooploc.scenarios.recordings.scenario import start_belief
from cooploc.scenarios.recordings.schema import Prior
from cooploc.scenarios.stream import Air, Stream

ANY = {"anchor_reading": "any", "reading": "any"}
PLACES = ", ".join(f"{name} = [{x}, {y}]" for name, (x, y) in ANCHORS.items())
SHORT = ("seconds = 60.0", "seconds = 20.0")
STATED = (
    'on = "first part"\nseconds = 60.0',
    'on = "nothing"\n[model]\nlength_scale = 1.1\nturn_scale = 0.9\nsigma_v = 0.03\nsigma_omega = 0.02\n'
    "range_bias = 0.35\nrange_sigma = 0.08",
)


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    folder = tmp_path_factory.mktemp("long") / "lab"
    write(folder, seconds=240.0)
    describe(folder, ("seconds = 60.0", "seconds = 180.0"))
    return folder


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Two runs with anchors, 40 s each."""
    folder = tmp_path_factory.mktemp("recorded") / "lab"
    for seed, name in enumerate(("one", "two")):
        write(folder / name, seed, 40.0, anchors=True)
    return folder


def lab(recorded, tmp_path, *changes, runs=("one", "two")):
    """The same two runs, described otherwise."""
    folder = tmp_path / "lab"
    describe(folder, *changes)
    for name in runs:
        (folder / name).symlink_to(recorded / name)
    return folder


@pytest.mark.slow
def test_the_models_that_made_the_data_are_recovered(long):
    _, stream = cl.simulate("log/all", data=long)
    models = stream.notes["models"]
    for scales in models["odometry_scales"].values():
        np.testing.assert_allclose(scales, [LENGTH_SCALE, TURN_SCALE], rtol=0.03)
    found = [models["sigma_v"], models["sigma_omega"], models["range_sigma"]]
    np.testing.assert_allclose(found, [SIGMA_V, SIGMA_OMEGA, SIGMA_RANGE], rtol=0.15)
    assert models["range_bias"]["red - blue"] == pytest.approx(BIAS, abs=0.01)
    assert models["fitted_on"] == "its first 180 s, which are not judged"
    assert stream.time[0] == pytest.approx(1_700_000_000.003 + 180 + TICK, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("tick", [0.1, 2.0])
def test_models_of_odometry_are_scored_by_the_crps_of_a_gaussian_for_any_tick(long, tick):
    """Of errors with the standard deviation sigma that a forecast says, it is sigma/sqrt(pi) on average."""
    run = resolve("log/all", long).model.at([0]).judged_run
    how = run.how._replace(tick=tick, robust=False)
    models = team_models(run.log, run.parts, how)
    sigma = np.sqrt(models.motion.sigma_v * models.motion.sigma_omega * tick)  # geometric mean, of a root of a second
    score = held_out_error(run.log, HeldOut(run.parts[0], how, models, []))
    assert score == pytest.approx(sigma / np.sqrt(np.pi), rel=0.1)


@pytest.mark.slow
def test_raw_ranges_keep_their_bias_and_sigma_contains_it(long):
    (_, fitted), (_, raw) = (cl.simulate(f"log/all[bias={bias}]", data=long) for bias in ("fitted", "none"))
    difference = raw.air.range - fitted.air.range
    bias = fitted.notes["models"]["range_bias"]["red - blue"]
    np.testing.assert_allclose(difference[np.isfinite(difference)], bias, atol=1e-12)
    assert raw.world.sensors["radio_range"].sigma > bias
    np.testing.assert_array_equal(raw.senses.odometry, fitted.senses.odometry)


@pytest.mark.slow
def test_nothing_that_is_judged_changes_what_the_team_is_told(recorded, tmp_path):
    """Truth and ranges of the judged part are shaken, and moved far away; models, odometry and readings stay."""
    folder = lab(recorded, tmp_path, SHORT, runs=())
    for file in (recorded / "one").iterdir():
        lines = file.read_text().splitlines()
        if file.name.startswith("mocap"):
            middle = int(len(lines) * 0.75)
            lines[middle:] = [",".join([*f[:2], "1.0", "2.0", "0.5"]) for f in (x.split(",") for x in lines[middle:])]
        (folder / file.name).write_text("\n".join(lines) + "\n")
    (truth, stream), (before, whole) = (
        cl.simulate("log/all", data=folder),
        cl.simulate("log/one", data=lab(recorded, tmp_path / "whole", SHORT)),
    )
    assert np.abs(truth.x - before.x).max() > 0.5
    assert stream.hashes == whole.hashes
    assert stream.notes["models"] == whole.notes["models"]


@pytest.mark.slow
def test_a_run_is_fitted_on_the_others_alone(recorded, tmp_path):
    folder = lab(recorded, tmp_path, ('on = "first part"\nseconds = 60.0', 'on = "other runs"'))
    worlds = {}
    for name in ("one", "two"):
        _, stream = cl.simulate(f"log/{name}", data=folder)
        worlds[name] = stream.notes["models"]
    assert worlds["one"]["fitted_on"] == "the other runs two"
    assert worlds["one"]["range_bias"] != worlds["two"]["range_bias"]
    assert cl.simulate("log/all", trials=[1], data=folder)[1].hashes == cl.simulate("log/two", data=folder)[1].hashes
    with pytest.raises(BadInput, match=r"fitted on no other run, too little for .*sigma_v.*first part"):
        cl.simulate("log/one", data=lab(recorded, tmp_path / "alone", (STATED[0], 'on = "other runs"'), runs=["one"]))


def lines(folder, name):
    return [line.split(",") for line in (folder / name).read_text().splitlines()[1:]]


def held(rows, t0, ticks):
    """Mean of values (ticks, 2), each of which holds until the next, by plain loops."""
    means = np.zeros((ticks, 2))
    for k in range(ticks):
        for (a, *u), (b, *_) in pairwise(rows):
            means[k] += np.array(u) * max(0.0, min(b, t0 + TICK * (k + 1)) - max(a, t0 + TICK * k)) / TICK
    return means


def ranged(rows, t0, ticks, bias):
    """Ranges (1, ticks, 2, 2) at the nearest tick, to the one robot and to the other in turn."""
    table = np.full((1, ticks, 2, 2), np.nan)
    for number, (at, d) in enumerate(rows):
        k = int(np.floor((at - t0) / TICK + 0.5)) - 1
        if 0 <= k < ticks:
            table[0, k, number % 2, 1 - number % 2] = d - bias
    return table


@pytest.mark.slow
def test_a_stream_fed_by_hand_has_the_same_bits(recorded, tmp_path):
    """Read, put on ticks and corrected by plain loops over the lines of the files."""
    folder = lab(recorded, tmp_path, STATED, ("[odometry]", "[sample]\nduration = 5.0\n[odometry]"), runs=["one"])
    _, stream = cl.simulate("log/one", data=folder)
    run, ticks, n = recorded / "one", 50, 2
    first = [
        (float(s) + float(ns) * 1e-9, *map(float, pose))
        for s, ns, *pose in (lines(run, f"mocap_{r}.csv")[0] for r in ROBOTS)
    ]
    t0 = max(at for at, *_ in first)
    odometry = [held([tuple(map(float, f)) for f in lines(run, f"odom_{robot}.csv")], t0, ticks) for robot in ROBOTS]
    np.testing.assert_allclose(stream.senses.odometry[0], np.stack(odometry, 1) * [1.1, 0.9], atol=1e-6)
    np.testing.assert_allclose(stream.prior.x[0], [pose for _, *pose in first], atol=1e-6)
    ranges = ranged(
        [(float(t), float(d)) for t, a, b, d in lines(run, "uwb.csv") if {a, b} == set(ROBOTS)], t0, ticks, 0.35
    )
    none, sightings = np.empty((1, ticks, n, 0)), np.empty((1, ticks, n, 0, 2))
    by_hand = Stream(
        scenario="log/one",
        seed=0,
        trial=np.zeros(1, np.int64),
        time=stream.time,
        world=World(n, TICK, np.array(ARENA), Unicycle(0.03, 0.02, TICK), {"radio_range": Range(0.08)}, t0=t0),
        prior=Belief(stream.prior.x, np.broadcast_to(np.diag([0.05**2] * 3), (1, n, 3, 3)).copy()),
        senses=Senses(stream.senses.odometry, np.full((1, ticks, n), TICK), none, sightings, sightings, {}),
        air=Air(np.broadcast_to(~np.eye(n, dtype=bool), (1, ticks, n, n)).copy(), none, ranges),
    )
    assert by_hand.hashes == stream.hashes
    mine, theirs = (cl.run({"joint": cl.make("ekf-joint", **ANY)}, s).traces["joint"].x for s in (by_hand, stream))
    np.testing.assert_array_equal(mine, theirs)


@pytest.mark.slow
def test_ranges_to_anchors_are_used_by_a_robot_alone(recorded, tmp_path):
    folder = lab(recorded, tmp_path, SHORT, ("[fit]", f"[anchors]\nplaces = {{ {PLACES} }}\n[fit]"))
    truth, stream = cl.simulate("log/two", data=folder)
    assert stream.channels() == {"odometry", "radio_range", "anchor_range"}
    assert stream.world.sensors["anchor_range"].sigma == pytest.approx(SIGMA_RANGE, rel=0.4)
    estimators = {"dr": cl.make("dead-reckoning"), "own": cl.make("ekf-local", anchor_reading="rssi")}
    table = cl.errors(truth, cl.run(estimators, stream)).set_index(["estimator", "robot"])["mse"]
    assert table["own", 0] < table["dr", 0]  # red ranges to anchors
    assert table["own", 1] == pytest.approx(table["dr", 1])  # blue does not

    class OfAnchors(EkfLocal):
        uses = ("odometry", "anchor_range")  # a channel that the worlds of the checks lack

    report = cl.check_estimator(OfAnchors(), isolate=False, scenarios="log/two", data=folder)
    assert {r.status for r in report.results} == {"passed"}, report.table()


def test_packets_may_need_a_reading(recorded, tmp_path):
    _, stream = cl.simulate("log/two[packets=with a reading]", data=lab(recorded, tmp_path, SHORT))
    np.testing.assert_array_equal(stream.air.link, np.isfinite(stream.air.range))
    assert 0 < stream.air.link.sum() < stream.air.link.size / 2


@pytest.mark.slow
def test_without_a_true_heading_it_must_be_said_what_robots_know(recorded, tmp_path):
    unknown = ('heading = "yaw"\n', "")
    with pytest.raises(BadInput, match='has no true heading where the prior is taken; choose heading = "first motion"'):
        cl.simulate("log/one", data=lab(recorded, tmp_path, SHORT, unknown))
    motion = ("[fit]", '[prior]\nheading = "first motion"\nheading_sd = 0.2\n[fit]')
    truth, stream = cl.simulate("log/one", data=lab(recorded, tmp_path / "motion", SHORT, unknown, motion))
    assert (truth.x.shape[-1], stream.prior.x.shape[-1]) == (2, 3)
    known, headed = cl.simulate("log/one", data=lab(recorded, tmp_path / "headed", SHORT))
    assert np.abs(wrap(stream.prior.x[0, :, 2] - headed.prior.x[0, :, 2])).max() < 0.2
    assert known.x.shape[-1] == 3
    np.testing.assert_array_equal(known.x[..., :2], truth.x)


def test_a_robot_that_stands_shows_no_heading_by_its_first_motion():
    poses = np.zeros((50, 2, 3))
    poses[:, 0, 1] = np.linspace(0, 2, 50)  # blue stands
    declared = Prior(heading="first motion", heading_sd=0.2)
    belief, source = start_belief(ROBOTS, "one", declared, np.array(ARENA), poses, np.zeros((49, 2)))
    np.testing.assert_allclose(belief.x[0, :, 2], [np.pi / 2, 0])
    np.testing.assert_allclose(belief.P[0, :, 2, 2], [0.2**2, np.pi**2 / 3])
    assert source.endswith("; unknown of blue, which hardly moved")


@pytest.mark.slow
def test_what_is_left_over_has_the_spread_that_filters_are_told(long):
    model = resolve("log/all", long).model.at([0])
    found = {one.fitted: one for one in model.link_residuals()}
    for one in found.values():
        assert (one.what, one.unit, one.link) == ("range", "m", "red - blue")
        assert abs(one.residual.mean()) < 0.02
        assert one.residual.std() == pytest.approx(one.sigma, rel=0.1)
    assert len(found[True].residual) == 15 * 180
    assert len(found[False].residual) == pytest.approx(15 * 60, abs=3)
