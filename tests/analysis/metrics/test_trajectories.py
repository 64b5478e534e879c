"""Trajectories in files: the numbers of evo, covariances in every form and in their axes, faults in one line."""

import os
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_bags import pose_at, write_messages
from made_trajectories import ROBOTS, expected, frame_of, paths_of_all, rmse_of, true_path, write_tum
from processes import inside

import cooploc as cl
from cooploc import BadInput
from cooploc.analysis.metrics.external import judge_trajectories, mean_drift


@pytest.fixture(scope="module")
def team(tmp_path_factory):
    """A folder of true trajectories at 10 Hz, and two of drifting ones at 3 Hz, in another frame."""
    folder, rng = tmp_path_factory.mktemp("team"), np.random.default_rng(1)
    for name in ("truth", "mine", "theirs"):
        (folder / name).mkdir()
    for r, robot in enumerate(ROBOTS):
        t, x = true_path(r)
        write_tum(folder / f"truth/{robot}.txt", t, x)
        late = t[3::3] + rng.uniform(-0.008, 0.008, len(t[3::3]))
        for name, spread in (("mine", 0.1), ("theirs", 0.2)):
            there = x[3::3] + np.cumsum(rng.normal(0, spread / 5, (len(late), 3)), 0) * [1, 1, 0.2]
            c, s = np.cos(0.4), np.sin(0.4)
            there[:, :2] = there[:, :2] @ np.array([[c, s], [-s, c]]) + [1, 2]
            there[:, 2] += 0.4
            write_tum(folder / f"{name}/{robot}.txt", late, there)
    return folder


EVO = {  # evo 1.38: evo_ape tum TRUTH MINE --t_max_diff 0.01 [-a, --align_origin], -r angle_rad; evo_rpe -d 1 -u f
    "none": [(2.713342, 4.040209, 2.621537, 0.306767, 0.031743), (1.476580, 2.457801, 1.334165, 0.397890, 0.027894)],
    "se2": [(0.163691, 0.318445, 0.147258, 0.094777, 0.031743), (0.149809, 0.288524, 0.136715, 0.027118, 0.027894)],
    "origin": [(0.233172, 0.444899, 0.213830, 0.110829, 0.031743), (0.264024, 0.468925, 0.220791, 0.021989, 0.027894)],
}


@pytest.mark.parametrize("align", EVO)
def test_errors_are_those_of_evo_to_six_digits(team, align):
    rows, notes = judge_trajectories(team / "truth", {"mine": team / "mine"}, align=align)
    assert rows["name"].tolist() == sorted(ROBOTS)
    found = rows.set_index("name").loc[list(ROBOTS), ["rmse", "max_error", "mean_error", "heading", "rpe"]]
    np.testing.assert_allclose(found, EVO[align], atol=1e-6)
    assert "mine has no covariances" in notes[0]
    assert bool(notes[1:]) == (align == "none")
    assert all("once all robots are aligned together: if it is in another frame, --align team" in n for n in notes[1:])


def test_methods_are_judged_at_common_times_and_pieces_are_trials(team, tmp_path):
    lines = (team / "mine/red.txt").read_text().splitlines(keepends=True)
    (tmp_path / "red.txt").write_text("".join(lines[:150]))
    (tmp_path / "blue.txt").write_text((team / "mine/blue.txt").read_text())
    both = {"mine": tmp_path, "theirs": team / "theirs"}
    rows, notes = judge_trajectories(team / "truth", both, align="team", pieces=5)
    assert notes[:2] == (
        "mine: robot 'red' has no poses within 0.01 s of true ones in 14.9 of 59.9 s, and is not judged there",
        "robot 'red': 150 of 199 poses are judged; not every method has the others",
    )
    assert rows.groupby(["estimator", "name"])["ticks"].sum().unstack()["red"].tolist() == [150, 150]
    table = cl.compare(rows, "mine", full=True)
    assert table["trials"].tolist() == [5, 5]
    assert (table["rmse_low"] < table["rmse"]).all()
    drift = mean_drift(rows).set_index("estimator")
    assert drift.loc["mine", "rpe"] < drift.loc["theirs", "rpe_low"]


# ---- covariances


@pytest.fixture(scope="module")
def honest():
    """True poses and estimates of one robot whose errors have the stated covariances, in its own axes."""
    t, x = true_path(0)
    rng, P = np.random.default_rng(4), np.diag([0.09, 0.0025, 0.0004])
    P[0, 2] = P[2, 0] = 0.002
    error = rng.multivariate_normal(np.zeros(3), P, len(t))
    c, s = np.cos(x[:, 2]), np.sin(x[:, 2])
    turned = np.column_stack([c * error[:, 0] - s * error[:, 1], s * error[:, 0] + c * error[:, 1], error[:, 2]])
    R = np.zeros((len(t), 3, 3))
    R[:, 0, 0] = R[:, 1, 1] = c
    R[:, 0, 1], R[:, 1, 0], R[:, 2, 2] = -s, s, 1
    return t, x, x + turned, np.broadcast_to(P, R.shape), R @ P @ R.mT


def written(folder, t, x, P, how):
    """A folder, or a bag, of one robot with covariances in one of the forms."""
    folder.mkdir()
    triangle = P[(slice(None), *np.triu_indices(3))]
    if how in ("csv", "semicolons"):
        named = dict(zip(["Pxx", "Pxy", "Pxh", "Pyy", "Pyh", "Phh"], triangle.T, strict=True))
        columns = {"Time": t, "X": x[:, 0], "Y": x[:, 1], "theta": x[:, 2], **named}
        signs = {"csv": {}, "semicolons": {"sep": ";", "decimal": ","}}[how]
        pd.DataFrame(columns).to_csv(folder / "red.csv", index=False, **signs)
    elif how == "bag":
        name, at = "geometry_msgs/msg/PoseWithCovarianceStamped", np.ix_([0, 1, 5], [0, 1, 5])
        C = np.zeros((len(t), 6, 6))
        C[(slice(None), *at)] = P
        poses = [pose_at(x, y, 0.0, heading, "pose.pose.") for x, y, heading in x]
        rows = zip(t, poses, C.reshape(-1, 36), strict=True)
        write_messages(folder / "bag", [("/red/pose", name, s, pose | {"pose.covariance": c}) for s, pose, c in rows])
    else:
        write_tum(folder / "red.txt", t, x)
        if how == "beside":
            np.savetxt(folder / "red.cov.txt", np.column_stack([t, triangle]), fmt="%.17g")
        else:
            np.savez(folder / "covariances.npz", red=P)
    return folder


