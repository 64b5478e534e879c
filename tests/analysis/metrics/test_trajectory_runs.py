"""Several runs judged together: however folders, files and tables say which is which, each has a truth of its own."""

import json

import numpy as np
import pandas as pd
import pytest
from made_trajectories import write_tum
from processes import inside

import cooploc as cl
from cooploc.analysis.metrics.external import judge_trajectories
from cooploc.estimators.errors import BadInput

SPREADS = {"mine": 0.1, "theirs": 0.2}
ROBOTS = ("red", "blue")
RUNS = ("run1", "run2", "run10")


def made_poses():
    """(run, robot, what) -> stamps and poses; every run has a clock and paths of its own."""
    rng, found = np.random.default_rng(6), {}
    for k, run in enumerate(RUNS):
        for robot in ROBOTS:
            t = np.arange(0, 30, 0.1)
            heading = rng.uniform(-3, 3) + np.cumsum(np.repeat(rng.normal(0, 0.4, 15), 20)) * 0.1
            path = np.cumsum(0.04 * np.stack([np.cos(heading), np.sin(heading)], -1), 0) + rng.uniform(-4, 4, 2)
            found[run, robot, "gt"] = t + 100 * k, np.column_stack([path, heading])
            for method, spread in SPREADS.items():
                x = np.column_stack([path + rng.normal(0, spread, path.shape), heading])
                found[run, robot, method] = t + 100 * k, x
    return found


POSES = made_poses()


def expected():
    """Method -> the root mean square error of each run and robot."""
    errors = {key: POSES[key][1][:, :2] - POSES[(*key[:2], "gt")][1][:, :2] for key in POSES}
    rmse = {key: float(np.sqrt((e**2).sum(1).mean())) for key, e in errors.items()}
    return {method: [rmse[run, robot, method] for run in RUNS for robot in sorted(ROBOTS)] for method in SPREADS}


def write(folder, name, only=None):
    for (run, robot, what), (t, x) in POSES.items():
        if only is None or only(run, robot, what):
            path = folder / name.format(run=run, robot=robot, what=what)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_tum(path, t, x)


LAYOUTS = [
    "{what}/{run}/{robot}.txt",
    "{what}/{run}_{robot}.txt",
    "{what}/{robot}-{run}.txt",
    "{run}/{what}_{robot}.txt",
    "{run}/{robot}/{what}.txt",
    "{what}_{run}_{robot}.txt",
]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_each_run_is_a_trial_however_files_say_which_it_is(layout, tmp_path):
    write(tmp_path, layout)
    apart = layout.startswith("{what}/")
    truth = tmp_path / "gt" if apart else tmp_path
    rows, notes = judge_trajectories(
        truth, {name: tmp_path / name if apart else tmp_path for name in SPREADS}, pieces=3
    )
    assert [note.partition(" has")[0] for note in notes] == list(SPREADS)  # no covariances, said once
    for name, part in rows.groupby("estimator"):
        part = part.sort_values(["trial", "name"])
        assert part["run"].tolist() == [run for run in RUNS for _ in ROBOTS]
        assert part["trial"].tolist() == [0, 0, 1, 1, 2, 2]
        np.testing.assert_allclose(part["rmse"], expected()[name], atol=1e-5)
    assert cl.compare(rows, "mine", full=True)["trials"].tolist() == [3, 3]


def test_a_run_judged_by_itself_errs_as_it_does_among_others(tmp_path):
    write(tmp_path, "{what}/{run}/{robot}.txt")
    together, _ = judge_trajectories(tmp_path / "gt", {"mine": tmp_path / "mine"}, align="se2")
    alone, _ = judge_trajectories(tmp_path / "gt/run10", {"mine": tmp_path / "mine/run10"}, align="se2")
    same = ["rmse", "rpe", "heading", "max_error", "name", "ticks"]
    found = together[together["run"] == "run10"][same].reset_index(drop=True)
    pd.testing.assert_frame_equal(found, alone[same], check_exact=True)


