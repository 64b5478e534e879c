"""Trajectories that other programs computed, with their covariances: from a saved stream, or of any recording.

Those of a stream are judged as ours are. A file is called `trial0-robot2.txt`, or `robot2.txt` where the stream has one
trial: one of `trajectory_files`, with a pose for each tick at its end, as of `Stream.time` [s]. Where no heading is
estimated the quaternion is that of heading 0, so compare translations: `evo_ape tum truth.txt estimate.txt`. With
covariances, consistency (ANEES, coverage) is judged, too.

Those of a recording are judged against true ones in files, matched and aligned as `alignment` says. Errors are those of
evo (M. Grupp, github.com/MichaelGrupp/evo): RPE is that of the translation between neighbouring poses.
"""

import hashlib
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from cooploc.analysis.metrics.alignment import (
    ENOUGH,
    Matched,
    align_team,
    path_remarks,
    require_estimates,
    rotation,
)
from cooploc.analysis.metrics.errors import demand_same, errors
from cooploc.analysis.metrics.statistics import FIXED
from cooploc.analysis.metrics.trajectory_bags import TRUTH
from cooploc.analysis.metrics.trajectory_files import (
    COVARIANCE,
    Trajectory,
    read_files,
    team_files,
)
from cooploc.analysis.metrics.trajectory_runs import Place, match_runs
from cooploc.estimators import split_labels
from cooploc.estimators.errors import BadInput, shorten
from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.label_syntax import parse
from cooploc.estimators.models import wrap
from cooploc.scenarios import BUILTIN, simulate
from cooploc.scenarios.runner.run import Run, run
from cooploc.scenarios.runner.tick import EstimatorError
from cooploc.scenarios.runner.trace import Trace, require_covariances
from cooploc.scenarios.scenario import split_family
from cooploc.scenarios.stream import Stream, Truth

FILE = re.compile(r"(?:trial(\d+)-)?robot(\d+)")
LATE = 0.01  # of a tick: a stamp that is further from every tick is of another one
LOOKED_AT = 3  # trials whose paths are looked at for what is odd
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

    Warns:
        UserWarning: a path fits the truth far better in another frame, at other times, or beside another robot's.

    """
    made = read_run(stream, estimates, offline)
    rows = errors(truth, made, burn_in).assign(certificate=ELSEWHERE)
    if remarks := remarks_on(truth, made, stream.time):
        warnings.warn("\n".join(remarks), UserWarning, stacklevel=2)
    return rows


def read_run(stream: Stream, estimates: Estimates, offline: bool = False) -> Run:
    """Return trajectories of a stream as a run; refuse those that do not fit it."""
    traces: dict[str, Trace] = {}
    named = read_tum(estimates, stream) if isinstance(estimates, str | Path) else estimates
    for name, given in named.items():
        trace = given if isinstance(given, Trace) else _read_team(Path(given), stream)
        _require_fit(name, trace, stream)
        traces[name] = replace(trace, offline=True, centralised=True) if offline else trace
    return Run(stream.scenario, stream.seed, stream.trial, stream.hashes, traces)


def remarks_on(truth: Truth, run: Run, time: Array) -> tuple[str, ...]:
    """Return what is odd about the paths of a run's first trials; refuse other units, and the truth itself."""

    def team(x: Array, P: Array) -> dict[str, Trajectory]:
        """Return the poses of each robot in each of the trials where they are judged, as if all were one team."""
        found, d = {}, x.shape[-1]
        for (i, trial), robot in product(enumerate(run.trial[:LOOKED_AT]), range(x.shape[2])):
            known = truth.valid[i, :, robot]
            if known.sum() < ENOUGH:
                continue
            poses = np.full((known.sum(), 3), np.nan)
            poses[:, :d] = x[i, known, robot]
            name = f"{robot}, trial {trial}" if len(run.trial) > 1 else str(robot)
            found[name] = Trajectory(time[known], poses, P[i, known, robot])
        return found

    remarks: list[str] = []
    true = team(truth.x, np.full((*truth.x.shape[:3], 3, 3), np.nan))
    for name, trace in run.traces.items() if true else ():
        P = np.full((*trace.x.shape[:3], 3, 3), np.nan)
        P[..., : trace.P.shape[-1], : trace.P.shape[-1]] = trace.P
        mine = team(trace.x, P)
        require_estimates(name, mine, true)
        remarks += align_team(name, mine, {robot: one.x for robot, one in true.items()}, "", "world")[1]
        remarks += path_remarks(name, mine, true)
    return tuple(shorten(remarks))


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
) -> tuple[pd.DataFrame, Truth, Run, tuple[str, ...]]:
    """Return the rows of `judge`, those of our own `estimators` on the same stream first, the truth, all, remarks."""
    truth, stream = load_truth(source, **how)  # type: ignore[arg-type]
    made, mine = read_run(stream, estimates, offline), split_labels(estimators or "")
    rows, remarks = errors(truth, made).assign(certificate=ELSEWHERE), remarks_on(truth, made, stream.time)
    if same := set(mine) & set(made.traces):
        raise BadInput(f"{same.pop()!r} is an estimator of ours and a folder of trajectories: rename the folder")
    if mine:
        ours = run(mine, stream)
        rows = pd.concat([errors(truth, ours), rows], ignore_index=True).fillna({"certificate": ""})
        made = replace(made, traces={**ours.traces, **made.traces})
    return rows, truth, made, remarks


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
        raise BadInput(f"{folder}: trial{trial}-robot{robot}.txt {fact}: the stream has {has}")
    found, time = read_files({str(key): path for key, path in files.items()}), stream.time
    team = [found[str(key)] for key in wanted]
    for key, one in zip(wanted, team, strict=True):
        if len(one.stamp) != len(time):
            lines = f"{len(one.stamp)} lines, and the stream {len(time)} ticks"
            raise BadInput("; ".join([f"{files[key]} has {lines}: write one line for each", *one.notes]))
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


