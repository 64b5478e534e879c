"""`cooploc inspect`: tables, findings and files; and one line for what cannot be read."""

import pandas as pd
import pytest
from made_csv_teams import eight_glitches, two_robots, write
from processes import inside

from cooploc.terminal.tables import recording_lines


@pytest.mark.slow
def test_inspect_prints_what_is_odd_and_writes_a_page(tmp_path):
    eight_glitches(tmp_path / "team")
    ended = inside("inspect", "team", cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    for word in ("odometry", "truth_blue.csv", "degrees red", "clock blue", "axes red", "to change in log.toml"):
        assert word in ended.stdout
    assert "next: look at both, then cooploc run log --data team" in ended.stdout
    assert (tmp_path / "team" / "inspect.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "team" / "inspect.html").read_text("utf-8")
    assert "<strong>8 things to look at; its log.toml runs.</strong>" in page
    assert page.count("<h2>") == 8 + 3
    assert page.count("data:image/png;base64,") == 7 + 1  # a torn line has no picture; the whole recording has one
    assert "[truth] clock_offset = { blue = -2.47 }" in page


@pytest.mark.slow
def test_only_force_replaces_a_log_toml(tmp_path):
    write(tmp_path / "team", two_robots(seconds=40))
    assert inside("inspect", "team", cwd=tmp_path).returncode == 0
    log = tmp_path / "team" / "log.toml"
    log.write_text(log.read_text() + "# mine\n")
    assert "was left as it is" in inside("inspect", "team", cwd=tmp_path).stdout
    assert log.read_text().endswith("# mine\n")
    inside("inspect", "team", "--force", cwd=tmp_path)
    assert "# mine" not in log.read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nothing"], "nothing: there is no such file or directory"),
        (["team", "--run", "tem"], "did you mean 'team'?"),
        (["team", "--out", "notes.txt"], "notes.txt"),
    ],
)
def test_a_recording_that_cannot_be_inspected_is_one_line(tmp_path, arguments, words):
    (tmp_path / "notes.txt").write_text("It rained.\n")
    write(tmp_path / "team", two_robots(seconds=40))
    ended = inside("inspect", *arguments, cwd=tmp_path)
    assert (ended.returncode, len(ended.stderr.strip().splitlines())) == (2, 1)
    assert words in ended.stderr


def test_the_table_of_a_recording_says_what_limits_its_order():
    table = pd.DataFrame(
        {"scenario": "log/all", "estimator": ["dr", "constant", "mine"], "baseline": "dr", "trials": 9}
    )
    table = table.assign(rmse=[0.2, 0.5, 0.9], change_low=[None, -0.2, -0.2], change_high=[None, 0.3, 0.3])
    limits = "the interval of every comparison with dr holds 0"
    first, *lines = recording_lines(table, ["run 'one' ranks no estimators: its 9 ticks are too few"])
    assert first == "run 'one' ranks no estimators: its 9 ticks are too few"
    assert len(lines) == 1
    assert limits in lines[0]
    assert "one trial: no intervals" in recording_lines(table.assign(trials=1), [])[0]


@pytest.mark.slow
def test_the_page_of_an_inspection_escapes_what_is_in_the_files(tmp_path):
    write(tmp_path / "<b>team", two_robots(seconds=40))
    ended = inside("inspect", "<b>team", cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    page = (tmp_path / "<b>team" / "inspect.html").read_text("utf-8")
    assert "Is &lt;b&gt;team sane?" in page
    assert "<b>team" not in page


@pytest.mark.slow
def test_a_recording_without_truth_is_inspected_and_not_judged(tmp_path):
    files = {name: columns for name, columns in two_robots(seconds=40).items() if not name.startswith("truth")}
    for column, values in files["odom_red.csv"].items():
        files["odom_red.csv"][column] = values[:100].tolist() + values[200:].tolist()
    write(tmp_path / "team", files)
    ended = inside("inspect", "team", cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert "not used: truth, as no file has columns that look like truth" in ended.stdout
    assert "it does not run: team: no robot has a truth to be judged by" in ended.stdout
    assert "next: look at the page" in ended.stdout
    assert "correct" not in ended.stdout
    page = (tmp_path / "team" / "inspect.html").read_text("utf-8")
    assert "There is no ground truth" in page
    assert "Gap: red" in page
    assert "no robot has a truth to be judged by" in inside("run", "log", "--data", "team", cwd=tmp_path).stderr
