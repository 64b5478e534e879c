"""What is odd about the truth of a team's files: found, said with its size, and not blamed on something else."""

import re

import numpy as np
import pandas as pd
import pytest
from made_csv_teams import ROBOTS, changed, two_robots

import cooploc as cl
from cooploc.analysis.plot.worlds import finding

pytestmark = pytest.mark.slow  # a second each; test_checks and test_infer_columns are quick


def inspect_changed(folder, change, robots=ROBOTS):
    """Inspect the files of two robots, with the truth of some changed."""
    files = {name: pd.DataFrame(columns) for name, columns in two_robots(seconds=90).items()}
    for name in (f"truth_{robot}.csv" for robot in robots):
        files[name] = change(files[name])
    for name, table in files.items():
        table.to_csv(folder / name, index=False)
    return cl.inspect(folder).inspected


def moved(table, x, y, turned=0.0):
    """Positions moved in the robot's own axes [m], and headings turned [rad]."""
    c, s = np.cos(table["theta"]), np.sin(table["theta"])
    return table.assign(x=table.x + x * c - y * s, y=table.y + x * s + y * c, theta=table["theta"] + turned)


def spoiled(table, rows, metres):
    return table.assign(x=table.x + metres * np.isin(table.index, rows))


def noisy(table):
    noise = np.random.default_rng(0).normal(0, 0.1, (2, len(table)))
    return table.assign(x=table.x + noise[0], y=table.y + noise[1])


def turned(table):
    return table.assign(x=table.y, y=-table.x, theta=table["theta"] - np.pi / 2)


@pytest.mark.parametrize(
    ("change", "robots", "kind", "fact"),
    [
        (lambda t: t.assign(theta=0.7), ["red"], "heading", "the heading is 0.7 in every line"),
        (lambda t: moved(t, 0, 0, 0.3), ["red"], "heading", r"the heading is \+1[67] deg"),
        (lambda t: t.iloc[::50], ROBOTS, "coarse", "positions come every 5 s, in which the robot turns"),
        (lambda t: t.round({"x": 1, "y": 1}), ROBOTS, "coarse", "positions are in steps of 0.1 m"),
        (noisy, ROBOTS, "coarse", "positions scatter by 0.097 m"),
        (lambda t: spoiled(t, [200, 400], 0.6), ROBOTS, "jump", "2 positions jump away and back; the first 20.0 s"),
        (
            lambda t: spoiled(t, range(400, 900), 2.0),
            ["red"],
            "jump",
            "leaps by up to 2 m and stays; the first time 39.9",
        ),
        (lambda t: moved(t, 0.4, 0), ["red"], "places", "red 0.4. m behind, 0.0. m (left|right); they spread by"),
    ],
)
def test_a_fault_of_the_truth_is_named_with_its_size_and_no_other_is(tmp_path, change, robots, kind, fact):
    found = inspect_changed(tmp_path, change, robots).findings
    assert {f.kind for f in found} <= {kind, "gap"}
    assert {f.robot for f in found if f.kind == kind} == ({""} if kind == "places" else {*robots})
    assert all(re.search(fact, f.fact) for f in found if f.kind == kind)


def test_truths_in_frames_of_each_robots_own_are_no_biases_of_ranges(tmp_path):
    found = {f.kind: f for f in inspect_changed(tmp_path, lambda t: t.assign(x=t.x - t.x[0], y=t.y - t.y[0])).findings}
    assert "begin at 0, 0: each is in a frame of its own" in found["frame"].fact
    found = {f.kind: f for f in inspect_changed(tmp_path, lambda t: t.assign(x=t.x - 2), ["red"]).findings}
    assert "more than a bias; look whether truths and places are in one frame" in found["bias"].setting
    (found,) = inspect_changed(tmp_path, turned, ["red"]).findings
    assert "or are truths in two frames?" in found.setting


@pytest.mark.parametrize("table", ["truth", "odom"])
def test_a_file_that_was_copied_is_of_the_robot_that_it_fits(tmp_path, table):
    files = two_robots(seconds=90)
    files[f"{table}_blue.csv"] = files[f"{table}_red.csv"]
    for name, columns in files.items():
        pd.DataFrame(columns).to_csv(tmp_path / name, index=False)
    inspected = cl.inspect(tmp_path).inspected
    (found,) = (f for f in inspected.findings if f.kind == "robots")
    assert found.robot == "blue"
    assert "the same in every line" in found.fact
    assert not {f.kind for f in inspected.findings} & {"clock", "turn sign", "scale"}
    assert len(finding(found, inspected.log, inspected.corrected).axes) == 2


def test_headings_that_never_change_are_not_read(tmp_path):
    inspected = inspect_changed(tmp_path, lambda t: t.assign(theta=0.0))
    assert inspected.findings == ()
    assert any("theta, the same in every line while positions change" in line for line in inspected.unused)
    assert 'heading = "first motion"' in inspected.text
    straight = inspect_changed(tmp_path, lambda t: t.assign(theta=0.5, x=t.index / 20, y=t.index / 20 * np.tan(0.5)))
    assert 'heading = "theta"' in straight.text


def test_y_that_hardly_changes_is_up(tmp_path):
    def y_up(table):
        half = table.pop("theta") / 2
        turn = {"qx": 0.0, "qy": np.sin(half), "qz": 0.0, "qw": np.cos(half)}
        return table.assign(z=-table.y, y=0.4 + 0.002 * np.sin(table.index), **turn)

    inspected = inspect_changed(tmp_path, y_up)
    assert inspected.findings == ()
    assert "beside a y that hardly changes, perhaps up" in inspected.text
    for robot, series in zip(inspected.log.robots, inspected.log.truth, strict=True):
        own = pd.DataFrame(two_robots(seconds=90)[f"truth_{robot}.csv"])
        np.testing.assert_allclose(series.values, own[["x", "y", "theta"]])


@pytest.mark.parametrize("times", [4, 5])  # with 4 some span 10 m, and others less
def test_lengths_in_cm_are_told_from_mm_by_how_fast_robots_drive(tmp_path, times):
    larger = changed(
        **dict.fromkeys("xy", lambda x: 100 * times * x), **dict.fromkeys(("v", "range"), lambda v: times * v)
    )
    files = larger({name: pd.DataFrame(columns) for name, columns in two_robots(seconds=90).items()})
    for name, table in files.items():
        table.to_csv(tmp_path / name, index=False)
    assert np.ptp(files["truth_red.csv"]["x"]) > 1000  # of which alone mm are told
    inspected = cl.inspect(tmp_path).inspected
    assert all(f'{q} = {{ column = "{q}", unit = "cm" }}' in inspected.text for q in "xy")
    assert inspected.findings == ()


def test_robots_that_go_elsewhere_than_their_heading_go_to_the_side(tmp_path):
    found = inspect_changed(tmp_path, lambda t: t.assign(theta=np.sin(0.5 * (t.time - t.time[0])))).findings
    assert {f.robot for f in found if f.kind == "sideways"} == {*ROBOTS}
