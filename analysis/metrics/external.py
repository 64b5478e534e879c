"""Trajectories that were computed elsewhere, read from TUM files and judged as ours are; ours, written as such files.

A file is called `trial0-robot2.txt`, or `robot2.txt` where the stream has one trial. Each line is
`timestamp tx ty tz qx qy qz qw`: the tick's end as of `Stream.time` [s], the position [m], and the heading as a
quaternion, whose yaw alone counts; one line for each tick, in order. The evo command reads such files; where no heading
is estimated the quaternion is that of heading 0, so compare translations: `evo_ape tum truth.txt estimate.txt`.

Beside it may lie `trial0-robot2.cov.txt`, the covariances of the same ticks, in the axes of the world: each line is
`timestamp xx xy yy` [m^2], the upper triangle, or in worlds with a heading h `timestamp xx xy xh yy yh hh` [m^2, m rad,
rad^2]. Then consistency (ANEES, coverage) is judged, too.

Source: the TUM RGB-D benchmark, J. Sturm et al., IROS 2012.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.errors import demand_same, errors
from cooploc.estimators import split_labels
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.estimators.registry import parse
from cooploc.scenarios import BUILTIN, simulate
from cooploc.scenarios.recordings.text_files import TextTable, read_table
from cooploc.scenarios.runner.run import Run, run
from cooploc.scenarios.runner.tick import EstimatorError
from cooploc.scenarios.runner.trace import Trace, require_covariances
from cooploc.scenarios.scenario import split_family
from cooploc.scenarios.stream import Stream, Truth

TRUTH = "truth"  # the folder of true trajectories
COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
COVARIANCES = {2: ("timestamp", "xx", "xy", "yy"), 3: ("timestamp", "xx", "xy", "xh", "yy", "yh", "hh")}  # by d
COVARIANCE = ".cov.txt"
FILE = re.compile(r"(?:trial(\d+)-)?robot(\d+)\.txt")
LATE = 0.01  # of a tick: a stamp that is further from every tick is of another one
UNIT = 0.01  # a quaternion's length may differ from 1 by so much
ELSEWHERE = "not checked: computed elsewhere"  # the certificate of each
Estimates = Mapping[str, Trace | str | Path] | str | Path  # by name, or a folder


def judge(truth: Truth, stream: Stream, estimates: Estimates, burn_in: int = 0, offline: bool = False) -> pd.DataFrame:
    """Return the errors, as of `cl.errors`, of trajectories computed elsewhere (C++, MATLAB, ROS) from a saved stream.

    Their `certificate` is "not checked: computed elsewhere". Where there are no covariances, consistency is not
    assessed, and they do not qualify as best; costs that are not known are nan. `pd.concat` joins them with the rows of
    `cl.run` on the same stream.

    Args:
        estimates: by name, each a `cl.Trace` or a folder of TUM files; or one folder that holds such files, or a folder
            of them for each name.
        burn_in: first ticks that do not count.
        offline: whether they were computed from the readings of all ticks at once, such as by a smoother.

    Raises:
        BadInput: truth and stream do not belong together, or a trajectory does not fit them; says where.

    """
    traces: dict[str, Trace] = {}
    named = read_tum(estimates, stream) if isinstance(estimates, str | Path) else estimates
    for name, given in named.items():
        trace = given if isinstance(given, Trace) else _read_team(Path(given), stream)
        _require_fit(name, trace, stream)
        traces[name] = replace(trace, offline=True, centralised=True) if offline else trace
    made = Run(stream.scenario, stream.seed, stream.trial, stream.hashes, traces)
    return errors(truth, made, burn_in).assign(certificate=ELSEWHERE)


def _require_fit(name: str, trace: Trace, stream: Stream) -> None:
    """Refuse a trace of another shape, with a pose that is not finite, or with what is not a covariance."""
    trials, ticks, robots = team = len(stream.trial), len(stream.time), stream.robots
    if trace.x.shape not in ((*team, 2), (*team, 3)):
        raise BadInput(
            f"{name}: poses have shape {trace.x.shape}, not (trial, tick, robot, 2 or 3), and this stream has {trials} "
            f"trials, {ticks} ticks, {robots} robots"
        )
    known = not np.isnan(trace.P).all()
    for what, array in (("pose", trace.x), ("covariance", trace.P))[: 1 + known]:
        for i, k, robot in np.argwhere(~np.isfinite(array).reshape(*team, -1).all(-1)):
            where = f"robot {robot} in trial {stream.trial[i]}, tick {k}"
            raise BadInput(f"{name}: the {what} of {where} is not finite; every tick needs one")
    if known:
        try:
            require_covariances(name, stream, trace.P)
        except EstimatorError as e:
            raise BadInput(f"{e}; leave P out where there is none") from None


# ---- the command `cooploc judge`


def evaluate_external(
    source: str, estimates: Estimates, estimators: str | None, offline: bool, **how: object
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the rows of `judge`, those of our own `estimators` on the same stream first, and their table."""
    truth, stream = load_truth(source, **how)  # type: ignore[arg-type]
    rows, mine = judge(truth, stream, estimates, offline=offline), split_labels(estimators or "")
    if same := set(mine) & set(rows["estimator"]):
        raise BadInput(f"{same.pop()!r} is an estimator of ours and a folder of trajectories: rename the folder")
    if mine:
        ours = errors(truth, run(mine, stream))
        rows = pd.concat([ours, rows], ignore_index=True).fillna({"certificate": ""})
    return rows, compare(rows, rows["estimator"].iloc[0], full=True)


