"""External trajectories: read, judged as ours are, or refused; ours written as TUM files, datasets and films."""

import json
import shutil
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from processes import inside

import cooploc as cl
from cooploc.analysis.metrics.external import ELSEWHERE, evaluate_external, read_tum, remarks_on
from cooploc.analysis.plot.beliefs import ellipse_shape

LABEL = "camera/n=2[ticks=6]"


@pytest.fixture(scope="module")
def ours():
    truth, stream = cl.simulate(LABEL, trials=6, seed=3)
    return truth, stream, cl.run(["ekf-local", "dead-reckoning"], stream)


@pytest.fixture
def written(ours, tmp_path):
    cl.to_tum(ours[0], ours[2], tmp_path / "theirs", ours[1].time)
    return tmp_path / "theirs"


def test_a_tum_file_holds_stamps_positions_and_headings_and_is_read_again(ours, written):
    _, stream, run = ours
    stamp, x, y, z, qx, qy, qz, qw = np.loadtxt(written / "ekf-local" / "trial1-robot0.txt").T
    pose = run.traces["ekf-local"].x[1, :, 0]
    np.testing.assert_allclose(stamp, stream.time, atol=1e-9)
    np.testing.assert_allclose(np.stack([x, y], -1), pose[:, :2], atol=1e-9)
    assert not np.any([z, qx, qy])
    np.testing.assert_allclose(np.exp(2j * np.arctan2(qz, qw)), np.exp(1j * pose[:, 2]), atol=1e-8)
    np.testing.assert_allclose(read_tum(written, stream)["ekf-local"].x, run.traces["ekf-local"].x, atol=1e-8)


