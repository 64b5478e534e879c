"""One team in bags whose messages are of many types: each is read as the same recording, without a log.toml by hand."""

import itertools
import re

import numpy as np
import pytest
from made_bags import pose_at, write_messages
from made_csv_teams import two_robots

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.inspect.inspection import inspect_recording
from cooploc.scenarios.recordings.inspect.motion import robot_motion
from cooploc.scenarios.recordings.team_log import metres_on_globe

pytestmark = pytest.mark.slow  # a second each; test_checks and test_infer_columns are quick
ROBOTS, ORIGIN = ("blue", "red"), (49.0, 8.4)
DEFINITIONS = {
    "gazebo_msgs/msg/ModelStates": "string[] name\ngeometry_msgs/Pose[] pose\ngeometry_msgs/Twist[] twist",
    "mocap_msgs/msg/Body": "string rigid_body_name\ngeometry_msgs/Pose pose",
    "mocap_msgs/msg/Bodies": "std_msgs/Header header\nuint32 frame_number\nmocap_msgs/Body[] rigidbodies",
    "lab_msgs/msg/Identified": "string id\nsensor_msgs/Range range\nfloat64 variance",
    "lab_msgs/msg/Ranges": "std_msgs/Header header\nlab_msgs/Identified[] ranges",
    "lab_msgs/msg/Arrays": "std_msgs/Header header\nstring[] ids\nfloat64[] distances",
    "lab_msgs/msg/Wheels": "std_msgs/Header header\nfloat64 linear_velocity\nfloat64 angular_velocity",
    "uwb_msgs/msg/UwbRange": "std_msgs/Header header\nuint8 requester_id\nuint8 requester_idx\nuint8 responder_id\n"
    "uint8 responder_idx\nfloat32 distance\nfloat32 distance_err\ngeometry_msgs/Point responder_location",
    "rtls_msgs/msg/Range": "uint8 id\nfloat64 tof\nfloat64 ra",
    "rtls_msgs/msg/Stick": "std_msgs/Header header\nrtls_msgs/Range[] ranges",
    "lab_msgs/msg/Distance": "std_msgs/Header header\nuint32 distance\nint8 rss",
    "vicon_msgs/msg/Subject": "std_msgs/Header header\nstring name\ngeometry_msgs/Point position\n"
    "geometry_msgs/Quaternion orientation",
    "vicon_msgs/msg/Marker": "string marker_name\nstring subject_name\ngeometry_msgs/Point translation",
    "vicon_msgs/msg/Markers": "std_msgs/Header header\nvicon_msgs/Marker[] markers",
    "lab_msgs/msg/Place": "std_msgs/Header header\nfloat64 x\nfloat64 y\nfloat64 theta",
}


def lines_of(files, kind):
    return [(robot, *line) for robot in ROBOTS for line in zip(*files[f"{kind}_{robot}.csv"].values(), strict=True)]


def odometry(topic, name, fields):
    return lambda files: [(topic.format(r), name, t, fields(v, omega)) for r, t, v, omega in lines_of(files, "odom")]


def truth(topic, name, fields):
    return lambda files: [(topic.format(r), name, t, fields(x, y, h)) for r, t, x, y, h in lines_of(files, "truth")]


def together(topic, name, fields):
    """The truth of both in one message, beside something else."""

    def messages(files):
        every = zip(*(zip(*files[f"truth_{robot}.csv"].values(), strict=True) for robot in ROBOTS), strict=True)
        for at in every:
            poses = {"ground_plane": (0.0, 0.0, 0.0)} | {r: one[1:] for r, one in zip(ROBOTS, at, strict=True)}
            yield topic, name, at[0][0], fields(poses)

    return messages


def ranges(topic, name, field="data", unit=1.0, more=lambda other: {}, wrap=lambda one: one):
    def messages(files):
        for t, robot, other, d in zip(*files["uwb.csv"].values(), strict=True):
            value = round(d / unit) if unit < 1 else d
            yield topic.format(robot, other), name, t, wrap({field: value} | more(other))

    return messages


