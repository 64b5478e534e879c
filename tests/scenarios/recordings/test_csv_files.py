"""A team's log from CSV files, as log.toml describes them."""

import gzip

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from made_team import ANCHORS, BIAS, DESCRIPTION, ROBOTS, describe, poses_at, write
from oracles import repeatable

import cooploc as cl
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings import csv_files, schema
from cooploc.scenarios.recordings.inspect.checks import check_recording
from cooploc.scenarios.recordings.text_files import parse_fields, plain_numbers, read_text, split_fields

UWB = DESCRIPTION[DESCRIPTION.index("[ranges]") : DESCRIPTION.index("[fit]")]


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sound") / "lab"
    return folder, write(folder, seconds=12.0, anchors=True)


@pytest.fixture
def lab(sound, tmp_path):
    """A copy that a test may change."""
    folder = tmp_path / "lab"
    folder.mkdir()
    for file in sound[0].iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    return folder


def read(folder, *changes):
    describe(folder, *changes)
    description = schema.load(folder / "log.toml")
    ((name, place),) = csv_files.find_runs(folder, description).items()
    return csv_files.read_run(place, name, description)


def same(a, b):
    for one, other in zip((*a.odometry, *a.truth), (*b.odometry, *b.truth), strict=True):
        np.testing.assert_allclose(one.time, other.time, rtol=0, atol=1e-6)
        np.testing.assert_allclose(one.values, other.values, rtol=0, atol=1e-8)
    assert a.readings.keys() == b.readings.keys()
    for channel, readings in a.readings.items():
        for one, other in zip(readings[:4], b.readings[channel][:4], strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-6)


def test_what_was_written_is_read(sound):
    folder, motions = sound
    log = read(folder)
    assert (log.name, log.robots, log.odometry_kind) == ("lab", ROBOTS, "velocity")
    for i, truth in enumerate(log.truth):
        np.testing.assert_allclose(truth.values, poses_at(motions, i, truth.time), atol=1e-5)
        np.testing.assert_allclose(log.odometry[i].time, motions.time[:-1], atol=1e-6)
    ranges = log.readings["range"]
    assert set(zip(ranges.robot.tolist(), ranges.other.tolist(), strict=True)) == {(0, 1)}
    red, blue = (poses_at(motions, i, ranges.time)[:, :2] for i in (0, 1))
    assert abs(np.median(ranges.values[:, 0] - np.hypot(*(red - blue).T)) - BIAS) < 0.03


def test_a_range_to_a_place_is_one_of_an_anchor(lab):
    places = ", ".join(f"{name} = [{x}, {y}]" for name, (x, y) in ANCHORS.items())
    (warning,) = read(lab).warnings
    assert "readings of 'east', 'north', 'south': neither a robot of the team nor an anchor" in warning
    assert check_recording(read(lab)).findings[0].change.startswith("[anchors] places = ")
    log = read(lab, ("[fit]", f"[anchors]\nplaces = {{ {places} }}\n[fit]"))
    assert log.anchors.names == tuple(ANCHORS)
    assert np.bincount(log.readings["anchor_range"].other).tolist() == [len(log.readings["range"].time)] * 3
    assert log.warnings == ()


def test_a_truncated_last_line_is_left_out_and_told(lab):
    whole = read(lab)
    for name in ("odom_red.csv", "uwb.csv", "mocap_blue.csv"):
        text = (lab / name).read_bytes()
        (lab / name).write_bytes(text[:-3])
        where = f"{lab / name}, line {len(text.splitlines())}"
        assert [w for w in read(lab).warnings if w.startswith(where) and w.endswith("; it was left out")]
        (lab / name).write_bytes(text[:-1])  # nobody knows whether a digit is missing
        assert any("cut off" in w for w in read(lab).warnings)
        (lab / name).write_bytes(text)
    same(read(lab), whole)


