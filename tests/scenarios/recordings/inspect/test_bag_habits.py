"""Habits of people who record bags: a bag for each robot, the truth in text files, a simulator's, files compressed."""

import numpy as np
import pytest
from made_bags import START, made_bag, write_messages

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings import bags
from cooploc.scenarios.recordings.bags import Fields, find_runs, read_topics
from cooploc.scenarios.recordings.inspect.bag_draft import bag_draft, topics_by_robot
from cooploc.scenarios.recordings.inspect.inspection import inspect_recording

pytestmark = pytest.mark.slow  # a second each; test_checks and test_infer_columns are quick
SECONDS = 30.0
MOCAP = {"/mocap/red": "/mocap/red", "/mocap/blue": "/mocap/blue"}


def write_truth(folder, name, separator=","):
    """The circles of `made_bag` as text, of each robot: with names of columns, or as TUM has them, without."""
    folder.mkdir(exist_ok=True)
    for robot, side in (("red", 0.0), ("blue", np.pi)):
        t = np.arange(0, SECONDS, 0.1)
        angle, zero = 0.1 * t + side, np.zeros(len(t))
        half = (angle + np.pi / 2 - 2 * side) / 2
        columns = [START + t, 2 * np.cos(angle), 2 * np.sin(angle), zero, zero, zero, np.sin(half), np.cos(half)]
        head = "time,x,y,z,qx,qy,qz,qw" if separator == "," else ""
        np.savetxt(folder / name.format(robot), np.array(columns).T, "%.6f", separator, header=head, comments="")


def each_robot(folder, kind, topic, more=None):
    for robot in ("red", "blue"):
        made_bag(folder, kind, SECONDS, name=robot, names={f"/{robot}/odom": topic.format(robot), **(more or {})})


def own_names(folder):
    each_robot(folder, "ros1", "/{}/odom")
    write_truth(folder, "gt_{}.txt", " ")


def same_names(folder):
    each_robot(folder, "ros1", "/odom")
    write_truth(folder, "{}_groundtruth.csv")


def truth_heard_by_each(folder):
    each_robot(folder, "sqlite3", "/odom", {**MOCAP, "/uwb/red/blue": "/uwb/red/blue"})


def truth_in_a_bag_of_its_own(folder):
    each_robot(folder, "ros1", "/{}/odom")
    made_bag(folder, "ros1", SECONDS, name="mocap", names=MOCAP)


def truth_in_a_folder_beside_one_bag(folder):
    made_bag(folder, "mcap", SECONDS, names={f"/{robot}/odom": f"/{robot}/odom" for robot in ("red", "blue")})
    write_truth(folder / "gt", "{}.csv")


def truth_beside_a_bag_with_notes_in_it(folder):
    truth_in_a_folder_beside_one_bag(folder)
    (folder / "team/notes.txt").write_text("It rained.\n")


def truth_of_a_simulator(folder):
    """Both are Odometry; the truth's name comes first in the alphabet."""
    for robot in ("red", "blue"):
        for topic in (f"/{robot}/ground_truth/state", f"/{robot}/odom"):
            named = "odom" if topic.endswith("odom") else "truth"
            made_bag(folder, "ros1", SECONDS, name=f"{robot}_{named}", names={f"/{robot}/odom": topic})


def goals_beside_true_poses(folder):
    names = {topic: f"/{topic.rpartition('/')[2]}/pose" for topic in MOCAP} | {"/amcl/red": "/red/goal_pose"}
    made_bag(folder, "mcap", SECONDS, names=names | {f"/{robot}/odom": f"/{robot}/odom" for robot in ("red", "blue")})


def dated(folder):
    each_robot(folder, "ros1", "/odom")
    for k, robot in enumerate(("red", "blue")):
        (folder / f"{robot}.bag").rename(folder / f"{robot}_2024-05-11-10-19-3{k}.bag")
    write_truth(folder, "{}_2024-05-11.csv")


