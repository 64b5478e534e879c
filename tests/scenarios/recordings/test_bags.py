"""Bags of all three kinds: what is read is what was written."""

import numpy as np
import pytest
from made_bags import KINDS, RATE, START, TOPICS, made_bag

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings import bags, schema
from cooploc.scenarios.recordings.bags import read_topics, topics

NUMBERS = [topic for topic in TOPICS if topic != "/chatter"]


@pytest.fixture(scope="module", params=KINDS)
def bag(request, tmp_path_factory):
    return made_bag(tmp_path_factory.mktemp(request.param), request.param)


def test_topics_have_types_counts_and_rates(bag):
    found, warnings = topics(bag[0])
    assert {info.name: info.type for info in found} == TOPICS
    assert {info.messages for info in found} == {20}
    np.testing.assert_allclose([info.rate for info in found], RATE)
    assert [info.name for info in found if not info.columns] == ["/chatter"]
    assert warnings == []


def test_values_and_header_stamps_equal_those_written(bag):
    path, written = bag
    series, warnings = read_topics(path, NUMBERS)
    assert warnings == []
    for topic in NUMBERS:
        time, rows = written[topic]
        np.testing.assert_allclose(series[topic].time, time, atol=1e-6)
        np.testing.assert_allclose(series[topic].values, rows, atol=1e-9)
        stamped = TOPICS[topic].startswith(("nav", "sensor")) or "Stamped" in TOPICS[topic] or "Array" in TOPICS[topic]
        assert series[topic].clock == ("header" if stamped else "receipt")


def test_headers_of_a_clock_that_was_not_set_are_shifted_to_the_recorders(tmp_path):
    path, written = made_bag(tmp_path, "mcap", behind=86_400)
    series, (warning,) = read_topics(path, ["/red/odom", "/red/cmd"])
    assert "86400.0 s behind" in warning
    np.testing.assert_allclose(series["/red/odom"].time, written["/red/odom"][0] + 0.005, atol=1e-6)
    np.testing.assert_allclose(series["/red/cmd"].time, written["/red/cmd"][0], atol=1e-6)


@pytest.mark.slow
def test_several_bags_are_read_as_one(tmp_path):
    path, _ = made_bag(tmp_path, "mcap", seconds=1.0)
    path.rename(tmp_path / "earlier")
    made_bag(tmp_path, "mcap", seconds=1.0, start=START + 3)
    found, _ = topics(tmp_path)
    assert {info.messages for info in found} == {20}


DESCRIPTION = """
format = "bag"
robots = ["red", "blue"]
[odometry]
kind = "velocity"
topic = "/{robot}/odom"
[truth]
topic = "/mocap/{robot}"
[[ranges]]
topic = "/uwb/{robot}/{other}"
[[ranges]]
topic = "/range/{robot}/{other}"
unit = "cm"
nodes = { dock = "north" }
[rssi]
topic = "/rssi/{robot}/{other}"
missing_from = -40.0
[sightings]
topics = { red = "/red/seen" }
[anchors]
places = { north = [3, 4] }
"""


def load(folder, text=DESCRIPTION):
    (folder / "log.toml").write_text(text)
    return schema.load(folder / "log.toml")


