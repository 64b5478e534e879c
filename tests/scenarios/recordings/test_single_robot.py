"""A user's own log, on small CSV files written here from a known motion and model, and on the real WiFi recordings."""

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
from cooploc.analysis.metrics.errors import errors
from cooploc.estimators import make
from cooploc.estimators.errors import BadInput
from cooploc.estimators.models import Displacement, LogDistance, wrap
from cooploc.scenarios.recordings import schema
from cooploc.scenarios.recordings.single_robot import Log, read_run
from cooploc.scenarios.runner.run import run


@pytest.fixture
def data(tmp_path):
    folder = tmp_path / "lab"
    folder.mkdir()
    describe(folder)
    for i, name in enumerate(("a", "b", "c")):
        write(folder, name, lines(i))
    return folder


@pytest.fixture
def single(tmp_path):
    """One run whose models are stated."""
    folder = tmp_path / "single"
    folder.mkdir()
    describe(folder, new=MODEL)
    write(folder, "a", lines(0))
    return folder


def simulate(data, which="a", trials=(0,), **overrides):
    log = Log(data=data, run=which, **overrides).at(list(trials))
    return log.simulate(f"log/{which}", list(trials), 0, log.world())


def refused(data, which="a", **overrides):
    """The error's text, which must be one line."""
    with pytest.raises(BadInput) as caught:
        simulate(data, which, **overrides)
    assert "\n" not in str(caught.value)
    return str(caught.value)


# What was recorded


def test_truth_odometry_and_readings_are_recovered(data):
    truth, stream = simulate(data)
    time, pose, u = drive(0)
    assert truth.x.shape == (1, TICKS, 1, 2)
    np.testing.assert_allclose(truth.x[0, :, 0], pose[1:, :2], atol=1e-8)
    np.testing.assert_allclose(stream.time, EPOCH + time[1:], atol=1e-6)
    np.testing.assert_allclose(stream.senses.dt[0, :, 0], np.diff(time), atol=1e-8)
    models = stream.notes["models"]
    scale = [models["length_scale"] / LENGTH, models["turn_scale"] / TURN]
    np.testing.assert_allclose(stream.senses.odometry[0, :, 0], u * scale, atol=1e-6)
    assert stream.senses.anchor_rssi.shape == (1, TICKS, 1, 4)
    assert stream.channels() == {"odometry", "anchor_rssi"}
    assert truth.valid.all()
    assert truth.origin == stream.hashes


def test_dead_reckoning_follows_odometry_that_is_exact(data):
    truth, stream = simulate(data, length_scale=LENGTH, turn_scale=TURN)
    at = stream.prior.x[0, 0]
    np.testing.assert_allclose(at[:2], [2.0, 1.2])
    assert abs(wrap(at[2] - drive(0)[1][0, 2])) < 0.1
    stream = stream.with_arrays({"prior.x": drive(0)[1][:1][None]})
    trace = run({"dr": make("dead-reckoning")}, stream).traces["dr"]
    assert np.abs(trace.x[..., :2] - truth.x).max() < 1e-5
    assert stream.world.motion.tick == stream.world.tick == pytest.approx(1, abs=0.01)


def test_what_means_missing_is_absent_and_counted(data):
    cells = {(3, "r1"): "0.0", (4, "r1"): "12", (5, "r2"): "", (6, "r3"): "nan", (7, "s4"): "0", (8, "s4"): ""}
    change(data, "a", cells)
    _, stream = simulate(data)
    absent = np.isnan(stream.senses.anchor_rssi[0, :, 0])
    assert {(int(k) + 1, int(i)) for k, i in np.argwhere(absent)} == {(3, 0), (4, 0), (5, 1), (6, 2), (7, 3), (8, 3)}
    assert stream.notes["rssi_missing"] == [2, 1, 1, 2]
    describe(data, "status =", "missing_from = -20.0\nstatus =")
    change(data, "a", {(9, "r1"): "-15"})
    assert simulate(data)[1].notes["rssi_missing"] == [3, 1, 1, 2]


def later(data, name, row, seconds):
    """A gap before a row."""
    table = [line.split(",") for line in (data / f"{name}.csv").read_text().splitlines()[1:]]
    for line in table[row:]:
        line[1] = str(int(line[1]) + seconds)
    write(data, name, table)


