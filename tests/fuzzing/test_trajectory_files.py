"""Files of trajectories that came to harm: judged, perhaps with a note, or refused in one line."""

import shutil

import numpy as np
import pandas as pd
import pytest
from attempts import attempted, cases
from damage import HARM, harm_file
from hypothesis import given
from hypothesis import strategies as st

import cooploc as cl
from cooploc.estimators.errors import BadInput

T = np.arange(40)
PATH = np.column_stack([0.1 * T, np.sin(0.1 * T), 0 * T])
ZERO, ONE = 0.0 * T, 1.0 + 0 * T


def write_all(folder, x):
    """A path as TUM, as KITTI, and as CSV with covariances and a column of methods."""
    np.savetxt(folder / "tum.txt", np.column_stack([T, x, ZERO, ZERO, ZERO, ONE]), fmt="%.6f")
    rows = [ONE, ZERO, ZERO, x[:, 0], ZERO, ONE, ZERO, x[:, 1], ZERO, ZERO, ONE, ZERO]
    np.savetxt(folder / "kitti.txt", np.column_stack(rows), fmt="%.6f")
    table = pd.DataFrame({"t": T, "x": x[:, 0], "y": x[:, 1], "theta": ZERO, "sigma_x": 0.1, "sigma_y": 0.1})
    both = [table.assign(robot=robot, method=method) for robot in ("red", "blue") for method in ("truth", "mine")]
    pd.concat(both).to_csv(folder / "all.csv", index=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("trajectories")


@cases(100)
@given(st.sampled_from(["tum.txt", "kitti.txt", "all.csv"]), HARM)
def test_a_harmed_file_is_judged_or_one_line(folder, name, harm):
    for place, spread in (("truth", 0.0), ("mine", 0.1)):
        shutil.rmtree(folder / place, ignore_errors=True)
        (folder / place).mkdir()
        write_all(folder / place, PATH + spread)
    harm_file(folder / "mine" / name, harm)
    found = attempted(cl.judge_trajectories, folder / "truth" / name, {"mine": folder / "mine" / name}, align="se2")
    if isinstance(found, BadInput):
        assert "\n" not in str(found)
    else:
        assert np.isfinite(found[0]["rmse"]).all()
