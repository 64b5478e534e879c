"""Twelve robots, whose numbers are parts of each other's, as in robot_1 and robot_12, or of a kind, as in tb3_3."""

import itertools

import numpy as np
import pandas as pd
import pytest
from made_bags import pose_at, write_messages
from made_team import drive

from cooploc.scenarios.recordings.inspect.inspection import inspect_recording

N, START = 12, 1_700_000_000.0


def team():
    """Stamps, poses and controls of each robot, and ranges: (time, robot, other, range)."""
    motions, rng = drive(3, 30.0, N), np.random.default_rng(3)
    t = START + np.arange(len(motions.time[:-1:2])) / 10
    pose, control = motions.pose[:-1:2], (motions.u[::2] + motions.u[1::2]) / 2
    ranges = []
    for k, (i, step) in itertools.product(range(0, len(t), 10), itertools.product(range(N), (1, 3, 5, 7))):
        j = (i + step) % N
        distance = float(np.hypot(*(pose[k, i, :2] - pose[k, j, :2])) + rng.normal(0, 0.03))
        ranges.append((t[k], i, j, distance))
    return t, pose, control, ranges


def write_motion(folder, name):
    t, pose, control, ranges = team()
    for i in range(N):
        odometry = {"time": t, "v": control[:, i, 0], "omega": control[:, i, 1]}
        pd.DataFrame(odometry).to_csv(folder / f"odom_{name(i)}.csv", index=False)
        true = {"time": t, "x": pose[:, i, 0], "y": pose[:, i, 1], "yaw": pose[:, i, 2]}
        pd.DataFrame(true).to_csv(folder / f"truth_{name(i)}.csv", index=False)
    return ranges


def in_one_file(folder, ranges, name):
    lines = [(t, i + 1, j + 1, d) for t, i, j, d in ranges]
    pd.DataFrame(lines, columns=["time", "src", "dst", "d"]).to_csv(folder / "uwb.csv", index=False)


def in_a_file_each(folder, ranges, name):
    for i in range(N):
        lines = [(t, name(j), d) for t, of, j, d in ranges if of == i]
        pd.DataFrame(lines, columns=["time", "to", "range"]).to_csv(folder / f"uwb_{name(i)}.csv", index=False)


def in_a_column_each(folder, ranges, name):
    for i in range(N):
        lines = [{"time": t, f"d_{name(j)}": d} for t, of, j, d in ranges if of == i]
        table = pd.DataFrame(lines).groupby("time", as_index=False).first()
        for j in {*range(N)} - {i}:
            table[f"d_{name(j)}"] = table.get(f"d_{name(j)}", np.nan)
        table.to_csv(folder / f"uwb_{name(i)}.csv", index=False)


@pytest.mark.slow
@pytest.mark.parametrize("form", [in_one_file, in_a_file_each, in_a_column_each])
@pytest.mark.parametrize("kind", ["robot_{}", "tb3_{}"])
def test_ranges_in_text_files_are_of_whom_they_name(tmp_path, kind, form):
    def name(i):
        return kind.format(i + (kind == "robot_{}"))

    ranges = write_motion(tmp_path, name)
    form(tmp_path, ranges, name)
    check(tmp_path, ranges)


LINK = {
    "lab_msgs/msg/Node": "uint8 id\nfloat32 dis",
    "lab_msgs/msg/Nodes": "uint8 role\nuint8 id\nlab_msgs/Node[] nodes",
    "lab_msgs/msg/Link": "std_msgs/Header header\nuint8 src_id\nuint8 dst_id\nfloat32 distance",
}
MESSAGES = {
    "a topic each": lambda i, j, d: (
        f"/robot_{i}/nodes",
        "lab_msgs/msg/Nodes",
        {"id": i, "nodes": [{"id": j, "dis": d}]},
    ),
    "one topic": lambda i, j, d: ("/uwb", "lab_msgs/msg/Link", {"src_id": i, "dst_id": j, "distance": d}),
    "other numbers": lambda i, j, d: ("/uwb", "lab_msgs/msg/Link", {"src_id": i + 32, "dst_id": j + 32, "distance": d}),
    "names": lambda i, j, d: (f"/uwb/robot_{i}/robot_{j}", "sensor_msgs/msg/Range", {"range": d}),
    "a topic of two": lambda i, j, d: (f"/robot_{i}/range_{j}", "sensor_msgs/msg/Range", {"range": d}),
}


TOPICS = {
    "names": ("/robot_{}/odom", "/mocap/robot_{}"),
    "numbers": ("/robot_{}/odom", "/mocap_{}/pose"),
    "numbers alone": ("/odom_robot_{}", "/pose_robot_{}"),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("topics", "form"), [*(("names", form) for form in MESSAGES), ("numbers", "names"), ("numbers alone", "names")]
)
def test_ranges_in_bags_are_of_whom_they_name(tmp_path, topics, form):
    t, pose, _, ranges = team()
    odometry, truth = TOPICS[topics]
    made = []
    for i, k in itertools.product(range(N), range(len(t))):
        x, y, heading = pose[k, i]
        at = pose_at(x, y, 0.1, heading, "pose.")
        made.append((truth.format(i + 1), "geometry_msgs/msg/PoseStamped", t[k], at))
        at = pose_at(x, y, 0.0, heading, "pose.pose.")
        made.append((odometry.format(i + 1), "nav_msgs/msg/Odometry", t[k], at))
    for when, i, j, d in ranges:
        topic, kind, fields = MESSAGES[form](i + 1, j + 1, d)
        made.append((topic, kind, when, fields))
    write_messages(tmp_path / "team", made, LINK)
    check(tmp_path, ranges)


def check(folder, ranges):
    """Each reading is there once, and of its robots: by the true distance."""
    found = inspect_recording(folder)
    log = found.log
    assert found.findings == ()
    assert len(log.robots) == N
    readings = log.readings["range"]
    assert len(readings.time) == len(ranges)
    at = [np.stack([np.interp(readings.time, s.time, s.values[:, k]) for k in (0, 1)], -1) for s in log.truth]
    rows = np.arange(len(readings.time))
    apart = np.stack(at)[readings.robot, rows] - np.stack(at)[readings.other, rows]
    np.testing.assert_allclose(readings.values[:, 0], np.hypot(*apart.T), atol=0.2)
