"""Trajectories that were computed elsewhere from a saved stream, judged as ours are.

A file is called `trial0-robot2.txt`, or `robot2.txt` where the stream has one trial: one of `trajectory_files`, with a
pose for each tick at its end, as of `Stream.time` [s]. Where no heading is estimated the quaternion is that of heading
0, so compare translations: `evo_ape tum truth.txt estimate.txt`. With covariances, consistency (ANEES, coverage) is
judged, too.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from cooploc.analysis.metrics.errors import errors
from cooploc.analysis.metrics.trajectory_files import COVARIANCE, TRUTH, read_files, team_files
from cooploc.estimators import split_labels
from cooploc.estimators.errors import BadInput
from cooploc.estimators.registry import parse
from cooploc.scenarios import BUILTIN, simulate
from cooploc.scenarios.runner.run import Run, run
from cooploc.scenarios.runner.tick import EstimatorError
from cooploc.scenarios.runner.trace import Trace, require_covariances
from cooploc.scenarios.scenario import split_family
from cooploc.scenarios.stream import Stream, Truth

FILE = re.compile(r"(?:trial(\d+)-)?robot(\d+)")
LATE = 0.01  # of a tick: a stamp that is further from every tick is of another one
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
    made = read_run(stream, estimates, offline)
    return errors(truth, made, burn_in).assign(certificate=ELSEWHERE)


def read_run(stream: Stream, estimates: Estimates, offline: bool = False) -> Run:
    """Return trajectories of a stream as a run; refuse those that do not fit it."""
    traces: dict[str, Trace] = {}
    named = read_tum(estimates, stream) if isinstance(estimates, str | Path) else estimates
    for name, given in named.items():
        trace = given if isinstance(given, Trace) else _read_team(Path(given), stream)
        _require_fit(name, trace, stream)
        traces[name] = replace(trace, offline=True, centralised=True) if offline else trace
    return Run(stream.scenario, stream.seed, stream.trial, stream.hashes, traces)


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
) -> tuple[pd.DataFrame, Truth, Run]:
    """Return the rows of `judge`, those of our own `estimators` on the same stream first, with the truth and all."""
    truth, stream = load_truth(source, **how)  # type: ignore[arg-type]
    made, mine = read_run(stream, estimates, offline), split_labels(estimators or "")
    rows = errors(truth, made).assign(certificate=ELSEWHERE)
    if same := set(mine) & set(made.traces):
        raise BadInput(f"{same.pop()!r} is an estimator of ours and a folder of trajectories: rename the folder")
    if mine:
        ours = run(mine, stream)
        rows = pd.concat([errors(truth, ours), rows], ignore_index=True).fillna({"certificate": ""})
        made = replace(made, traces={**ours.traces, **made.traces})
    return rows, truth, made


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


# ---- files


def read_tum(folder: str | Path, stream: Stream) -> dict[str, Trace]:
    """Read the trajectories of a folder by name: its own, or one for each of its folders, but for `truth`.

    Covariances are nan where no robot has a file of them; messages, bytes and seconds are not known, and nan.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise BadInput(f"there is no folder {folder}; name the one that holds the TUM files")
    own = bool(_files(folder))
    others = () if own else sorted(folder.iterdir())
    found = [folder] * own + [one for one in others if one.is_dir() and one.name != TRUTH and _files(one)]
    if not found:
        raise BadInput(f"{folder} holds no trial0-robot0.txt or robot0.txt, and none of its folders does")
    return {one.resolve().name: _read_team(one, stream) for one in found}


def _files(folder: Path) -> dict[tuple[int | None, int], Path]:
    """Return files by trial, None where a name has none, and robot."""
    named = ((FILE.fullmatch(name), path) for name, path in team_files(folder).items())
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
    found, time = read_files({path.stem: path for path in files.values()}), stream.time
    team = [found[files[key].stem] for key in wanted]
    for key, one in zip(wanted, team, strict=True):
        if len(one.stamp) != len(time):
            lines = f"{len(one.stamp)} lines, and the stream {len(time)} ticks"
            raise BadInput(f"{files[key]} has {lines}: write one line for each")
        for k in np.flatnonzero(np.abs(one.stamp - time) > LATE * stream.world.tick).tolist():
            end = f"the stamp of tick {k} is {one.stamp[k]:.10g} s, and it ends at {time[k]:.10g} s"
            raise BadInput(f"{files[key]}: {end}: write the stamps of stream.time")
    d, shape = stream.prior.x.shape[-1], (len(trials), stream.robots, len(time))
    x, P = (np.stack(each).reshape(*shape, *each[0].shape[1:]).swapaxes(1, 2) for each in
            ([one.x[:, :d] for one in team], [one.P[:, :d, :d] for one in team]))  # fmt: skip
    unknown = np.isnan(P).all((1, 3, 4))
    for i, robot in np.argwhere(unknown) if not unknown.all() else ():
        name = files[trials[i], int(robot)].stem + COVARIANCE
        raise BadInput(f"{folder}: {name} is missing, and others are there: add it, or remove them")
    return Trace.of(np.ascontiguousarray(x), np.ascontiguousarray(P))
