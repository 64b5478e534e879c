"""From a directory to findings, a log.toml that runs, and a sketch; for every format."""

import tomllib

import pytest
from made_csv_teams import eight_glitches, two_robots, write

import cooploc as cl
from cooploc.scenarios.recordings.inspect.draft_toml import toml
from cooploc.scenarios.recordings.scenario import TeamScenario


@pytest.fixture(scope="module")
def clean():
    return two_robots(seconds=60)


def found(inspection):
    return {(f.kind, f.robot) for f in inspection.inspected.findings}


@pytest.mark.slow
def test_eight_deliberate_glitches_are_each_named_and_stand_in_log_toml(tmp_path):
    wanted = eight_glitches(tmp_path / "team")
    table = cl.inspect(tmp_path / "team").findings
    assert len(wanted) == 8
    assert dict(zip(table["kind"], table["robot"], strict=True)) == wanted
    text = cl.inspect(tmp_path / "team").log_toml
    truth = text[text.index("[truth]") : text.index("[ranges]")]
    for line in ("clock_offset = { blue = -2.", 'unit = "mm"', 'frame = "swapped"', "max_speed ="):
        assert line in truth


@pytest.mark.slow
def test_a_run_says_what_was_found_and_still_stands_in_log_toml(tmp_path, clean):
    mirrored = {name: columns | {"y": -columns["y"]} for name, columns in clean.items() if name.startswith("truth")}
    found = cl.inspect(write(tmp_path / "team", clean | mirrored))
    found.write()
    scenario = TeamScenario(data=tmp_path / "team")
    lines = [line for line in scenario.explanations() if "FOUND" in line]
    assert len(lines) == 2
    assert all(line.startswith("log.toml says in [truth]: FOUND (sure): mirrored") for line in lines)
    assert all("To change: frame" in line for line in lines)
    (tmp_path / "team/log.toml").write_text(found.log_toml.replace("# FOUND (sure)", "# settled"))
    assert not any("FOUND" in line for line in TeamScenario(data=tmp_path / "team").explanations())


@pytest.mark.slow
def test_directories_of_a_team_are_runs_and_share_the_places_above(tmp_path, clean):
    write(tmp_path / "team" / "monday", clean)
    write(tmp_path / "team" / "tuesday", two_robots(seed=2, seconds=60))
    (tmp_path / "team" / "anchors.csv").write_text("name,x,y\nnorth,0,5\neast,6,0\n")
    inspection = cl.inspect(tmp_path / "team")
    assert inspection.inspected.runs == ("monday", "tuesday")
    assert inspection.inspected.log.anchors.names == ("north", "east")
    assert tomllib.loads(inspection.log_toml)["fit"] == {"on": "other runs"}


@pytest.mark.slow
def test_files_that_follow_each_other_are_runs_of_one_robot(tmp_path, clean):
    for k in range(3):
        odometry, truth = clean["odom_red.csv"], clean["truth_red.csv"]
        both = {"time": odometry["time"] + 1000 * k, "v": odometry["v"], "omega": odometry["omega"]}
        write(tmp_path / "one", {f"run{k}.csv": both | {"gt_x": truth["x"], "gt_y": truth["y"]}})
    inspection = cl.inspect(tmp_path / "one")
    inspection.write()
    assert inspection.inspected.runs == ("run0", "run1", "run2")
    assert tomllib.loads(inspection.log_toml)["odometry"]["file"] == "{run}.csv"
    assert cl.simulate("log/run0", data=tmp_path / "one")[1].robots == 1


@pytest.mark.parametrize(
    ("names", "robots", "doubted"),
    [("diag-0 diag-1 inside-0", ["robot"], False), ("diag0 diag1", ["diag0", "diag1"], True)],
)
def test_runs_whose_clocks_begin_alike_are_told_from_robots_by_their_names(tmp_path, clean, names, robots, doubted):
    odometry, truth = clean["odom_red.csv"], clean["truth_red.csv"]
    both = {"time": odometry["time"], "v": odometry["v"], "omega": odometry["omega"]}
    write(tmp_path / "one", {f"{n}.csv": both | {"gt_x": truth["x"], "gt_y": truth["y"]} for n in names.split()})
    inspection = cl.inspect(tmp_path / "one")
    assert tomllib.loads(inspection.log_toml)["robots"] == robots
    assert (("robots", "") in found(inspection)) == doubted


def test_a_robot_whose_file_lacks_a_column_is_left_out_and_named(tmp_path, clean):
    odometry = {c: v for c, v in clean["odom_blue.csv"].items() if c != "omega"}
    inspected = cl.inspect(write(tmp_path / "team", clean | {"odom_blue.csv": odometry})).inspected
    assert inspected.log.robots == ("red",)
    assert any(line.startswith("odom_blue.csv: its columns") for line in inspected.unused)


@pytest.mark.slow
def test_a_log_toml_elsewhere_is_inspected_as_the_command_says(tmp_path, clean):
    cl.inspect(write(tmp_path / "team", clean)).write(tmp_path / "out")
    assert set(cl.inspect(tmp_path / "out").inspected.log.robots) == {"red", "blue"}


@pytest.mark.slow
def test_a_log_toml_that_is_there_is_believed_and_stays(tmp_path, clean):
    team = write(tmp_path / "team", clean)
    cl.inspect(team).write()
    text = (team / "log.toml").read_text().replace('heading = "theta"', 'heading = {column = "theta", unit = "deg"}')
    (team / "log.toml").write_text(text)
    inspection = cl.inspect(team)
    assert found(inspection) == {("radians", "blue"), ("radians", "red")}
    inspection.write()
    assert (team / "log.toml").read_text() == text
    assert len(cl.inspect(team, again=True).findings) == 0
    cl.inspect(team, again=True).write(force=True)
    assert (team / "log.toml").read_text() != text


def test_text_of_a_file_cannot_end_a_comment_or_a_value():
    strange = 'x"\n[b]'
    assert tomllib.loads(f"a = {toml(strange)}") == {"a": strange}


def test_what_is_packed_is_to_be_unpacked(tmp_path):
    (tmp_path / "team.zip").write_bytes(b"PK")
    with pytest.raises(cl.BadInput, match=r"\(team.zip: unpack it\)"):
        cl.inspect(tmp_path)