KINDS = {
    "path": [True, False],
    "velocity": [False, False],
    "displacement": [True, True],
}
OTHER = {
    "velocity": 'kind = "velocity"\nspeed = "metres"\nturn_rate = "turn"\nholds = "until the next line"',
    "displacement": 'kind = "displacement"\ndx = "metres"\ndy = "turn"',
}
PATH = 'kind = "path"\nlength = "metres"\nturn_rate = "turn"\nholds = "until the next line"'


@pytest.mark.parametrize("kind", KINDS)
def test_across_a_gap_a_command_is_unknown_and_a_counter_is_not(data, kind):
    before = simulate(data)[1].senses.odometry[0, 20, 0, 0]
    later(data, "a", 21, 67)
    describe(data, PATH, OTHER.get(kind, PATH))
    describe(data, new="[model]\nsigma_move = 0.1", text=(data / "log.toml").read_text())
    _, stream = simulate(data)
    dt, u = stream.senses.dt[0, :, 0], stream.senses.odometry[0, :, 0]
    assert dt[20] == pytest.approx(68, abs=0.01)
    assert dt.sum() == pytest.approx(stream.time[-1] - stream.world.t0)
    assert np.isfinite(u[20]).tolist() == KINDS[kind]
    assert np.isfinite(np.delete(u, 20, 0)).all()
    assert stream.notes["gaps"] == [{"line": 23, "seconds": pytest.approx(68, abs=0.01)}]
    if kind == "path":
        assert u[20, 0] * dt[20] == pytest.approx(before, abs=0.01)
    run({"dr": make("dead-reckoning")}, stream)


def test_truth_that_stood_still_while_it_was_lost_is_masked(data):
    cells = {(row, axis): lines(0)[10][COLUMNS.index(axis)] for row in (11, 12, 13) for axis in "xy"}
    change(data, "a", cells)
    truth, stream = simulate(data)
    np.testing.assert_array_equal(np.flatnonzero(~truth.valid[0, :, 0]) + 1, [11, 12, 13])
    assert (stream.notes["truth_stale"], stream.notes["truth_jumps"], stream.notes["truth_masked"]) == (3, 0, [3])
    assert np.isnan(truth.x[~truth.valid]).all()
    describe(data, 'repeats = "stale"\n', "")
    assert simulate(data)[0].valid.all()


def test_a_jump_is_masked_until_the_truth_can_be_reached_again(data):
    change(data, "a", {(20, "x"): "9.0", (21, "x"): "9.1", (30, "y"): ""})
    truth, stream = simulate(data)
    np.testing.assert_array_equal(np.flatnonzero(~truth.valid[0, :, 0]) + 1, [20, 21, 30])
    assert (stream.notes["truth_jumps"], stream.notes["truth_absent"]) == (2, 1)
    e = errors(truth, run({"dr": make("dead-reckoning")}, stream))
    assert e["ticks"].tolist() == [TICKS - 3]


def test_a_turn_rate_may_hold_since_the_line_before(data):
    after = simulate(data, turn_scale=1.0)[1].senses.odometry[0, :, 0, 1]
    describe(data, "until the next line", "since the line before")
    before = simulate(data, turn_scale=1.0)[1].senses.odometry[0, :, 0, 1]
    np.testing.assert_array_equal(before[:-1], after[1:])


def test_displacements_have_a_compass(data):
    describe(data, PATH, OTHER["displacement"].replace('"metres"', '{ column = "metres", unit = "mm" }'))
    for i, name in enumerate("abc"):
        step = np.diff(drive(i)[1][:, :2], axis=0) + np.random.default_rng(i).normal(0, 0.01, (TICKS, 2))
        text = {
            (k + 1, axis): f"{v:.9f}"
            for k in range(TICKS)
            for axis, v in (("metres", 1e3 * step[k, 0]), ("turn", step[k, 1]))
        }
        change(data, name, text)
    truth, stream = simulate(data)
    assert isinstance(stream.world.motion, Displacement)
    assert stream.world.motion.sigma == pytest.approx(0.01, rel=0.15)
    assert (stream.prior.x.shape[-1], stream.notes["prior"]) == (2, "first truth, assumed sd 0.05 m")
    trace = run({"dr": make("dead-reckoning")}, stream).traces["dr"]
    assert np.abs(trace.x - truth.x).max() < 0.3


# What the robot knows, and from which source