@pytest.mark.parametrize("sign", [";", "\t", "|", "  "])
def test_what_divides_the_fields_of_a_file_may_differ_from_the_rest(lab, sign):
    whole = read(lab)
    file = lab / "odom_red.csv"
    lines = file.read_text().replace(",", sign).splitlines()
    around = sign * (sign == "  ")  # columns may be aligned by blanks
    file.write_text("\n".join([f"{lines[0]}{around}", *(f"{around}{line}" for line in lines[1:]), ""]))
    same(read(lab), whole)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("# by Bob; on Monday; at noon\n" * 1200 + "t,x\n0,1\n1,2\n", ["t", "x"]),
        ("0,1;1,2;3,4\n0,2;1,2;3,4\n", ["1", "2", "3"]),
        ("t,ids\n0.0,1;2;3\n0.1,2;3;4\n", ["t", "ids"]),
        ('t;name;x\n0;"a,b,c,d";1\n1;"a,b,c,d";2\n', ["t", "name", "x"]),
        ("time (s), the robot, x\n0, red one, 1\n1, red one, 2\n", ["time (s)", "the robot", "x"]),
        ("t\n1\n2\n", ["t"]),
        ("", []),
    ],
)
def test_a_sign_within_comments_numbers_lists_or_names_divides_no_fields(text, names):
    assert split_fields(text)[0] == names


def test_one_file_for_all_robots_says_the_same(lab):
    whole = read(lab)
    rows = [
        (float(line.split(",")[0]), f"{line},{robot[0].upper()}")
        for robot in ROBOTS
        for line in (lab / f"odom_{robot}.csv").read_text().splitlines()[1:]
    ]
    (lab / "odom.csv").write_text("t,v,w,who\n" + "\n".join(line for _, line in sorted(rows)) + "\n")
    column = 'file = "odom.csv"\nrobot = "who"\nnodes = { R = "red", B = "blue" }'
    same(read(lab, ('file = "odom_{robot}.csv"', column)), whole)


def test_units_clocks_and_frames_are_undone(lab):
    whole = read(lab)
    for robot in ROBOTS:
        sec, nsec, x, y, yaw = np.loadtxt(lab / f"mocap_{robot}.csv", delimiter=",", skiprows=1).T
        table = np.column_stack([(sec + nsec * 1e-9 + 2.5), x * 1000, -y * 1000, np.degrees(-yaw)])
        np.savetxt(lab / f"mocap_{robot}.csv", table, fmt="%.9f", delimiter=",", header="t,x,y,yaw", comments="")
    changes = [
        ('time = ["sec", { column = "nsec", unit = "ns" }]', 'time = "t"\nclock_offset = -2.5\nframe = "mirrored"'),
        ('x = "x"', 'x = { column = "x", unit = "mm" }'),
        ('y = "y"', 'y = { column = "y", unit = "mm" }'),
        ('heading = "yaw"', 'heading = { column = "yaw", unit = "deg" }'),
    ]
    same(read(lab, *changes), whole)


@pytest.mark.parametrize("sideways", [0.0, 0.02])
def test_increments_are_the_poses_that_they_lead_to(lab, sideways):
    (lab / "mocap_blue.csv").unlink()
    (lab / "odom_blue.csv").unlink()
    rng = np.random.default_rng(1)
    steps = np.column_stack([rng.uniform(0, 0.1, 80), sideways * rng.normal(size=80), rng.normal(0, 0.2, 80)])
    at, poses = np.zeros(3), []
    for dx, dy, turn in [np.zeros(3), *steps[1:]]:
        c, s = np.cos(at[2]), np.sin(at[2])
        at = at + np.array([c * dx - s * dy, s * dx + c * dy, turn])
        poses.append(at)
    table = np.column_stack([1.7e9 + 0.1 * np.arange(80), steps])
    np.savetxt(lab / "odom_red.csv", table, "%.9f", ",", header="t,ahead,left,turned", comments="")
    columns = 'dx = "ahead"\n' + 'dy = "left"\n' * (sideways > 0) + 'turn = "turned"'
    changes = ('kind = "velocity"', 'kind = "increment"'), ('speed = "v"', columns), ('turn_rate = "w"', "")
    log = read(lab, *changes)
    assert log.odometry_kind == "pose"
    np.testing.assert_allclose(log.odometry[0].values, poses, atol=1e-6)
    text = (lab / "odom_red.csv").read_text()
    (lab / "odom_red.csv").write_text(text.rstrip().rpartition(",")[0] + ",\n")  # the last has no turn
    np.testing.assert_allclose(read(lab, *changes).odometry[0].values, poses[:-1], atol=1e-6)