def table_of(what, column):
    rows = []
    for (run, robot, one), (t, x) in POSES.items():
        number = int(run.removeprefix("run"))
        rows += [(number, robot, *pose) for pose in np.column_stack([t, x])] if one == what else []
    return pd.DataFrame(rows, columns=[column, "robot", "time", "x", "y", "yaw"])


@pytest.mark.parametrize("column", ["trial", "run_id", "Episode", "mc"])
def test_a_column_of_a_table_says_it_too(column):
    rows, _ = judge_trajectories(table_of("gt", column), {"mine": table_of("mine", column)})
    word = {"run_id": "run"}.get(column, column.lower())
    assert rows["run"].unique().tolist() == [f"{word}{k}" for k in (1, 2, 10)]
    np.testing.assert_allclose(rows.sort_values(["trial", "name"])["rmse"], expected()["mine"], atol=1e-5)


def test_runs_robots_and_methods_may_all_be_in_one_table():
    """A line for each run, robot and stamp, with columns of the truth and of each method."""
    found = table_of("gt", "trial").rename(columns={"x": "x_true", "y": "y_true", "yaw": "yaw_true"})
    for name in SPREADS:
        found[[f"x_{name}", f"y_{name}"]] = table_of(name, "trial")[["x", "y"]]
    rows, _ = judge_trajectories(found, dict.fromkeys(SPREADS, found))
    for name, part in rows.groupby("estimator"):
        np.testing.assert_allclose(part.sort_values(["trial", "name"])["rmse"], expected()[name], atol=1e-5)
    with pytest.raises(
        BadInput, match="has columns of mine, theirs, and none of 'ours': name the method by its column"
    ):
        judge_trajectories(found, {"ours": found})


