"""A team's directory with one thing wrong in log.toml or in a file: one line that names the place."""

import re

import pytest
from attempts import attempted
from made_team import DESCRIPTION, describe, write

import cooploc as cl
from cooploc.estimators.errors import BadInput

SHORT = DESCRIPTION.replace("seconds = 60.0", "seconds = 4.0")

# What is replaced in log.toml, by what, and a part of what is said.
IN_TOML = [
    ('format = "csv"', 'format = "cvs"', "log.toml: format"),
    ('format = "csv"', 'format = "bag"', "no bag here"),
    ('format = "csv"', 'format = "pyfg"', "has odometry, truth, readings and places in its files; correct them there"),
    ('robots = ["red", "blue"]', "", "robots is missing"),
    ('robots = ["red", "blue"]', 'robots = ["husky 1", "blue"]', "'husky 1' cannot be a name here: it has a blank"),
    ('robots = ["red", "blue"]', 'robots = ["red", "red"]', "'red' is the name of two things"),
    ("arena = [[0, 0], [8, 6]]", "arena = [[8, 6], [0, 0]]", "lower left and the upper right corner"),
    ("arena = [[0, 0], [8, 6]]", "", "state its corners"),
    ('kind = "velocity"', 'kind = "speed"', "odometry.kind"),
    ('kind = "velocity"', 'kind = "pose"', "kind 'pose' takes x, y, heading, not speed, turn_rate"),
    ('speed = "v"', "", "kind 'velocity' takes speed, turn_rate, not turn_rate"),
    ('speed = "v"', 'speed = "vv"', "there is no column 'vv'; did you mean 'v'"),
    ('speed = "v"', 'speed = { column = "v", unit = "knots" }', "unit 'knots' is not one of m/s"),
    ('range = "d"', 'range = "d"\nunit = "cm"', 'of a column it is range = { column = "...", unit = "cm" }'),
    ('speed = "v"', 'speed = { name = "v" }', 'write a column as "name" or'),
    ('file = "odom_{robot}.csv"', 'file = "odom.csv"', "whose lines are they"),
    ('file = "odom_{robot}.csv"', 'file = "odo_{robot}.csv"', "has a file odo_{robot}.csv"),
    ('file = "odom_{robot}.csv"', 'file = "../odom_{robot}.csv"', "name one inside the directory"),
    ('file = "odom_{robot}.csv"', "", "state where it is"),
    ("[truth]", "[truth]\nclock_offset = nan", "truth.clock_offset"),
    ("[truth]", "[truth]\nclock_offset = 500.0", "share no time: state clock_offset"),
    ('x = "x"', "", "name the columns x and y"),
    ('file = "mocap_{robot}.csv"', 'file = "mokap_{robot}.csv"', "mokap_red.csv: there is no such file"),
    ('heading = "yaw"', "", "has no true heading"),
    ('range = "d"', "", "name the column"),
    ('range = "d"', 'range = "d"\neach = { north = "d" }', "name the column"),
    ('other = "to"\nrange = "d"', 'others = { 1 = "a1" }\neach = { red = "d" }', "each and others exclude each other"),
    ("[fit]", "[anchors]\n[fit]", "anchors.places: it is missing"),
    ("[fit]", "[sample]\nstart = 100\n[fit]", "less than a tick of 0.1 s: choose a smaller start"),
    ("[fit]", "[sample]\nduration = 0.01\n[fit]", "less than a tick of 0.1 s: choose a longer duration"),
    ("[fit]", '[prior]\nposition = "somewhere"\n[fit]', "prior.position"),
    ("[fit]", "[prior]\nheading = { red = 0.0 }\n[fit]", "prior.heading"),
    ("[fit]", "[prior]\n'' = 0.0\n[fit]", "there is no key '' in [prior]"),
    ("seconds = 4.0", "", 'on = "first part" needs seconds'),
    ('on = "first part"\nseconds = 4.0', 'on = "other runs"', "is fitted on no other run, too little for"),
    ("seconds = 4.0", "seconds = 4.0\n[model]\nsigmav = 1", "did you mean 'sigma_v'"),
    ("seconds = 4.0", "seconds = 4.0\nseconds = 5.0", "cannot be read as TOML"),
]