def test_poses_whose_covariance_is_torn_are_left_out_and_named(honest, tmp_path):
    t, truth, x, P, _ = honest
    (tmp_path / "truth").mkdir()
    write_tum(tmp_path / "truth/red.txt", t, truth)
    beside = written(tmp_path / "mine", t, x, P, "beside") / "red.cov.txt"
    beside.write_text("# stamp, then the upper triangle\n" + beside.read_text()[:-30])
    rows, (line, lost) = judge_trajectories(tmp_path / "truth", {"mine": tmp_path / "mine"}, axes="body")
    assert "red.cov.txt, line 601: 5 columns, not 7" in line
    assert lost.endswith("red.cov.txt: 1 pose without covariance count nowhere")
    assert rows["anees"].notna().all()


@pytest.mark.parametrize("how", ["beside", "csv", "semicolons", "npz", "bag"])
def test_covariances_are_read_in_every_form_and_honest_ones_are_consistent(honest, tmp_path, how):
    t, true, x, _, P = honest
    (tmp_path / "truth").mkdir()
    write_tum(tmp_path / "truth/red.txt", t + 1.0, true)
    rows, notes = judge_trajectories(tmp_path / "truth", {"mine": written(tmp_path / "mine", t + 1.0, x, P, how)})
    error = x[:, :2] - true[:, :2]
    nees = np.einsum("ti,tij,tj->t", error, np.linalg.inv(P[:, :2, :2]), error)
    assert rows["anees"].item() == pytest.approx(nees.mean() / 2, rel=1e-5)
    assert rows["anees"].item() == pytest.approx(1, abs=0.15)
    assert rows["pose_nees"].item() == pytest.approx(1, abs=0.15)
    assert notes == ()


def test_singular_covariances_are_counted(honest, tmp_path):
    t, true, x, _, P = honest
    P = P.copy()
    P[:7] = [[0.01, 0.02, 0], [0.02, 0.04, 0], [0, 0, 4e-4]]
    mine = {"mine": written(tmp_path / "mine", t, x, P, "npz")}
    write_tum(tmp_path / "red.txt", t, true)
    _, notes = judge_trajectories(tmp_path / "red.txt", mine)
    assert notes == ("mine: robot 'red' has 7 singular covariances: with any error there, ANEES is infinite",)


def test_covariances_in_the_robots_axes_are_noticed_and_turned(honest, tmp_path):
    t, true, x, body, world = honest
    (tmp_path / "truth").mkdir()
    write_tum(tmp_path / "truth/red.txt", t, true)
    mine = {"mine": written(tmp_path / "mine", t, x, body, "beside")}
    rows, (note,) = judge_trajectories(tmp_path / "truth", mine)
    assert rows["anees"].item() > 2
    assert "fit in axes of the body" in note
    assert note.endswith("--axes body")
    turned, notes = judge_trajectories(tmp_path / "truth", mine, axes="body")
    other = {"mine": written(tmp_path / "other", t, x, world, "npz")}
    straight, _ = judge_trajectories(tmp_path / "truth", other)
    assert notes == ()
    _, (note,) = judge_trajectories(tmp_path / "truth", other, axes="body")
    assert note.endswith("--axes world")
    # the filter knows its own heading, not the true one
    assert turned["anees"].item() == pytest.approx(straight["anees"].item(), rel=0.05)


def as_euroc(t, x, frames="RS_R"):
    half, zero = x[:, 2] / 2, np.zeros(len(t))
    names = ["#timestamp [ns]", *(f"p_{frames}_{axis} [m]" for axis in "xyz"), *(f"q_RS_{q} []" for q in "wxyz")]
    return dict(zip(names, [1e9 * t, x[:, 0], x[:, 1], zero, np.cos(half), zero, zero, np.sin(half)], strict=True))


@pytest.mark.parametrize(
    "columns",
    [
        as_euroc,
        lambda t, x: as_euroc(t, x, "WS_W"),
        lambda t, x: {
            "Time (ms)": 1e3 * t,
            "x_mm": 1e3 * x[:, 0],
            "y_mm": 1e3 * x[:, 1],
            "yaw_deg": np.degrees(x[:, 2]),
        },
        lambda t, x: {"t": 1e9 * t, "x": x[:, 0], "y": x[:, 1], "qz": np.sin(x[:, 2] / 2), "qw": np.cos(x[:, 2] / 2)},
    ],
    ids=["EuRoC", "OKVIS", "units in names", "nanoseconds"],
)
def test_poses_are_what_the_names_of_columns_say(honest, tmp_path, columns):
    t, true, x, *_ = honest
    write_tum(tmp_path / "truth.txt", t + 1.7e9, true)
    write_tum(tmp_path / "mine.txt", t + 1.7e9, x)
    pd.DataFrame(columns(t + 1.7e9, x)).to_csv(tmp_path / "theirs.csv", index=False)
    text = (tmp_path / "mine.txt").read_text()
    (tmp_path / "commas.txt").write_text("# by hand\n" + text.replace(" ", ","))
    files = {name: tmp_path / name for name in ("mine.txt", "theirs.csv", "commas.txt")}
    rows, _ = judge_trajectories(tmp_path / "truth.txt", files)
    for column in ("rmse", "rpe", "heading"):
        np.testing.assert_allclose(rows[column], rows[column].iloc[0], rtol=1e-6)


# ---- faults