def place(x, y, heading):
    return pose_at(x, y, 0.1, heading)


def posed(x, y, heading):
    return pose_at(x, y, 0.1, heading, "pose.")


def frames(parent):
    """Transforms of the robots, each in a message of its own."""

    def messages(files):
        for robot, t, x, y, h in lines_of(files, "truth"):
            turn = {"transform.rotation.z": np.sin(h / 2), "transform.rotation.w": np.cos(h / 2)}
            at = {"transform.translation.x": x, "transform.translation.y": y, "child_frame_id": robot}
            yield "/tf", "tf2_msgs/msg/TFMessage", t, {"transforms": [turn | at | {"header.frame_id": parent}]}

    return messages


def beside_an_estimate(files):
    """The truth, and in topics that come first in the alphabet what two filters say."""
    makes = (truth(f"/{name}/pose", f"{G}PoseStamped", lambda x, y, h: posed(x + 1, y - 1, h)) for name in ESTIMATES)
    return [*(one for make in makes for one in make(files)), *USUAL["truth"](files)]


def beside_a_filter(files):
    """Odometry, and in topics that come first in the alphabet what a filter made of it."""
    fields = ("nav_msgs/msg/Odometry", lambda v, w: {"twist.twist.linear.x": 2 * v, "twist.twist.angular.z": -w})
    return [*odometry("/{}/filtered/odom", *fields)(files), *USUAL["odometry"](files)]


def upright(x, y, heading):
    """A pose in axes of which y is up."""
    place = {"pose.position.x": x, "pose.position.y": 0.1, "pose.position.z": -y}
    return place | {"pose.orientation.y": np.sin(heading / 2), "pose.orientation.w": np.cos(heading / 2)}


def gyroscopes(files):
    """Speeds alone as odometry, and turn rates of another topic."""
    speeds = odometry("/{}/velocity", "geometry_msgs/msg/TwistStamped", lambda v, w: {"twist.linear.x": v})
    rates = odometry("/{}/imu", "sensor_msgs/msg/Imu", lambda v, w: {"angular_velocity.z": w})
    return [*speeds(files), *rates(files)]


def on_globe(x, y, heading):
    """Degrees, by which `metres_on_globe` gives these metres."""
    east, north = metres_on_globe(np.array(ORIGIN[0] + 1), np.array(ORIGIN[1] + 1), ORIGIN)
    return {"latitude": ORIGIN[0] + y / north, "longitude": ORIGIN[1] + x / east}


def of_driver(robot):
    """What a driver writes of a range between radios 201 and 202, beside the distance."""
    measured = {"red": 202, "blue": 201}[robot]
    return {"requester_id": 403 - measured, "responder_id": measured, "requester_idx": 1, "distance_err": 0.1}