# ---- trajectories of any recording, against true ones in files


def judge_trajectories(
    truth: Place,
    estimates: Mapping[str, Place],
    align: str = "none",
    axes: str = "world",
    pieces: int = 1,
    largest_difference: float = 0.01,
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Return errors of trajectories of any program, a row for each robot and piece, and remarks on them.

    Only true poses count that every method has an estimate for, so that all are judged at the same times. Columns are
    those of `cl.errors`, with the robot's `name`, `rpe` [m] and `heading` [rad], root mean squares; a trial is a piece.
    Of several runs (`trajectory_runs` says which are) a trial is a run, whose name is in the column `run`.

    Args:
        truth: the folder, file or bag of true trajectories, or a table with the columns of such a file. Where
            no name of a column or topic says that it is true, "gnss=FILE" takes those with this word.
        estimates: by name, each a folder, file, bag or table; `trajectory_files` says what a team is.
        align: each robot's path to the truth by its first pose (`origin`) or by a rotation and a translation of least
            squares (`se2`), one for the whole `team`, or not at all (`none`).
        axes: in which covariances are stated: those of the `world`, or of the robot's `body`, x forward.
        pieces: into so many a single recording is cut, as trials from which intervals come; they are not independent.
        largest_difference: [s] between stamps that belong together.

    Raises:
        BadInput: a robot has no file, stamps do not meet, a path is mirrored, a covariance is none; says where.

    """
    if not isinstance(estimates, Mapping):
        raise BadInput(f'estimates is a {type(estimates).__name__}: name each, as in {{"mine": "DIR"}}')
    found, remarks = match_runs(truth, estimates, align, axes, largest_difference)
    return judge_matched(found, pieces)[0], remarks


def judge_matched(found: Mapping[str, Matched], pieces: int) -> tuple[pd.DataFrame, Truth, Run]:
    """Return the errors of runs, a trial each, or of the pieces of the only one; the truth and paths of the first."""
    cut = [(*in_pieces(one, pieces if len(found) == 1 else 1), list(one.paths)) for one in found.values()]
    rows = [judge_pieces(*one) for one in cut]
    if len(found) > 1:
        rows = [one.assign(trial=k, run=run) for k, (run, one) in enumerate(zip(found, rows, strict=True))]
    return pd.concat(rows, ignore_index=True), *cut[0][:2]


def over_runs(robots: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each method and robot of all runs: root mean squares, ANEES and coverage over all poses."""
    powers = {"rmse": 2, "rpe": 2, "heading": 2, "anees": 1, "coverage95": 1}
    found = []
    for (method, name), part in robots.groupby(["estimator", "name"], sort=False):
        means = {q: np.average(part[q] ** power, weights=part["ticks"]) ** (1 / power) for q, power in powers.items()}
        found.append({"estimator": method, "name": name, "ticks": part["ticks"].sum(), **means})
    return pd.DataFrame(found)


def mean_drift(rows: pd.DataFrame) -> pd.DataFrame:
    """Return RPE [m] and error of the heading [rad] of every method, root mean squares with intervals over pieces."""
    found = []
    for name, part in rows.groupby("estimator", sort=False):
        one: dict[str, object] = {"estimator": name}
        for column in ("rpe", "heading"):
            squares = part.assign(square=part[column] ** 2).groupby("trial")["square"].mean().to_numpy(float)
            ends = FIXED.mean_of_positive(squares) if np.isfinite(squares).all() else (np.nan,) * 3
            one |= dict(zip((column, f"{column}_low", f"{column}_high"), np.sqrt(ends), strict=True))
        found.append(one)
    return pd.DataFrame(found)


# ---- rows


def in_pieces(found: Matched, pieces: int) -> tuple[Truth, Run]:
    """Return trajectories as a truth and a run, whose trials are pieces of the recording; ticks beyond a path are nan.

    Raises:
        BadInput: too few poses for so many pieces, or some poses of a method have covariances and others none.

    """
    paths, short = found.paths, min(map(len, found.paths.values()))
    if short < 2:
        raise BadInput("a robot has 1 pose to judge, less than 2: see that the stamps are of one clock, in seconds")
    if pieces not in range(1, short // 2 + 1):
        raise BadInput(
            f"pieces is {pieces}; it must be a whole number from 1 to {short // 2}, as a robot has {short} poses"
        )
    pieces, n = int(pieces), len(paths)
    length = -(-max(map(len, paths.values())) // pieces)

    def cut(values: Iterable[Array], fill: float = np.nan) -> Array:
        """Return arrays of the robots (T, ...) as one (piece, tick, robot, ...)."""
        robots = [np.array_split(one, pieces) for one in values]
        out = np.full((pieces, length, n, *robots[0][0].shape[1:]), fill)
        for r, parts in enumerate(robots):
            for k, part in enumerate(parts):
                out[k, : len(part), r] = part
        return out

    def poses(team: Iterable[Array]) -> Array:
        """Return poses, without headings where one is not known."""
        robots = list(team)
        return cut([x[:, : 3 if all(np.isfinite(one[:, 2]).all() for one in robots) else 2] for x in robots])

    valid = cut([np.ones(len(path)) for path in paths.values()], 0.0) > 0
    every = np.concatenate([path[:, :2] for path in paths.values()])
    words = [f"{robot} {len(path)} {float(path[:, :2].sum()):.17g}" for robot, path in paths.items()]
    hashes = tuple(hashlib.sha256(f"{k} of {pieces} {words}".encode()).hexdigest() for k in range(pieces))
    arena, trial, traces = np.stack([every.min(0), every.max(0)]), np.arange(pieces), {}
    for name, team in found.teams.items():
        x, P = poses(team[robot].x for robot in paths), cut([team[robot].P for robot in paths])
        d = x.shape[-1]
        traces[name] = Trace.of(x, _without_gaps(name, P, valid, list(paths))[..., :d, :d])
    truth = Truth(found.label, trial, poses(paths.values()), valid, arena, hashes)
    return truth, Run(found.label, 0, trial, hashes, traces)


def _without_gaps(name: str, P: Array, valid: Mask, robots: Sequence[str]) -> Array:
    """Return covariances if every pose has one or none has; refuse those that are left out in part."""
    for d in (2, 3):
        known: Mask = np.asarray(np.isfinite(P[..., :d, :d]).all((3, 4)))
        lacking = (valid & ~known).sum((0, 1))
        if known[valid].any() and lacking.any():
            first = int(lacking.argmax())
            count = f"{lacking[first]} of {valid[..., first].sum()} poses of robot {robots[first]!r}"
            raise BadInput(f"{name}: {count} have no covariance: add them, or remove all")
    return P


def judge_pieces(truth: Truth, run: Run, names: Sequence[str]) -> pd.DataFrame:
    """Return `errors` with the robots' names and `drift`; pose NEES only where headings have covariances."""
    rows = errors(truth, run).assign(certificate=ELSEWHERE)
    rows["name"] = np.asarray(names)[rows["robot"]]
    for name, trace in run.traces.items():
        if trace.P.shape[-1] < 3 or np.isnan(trace.P[truth.valid]).any():
            rows.loc[rows["estimator"] == name, "pose_nees"] = np.nan
    return rows.merge(drift(truth, run))


def drift(truth: Truth, run: Run) -> pd.DataFrame:
    """Return `rpe` [m] and `heading` [rad], root mean squares of the errors, of every estimator, trial and robot.

    RPE is the error of the motion between neighbouring ticks, in the robot's axes; nan where there is no heading.
    """
    found = []
    for (name, trace), (i, trial), robot in product(run.traces.items(), enumerate(run.trial), range(truth.x.shape[2])):
        known = truth.valid[i, :, robot]
        a, b = trace.x[i, known, robot], truth.x[i, known, robot]
        rpe = heading = np.nan
        if min(a.shape[-1], b.shape[-1]) == 3 and len(a) > 1:
            steps = [np.einsum("tij,ti->tj", rotation(x[:-1, 2]), np.diff(x[:, :2], axis=0)) for x in (a, b)]
            rpe = float(np.sqrt(((steps[0] - steps[1]) ** 2).sum(1).mean()))
            heading = float(np.sqrt((wrap(a[:, 2] - b[:, 2]) ** 2).mean()))
        found.append((name, trial, robot, rpe, heading))
    return pd.DataFrame(found, columns=["estimator", "trial", "robot", "rpe", "heading"])
