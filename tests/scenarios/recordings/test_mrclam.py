"""The MRCLAM adapter, on small data sets written here in the same format, and on the real one where it lies around."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from cooploc import scenarios
from cooploc.estimators import make
from cooploc.estimators.errors import BadInput
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings import mrclam
from cooploc.scenarios.recordings.scenario import TeamFolder
from cooploc.scenarios.runner.run import run

EPOCH = 1248272000.0  # stamps are seconds of the day's clock, with milliseconds
SECONDS = 6.0
BARCODES = {1: 5, 2: 14, 3: 41, 4: 32, 5: 23}  # subject: two robots, three landmarks
PLACES = {5: (3.0, 1.0), 3: (-1.0, 2.0), 4: (0.5, -2.0)}  # not in the order of their numbers
DRIVES = {1: (0.5, 0.9, (0.0, 0.0, 2.0)), 2: (0.3, -0.7, (1.0, 1.0, -2.5))}  # v, omega, start
FIRST_COMMAND = {1: 0.1, 2: 0.25}  # so the prior is at 0.25 s


def pose(robot, t):
    """On a circle, from 0 s on; both robots cross the cut of the heading."""
    v, omega, (x, y, heading) = DRIVES[robot]
    a = heading + omega * t
    r = v / omega
    return np.stack([x + r * (np.sin(a) - np.sin(heading)), y - r * (np.cos(a) - np.cos(heading)), wrap(a)], -1)


def write(path, rows, end="\r\n"):
    """Four remarks, then tab-separated numbers; the first column of a robot's file is a time after EPOCH."""
    if path.name.startswith("Robot"):
        rows = [(f"{EPOCH + t:.3f}", *rest) for t, *rest in rows]
    lines = [f"# remark {i}" for i in range(4)] + ["  " + " \t ".join(map(str, row)) + " " for row in rows]
    path.write_bytes("".join(line + end for line in lines).encode())


def write_truth(data, robot, stamps):
    at = np.asarray(stamps)
    write(data / f"Robot{robot}_Groundtruth.dat", [(t, *p.round(8)) for t, p in zip(at, pose(robot, at), strict=True)])


@pytest.fixture
def data(tmp_path):
    write(tmp_path / "Barcodes.dat", BARCODES.items())
    write(tmp_path / "Landmark_Groundtruth.dat", [(s, *place, 1e-4, 1e-4) for s, place in PLACES.items()])
    for i, (v, omega, _) in DRIVES.items():
        write_truth(tmp_path, i, np.arange(0, SECONDS + 0.001, 0.016))
        stamps = np.arange(FIRST_COMMAND[i], SECONDS, 0.013)
        write(tmp_path / f"Robot{i}_Odometry.dat", [(t, v, omega) for t in stamps])
    write(tmp_path / "Robot1_Measurement.dat", [(1.01, 23, 3.0, 0.1), (1.09, 14, 1.5, -0.2), (2.26, 41, 2.0, 0.3)])
    write(tmp_path / "Robot2_Measurement.dat", [(1.31, 32, 1.0, 0.4), (3.0, 5, 2.5, -0.5)])
    return tmp_path


def simulate(data, sees="all", **overrides):
    return scenarios.simulate(f"mrclam/{sees}", data=data, **overrides)


def test_truth_is_recovered_on_the_grid_and_across_the_cut_of_the_heading(data):
    truth, stream = simulate(data)
    at = stream.time - EPOCH
    np.testing.assert_allclose(at, 0.25 + 0.1 * np.arange(1, len(at) + 1), atol=1e-6)
    for i in (1, 2):
        error = truth.x[0, :, i - 1] - pose(i, at)
        error[:, 2] = wrap(error[:, 2])
        assert np.abs(error).max() < 1e-4
        assert np.abs(np.diff(truth.x[0, :, i - 1, 2])).max() > 6  # it did cross
    assert truth.valid.all()
    assert truth.origin == stream.hashes
    assert stream.world.t0 == pytest.approx(EPOCH + 0.25)  # when every robot has truth and a command
    np.testing.assert_allclose(stream.prior.x[0], [pose(i, 0.25) for i in (1, 2)], atol=1e-4)


