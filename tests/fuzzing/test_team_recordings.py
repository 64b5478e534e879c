"""Recordings of a team that came to harm: read, perhaps with a warning, or one line; never a hang, or much memory."""

import resource

import pytest
from attempts import attempted, cases
from damage import HARM, harmed
from hypothesis import given
from hypothesis import strategies as st
from made_bags import KINDS, made_bag

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings import bags, pyfg, schema
from cooploc.scenarios.recordings.team_log import TeamLog

BAGS = """
format = "bag"
robots = ["red", "blue"]
odometry = { kind = "velocity", topic = "/{robot}/odom" }
truth.topic = "/mocap/{robot}"
ranges.topic = "/uwb/{robot}/{other}"
sightings.topics = { red = "/red/seen" }
"""
COV3, COV6 = "0.1 0 0.1", "0.1 0 0 0.1 0 0.1"
PYFG = "\n".join(
    [f"VERTEX_SE2 {t}.5 {r}{t} {t} {i} 0.1" for i, r in enumerate("AB") for t in range(6)]
    + ["VERTEX_XY L0 3 4", f"VERTEX_SE2:PRIOR 0.5 A0 0 0 0 {COV6}"]
    + [f"EDGE_SE2 {t}.5 {r}{t} {r}{t + 1} 1 0 0 {COV6}" for r in "AB" for t in range(5)]
    + [f"EDGE_RANGE {t}.5 A{t} B{t} 1.2 0.01" for t in range(6)]
    + [f"EDGE_RANGE 2.5 B2 L0 2.2 0.01\nEDGE_SE2_XY 2.5 A2 L0 1 4 {COV3}\n"]
)
MEMORY = 200  # [MB] that reading a small file may add
WORDS = st.sampled_from(
    ["nan", "inf", "1e308", "-1", "", "x", "L0", "A0", "B9", "A99999999999", "EDGE_RANGE", "VERTEX_XYZ", "#", "\0", "٣"]
)
PLACE = st.floats(0, 1, exclude_max=True)


def checked(read, *arguments):
    """A log whose arrays agree, or a BadInput in one line."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    log = attempted(read, *arguments)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MEMORY * 1024
    if isinstance(log, BadInput):
        assert "\n" not in str(log)
        return log
    assert isinstance(log, TeamLog)
    for series in (*log.odometry, *filter(None, log.truth)):
        assert len(series.time) == len(series.values)
        assert (series.time[1:] > series.time[:-1]).all()
    for readings in log.readings.values():
        assert len(readings.time) == len(readings.robot) == len(readings.other) == len(readings.values)
        assert (readings.time[1:] >= readings.time[:-1]).all()
    return log


@pytest.fixture(scope="module", params=KINDS)
def bag(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    path, _ = made_bag(folder, request.param, seconds=0.5)
    (folder / "log.toml").write_text(BAGS)
    file = path if path.is_file() else next(p for p in path.iterdir() if p.suffix != ".yaml")
    description = schema.load(folder / "log.toml")
    checked(bags.read, folder, path, "sound", description)  # the types of messages are compiled once
    return folder, path, file, file.read_bytes(), description


def test_a_sound_bag_is_read_without_a_warning(bag):
    folder, path, file, content, description = bag
    file.write_bytes(content)
    assert bags.read(folder, path, "team", description).warnings == ()


@cases(45)
@given(HARM)
def test_a_harmed_bag_is_read_or_one_line(bag, harm):
    folder, path, file, content, description = bag
    file.write_bytes(harmed(content, harm))
    read = checked(bags.read, folder, path, "team", description)
    cut = harm[0] in ("cut", "garbage", "empty", "remove", "folder")
    assert not cut or isinstance(read, BadInput) or read.warnings


@cases(45)
@given(HARM)
def test_a_ros2_bag_with_harmed_metadata_is_read_or_one_line(bag, harm):
    folder, path, file, content, description = bag
    file.write_bytes(content)
    index = path / "metadata.yaml"
    if not index.exists():
        pytest.skip("a ROS 1 bag is one file")
    before = index.read_bytes()
    index.write_bytes(harmed(before, harm))
    try:
        checked(bags.read, folder, path, "team", description)
    finally:
        index.write_bytes(before)


@cases(200)
@given(HARM)
def test_a_harmed_factor_graph_is_read_or_one_line(tmp_path_factory, harm):
    file = tmp_path_factory.getbasetemp() / "graph.pyfg"
    file.write_bytes(harmed(PYFG.encode(), harm))
    checked(pyfg.read_pyfg, file)


@cases(200)
@given(PLACE, PLACE, WORDS)
def test_a_factor_graph_with_a_field_that_says_anything_is_read_or_one_line(tmp_path_factory, line, field, word):
    file = tmp_path_factory.getbasetemp() / "graph.pyfg"
    lines = PYFG.split("\n")
    fields = lines[int(line * len(lines))].split(" ")
    fields[int(field * len(fields))] = word
    lines[int(line * len(lines))] = " ".join(fields)
    file.write_text("\n".join(lines), encoding="utf-8")
    checked(pyfg.read_pyfg, file)
