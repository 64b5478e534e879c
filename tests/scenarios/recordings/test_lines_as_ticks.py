"""A lone robot whose lines are its ticks, on small files from a known motion and model, and on the WiFi recordings."""

import os
from pathlib import Path

import numpy as np
import pytest
from made_logs import (
    COLUMNS,
    DESCRIPTION,
    EPOCH,
    ETA,
    LENGTH,
    MODEL,
    SIGMA,
    TICKS,
    TURN,
    A,
    change,
    describe,
    drive,
    lines,
    write,
)

from cooploc import scenarios
from cooploc.estimators.errors import BadInput
from cooploc.estimators.models import LogDistance, wrap
from cooploc.scenarios.recordings.scenario import TeamScenario


@pytest.fixture
def data(tmp_path):
    folder = tmp_path / "lab"
    folder.mkdir()
    describe(folder)
    for i, name in enumerate(("a", "b", "c")):
        write(folder, name, lines(i))
    return folder


def simulate(data, which="a", trials=(0,), robust=False, **overrides):
    log = TeamScenario(data=data, run=which, robust=robust, **overrides).at(list(trials))
    return log.simulate(f"log/{which}", list(trials), 0, log.world())


def refused(data, which="a", **overrides):
    """The error's text, which must be one line."""
    with pytest.raises(BadInput) as caught:
        simulate(data, which, **overrides)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_truth_odometry_and_readings_are_recovered_to_the_nanosecond(data):
    truth, stream = simulate(data)
    time, pose, u = drive(0)
    assert truth.x.shape == (1, TICKS, 1, 2)
    np.testing.assert_allclose(truth.x[0, :, 0], pose[1:, :2], atol=1e-8)
    np.testing.assert_allclose(stream.time, EPOCH + time[1:], atol=1e-6)
    np.testing.assert_allclose(stream.senses.dt[0, :, 0], np.diff(time), atol=1e-8)
    length, turn = stream.notes["models"]["odometry_scales"]["robot"]
    np.testing.assert_allclose(stream.senses.odometry[0, :, 0], u * [length / LENGTH, turn / TURN], atol=1e-6)
    rssi = [[float(field) for field in row[7:11]] for row in lines(0)[1:]]
    np.testing.assert_array_equal(stream.senses.anchor_rssi[0, :, 0], rssi)
    assert stream.channels() == {"odometry", "anchor_rssi"}
    assert truth.valid.all()
    assert truth.origin == stream.hashes


def test_truth_that_stood_still_while_it_was_lost_is_masked_and_a_missing_reading_is_absent(data):
    change(data, "a", {(3, "r1"): "0.0", (4, "r1"): "12", (5, "r2"): "", (6, "r3"): "nan"})
    change(data, "a", {(row, axis): lines(0)[10][COLUMNS.index(axis)] for row in (11, 12, 13) for axis in "xy"})
    truth, stream = simulate(data)
    np.testing.assert_array_equal(np.flatnonzero(~truth.valid[0, :, 0]) + 1, [11, 12, 13])
    assert stream.notes["truth_masked"] == [3]
    assert np.isnan(truth.x[~truth.valid]).all()
    absent = np.argwhere(np.isnan(stream.senses.anchor_rssi[0, :, 0]))
    assert absent.tolist() == [[2, 0], [3, 0], [4, 1], [5, 2]]
    describe(data, 'repeats = "stale"\n', "")
    assert simulate(data)[0].valid.all()


def test_across_a_gap_a_turn_is_unknown_and_a_counter_is_not(data):
    table = lines(0)
    for line in table[21:]:
        line[1] = str(int(line[1]) + 67)
    write(data, "a", table)
    _, stream = simulate(data)
    dt, u = stream.senses.dt[0, :, 0], stream.senses.odometry[0, :, 0]
    assert dt[20] == pytest.approx(68, abs=0.01)
    assert dt.sum() == pytest.approx(stream.time[-1] - stream.world.t0)
    assert np.isfinite(u[20]).tolist() == [True, False]
    assert np.isfinite(np.delete(u, 20, 0)).all()