def broken(honest, folder, **change):
    t, _, x, _, P = honest
    given = {"t": t, "x": x, "P": P, "how": "npz", **change}
    return written(folder, *given.values())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"x": "mirrored"}, r"robot 'red' has a mirrored path: it fits the truth to [\d.]+ m with y turned"),
        (
            {"x": "millimetres"},
            r"robot 'red' has the true path 1e\+03 times as large: write m, or name its columns",
        ),
        ({"x": "degrees", "how": "csv"}, r"robot 'red' has headings that fit the truth as degrees: write rad, or name"),
        (
            {"t": "late"},
            r"no stamp of robot 'red' \(1000 to 1059.9 s\) is within 0.01 s of one of the truth",
        ),
        ({"t": "between"}, r"to 59.9 s\): interpolate the true poses at its stamps, or allow more by --within 0.05"),
        ({"P": "negative"}, r"covariances.npz, index 7: the covariance is not positive, its least eigenvalue is -"),
        ({"P": "negative", "how": "csv"}, r"red.csv, line 9: the covariance is not positive"),
        ({"P": "negative", "how": "beside"}, r"red.cov.txt, line 8: the covariance is not positive"),
        ({"P": "crooked"}, r"covariances.npz, index 7: the covariance is not symmetric"),
        ({"P": "short"}, r"covariances.npz: red has shape \(5, 3, 3\), not \(600, 2, 2\) or \(600, 3, 3\)"),
        ({"P": "absent"}, r"mine: 1 of 600 poses of robot 'red' have no covariance: add them, or remove all"),
    ],
)
def test_what_cannot_be_judged_is_one_line(honest, tmp_path, change, said):
    t, true, x, _, P = honest
    (tmp_path / "truth").mkdir()
    write_tum(tmp_path / "truth/red.txt", t, true)
    negative, crooked, absent = P.copy(), P.copy(), P.copy()
    negative[7, 0, 0], crooked[7, 0, 1], absent[7] = -1.0, 9.0, np.nan
    wrong = {
        "mirrored": x * [1, -1, -1], "millimetres": x * [1e3, 1e3, 1], "degrees": x * [1, 1, np.degrees(1)],
        "late": t + 1000, "between": t + 0.05, "negative": negative, "crooked": crooked,
        "short": P[:5], "absent": absent,
    }  # fmt: skip
    folder = broken(honest, tmp_path / "mine", **{key: wrong.get(word, word) for key, word in change.items()})
    with pytest.raises(cl.BadInput, match=said) as caught:
        judge_trajectories(tmp_path / "truth", {"mine": folder})
    assert "\n" not in str(caught.value)


def test_a_robot_without_a_file_and_unknown_words_are_one_line(team, tmp_path):
    (tmp_path / "NOTES.txt").write_text("It rained.\n")  # of no robot
    (tmp_path / "read.txt").write_text((team / "mine/red.txt").read_text())
    (tmp_path / "blue.txt").write_text((team / "mine/blue.txt").read_text())
    with pytest.raises(cl.BadInput, match=r"robot 'red' has no trajectory; did you mean 'read'"):
        judge_trajectories(team / "truth", {"mine": tmp_path})
    (tmp_path / "empty").mkdir()
    with pytest.raises(cl.BadInput, match=r"holds no NAME\.txt or NAME\.csv, nor a bag"):
        judge_trajectories(team / "truth", {"mine": tmp_path / "empty"})
    with pytest.raises(cl.BadInput, match=r"there is no align 'se3'; did you mean 'se2'"):
        judge_trajectories(team / "truth", {"mine": team / "mine"}, align="se3")
    with pytest.raises(cl.BadInput, match="pieces is 1000; it must be a whole number from 1 to 99"):
        judge_trajectories(team / "truth", {"mine": team / "mine"}, pieces=1000)


@pytest.mark.slow
def test_the_command_ranks_methods_and_says_what_is_odd(team, tmp_path):
    named = ["--tum", f"mine={team / 'mine'}", "--tum", str(team / "theirs")]
    done = inside("judge", "--truth", team / "truth", *named, "--align", "se2", "--out", tmp_path / "out")
    assert done.returncode == 0
    assert done.stdout.index(" mine ") < done.stdout.index(" theirs ")
    assert pd.read_csv(tmp_path / "out/robots.csv")["robot"].tolist() == ["blue", "red"] * 2
    assert (tmp_path / "out/rmse.png").exists()
    page = (tmp_path / "out/index.html").read_text("utf-8")
    assert "<strong>mine has the smallest RMSE, " in page
    assert page.count("data:image/png;base64,") == 4  # RMSE, two paths, error over time
    assert all(re.search(rf">{robot}</t[dh]>", page) for robot in ROBOTS)
    assert "another frame" in inside("judge", "--truth", team / "truth", *named).stdout.replace("\n", " ")
    equals = tmp_path / "ekf-local[gate=3]"
    shutil.copytree(team / "mine", equals)
    three = inside(
        "judge", "--truth", team / "truth", *named, "--tum", equals, "--align", "se2", "--out", tmp_path / "3"
    )
    assert "ekf-local" in three.stdout
    verdict = "<strong>mine has the smallest RMSE, [0-9.]+ m; it is not told apart from ekf-local.gate=3.[.]</strong>"
    assert re.search(verdict, (tmp_path / "3/index.html").read_text("utf-8"))
    assert inside("judge", "--truth", team / "truth", *named[:2], "--out", tmp_path / "1").returncode == 0
    assert re.search(
        "<strong>mine has an RMSE of [0-9.]+ m[.]</strong>", (tmp_path / "1/index.html").read_text("utf-8")
    )
    taken = inside("judge", "--truth", team / "truth", *named, "--out", team / "mine/red.txt")
    assert (taken.returncode, len(taken.stderr.strip().splitlines())) == (2, 1)
    refused = inside("judge", "--tum", team / "mine")
    assert "name a stream or scenario, or --truth DIR" in refused.stderr


def test_stored_covariances_follow_poses_in_any_order_and_headings_may_lack_them(honest, tmp_path):
    t, true, x, _, P = honest
    (tmp_path / "truth").mkdir()
    write_tum(tmp_path / "truth/red.txt", t, true)
    P, back = P * np.linspace(1, 9, len(t))[:, None, None], slice(None, None, -1)
    forth = written(tmp_path / "forth", t, x, P, "npz")
    turned = written(tmp_path / "turned", t[back], x[back], P[back], "npz")
    np.savez(turned / "covariances.npz", red=P[back, :2, :2])
    rows, _ = judge_trajectories(tmp_path / "truth", {"forth": forth, "turned": turned})
    assert rows["anees"].iloc[1] == pytest.approx(rows["anees"].iloc[0])
    assert rows["pose_nees"].isna().tolist() == [False, True]