def test_models_are_those_of_the_other_runs(data):
    for i, name in enumerate("bc", 1):
        write(data, name, lines(i, 600))
    models = simulate(data)[1].notes["models"]
    assert models["fitted_on"] == ["b", "c"]
    for name, value in {"A": A, "eta": ETA, "residual_sd": SIGMA, "sigma": SIGMA}.items():
        assert models[name] == pytest.approx(value, rel=0.06), name
    assert models["length_scale"] == pytest.approx(LENGTH, rel=0.01)
    assert models["turn_scale"] == pytest.approx(TURN, rel=0.01)


def test_a_runs_own_lines_do_not_touch_its_models(data):
    before, teaches = simulate(data)[1], simulate(data, "b", eta=1.8)[1].notes["models"]["A"]
    rng = np.random.default_rng(0)
    own = {
        (k, c): f"{v:.6f}"
        for k in range(TICKS + 1)
        for c, v in zip(["r1", "r3", "x", "y", "turn"], rng.normal(-1, 1, 5), strict=True)
    }
    change(data, "a", own)
    describe(data, "max_speed = 1.0\n", "")
    after = simulate(data, heading="unknown")[1]
    assert after.notes["models"] == before.notes["models"]
    assert after.world.motion == before.world.motion
    assert after.world.sensors == before.world.sensors
    assert simulate(data, "b", eta=1.8)[1].notes["models"]["A"] != pytest.approx(teaches, abs=0.1)


def test_nothing_is_fitted_across_set_ups(data):
    describe(data, 'about = "made by a test"', 'set_ups = ["[ab]", "c*", "d"]')
    write(data, "c2", lines(3))
    write(data, "e", lines(4))
    on = {name: simulate(data, name)[1].notes["models"]["fitted_on"] for name in ("a", "b", "c", "c2")}
    assert on == {"a": ["b"], "b": ["a"], "c": ["c2"], "c2": ["c"]}
    assert simulate(data, fitted_on="all others")[1].notes["models"]["fitted_on"] == ["b", "c", "c2", "e"]
    assert "run 'e' has 0 other runs" in refused(data, "e")


def test_a_part_of_another_run_is_not_a_run_and_is_not_fitted_on(data):
    rows = lines(1)
    write(data, "b-end", rows[40:])
    write(data, "b-twice", rows)
    assert Log(data=data).at([1]).run == "b"
    assert Log(data=data).count() == 3
    on = {name: simulate(data, name)[1].notes["models"]["fitted_on"] for name in ("a", "b", "b-end", "b-twice")}
    assert on == {"a": ["b", "c"], "b": ["a", "c"], "b-end": ["a", "c"], "b-twice": ["a", "c"]}


def test_readings_that_are_correlated_in_time_are_assumed_noisier(data):
    for i, name in enumerate("bc", 1):
        write(data, name, lines(i, 1500, correlation=0.6))
    models = simulate(data)[1].notes["models"]
    assert models["residual_lag1"] == pytest.approx(0.6, abs=0.04)
    assert models["sigma"] == pytest.approx(2 * SIGMA, rel=0.1)  # sqrt(1.6 / 0.4) = 2
    assert simulate(data, correlation="ignore")[1].notes["models"]["sigma"] == models["residual_sd"]


def test_what_is_stated_is_not_fitted_and_overrides_win(data):
    describe(data, new="[model]\nA = -40\nsigma_v = 0.5\n")
    models = simulate(data, eta=2.5, turn_scale=1.0)[1].notes["models"]
    assert (models["A"], models["eta"], models["sigma_v"], models["turn_scale"]) == (-40, 2.5, 0.5, 1.0)
    assert models["residual_sd"] > SIGMA
    assert models["length_scale"] == pytest.approx(LENGTH, rel=0.02)


def test_noise_of_odometry_is_fitted(data):
    rng = np.random.default_rng(5)
    for i, name in enumerate("bc", 1):
        write(data, name, lines(i, 600))
        _, _, u = drive(i, 600)
        metres = np.cumsum(np.concatenate([[0], (u[:, 0] + rng.normal(0, 0.02, 600)) / LENGTH]))
        turn = (u[:, 1] + rng.normal(0, 0.1, 600)) / TURN
        cells = {(k, "turn"): f"{turn[k]:.9f}" for k in range(600)}
        change(data, name, cells | {(k, "metres"): f"{metres[k]:.9f}" for k in range(601)})
    models = simulate(data)[1].notes["models"]
    assert models["sigma_v"] == pytest.approx(0.02, rel=0.15)
    assert models["sigma_omega"] == pytest.approx(0.1, rel=0.35)  # of courses, so the mean of two turns