def a_folder_of_each(folder):
    """As the recorder of ROS 2 calls them, beside the truth."""
    for k, robot in enumerate(("red", "blue")):
        (folder / robot).mkdir()
        name = f"rosbag2_2024_05_11-10_19_3{k}"
        made_bag(folder / robot, "sqlite3", SECONDS, name=name, names={f"/{robot}/odom": "/odom"})
    write_truth(folder, "{}_groundtruth.csv")


def parts_of_each(folder):
    for robot in ("red", "blue"):
        for k in range(2):
            only = {f"/{robot}/odom": "/odom"}
            made_bag(folder, "ros1", SECONDS / 2, name=f"{robot}_{k}", start=START + 15 * k, names=only)
    write_truth(folder, "{}_groundtruth.csv")


def odometry_of_one_by_a_filter(folder):
    made_bag(folder, "mcap", SECONDS, names=MOCAP | {"/red/odom": "/red/odometry/filtered", "/blue/odom": "/blue/odom"})


HABITS = [
    odometry_of_one_by_a_filter,
    dated,
    a_folder_of_each,
    parts_of_each,
    own_names,
    same_names,
    truth_heard_by_each,
    truth_in_a_bag_of_its_own,
    truth_in_a_folder_beside_one_bag,
    truth_beside_a_bag_with_notes_in_it,
    truth_of_a_simulator,
    goals_beside_true_poses,
]


@pytest.mark.parametrize("habit", HABITS)
def test_every_robot_has_its_odometry_and_its_truth(habit, tmp_path):
    habit(tmp_path)
    found = inspect_recording(tmp_path)
    assert not found.trial.problem
    assert len(found.runs) == 1
    assert {*found.log.robots} == {"red", "blue"}
    for robot, odometry, truth in zip(found.log.robots, found.log.odometry, found.log.truth, strict=True):
        assert robot in odometry.source
        assert robot in truth.source
        assert "goal" not in truth.source
        assert ("truth" in odometry.source, len(odometry.time), len(truth.time)) == (False, 300, 300)
        angle = 0.1 * (truth.time - START) + (0.0 if robot == "red" else np.pi)
        np.testing.assert_allclose(truth.values[:, 0], 2 * np.cos(angle), atol=0.002)


def test_what_was_read_of_a_bag_is_not_read_again_in_one_inspection(tmp_path, monkeypatch):
    bag, _ = made_bag(tmp_path, "mcap", SECONDS)
    collect, wanted = bags._collect, []
    monkeypatch.setattr(bags, "_collect", lambda bag, of: wanted.append(of) or collect(bag, of))
    for _ in range(2):
        assert not inspect_recording(bag).trial.problem
        assert [one and {*one.values()} for one in wanted] == [None, {Fields()}]
        wanted.clear()
    with bags.keep_what_is_read():
        several, one = (read_topics(bag, names)[0] for names in (["/red/odom", "/mocap/red"], ["/mocap/red"]))
    assert len(wanted) == len(one) == 1
    np.testing.assert_array_equal(one["/mocap/red"].values, several["/mocap/red"].values)
    other, _ = made_bag(tmp_path, "mcap", SECONDS, name="other")
    for most, times in ((1000, 2), (400, 4)):
        monkeypatch.setattr(bags, "MOST_KEPT", most)
        wanted.clear()
        with bags.keep_what_is_read():
            for path in (bag, other, bag, other):
                read_topics(path, ["/red/odom"])
        assert len(wanted) == times


def test_fields_are_looked_at_in_a_sample_and_not_in_the_whole_bag(tmp_path, monkeypatch):
    bag, _ = made_bag(tmp_path, "mcap", SECONDS)
    monkeypatch.setattr(bags, "SAMPLE", 7)
    content, _ = bags.read_content(bag, {"/red/odom": bags.EVERY_FIELD})
    assert (len(content["/red/odom"].rows), len(content["/red/odom"].received)) == (7, 8)