@pytest.mark.parametrize(
    ("file", "text", "how", "said"),
    [
        ("red.csv", "stamp,x,y\n0,0,0\n1,1,0\n", {"align": "origin"}, "has no heading in its first pose"),
        ("red.csv", "stamp,x,y,xx,xy,yy\n0,0,0,1,0,1\n1,1,0,1,0,1\n", {"axes": "body"}, "no heading for axes"),
        ("red.csv", "stamp,x,y\n0,0,0\n1000000000000,1,0\n", {}, "write seconds"),
        ("red.csv", "stamp,x,y\n", {}, "it has no line of 3 fields"),
        ("red.csv", "stamp,x,y\n0,,0\n1,,0\n", {}, "no line has a stamp, x and y"),
        ("red.txt", "0 0 0 0 1 0 0 0\n1 0 0 0 1 0 0 0\n", {}, "write qx qy qz qw, w last"),
        ("red.txt", "0 0 0 0 0 0 1\n", {}, "line 1: 7 columns, not 8"),
        ("red.csv", "0,0,0,0\n1,1,0,0\n", {}, "it has 1, 2, 3, 4: write their names above: stamp,x,y,heading"),
        ("red.txt", "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", {"pieces": 1.5}, "must be a whole number from 1 to 1"),
        ("red.csv", "stamp,x,y,yaw\n0,0,0,170\n1,1,0,-170\n", {}, "call it yaw_deg if it is in degrees, else yaw_rad"),
        ("red.csv", "stamp,x,y,x\n0,0,0,0\n", {}, "two columns have one name: stamp, x, y, x"),
        ("red.csv", "stamp,x,y\n0,0,0\n", {}, "a robot has 1 pose to judge"),
        ("covariances.npz", "PK\x03\x04", {}, "covariances.npz: cannot be read"),
        ("red.bag", "no bag", {}, "red.bag: cannot be read as a bag"),
    ],
)
def test_files_that_lack_what_is_asked_are_one_line(honest, tmp_path, file, text, how, said):
    t, true, *_ = honest
    for folder in ("truth", "mine"):
        (tmp_path / folder).mkdir()
        write_tum(tmp_path / folder / "red.txt", t, true)
    if file in ("red.csv", "red.bag"):
        (tmp_path / "mine/red.txt").unlink()
    (tmp_path / "mine" / file).write_text(text)
    with pytest.raises(cl.BadInput, match=said):
        judge_trajectories(tmp_path / "truth", {"mine": tmp_path / "mine"}, **how)


def test_one_file_of_any_name_is_a_team_of_one_and_what_stands_or_is_not_known_is_told(honest, tmp_path):
    t, true, x, _, P = honest
    write_tum(tmp_path / "truth.tum", t, true)
    written(tmp_path / "mine", t, x, 0 * P, "beside")
    (tmp_path / "mine/red.txt").rename(tmp_path / "mine/poses.tum")
    (tmp_path / "mine/red.cov.txt").rename(tmp_path / "mine/poses.cov.txt")
    rows, notes = judge_trajectories(tmp_path / "truth.tum", {"mine": tmp_path / "mine/poses.tum"})
    assert rows["rmse"].item() == pytest.approx(np.sqrt(((x - true)[:, :2] ** 2).sum(1).mean()), rel=1e-6)
    assert rows["anees"].isna().all()  # zeros are not known, as in ROS
    assert notes == ("mine has no covariances, or zeros alone: its consistency is not known",)
    write_tum(tmp_path / "still.txt", t, 0 * true)
    write_tum(tmp_path / "mine.txt", t, 0 * true + 0.003)
    rows, notes = judge_trajectories(tmp_path / "still.txt", {"mine": tmp_path / "mine.txt"})
    assert rows["rmse"].item() == pytest.approx(0.003 * np.sqrt(2))
    assert notes[0] == "robot 'still' stands, within 0.05 m: its RPE is noise, and --align se2 turns it at random"
    with pytest.raises(BadInput, match="mine: poses of robot 'still' are the true ones: name other files"):
        judge_trajectories(tmp_path / "still.txt", {"mine": tmp_path / "still.txt"})


@pytest.mark.parametrize("place", ["{robot}_{what}.txt", "{robot}/stamped_{what}.txt"])
def test_true_poses_may_lie_beside_those_of_methods(team, place, tmp_path):
    for what, name in (("groundtruth", "truth"), ("mine", "mine"), ("theirs", "theirs")):
        for robot in ROBOTS:
            file = tmp_path / place.format(robot=robot, what=what)
            file.parent.mkdir(exist_ok=True)
            shutil.copy(team / f"{name}/{robot}.txt", file)
            file.with_name(f"._{file.name}").write_bytes(b"\0\5\x16\7Mac OS X")  # what macOS leaves on other disks
    together, _ = judge_trajectories(tmp_path, dict.fromkeys(("mine", "theirs"), tmp_path))
    apart, _ = judge_trajectories(team / "truth", {name: team / name for name in ("mine", "theirs")})
    columns = ["estimator", "name", "rmse", "rpe"]
    pd.testing.assert_frame_equal(together[columns], apart[columns])
    if "/" in place:  # a robot without true poses is not judged by what a method says of it
        (tmp_path / "blue/stamped_groundtruth.txt").unlink()
        (tmp_path / "blue/stamped_theirs.txt").unlink()
        with pytest.raises(BadInput, match="robot 'blue' are the true ones"):
            judge_trajectories(tmp_path, {"mine": tmp_path})


def test_where_stamps_never_meet_it_is_said_which_file_has_none(tmp_path):
    (tmp_path / "truth.csv").write_text("stamp,x,y\n1000.5,0,0\n")
    (tmp_path / "mine.csv").write_text("x,y\n1,2\n3,4\n")
    said = "1000.5 to 1000.5 s.: write both by one clock; poses without stamps have the numbers of their lines"
    with pytest.raises(BadInput, match=said):
        judge_trajectories(tmp_path / "truth.csv", {"mine": tmp_path / "mine.csv"})


