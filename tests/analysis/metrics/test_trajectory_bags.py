"""Trajectories in bags: topics of poses, paths and frames, by robot and method, as their files would have them."""

import numpy as np
import pytest
from made_bags import pose_at, write_messages
from made_trajectories import ROBOTS, expected, paths_of_all, rmse_of

from cooploc import BadInput
from cooploc.analysis.metrics.external import judge_trajectories

ODOMETRY, POSE, PATH, FRAMES, STATES = (
    "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Path", "tf2_msgs/msg/TFMessage",
    "gazebo_msgs/msg/ModelStates",
)  # fmt: skip
START = 1.7e9


def poses(topic, kind, path):
    """Messages of one robot's poses (T, 3) in a topic."""
    prefix = {ODOMETRY: "pose.pose.", POSE: "pose."}[kind]
    stamps = START + paths_of_all()[0]
    return [(topic, kind, s, pose_at(x, y, 0.0, h, prefix)) for s, (x, y, h) in zip(stamps, path, strict=True)]


def write(folder, *messages):
    write_messages(folder, sorted((one for some in messages for one in some), key=lambda one: one[2]))
    return folder


@pytest.fixture
def truth(tmp_path):
    """A bag of a tracker."""
    true = paths_of_all()[1]["truth"]
    return write(tmp_path / "truth", *(poses(f"/vrpn/{robot}/pose", POSE, true[robot]) for robot in ROBOTS))


def expected_of(method="mine"):
    return {key: value for key, value in expected(paths_of_all()[1]).items() if key[0] == method}


@pytest.mark.slow
def test_of_several_topics_of_a_robot_that_of_the_method_counts(truth, tmp_path):
    _, paths = paths_of_all()
    topics = ((f"/{robot}/{name}", paths[name][robot]) for name in ("mine", "theirs") for robot in ROBOTS)
    bag = write(tmp_path / "bag", *(poses(topic, ODOMETRY, path) for topic, path in topics))
    found, _ = judge_trajectories(truth, {"mine": bag, "theirs": bag})
    assert rmse_of(found) == expected(paths)
    with pytest.raises(BadInput, match=r"topics /red/mine, /red/theirs of robot 'red': name the method like a part"):
        judge_trajectories(truth, {"odom": bag})


@pytest.mark.slow
@pytest.mark.parametrize("true", ["/{}/ground_truth", "/vicon/{}/pose"])
def test_a_bag_may_hold_the_truth_beside_what_a_filter_says(tmp_path, true):
    _, paths = paths_of_all()
    own = [poses(f"/{robot}/{name}", ODOMETRY, paths[name][robot]) for name in ("mine", "theirs") for robot in ROBOTS]
    bag = write(tmp_path / "bag", *own, *(poses(true.format(r), POSE, paths["truth"][r]) for r in ROBOTS))
    assert rmse_of(judge_trajectories(bag, dict.fromkeys(("mine", "theirs"), bag))[0]) == expected(paths)


@pytest.mark.slow
def test_topics_with_covariances_come_before_those_without(truth, tmp_path):
    _, paths = paths_of_all()
    with_it = [poses(f"/{robot}/odom", ODOMETRY, paths["mine"][robot]) for robot in ROBOTS]
    bag = write(tmp_path / "bag", *with_it, *(poses(f"/{r}/pose", POSE, paths["theirs"][r]) for r in ROBOTS))
    assert rmse_of(judge_trajectories(truth, {"mine": bag})[0]) == expected_of()


@pytest.mark.slow
@pytest.mark.parametrize("true", ["groundtruth", "/amcl_pose", "/red/amcl_pose"])
def test_one_robots_topics_need_not_have_its_name_and_a_word_says_which_is_true(tmp_path, true):
    paths = {name: of["red"] for name, of in paths_of_all()[1].items()}
    own = [poses(f"/{name}", POSE, paths[name]) for name in ("mine", "theirs")]
    bag = write(tmp_path / "bag", *own, poses(true, POSE, paths["truth"]))
    place = bag if true == "groundtruth" else f"amcl_pose={bag}"
    found, _ = judge_trajectories(place, dict.fromkeys(("mine", "theirs"), bag))
    errors = {method: error for (method, robot), error in expected(paths_of_all()[1]).items() if robot == "red"}
    assert dict(zip(found["estimator"], found["rmse"], strict=True)) == errors
    with pytest.raises(BadInput, match="are the true ones: name other files, or which of a bag's topics is true"):
        judge_trajectories(place, {true.rpartition("/")[2]: bag})


def test_poses_in_the_axes_of_a_camera_are_refused(tmp_path):
    stamps, path = START + paths_of_all()[0], paths_of_all()[1]["truth"]["red"]
    camera = [("/truth", POSE, s, pose_at(-y, 0.0, x, 0.0, "pose.")) for s, (x, y, _) in zip(stamps, path, strict=True)]
    bag = write(tmp_path / "bag", camera, poses("/mine", POSE, path))
    with pytest.raises(BadInput, match=r"bag, /truth: its path spans .* turn it so that z points up"):
        judge_trajectories(bag, {"mine": bag})


