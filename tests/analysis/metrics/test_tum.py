"""Trajectories on disk, as labelled arrays and as pictures say what the run says."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

import cooploc as cl
from cooploc.analysis.plot.beliefs import shape


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


def test_ticks_without_truth_are_not_in_its_file(ran, tmp_path):
    truth, _, run = ran
    truth.valid[0, 3, 1] = False
    try:
        cl.to_tum(truth, run, tmp_path)
    finally:
        truth.valid[0, 3, 1] = True
    assert np.loadtxt(tmp_path / "truth" / "trial0-robot1.txt")[:, 0].tolist() == [1, 2, 3, 5, 6, 7, 8]


def test_what_cannot_be_written_is_refused(ran, tmp_path):
    truth, stream, run = ran
    with pytest.raises(cl.BadInput, match="one number a tick"):
        cl.to_tum(truth, run, tmp_path, stream.time[1:])
    with pytest.raises(cl.BadInput, match="would share a folder"):
        cl.to_tum(truth, cl.run({"a/b": cl.make("ekf-local"), "a b": cl.make("ekf-local")}, stream), tmp_path)
    with pytest.raises(cl.BadInput, match="different streams"):
        cl.to_tum(truth.select([0]), run, tmp_path)


def test_a_dataset_names_every_axis(ran):
    _, _, run = ran
    data = run.to_xarray()
    assert data["x"].dims == ("estimator", "trial", "tick", "robot", "axis")
    one = data.sel(estimator="ekf-local", trial=1, robot=1)
    trace = run.traces["ekf-local"]
    np.testing.assert_array_equal(one["x"].sel(axis="heading"), trace.x[1, :, 1, 2])
    np.testing.assert_array_equal(one["P"].sel(axis="x", other_axis="y"), trace.P[1, :, 1, 0, 1])
    assert float(one["bytes"]) == trace.bytes[1, 1]
    assert data.attrs["scenario"] == run.scenario


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


def test_no_ellipse_of_an_animation_is_cut_off(ran):
    truth, stream, run = ran
    film = cl.plot.animate(truth, run, stream, step=3)
    assert list(film.new_frame_seq()) == [0, 3, 6]
    film._init_draw()  # else matplotlib warns that it was never drawn
    ax = plt.gcf().axes[0]
    for trace in run.traces.values():
        reach = 2.4 * np.sqrt(trace.P[0, ..., 0, 0])
        assert (trace.x[0, ..., 0] + reach).max() < ax.get_xlim()[1]
        assert (trace.x[0, ..., 0] - reach).min() > ax.get_xlim()[0]
    with pytest.raises(cl.BadInput, match="step is 0"):
        cl.plot.animate(truth, run, step=0)
    plt.close("all")


def test_an_ellipse_holds_the_share_it_says():
    P = np.array([[0.5, 0.3], [0.3, 0.4]])
    width, height, angle = shape(P)
    turn = np.radians(angle)
    e = np.random.default_rng(0).multivariate_normal([0, 0], P, 20000)
    along = e @ [np.cos(turn), np.sin(turn)] / (width / 2)
    across = e @ [-np.sin(turn), np.cos(turn)] / (height / 2)
    assert abs(np.mean(along**2 + across**2 <= 1) - 0.95) < 0.006


def test_beliefs_are_drawn_of_trials_and_ticks_that_are_there(ran):
    truth, _, run = ran
    ax = cl.plot.ellipses(truth, run, trial=1, tick=3)
    assert len(ax.patches) == 2 * len(run.traces)
    assert len(cl.plot.anees(truth, run).get_legend().get_texts()) == len(run.traces)
    for wrong, says in (({"trial": 5}, "no trial 5"), ({"tick": 8}, "no tick 8")):
        with pytest.raises(cl.BadInput, match=says):
            cl.plot.ellipses(truth, run, **wrong)
    plt.close("all")