@pytest.mark.parametrize("torn", ["nan", "1e999"])
def test_poses_of_kitti_that_are_no_numbers_are_left_out(tmp_path, torn):
    t, paths = paths_of_all()
    for method in ("truth", "mine"):
        write_kitti(tmp_path / method, t, paths[method]["red"])
    lines = (tmp_path / "mine.txt").read_text().splitlines()
    lines[7] = lines[7].replace(lines[7].split()[3], torn, 1)
    (tmp_path / "mine.txt").write_text("\n".join(lines) + "\n")
    rows, _ = judge_trajectories(tmp_path / "truth.txt", {"mine": tmp_path / "mine.txt"})
    error = np.delete((paths["mine"]["red"] - paths["truth"]["red"])[:, :2], 7, axis=0)
    assert rows["ticks"].item() == len(t) - 1
    assert rows["rmse"].item() == pytest.approx(np.sqrt((error**2).sum(1).mean()), rel=1e-6)


def test_a_quaternion_of_zeros_is_no_heading(honest, tmp_path):
    t, true, x, *_ = honest
    write_tum(tmp_path / "truth.txt", t, true)
    for name, lacking in (("mine", slice(6, 8)), ("theirs", slice(0, 0))):
        write_tum(tmp_path / f"{name}.txt", t, x)
        columns = np.loadtxt(tmp_path / f"{name}.txt")
        columns[:, lacking] = 0
        np.savetxt(tmp_path / f"{name}.txt", columns)
    rows, _ = judge_trajectories(
        tmp_path / "truth.txt", {name: tmp_path / f"{name}.txt" for name in ("mine", "theirs")}
    )
    assert rows["rmse"].iloc[0] == pytest.approx(rows["rmse"].iloc[1])
    assert rows["heading"].isna().tolist() == rows["rpe"].isna().tolist() == [True, False]


REAL = Path(os.environ.get("COOPLOC_DATA", Path(__file__).parents[4] / "shared" / "data")) / "mrclam6"


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason="MRCLAM data set 6 is not here; set COOPLOC_DATA to where mrclam6/ lies")
def test_by_the_files_of_a_data_set_errors_are_those_of_its_scenario(tmp_path):
    truth, stream = cl.simulate("mrclam", duration=60, data=REAL)
    run = cl.run("dead-reckoning", stream)
    cl.to_tum(truth, run, tmp_path, stream.time)
    found, _ = judge_trajectories(REAL, {"dead-reckoning": tmp_path / "dead-reckoning"}, largest_difference=0.05)
    own = cl.errors(truth, run)
    assert found["name"].tolist() == [f"Robot{k}" for k in range(1, 6)]
    assert found["ticks"].tolist() == own["ticks"].tolist()
    np.testing.assert_allclose(found["rmse"], own["rmse"], rtol=1e-3)  # the nearest true pose, not an interpolated one


def test_robots_may_be_called_a_little_otherwise_in_files(tmp_path):
    t, paths = paths_of_all()
    for method, name in (("truth", "robot{}"), ("mine", "tb3_{}_ekf")):
        (tmp_path / method).mkdir()
        for k, robot in enumerate(ROBOTS):
            write_tum(tmp_path / method / (name.format(k) + ".txt"), t, paths[method][robot])
    found, notes = judge_trajectories(tmp_path / "truth", {"mine": tmp_path / "mine"})
    assert found["rmse"].tolist() == [expected(paths)["mine", robot] for robot in ROBOTS]
    said = [f"{tmp_path / f'mine/tb3_{k}_ekf.txt'} is taken for robot 'robot{k}'" for k in range(2)]
    assert list(notes[:2]) == said


@pytest.mark.parametrize("place", ["{0}_{1}.txt", "{1}_{0}_ekf.txt", "{0}_{1}/poses.txt", "{0}/{1}.txt"])
def test_dates_in_names_of_files_say_nothing_of_robots(tmp_path, place):
    """Of the seconds, those of one robot's truth and of the other's estimate are alike."""
    t, paths = paths_of_all()
    for method, seconds in (("truth", (31, 33)), ("mine", (33, 31))):
        for robot, second in zip(ROBOTS, seconds, strict=True):
            file = tmp_path / method / place.format(robot, f"2024-05-11-10-19-{second}")
            file.parent.mkdir(parents=True, exist_ok=True)
            write_tum(file, t, paths[method][robot])
    found, notes = judge_trajectories(tmp_path / "truth", {"mine": tmp_path / "mine"})
    assert {*found["name"]} in ({*ROBOTS}, {f"{robot}_ekf" for robot in ROBOTS})
    rmse = dict(zip(found["name"].str.removesuffix("_ekf"), found["rmse"], strict=True))
    assert rmse == {robot: expected(paths)["mine", robot] for robot in ROBOTS}
    assert not [note for note in notes if "taken for" in note]


def test_lines_that_cannot_be_read_are_left_out_and_named(honest, tmp_path):
    t, true, x, _, P = honest
    write_tum(tmp_path / "truth.txt", t, true)
    whole, torn = (written(tmp_path / name, t, x, P, "beside") / "red.txt" for name in ("whole", "torn"))
    lines = torn.read_text().splitlines(keepends=True)
    torn.write_text("".join([*lines[:50], "nan" + lines[50], *lines[51:-1], lines[-1][:20]]))
    table = pd.DataFrame({"t": t, "x": x[:, 0], "y": x[:, 1], "yaw": x[:, 2]})
    table.to_csv(tmp_path / "torn.csv", index=False)
    text = (tmp_path / "torn.csv").read_text().splitlines()
    (tmp_path / "torn.csv").write_text("\n".join([*text[:51], "north,,,", *text[52:-1], text[-1][:9]]))
    rows, notes = judge_trajectories(
        tmp_path / "truth.txt", {"whole": whole, "torn": torn, "csv": tmp_path / "torn.csv"}
    )
    np.testing.assert_allclose(rows["rmse"], rows["rmse"].iloc[0], rtol=1e-6)
    assert rows["anees"].notna().tolist() == [True, True, False]
    assert sum("torn/red.txt, line 51: timestamp is 'nan" in note for note in notes) == 1
    assert any("torn.csv, line" in note for note in notes)