G, ESTIMATES = "geometry_msgs/msg/", ("amcl/{}", "{}/local_position")
USUAL = {
    "odometry": odometry("/{}/odom", "nav_msgs/msg/Odometry", lambda v, w: {
        "twist.twist.linear.x": v, "twist.twist.angular.z": w}),
    "truth": truth("/vrpn/{}/pose", f"{G}PoseStamped", posed),
    "ranges": ranges("/{}/uwb/{}", "sensor_msgs/msg/Range", "range"),
}  # fmt: skip
HABITS = {
    "usual": {},
    "stamped speeds": {"odometry": odometry("/{}/velocity", f"{G}TwistStamped", lambda v, w: {
        "twist.linear.x": v, "twist.angular.z": w})},
    "commands": {"odometry": odometry("/{}/cmd_vel", f"{G}Twist", lambda v, w: {"linear.x": v, "angular.z": w})},
    "own wheels": {"odometry": odometry("/{}/wheels", "lab_msgs/msg/Wheels", lambda v, w: {
        "linear_velocity": v, "angular_velocity": w})},
    "gyroscopes": {"odometry": gyroscopes},
    "poses": {"truth": truth("/mocap/{}", f"{G}Pose", place)},
    "plane poses": {"truth": truth("/mocap/{}", f"{G}Pose2D", lambda x, y, h: {"x": x, "y": y, "theta": h})},
    "points": {"truth": truth("/leica/{}", f"{G}PointStamped", lambda x, y, h: {"point.x": x, "point.y": y})},
    "vectors": {"truth": truth("/leica/{}", f"{G}Vector3Stamped", lambda x, y, h: {"vector.x": x, "vector.y": y})},
    "own poses": {"truth": truth("/{}/gt", "lab_msgs/msg/Place", lambda x, y, h: {"x": x, "y": y, "theta": h})},
    "y is up": {"truth": truth("/vrpn/{}/pose", f"{G}PoseStamped", upright)},
    "an estimate": {"truth": beside_an_estimate},
    "a satellite": {"truth": truth("/{}/fix", "sensor_msgs/msg/NavSatFix", on_globe)},
    "frames": {"truth": frames("world")},
    "models": {"truth": together("/gazebo/model_states", "gazebo_msgs/msg/ModelStates", lambda poses: {
        "name": [*poses], "pose": [place(*one) for one in poses.values()], "twist": [{}] * len(poses)})},
    "bodies": {"truth": together("/rigid_bodies", "mocap_msgs/msg/Bodies", lambda poses: {
        "rigidbodies": [{"rigid_body_name": name} | posed(*one) for name, one in poses.items()]})},
    "floats": {"ranges": ranges("/{}/range_to/{}", "std_msgs/msg/Float32")},
    "millimetres": {"ranges": ranges("/{}/range_to/{}", "std_msgs/msg/Int32", unit=1e-3)},
    "frames of headers": {"ranges": ranges("/{}/uwb", "sensor_msgs/msg/Range", "range", more=lambda r: {
        "header.frame_id": r})},
    "an array": {"ranges": ranges("/{}/uwb/range", "lab_msgs/msg/Ranges", "range.range", more=lambda r: {"id": r},
        wrap=lambda one: {"ranges": [one]})},
    "arrays side by side": {"ranges": ranges("/{}/uwb", "lab_msgs/msg/Arrays", "distances", more=lambda r: {"ids": [r]},
        wrap=lambda one: one | {"distances": np.array([one["distances"]])})},
    "numbers of its own": {"ranges": ranges("/uwb", "uwb_msgs/msg/UwbRange", "distance", more=of_driver)},
    "times of flight": {"ranges": ranges("/{}/sticks", "rtls_msgs/msg/Stick", "ra", more=lambda r: {
        "id": {"blue": 1, "red": 2}[r], "tof": 3e-8}, wrap=lambda one: {"ranges": [one]})},
    "a type of the lab": {"ranges": ranges("/{}/to/{}", "lab_msgs/msg/Distance", "distance", unit=1e-3)},
    "a subject": {"truth": truth("/vicon/{}", "vicon_msgs/msg/Subject", lambda *at: {"name": "it"} | place(*at))},
    "markers": {"truth": together("/vicon/markers", "vicon_msgs/msg/Markers", lambda poses: {"markers": [
        {"marker_name": f"m{k}", "subject_name": name, "translation.x": x, "translation.y": y}
        for name, (x, y, _) in poses.items() for k in (1, 2)]})},
    "a filter": {"odometry": beside_a_filter},
    "poses of a camera": {"odometry": truth("/{}/orb_slam3/pose", f"{G}PoseStamped", posed)},
    "the only teammate": {"ranges": ranges("/{}/uwb/range", "sensor_msgs/msg/Range", "range")},
}  # fmt: skip


