"""Errors and consistency of a run, on traces made by hand; curves over time and over a sweep."""

import numpy as np
import pandas as pd
import pytest

import cooploc as cl
from cooploc.analysis.metrics.compare import over_time
from cooploc.analysis.metrics.consistency import band
from cooploc.analysis.metrics.errors import COLUMNS, OPTIONAL_COLUMNS, SENSES, errors
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.stream import Truth

ARENA = np.array([[0.0, 0.0], [8.0, 8.0]])


def made(x, P, true, valid=None, trial=(0,)):
    """Truth and a run of one estimator with belief (x, P) over `true` (t, T, n, d)."""
    t, T, n, _ = true.shape
    hashes = tuple(f"hash{k}" for k in trial)
    truth = Truth("by-hand", np.array(trial), true, np.ones((t, T, n), bool) if valid is None else valid, ARENA, hashes)
    trace = Trace(x, P, np.full((t, n), 2.0 * T), np.full((t, n), 96.0 * T), seconds=0.6)
    return truth, Run("by-hand", 0, np.array(trial), hashes, {"mine": trace})


def constant_error(offset, T=8, P=None):
    true = np.zeros((1, T, 1, 2))
    return made(true + np.array(offset), np.broadcast_to(np.eye(2) if P is None else P, (1, T, 1, 2, 2)), true)


def test_a_constant_error_by_hand():
    row = errors(*constant_error([3.0, 4.0], P=np.diag([9.0, 16.0]))).iloc[0]
    assert list(row.index) == [*COLUMNS, *OPTIONAL_COLUMNS, SENSES]
    assert (row[["rmse", "mean_error", "median_error", "max_error", "final_error"]] == 5).all()
    assert row["mse"] == 25
    assert row["anees"] == pytest.approx(1.0)  # (9/9 + 16/16) / 2
    assert row["coverage95"] == 1.0
    assert row["diverged"] == 1.0  # 5 m > 8 m / 4
    assert (row["messages"], row["bytes"]) == (2.0, 96.0)
    assert row["seconds"] == pytest.approx(0.6 / 8)
    assert np.isnan(row["pose_nees"])


def test_anees_of_a_consistent_estimator_is_one_and_covers_95_percent():
    rng = np.random.default_rng(0)
    true = rng.normal(size=(1, 20000, 1, 2))
    P = np.array([[0.5, 0.2], [0.2, 0.3]])
    x = true + rng.multivariate_normal([0, 0], P, true.shape[:3])
    row = errors(*made(x, np.broadcast_to(P, (*true.shape, 2)), true)).iloc[0]
    assert row["anees"] == pytest.approx(1, abs=0.03)
    assert row["coverage95"] == pytest.approx(0.95, abs=0.006)
    assert [errors(*constant_error([e**0.5, 0]))["coverage95"].item() for e in (5.99, 6.0)] == [1.0, 0.0]


def test_ticks_without_truth_and_the_burn_in_do_not_count():
    truth, run = constant_error([0.0, 0.0], T=4)
    run.traces["mine"].x.flat[::2] = [100, 1, 50, 3]
    truth.valid[0, 2] = False
    row = errors(truth, run, burn_in=1).iloc[0]
    assert (row["ticks"], row["mse"], row["final_error"]) == (2, (1 + 9) / 2, 3)
    truth.valid[0, 2:] = [[True], [False]]
    assert errors(truth, run)["final_error"].item() == 50


def test_divergence_is_that_of_the_last_quarter():
    true = np.zeros((2, 8, 1, 2))
    x = true.copy()
    x[0, :6, 0, 0] = 7.0  # lost early, found late
    x[1, 6:, 0, 0] = 2.1  # above 8 m / 4 at the end
    rows = errors(*made(x, np.broadcast_to(np.eye(2), (2, 8, 1, 2, 2)), true, trial=(0, 1)))
    assert rows["diverged"].tolist() == [0.0, 1.0]


def test_pose_nees_wraps_the_heading():
    true = np.zeros((1, 1, 1, 3))
    true[..., 2] = np.pi - 0.05
    x = true.copy()
    x[..., 2] = -np.pi + 0.05
    row = errors(*made(x, np.broadcast_to(np.diag([1, 1, 0.01]), (1, 1, 1, 3, 3)), true)).iloc[0]
    assert row["pose_nees"] == pytest.approx(0.1**2 / 0.01 / 3)


def test_the_score_is_best_for_the_true_covariance():
    """Errors are Gaussian of variance 1; `scale` is the variance that the estimator states."""
    true = np.zeros((1, 20000, 1, 2))
    x = true + np.random.default_rng(1).normal(size=true.shape)
    found = {}
    for scale in (1.0, 0.1, 0.5, 2.0, 1000.0):
        row = errors(*made(x, np.broadcast_to(scale * np.eye(2), (*true.shape, 2)), true)).iloc[0]
        found[scale] = row["nll"]
        assert row["area95"] == pytest.approx(scale * np.pi * 5.991, rel=1e-3)
    best = found.pop(1.0)
    assert best == pytest.approx(np.log(2 * np.pi) + 1, abs=0.03)  # the entropy of the errors
    assert min(found.values()) > best + 0.1


@pytest.mark.parametrize("offset", [0.0, 1.0])
def test_a_singular_covariance_has_no_area_and_an_infinite_score_even_where_it_is_right(offset):
    row = errors(*constant_error([offset, 0], P=np.zeros((2, 2)))).iloc[0]
    assert (row["nll"], row["area95"]) == (np.inf, 0.0)


def test_an_estimator_that_is_not_built_in_is_marked_unchecked():
    class Mine:
        inner = cl.make("dead-reckoning")

        def __getattr__(self, name):
            return getattr(self.inner, name)

    truth, stream = cl.simulate("trajectory", trials=6, ticks=4)
    run = cl.run({"mine": Mine(), "dr": "dead-reckoning"}, stream, isolate=False)
    lines = cl.compare(errors(truth, run), baseline="dr").set_index("estimator")["certificate"]
    assert lines["mine"].startswith("unchecked: ")
    assert lines["dr"] == ""
    assert "certificate" not in errors(truth, cl.run("dead-reckoning", stream))


def test_the_curve_pools_to_the_table():
    truth, stream = cl.simulate("robots-1-3/n=3[ticks=6]", trials=6, seed=1)
    ran = truth, cl.run("ekf-local", stream)
    curve, table = over_time(*ran), cl.summarize(cl.errors(*ran))
    assert curve["tick"].tolist() == list(range(6))
    assert np.sqrt((curve["rmse"] ** 2).mean()) == pytest.approx(table["rmse"].item())
    assert curve["anees"].mean() == pytest.approx(table["anees"].item())
    assert (curve["rmse_low"] < curve["rmse"]).all()
    assert curve[["band_low", "band_high"]].iloc[0].tolist() == list(band(6, 2))
    pd.testing.assert_frame_equal(over_time(*ran, step=4), curve.iloc[::4].reset_index(drop=True))


def test_the_band_holds_95_percent_of_consistent_filters():
    rng = np.random.default_rng(0)
    anees = (rng.normal(size=(4000, 20, 2)) ** 2).sum(-1).mean(-1) / 2
    low, high = band(20, 2)
    assert np.mean((low < anees) & (anees < high)) == pytest.approx(0.95, abs=0.012)
    assert np.isnan(band(0, 2)).all()