def test_a_column_of_one_trial_or_of_a_number_of_each_line_makes_no_runs():
    one, count = (table_of(what, "trial").query("trial == 1") for what in ("gt", "mine"))
    for change in (lambda of: of, lambda of: of.assign(trial=np.arange(len(of)) // 4)):
        rows, _ = judge_trajectories(change(one), {"mine": change(count)})
        assert "run" not in rows
        assert len(rows) == 2


def test_covariances_lie_beside_the_poses_of_their_run(tmp_path):
    write(tmp_path, "{what}/{run}-{robot}.txt")
    for k, run in enumerate(RUNS):
        for robot in ROBOTS:
            t, _ = POSES[run, robot, "mine"]
            xx, zero = np.full(len(t), 0.01 * (k + 1)), np.zeros(len(t))
            np.savetxt(tmp_path / f"mine/{run}-{robot}.cov.txt", np.column_stack([t, xx, zero, xx]))
    stored = {f"{run}-{robot}": np.tile(np.eye(2) * 0.04, (300, 1, 1)) for run in RUNS for robot in ROBOTS}
    np.savez(tmp_path / "theirs/covariances.npz", **stored)
    rows, notes = judge_trajectories(tmp_path / "gt", {name: tmp_path / name for name in SPREADS})
    anees = rows.groupby(["estimator", "trial"])["anees"].mean().unstack()
    np.testing.assert_allclose(anees.loc["mine"], [1, 1 / 2, 1 / 3], rtol=0.1)
    np.testing.assert_allclose(anees.loc["theirs"], 1, rtol=0.1)
    assert notes == ()


def test_of_one_robot_the_names_of_runs_are_not_those_of_robots(tmp_path):
    write(tmp_path, "{what}/{run}.txt", lambda run, robot, what: robot == "red")
    rows, _ = judge_trajectories(tmp_path / "gt", {"mine": tmp_path / "mine"})
    assert rows["name"].tolist() == ["robot"] * 3


def test_only_runs_count_that_every_method_has(tmp_path):
    write(tmp_path, "{what}/{run}/{robot}.txt", lambda run, robot, what: (run, what) != ("run2", "theirs"))
    places = {name: tmp_path / name for name in SPREADS}
    rows, notes = judge_trajectories(tmp_path / "gt", places)
    assert rows["run"].unique().tolist() == ["run1", "run10"]
    assert notes[0] == "theirs lacks run2: judged is what all have"
    for place, said in (
        (tmp_path / "mine/run1", "has none of the runs run1, run2, run10"),
        (tmp_path / "no", "no folder"),
    ):
        with pytest.raises(BadInput, match=said):
            judge_trajectories(tmp_path / "gt", {"mine": place})


def test_runs_that_the_truth_lacks_are_said_as_others_may_be_numbered_otherwise(tmp_path):
    write(tmp_path, "{what}/{run}/{robot}.txt", lambda run, robot, what: run != "run10")
    for old, new in (("run1", "run0"), ("run2", "run1")):  # numbered from 0
        (tmp_path / "mine" / old).rename(tmp_path / "mine" / new)
    write(tmp_path, "{what}/{run}/{robot}.txt", lambda run, robot, what: (run, what) == ("run2", "mine"))
    _, notes = judge_trajectories(tmp_path / "gt", {"mine": tmp_path / "mine"}, largest_difference=200)
    assert notes[0] == "mine has run0, and the truth has not: are both numbered alike?"


def test_other_folders_beside_runs_do_not_matter_and_two_of_one_name_do(tmp_path):
    write(tmp_path, "{what}/{run}/{robot}.txt")
    (tmp_path / "gt/figures").mkdir()
    rows, _ = judge_trajectories(tmp_path / "gt", {"mine": tmp_path / "mine"})
    assert rows["run"].unique().tolist() == list(RUNS)
    (tmp_path / "gt/Run_01").mkdir()
    with pytest.raises(BadInput, match="two of its folders are of one run"):
        judge_trajectories(tmp_path / "gt", {"mine": tmp_path / "mine"})


def test_what_is_odd_about_one_run_names_it(tmp_path):
    write(tmp_path, "{what}/{run}/{robot}.txt")
    t, x = POSES["run2", "red", "mine"]
    write_tum(tmp_path / "mine/run2/red.txt", t, x + np.array([3, 0, 0]))
    _, notes = judge_trajectories(tmp_path / "gt", {"mine": tmp_path / "mine"})
    assert [note for note in notes if "once aligned" in note and note.startswith("run2: mine: robot 'red'")]


def test_a_file_of_a_run_that_cannot_be_read_is_named(tmp_path):
    write(tmp_path, "{what}/{run}_{robot}.txt")
    (tmp_path / "mine/run2_red.txt").rename(tmp_path / "mine/run2_red.csv")
    (tmp_path / "mine/run2_red.csv").write_text("a,b\n1,2\n")
    with pytest.raises(BadInput, match=r"^run2_red\.csv has no column x"):
        judge_trajectories(tmp_path / "gt", {"mine": tmp_path / "mine"})


@pytest.mark.slow
def test_the_command_says_what_trials_are_and_pools_each_robot(tmp_path):
    write(tmp_path, "{what}/{run}_{robot}.txt")
    command = ("judge", "--truth", "gt", "--tum", "mine", "--tum", "theirs", "--out", "judged")
    told = inside(*command, cwd=tmp_path)
    assert "trials are 3 runs: run1, run2, run10" in told.stdout
    assert "each robot, over all poses of all runs" in told.stdout
    each = pd.read_csv(tmp_path / "judged/robots.csv")
    assert each.groupby("method")["run"].nunique().tolist() == [3, 3]
    table = json.loads(inside(*command, "--json", cwd=tmp_path).stdout)
    assert [row["trials"] for row in table] == [3, 3]
    pooled = np.sqrt((each[each["method"] == "mine"]["rmse"] ** 2).mean())
    assert table[0]["rmse"] == pytest.approx(pooled, rel=1e-3)