@pytest.mark.parametrize("end", [3.0, np.inf])
def test_truth_is_masked_where_it_was_not_recorded(data, end):
    stamps = np.arange(0, SECONDS + 0.001, 0.016)
    write_truth(data, 2, stamps[(stamps <= 2.0) | (stamps >= end)])
    truth, stream = simulate(data)
    at = stream.time - EPOCH
    expected = (at < 2.0) | (at > end)
    np.testing.assert_array_equal(truth.valid[0], np.stack([np.ones(len(at), bool), expected], -1))
    np.testing.assert_array_equal(np.isfinite(truth.x[0, :, 1]).all(-1), expected)
    assert stream.notes["truth_masked"] == [0, int((~expected).sum())]
    assert simulate(data, max_gap=2.0)[0].valid[0, :, 1].sum() == (len(at) if end == 3 else expected.sum())


def test_a_barcode_names_a_robot_or_a_landmark_and_a_reading_goes_to_the_nearest_tick(data):
    _, stream = simulate(data)
    landmark, sighting = stream.senses.landmark[0], stream.senses.sighting[0]
    assert landmark.shape == (57, 2, 3, 2)
    assert sighting.shape == (57, 2, 2, 2)
    cells = {  # tick k ends at 0.35 + 0.1 k
        ("landmark", 7, 0, 0): (3.0, 0.1),  # 1.01 s
        ("sighting", 7, 0, 1): (1.5, -0.2),  # 1.09 s
        ("landmark", 19, 0, 1): (2.0, 0.3),  # 2.26 s
        ("landmark", 10, 1, 2): (1.0, 0.4),  # 1.31 s
        ("sighting", 27, 1, 0): (2.5, -0.5),
    }
    for (channel, k, i, j), reading in cells.items():
        np.testing.assert_allclose(getattr(stream.senses, channel)[0, k, i, j], reading)
    assert np.isfinite(landmark[..., 0]).sum() + np.isfinite(sighting[..., 0]).sum() == len(cells)
    assert stream.notes["landmark"]["kept"] + stream.notes["sighting"]["kept"] == len(cells)


@pytest.mark.parametrize(("sees", "users"), [("all", [True, True]), ("one", [True, False]), ("none", [False, False])])
def test_who_uses_landmarks(data, sees, users):
    _, stream = simulate(data, sees)
    full = simulate(data)[1]
    assert stream.channels() == {"odometry", "landmark", "sighting"}
    np.testing.assert_array_equal(np.isfinite(stream.senses.landmark[0]).any((0, 2, 3)), users)
    np.testing.assert_array_equal(stream.senses.sighting, full.senses.sighting)
    run({name: make(name) for name in ("ekf-local", "ekf-joint")}, stream)


def test_what_is_dropped_is_counted_and_unknown_barcodes_are_named(data):
    rows = [(0.2, 23, 3.0, 0.1), (1.0, 5, 1.0, 0.0), (1.1, 99, 1.0, 0.0), (1.2, 99, 1.0, 0.0), (9.0, 41, 1.0, 0.0)]
    write(data / "Robot1_Measurement.dat", rows)
    _, stream = simulate(data)
    assert [line.split(": neither")[0] for line in stream.notes["warnings"]] == [
        "Robot1_Measurement.dat: left out 2 readings of 'barcode 99'",
        "Robot1_Measurement.dat: left out 1 reading of '1' by itself",
    ]
    assert stream.notes["landmark"] == {"readings": 3, "kept": 1, "collisions": 0, "outside_span": 2}
    assert not np.isfinite(stream.senses.sighting[0, :, [0, 1], [0, 1]]).any()
    assert str(data) not in json.dumps(stream.notes)


