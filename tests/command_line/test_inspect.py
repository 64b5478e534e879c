"""`cooploc inspect`: tables, findings and files; and one line for what cannot be read."""

import pandas as pd
import pytest
from made_csv_teams import eight_glitches, two_robots, write
from processes import inside

from cooploc.terminal.tables import recording_lines


def test_inspect_prints_what_is_odd_and_writes_a_log_that_only_force_replaces(tmp_path):
    eight_glitches(tmp_path / "team")
    ended = inside("inspect", "team", cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    for word in ("odometry", "truth_blue.csv", "degrees red", "clock blue", "axes red", "to change in log.toml"):
        assert word in ended.stdout
    assert "next: look at both, then cooploc run log --data team" in ended.stdout
    assert (tmp_path / "team" / "inspect.png").read_bytes().startswith(b"\x89PNG")
    changed = (tmp_path / "team" / "log.toml").read_text() + "# mine\n"
    (tmp_path / "team" / "log.toml").write_text(changed)
    assert "was left as it is" in inside("inspect", "team", cwd=tmp_path).stdout
    assert (tmp_path / "team" / "log.toml").read_text() == changed
    inside("inspect", "team", "--force", cwd=tmp_path)
    assert "# mine" not in (tmp_path / "team" / "log.toml").read_text()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing"], "nothing: there is no such file or directory"),
        (["team", "--run", "tem"], "did you mean 'team'?"),
        (["team", "--out", "notes.txt"], "notes.txt"),
    ],
)
def test_a_recording_that_cannot_be_inspected_is_one_line(tmp_path, arguments, said):
    (tmp_path / "notes.txt").write_text("It rained.\n")
    write(tmp_path / "team", two_robots(seconds=40))
    ended = inside("inspect", *arguments, cwd=tmp_path)
    assert ended.returncode == 2
    assert said in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("trials", "change", "said"),
    [
        (1, (None, None), ["one trial: no intervals", "worse than a constant, which errs by 0.500 m: mine"]),
        (9, (-0.2, 0.3), ["the interval of every comparison with dead-reckoning holds 0", "worse than a constant"]),
        (9, (0.2, 0.3), ["worse than a constant"]),
    ],
)
def test_the_table_of_a_recording_says_what_limits_its_order(trials, change, said):
    names = ["dead-reckoning", "constant", "mine"]
    low, high = ([None, change[k], change[k]] for k in (0, 1))
    part = pd.DataFrame({"scenario": "log/all", "estimator": names, "baseline": names[0], "trials": trials})
    part = part.assign(rmse=[0.2, 0.5, 0.9], change_low=low, change_high=high)
    lines = recording_lines(part, ["run 'one' ranks no estimators: its 9 ticks are too few"])
    assert lines[0] == "log/all, run 'one' ranks no estimators: its 9 ticks are too few"
    for line, words in zip(lines[1:], said, strict=True):
        assert words in line