def test_a_column_for_each_anchor_says_the_same(lab):
    places = "[anchors]\nplaces = { north = [4, 5.5], south = [1, 0.5], east = [7.5, 3] }\n[fit]"
    whole = read(lab, ("[fit]", places)).readings["anchor_range"]
    table = {}
    for line in (lab / "uwb.csv").read_text().splitlines()[1:]:
        at, who, other, d = line.split(",")
        table.setdefault((at, who), {})[other] = d
    lines = [f"{at},{who},{row['north']},{row['south']}" for (at, who), row in table.items()]
    (lab / "wide.csv").write_text("t,from,n,s\n" + "\n".join(lines) + "\n")
    wide = UWB.replace("uwb.csv", "wide.csv").replace(
        'other = "to"\nrange = "d"', 'each = { north = "n", south = "s" }'
    )
    found = read(lab, (UWB, wide), ("[fit]", places)).readings["anchor_range"]
    kept = whole.other < 2
    for one, other in zip(found[:4], whole[:4], strict=True):
        np.testing.assert_array_equal(one, other[kept])


def test_a_jump_that_no_robot_can_make_is_left_out(lab):
    lines = (lab / "mocap_red.csv").read_text().splitlines()
    fields = lines[100].split(",")
    lines[100] = ",".join([*fields[:2], "55.0", *fields[3:]])
    (lab / "mocap_red.csv").write_text("\n".join(lines) + "\n")
    log = read(lab, ('x = "x"', 'x = "x"\nmax_speed = 2.0'))
    assert np.isnan(log.truth[0].values).any(-1).sum() == 1
    assert any("left out 1 true position out of reach" in w for w in log.warnings)


def test_true_positions_at_exactly_0_0_and_far_from_all_others_were_lost(lab):
    whole = read(lab).truth[0]
    lines = (lab / "mocap_red.csv").read_text().splitlines()
    for k in (1, 60, 61, len(lines) - 1):
        lines[k] = ",".join([*lines[k].split(",")[:2], "0.0", "0.0", "0.0"])
    (lab / "mocap_red.csv").write_text("\n".join(lines) + "\n")
    log = read(lab)
    lost = [0, 59, 60, len(lines) - 2]
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(log.truth[0].values[:, 0])), lost)
    np.testing.assert_array_equal(np.delete(log.truth[0].values, lost, 0), np.delete(whole.values, lost, 0))
    assert any("left out 4 true positions at exactly 0, 0" in w for w in log.warnings)


def test_a_robot_without_truth_is_told_and_one_without_odometry_left_out(lab):
    (lab / "mocap_blue.csv").unlink()
    log = read(lab)
    assert log.truth[1] is None
    assert any("robot 'blue' has no truth" in w for w in log.warnings)
    (lab / "odom_blue.csv").unlink()
    assert read(lab).robots == ("red",)
    assert any("robot 'blue' has fewer than two samples of odometry; it was left out" in w for w in read(lab).warnings)


@pytest.mark.slow
def test_a_strict_run_refuses_what_another_reads_around_and_says_that_trials_are_runs(lab, tmp_path, capsys):
    describe(lab, ("seconds = 60.0", "seconds = 6.0"))
    odometry = sorted(lab.glob("odom*.csv"))[0]
    odometry.write_text(odometry.read_text() + "12.3,torn")
    options = {"data": lab, "estimators": "dead-reckoning,constant,mrsl-rssi", "out": tmp_path / "run"}
    with pytest.raises(BadInput, match=rf"{odometry.name}.*: mend the recording, or leave out --strict$"):
        cl.run_study("log", **options, strict=True)
    assert not (tmp_path / "run").exists()
    assert not len(cl.run_study("log", **options, trials=3).failures)
    said = capsys.readouterr().err
    assert "trials of a recording are its runs, not the 3 asked for: log/all has 1\n" in said
    assert "left out: mrsl-rssi[anchor_reading=any]: needs channel" in said  # it has no ranges to places