def test_a_clock_set_back_a_little_is_put_in_order_and_counted(data):
    stamps = [0.25, 1.0, 2.0, 1.9, 3.0, SECONDS]  # as in data set 9
    write(data / "Robot2_Odometry.dat", [(t, t, 0.0) for t in stamps])
    _, stream = simulate(data)
    k = int(np.flatnonzero(np.isclose(stream.time - EPOCH, 1.95))[0])
    assert stream.senses.odometry[0, k, 1, 0] == pytest.approx((1.0 + 1.9) / 2)
    assert stream.notes["warnings"] == ["Robot2_Odometry.dat: stamps step back, 1 time; they were sorted"]


def test_the_seed_changes_nothing_and_assumptions_leave_the_readings(data):
    truth, stream = simulate(data, seed=1)
    assert simulate(data, seed=2)[1].hashes == stream.hashes
    assumed = simulate(data, assumed={"sigma_range": 1.0})[1]
    assert assumed.hashes != stream.hashes  # what the team assumes is part of what is compared
    np.testing.assert_array_equal(assumed.senses.landmark, stream.senses.landmark)
    assert assumed.world.sensors["landmark"].R[0, 0] == 1.0
    assert (truth.trial, stream.seed) == (0, 1)


@pytest.mark.parametrize(
    ("name", "line", "text", "said"),
    [
        ("Robot1_Measurement.dat", 6, "1248272001.000 14.5 1 0", "14.5 is not a whole number"),
        ("Robot1_Measurement.dat", 6, "1248272001.000 \xe9 1 0", "barcode is 'é', which is not a number"),
        ("Barcodes.dat", 6, "2 5", "barcode 5 was given before"),
        ("Barcodes.dat", 6, "9 14", "subject 2 has no barcode"),
        ("Landmark_Groundtruth.dat", 6, "5 0 0 0 0", "subject 5 was given before"),
        ("Landmark_Groundtruth.dat", 6, "2 0 0 0 0", "landmark 2 has a robot's number"),
        ("Landmark_Groundtruth.dat", 6, "8 0 0 0 0", "Barcodes.dat: subject 8 has no barcode"),
        ("Robot1_Groundtruth.dat", 7, "1248272000.032 \t 1.0 \t 2.0", "line 7: 3 columns, not 4"),
        ("Robot2_Odometry.dat", 8, "1248272000.289 0.3 fast", "line 8: omega [rad/s] is 'fast', which is not a number"),
        ("Robot1_Odometry.dat", 20, "1248271999.000 0.3 0.1", "left out 1 line out of order"),
    ],
)
def test_a_bad_line_is_named_or_left_out(data, name, line, text, said):
    rows = (data / name).read_text().split("\n")
    rows[line - 1] = text
    (data / name).write_text("\n".join(rows), encoding="latin-1")
    try:
        lines = mrclam.read_run(data, "set", None).warnings
    except BadInput as e:
        lines = (str(e),)
    assert any(said in one and "\n" not in one for one in lines), lines


@pytest.mark.parametrize("kind", mrclam.FILES)
def test_a_robot_whose_file_is_lost_is_left_out(data, kind):
    (data / f"Robot1_{kind}.dat").write_text("\ufeff# only the head\n", encoding="utf-8")
    log = mrclam.read_run(data, "set", None)
    assert log.robots == ("2",)
    assert log.warnings[0].startswith(f"{data}/Robot1_{kind}.dat: the file is empty")
    (data / f"Robot2_{kind}.dat").unlink()
    with pytest.raises(BadInput, match=f"Robot1_{kind}.dat: the file is empty.*; get the file again$"):
        mrclam.read_run(data, "set", None)


@pytest.mark.parametrize(
    ("options", "said"),
    [({"start": 10.0}, "start=10"), ({"start": 2.0}, "robot 2 has no truth"), ({"trials": 2}, "trials=1")],
)
def test_a_part_or_trial_that_is_not_there_is_refused(data, options, said):
    stamps = np.arange(0, SECONDS + 0.001, 0.016)
    write_truth(data, 2, stamps[(stamps < 2.0) | (stamps > 3.0)])
    with pytest.raises(BadInput, match=said):
        simulate(data, **options)