@pytest.fixture(scope="module", params=KINDS)
def team(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    _, written = made_bag(folder, request.param)
    description = load(folder)
    runs = bags.find_runs(folder, description)
    assert list(runs) == ["team"]
    return bags.read_run(runs["team"], "team", description), written


def test_odometry_and_truth_are_those_of_each_robots_topic(team):
    log, written = team
    assert log.robots == ("red", "blue")
    for i, robot in enumerate(log.robots):
        np.testing.assert_allclose(log.odometry[i].time, written[f"/{robot}/odom"][0], atol=1e-6)
        np.testing.assert_allclose(log.odometry[i].values, written[f"/{robot}/odom"][1][:, 4:], atol=1e-9)
        poses = written[f"/mocap/{robot}"][1][:, [0, 1, 3]]
        np.testing.assert_allclose(log.truth[i].values, poses, atol=1e-9)


def test_ranges_rssi_and_what_a_camera_saw_are_readings_in_si_units(team):
    log, written = team
    mates = log.readings["range"]
    assert set(mates.robot) == {0}
    assert set(mates.other) == {1}
    np.testing.assert_allclose(mates.values, written["/uwb/red/blue"][1], atol=1e-6)
    assert any("/range/red/dock" in warning and "range of 0 or less" in warning for warning in log.warnings)
    strengths = written["/rssi/red/blue"][1]
    np.testing.assert_allclose(log.readings["rssi"].values, strengths[strengths < -40].reshape(-1, 1), atol=1e-6)
    seen = log.readings["sighting"]
    assert len(seen.time) == 7  # messages with one detection: 3 m to the right, 0.1 m ahead
    np.testing.assert_allclose(seen.values[0], [np.hypot(3, 0.1), np.arctan2(-3, 0.1)])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("/{robot}/odom", "/red/odom", "of which robot"),
        ("/mocap/{robot}", "/uwb/red/{robot}", "topic /uwb/red/blue has range"),
        ('"velocity"', '"path"', "not 'path'; correct kind"),
        ("/rssi/{robot}/{other}", "/{robot}/odom", "not one number"),
        ("/{robot}/odom", "/{robot}/odo", r"no robot has two .* no topic '/red/odo'; did you mean '/red/odom'"),
        ('topic = "/{robot}/odom"', 'topic = "/{robot}/odom"\ntime = "t"', "time is a column of CSV files"),
    ],
)
def test_a_topic_that_does_not_fit_is_one_line(tmp_path, old, new, said):
    assert old in DESCRIPTION
    path, _ = made_bag(tmp_path, "mcap")
    with pytest.raises(BadInput, match=said):
        bags.read_run(path, "team", load(tmp_path, DESCRIPTION.replace(old, new, 1)))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("/mocap/{robot}", "/amcl/{robot}", ["there is no topic '/amcl/blue'; did you mean '/mocap/blue'?"]),
        ("/uwb/{robot}/{other}", "/uw/{robot}/{other}", ["there is no topic '/uw/red/blue'; did you mean '/uwb/red/"]),
    ],
)
def test_a_topic_that_is_not_there_is_named_with_the_nearest(tmp_path, old, new, said):
    path, _ = made_bag(tmp_path, "mcap")
    warnings = bags.read_run(path, "team", load(tmp_path, DESCRIPTION.replace(old, new, 1))).warnings
    found = [line.partition(": ")[2] for line in warnings if "there is no topic" in line]
    assert len(found) == len(said)
    assert all(line.startswith(start) for line, start in zip(found, said, strict=True))


def test_of_three_robots_a_reading_must_say_whom_it_measured(tmp_path):
    text = DESCRIPTION.split("[[ranges]]")[0].replace('"blue"]', '"blue", "green"]')
    for topic in ("/{robot}/odom", "/mocap/{robot}"):
        red, blue = (topic.format(robot=robot) for robot in ("red", "blue"))
        text = text.replace(f'topic = "{topic}"', f'topics = {{ red = "{red}", blue = "{blue}", green = "{blue}" }}')
    text += '[ranges]\ntopic = "/uwb/{robot}/blue"\nrange = "range"\n'
    path, _ = made_bag(tmp_path, "mcap")
    with pytest.raises(BadInput, match="topic /uwb/red/blue does not say what was measured"):
        bags.read_run(path, "team", load(tmp_path, text))
    named = bags.read_run(path, "team", load(tmp_path, f'{text}other = "header.frame_id"\n'))
    assert named.warnings == ("/uwb/red/blue: left out 20 readings of '': neither a robot of the team nor an anchor",)


def test_a_node_that_is_called_as_its_robot_is_read_once(tmp_path):
    path, _ = made_bag(tmp_path, "mcap")
    text = DESCRIPTION.replace("missing_from = -40.0", 'nodes = { red = "red", blue = "blue" }')
    log = bags.read_run(path, "team", load(tmp_path, text))
    assert len(log.readings["rssi"].time) == 20


def test_each_bag_in_a_directory_is_a_run_and_a_directory_of_bags_is_one(tmp_path):
    made_bag(tmp_path, "ros1")
    (tmp_path / "each").mkdir()
    made_bag(tmp_path / "each", "mcap")
    assert sorted(bags.find_runs(tmp_path, load(tmp_path))) == ["each", "team"]
