"""Every drafted log.toml runs: of whole recordings, and with robots that are missing or late."""

import os
import re
from pathlib import Path
from types import SimpleNamespace

import made_bags
import numpy as np
import pandas as pd
import pytest
from made_bags import KINDS, made_bag
from made_csv_teams import eight_glitches, two_robots, write

import cooploc as cl
import cooploc.inspection
from cooploc.analysis.execution.run import prepare
from cooploc.analysis.metrics.errors import demand_same_streams
from cooploc.estimators.errors import BadInput
from cooploc.scenarios import resolve
from cooploc.scenarios.recordings import scenario
from cooploc.scenarios.recordings.inspect import inspection
from cooploc.scenarios.recordings.inspect.draft_toml import common_span
from cooploc.scenarios.recordings.sampling import span
from cooploc.scenarios.studies.study import load, resolve_study

DATA = Path(os.environ.get("COOPLOC_DATA", "../shared/data"))
STARTS = {"A": (0, 0), "B": (1, 2)}
POSES = [f"VERTEX_SE2 {k} {r}{k} {x + 0.05 * k} {y} 0.0\n" for r, (x, y) in STARTS.items() for k in range(40)]
STEPS = [f"EDGE_SE2 {k} {r}{k} {r}{k + 1} 0.05 0 0 0.01 0 0 0.01 0 0.001\n" for r in STARTS for k in range(39)]


def made_graph(folder):
    (folder / "graph.pyfg").write_text("".join(POSES + STEPS))


def still_runs(folder):
    """Two runs whose odometry says nothing: filters are given the same, and the truth is another."""
    for run, speed in enumerate((0.02, 0.04)):
        k = np.arange(40.0)
        columns = {"x": 3 + speed * k, "y": 3.0 + 0 * k, "time": k + 1000 * run, "dx": 0 * k, "dy": 0 * k}
        pd.DataFrame(columns).to_csv(folder / f"run{run}.csv", index=False)


MADE = {
    "still": still_runs,
    "glitches": lambda folder: eight_glitches(folder),
    "graph": made_graph,
    **{f"bag {kind}": lambda folder, kind=kind: made_bag(folder, kind, seconds=20.0) for kind in KINDS},
}
CHANGES = ("a robot less", "a late robot", "a tenth")
TRIED = [(name, "whole") for name in MADE] + [("glitches", change) for change in CHANGES]
TWO, FOUR = "uwb-tiers/two-robots", "uwb-tiers/four-robots"
REAL = [("wifi-rssi", "whole"), ("mrclam6", "a tenth"), (TWO, "whole"), (TWO, "a robot less"), (FOUR, "a late robot")]


def cut(record, kept):
    """Some of the samples of a series or readings."""
    return record._replace(**{name: a[kept] for name, a in record._asdict().items() if isinstance(a, np.ndarray)})


def changed(log, change):
    """The recording without its last robot, with one that begins in the middle, or the tenth of it in the middle."""
    begin, end = min(s.time[0] for s in log.odometry), max(s.time[-1] for s in log.odometry)
    if change == "a tenth":
        begin, end = begin + 0.45 * (end - begin), begin + 0.55 * (end - begin)
    last = len(log.robots) - 1
    starts = [begin] * last + [(begin + end) / 2 if change == "a late robot" else begin]
    odometry, truth = (
        tuple(s and cut(s, (s.time >= start) & (s.time <= end)) for s, start in zip(each, starts, strict=True))
        for each in (log.odometry, log.truth)
    )
    robots, readings = log.robots, {c: cut(r, (r.time >= begin) & (r.time <= end)) for c, r in log.readings.items()}
    if change == "a robot less" and last > 0:
        robots, odometry, truth = robots[:-1], odometry[:-1], truth[:-1]
        for c, r in readings.items():
            mutual = c in ("range", "rssi", "sighting")
            readings[c] = cut(r, (r.robot < last) & ((r.other < last) | (not mutual)))
    readings = {c: r for c, r in readings.items() if len(r.time)}
    return log._replace(robots=robots, odometry=odometry, truth=truth, readings=readings)


