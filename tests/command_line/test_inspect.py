"""`cooploc inspect`: tables, findings and files; and one line for what cannot be read."""

import pytest
from made_csv_teams import eight_glitches, two_robots, write
from processes import inside


def test_inspect_names_what_is_odd_and_writes_a_log_that_runs(tmp_path):
    eight_glitches(tmp_path / "team")
    told = inside("inspect", "team", cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    for word in ("odometry", "truth_blue.csv", "degrees red", "clock blue", "axes red", "to change in log.toml"):
        assert word in told.stdout
    assert "next: look at both, then cooploc run log --data team" in told.stdout
    assert (tmp_path / "team" / "inspect.png").read_bytes().startswith(b"\x89PNG")


def test_a_log_toml_is_never_overwritten_without_force(tmp_path):
    write(tmp_path / "team", two_robots(seconds=40))
    inside("inspect", "team", cwd=tmp_path)
    changed = (tmp_path / "team" / "log.toml").read_text() + "# mine\n"
    (tmp_path / "team" / "log.toml").write_text(changed)
    told = inside("inspect", "team", cwd=tmp_path)
    assert "was left as it is" in told.stdout
    assert (tmp_path / "team" / "log.toml").read_text() == changed
    inside("inspect", "team", "--force", cwd=tmp_path)
    assert "# mine" not in (tmp_path / "team" / "log.toml").read_text()


def test_files_go_to_another_directory(tmp_path):
    write(tmp_path / "team", two_robots(seconds=40))
    assert inside("inspect", "team", "--out", "notes", cwd=tmp_path).returncode == 0
    assert sorted(path.name for path in (tmp_path / "notes").iterdir()) == ["inspect.png", "log.toml"]
    assert not (tmp_path / "team" / "log.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing"], "nothing: there is no such file or directory"),
        (["empty"], "there is no CSV file, bag, PyFG file or MRCLAM text"),
        (["notes.txt"], "notes.txt"),
        (["team", "--run", "tem"], "did you mean 'team'?"),
        (["team", "--out", "notes.txt"], "notes.txt"),
    ],
)
def test_what_cannot_be_looked_at_is_one_line(tmp_path, arguments, said):
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").write_text("It rained.\n")
    write(tmp_path / "team", two_robots(seconds=40))
    told = inside("inspect", *arguments, cwd=tmp_path)
    assert told.returncode == 2
    assert said in told.stderr
    assert len(told.stderr.strip().splitlines()) == 1