def test_a_single_run_needs_stated_models(single):
    truth, stream = simulate(single)
    assert stream.world.sensors["anchor_rssi"] == LogDistance(A, ETA, SIGMA)
    assert (stream.world.motion.sigma_v, stream.world.motion.sigma_omega) == (0.02, 0.03)
    assert stream.notes["models"]["fitted_on"] == []
    assert Log(data=single).count() == 1
    describe(single)
    message = refused(single)
    for part in ("'a' has 0 other runs", "sigma_v, sigma_omega, A, eta, sigma", "log.toml"):
        assert part in message
    stated = {"A": A, "eta": ETA, "sigma": SIGMA, "sigma_v": 0.02, "sigma_omega": 0.03}
    assert simulate(single, **stated)[1].hashes == stream.hashes
    assert truth.origin == stream.hashes


PRIORS = [
    ({"heading": "unknown"}, [2.0, 1.2, 0.0], [0.05, 0.05, np.pi / np.sqrt(3)], "heading: unknown"),
    ({"position": "arena", "heading": "unknown"}, [2, 1.5, 0], [4 / 12**0.5, 3 / 12**0.5, 1.814], "anywhere"),
    (
        {"position_sd": 0.3, "heading_sd": 0.4},
        None,
        [0.3, 0.3, 0.4],
        "first truth, assumed sd 0.3 m; heading: first motion",
    ),
]


@pytest.mark.parametrize(("overrides", "x", "sd", "says"), PRIORS)
def test_the_source_of_the_prior_is_declared(data, overrides, x, sd, says):
    _, stream = simulate(data, **overrides)
    if x is not None:
        np.testing.assert_allclose(stream.prior.x[0, 0], x, atol=1e-8)
    np.testing.assert_allclose(np.sqrt(np.diag(stream.prior.P[0, 0])), sd, atol=1e-3)
    assert says in stream.notes["prior"]


def test_a_prior_can_be_stated(data):
    describe(data, 'position = "first truth"', "position = [1.0, 2.0]")
    describe(data, 'heading = "first motion"', "heading = 4.0", text=(data / "log.toml").read_text())
    _, stream = simulate(data)
    np.testing.assert_allclose(stream.prior.x[0, 0], [1, 2, 4 - 2 * np.pi])
    assert stream.notes["prior"].startswith("stated position")


def test_the_first_motion_gives_the_heading_before_the_turns_that_led_to_it(data):
    _, pose, _ = drive(0)
    standing = [row[:] for row in lines(0)[:1] * 4]
    for k, row in enumerate(standing):
        row[1], row[4] = str(EPOCH - 4 + k), f"{0.5 / TURN:.9f}"  # turns on the spot by 4 x 0.5 rad
        row[5] = f"{2.0 + 1e-4 * k:.9f}"
    write(data, "a", standing + lines(0))
    _, stream = simulate(data, turn_scale=TURN)
    assert wrap(stream.prior.x[0, 0, 2] - (pose[0, 2] - 2.0)) == pytest.approx(0, abs=0.15)


def test_a_recorded_heading_is_truth_and_can_be_the_prior(data):
    describe(data, 'y = "y"', 'y = "y"\nheading = { column = "note", unit = "deg" }')
    for i, name in enumerate("abc"):
        change(data, name, {(k, "note"): f"{np.degrees(pose[2]):.9f}" for k, pose in enumerate(drive(i)[1])})
    truth, stream = simulate(data, heading="first truth")
    np.testing.assert_allclose(truth.x[0, :, 0], drive(0)[1][1:], atol=1e-8)
    np.testing.assert_allclose(stream.prior.x[0, 0], drive(0)[1][0], atol=1e-8)
    assert stream.notes["models"]["turn_scale"] == pytest.approx(TURN, rel=1e-6)
    assert stream.notes["models"]["sigma_omega"] < 1e-6


# A scenario, and its trials