def load_truth(
    source: str, trials: int | None = None, seed: int | None = None, data: str | Path | None = None
) -> tuple[Truth, Stream]:
    """Return the truth and the stream of a scenario, or of a file of `Stream.save`, whose truth is simulated again."""
    if not Path(source).is_file():
        if source.endswith(".npz"):
            raise BadInput(f"there is no file {source}; check its path, or name a scenario (cooploc list scenarios)")
        return simulate(source, trials=1 if trials is None else trials, seed=seed or 0, data=data)
    if trials is not None or seed is not None:
        raise BadInput(f"{source} is a file, which says its trials and its seed itself: leave --trials and --seed out")
    stream, remedy = Stream.load(source), "use cl.judge(truth, stream, ...)"
    if split_family(parse(stream.scenario)[0])[0] not in BUILTIN:  # its code does not run by the name in a file
        raise BadInput(f"{source} is of {stream.scenario!r}, which is not built in: {remedy}")
    truth, again = simulate(stream.scenario, trials=stream.trial.tolist(), seed=stream.seed, data=data)
    if again.hashes != stream.hashes:
        raise BadInput(
            f"{source} does not hold the readings of {stream.scenario!r}, seed {stream.seed}, as they are made here: "
            f"save the stream again, or {remedy}"
        )
    return truth, stream


# ---- TUM files


def read_tum(folder: str | Path, stream: Stream) -> dict[str, Trace]:
    """Read the trajectories of a folder by name: its own, or one for each of its folders, but for `truth`.

    Covariances are nan where no robot has a file of them; messages, bytes and seconds are not known, and nan.
    """
    folder = Path(folder)
    own = bool(_files(folder))
    others = () if own else sorted(folder.iterdir())
    found = [folder] * own + [one for one in others if one.is_dir() and one.name != TRUTH and _files(one)]
    if not found:
        raise BadInput(f"{folder} holds no trial0-robot0.txt or robot0.txt, and none of its folders does")
    return {one.resolve().name: _read_team(one, stream) for one in found}


def _files(folder: Path) -> dict[tuple[int | None, int], Path]:
    """Return TUM files by trial, None where a name has none, and robot."""
    if not folder.is_dir():
        raise BadInput(f"there is no folder {folder}; name the one that holds the TUM files")
    named = ((FILE.fullmatch(path.name), path) for path in sorted(folder.iterdir()))
    return {(None if m[1] is None else int(m[1]), int(m[2])): path for m, path in named if m}


def _read_team(folder: Path, stream: Stream) -> Trace:
    """Read poses and covariances of every trial, tick and robot."""
    files, trials = _files(folder), stream.trial.tolist()
    files = {(trials[0] if trial is None else trial, robot): path for (trial, robot), path in files.items()}
    wanted = list(product(trials, range(stream.robots)))
    for trial, robot in sorted(files.keys() ^ set(wanted)):
        fact = "is of no robot of the stream" if (trial, robot) in files else "is missing"
        has = f"robots 0 to {stream.robots - 1} in trials {trials[0]} to {trials[-1]}"
        raise BadInput(f"{folder}: trial{trial}-robot{robot}.txt {fact}, which has {has}")
    d = stream.prior.x.shape[-1]
    x, P = (
        np.stack([read(files[key], stream) for key in wanted])
        .reshape(len(trials), stream.robots, len(stream.time), *shape)
        .swapaxes(1, 2)
        for read, shape in ((_read_poses, (3,)), (_read_covariances, (d, d)))
    )
    unknown = np.isnan(P).all((1, 3, 4))
    for i, robot in np.argwhere(unknown) if not unknown.all() else ():
        name = f"trial{trials[i]}-robot{robot}{COVARIANCE}"
        raise BadInput(f"{folder}: {name} is missing, and others are there: add it, or remove them")
    return Trace.of(np.ascontiguousarray(x[..., :d]), np.ascontiguousarray(P))


