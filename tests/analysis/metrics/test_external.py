"""Trajectories that were computed elsewhere: read, judged as ours are, or refused; ours written as TUM files."""

import json
import shutil
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from processes import inside

import cooploc as cl
from cooploc.analysis.metrics.external import ELSEWHERE, evaluate_external, read_tum
from cooploc.analysis.plot.beliefs import ellipse_shape

LABEL = "robots-1-3/n=2[ticks=6]"


@pytest.fixture(scope="module")
def ours():
    truth, stream = cl.simulate(LABEL, trials=6, seed=3)
    return truth, stream, cl.run(["ekf-local", "dead-reckoning"], stream)


@pytest.fixture
def written(ours, tmp_path):
    cl.to_tum(ours[0], ours[2], tmp_path / "theirs", ours[1].time)
    return tmp_path / "theirs"


def test_files_of_our_own_trajectories_have_our_errors_and_neither_consistency_nor_cost(ours, written):
    truth, stream, run = ours
    theirs, mine = cl.judge(truth, stream, written), cl.errors(truth, run)
    both = theirs.merge(mine, on=["estimator", "trial", "robot"], suffixes=("", "_mine"))
    assert len(both) == len(mine) == 24
    for column in ("mse", "max_error", "final_error", "ticks"):
        np.testing.assert_allclose(both[column], both[f"{column}_mine"], rtol=1e-6)
    assert theirs[["anees", "nll", "area95", "coverage95", "seconds", "bytes"]].isna().all(axis=None)
    assert set(theirs["certificate"]) == {ELSEWHERE}


def test_without_covariances_none_is_consistent_over_confident_or_best(ours, written):
    table = cl.compare(cl.judge(ours[0], ours[1], written), "dead-reckoning", full=True)
    assert set(table["consistency"]) == {"not assessed"}
    assert set(table["failed"]) == {0}


def test_poses_are_read_as_they_were_written_with_their_headings(tmp_path):
    truth, stream = cl.simulate("camera[ticks=5]", trials=1, seed=2)
    run = cl.run(["ekf-local"], stream)
    cl.to_tum(truth, run, tmp_path, stream.time)
    (found,) = read_tum(tmp_path, stream).values()
    np.testing.assert_allclose(found.x, run.traces["ekf-local"].x, atol=1e-8)


def edit(change):
    def damage(folder):
        file = folder / "ekf-local" / "trial2-robot1.txt"
        file.write_text("".join(f"{line}\n" for line in change(file.read_text().splitlines())))

    return damage


def word(line, column, value):
    words = line.split()
    words[column] = value
    return " ".join(words)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda f: (f / "ekf-local" / "trial2-robot1.txt").unlink(), r"has no trial2-robot1\.txt; .* robots 0 to 1"),
        (lambda f: (f / "ekf-local" / "trial2-robot2.txt").write_text(""), "is of no trial and robot of the stream"),
        (lambda f: shutil.rmtree(f), "there is no folder"),
        (lambda f: [shutil.rmtree(one) for one in f.iterdir()], r"holds no trial0-robot0\.txt"),
        (edit(lambda lines: lines[:-1]), "has 5 lines, and the stream 6 ticks"),
        (edit(lambda lines: [*lines[:3], *lines[4:], lines[3]]), "line 4: its stamp is"),
        (edit(lambda lines: [word(one, 0, str(i)) for i, one in enumerate(lines)]), "line 1: its stamp is 0 s"),
        (edit(lambda lines: [*lines[:2], word(lines[2], 1, "nan"), *lines[3:]]), "line 3: tx is 'nan'"),
        (edit(lambda lines: [one.rpartition(" ")[0] for one in lines]), "line 1: 7 columns, not 8"),
        (edit(lambda lines: [word(one, 7, "0.2") for one in lines]), "line 1: qx qy qz qw is not a unit quaternion"),
        (edit(lambda lines: []), "the file is empty"),
    ],
)
def test_what_does_not_fit_is_one_line(ours, written, damage, said):
    damage(written)
    with pytest.raises(cl.BadInput, match=said) as raised:
        cl.judge(ours[0], ours[1], written)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda x: x[:, :-1], "and this stream has 6 trials, 6 ticks, 2 robots"),
        (lambda x: x[..., :1], "2 or 3"),
        (lambda x: np.where(np.arange(6)[:, None, None] == 4, np.nan, x), "robot 0 in trial 0, tick 4 is not finite"),
    ],
)
def test_a_trace_that_does_not_fit_is_one_line(ours, change, said):
    truth, stream, run = ours
    with pytest.raises(cl.BadInput, match=said):
        cl.judge(truth, stream, {"mine": cl.Trace.of(change(run.traces["ekf-local"].x))})