def test_the_trials_of_all_are_the_runs(data):
    log = Log(data=data)
    assert log.count() == 3
    for k, name in enumerate("abc"):
        (truth, stream), (_, alone) = simulate(data, "all", [k]), simulate(data, name)
        assert stream.hashes == alone.hashes
        assert (int(truth.trial[0]), stream.notes["recording"]) == (k, f"lab/{name}.csv")
    assert "trials=[0]" in refused(data, "all", trials=[0, 1])
    assert "3 trials" in refused(data, "all", trials=[3])
    assert "1 trial," in refused(data, "a", trials=[1])
    with pytest.raises(BadInput, match="3 runs"):
        log.world()


def test_the_registry_knows_logs(data):
    truth, stream = scenarios.simulate("log/b", data=data)
    assert stream.notes["recording"] == "lab/b.csv"
    assert scenarios.simulate("log/all", data=data, trials=[1], seed=5)[1].hashes == stream.hashes
    assert scenarios.simulate("log", data=data)[1].notes["recording"] == "lab/a.csv"
    assumed = scenarios.simulate("log/b", data=data, assumed={"sigma": 9.0, "turn_scale": 3.0})[1]
    assert assumed.hashes != stream.hashes  # what the team assumes is part of what is compared
    np.testing.assert_array_equal(assumed.senses.anchor_rssi, stream.senses.anchor_rssi)
    assert assumed.world.sensors["anchor_rssi"].sigma == 9.0
    assert scenarios.simulate("log/b[sigma=9]", data=data)[1].scenario == "log/b[sigma=9]"
    assert truth.scenario == "log/b"
    with pytest.raises(BadInput, match=r"no run 'bb'; did you mean 'b'"):
        scenarios.simulate("log/bb", data=data)
    with pytest.raises(BadInput, match="ask for trials"):
        scenarios.simulate("log/all", data=data, trials=3)


def test_a_log_without_anchors_has_no_readings(data):
    text = DESCRIPTION[: DESCRIPTION.index("[anchors]")] + DESCRIPTION[DESCRIPTION.index("[prior]") :]
    describe(data, text="arena = [[0, 0], [6, 5]]\n" + text)
    _, stream = simulate(data)
    assert stream.channels() == {"odometry"}
    np.testing.assert_array_equal(stream.world.arena, [[0, 0], [6, 5]])


# Bad input


CELLS = [
    ({(-1, "turn"): "Turn"}, ["line 1", "no column 'turn'", "did you mean 'Turn'"]),
    ({(k, "x"): "" for k in range(TICKS)}, ["fewer than two lines have a truth"]),
]


@pytest.mark.parametrize(("cells", "says"), CELLS)
def test_a_malformed_line_is_named(data, cells, says):
    table = [COLUMNS[:], *lines(1)]
    for (row, column), text in cells.items():
        table[row + 1][COLUMNS.index(column)] = text
    (data / "b.csv").write_text("".join(",".join(row) + "\n" for row in table))
    message = refused(data)
    for part in ("b.csv", *says):
        assert part in message


REPAIRED = [
    ({(4, "x"): "north"}, "line 6: x is 'north', which is not a number; it counts as empty"),
    ({(4, "sec"): ""}, "left out 1 line whose stamp is missing"),
    ({(4, "sec"): str(EPOCH)}, "left out 1 line out of order"),
    ({(4, "note"): "one, too many"}, "line 6: 17 fields, not 16; it was left out"),
]


@pytest.mark.parametrize(("cells", "said"), REPAIRED)
def test_a_bad_line_is_left_out_and_said(data, cells, said):
    table = [COLUMNS[:], *lines(1)]
    for (row, column), text in cells.items():
        table[row + 1][COLUMNS.index(column)] = text
    (data / "b.csv").write_text("".join(",".join(row) + "\n" for row in table))
    found = read_run(data / "b.csv", schema.load_robot(data / "log.toml"))
    assert any("b.csv" in warning and said in warning for warning in found.counts["warnings"]), found.counts["warnings"]