def one_file(folder):
    lines = [(*line[[0, 1, 2]], 2 * np.arctan2(line[6], line[7]), robot) for robot in ROBOTS for line in
             np.loadtxt(folder / f"{robot}.txt")]  # fmt: skip
    table = pd.DataFrame(sorted(lines), columns=["time", "x", "y", "yaw", "robot"])
    table["yaw"] = table.groupby("robot")["yaw"].transform(np.unwrap) + 4 * np.pi  # lines of two robots alternate
    table.to_csv(folder / "all.csv", index=False)
    return folder / "all.csv"


def columns_of_each(folder):
    table = pd.read_csv(one_file(folder)).pivot(index="time", columns="robot")
    table.columns = [f"{robot}_{quantity}" for quantity, robot in table.columns]
    table.reset_index().to_csv(folder / "wide.csv", index=False)
    return folder / "wide.csv"


def test_a_file_of_several_robots_stands_alone(team, tmp_path):
    shutil.copytree(team / "mine", tmp_path / "mine")
    one_file(tmp_path / "mine").rename(tmp_path / "mine/red.csv")
    (tmp_path / "mine/red.txt").unlink()
    with pytest.raises(cl.BadInput, match=r"red\.csv has poses of several robots, and is one of several files"):
        judge_trajectories(team / "truth", {"mine": tmp_path / "mine"})


def folders(folder):
    for robot in ROBOTS:
        (folder / robot).mkdir()
        (folder / f"{robot}.txt").rename(folder / robot / "poses.txt")
    return folder


def other_names(folder):
    for robot in ROBOTS:
        (folder / f"{robot}.txt").rename(folder / f"{robot}_{folder.name}.txt")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("form", [one_file, columns_of_each, folders, other_names])
def test_a_team_is_one_file_or_folders_or_files_named_otherwise(team, tmp_path, form):
    for name in ("truth", "mine"):
        shutil.copytree(team / name, tmp_path / name)
    found, _ = judge_trajectories(form(tmp_path / "truth"), {"mine": form(tmp_path / "mine")})
    files, _ = judge_trajectories(team / "truth", {"mine": team / "mine"})
    assert found["name"].tolist() == files["name"].tolist()
    np.testing.assert_allclose(found[["rmse", "heading"]], files[["rmse", "heading"]], atol=1e-9)


def test_one_file_of_paths_of_unknown_robots_is_refused(tmp_path):
    t, x = true_path(0)
    pd.DataFrame({"t": t, "x": x[:, 0], "y": x[:, 1]}).to_csv(tmp_path / "truth.csv", index=False)
    paths = {f"{name}_{axis}": x[:, k] for name in ("ekf", "pf") for k, axis in enumerate("xy")}
    pd.DataFrame({"t": t, **paths}).to_csv(tmp_path / "mine.csv", index=False)
    with pytest.raises(cl.BadInput, match="robot 'truth' has no trajectory; known are ekf, pf"):
        judge_trajectories(tmp_path / "truth.csv", {"mine": tmp_path / "mine.csv"})


# ---- files of one program hold the truth and all methods, or lack what others have


def write_kitti(folder, t, x):
    c, s, zero, one = np.cos(x[:, 2]), np.sin(x[:, 2]), 0 * t, 1 + 0 * t
    np.savetxt(f"{folder}.txt", np.column_stack([c, -s, zero, x[:, 0], s, c, zero, x[:, 1], zero, zero, one, zero]))


def write_split_stamps(folder, t, x):
    nanoseconds = np.rint(1e9 * (1.7e9 + t)).astype(np.int64)
    stamps = {"secs": nanoseconds // 10**9, "nsecs": nanoseconds % 10**9}
    pd.DataFrame(stamps | {"x": x[:, 0], "y": x[:, 1]}).to_csv(f"{folder}.csv", index=False)


OF_A_ROBOT = {
    "KITTI": write_kitti,
    "seconds and nanoseconds": write_split_stamps,
    "no stamps": lambda path, t, x: frame_of(t, x).drop(columns="t").to_csv(f"{path}.csv", index=False),
    "no names": lambda path, t, x: frame_of(t, x).to_csv(f"{path}.csv", index=False, header=False),
    "blanks": lambda path, t, x: np.savetxt(f"{path}.dat", np.column_stack([t, x[:, :2]])),
    "Parquet": lambda path, t, x: frame_of(t, x).to_parquet(f"{path}.parquet"),
}


@pytest.mark.slow
@pytest.mark.parametrize("write", OF_A_ROBOT.values(), ids=OF_A_ROBOT)
def test_poses_are_read_as_programs_write_them(tmp_path, write):
    t, paths = paths_of_all()
    for method, robots in paths.items():
        (tmp_path / method).mkdir()
        for robot, x in robots.items():
            write(tmp_path / method / (robot if method == "truth" else f"{robot.upper()}_{method}"), t, x)
    found, notes = judge_trajectories(tmp_path / "truth", {name: tmp_path / name for name in ("mine", "theirs")})
    assert rmse_of(found) == expected(paths)
    untimed = "poses without stamps have the numbers of their lines, as ticks"
    assert (untimed in notes) == (write in (OF_A_ROBOT["KITTI"], OF_A_ROBOT["no stamps"]))
    nameless = f"{tmp_path / 'truth'}: columns without names are by their values 1 for time, 2 for x, 3 for y, 4 for"
    assert any(note.startswith(nameless) for note in notes) == (write is OF_A_ROBOT["no names"])


def one_table(folder, t, paths):
    parts = [frame_of(t, x).assign(robot=r, filter=name) for name, of in paths.items() for r, x in of.items()]
    pd.concat(parts).to_csv(folder / "results.csv", index=False)
    return folder / "results.csv"


def columns_of_methods(folder, t, paths, true="gt"):
    for robot in ROBOTS:
        named = {true if name == "truth" else name: of[robot] for name, of in paths.items()}
        table = pd.DataFrame(
            {"t": t} | {f"{q}_{name}": x[:, k] for name, x in named.items() for k, q in enumerate("xyh")}
        )
        table.to_csv(folder / f"{robot}.csv", index=False)
    return folder


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"sigma_x [mm]": 100.0, "sigma_y [mm]": 100.0}, "mine.csv: sigma_x [mm] has another unit: write covariances"),
        ({"sigma_x_mm": 100.0, "sigma_y_mm": 100.0}, "mine.csv: sigma_x_mm has another unit: write covariances"),
        ({"std_x": 0.1, "std_y": 0.1, "std_yaw_deg": 2.0}, "mine.csv: std_yaw_deg has another unit: write covariances"),
        ({"x_mm": 0.0, "y_mm": 0.0, "var_x": 1.0, "var_y": 1.0}, "mine.csv has var_x, whose unit is not told, beside"),
        ({"sigma_y": 0.1}, "mine.csv has sigma_y, and none of x with itself: add it, or remove them"),
    ],
)
def test_covariances_of_another_unit_or_of_one_axis_are_refused(columns, said):
    t, paths = paths_of_all()
    true, mine = (frame_of(t, paths[name]["red"]) for name in ("truth", "mine"))
    with pytest.raises(BadInput) as e:
        judge_trajectories(true, {"mine": mine.drop(columns=["x", "y"] * ("x_mm" in columns)).assign(**columns)})
    assert str(e.value).startswith(said)