def _read_ticks(path: Path, columns: tuple[str, ...], stream: Stream) -> TextTable:
    """Read a line for each tick; refuse stamps that are not those of the ticks, one line each."""
    table, time = read_table(path, columns, strict=True), stream.time
    stamps = table.values[:, 0]
    if len(stamps) != len(time):
        raise BadInput(f"{path} has {len(stamps)} lines, and the stream {len(time)} ticks: write one line for each")
    for row in np.flatnonzero(np.abs(stamps - time) > LATE * stream.world.tick).tolist():
        end = f"its stamp is {stamps[row]:.10g} s, and tick {row} ends at {time[row]:.10g} s"
        raise BadInput(f"{table.at(row)}: {end}: write the stamps of stream.time")
    return table


def _read_covariances(pose: Path, stream: Stream) -> Array:
    """Read the covariances (T, d, d) beside a file of poses; nan where there is no file."""
    path, d = pose.with_name(pose.name.removesuffix(".txt") + COVARIANCE), stream.prior.x.shape[-1]
    P, (row, column) = np.full((len(stream.time), d, d), np.nan), np.triu_indices(d)
    if path.exists():
        P[:, row, column] = P[:, column, row] = _read_ticks(path, COVARIANCES[d], stream).values[:, 1:]
    return P


def _read_poses(path: Path, stream: Stream) -> Array:
    """Read positions [m] and headings [rad] (T, 3)."""
    table = _read_ticks(path, COLUMNS, stream)
    q = table.values[:, 4:]
    for row in np.flatnonzero(np.abs(np.linalg.norm(q, axis=1) - 1) > UNIT).tolist():
        raise BadInput(f"{table.at(row)}: qx qy qz qw is not a unit quaternion; heading 0 is 0 0 0 1")
    x, y, z, w = q.T
    return np.column_stack([table.values[:, 1:3], np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))])


def to_tum(truth: Truth, run: Run, folder: str | Path, time: Array | None = None) -> list[Path]:
    """Write `ESTIMATOR/trial0-robot0.txt` for each trial, robot and estimator, and `truth/trial0-robot0.txt`.

    Beside an estimator's file stands one of its covariances, `trial0-robot0.cov.txt`.

    Characters unfit for a file name become "_". Ticks without truth are left out of the truth's file. `time` (T,) is
    that of the ticks [s], such as `stream.time`; without it their number, from 1. Return the files, the truth's first.

    """
    demand_same(truth, run)
    stamps = np.arange(1.0, truth.x.shape[1] + 1) if time is None else np.asarray(time, float)
    if stamps.shape != truth.x.shape[1:2]:
        raise BadInput(f"time has shape {stamps.shape}; it must be ({truth.x.shape[1]},), one number a tick")
    names = {estimator: re.sub(r"[^\w.,=+\[\]-]", "_", estimator) for estimator in run.traces}
    for estimator, name in names.items():
        if name.strip(".") == "" or name.lower() == TRUTH:  # no folder of its own
            names[estimator] = f"{name}_"
    if len({name.lower() for name in names.values()}) < len(names):
        raise BadInput(f"two of {', '.join(names)} would share a folder: rename one in cl.run")
    none = np.full((*truth.x.shape, truth.x.shape[-1]), np.nan)
    teams = [(TRUTH, truth.x, none, truth.valid)]
    teams += [(names[each], trace.x, trace.P, np.ones_like(truth.valid)) for each, trace in run.traces.items()]
    files = []
    for name, x, P, known in teams:
        (Path(folder) / name).mkdir(parents=True, exist_ok=True)
        for (i, trial), robot in product(enumerate(run.trial), range(x.shape[2])):
            there = known[i, :, robot]
            pose = x[i, there, robot]
            half, zero = (pose[:, 2] / 2 if x.shape[-1] > 2 else np.zeros(len(pose))), np.zeros(len(pose))
            columns = stamps[there], pose[:, 0], pose[:, 1], zero, zero, zero, np.sin(half), np.cos(half)
            files.append(Path(folder) / name / f"trial{trial}-robot{robot}.txt")
            np.savetxt(files[-1], np.column_stack(columns), fmt="%.9f")
            if np.isfinite(P[i, :, robot]).all():
                triangle = P[i, :, robot][(slice(None), *np.triu_indices(P.shape[-1]))]
                beside = files[-1].with_name(files[-1].stem + COVARIANCE)
                np.savetxt(beside, np.column_stack([stamps, triangle]), fmt=["%.9f", *["%.17g"] * triangle.shape[1]])
    return files