OTHER_PATHS = {
    "mm": (lambda x: 1000 * x, "mine: robot '0, trial 0' has the true path .* times as large: write m"),
    "y forward": (lambda x: x[..., ::-1], "mine: robot '0, trial 0' has a mirrored path"),
    "frame": (
        lambda x: x + 30,
        "mine errs by 42.* once all robots are aligned .*: write it in the frame of the stream",
    ),
    "robots": (
        lambda x: x[:, :, ::-1],
        "mine: robot '0, trial 0' fits the truth to .*, and that of '2, trial 0' .* names exchanged",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(("change", "said"), OTHER_PATHS.values(), ids=OTHER_PATHS)
def test_of_paths_that_fit_the_truth_of_the_stream_otherwise_it_is_said(change, said):
    truth, stream = cl.simulate("trajectory[ticks=120]", trials=2, seed=3)
    trace = cl.run(["ekf-ci"], stream).traces["ekf-ci"]
    mine = cl.Trace.of(np.ascontiguousarray(change(trace.x)), np.full_like(trace.P, np.nan))
    assert (
        remarks_on(truth, cl.Run(stream.scenario, 3, stream.trial, stream.hashes, {"mine": trace}), stream.time) == ()
    )
    if said.startswith("mine: robot '0, trial 0' has"):
        with pytest.raises(cl.BadInput, match=said):
            cl.judge(truth, stream, {"mine": mine})
    else:
        with pytest.warns(UserWarning, match=said):
            cl.judge(truth, stream, {"mine": mine})


def test_the_truth_of_a_stream_is_no_estimate_and_short_paths_are_not_looked_at():
    truth, stream = cl.simulate("camera/n=2[ticks=20]", trials=1, seed=3)
    mine = cl.Trace.of(truth.x, np.full((*truth.x.shape, truth.x.shape[-1]), np.nan))
    with pytest.raises(cl.BadInput, match="mine: poses of robot '0' are the true ones: name other files"):
        cl.judge(truth, stream, {"mine": mine})
    truth = replace(truth, valid=truth.valid & (np.arange(20) > 0)[:, None])
    assert cl.judge(truth, stream, {"mine": mine})["rmse"].max() < 1e-9


def test_files_of_our_own_trajectories_and_covariances_have_our_errors_and_consistency(ours, written):
    truth, stream, run = ours
    theirs, mine = cl.judge(truth, stream, written), cl.errors(truth, run)
    both = theirs.merge(mine, on=["estimator", "trial", "robot"], suffixes=("", "_mine"))
    assert len(both) == len(mine) == 24
    for column in ("mse", "max_error", "final_error", "ticks"):
        np.testing.assert_allclose(both[column], both[f"{column}_mine"], rtol=1e-6)
    for column in ("anees", "nll", "area95", "coverage95"):
        np.testing.assert_allclose(both[column], both[f"{column}_mine"], rtol=1e-5, atol=1e-6)
    assert theirs[["seconds", "bytes"]].isna().all(axis=None)
    assert set(theirs["certificate"]) == {ELSEWHERE}
    for file in written.glob("*/*.cov.txt"):
        file.unlink()
    without = cl.judge(truth, stream, written)
    assert without[["anees", "nll", "area95", "coverage95"]].isna().all(axis=None)
    assert set(cl.compare(without, "dead-reckoning")["consistency"]) == {"not assessed"}


def edit(change, kind=""):
    def damage(folder):
        file = folder / "ekf-local" / f"trial2-robot1{kind}.txt"
        file.write_text("".join(f"{line}\n" for line in change(file.read_text().splitlines())))

    return damage


def edit_alone(change):
    """The same, where there are no covariances."""

    def damage(folder):
        edit(change)(folder)
        for file in folder.glob("ekf-local/*.cov.txt"):
            file.unlink()

    return damage


def word(line, column, value):
    words = line.split()
    words[column] = value
    return " ".join(words)


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda f: (f / "ekf-local" / "trial2-robot1.txt").unlink(), r"robot1\.txt is missing: .* robots 0 to 1"),
        (lambda f: (f / "ekf-local" / "trial2-robot2.txt").write_text(""), "robot2.txt is of no robot of the stream"),
        (shutil.rmtree, "there is no folder"),
        (lambda f: [shutil.rmtree(one) for one in f.iterdir()], r"holds no trial0-robot0\.txt"),
        (lambda f: (f / "ekf-local" / "trial2-robot1.cov.txt").unlink(), r"trial2-robot1\.cov\.txt is missing"),
        (edit(lambda lines: [word(one, 1, "-1") for one in lines], ".cov"), "line 1: the covariance is not positive"),
        (
            edit(lambda lines: [" ".join(one.split()[:4]) for one in lines], ".cov"),
            "robot 1 in trial 2, tick 0 is not finite",
        ),
        (edit(lambda lines: lines[:-1], ".cov"), r"robot1\.cov\.txt: its stamps are not those of trial2-robot1:"),
        (edit_alone(lambda lines: lines[:-1]), "has 5 lines, and the stream 6 ticks"),
        (edit_alone(lambda lines: [*lines[:3], word(lines[3], 0, "9"), *lines[4:]]), "the stamp of tick 3 is "),
        (edit(lambda lines: [*lines[:2], word(lines[2], 1, "nan"), *lines[3:]]), "line 3: tx is 'nan'"),
        (edit(lambda lines: [one.rpartition(" ")[0] for one in lines]), "line 1: 7 columns, not 8"),
        (edit(lambda lines: [word(one, 7, "3") for one in lines]), "line 1: qx qy qz qw is not a unit quaternion"),
    ],
)
def test_a_file_that_does_not_fit_is_refused_in_one_line(ours, written, damage, reason):
    damage(written)
    with pytest.raises(cl.BadInput, match=reason) as raised:
        cl.judge(ours[0], ours[1], written)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda x, P: (x[:, :-1],), "and this stream has 6 trials, 6 ticks, 2 robots"),
        (lambda x, P: (x[..., :1],), "2 or 3"),
        (lambda x, P: (lost(x),), "the pose of robot 0 in trial 0, tick 4 is not finite"),
        (lambda x, P: (x, lost(P)), "the covariance of robot 0 in trial 0, tick 4 is not finite"),
    ],
)
def test_a_trace_that_does_not_fit_is_refused_and_a_bad_covariance_may_not_be_left_out(ours, change, reason):
    truth, stream, run = ours
    trace = run.traces["ekf-local"]
    with pytest.raises(cl.BadInput, match=reason):
        cl.judge(truth, stream, {"mine": cl.Trace.of(*change(trace.x, trace.P))})


def lost(values):
    """The same (trial, tick, ...) without tick 4."""
    return np.where(np.arange(6).reshape(6, *[1] * (values.ndim - 2)) == 4, np.nan, values)


def test_a_stream_file_or_a_label_is_judged_beside_our_own(ours, written, tmp_path):
    ours[1].save(tmp_path / "stream.npz")
    shutil.rmtree(written / "dead-reckoning")
    (written / "ekf-local").rename(written / "matlab")
    for source, options in ((str(tmp_path / "stream.npz"), {}), (LABEL, {"trials": 6, "seed": 3})):
        rows, _, run, _ = evaluate_external(source, written, "ekf-local", False, **options)
        table = cl.compare(rows, "ekf-local", full=True)
        assert list(run.traces) == ["ekf-local", "matlab"]
        assert table["estimator"].tolist() == ["ekf-local", "matlab"]
        assert table["rmse"][1] == pytest.approx(table["rmse"][0], rel=1e-6)
        assert table["certificate"].tolist() == ["", ELSEWHERE]