@pytest.mark.parametrize("habit", HABITS)
def test_the_team_is_read_from_messages_of_many_types(tmp_path, habit):
    files = two_robots(seconds=40)
    write_messages(
        tmp_path / "team", [one for make in (USUAL | HABITS[habit]).values() for one in make(files)], DEFINITIONS
    )
    found = inspect_recording(tmp_path)
    log = found.log
    assert found.trial.problem == ""
    assert {finding.kind for finding in found.findings} <= {"dropped"}  # of ground_plane
    assert log.robots == ROBOTS
    np.testing.assert_allclose(
        np.sort(log.readings["range"].values[:, 0]), np.sort(files["uwb.csv"]["range"]), atol=1e-3
    )
    for i, robot in enumerate(ROBOTS):
        t, x, y, heading = files[f"truth_{robot}.csv"].values()
        known = np.interp(log.truth[i].time, t, x), np.interp(log.truth[i].time, t, y)
        there = log.truth[i].values
        if habit == "a satellite":
            known = known[0] - known[0][0] + there[0, 0], known[1] - known[1][0] + there[0, 1]
        np.testing.assert_allclose(there[:, :2].T, known, atol=0.005)
        headed = np.isfinite(there[:, 2])
        turned = np.interp(log.truth[i].time, t, np.unwrap(heading)) - there[:, 2]
        np.testing.assert_allclose(np.cos(turned[headed]), 1.0, atol=1e-3)
        if habit == "poses of a camera":  # have none of the noise of wheels
            np.testing.assert_allclose(log.odometry[i].values[:, :2], np.stack(known, -1), atol=0.005)
            continue
        t, v, omega = files[f"odom_{robot}.csv"].values()
        moved = robot_motion(log, i).odometry
        assert abs(moved.length[-1] - (np.diff(t) * v[:-1]).sum()) < 0.02
        assert abs(moved.turn[-1] - (np.diff(t) * omega[:-1]).sum()) < 0.02


def test_poses_of_one_robot_from_another_are_sightings(tmp_path):
    files = two_robots(seconds=40)
    made = [one for kind in ("odometry", "truth") for one in USUAL[kind](files)]
    times = files["odom_red.csv"]["time"]
    made += [("/red/relative_pose/blue", f"{G}PoseStamped", t, posed(3.0, -4.0, 0.1)) for t in times]
    write_messages(tmp_path / "team", made)
    found = inspect_recording(tmp_path).log.readings["sighting"]
    np.testing.assert_allclose(found.values, [[5.0, np.arctan2(-4, 3)]] * len(times))


def test_what_a_camera_detected_is_drafted_in_its_axes_and_text_is_named(tmp_path):
    files = two_robots(seconds=40)
    made = [one for kind in ("odometry", "truth") for one in USUAL[kind](files)]
    definitions = {"lab_msgs/msg/Tag": "string[] id\ngeometry_msgs/PoseStamped pose"}
    definitions["lab_msgs/msg/Tags"] = "std_msgs/Header header\nlab_msgs/Tag[] detections"
    for k, t in enumerate(files["odom_red.csv"]["time"]):
        tag = {"id": ["blue"], "pose.pose.position.x": -1.5, "pose.pose.position.y": 0.1}
        seen = [tag | {"pose.pose.position.z": 2.0 + 0.1 * (k % 9)}]
        made.append(("/red/tag_detections", "lab_msgs/msg/Tags", t, {"detections": seen}))
        made.append(("/uwb/data", "std_msgs/msg/String", t, {"data": "{}"}))
    write_messages(tmp_path / "team", made, definitions)
    found = inspect_recording(tmp_path)
    seen = found.log.readings["sighting"].values
    np.testing.assert_allclose(seen[:2], [[2.5, np.arctan2(1.5, 2.0)], [np.hypot(2.1, 1.5), np.arctan2(1.5, 2.1)]])
    assert any("not read: /uwb/data (std_msgs/msg/String)" in line for line in found.unused)