# The file, what is replaced in a line of it, by what, and a part of what is said: the directory is refused, or the line
# is left out, or its field counts as empty.
IN_FILES = [
    ("odom_red.csv", 1, "t,v,w", "t,v", "there is no column 'w'"),
    ("odom_red.csv", 1, "t,v,w", "t,v,v,w", "two columns are named 'v'"),
    ("uwb.csv", 5, ",", "\0\0,", "which is not a number; it counts as empty"),
    ("uwb.csv", 5, ",", ",".join(6 * "\0"), "line 5: this is not UTF-8 text"),
    ("odom_red.csv", 7, ",", ";", "line 7: 2 fields, not 3; it was left out"),
    ("odom_red.csv", 7, ",", ",x", "line 7: v is 'x"),
    ("odom_red.csv", 7, ",", ",,", "4 fields, not 3; it was left out"),
    ("odom_red.csv", 7, "17", "", "left out 1 line whose stamp is days from the others"),
    ("mocap_blue.csv", 9, "17", "x17", "line 9: sec is 'x17"),
    ("uwb.csv", 5, "17", "seventeen", "left out 1 line without a stamp"),
    (
        "uwb.csv",
        5,
        "17",
        "99999999999999999917",
        "left out 1 reading by 'red' with stamps that are days from the others",
    ),
    ("odom_red.csv", 1, "t", '"t', "there is no column 't'"),
    ("odom_red.csv", 7, "17", '"17', "line 7: 1 field, not 3; it was left out"),
]


@pytest.fixture
def copied(tmp_path):
    write(tmp_path / "lab", seconds=6.0, hertz=10.0)
    describe(tmp_path / "lab", text=SHORT)
    return tmp_path / "lab"


def told(folder):
    """The one line with which the directory is refused."""
    found = attempted(cl.simulate, "log/all", data=folder)
    assert isinstance(found, BadInput), "it was read"
    assert "\n" not in str(found)
    return str(found)


@pytest.mark.parametrize(("old", "new", "said"), IN_TOML, ids=range(len(IN_TOML)))
def test_one_thing_wrong_in_the_description(copied, old, new, said):
    describe(copied, (old, new), text=SHORT)
    assert said in told(copied)


def test_of_more_than_two_robots_it_must_be_said_what_was_measured(copied):
    of_three = ('robots = ["red", "blue"]', 'robots = ["red", "blue", "green"]')
    describe(copied, ('other = "to"', ""), of_three, text=SHORT)
    assert 'what was measured: other = "the column of names", or {other} in the name of the file' in told(copied)


@pytest.mark.parametrize(("name", "line", "old", "new", "said"), IN_FILES, ids=range(len(IN_FILES)))
def test_one_thing_wrong_in_a_file(copied, name, line, old, new, said):
    rows = (copied / name).read_text().split("\n")
    assert old in rows[line - 1]
    rows[line - 1] = rows[line - 1].replace(old, new, 1)
    (copied / name).write_text("\n".join(rows))
    found = attempted(cl.simulate, "log/all", data=copied)
    lines = [str(found)] if isinstance(found, BadInput) else found[1].notes["warnings"]
    assert any(name in line and said in line for line in lines), lines


def test_a_file_of_which_less_than_a_tenth_can_be_read_is_refused(copied):
    head, *rows = (copied / "odom_red.csv").read_text().splitlines()
    (copied / "odom_red.csv").write_text("\n".join([head, rows[0], *(f"{row},0" for row in rows[1:])]) + "\n")
    assert re.search(r"odom_red.csv, line 3: 4 fields, not 3; \d+ of \d+ lines are like it", told(copied))


def test_a_directory_that_is_not_one(tmp_path):
    assert "there is no such" in told(tmp_path / "none")
    (tmp_path / "empty").mkdir()
    assert "log.toml: there is no such file" in told(tmp_path / "empty")
    (tmp_path / "empty" / "log.toml").mkdir()
    assert "cannot be read as TOML" in told(tmp_path / "empty")
