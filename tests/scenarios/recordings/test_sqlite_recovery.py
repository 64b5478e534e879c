"""Damaged bags: what is recovered is what was written, and a warning says how much that is."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
from made_bags import made_bag
from rosbags.typesys import Stores, get_typestore

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.bag_storage import decode_ros2
from cooploc.scenarios.recordings.bags import read_topics, topics

DATA = Path(os.environ.get("COOPLOC_DATA", "../shared/data"))
FOUR = DATA / "uwb-tiers" / "four-robots"
TOPIC = "/red/odom"


def storage(path):
    return path if path.is_file() else next(p for p in path.iterdir() if p.suffix != ".yaml")


def rows(time, values):
    return {(round(t * 1e6), *np.round(row, 6)) for t, row in zip(time, values, strict=True)}


def recovered(path):
    """Rows of one topic and the warnings; no row where nothing can be read."""
    try:
        series, warnings = read_topics(path, [TOPIC])
    except BadInput as e:
        return set(), (str(e),)
    return rows(series[TOPIC].time, series[TOPIC].values), warnings


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path, written = made_bag(tmp_path_factory.mktemp("bag"), "sqlite3", seconds=5.0)
    return path, storage(path).read_bytes(), rows(*written[TOPIC])


@pytest.mark.slow
def test_of_a_bag_cut_off_anywhere_what_was_written_before_is_recovered(bag):
    path, raw, written = bag
    found = []
    for share in np.sort(np.random.default_rng(1).uniform(size=100)):
        storage(path).write_bytes(raw[: int(share * len(raw))])
        got, warnings = recovered(path)
        assert got <= written
        assert warnings
        found.append(len(got))
        assert len(got) >= (share - 0.25) * len(written)
    assert found == sorted(found)


def test_the_warning_says_how_many_messages_the_whole_bag_had(bag):
    path, raw, _ = bag
    storage(path).write_bytes(raw[: len(raw) // 2])
    whole = re.search(r"\n  message_count: (\d+)", (path / "metadata.yaml").read_text())[1]
    assert f" of {whole} messages recovered" in recovered(path)[1][0]


@pytest.mark.slow
def test_of_a_bag_with_bytes_missing_most_is_recovered(bag):
    path, raw, written = bag
    rng = np.random.default_rng(2)
    for begin in rng.uniform(0.3, 0.7, 30):
        at = int(begin * len(raw))
        storage(path).write_bytes(raw[:at] + raw[at + int(rng.integers(1, 200)) :])
        got, warnings = recovered(path)
        assert len(got - written) <= 1  # the message that bytes are missing in may still look like one
        assert len(got) >= 0.9 * len(written)
        assert warnings


def test_ranges_are_decoded_by_the_definition_of_before_and_after_they_got_a_variance():
    for version, more in ((Stores.ROS2_HUMBLE, {}), (Stores.LATEST, {"variance": 0.5})):
        store = get_typestore(version)
        time = store.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
        header = store.types["std_msgs/msg/Header"](stamp=time, frame_id="uwb")
        sent = {"radiation_type": 0, "field_of_view": 0.1, "min_range": 0.0, "max_range": 9.0, "range": 3.25, **more}
        raw = store.serialize_cdr(store.types["sensor_msgs/msg/Range"](header=header, **sent), "sensor_msgs/msg/Range")
        assert decode_ros2(bytes(raw), "sensor_msgs/msg/Range").range == 3.25


def test_a_split_bag_whose_last_file_is_empty_is_read_without_it(tmp_path):
    path, written = made_bag(tmp_path, "sqlite3")
    (path / "team_1.db3").write_bytes(b"")
    index = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(index.replace("- team.db3", "- team.db3\n  - team_1.db3"))
    got, warnings = recovered(path)
    assert got == rows(*written[TOPIC])
    assert any("team_1.db3: cannot be read" in warning for warning in warnings)


@pytest.mark.parametrize(
    ("kind", "remedy"), [("sqlite3", "get the file again"), ("mcap", "mcap recover"), ("ros1", "rosbag reindex")]
)
def test_an_empty_file_is_one_line_that_says_what_repairs_it(tmp_path, kind, remedy):
    path, _ = made_bag(tmp_path, kind)
    storage(path).write_bytes(b"")
    with pytest.raises(BadInput, match=remedy):
        topics(path)


@pytest.mark.slow
@pytest.mark.skipif(not FOUR.exists(), reason="needs ../shared/data/uwb-tiers")
def test_of_the_recorded_bag_with_bytes_missing_all_but_18_log_messages_are_recovered():
    found, (warning,) = topics(FOUR)
    assert "damaged: 13094 of 13112 messages recovered" in warning
    index = (FOUR / "metadata.yaml").read_text().split("topic_metadata:")[1:]
    expected = {t.split("name: ")[1].split()[0]: int(t.split("message_count: ")[1].split()[0]) for t in index}
    expected["/rosout"] -= 18
    assert {info.name: info.messages for info in found if info.messages} == {k: n for k, n in expected.items() if n}