def test_marks_without_places_are_named_and_the_stamps_are_those_of_their_messages(tmp_path):
    files = two_robots(seconds=40)
    made = [one for kind in ("odometry", "truth") for one in USUAL[kind](files)]
    definitions = {"lab_msgs/msg/Fiducial": "int32 fiducial_id\ngeometry_msgs/Transform transform"}
    definitions["lab_msgs/msg/Fiducials"] = "std_msgs/Header header\nlab_msgs/Fiducial[] transforms"
    for k, (robot, t, x, y, heading) in enumerate(lines_of(files, "truth")):
        far, bearing = np.hypot(4 - x, 9 - y), np.arctan2(9 - y, 4 - x) - heading
        ahead, left = far * np.cos(bearing), far * np.sin(bearing)
        seen = {"fiducial_id": 7, "transform.translation.x": ahead, "transform.translation.y": left}
        made.append(
            (f"/{robot}/fiducial_transforms", "lab_msgs/msg/Fiducials", t, {"transforms": [seen] * (k % 3 > 0)})
        )
    write_messages(tmp_path / "team", made, definitions)
    *_, found = findings = inspect_recording(tmp_path).findings
    assert {one.kind for one in findings} == {"dropped"}
    assert not any("stamp" in one.fact for one in findings)
    assert found.fact.endswith("readings of '7': neither a robot of the team nor a landmark")
    assert found.change == "[landmarks] places = { NAME = [X, Y], ... }, of a landmark"


def test_what_a_camera_saw_may_be_places_in_its_axes(tmp_path):
    """z ahead and x to the right, of whom each message names."""
    files, definitions = two_robots(seconds=40), {"lab_msgs/msg/Seen": "string id\ngeometry_msgs/Point[] at"}
    write_messages(tmp_path / "team", [one for make in USUAL.values() for one in make(files)])
    text = inspect_recording(tmp_path).text
    t = files["odom_red.csv"]["time"]
    seen = [("/red/camera", "lab_msgs/msg/Seen", s, {"id": "blue", "at": [{"x": -1.5, "y": 9.0, "z": 2.0}]}) for s in t]
    write_messages(tmp_path / "camera", seen, definitions)
    fields = 'other = "id"\nx = "at.z"\ny = { column = "at.x", unit = "-m" }\n'
    (tmp_path / "log.toml").write_text(f'{text}\n[sightings]\ntopic = "/{{robot}}/camera"\n{fields}')
    found = inspect_recording(tmp_path).log.readings["sighting"]
    assert len(found.time) == len(t)
    np.testing.assert_allclose(found.values, [[2.5, np.arctan2(1.5, 2.0)]] * len(t))


def test_a_field_may_say_who_measured_and_the_teammate_follows(tmp_path):
    """Ranges of both robots are in one topic, and the frames of their headers are the robots."""
    files = two_robots(seconds=40)
    both = [
        ("/uwb", "sensor_msgs/msg/Range", t, {"range": d, "header.frame_id": robot})
        for t, robot, _, d in zip(*files["uwb.csv"].values(), strict=True)
    ]
    write_messages(tmp_path / "team", both + [one for kind in ("odometry", "truth") for one in USUAL[kind](files)])
    text, fields = inspect_recording(tmp_path).text, 'topic = "/uwb"\nrobot = "header.frame_id"\n'
    (tmp_path / "log.toml").write_text(f'{text}\n[ranges]\n{fields}range = "range"\n')
    found = inspect_recording(tmp_path)
    assert (len(found.log.readings["range"].time), found.findings) == (len(both), ())
    (tmp_path / "log.toml").write_text(f"{text}\n[ranges]\n{fields}")
    with pytest.raises(BadInput, match=r"ranges: names by robot need numbers: name their fields, too"):
        inspect_recording(tmp_path)