def test_of_poses_with_one_stamp_the_first_counts_and_columns_like_hats_are_places():
    t, paths = paths_of_all()
    true, mine = (frame_of(t, paths[name]["red"]) for name in ("truth", "mine"))
    mine = pd.concat([mine, mine.head(100).assign(x=0.0)]).rename(columns={"x": "x_h", "y": "y_h"})
    found, notes = judge_trajectories(true, {"mine": mine})
    assert found["rmse"].item() == expected(paths)["mine", "red"]
    assert notes[0] == "mine.csv: left out 100 poses with the stamp of another"


def test_errors_and_what_was_wanted_beside_poses_are_no_poses():
    t, paths = paths_of_all()
    true, mine = (frame_of(t, paths[name]["red"]) for name in ("truth", "mine"))
    beside = pd.DataFrame(dict.fromkeys(("error_x", "error_y", "ref_x", "ref_y", "goal_x"), 9.0), index=mine.index)
    found, _ = judge_trajectories(true, {"mine": pd.concat([beside, mine], axis=1)})
    assert found["rmse"].item() == expected(paths)["mine", "red"]


def test_a_flag_names_no_method(tmp_path):
    t, paths = paths_of_all()
    true, mine = (frame_of(t, paths[name]["red"]).assign(seen=t > 5.0) for name in ("truth", "mine"))
    found, _ = judge_trajectories(true, {"mine": mine})
    assert found["ticks"].item() == len(t)


@pytest.mark.slow
def test_tables_in_memory_are_judged_as_files_are(tmp_path):
    t, paths = paths_of_all()
    results = pd.read_csv(one_table(tmp_path, t, paths))
    own = {name: results[results["filter"] == name].drop(columns="filter") for name in paths}
    found, _ = judge_trajectories(own["truth"], {"mine": own["mine"].set_index("t"), "theirs": results})
    assert rmse_of(found) == expected(paths)
    with pytest.raises(cl.BadInput, match=r"mine.csv has no column x; it has t, y, theta, robot: name one so"):
        judge_trajectories(own["truth"], {"mine": own["mine"].drop(columns="x")})
    with pytest.raises(cl.BadInput, match=r"mine is a list; name a folder, file or bag, or give a pandas.DataFrame"):
        judge_trajectories(own["truth"], {"mine": [own["mine"]]})
    with pytest.raises(cl.BadInput, match="estimates is a DataFrame: name each, as in"):
        judge_trajectories(own["truth"], own["mine"])


@pytest.mark.slow
@pytest.mark.parametrize("form", [one_table, columns_of_methods])
def test_the_truth_and_all_methods_may_be_in_one_table(tmp_path, form):
    t, paths = paths_of_all()
    place = form(tmp_path, t, paths)
    found, _ = judge_trajectories(place, dict.fromkeys(("mine", "theirs"), place))
    assert rmse_of(found) == expected(paths)
    said = "67% of its poses have the stamp of another" if form is one_table else "has poses of several robots"
    with pytest.raises(cl.BadInput, match=said):
        judge_trajectories(place, {"ours": place})


@pytest.mark.slow
@pytest.mark.parametrize("methods", [("odom", "ekf"), ("ekf", "odom")])
def test_of_columns_of_odometry_and_of_a_filter_those_of_the_method_count(tmp_path, methods):
    t, paths = paths_of_all()
    of = {"gt": "truth", "odom": "theirs", "ekf": "mine"}
    for robot in ROBOTS:
        parts = [
            frame_of(t, paths[of[name]][robot]).drop(columns="t").add_prefix(f"{name}_") for name in ("gt", *methods)
        ]
        pd.concat([pd.DataFrame({"t": t}), *parts], axis=1).to_csv(tmp_path / f"{robot}.csv", index=False)
    found, _ = judge_trajectories(tmp_path, dict.fromkeys(("ekf", "odom", "other"), tmp_path))
    errors = {key: found.loc[found["estimator"] == key, "rmse"].tolist() for key in ("ekf", "odom", "other")}
    for key, method in (("ekf", "mine"), ("odom", "theirs"), ("other", "mine")):
        assert errors[key] == [expected(paths)[method, robot] for robot in sorted(ROBOTS)]