@pytest.mark.slow
def test_of_a_damaged_bag_what_can_be_recovered_is_judged(truth, tmp_path):
    t, paths = paths_of_all()
    bag = write(tmp_path / "mine", *(poses(f"/{robot}/mine", ODOMETRY, paths["mine"][robot]) for robot in ROBOTS))
    (file,) = bag.glob("*.db3")
    file.write_bytes(bytes(100) + file.read_bytes()[100:])
    found, notes = judge_trajectories(truth, {"mine": bag})
    assert rmse_of(found) == expected_of()
    assert notes[0].startswith(f"{file}: damaged: {2 * len(t)} of {2 * len(t)} messages recovered (")
    file.write_bytes(bytes(100))
    with pytest.raises(BadInput, match="and no message is found in it"):
        judge_trajectories(truth, {"mine": bag})


@pytest.mark.slow
def test_robots_may_be_called_a_little_otherwise_in_a_bag(tmp_path):
    _, paths = paths_of_all()
    for method, name, kind in (("truth", "/mocap/robot{}/pose", POSE), ("mine", "/tb3_{}/odom", ODOMETRY)):
        write(tmp_path / method, *(poses(name.format(k), kind, paths[method][r]) for k, r in enumerate(ROBOTS)))
    found, notes = judge_trajectories(tmp_path / "truth", {"mine": tmp_path / "mine"})
    said = [f"topic /tb3_{k}/odom is taken for robot 'robot{k}'" for k in range(2)]
    assert [note.partition(": ")[2] for note in notes[:2]] == said
    assert found["name"].tolist() == ["robot0", "robot1"]
    assert found["rmse"].tolist() == [*expected_of().values()]


def path_message(topic, end, count, path):
    """A message at `end` [s] with the first poses (T, 3) of a path."""
    stamped = zip(START + paths_of_all()[0][:count], path, strict=False)
    places = [pose_at(x, y, 0.0, h, "pose.") | {"header.stamp.ns": round(1e9 * s)} for s, (x, y, h) in stamped]
    return topic, PATH, START + end, {"poses": places}


@pytest.mark.slow
def test_of_a_path_the_last_message_counts_and_a_plan_is_no_path(truth, tmp_path):
    t, paths = paths_of_all()
    of_all = paths["mine"].items()
    early = [path_message(f"/{robot}/path", 5.0, 50, path + 9) for robot, path in of_all]  # before its loop was closed
    late = [path_message(f"/{robot}/path", 60.0, len(t), path) for robot, path in of_all]
    plans = [path_message(f"/{robot}/global_plan", 1.0, 50, 0 * path) for robot, path in of_all]
    odometry = [poses(f"/{robot}/odom", ODOMETRY, path) for robot, path in paths["theirs"].items()]
    for method, beside in (("mine", ()), ("path", odometry)):
        bag = write(tmp_path / method, early, late, plans, *beside)
        assert rmse_of(judge_trajectories(truth, {method: bag})[0]) == {
            (method, r): e for (_, r), e in expected_of().items()
        }


def transforms(frame, parent, stamps, path, topic):
    """Messages of one frame in another, at poses (T, 3)."""
    found = []
    for s, (x, y, heading) in zip(START + stamps, path, strict=True):
        place = {f"transform.translation.{axis}": v for axis, v in (("x", x), ("y", y))}
        turn = {"transform.rotation.z": np.sin(heading / 2), "transform.rotation.w": np.cos(heading / 2)}
        frames = {"header.frame_id": parent, "child_frame_id": frame, "header.stamp.ns": round(1e9 * s)}
        found.append((topic, FRAMES, s, {"transforms": [place | turn | frames]}))
    return found


def pose_in(frame, pose):
    """Poses (T, 3) as seen from a frame at poses (T, 3)."""
    c, s, (dx, dy, turn) = np.cos(frame[:, 2]), np.sin(frame[:, 2]), (pose - frame).T
    return np.column_stack([c * dx + s * dy, -s * dx + c * dy, turn])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("base", "method", "place"),
    [
        ("{}/base_link", "mine", "/tf"),
        ("/{}_base_link", "mine", "/tf"),
        ("{}", "mine", "/tf"),
        ("{}/base_link", "tf", "/tf"),
        ("base_link", "mine", "/{}/tf"),
    ],
)
def test_robots_are_where_the_frames_of_their_bases_are_in_the_root_of_tf(truth, tmp_path, base, method, place):
    """A map, odometry that drifts in it, its corrections once a second, and a base with a laser."""
    t, paths = paths_of_all()
    messages, every = [], np.arange(0, len(t), 10)
    for robot, path in paths["mine"].items():
        drift = np.column_stack([0.02 * t, 1 + 0.01 * t, -0.01 * t])  # [m, m, rad]
        own, topic, odom = base.format(robot), place.format(robot), "odom" if "{}" in place else f"{robot}/odom"
        messages += [
            transforms(own, odom, t, pose_in(drift, path), topic),
            transforms(odom, "map", t[every], drift[every], topic),
            transforms(f"{own}/laser", own, t[:1], [[0.5, 0.0, 0.0]], f"{topic}_static"),
            transforms("map", "world", t[:1], [[0.0, 0.0, 0.0]], f"{topic}_static"),
        ]
    if method == "tf":
        messages += [poses(f"/{robot}/odom", ODOMETRY, path) for robot, path in paths["theirs"].items()]
    found, _ = judge_trajectories(truth, {method: write(tmp_path / "bag", *messages)})
    assert found["ticks"].tolist() == 2 * [every[-1] + 1]  # until the last correction
    error = {r: (path - paths["truth"][r])[: every[-1] + 1, :2] for r, path in paths["mine"].items()}
    assert rmse_of(found) == {(method, r): pytest.approx(np.sqrt((e**2).sum(1).mean())) for r, e in error.items()}