SIGHT, PLACED, PLACES = "lab_msgs/msg/Sight", "lab_msgs/msg/Placed", {"A1": (0.0, 0.0), "A2": (8.0, 8.0)}
OF_ANCHORS = {  # (topic, type, fields) of a robot's distance d from the anchor a
    "frames": lambda own, a, d: (f"{own}/uwb", "sensor_msgs/msg/Range", {"range": d, "header.frame_id": a}),
    "topics": lambda own, a, d: (f"{own}/range_to/{a}", "sensor_msgs/msg/Range", {"range": d}),
    "floats": lambda own, a, d: (f"{own}/{a}/distance", "std_msgs/msg/Float64", {"data": d}),
    "fields": lambda own, a, d: (f"{own}/wifi", SIGHT, {"ap": a, "distance": d}),
    "places": lambda own, a, d: (
        f"{own}/wifi",
        PLACED,
        {"ap": a, "distance": d, "anchor_x": PLACES[a][0], "anchor_y": PLACES[a][1]},
    ),
}


@pytest.mark.parametrize("team", [ROBOTS, ("red",)])
@pytest.mark.parametrize("form", OF_ANCHORS)
def test_anchors_in_a_file_beside_a_bag_are_those_that_its_ranges_name(tmp_path, form, team):
    """Of two robots none is taken for its only teammate's; a robot alone needs no name in topics."""
    files, alone = two_robots(seconds=40), len(team) == 1
    made = [one for kind in ("odometry", "truth") for one in USUAL[kind](files)]
    made = [(t.replace("/red/odom", "/odom"), *one) for t, *one in made if "red" in t] if alone else made
    for robot in team:
        for t, x, y, _ in zip(*files[f"truth_{robot}.csv"].values(), strict=True):
            for anchor, (a, b) in PLACES.items():
                topic, kind, fields = OF_ANCHORS[form]("" if alone else f"/{robot}", anchor, np.hypot(x - a, y - b))
                made.append((topic, kind, t, fields))
    definition = "std_msgs/Header header\nstring ap\nfloat64 distance"
    placed = f"{definition}\nfloat64 anchor_x\nfloat64 anchor_y"
    write_messages(tmp_path / "team", made, {SIGHT: definition, PLACED: placed})
    if form == "frames":
        said = "/uwb (Range, 800): of frames A1, A2, whose places are not known; if these are anchors, write their id"
        assert [line for line in inspect_recording(tmp_path).unused if f"{said}, x, y into anchors.csv beside" in line]
    lines = ["id,x,y", *(f"{anchor},{x},{y}" for anchor, (x, y) in PLACES.items())]
    if form != "places":  # which are in the messages
        (tmp_path / "anchors.csv").write_text("\n".join([*lines, ""]))
    found = inspect_recording(tmp_path)
    assert (list(found.log.readings), found.log.anchors.names) == (["anchor_range"], ("A1", "A2"))
    assert (len(found.log.robots), {*found.log.readings["anchor_range"].other}) == (len(team), {0, 1})
    assert found.findings == ()


def test_frames_say_what_two_radios_of_a_robot_measured_though_anchors_have_their_numbers(tmp_path):
    files = two_robots(seconds=40)
    made = [one for kind in ("odometry", "truth") for one in USUAL[kind](files) if "red" in one[0]]
    for t, x, y in zip(*[*files["truth_red.csv"].values()][:3], strict=True):
        for radio, (anchor, (a, b)) in itertools.product("12", {"1": (0.0, 0.0), "2": (8.0, 8.0)}.items()):
            fields = {"range": np.hypot(x - a, y - b), "header.frame_id": anchor}
            made.append((f"/uwb{radio}/range", "sensor_msgs/msg/Range", t, fields))
    write_messages(tmp_path / "team", made)
    (tmp_path / "anchors.csv").write_text("id,x,y\n1,0.0,0.0\n2,8.0,8.0\n")
    found = inspect_recording(tmp_path)
    assert {channel: len(one.time) for channel, one in found.log.readings.items()} == {"anchor_range": 4 * 400}
    assert found.findings == ()


