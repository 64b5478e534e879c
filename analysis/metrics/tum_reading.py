"""Trajectories that were computed elsewhere, read from TUM files: one for each robot, and trial where there are many.

A file is called `trial0-robot2.txt`, or `robot2.txt` where the stream has one trial; robots and trials are numbered as
in the stream, from 0. Each line is `timestamp tx ty tz qx qy qz qw`: the tick's end as of `Stream.time` [s], the
position [m], and the heading as a quaternion, whose yaw alone counts. There is one line for each tick, in order.
"""

import re
from pathlib import Path

import numpy as np

from cooploc.analysis.metrics.tum import TRUTH
from cooploc.estimators.interface import Array
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.recordings.text_tables import Table, read_table
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.stream import Stream

COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
FILE = re.compile(r"(?:trial(\d+)-)?robot(\d+)\.txt")
LATE = 0.01  # of a tick: a stamp that is further from every tick is of another one
UNIT = 0.01  # a quaternion's length may differ from 1 by so much


def from_tum(folder: str | Path, stream: Stream) -> dict[str, Trace]:
    """The trajectories of a folder by name: its own, or one for each of its folders, but for `truth`.

    Positions come without covariances, and messages, bytes and seconds are not known: all these are nan.

    Raises:
        BadInput: there are none, a robot is missing, a stamp matches no tick, or a line is not eight finite numbers.

    """
    folder = Path(folder)
    if not folder.is_dir():
        raise BadInput(f"there is no folder {folder}; name the one that holds the TUM files")
    inside = sorted(one for one in folder.iterdir() if one.is_dir() and one.name != TRUTH and _files(one))
    found = [folder] if _files(folder) else inside
    if not found:
        raise BadInput(f"{folder} holds no trial0-robot0.txt or robot0.txt, and none of its folders does")
    return {one.resolve().name: Trace.of(_team(one, stream)) for one in found}


def _files(folder: Path) -> dict[tuple[int | None, int], Path]:
    """TUM files by trial, None where a name has none, and robot."""
    named = ((FILE.fullmatch(path.name), path) for path in sorted(folder.iterdir()))
    return {(None if m[1] is None else int(m[1]), int(m[2])): path for m, path in named if m}


def _team(folder: Path, stream: Stream) -> Array:
    """Poses (t, T, n, 2 or 3) of every trial, tick and robot."""
    files, d = _files(folder), stream.prior.x.shape[-1]
    trials = [int(k) for k in stream.trial]
    if len(trials) == 1:
        files = {(trials[0] if trial is None else trial, robot): path for (trial, robot), path in files.items()}
    wanted = [(trial, robot) for trial in trials for robot in range(stream.robots)]
    for extra in [key for key in files if key not in wanted]:
        raise BadInput(f"{files[extra]} is of no trial and robot of the stream, which has {_numbers(stream)}")
    for trial, robot in wanted:
        if (trial, robot) not in files:
            raise BadInput(f"{folder} has no trial{trial}-robot{robot}.txt; the stream has {_numbers(stream)}")
    poses = [_poses(files[key], stream) for key in wanted]
    stacked = np.stack(poses).reshape(len(trials), stream.robots, len(stream.time), 3)
    return np.ascontiguousarray(stacked.swapaxes(1, 2)[..., :d])


def _numbers(stream: Stream) -> str:
    robots = "robot 0" if stream.robots == 1 else f"robots 0 to {stream.robots - 1}"
    trials = [int(k) for k in stream.trial]
    return f"{robots} in trial {trials[0]}" + f" to {trials[-1]}" * (len(trials) > 1)


def _poses(path: Path, stream: Stream) -> Array:
    """Positions [m] and headings [rad] (T, 3)."""
    table = read_table(path, COLUMNS)
    _demand_ticks(table, stream)
    x, y, z, w = table.values[:, 4:].T
    skewed = np.abs(np.linalg.norm(table.values[:, 4:], axis=1) - 1) > UNIT
    if skewed.any():
        row = int(np.argmax(skewed))
        raise BadInput(f"{table.at(row)}: qx qy qz qw is not a unit quaternion; heading 0 is 0 0 0 1")
    return np.column_stack([table.values[:, 1:3], np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))])


def _demand_ticks(table: Table, stream: Stream) -> None:
    """Refuse stamps that are not those of the ticks, one line each."""
    stamps, time = table.values[:, 0], stream.time
    short = min(len(stamps), len(time))
    apart = np.abs(stamps[:short] - time[:short]) > LATE * stream.world.tick
    if apart.any():
        row = int(np.argmax(apart))
        raise BadInput(
            f"{table.at(row)}: its stamp is {stamps[row]:.10g} s, and tick {row} ends at {time[row]:.10g} s: write one "
            "line for each tick, with the stamps of stream.time"
        )
    if len(stamps) != len(time):
        raise BadInput(
            f"{table.path} has {len(stamps)} lines, and the stream {len(time)} ticks: write one line for each tick"
        )