@pytest.mark.slow
def test_models_of_gazebo_are_the_truth_and_odometry_is_so_with_a_note(tmp_path):
    t, paths = paths_of_all()
    odometry = [poses(f"/{robot}/odom", ODOMETRY, paths["truth"][robot]) for robot in ROBOTS]
    models = {"wall": np.tile([3.0, 1.0, 0.0], (len(t), 1)), **paths["truth"]}
    states = [
        ("/gazebo/model_states", STATES, s, {"name": [*models], "pose": [pose_at(x, y, 0.0, h) for x, y, h in now]})
        for s, *now in zip(START + t, *models.values(), strict=True)
    ]
    mine = write(tmp_path / "mine", *(poses(f"/{robot}/mine", ODOMETRY, paths["mine"][robot]) for robot in ROBOTS))
    simulated = tmp_path / "simulated"
    write_messages(
        simulated, [*states, *odometry[0], *odometry[1]], {STATES: "string[] name\ngeometry_msgs/Pose[] pose"}
    )
    found, notes = judge_trajectories(simulated, {"mine": mine})
    assert rmse_of(found) == expected_of()
    assert not [note for note in notes if "taken for" in note]
    _, notes = judge_trajectories(write(tmp_path / "odometry", *odometry), {"mine": mine})
    assert any(note.endswith("odometry: topics such as /red/odom are taken for the truth") for note in notes)


@pytest.mark.slow
@pytest.mark.parametrize("own", ["odometry", "frames", "each with the truth of all"])
def test_of_bags_that_each_robot_recorded_topics_of_one_name_are_of_their_robots(truth, tmp_path, own):
    t, paths = paths_of_all()
    of_truth = [poses(f"/vrpn/{r}/pose", POSE, paths["truth"][r]) for r in ROBOTS] if own.startswith("each") else []
    for robot, path in paths["mine"].items():
        mine = transforms("base_link", "map", t, path, "/tf") if own == "frames" else poses("/odom", ODOMETRY, path)
        (tmp_path / "mine").mkdir(exist_ok=True)
        write(tmp_path / "mine" / robot, mine, *of_truth)
    assert rmse_of(judge_trajectories(truth, {"mine": tmp_path / "mine"})[0]) == expected_of()
    if not of_truth:
        return
    found, _ = judge_trajectories(tmp_path / "mine", {"mine": tmp_path / "mine"})
    assert rmse_of(found) == expected_of()


@pytest.mark.slow
def test_bags_that_follow_one_another_are_parts_of_one_recording(truth, tmp_path):
    _, paths = paths_of_all()
    every = [poses(f"/{robot}/mine", ODOMETRY, path) for robot, path in paths["mine"].items()]
    (tmp_path / "mine").mkdir()
    for k, part in enumerate((slice(0, 300), slice(300, None))):
        write(tmp_path / f"mine/part_{k}", *(one[part] for one in every))
    assert rmse_of(judge_trajectories(truth, {"mine": tmp_path / "mine"})[0]) == expected_of()
    (tmp_path / "paths").mkdir()
    for k, (end, moved) in enumerate(((300, 9.0), (600, 0.0))):
        some = [(f"/{r}/path", end / 10, end, path + moved) for r, path in paths["mine"].items()]
        write(tmp_path / f"paths/part_{k}", [path_message(*one) for one in some])
    assert rmse_of(judge_trajectories(truth, {"mine": tmp_path / "paths"})[0]) == expected_of()


def test_a_bag_without_poses_says_what_it_may_hold(truth, tmp_path):
    bag = write(tmp_path / "bag", [("/chatter", "std_msgs/msg/Float64", START, {"data": 1.0})])
    with pytest.raises(BadInput, match=r"nor a bag with poses, such as .*, a nav_msgs/Path or /tf; write .* NAME.csv"):
        judge_trajectories(truth, {"mine": bag})