def test_landmarks_at_places_ahead_and_to_the_left_of_a_robot_are_sightings(tmp_path):
    files, place, name = two_robots(seconds=40), np.array([4.0, 9.0]), "lab_msgs/msg/Seen"
    made = [one for kind in ("odometry", "truth") for one in USUAL[kind](files)]
    for robot, t, x, y, h in lines_of(files, "truth"):
        ahead, left = np.array([[np.cos(h), np.sin(h)], [-np.sin(h), np.cos(h)]]) @ (place - [x, y])
        made.append((f"/{robot}/landmarks", name, t, {"id": 7, "x": ahead, "y": left}))
    write_messages(tmp_path / "team", made, {name: "std_msgs/Header header\nint32 id\nfloat64 x\nfloat64 y"})
    (tmp_path / "landmarks.csv").write_text("id,x,y\n7,4.0,9.0\n")
    found = inspect_recording(tmp_path)
    assert {channel: len(one.time) for channel, one in found.log.readings.items()} == {"landmark": 800}
    assert found.findings == ()


@pytest.mark.parametrize(("anchored", "why"), [(False, "makes no difference to ranges"), (True, "the next best to")])
def test_which_of_two_radios_is_whose_matters_where_they_measured_anchors(tmp_path, anchored, why):
    files = two_robots(seconds=40)
    made = [one for kind in ("odometry", "truth") for one in USUAL[kind](files)]
    made += ranges("/uwb", "uwb_msgs/msg/UwbRange", "distance", more=of_driver)(files)
    for robot, t, x, y, _ in lines_of(files, "truth") if anchored else ():
        for k, (a, b) in enumerate(PLACES.values()):
            ends = {"requester_id": {"blue": 201, "red": 202}[robot], "responder_id": 100 + k}
            made.append(("/uwb", "uwb_msgs/msg/UwbRange", t, ends | {"distance": np.hypot(x - a, y - b)}))
    lines = [f"{100 + k},{a},{b}\n" for k, (a, b) in enumerate(PLACES.values())]
    write_messages(tmp_path / "team", made, DEFINITIONS)
    (tmp_path / "anchors.csv").write_text("id,x,y\n" + "".join(lines))
    text = inspect_recording(tmp_path).text
    assert why in text
    assert ('201 = "blue"' in text and '202 = "red"' in text) or not anchored


def test_anchors_places_may_stand_in_each_message_of_a_tag(tmp_path):
    files, rng = two_robots(seconds=40), np.random.default_rng(1)
    made = [one for kind in ("odometry", "truth") for one in USUAL[kind](files)]
    definitions = {"mdek_msgs/msg/Anchor": "string id\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 distanceFromTag"}
    definitions["mdek_msgs/msg/Anchors"] = "std_msgs/Header header\nmdek_msgs/Anchor[] anchors"
    for robot, t, x, y, _ in lines_of(files, "truth"):
        far = {name: np.hypot(x - a, y - b) + rng.normal(0, 0.05) for name, (a, b) in PLACES.items()}
        at = {name: {"id": name, "x": a, "y": b, "z": 2.0} for name, (a, b) in PLACES.items()}
        seen = [at[name] | {"distanceFromTag": d} for name, d in far.items()]
        made.append((f"/{robot}/dwm1001/anchors", "mdek_msgs/msg/Anchors", t, {"anchors": seen}))
    write_messages(tmp_path / "team", made, definitions)
    log = inspect_recording(tmp_path).log
    assert log.anchors.names == (*PLACES,)
    assert len(log.readings["anchor_range"].time) == 2 * len(lines_of(files, "truth"))