def test_folders_of_robots_are_runs_and_one_of_them_may_be_inspected(tmp_path):
    for k in (1, 2):
        folder = tmp_path / f"run{k}"
        folder.mkdir()
        for robot in ("red", "blue"):
            made_bag(folder, "ros1", SECONDS, start=START + 1000 * k, name=robot, names={f"/{robot}/odom": "/odom"})
        made_bag(folder, "ros1", SECONDS, start=START + 1000 * k, name="mocap", names=MOCAP)
    assert inspect_recording(tmp_path).runs == ("run1", "run2")
    assert inspect_recording(tmp_path / "run1").runs == ("run1",)


def test_bags_one_after_the_other_and_those_of_a_clock_that_begins_again_are_runs(tmp_path):
    for folder, starts in (("later", (START, START + 40)), ("simulated", (0, 3)), ("no date", (START, START + 3))):
        (tmp_path / folder).mkdir()
        for k, start in enumerate(starts):
            made_bag(tmp_path / folder, "ros1", SECONDS, name=f"run{k}", start=start)
        assert list(find_runs(tmp_path / folder)) == ["run0", "run1"]


def test_folders_that_are_called_runs_are_no_robots_though_their_clocks_begin_alike(tmp_path):
    for name in ("run 1", "run 2"):
        (tmp_path / name).mkdir()
        made_bag(tmp_path / name, "ros1", SECONDS, names={"/red/odom": "/odom"})
    assert list(find_runs(tmp_path)) == ["run 1", "run 2"]


def test_runs_of_other_robots_are_to_be_inspected_each(tmp_path):
    """Red drives in both, blue in the second alone, and no topic is the truth of red."""
    for k, robots in enumerate((["red"], ["red", "blue"])):
        names = {f"/{robot}/odom": f"/{robot}/odom" for robot in robots}
        made_bag(tmp_path, "mcap", SECONDS, name=f"run{k}", start=START + 100 * k, names=names)
    with pytest.raises(BadInput, match=r"the topics of its 2 runs differ; inspect each: cooploc inspect \S+/run0;"):
        bag_draft(tmp_path)


def test_topics_of_types_that_are_not_read_are_named_with_a_remedy(tmp_path):
    path, _ = made_bag(tmp_path, "sqlite3", SECONDS)
    write_messages(
        tmp_path / "more", [("/uwb_node", "sensor_msgs/msg/Imu", START + seconds, {}) for seconds in (1, 20)]
    )
    assert not any("not read" in line for line in bag_draft(path).unused)
    line = next(line for line in bag_draft(tmp_path).unused if "not read" in line)
    assert "/uwb_node (sensor_msgs/msg/Imu)" in line
    assert "CSV" in line


FRAME = "std_msgs/Header header\nuint8 id\nfloat32[3] pos_3d\nuwb_msgs/Node[] nodes"
DEFINITIONS = {
    "uwb_msgs/msg/Node": "uint8 role\nuint8 id\nfloat32 dis",
    "uwb_msgs/msg/Frame": FRAME,
    "uwb_msgs/msg/Range": "std_msgs/Header header\nstring source\nstring target\nuint16 distance_mm\nfloat32 rssi",
}


def bag_of_radios(folder, messages):
    """A bag of messages of types that come with no ROS."""
    later = [(topic, name, START + seconds, fields) for topic, name, seconds, fields in messages]
    write_messages(folder / "radios", later, DEFINITIONS)


def test_ranges_in_arrays_of_messages_that_are_not_standard_are_read_by_their_fields(tmp_path):
    """Each robot hears the other and an anchor, 101; its own number is in its messages alone."""

    def messages():
        for k in range(200):
            for robot, number, other in (("red", 7, 9), ("blue", 9, 7)):
                nodes = [{"role": 1, "id": n, "dis": d} for n, d in ((other, 4.25), (101, 9.0))]
                fields = {"id": number, "nodes": nodes[: k % 3]}
                yield f"/{robot}/uwb", "uwb_msgs/msg/Frame", 0.1 * k, fields

    truth_in_a_bag_of_its_own(tmp_path)
    bag_of_radios(tmp_path, messages())
    found = inspect_recording(tmp_path)
    ranges = found.log.readings["range"]
    assert 'range = "nodes.dis"' in found.text
    assert [len(ranges.time), {*ranges.values[:, 0]}] == [2 * 133, {4.25}]
    assert (ranges.robot != ranges.other).all()
    (left_out,) = {line.split("left out ")[1] for f in found.findings if "left out" in (line := f.fact)}
    assert left_out == "66 readings of '101': neither a robot of the team nor an anchor"
    with pytest.raises(BadInput, match=r"messages of /red/uwb have no field 'nodes\.dist'; .*nodes\.dis"):
        read_topics(tmp_path, {"/red/uwb": Fields(("nodes.dist",), ("nodes.id",))})