def test_a_star_in_a_name_stands_for_what_one_file_has_there(lab):
    described, dated = ('"mocap_{robot}.csv"', '"mocap_{robot}_*.csv"'), lab / "mocap_red_10-19-31.csv"
    before = read(lab)
    (lab / "mocap_red.csv").rename(dated)
    (lab / "mocap_blue.csv").rename(lab / "mocap_blue_10-19-33.csv")
    same(read(lab, described), before)
    (lab / "mocap_red_again.csv").write_bytes(dated.read_bytes())
    with pytest.raises(BadInput, match=r"mocap_red_\*.csv: this is of mocap_red_10-19-31.csv, .*again.csv; keep one"):
        read(lab, described)


def test_a_compressed_text_may_be_in_parts_and_cut_off(tmp_path):
    path = tmp_path / "odom.csv.gz"
    lines = "".join(f"{k},{k * k % 97}\n" for k in range(20_000))
    path.write_bytes(gzip.compress(b"time,v\n") + gzip.compress(lines.encode()))
    assert read_text(path) == f"time,v\n{lines}"
    path.write_bytes(path.read_bytes()[:-2000])
    assert 1000 < len(text := read_text(path)) < len(lines)
    assert f"time,v\n{lines}".startswith(text)
    path.write_bytes(b"time,v\n1,2\n")
    with pytest.raises(BadInput, match="this is no gzip file, or it is damaged"):
        read_text(path)


@pytest.mark.parametrize("text", ["[" * 100_000, "[1, 2]", '{"a": 1', "[]"], ids=range(4))
def test_json_that_is_no_table_is_one_line(tmp_path, text):
    (tmp_path / "odom.json").write_text(text)
    with pytest.raises(BadInput, match=r"odom.json: this is no json file, or it is damaged"):
        read_text(tmp_path / "odom.json")


WORDS = [
    "",
    " ",
    "nan",
    "inf",
    "1e400",
    "-",
    "1_000",
    "0x10",
    "1,5",
    "true",
    "12:30:01",
    "1 2",
    "#3",
    '"1"',
    "1.",
    "+3",
    "-0",
]


@pytest.mark.slow
@given(
    rows=st.lists(
        st.lists(st.floats(-1e19, 1e19, width=64) | st.sampled_from(WORDS), min_size=3, max_size=3), min_size=1
    ),
    head=st.sampled_from(["t,x,y", "1,2,3", "# t,x,y", "a title\nt,x,y", "t,x,y\n", "t,x"]),
    delimiter=st.sampled_from([",", ", ", ";", "\t"]),
    end=st.sampled_from(["\n", "\n\n", "", "\n1,2\n"]),
)
@example(rows=[[1.0, "", 2.0], [2.0, "", 3.0]], head="t,x,y", delimiter=",", end="\n")  # a column is empty
@example(rows=[[1.0, 2.0, 3.0], ["", "", ""]], head="t,x,y", delimiter=",", end="\n")  # a line
@example(rows=[[1.0, 2.0, 3.0], [2.0, 1e31, 3.0]], head="t,x,y", delimiter=",", end="\n")
@repeatable
def test_files_of_numbers_alone_are_read_as_all_others_to_the_bit(rows, head, delimiter, end):
    lines = [head.replace(",", delimiter), *(delimiter.join(map(str, row)) for row in rows)]
    text = "\n".join(lines) + end.replace(",", delimiter)
    plain = plain_numbers(text)
    words = not all(isinstance(one, float) and one < 1e30 for row in rows for one in row)
    assert plain is not None or words or end != "\n" or head.count(",") < 2 or "\n" in head or head.startswith("#")
    if plain is not None:
        known = np.isfinite(plain.values)
        assert known.any(0).all()  # what a column is without any number is for others to say
        assert known.any(1).all()
        assert np.nanmax(np.abs(plain.values)) < 1e31
        names, line, content = split_fields(text)
        assert (plain.head, plain.named) == (names, line)
        assert [i for i, _ in content] == [*range(plain.first, plain.first + len(plain.values))]
        slow = np.array([parse_fields(fields) for _, fields in content])
        np.testing.assert_array_equal(plain.values, slow)
        np.testing.assert_array_equal(np.signbit(plain.values), np.signbit(slow))