def test_elements_of_an_array_are_of_whom_log_toml_says(tmp_path):
    files, name = two_robots(seconds=40), "std_msgs/msg/Float64MultiArray"
    made = [one for kind in ("odometry", "truth") for one in USUAL[kind](files)]
    layout = {"layout.dim": [], "layout.data_offset": 0}
    measured = list(zip(*files["uwb.csv"].values(), strict=True))
    made += [(f"/{robot}/uwb", name, t, {**layout, "data": np.array([9.0, d])}) for t, robot, _, d in measured]
    write_messages(tmp_path / "team", made)
    found = inspect_recording(tmp_path)
    assert sum("/uwb, an array that does not say of what: write each = {" in line for line in found.unused) == 2
    each = 'each = { red = "data.1", blue = "data.1", a1 = "data.0" }\n[anchors]\nplaces = { a1 = [9.0, 0.0] }'
    (tmp_path / "log.toml").write_text(f'{found.text}\n[[ranges]]\ntopic = "/{{robot}}/uwb"\n{each}\n')
    readings = inspect_recording(tmp_path).log.readings
    np.testing.assert_allclose(np.sort(readings["range"].values[:, 0]), np.sort(files["uwb.csv"]["range"]))
    assert readings["anchor_range"].values.tolist() == [[9.0]] * len(measured)


def test_frames_that_odometry_moves_are_no_truth(tmp_path):
    files = two_robots(seconds=40)
    made = USUAL | {"truth": frames("odom")}
    write_messages(tmp_path / "team", [one for make in made.values() for one in make(files)])
    found = inspect_recording(tmp_path)
    assert not any(found.log.truth)
    assert any(line.startswith("truth, as no pose has the name") for line in found.unused)


@pytest.mark.parametrize("names", [("tb3_blue", "tb3_red"), ("r1", "r10"), ("1", "2")])
def test_a_robots_name_is_a_word_of_its_topics(tmp_path, names):
    """Robots tb3_blue and tb3_red share letters and a number, r1 stands in r10, /odom_1 is of 1, a sonar of none."""
    written = dict(zip(ROBOTS, names, strict=True))
    messages = [one for make in USUAL.values() for one in make(two_robots(seconds=40))]
    for robot, name in written.items():
        messages = [(topic.replace(f"/{robot}", f"/{name}"), *rest) for topic, *rest in messages]
    if names == ("1", "2"):
        messages = [(re.sub(r"/([12])/odom", r"/odom_\1", topic), *rest) for topic, *rest in messages]
    sonar = {"range": 0.25, "header.frame_id": "sonar_10"}
    messages += [(f"/{names[0]}/sonar", "sensor_msgs/msg/Range", one[2], sonar) for one in messages[:300]]
    write_messages(tmp_path / "team", messages)
    log = inspect_recording(tmp_path).log
    assert log.robots == names
    assert 0.25 not in log.readings["range"].values
    assert [one.source for one in log.truth] == [f"/vrpn/{name}/pose" for name in names]
    assert len(log.readings["range"].time) > 100


def test_places_on_the_globe_are_those_of_the_tangent_plane():
    """Against the way over the centre of the earth."""
    a, e2 = 6_378_137.0, 0.0818191908426215**2

    def centred(latitude, longitude):
        phi, theta = np.radians([latitude, longitude])
        N = a / np.sqrt(1 - e2 * np.sin(phi) ** 2)
        return N * np.array([np.cos(phi) * np.cos(theta), np.cos(phi) * np.sin(theta), (1 - e2) * np.sin(phi)])

    for latitude in (-33.0, 0.0, 60.0):
        origin, there = (latitude, 8.4), (latitude + 0.001, 8.402)
        (phi, theta), moved = np.radians(origin), centred(*there) - centred(*origin)
        east = np.array([-np.sin(theta), np.cos(theta), 0.0])
        north = np.array([-np.sin(phi) * np.cos(theta), -np.sin(phi) * np.sin(theta), np.cos(phi)])
        np.testing.assert_allclose(metres_on_globe(*there, origin), [east @ moved, north @ moved], atol=0.01)
