"""Exports of motion capture systems: the poses that were written, whatever is up and in which units."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cooploc as cl
from cooploc.scenarios.recordings import motion_capture

TIME = np.arange(50) / 10
POSES = {"red": (1 + 0.1 * TIME, 2 - 0.2 * TIME, 0.3 * TIME - 1), "rover 2": (3 * np.cos(TIME), np.sin(TIME), TIME - 2)}


def motive(up, rotation, unit):
    """Two bodies and a marker, as Motive writes them with Y or Z up."""
    scale = {"Meters": 1.0, "Millimeters": 1000.0}[unit]
    angles = "XYZW" if rotation == "Quaternion" else "XYZ"
    kinds = [*["Rotation"] * len(angles), *["Position"] * 3, "Mean Marker Error"]
    rows = [["", "Type"], ["", "Name"], ["", "ID"], ["", ""], ["Frame", "Time (Seconds)"]]
    columns = [np.arange(len(TIME)), TIME]
    for name, (x, y, h) in POSES.items():
        words = [["Rigid Body"] * len(kinds), [name] * len(kinds), ["1"] * len(kinds), kinds, [*angles, *"XYZ", ""]]
        rows = [row + more for row, more in zip(rows, words, strict=True)]
        zero = 0 * h
        about = {"Z": (zero, zero, np.sin(h / 2)), "Y": (zero, np.sin(h / 2), zero)}[up]
        turned = (
            [*about, np.cos(h / 2)] if rotation == "Quaternion" else [np.degrees(h) * (up == axis) for axis in "XYZ"]
        )
        at = (x, y, zero + 0.1) if up == "Z" else (x, zero + 0.1, -y)
        columns += [*turned, *(scale * value for value in at), zero]
    for row, word in zip(rows, ("Marker", "red:Marker1", "2", "Position", "X"), strict=True):
        row.append(word)
    head = f"Format Version,1.23,Take Name,Monday,Rotation Type,{rotation},Length Units,{unit},Coordinate Space,Global"
    lines = [",".join(f"{value:.9f}" for value in line) for line in np.transpose([*columns, TIME])]
    lines[7] = ",".join(lines[7].split(",")[:2] + [""] * (len(columns) - 1))  # nothing was seen
    return "\n".join([head, "", *(",".join(row) for row in rows), *lines])[:-30]  # the last line is torn


def vicon():
    """Two objects as Tracker writes them, with 10 frames a second, in mm."""
    lines = [
        "Objects",
        "10",
        ",,Global Angle red:red,,,,,,rover 2,,,,,",
        "Frame,Sub Frame," + ",".join(["RX,RY,RZ,TX,TY,TZ"] * 2),
    ]
    lines += [",," + ",".join(["rad,rad,rad,mm,mm,mm"] * 2)]
    for k in range(len(TIME)):
        own = [(0, 0, h[k], 1000 * x[k], 1000 * y[k], 30) for x, y, h in POSES.values()]
        lines.append(",".join([str(k + 1), "0", *(f"{value:.9f}" for value in np.ravel(own))]))
    return "\n".join(lines) + "\n"


EXPORTS = [motive("Z", "Quaternion", "Meters"), motive("Y", "Quaternion", "Millimeters"), motive("Y", "XYZ", "Meters")]


@pytest.mark.parametrize("text", [*EXPORTS, motive("Z", "XYZ", "Meters"), vicon()])
def test_poses_are_those_that_were_written(text):
    table = motion_capture.table_of(text)
    known = np.setdiff1d(np.arange(len(TIME) - 1), [7] if text.startswith("Format") else [])
    assert {*table["robot"]} == {*POSES}
    for name, (x, y, h) in POSES.items():
        of = table[table["robot"] == name].reset_index()
        heading = of["yaw"] if "yaw" in of else 2 * np.arctan2(of["qz"], of["qw"])
        pairs = ((of["time"], TIME), (of["x"], x), (of["y"], y), (np.sin(heading), np.sin(h)))
        for found, true in pairs:
            np.testing.assert_allclose(found[known], true[known], atol=1e-6)


def test_robots_that_drive_along_x_on_two_lanes_show_what_is_up():
    lanes = "Objects\n10\n,,a:a,,,,,,b:b,,,,,\nFrame,Sub Frame,RX,RY,RZ,TX,TY,TZ,RX,RY,RZ,TX,TY,TZ\n" + "," * 13 + "\n"
    for k in range(20):  # they shake more up and down than aside
        lanes += f"{k + 1},0,0,0,0,{100 * k},1000,{5 * (k % 3)},0,0,0,{90 * k},2000,{5 * (k % 2)}\n"
    assert {*motion_capture.table_of(lanes)["y"]} == {1.0, 2.0}


def test_other_texts_are_none():
    for text in (
        "time,x,y\n1,2,3\n",
        "Format Version,1.23\nFrame\n",
        "Objects\n50\n",
        "Objects\n50\n,,a\nFrame,Sub Frame\n,,\n",
    ):
        assert motion_capture.table_of(text) is None


@pytest.mark.slow
@given(
    st.sampled_from([*EXPORTS, vicon()]),
    st.lists(
        st.tuples(
            st.floats(0, 1, exclude_max=True), st.integers(0, 60), st.sampled_from(["", ",", "\n", '"', "x", "-"])
        )
    ),
)
def test_a_damaged_export_is_a_table_or_none(text, harm):
    for place, cut, instead in harm:
        at = int(place * len(text))
        text = text[:at] + instead + text[at + cut :]
    table = motion_capture.table_of(text)
    assert table is None or {"time", "robot", "x", "y"} <= {*table}


def test_an_export_beside_odometry_is_the_truth(tmp_path):
    for name, (x, y, h) in POSES.items():
        speed = np.hypot(np.gradient(x, TIME), np.gradient(y, TIME))
        lines = [f"{t},{v},{w}" for t, v, w in zip(TIME, speed, np.gradient(h, TIME), strict=True)]
        (tmp_path / f"odom_{name.replace(' ', '')}.csv").write_text("time,v,w\n" + "\n".join(lines) + "\n")
    (tmp_path / "Take 2026.csv").write_text(motive("Y", "Quaternion", "Meters"))
    log = cl.inspect(tmp_path).inspected.log
    for series, (x, _, _) in zip(log.truth, POSES.values(), strict=True):
        np.testing.assert_allclose(series.values[:, 0], np.interp(series.time, TIME, x), atol=1e-6)