def require_run_of_draft(folder, out, change, monkeypatch):
    reader = scenario.reader

    def cut_reader(form):
        found = reader(form)
        return SimpleNamespace(find_runs=found.find_runs, read_run=lambda *args: changed(found.read_run(*args), change))

    for module in (scenario, inspection):
        monkeypatch.setattr(module, "reader", cut_reader)
    found = cl.inspect(folder)
    assert found.inspected.trial.problem == ""
    assert found.inspected.trial.lines
    if change != "whole":  # what is drawn is looked at once for each recording
        monkeypatch.setattr(cooploc.inspection, "inspection_page", lambda found, sketch: "")
        monkeypatch.setattr(cooploc.inspection.Inspection, "sketch", lambda self, path: path.write_bytes(b""))
    found.write(out)
    errors = []
    runs = sum(": 1 robot" in line or " robots, " in line for line in found.inspected.trial.lines)
    for trial in range(min(runs, 3)):
        truth, stream = cl.simulate("log/all", trials=[trial], data=out)
        assert truth.valid.any()
        errors.append(cl.errors(truth, cl.run(["dead-reckoning"], stream)))
        assert np.isfinite(errors[-1]["rmse"]).all()
    demand_same_streams(pd.concat(errors, ignore_index=True))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "change"), TRIED)
def test_the_draft_of_a_made_recording_runs(tmp_path, name, change, monkeypatch):
    (tmp_path / "made").mkdir()
    MADE[name](tmp_path / "made")
    require_run_of_draft(tmp_path / "made", tmp_path / "out", change, monkeypatch)


def tum_files(folder):
    for name, columns in two_robots(seconds=40).items():
        kind, _, robot = name.partition("_")
        if kind == "truth":
            t, x, y, h = columns.values()
            rows = np.stack([t, x, y, 0 * x, 0 * x, 0 * x, np.sin(h / 2), np.cos(h / 2)], -1)
            for side in ("gt", "odom"):
                np.savetxt(folder / f"{robot[:-4]}_{side}.tum", rows, fmt="%.4f")


def mrclam_files(folder):
    angles = 0.02 * np.arange(400)
    at = np.stack([1_248_000_000 + angles / 0.2, np.cos(angles), np.sin(angles), angles + np.pi / 2], -1)
    for robot in "12":
        np.savetxt(folder / f"Robot{robot}_Groundtruth.dat", at, fmt="%.4f")
        np.savetxt(folder / f"Robot{robot}_Odometry.dat", np.insert(at[:, :1], 1, [[0.2], [0.2]], 1), fmt="%.4f")
        np.savetxt(folder / f"Robot{robot}_Measurement.dat", [[t, 6, 2.0, 0.1] for t in at[::9, 0]], fmt="%.4f")
    (folder / "Barcodes.dat").write_text("1 5\n2 14\n6 6\n")
    (folder / "Landmark_Groundtruth.dat").write_text("6 3 0 0.001 0.001\n")


def torn(make, pattern):
    """The recording, and a line that is cut off in the middle of one file."""

    def tear(folder):
        make(folder)
        path = next(folder.glob(pattern))
        lines = path.read_text().split("\n")
        path.write_text("\n".join([*lines[:60], lines[60][:9], *lines[61:]]))

    return tear