TOML = [
    ('x = "x"', 'x = { column = "x", unit = "inch" }', ["line 12", "truth.x: ", "'inch'", "cm"]),
    ('x = "x"\n', "", ["line 11", "truth.x: it is missing"]),
    ("max_speed", "max_sped", ["line 15", "no key 'max_sped' in [truth]", "did you mean 'max_speed'"]),
    ("[anchors]", "[anchor]", ["no key 'anchor'", "did you mean 'anchors'"]),
    ("[4, 0]]", "[4, 0], [9, 9]]", ["5 positions have 4 rssi columns"]),
    ("[[0, 0], [0, 3], [4, 3], [4, 0]]", "[[0, 0], [0, 3], [0, 4], [0, 5]]", ["arena"]),
    ('length = "metres"\n', "", ["line 6", "odometry: ", "takes holds, length, turn_rate"]),
    ("position_sd = 0.05\n", "", ["line 20", "prior: ", "position_sd"]),
    ('heading = "first motion"', 'heading = "first truth"', ["heading column"]),
    ("max_gap = 5.0", "max_gap = inf", ["time.max_gap", "finite"]),
    ("[time]", "[time", ["cannot be read as TOML"]),
]


@pytest.mark.parametrize(("old", "new", "says"), TOML)
def test_a_malformed_description_is_named(data, old, new, says):
    describe(data, old, new)
    message = refused(data)
    for part in ("log.toml", *says):
        assert part in message


def test_what_is_not_there_is_named(data, tmp_path):
    assert "no run 'aa'; did you mean 'a'" in refused(data, "aa")
    assert "no such directory" in refused(tmp_path / "nowhere")
    assert "no such directory" in refused(data / "a.csv")
    (data / "a.csv").rename(data / "all.csv")
    assert "'all'" in refused(data)
    for path in data.glob("*.csv"):
        path.unlink()
    assert "matches '*.csv'" in refused(data)
    (data / "log.toml").unlink()
    assert "log.toml: there is no such file" in refused(data)


def test_what_cannot_be_fitted_or_known_is_named(data):
    describe(data, "[[0, 0], [0, 3], [4, 3], [4, 0]]", "[[4, 3], [4, 0], [0, 0], [0, 3]]")
    assert "does not fall with distance" in refused(data)
    describe(data)
    change(data, "a", {(k, axis): f"{1 + 1e-4 * k}" for k in range(TICKS + 1) for axis in "xy"})
    assert simulate(data)[1].notes["prior"].endswith("unknown of a, which hardly moved")
    assert "no true heading" in refused(data, heading="first truth")
    describe(data, 'position = "first truth"\nposition_sd = 0.05', 'position = "arena"')
    assert "position_sd" in refused(data, heading="unknown", position="first truth")


@pytest.mark.parametrize("override", [{"eta": -1}, {"heading": "north"}])
def test_a_bad_parameter_is_named(data, override):
    with pytest.raises(BadInput, match=next(iter(override))):
        scenarios.simulate("log/a", data=data, **override)


# The recordings of the paper's authors


REAL = Path(os.environ.get("COOPLOC_DATA", Path(__file__).parents[4] / "shared" / "data")) / "wifi-rssi"


@pytest.mark.skipif(
    not REAL.is_dir(), reason="the WiFi recordings are not here; set COOPLOC_DATA to where wifi-rssi/ lies"
)
def test_the_wifi_recordings():
    log = Log(data=REAL, described="wifi")
    assert (len(log.folder.runs), log.count()) == (12, 11)  # exp4.4.1 is the end of exp4.4
    names = ["dead-reckoning", "ekf-local", "ekf-local[anchor_reading=rssi]", "arl", "rssi-pf"]
    stale = 0
    for k in range(log.count()):
        truth, stream = scenarios.simulate("wifi/all", data=REAL, trials=[k])
        notes, models = stream.notes, stream.notes["models"]
        set_up = Path(notes["recording"]).name[:5]
        assert all(name.startswith(set_up) for name in models["fitted_on"])
        assert len(models["fitted_on"]) == {"corne": 4, "trial": 5}[set_up]
        assert 0.4 < models["eta"] < 1.6
        assert 4 < models["residual_sd"] < 5
        assert 0.5 < models["residual_lag1"] < 0.7
        assert np.nanmax(stream.senses.anchor_rssi) < -15
        stale += notes["truth_stale"]
        assert (notes["truth_jumps"], notes["truth_masked"]) == (0, [notes["truth_stale"]])
        gaps = [gap["seconds"] for gap in notes["gaps"]]
        assert gaps == ([pytest.approx(67, abs=0.1)] if "exp4.4" in notes["recording"] else [])
        assert errors(truth, run({name: make(name) for name in names}, stream))["rmse"].notna().all()
    assert stale == 100
