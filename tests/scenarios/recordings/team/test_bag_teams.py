"""A team's log from a bag, by what log.toml says of its topics."""

import os
from pathlib import Path

import numpy as np
import pytest
from made_bags import KINDS, made_bag

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings import bags, schema

DATA = Path(os.environ.get("COOPLOC_DATA", "../shared/data"))
REAL = DATA / "uwb-tiers"
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
TWO = """
format = "bag"
robots = ["turtle01", "turtle03"]
[odometry]
kind = "velocity"
topic = "/{robot}/odom"
[truth]
topics.turtle01 = "/vrpn_client_node/turtlebot01_cap/pose"
topics.turtle03 = "/vrpn_client_node/turtlebot03_cap/pose"
[ranges]
topic = "/uwb/tof/n_{robot}/n_{other}/distance"
nodes = { 2 = "turtle01", 3 = "turtle03" }
"""


def described(folder, text=DESCRIPTION):
    (folder / "log.toml").write_text(text)
    return schema.load(folder / "log.toml")


@pytest.fixture(scope="module", params=KINDS)
def team(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    _, written = made_bag(folder, request.param)
    description = described(folder)
    runs = bags.runs(folder, description)
    assert list(runs) == ["team"]
    return bags.read(folder, runs["team"], "team", description), written


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
    assert any("/range/red/dock" in warning and "not positive" in warning for warning in log.warnings)
    strengths = written["/rssi/red/blue"][1]
    np.testing.assert_allclose(log.readings["rssi"].values, strengths[strengths < -40].reshape(-1, 1), atol=1e-6)
    seen = log.readings["sighting"]
    assert len(seen.time) == 7  # messages with one detection: 3 m to the right, 0.1 m ahead
    np.testing.assert_allclose(seen.values[0], [np.hypot(3, 0.1), np.arctan2(-3, 0.1)])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("/{robot}/odom", "/{robot}/odo", "robot 'red' has fewer than two samples of odometry"),
        ("/{robot}/odom", "/red/odom", "of which robot"),
        ("/mocap/{robot}", "/uwb/red/{robot}", "topic /uwb/red/blue has range"),
        ("/mocap/{robot}", "/chatter{robot}", "no robot has a truth"),
        ('"velocity"', '"path"', "not 'path'; correct kind"),
        ("/rssi/{robot}/{other}", "/{robot}/odom", "not one number"),
    ],
)
def test_a_topic_that_does_not_fit_is_one_line(tmp_path, old, new, said):
    assert old in DESCRIPTION
    path, _ = made_bag(tmp_path, "mcap")
    with pytest.raises(BadInput, match=said):
        bags.read(tmp_path, path, "team", described(tmp_path, DESCRIPTION.replace(old, new, 1)))


def test_each_bag_in_a_directory_is_a_run_and_a_directory_of_bags_is_one(tmp_path):
    made_bag(tmp_path, "ros1")
    (tmp_path / "each").mkdir()
    made_bag(tmp_path / "each", "mcap")
    assert sorted(bags.runs(tmp_path, described(tmp_path))) == ["each", "team"]


@pytest.mark.skipif(not REAL.exists(), reason="needs ../shared/data/uwb-tiers")
def test_two_recorded_robots_are_read(tmp_path):
    log = bags.read(REAL, REAL / "two-robots", "two-robots", described(tmp_path, TWO))
    assert [len(series.time) for series in log.odometry] == [848, 851]
    assert [len(series.time) for series in log.truth] == [5431, 5431]
    assert len(log.readings["range"].time) == 3437
    assert log.warnings == ()