FAULTS = {
    "csv": (torn(lambda folder: write(folder, two_robots(seconds=40)), "truth_red.csv"), "line 61: 1 field, not 4"),
    "tum": (torn(tum_files, "red_gt.tum"), "line 61: 1 field, not 8"),
    "graph": (torn(made_graph, "graph.pyfg"), "1 lines of 'VERTEX_SE', which is not read"),
    "mrclam": (torn(mrclam_files, "Robot2_Odometry.dat"), "line 61: 1 columns, not 3"),
    "bag": (lambda folder: made_bag(folder, "mcap", 20.0, behind=900), "900.0 s behind"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_a_strict_run_refuses_what_another_mends_and_says(tmp_path, name):
    make, said = FAULTS[name]
    (tmp_path / "made").mkdir()
    make(tmp_path / "made")
    found = cl.inspect(tmp_path / "made")
    assert found.inspected.trial.problem == ""
    assert any(said in line for line in found.inspected.faults)
    found.write(tmp_path / "out")
    study = resolve_study(load("log"), tmp_path / "out")
    assert any(said in line for line in study.cells[0].scenario.explanations())
    with pytest.raises(BadInput, match="mend the recording, or leave out --strict"):
        prepare(load("log"), tmp_path / "out", strict=True)


@pytest.mark.slow
@pytest.mark.parametrize("change", ["no odometry", "no truth", "much too late"])
def test_a_draft_leaves_out_a_robot_that_lacks_a_series(tmp_path, change):
    files = two_robots(seconds=60)
    if change == "much too late":
        files["odom_red.csv"] = {name: column[-30:] for name, column in files["odom_red.csv"].items()}
    else:
        del files["odom_red.csv" if change == "no odometry" else "truth_red.csv"]
    found = cl.inspect(write(tmp_path / "team", files))
    found.write()
    assert found.inspected.trial.problem == ""
    there = {"no odometry": "truth of it and no odometry", "no truth": "odometry of it and no truth"}.get(change)
    assert (f"robot 'red', as there is {there}" in found.inspected.unused) == (there is not None)
    truth, stream = cl.simulate("log/all", data=tmp_path / "team")
    assert stream.robots == 1
    assert truth.valid.mean() > 0.9


@pytest.mark.slow
def test_a_robot_whose_odometry_is_empty_is_named_and_the_draft_leaves_no_traceback(tmp_path):
    log = inspection.inspect_recording(write(tmp_path / "team", two_robots(seconds=60))).log
    cut_out = log._replace(odometry=(cut(log.odometry[0], log.odometry[0].time < 0), log.odometry[1]))
    with pytest.raises(BadInput, match=r"has no odometry: leave that robot out of robots in log\.toml"):
        span(cut_out)
    assert common_span(cut_out) == 0.0


def test_a_run_that_repeats_another_is_left_out_and_named(tmp_path):
    still_runs(tmp_path)
    lines = cl.inspect(tmp_path).inspected.trial.lines
    assert lines[-1] == f"{tmp_path}: run 'run1' was left out: it repeats run 'run0'"


@pytest.mark.slow
def test_a_draft_that_does_not_run_says_what_to_state(tmp_path):
    files = two_robots(seconds=60)
    for name in ("truth_red.csv", "truth_blue.csv"):
        files[name]["time"] = files[name]["time"] - 1.6e9
    assert "state clock_offset" in cl.inspect(write(tmp_path / "team", files)).inspected.trial.problem


@pytest.mark.slow
def test_models_of_a_recording_that_is_too_short_to_be_fitted_are_assumed(tmp_path):
    found = cl.inspect(write(tmp_path / "team", two_robots(seconds=4)))
    found.write()
    assert 'on = "nothing"' in found.log_toml
    assert "assumed, as the recording is too short" in found.log_toml
    assert cl.simulate("log/all", data=tmp_path / "team")[1].world.motion.sigma_v == 0.05


@pytest.mark.slow
def test_readings_by_another_clock_are_refused_until_its_offset_is_stated(tmp_path):
    files = two_robots(seconds=60)
    files["uwb.csv"]["time"] = files["uwb.csv"]["time"] - 1.6e9
    found = cl.inspect(write(tmp_path / "team", files))
    (home,) = (path for path in found.write() if path.name == "log.toml")
    assert "share no time: state clock_offset" in found.inspected.trial.problem
    assert "range_sigma" not in found.log_toml  # it is to be fitted once the clock is right
    home.write_text(found.log_toml.replace("[ranges]", "[ranges]\nclock_offset = 1.6e9"))
    assert 0.02 < cl.simulate("log/all", data=home.parent)[1].world.sensors["radio_range"].sigma < 0.1


@pytest.mark.slow
def test_a_run_whose_readings_are_of_another_clock_is_left_out_of_all(tmp_path):
    for seed, run in enumerate(("monday", "tuesday", "friday"), 1):
        files = two_robots(seed=seed, seconds=40)
        files["uwb.csv"]["time"] = files["uwb.csv"]["time"] + 1000.0 * (run == "tuesday")
        write(tmp_path / "team" / run, files)
    found = cl.inspect(tmp_path / "team")
    found.write()
    assert not found.inspected.trial.problem
    scenario = resolve("log/all", data=tmp_path / "team").model
    assert scenario.count() == 2
    assert [*scenario.left_out] == ["tuesday"]
    assert re.search("share no time: state clock_offset.*; it was left out", scenario.left_out["tuesday"])


@pytest.mark.slow
@pytest.mark.parametrize(("late", "table"), [((), "truth"), (("odom_red.csv", "uwb.csv"), "odometry")])
def test_a_robot_with_a_clock_of_its_own_is_told_from_a_truth_with_another(tmp_path, late, table):
    files = two_robots(seconds=60)
    for name in late or ("truth_red.csv",):
        time = files[name]["time"]
        files[name]["time"] = np.where(files[name].get("from", "red") == "red", time + 4.0, time)
    found = cl.inspect(write(tmp_path / "team", files))
    (clock,) = (one for one in found.inspected.findings if one.kind == "clock")
    assert (clock.robot, clock.table) == ("red", table)
    setting = re.match("clock_offset = { red = (.*) }", clock.setting)
    assert float(setting[1]) == pytest.approx(-4.0, abs=0.1)
    assert ("also in [ranges]" in clock.setting) == bool(late)
    text = found.log_toml
    for of in (table, "ranges") if late else (table,):
        text = text.replace(f"\n[{of}]\n", f"\n[{of}]\n{setting[0]}\n")
    (tmp_path / "team/log.toml").write_text(text)
    cl.inspect(write(tmp_path / "clean", two_robots(seconds=60))).write()
    corrected, clean = (
        cl.simulate("log/all", data=tmp_path / folder)[1].world.sensors["radio_range"].sigma
        for folder in ("team", "clean")
    )
    assert corrected == pytest.approx(clean, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(("kept", "assumed", "said"), [(slice(150, None), 0.2, 0), (slice(90), 0.05, 1)])
def test_of_readings_that_are_there_for_a_part_their_models_alone_are_assumed(tmp_path, kept, assumed, said):
    files = two_robots(seconds=60)
    files["uwb.csv"] = {name: column[kept] for name, column in files["uwb.csv"].items()}
    found = cl.inspect(write(tmp_path / "team", files))
    found.write()
    assert not found.inspected.trial.problem
    _, stream = cl.simulate("log/all", data=tmp_path / "team")
    assert stream.world.sensors["radio_range"].sigma == pytest.approx(assumed, rel=0.3)
    assert "first 20 s" in stream.notes["models"]["fitted_on"]
    explained = resolve("log/all", data=tmp_path / "team").explanations()
    assert sum("no range reading is in the part that is judged" in line for line in explained) == said


@pytest.mark.slow
def test_a_run_that_was_made_in_the_folder_of_a_recording_is_no_part_of_it(tmp_path, monkeypatch):
    cl.inspect(write(tmp_path / "team", two_robots(seconds=40))).write()
    monkeypatch.chdir(tmp_path / "team")
    cl.run_study("log/all", estimators=["dead-reckoning"], data=".")
    assert [*(tmp_path / "team").glob("runs/*/manifest.json")]
    assert cl.inspect(".", again=True).inspected.unused == ()


@pytest.mark.slow
def test_a_run_says_where_a_robot_has_no_odometry(tmp_path):
    files = two_robots(seconds=60)
    files["odom_red.csv"] = {name: np.delete(column, slice(250, 400)) for name, column in files["odom_red.csv"].items()}
    cl.inspect(write(tmp_path / "team", files)).write()
    (line,) = (one for one in resolve("log/all", data=tmp_path / "team").explanations() if "no odometry in" in one)
    assert re.search(r"red has no odometry in 1\d\d of 39\d ticks; filters take it to stand there", line)


@pytest.mark.slow
@pytest.mark.skipif(not DATA.exists(), reason="needs ../shared/data")
@pytest.mark.parametrize(("place", "change"), REAL)
def test_the_draft_of_a_real_recording_runs(tmp_path, place, change, monkeypatch):
    require_run_of_draft(DATA / place, tmp_path / "out", change, monkeypatch)


@pytest.mark.slow
def test_a_bag_without_truth_is_inspected(tmp_path, monkeypatch):
    without = {topic: name for topic, name in made_bags.TOPICS.items() if "mocap" not in topic and "amcl" not in topic}
    monkeypatch.setattr(made_bags, "TOPICS", without)
    found = cl.inspect(made_bag(tmp_path, "sqlite3", seconds=20.0)[0])
    assert {*found.series["series"]} >= {"odometry", "range"}
    assert found.inspected.unused[0].startswith("truth, as no pose has the name or number of a robot with odometry")
    assert "no robot has a truth to be judged by" in found.inspected.trial.problem
    assert {path.name for path in found.write(tmp_path / "out")} == {"log.toml", "inspect.png", "inspect.html"}
