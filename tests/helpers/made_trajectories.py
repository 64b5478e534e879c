"""Trajectories of two robots, as files and tables, and the errors of estimates of them."""

import numpy as np
import pandas as pd
import pytest

ROBOTS = "red", "blue"


def write_tum(path, t, x):
    half, zero = x[:, 2] / 2, np.zeros(len(t))
    columns = [t, x[:, 0], x[:, 1], zero, zero, zero, np.sin(half), np.cos(half)]
    np.savetxt(path, np.column_stack(columns), fmt="%.9f")


def true_path(r):
    t = np.arange(0, 60, 0.1)
    h = 0.1 * np.cumsum(0.3 * np.sin(0.2 * t + r) + 0.1)
    return t, np.column_stack([np.cumsum(np.cos(h)) * 0.05, np.cumsum(np.sin(h)) * 0.05, h])


def paths_of_all():
    """Poses (T, 3) of the truth and two methods, by robot, at stamps (T,)."""
    rng = np.random.default_rng(5)
    t, true = true_path(0)[0], {robot: true_path(r)[1] for r, robot in enumerate(ROBOTS)}
    noise = {"truth": 0.0, "mine": 0.1, "theirs": 0.2}
    return t, {
        name: {r: x + rng.normal(0, s, x.shape) * [1, 1, 0] for r, x in true.items()} for name, s in noise.items()
    }


def frame_of(t, x):
    return pd.DataFrame(np.column_stack([t, x]), columns=["t", "x", "y", "theta"])


def rmse_of(found):
    return {(row.estimator, row.name): row.rmse for row in found[["estimator", "name", "rmse"]].itertuples(index=False)}


def expected(paths):
    return {
        (method, robot): pytest.approx(np.sqrt(((x - paths["truth"][robot])[:, :2] ** 2).sum(1).mean()), rel=1e-5)
        for method in ("mine", "theirs")
        for robot, x in paths[method].items()
    }
