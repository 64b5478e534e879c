"""Bags of all three kinds: what is read is what was written."""

import numpy as np
import pytest
from made_bags import KINDS, RATE, START, TOPICS, made_bag

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.bags import read_series, read_topics, topics

NUMBERS = [topic for topic in TOPICS if topic != "/chatter"]


@pytest.fixture(scope="module", params=KINDS)
def bag(request, tmp_path_factory):
    return made_bag(tmp_path_factory.mktemp(request.param), request.param)


def test_topics_have_types_counts_and_rates(bag):
    found, warnings = topics(bag[0])
    assert {info.name: info.type for info in found} == TOPICS
    assert {info.messages for info in found} == {20}
    np.testing.assert_allclose([info.rate for info in found], RATE)
    assert [info.gaps for info in found] == [()] * len(TOPICS)
    assert [info.name for info in found if not info.columns] == ["/chatter"]
    assert warnings == ()


def test_values_and_header_stamps_equal_those_written(bag):
    path, written = bag
    series, warnings = read_topics(path, NUMBERS)
    assert warnings == ()
    for topic in NUMBERS:
        time, rows = written[topic]
        np.testing.assert_allclose(series[topic].time, time, atol=1e-6)
        np.testing.assert_allclose(series[topic].values, rows, atol=1e-9)
        stamped = TOPICS[topic].startswith(("nav", "sensor")) or "Stamped" in TOPICS[topic] or "Array" in TOPICS[topic]
        assert series[topic].clock == ("header" if stamped else "receipt")


def test_a_topic_that_is_not_there_or_not_read_is_named(bag):
    with pytest.raises(BadInput, match="did you mean '/red/odom'"):
        read_series(bag[0], "/red/odm")
    with pytest.raises(BadInput, match="has type std_msgs/msg/String, which is not read"):
        read_series(bag[0], "/chatter")


@pytest.mark.parametrize("kind", KINDS)
def test_headers_of_a_clock_that_was_not_set_are_shifted_to_the_recorders(tmp_path, kind):
    path, written = made_bag(tmp_path, kind, behind=86_400)
    series, (warning,) = read_topics(path, ["/red/odom", "/red/cmd"])
    assert "86400.0 s behind" in warning
    np.testing.assert_allclose(series["/red/odom"].time, written["/red/odom"][0] + 0.005, atol=1e-6)
    np.testing.assert_allclose(series["/red/cmd"].time, written["/red/cmd"][0], atol=1e-6)


def test_several_bags_are_read_as_one_and_the_silence_between_them_is_a_gap(tmp_path):
    path, _ = made_bag(tmp_path, "mcap", seconds=1.0)
    path.rename(tmp_path / "earlier")
    made_bag(tmp_path, "mcap", seconds=1.0, start=START + 3)
    found, _ = topics(tmp_path)
    assert {info.messages for info in found} == {20}
    assert all(len(info.gaps) == 1 and info.gaps[0][1] == pytest.approx(2.1) for info in found)


def test_no_bag_is_one_line(tmp_path):
    with pytest.raises(BadInput, match="no such file"):
        topics(tmp_path / "nothing")
    with pytest.raises(BadInput, match="no bag here"):
        topics(tmp_path)