def test_displacements_have_a_compass(data):
    text = DESCRIPTION.replace('kind = "path"', 'kind = "displacement"')
    columns = 'length = "metres"\nturn_rate = "turn"'
    describe(data, columns, 'dx = { column = "metres", unit = "mm" }\ndy = "turn"', text)
    for i, name in enumerate("abc"):
        step = np.diff(drive(i)[1][:, :2], axis=0) + np.random.default_rng(i).normal(0, 0.01, (TICKS, 2))
        cells = {(k + 1, "metres"): f"{1e3 * step[k, 0]:.9f}" for k in range(TICKS)}
        change(data, name, cells | {(k + 1, "turn"): f"{step[k, 1]:.9f}" for k in range(TICKS)})
    truth, stream = simulate(data)
    assert stream.world.motion.sigma == pytest.approx(0.01, rel=0.15)
    assert (stream.prior.x.shape[-1], stream.notes["prior"]) == (2, "first truth, assumed sd 0.05 m")
    assert np.abs(np.cumsum(stream.senses.odometry, 1) - (truth.x - [2.0, 1.2])).max() < 0.3


def test_models_are_those_of_the_other_runs(data):
    for i, name in enumerate("bc", 1):
        write(data, name, lines(i, 600))
    models = simulate(data)[1].notes["models"]
    assert models["fitted_on"] == "the other runs b, c"
    for name, value in {"anchor_A": A, "anchor_eta": ETA, "anchor_rssi_sigma": SIGMA}.items():
        assert models[name] == pytest.approx(value, rel=0.06), name
    np.testing.assert_allclose(models["odometry_scales"]["robot"], [LENGTH, TURN], rtol=0.01)


def test_a_runs_own_lines_do_not_touch_its_models(data):
    before = simulate(data)[1]
    rng = np.random.default_rng(0)
    rows = [(k, c) for k in range(1, TICKS + 1) for c in ("r1", "r3", "x", "y", "turn")]
    change(data, "a", {cell: f"{value:.6f}" for cell, value in zip(rows, rng.normal(-1, 1, len(rows)), strict=True)})
    after = simulate(data)[1]
    assert after.notes["models"] == before.notes["models"]
    assert (after.world.motion, after.world.sensors) == (before.world.motion, before.world.sensors)
    assert after.hashes != before.hashes


@pytest.mark.slow
def test_nothing_is_fitted_across_set_ups(data):
    describe(data, 'about = "made by a test"', 'set_ups = ["[ab]", "c*", "d"]')
    write(data, "c2", lines(3))
    write(data, "e", lines(4))
    on = {name: simulate(data, name)[1].notes["models"]["fitted_on"] for name in ("a", "b", "c", "c2")}
    assert on == {name: f"the other runs {other}" for name, other in zip(on, ("b", "a", "c2", "c"), strict=True)}
    assert "run 'e' is fitted on no other run, too little for sigma_v" in refused(data, "e")


@pytest.mark.slow
def test_a_part_of_another_run_is_not_a_run_and_is_not_fitted_on(data):
    rows = lines(1)
    write(data, "b-end", rows[20:])
    write(data, "b-twice", rows)
    log = TeamScenario(data=data)
    assert (log.at([1]).run, log.count()) == ("b", 3)
    on = {name: simulate(data, name)[1].notes["models"]["fitted_on"] for name in ("a", "b", "b-end", "b-twice")}
    assert [fitted[-4:] for fitted in on.values()] == ["b, c", "a, c", "a, c", "a, c"]


@pytest.mark.slow
def test_readings_that_are_correlated_in_time_are_assumed_noisier(data):
    for i, name in enumerate("bc", 1):
        write(data, name, lines(i, 1500, correlation=0.6))
    models = simulate(data)[1].notes["models"]
    assert models["anchor_rssi_lag1"] == pytest.approx(0.6, abs=0.04)
    assert models["anchor_rssi_sigma"] == pytest.approx(2 * SIGMA, rel=0.1)  # sqrt(1.6 / 0.4) = 2
    alone = simulate(data, correlation="ignore")[1].notes["models"]["anchor_rssi_sigma"]
    assert alone == pytest.approx(SIGMA, rel=0.05)