@pytest.mark.slow
def test_a_word_says_which_columns_are_true_and_methods_in_any_case(tmp_path):
    t, paths = paths_of_all()
    of = {"gnss": "truth", "PF": "mine", "odom": "theirs", "EKF": "mine"}
    parts = [frame_of(t, paths[of[name]]["red"]).drop(columns="t").add_prefix(f"{name}_") for name in of]
    place = tmp_path / "red.csv"
    pd.concat([pd.DataFrame({"t": t}), *parts], axis=1).to_csv(place, index=False)
    found, notes = judge_trajectories(f"gnss={place}", dict.fromkeys(("pf", "odom", "ekf"), place))
    assert not any("does not say of which x" in note for note in notes)  # there are no covariances
    for method, key in (("pf", "mine"), ("odom", "theirs"), ("ekf", "mine")):
        assert found.loc[found["estimator"] == method, "rmse"].item() == expected(paths)[key, "red"]
    with pytest.raises(BadInput, match="if other columns or topics are true, name them: --truth WORD="):
        judge_trajectories(place, {"pf": place})
    with pytest.raises(BadInput, match=r"red.csv: no column or topic has the word 'gnsss': name one that is true"):
        judge_trajectories(f"gnsss={place}", {"pf": place})
    pd.read_csv(place).assign(sigma_x=1.0, sigma_y=1.0).to_csv(place, index=False)
    _, notes = judge_trajectories(f"gnss={place}", {"odom": place})
    assert any(note.endswith("sigma_x does not say of which x it is: it counts for odom_x") for note in notes)


def test_columns_of_the_truth_beside_an_estimate_are_of_the_truth_alone(tmp_path):
    t, paths = paths_of_all()
    del paths["theirs"]
    place = columns_of_methods(tmp_path, t, {"truth": paths["truth"], "hat": paths["mine"]})
    found, _ = judge_trajectories(place, {"mine": place})
    assert rmse_of(found) == {key: value for key, value in expected(paths | {"theirs": {}}).items() if key[0] == "mine"}


@pytest.mark.parametrize(
    ("names", "diagonal"),
    [
        (("cov_xx", "cov_xy", "cov_x_theta", "cov_yy", "cov_y_theta", "cov_theta_theta"), False),
        (("Pxx [m^2]", "Pyx [m^2]", "Pxh", "Pyy [m^2]", "Pyh", "Phh"), False),
        (tuple(f"pose.covariance_{k}" for k in (0, 1, 5, 7, 11, 35)), False),
        (tuple(f"field.pose.covariance{k}" for k in (0, 1, 5, 7, 11, 35)), False),
        (("sigma_x", "", "", "sigma_y", "", "sigma_yaw"), True),
        (("var_x", "", "", "variance_y", "", "var_h"), True),
        (("pos_x_std", "", "", "pos_y_std", "", "yaw_std"), True),
        (("P00", "P01", "P02", "P11", "P12", "P22"), False),
        (("P[1,1]", "P[1,2]", "P[1,3]", "P[2,2]", "P[2,3]", "P[3,3]"), False),
        (("cov_0_0", "cov_0_1", "cov_0_2", "cov_1_1", "cov_1_2", "cov_2_2"), False),
    ],
)
def test_covariances_are_columns_of_any_usual_name(honest, tmp_path, names, diagonal):
    t, true, x, _, P = honest
    write_tum(tmp_path / "truth.txt", t, true)
    P = P * np.eye(3) if diagonal else P
    values = dict(zip(names, P[(slice(None), *np.triu_indices(3))].T, strict=True))
    deviations = ("sigma", "std")
    values = {name: np.sqrt(v) if any(word in name for word in deviations) else v for name, v in values.items() if name}
    table = frame_of(t, x).assign(**values, **{"twist.covariance_0": 9.0, "cov_z_z": 9.0, "sigma2": 9.0})
    table.to_csv(tmp_path / "mine.csv", index=False)
    (tmp_path / "theirs").mkdir()
    there = written(tmp_path / "theirs/form", t, x, P, "npz")
    rows, notes = judge_trajectories(tmp_path / "truth.txt", {"mine": tmp_path / "mine.csv", "theirs": there})
    for column in ("anees", "pose_nees"):
        assert rows[column].iloc[0] == pytest.approx(rows[column].iloc[1], rel=1e-5)
    beside = f"{tmp_path / 'mine.csv'}: no columns have covariances beside the diagonal: they count as 0"
    assert (beside in notes) == diagonal


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"t": 0, "longitude": 1, "latitude": 2}, "longitude and latitude are degrees on the globe: write x, y"),
        ({"1": 4, "2": 5, "3": 6}, "has no column x; it has 1, 2, 3: write their names above"),
    ],
)
def test_columns_that_are_no_plane_positions_are_refused(tmp_path, columns, said):
    t, true = true_path(0)
    write_tum(tmp_path / "truth.txt", t, true)
    given = np.column_stack([t, true[:, :2], *np.random.default_rng(0).normal(size=(4, len(t)))])
    table = pd.DataFrame({name: given[:, k] for name, k in columns.items()})
    table.to_csv(tmp_path / "mine.csv", index=False, header="1" not in columns)
    with pytest.raises(cl.BadInput, match=said):
        judge_trajectories(tmp_path / "truth.txt", {"mine": tmp_path / "mine.csv"})


def test_a_path_in_the_axes_of_a_camera_is_refused_and_one_along_a_corridor_is_not(tmp_path):
    t, true = true_path(0)
    write_tum(tmp_path / "truth.txt", t, true)
    zero, one = 0 * t, 1 + 0 * t
    right, forward, turned = -true[:, 1], true[:, 0], -true[:, 2] / 2
    camera = [t, right, 0.01 * np.sin(t), forward, zero, np.sin(turned), zero, np.cos(turned)]
    np.savetxt(tmp_path / "camera.txt", np.column_stack(camera))
    with pytest.raises(cl.BadInput, match="m along x, y and z: turn it so that z points up; a camera's z points"):
        judge_trajectories(tmp_path / "truth.txt", {"mine": tmp_path / "camera.txt"})
    corridor = [t, 0.2 * t, 0.001 * t, 0.02 * t, zero, zero, zero, one]
    for name, shift in (("true", 0.0), ("found", 0.1)):
        np.savetxt(tmp_path / f"{name}.txt", np.column_stack(corridor) + shift * np.eye(8)[1])
    rows, _ = judge_trajectories(tmp_path / "true.txt", {"mine": tmp_path / "found.txt"})
    assert rows["rmse"].item() == pytest.approx(0.1)