def test_data_sets_are_runs_of_a_team_whose_models_are_fitted(data):
    (data / "log.toml").write_text('format = "mrclam"')
    folder = TeamFolder(data)
    assert folder.places == {data.name: data}
    log = folder.log(data.name)
    assert (log.robots, log.landmarks.names) == (("1", "2"), ("5", "3", "4"))
    assert {channel: len(readings.time) for channel, readings in log.readings.items()} == {"landmark": 3, "sighting": 2}


def test_robots_of_a_data_set_may_be_chosen_and_places_stand_in_its_files(data):
    (data / "log.toml").write_text('format = "mrclam"\nrobots = ["2"]')
    log = TeamFolder(data).log(data.name)
    assert (log.robots, [*log.readings]) == (("2",), ["landmark"])
    assert any("of '1': neither a robot of the team nor a landmark" in line for line in log.warnings)
    for text, said in (
        ('robots = ["2", "6"]', "there is no robot '6'; known are 1, 2"),
        ("[landmarks]\nplaces = { 5 = [0, 0] }", "has odometry, truth, readings and places in its files"),
    ):
        (data / "log.toml").write_text(f'format = "mrclam"\n{text}')
        with pytest.raises(BadInput, match=said):
            TeamFolder(data).log(data.name)


def test_the_directory_may_be_that_of_the_data_set_or_the_one_above_it(data, tmp_path_factory):
    above = tmp_path_factory.mktemp("above")
    shutil.copytree(data, above / "MRCLAM_Dataset1")
    _, inside = simulate(above)
    assert inside.notes["recording"] == "MRCLAM_Dataset1"
    assert inside.hashes == simulate(above / "MRCLAM_Dataset1")[1].hashes
    shutil.copytree(data, above / "MRCLAM_Dataset2")
    with pytest.raises(BadInput, match=r"above0 holds several data sets: name one, such as .*/MRCLAM_Dataset1"):
        simulate(above)
    with pytest.raises(BadInput, match=r"neither it nor a directory in it holds Barcodes\.dat"):
        simulate(tmp_path_factory.mktemp("none"))


REAL = Path(os.environ.get("COOPLOC_DATA", Path(__file__).parents[4] / "shared" / "data")) / "mrclam6"


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason="MRCLAM data set 6 is not here; set COOPLOC_DATA to where mrclam6/ lies")
def test_data_set_6():
    truth, stream = simulate(REAL)
    assert (stream.world.robots, len(stream.world.landmarks), stream.senses.landmark.shape[3]) == (5, 15, 15)
    assert len(stream.time) * 0.1 == pytest.approx(756, abs=1)  # robot 1's truth stops 128 s early
    assert 15 <= (~truth.valid[0, :, 3]).sum() <= 30  # robot 4's hole of 2 s, and one of half a second
    assert np.isfinite(stream.senses.odometry).all()
    seen = np.isfinite(stream.senses.landmark[0, ..., 0]).sum() + np.isfinite(stream.senses.sighting[0, ..., 0]).sum()
    counts = [stream.notes["landmark"], stream.notes["sighting"]]
    assert (sum(c["readings"] for c in counts), sum(c["kept"] for c in counts)) == (19377 - 6, seen)
    assert sum("'barcode" in line for line in stream.notes["warnings"]) == 3
    # The bearings fit the interpolated truth, so clocks, frames and barcodes are understood.
    delta = stream.world.landmarks - truth.x[0, :, :, None, :2]
    expected = np.arctan2(delta[..., 1], delta[..., 0]) - truth.x[0, :, :, None, 2]
    assert np.nanmedian(np.abs(wrap(stream.senses.landmark[0, ..., 1] - expected))) < 0.01