def test_a_single_run_needs_stated_models(data):
    for name in "bc":
        (data / f"{name}.csv").unlink()
    assert "too little for sigma_v, sigma_omega, anchor_A, anchor_eta, anchor_rssi_sigma" in refused(data)
    describe(data, new=MODEL)
    _, stream = simulate(data)
    assert stream.world.sensors["anchor_rssi"] == LogDistance(A, ETA, SIGMA)
    assert (stream.world.motion.sigma_v, stream.world.motion.sigma_omega) == (0.02, 0.03)
    assert stream.notes["models"]["fitted_on"] == "no other run"


@pytest.mark.parametrize(
    ("overrides", "x", "sd", "says"),
    [
        ({"heading": "unknown"}, [2.0, 1.2, 0.0], [0.05, 0.05, np.pi / np.sqrt(3)], "heading: unknown"),
        ({"position": "arena", "heading": "unknown"}, [2, 1.5, 0], [4 / 12**0.5, 3 / 12**0.5, 1.814], "anywhere"),
    ],
)
def test_the_source_of_the_prior_is_declared(data, overrides, x, sd, says):
    _, stream = simulate(data, **overrides)
    np.testing.assert_allclose(stream.prior.x[0, 0], x, atol=1e-8)
    np.testing.assert_allclose(np.sqrt(np.diag(stream.prior.P[0, 0])), sd, atol=1e-3)
    assert says in stream.notes["prior"]


def test_the_first_motion_gives_the_heading_before_the_turns_that_led_to_it(data):
    _, pose, _ = drive(0)
    standing = [row[:] for row in lines(0)[:1] * 4]
    for k, row in enumerate(standing):
        row[1], row[4] = str(EPOCH - 4 + k), f"{0.5 / TURN:.9f}"  # turns on the spot by 4 x 0.5 rad
        row[5] = f"{2.0 + 1e-4 * k:.9f}"
    write(data, "a", standing + lines(0))
    _, stream = simulate(data, turn_scale=TURN)
    assert wrap(stream.prior.x[0, 0, 2] - (pose[0, 2] - 2.0)) == pytest.approx(0, abs=0.15)


@pytest.mark.slow
def test_the_trials_of_all_are_the_runs(data):
    for k, name in enumerate("abc"):
        (truth, stream), (_, alone) = simulate(data, "all", [k]), simulate(data, name)
        assert stream.hashes == alone.hashes
        assert (int(truth.trial[0]), stream.notes["recording"]) == (k, f"lab/{name}")
    assert "trials=[0]" in refused(data, "all", trials=[0, 1])
    assert "3 trials" in refused(data, "all", trials=[3])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('robots = ["robot"]', 'robots = ["one", "two"]', 'tick = "lines" takes one robot'),
        ("south = [4, 3], west = [4, 0]", "south = [0, 0.1], west = [0, 2.9]", "does not fall with distance"),
    ],
)
def test_a_description_that_cannot_be_is_one_line(data, old, new, said):
    describe(data, old, new)
    assert said in refused(data)


REAL = Path(os.environ.get("COOPLOC_DATA", Path(__file__).parents[4] / "shared" / "data")) / "wifi-rssi"


@pytest.mark.slow
@pytest.mark.skipif(
    not REAL.is_dir(), reason="the WiFi recordings are not here; set COOPLOC_DATA to where wifi-rssi/ lies"
)
def test_the_wifi_recordings():
    log = TeamScenario(data=REAL, described="wifi", robust=False)
    assert (len(log.folder.places), log.count()) == (12, 11)  # exp4.4.1 is the end of exp4.4
    stale = 0
    for k in range(log.count()):
        _, stream = scenarios.simulate("wifi/all", data=REAL, trials=[k])
        notes, models = stream.notes, stream.notes["models"]
        set_up = Path(notes["recording"]).name[:5]
        others = models["fitted_on"].removeprefix("the other runs ").split(", ")
        assert all(name.startswith(set_up) for name in others)
        assert len(others) == {"corne": 4, "trial": 5}[set_up]
        assert 0.4 < models["anchor_eta"] < 1.6
        assert 0.5 < models["anchor_rssi_lag1"] < 0.7
        assert np.nanmax(stream.senses.anchor_rssi) < -15
        stale += notes["truth_masked"][0]
        assert notes["odometry_missing"] == [int("exp4.4" in notes["recording"])]  # a gap of 67 s
    assert stale == 100
