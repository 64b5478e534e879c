"""Trajectories as TUM files, which the evo command reads: `timestamp tx ty tz qx qy qz qw` in each line.

Source: the TUM RGB-D benchmark, J. Sturm et al., IROS 2012. Where no heading is estimated the quaternion is that of
heading 0, so compare translations only: `evo_ape tum truth.txt estimate.txt`, whose default that is.
"""

import re
from pathlib import Path

import numpy as np

from cooploc.analysis.metrics.errors import demand_same
from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.stream import Truth

TRUTH = "truth"  # the folder of true trajectories


def to_tum(truth: Truth, run: Run, folder: str | Path, time: Array | None = None) -> list[Path]:
    """Write one file for each trial, robot and estimator, and one of the truth for each trial and robot.

    They are called `ESTIMATOR/trial0-robot0.txt` and `truth/trial0-robot0.txt`; characters unfit for a file name become
    "_". Ticks without truth are left out of the truth's file; evo pairs by timestamps.

    Args:
        truth: of the same stream as the run.
        run: from `run`.
        folder: created if it does not exist.
        time: (T,) of the ticks [s], such as `stream.time`; without it their number, from 1.

    Returns:
        The files, the truth's first.

    Raises:
        BadInput: truth and run are swapped or of different streams, `time` is not one number a tick, or two
            estimators would write into the same folder.

    """
    demand_same(truth, run)
    stamps = np.arange(1.0, truth.x.shape[1] + 1) if time is None else np.asarray(time, float)
    if stamps.shape != truth.x.shape[1:2]:
        raise BadInput(f"time has shape {stamps.shape}; it must be ({truth.x.shape[1]},), one number a tick")
    names = {estimator: _name(estimator) for estimator in run.traces}
    if len({name.lower() for name in names.values()}) < len(names):
        raise BadInput(f"two of {', '.join(names)} would share a folder: rename one in cl.run")
    files = _team(Path(folder) / TRUTH, run, stamps, truth.x, truth.valid)
    for estimator, trace in run.traces.items():
        files += _team(Path(folder) / names[estimator], run, stamps, trace.x, np.ones_like(truth.valid))
    return files


def poses(stamps: Array, x: Array) -> Array:
    """TUM rows (T, 8) of poses x (T, 2 or 3): stamp [s], position [m], and heading as a quaternion about z."""
    half = x[:, 2] / 2 if x.shape[1] > 2 else np.zeros(len(x))
    zero = np.zeros(len(x))
    return np.column_stack([stamps, x[:, 0], x[:, 1], zero, zero, zero, np.sin(half), np.cos(half)])


def _team(folder: Path, run: Run, stamps: Array, x: Array, known: Mask) -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for i, trial in enumerate(run.trial):
        for robot in range(x.shape[2]):
            there = known[i, :, robot]
            path = folder / f"trial{trial}-robot{robot}.txt"
            np.savetxt(path, poses(stamps[there], x[i, there, robot]), fmt="%.9f")
            files.append(path)
    return files


def _name(estimator: str) -> str:
    """A folder's name for an estimator's label; one that is "truth", or only dots, gets a "_" behind it."""
    name = re.sub(r"[^\w.,=+\[\]-]", "_", estimator)
    return f"{name}_" if name.strip(".") == "" or name.lower() == TRUTH else name