def test_numbers_that_a_robot_would_share_with_itself_are_of_anchors(tmp_path):
    def messages():
        for k in range(200):
            for number, robot in enumerate(("red", "blue"), 1):
                fields = {"id": number, "nodes": [{"role": 1, "id": 1 + k % 3, "dis": 4.25}]}
                yield f"/{robot}/uwb", "uwb_msgs/msg/Frame", 0.1 * k, fields

    truth_in_a_bag_of_its_own(tmp_path)
    bag_of_radios(tmp_path, messages())
    found = inspect_recording(tmp_path)
    assert "range" not in found.log.readings
    assert any("'1', '2', '3': neither a robot of the team nor an anchor" in finding.fact for finding in found.findings)


def test_messages_may_say_who_measured_whom_in_what_unit(tmp_path):
    def messages():
        for k in range(200):
            for source, target in (("red", "blue"), ("blue", "red")):
                fields = {"source": source, "target": target, "distance_mm": 4000 + k, "rssi": -60.0}
                yield "/uwb", "uwb_msgs/msg/Range", 0.1 * k + 0.01 * (source == "red"), fields

    truth_in_a_bag_of_its_own(tmp_path)
    bag_of_radios(tmp_path, messages())
    found = inspect_recording(tmp_path)
    ranges = found.log.readings["range"]
    assert 'robot = "source"' in found.text
    assert [len(ranges.time), ranges.values.min(), ranges.values.max()] == [400, 4.0, 4.199]
    at = np.array(found.log.robots)[ranges.robot] == "red"
    np.testing.assert_allclose(np.diff(ranges.time[at]), 0.1, atol=1e-6)


def test_a_bag_whose_files_are_compressed_is_a_bag(tmp_path):
    path, _ = made_bag(tmp_path, "sqlite3", SECONDS, compressed=True)
    assert [file.suffix for file in path.glob("*.db3*")] == [".zstd"]
    assert inspect_recording(tmp_path).log.robots == ("blue", "red")


def test_a_bag_whose_recorder_was_killed_is_named_with_what_mends_it(tmp_path):
    (tmp_path / "team.bag.active").touch()
    with pytest.raises(BadInput, match=r"its recorder was killed; `rosbag reindex team\.bag\.active` mends it"):
        inspect_recording(tmp_path)


def test_a_description_of_a_bag_may_name_text_files_for_a_table(tmp_path):
    same_names(tmp_path)
    assert 'topic = "/{robot}/odom"' in (text := inspect_recording(tmp_path).text)
    assert 'file = "{robot}_groundtruth.csv"' in text


def test_a_single_robot_needs_no_name(tmp_path):
    topics = {"/red/odom": "/odom", "/blue/odom": "/raw_odom", "/mocap/red": "/vicon/pose", "/amcl/red": "/amcl"}
    made_bag(tmp_path, "ros1", SECONDS, names=topics)
    log = inspect_recording(tmp_path).log
    assert log.robots == ("robot",)
    assert (log.odometry[0].source, log.truth[0].source) == ("/odom", "/vicon/pose")


@pytest.mark.parametrize(("topic", "robot"), [("/odometry/filtered", "robot"), ("/red/odom", "red")])
def test_a_robot_is_not_called_after_its_odometry(topic, robot):
    assert topics_by_robot([topic]) == {robot: topic}