def test_no_drift_is_printed_where_there_is_no_heading(tmp_path):
    truth, stream = cl.simulate("trajectory[ticks=3]", trials=1)
    cl.to_tum(truth, cl.run(["dead-reckoning"], stream), tmp_path, stream.time)
    done = inside("judge", "trajectory[ticks=3]", "--tum", tmp_path / "dead-reckoning")
    assert ("RMSE" in done.stdout, "drift" in done.stdout) == (True, False), done.stderr


def test_the_command_prints_the_table(written):
    done = inside("judge", LABEL, "--trials", "6", "--seed", "3", "--tum", written, "--json")
    assert done.returncode == 0, done.stderr
    assert [row["estimator"] for row in json.loads(done.stdout)] == ["dead-reckoning", "ekf-local"]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"scenario": "nlos[ticks=6]"}, "does not hold the readings"),
        ({"scenario": "mine.py:World"}, "is not built in"),
        ({"seed": 4}, "does not hold the readings"),
    ],
)
def test_a_file_whose_truth_cannot_be_made_again_is_refused(ours, written, tmp_path, change, reason):
    replace(ours[1], **change).save(tmp_path / "stream.npz")
    with pytest.raises(cl.BadInput, match=reason):
        evaluate_external(str(tmp_path / "stream.npz"), written, None, False)
    with pytest.raises(cl.BadInput, match=r"there is no file nothing\.npz; check its path"):
        evaluate_external("nothing.npz", written, None, False)


def test_a_folder_is_never_shared_and_the_truth_never_overwritten(ours, tmp_path):
    truth, stream, run = ours
    trace = run.traces["ekf-local"]
    files = cl.to_tum(truth, replace(run, traces={"truth": trace}), tmp_path, stream.time)
    assert len(files) == len(set(files)) == 2 * 6 * 2
    with pytest.raises(cl.BadInput, match="one number a tick"):
        cl.to_tum(truth, run, tmp_path, stream.time[1:])
    with pytest.raises(cl.BadInput, match="would share a folder"):
        cl.to_tum(truth, replace(run, traces={"a/b": trace, "a b": trace}), tmp_path)
    with pytest.raises(cl.BadInput, match="different streams"):
        cl.to_tum(truth.select([0]), run, tmp_path)


def test_a_dataset_with_the_truth_has_errors_and_units_and_goes_into_a_file(ours, tmp_path):
    truth, stream, run = ours
    data = run.to_xarray(truth)
    data.to_netcdf(tmp_path / "run.nc")
    again = xr.load_dataset(tmp_path / "run.nc")
    xr.testing.assert_equal(again, data)
    assert again.attrs == {"scenario": run.scenario, "seed": run.seed}
    assert list(again["unit"].values) == ["m", "m", "rad"]
    assert (again["error"].units, again["seconds"].units, again["time"].units) == ("m", "s", "s")
    np.testing.assert_array_equal(again["time"], stream.time)
    mean = again["error"].sel(estimator="ekf-local").mean("tick")
    expected = cl.errors(truth, run).query("estimator == 'ekf-local'")["mean_error"]
    np.testing.assert_allclose(mean.values.ravel(), expected)


@pytest.mark.slow
def test_an_animation_shows_every_tick_of_its_own_stream(ours, tmp_path):
    truth, stream, run = ours
    _, ax = plt.subplots()
    cl.plot.animate(truth, run, stream, trial=1, ax=ax).save(tmp_path / "film.gif", writer="pillow")
    assert "trial 1, tick 5" in ax.get_title(loc="left")
    drawn = next(line for line in ax.lines if line.get_label() == "truth")
    np.testing.assert_array_equal(np.transpose(drawn.get_data()), truth.x[1, 5, :, :2])
    plt.close("all")
    other, unpaired = cl.simulate(LABEL, trials=6, seed=4)
    for show in (lambda: cl.plot.animate(truth, run, unpaired), lambda: run.to_xarray(other)):
        with pytest.raises(cl.BadInput, match="simulate it again"):
            show()


def test_an_ellipse_holds_95_percent():
    P = np.array([[0.5, 0.3], [0.3, 0.4]])
    width, height, angle = ellipse_shape(P)
    e = np.random.default_rng(0).multivariate_normal([0, 0], P, 20000)
    along, across = (e @ [np.cos(a), np.sin(a)] for a in np.radians([angle, angle + 90]))
    assert abs(np.mean((2 * along / width) ** 2 + (2 * across / height) ** 2 <= 1) - 0.95) < 0.006