def test_the_command_judges_beside_our_own(ours, written, tmp_path):
    ours[1].save(tmp_path / "stream.npz")
    shutil.rmtree(written / "dead-reckoning")
    (written / "ekf-local").rename(written / "matlab")
    for source in ([tmp_path / "stream.npz"], [LABEL, "--trials", "6", "--seed", "3"]):
        done = inside("judge", *source, "--tum", written, "--estimators", "ekf-local", "--json")
        assert done.returncode == 0, done.stderr
        table = pd.DataFrame(json.loads(done.stdout)).set_index("estimator")
        assert list(table.index) == ["ekf-local", "matlab"]
        assert table.loc["matlab", "rmse"] == pytest.approx(table.loc["ekf-local", "rmse"], rel=1e-6)
        assert table.loc["matlab", "certificate"] == ELSEWHERE
    shown = inside("judge", LABEL, "--trials", "6", "--seed", "3", "--tum", written / "matlab")
    assert "matlab is not checked: computed elsewhere" in shown.stdout


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scenario": "nlos[ticks=6]"}, "does not hold the readings"),
        ({"scenario": "mine.py:World"}, "is not built in"),
        ({"seed": 4}, "does not hold the readings"),
    ],
)
def test_a_file_whose_truth_cannot_be_made_again_is_refused(ours, written, tmp_path, change, said):
    replace(ours[1], **change).save(tmp_path / "stream.npz")
    with pytest.raises(cl.BadInput, match=said):
        evaluate_external(str(tmp_path / "stream.npz"), written, None, False)


@pytest.fixture(scope="module")
def ran():
    truth, stream = cl.simulate("camera/n=2", trials=2, seed=1, ticks=8)
    run = cl.run({"ekf-local": cl.make("ekf-local"), "truth": cl.make("dead-reckoning")}, stream)
    return truth, stream, run


def test_a_tum_file_holds_stamps_positions_and_headings(ran, tmp_path):
    truth, stream, run = ran
    files = cl.to_tum(truth, run, tmp_path, stream.time)
    assert len(files) == len(set(files)) == 3 * 2 * 2  # an estimator called truth does not overwrite the truth
    stamp, x, y, z, qx, qy, qz, qw = np.loadtxt(tmp_path / "ekf-local" / "trial1-robot0.txt").T
    pose = run.traces["ekf-local"].x[1, :, 0]
    np.testing.assert_allclose(stamp, stream.time, atol=1e-9)
    np.testing.assert_allclose(np.stack([x, y], -1), pose[:, :2], atol=1e-9)
    assert not np.any([z, qx, qy])
    np.testing.assert_allclose(np.exp(2j * np.arctan2(qz, qw)), np.exp(1j * pose[:, 2]), atol=1e-8)


def test_what_cannot_be_written_is_refused(ran, tmp_path):
    truth, stream, run = ran
    with pytest.raises(cl.BadInput, match="one number a tick"):
        cl.to_tum(truth, run, tmp_path, stream.time[1:])
    with pytest.raises(cl.BadInput, match="would share a folder"):
        cl.to_tum(truth, cl.run({"a/b": cl.make("ekf-local"), "a b": cl.make("ekf-local")}, stream), tmp_path)
    with pytest.raises(cl.BadInput, match="different streams"):
        cl.to_tum(truth.select([0]), run, tmp_path)


def test_a_dataset_with_the_truth_has_errors_seconds_and_units_and_goes_into_a_file(ran, tmp_path):
    truth, stream, run = ran
    data = run.to_xarray(truth)
    data.to_netcdf(tmp_path / "run.nc")
    again = xr.load_dataset(tmp_path / "run.nc")
    xr.testing.assert_equal(again, data)
    assert again.attrs == data.attrs == {"scenario": run.scenario, "seed": run.seed}
    assert list(again["unit"].values) == ["m", "m", "rad"]
    assert (again["error"].units, again["seconds"].units, again["time"].units) == ("m", "s", "s")
    np.testing.assert_array_equal(again["time"], stream.time)
    assert again["stream"].values.tolist() == list(run.hashes)
    mean = again["error"].sel(estimator="ekf-local").mean("tick")
    expected = cl.errors(truth, run).query("estimator == 'ekf-local'")["mean_error"]
    np.testing.assert_allclose(mean.values.ravel(), expected)
    other, _ = cl.simulate(run.scenario, trials=len(run.trial), seed=run.seed + 1)
    with pytest.raises(cl.BadInput, match="simulate it again"):
        run.to_xarray(other)


def test_an_animation_shows_every_tick(ran, tmp_path):
    truth, stream, run = ran
    _, ax = plt.subplots()
    film = cl.plot.animate(truth, run, stream, trial=1, ax=ax)
    film.save(tmp_path / "film.gif", writer="pillow")
    assert "trial 1, tick 7" in ax.get_title(loc="left")
    drawn = next(line for line in ax.lines if line.get_label() == "truth")
    np.testing.assert_array_equal(np.transpose(drawn.get_data()), truth.x[1, 7, :, :2])
    _, other = cl.simulate("camera/n=2", trials=2, seed=2, ticks=8)
    with pytest.raises(cl.BadInput, match="simulate it again"):
        cl.plot.animate(truth, run, other)
    plt.close("all")


def test_an_ellipse_holds_the_share_it_says():
    P = np.array([[0.5, 0.3], [0.3, 0.4]])
    width, height, angle = ellipse_shape(P)
    turn = np.radians(angle)
    e = np.random.default_rng(0).multivariate_normal([0, 0], P, 20000)
    along = e @ [np.cos(turn), np.sin(turn)] / (width / 2)
    across = e @ [-np.sin(turn), np.cos(turn)] / (height / 2)
    assert abs(np.mean(along**2 + across**2 <= 1) - 0.95) < 0.006
