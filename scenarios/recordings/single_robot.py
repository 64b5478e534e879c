"""Real runs of one robot as a scenario: each run is a CSV file whose lines are its ticks.

A directory holds the files, and a description (`schema.RobotDescription`) states what their columns mean. `log/RUN` is
one run; `log/all` has a trial for each run, so intervals are over runs. The models of a run are fitted on the *other*
runs: each run has a world of its own, so a stream holds one run. The WiFi recordings of Latif & Parasuraman, `wifi/RUN`
and `wifi/all`, are such a directory with a shipped description.

What was not recorded becomes nan and is counted: readings that mean "missing", truth that repeats a stale position or
jumps, commands across a gap.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel

from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Mask, Motion, Senses, Sensor, World
from cooploc.estimators.models import Displacement, LogDistance, Unicycle, wrap
from cooploc.scenarios.recordings.fit import (
    Stated,
    Track,
    fit_displacement,
    fit_log_distance,
    fit_wheel_odometry,
    log_distance,
)
from cooploc.scenarios.recordings.prior import prior
from cooploc.scenarios.recordings.schema import COLUMNS, NAME, RobotDescription, RobotModel, RobotPrior, load_robot
from cooploc.scenarios.recordings.team_log import unreachable
from cooploc.scenarios.recordings.text_files import Table, count_of, read_lines, time_order
from cooploc.scenarios.stream import Air, Stream, Truth
from cooploc.scenarios.worlds.radio import Positive

ALL = "all"  # in the place of a run's name
GAP = 5.0  # [median intervals] a longer interval is a gap, unless the description gives max_gap
SHARED = 3  # equal lines: two files with this many in common are never fitted on each other

# ---- Reading a run


class RobotRun(NamedTuple):
    """One run. Row 0 is before the first tick; tick k leads from row k to row k + 1."""

    path: Path
    stamp: Array  # (T + 1,)     as in the file [s]
    track: Track  # time since row 0, to the nanosecond [s], odometry and truth; not to be fitted on across gaps
    rssi: Array  # (T + 1, a)   [dBm]
    rows: Array  # (T + 1, c)   as in the file, to find lines that two files share
    counts: dict[str, Any]  # what was dropped

    @property
    def tick(self) -> float:
        """The median length of a tick [s]."""
        return float(np.median(self.track.dt))

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self.path.stem

    def shared_lines(self, other: "RobotRun") -> int:
        """Return how many lines two runs have in common, digit by digit."""
        _, i, j = np.intersect1d(self.stamp, other.stamp, return_indices=True)
        a, b = self.rows[i], other.rows[j]
        return int(((a == b) | (np.isnan(a) & np.isnan(b))).all(-1).sum())


def read_run(path: Path, description: RobotDescription) -> RobotRun:
    """Read one run from its CSV file.

    Raises:
        BadInput: a column is missing, or too few lines can be read; names file and line.

    """
    d = description
    groups = {
        "time": d.time.columns,
        "odometry": tuple(getattr(d.odometry, name) for name in COLUMNS[d.odometry.kind]),
        "truth": tuple(c for c in (d.truth.x, d.truth.y, d.truth.heading) if c),
        "rssi": d.anchors.rssi if d.anchors else (),
        "status": d.anchors.status if d.anchors else (),
    }
    columns = [column for group in groups.values() for column in group]
    lines, before = _from_first_truth(read_lines(path, [c.column for c in columns], (), d.delimiter), groups)
    factor = np.array([column.factor for column in columns])
    lines, time = _rising(lines, factor[: len(groups["time"])])
    raw = lines.values
    ends = np.cumsum([len(group) for group in groups.values()])[:-1]
    stamps, moves, poses, rssi, _ = np.split(raw * factor, ends, axis=1)
    truth, lost = _truth(d, time, poses)
    rssi, missing = _rssi(d, rssi, raw[:, ends[3] :])
    odometry, known = _odometry(d, time, moves)
    counts = {
        "before_first_truth": before,
        **lost,
        "rssi_missing": missing,
        "odometry_missing": int((np.isnan(odometry).any(-1) & known).sum()),
        "gaps": [
            {"line": int(lines.line[k + 1]), "seconds": round(float(time[k + 1] - time[k]), 3)}
            for k in np.flatnonzero(~known)
        ],
        "warnings": list(lines.notes),
    }
    return RobotRun(path, stamps.sum(-1), Track(time, odometry, known, truth), rssi, raw, counts)


def _from_first_truth(lines: Table, groups: dict[str, tuple[Any, ...]]) -> tuple[Table, int]:
    """Return the lines from the first one on whose truth is known, and how many were before it."""
    if len(lines.line) < 2:
        raise BadInput(
            f"{lines.path}: it has {len(lines.line)} lines of data, at least two are needed; get the file again"
        )
    begin = len(groups["time"]) + len(groups["odometry"])
    there: Mask = np.asarray(np.isfinite(lines.values[:, begin : begin + len(groups["truth"])]).all(-1))
    first = int(np.argmax(there))
    if there[first:].sum() < 2:
        raise BadInput(f"{lines.path}: fewer than two lines have a truth; check the columns named in [truth]")
    return lines._replace(values=lines.values[first:], line=lines.line[first:]), first


def _rising(lines: Table, factor: Array) -> tuple[Table, Array]:
    """Return the lines whose stamps rise, with a sentence on the others, and seconds since the first (m,).

    Columns of a stamp are subtracted before they are summed, which keeps the nanoseconds.
    """
    stamped: Mask = np.asarray(np.isfinite(lines.values[:, : len(factor)]).all(-1))
    rows = np.flatnonzero(stamped)
    stamps = lines.values[rows, : len(factor)]
    time: Array = ((stamps - stamps[:1]) * factor).sum(-1)
    order, notes = time_order(time)
    rising = np.append(True, np.diff(time[order]) > 0)[: len(order)]
    repeats, order = int((~rising).sum()), order[rising]
    rows, time = rows[order], time[order]
    reasons = {"is missing": int((~stamped).sum()), "was given before": repeats}
    left_out = [f"{lines.path}: left out {count_of(n, 'line')} whose stamp {why}" for why, n in reasons.items() if n]
    notes = (*lines.notes, *left_out, *(f"{lines.path}: {note}" for note in notes))
    return lines._replace(values=lines.values[rows], line=lines.line[rows], notes=notes), time - time[:1]


def _odometry(description: RobotDescription, time: Array, values: Array) -> tuple[Array, Mask]:
    """Odometry (T, 2) between the lines, and where it is known.

    Across a gap a speed or a turn rate is unknown (nan), as it may have changed; a counter still gives the distance.
    """
    dt = np.diff(time)
    known: Mask = dt <= (description.time.max_gap or GAP * np.median(dt))
    if description.odometry.kind == "displacement":
        return values[1:], known
    held = values[:-1] if description.odometry.holds == "until the next line" else values[1:]
    u = np.where(known[:, None], held, np.nan)
    if description.odometry.kind == "path":
        u[:, 0] = np.diff(values[:, 0]) / dt
    return u, known


def _rssi(description: RobotDescription, rssi: Array, status: Array) -> tuple[Array, list[int]]:
    """Readings with nan where they are missing, and how many are, by anchor."""
    if description.anchors is None:
        return rssi, []
    missing = np.isnan(rssi) | (rssi >= description.anchors.missing_from)
    if status.shape[1]:
        missing |= ~(np.nan_to_num(status) != 0)
    return np.where(missing, np.nan, rssi), missing.sum(0).tolist()


def _truth(description: RobotDescription, time: Array, values: Array) -> tuple[Array, dict[str, Any]]:
    """True poses (T + 1, 3), nan where they are not valid, and how many are not, by reason."""
    absent = np.isnan(values).any(-1)
    stale = np.zeros(len(time), bool)
    if description.truth.repeats == "stale":
        stale[1:] = (np.diff(values[:, :2], axis=0) == 0).all(-1)
    use = ~absent & ~stale
    jumped = unreachable(time, np.where(use[:, None], values[:, :2], np.nan), description.truth.max_speed or np.inf)
    heading = values[:, 2:] if values.shape[1] > 2 else np.full((len(time), 1), np.nan)
    poses = np.where((use & ~jumped)[:, None], np.concatenate([values[:, :2], heading], -1), np.nan)
    reasons = {"absent": absent, "stale": stale & ~absent, "jumps": jumped}
    return poses, {f"truth_{reason}": int(mask.sum()) for reason, mask in reasons.items()}


# ---- A directory of runs: those that are different, and those on which a run's models may be fitted


@dataclass(frozen=True)
class RobotFolder:
    """A directory of runs with its description."""

    data: Path
    source: Any  # the path of the description
    description: RobotDescription
    runs: dict[str, RobotRun]  # by name, sorted

    @property
    def anchors(self) -> Array:
        """Positions of the anchors (a, 2) [m]."""
        return np.array(self.description.anchors.positions if self.description.anchors else (), float).reshape(-1, 2)

    @property
    def arena(self) -> Array:
        """Lower left and upper right corner (2, 2) [m]."""
        corners = np.array(self.description.arena, float) if self.description.arena else self.anchors
        return np.stack([corners.min(0), corners.max(0)])

    @cached_property
    def different(self) -> list[str]:
        """Names of the runs without parts of others: another run has every line; of two equal runs the first stays."""
        return [name for name in self.runs if not any(self._is_part(name, other) for other in self.runs)]

    def others(self, name: str, same_set_up: bool) -> list[RobotRun]:
        """Return the runs on which this one's models may be fitted: none shares lines with it or is there twice."""
        mine = set_up(name, self.description.set_ups)
        return [
            self.runs[other]
            for other in self.different
            if other != name
            and (set_up(other, self.description.set_ups) == mine or not same_set_up)
            and self.runs[other].shared_lines(self.runs[name]) < SHARED
        ]

    def _is_part(self, name: str, other: str) -> bool:
        a, b = self.runs[name], self.runs[other]
        return (len(b.rows), name) > (len(a.rows), other) and b.shared_lines(a) == len(a.rows)


def set_up(name: str, patterns: Sequence[str]) -> str:
    """Return the first pattern that a run's name matches; a run that matches none is a set-up of its own."""
    return next((pattern for pattern in patterns if fnmatchcase(name, pattern)), f"only {name}")


def shipped_description(name: str) -> Any:
    """Return the path of a description that comes with cooploc."""
    return files(__package__) / f"{name}.{NAME}"


def read_folder(data: Path, described: str = "") -> RobotFolder:
    """Read every run in a directory, as `log.toml` there describes it, or the shipped description named `described`.

    Raises:
        BadInput: there is no directory, no description or no run, or one of them is malformed.

    """
    if not data.is_dir():
        raise BadInput(f"{data}: there is no such directory; name the one that holds the runs' CSV files")
    source = shipped_description(described) if described else data / NAME
    description = load_robot(source)
    found = [path for path in data.iterdir() if fnmatchcase(path.name, description.files) and path != source]
    paths = sorted(found, key=lambda path: path.stem)
    if not paths:
        raise BadInput(
            f"{data}: no file there matches {description.files!r}; put the runs there, or correct `files` in {source}"
        )
    for before, path in zip([Path(f"{ALL}.csv"), *paths], paths, strict=False):
        if path.stem in (ALL, before.stem):
            raise BadInput(f"{path}: a run cannot be named {path.stem!r}, the name is taken; rename the file")
    return RobotFolder(data, source, description, {path.stem: read_run(path, description) for path in paths})


# ---- The models of a run, stated or fitted on the other runs


class RobotModels(NamedTuple):
    """Models of one run, and where they come from."""

    motion: Motion
    sensors: dict[str, Sensor]
    scales: Array  # (2,)  factors of the odometry
    notes: dict[str, Any]


def robot_models(
    folder: RobotFolder, run: RobotRun, others: Sequence[RobotRun], stated: Stated, inflate: bool, robust: bool
) -> RobotModels:
    """Return the models of a run.

    Args:
        folder: the directory of runs.
        run: the run that is simulated.
        others: the runs to fit on.
        stated: values by name that are not fitted; None: fitted.
        inflate: whether sigma of RSSI accounts for its correlation in time.
        robust: whether Huber's loss is minimised, so that one bad run counts little.

    Raises:
        BadInput: a value is not stated, and the other runs do not suffice to fit it.

    """
    tracks, scales = [other.track for other in others], (stated["length_scale"], stated["turn_scale"])
    if folder.description.odometry.kind == "displacement":
        scale, sigma = scales[0] or 1.0, stated["sigma_move"]
        values = {"length_scale": scale, "sigma_move": sigma or fit_displacement(tracks, run.tick, scale, robust)}
    else:
        fitted = fit_wheel_odometry(tracks, run.tick, *scales, robust)._asdict()
        values = fitted | {name: value for name in fitted if (value := stated[name]) is not None}
    if len(folder.anchors):
        values |= _path_loss(folder, run, others, stated, inflate, robust)
    lacking = [name for name, value in values.items() if not np.isfinite(value)]
    if lacking:
        raise BadInput(
            f"{folder.data}: run {run.name!r} has {len(others)} other runs of its set-up, too few to fit "
            f"{', '.join(lacking)}: give them as parameters, or in [model] of {folder.source}"
        )
    sensors: dict[str, Sensor] = {}
    if len(folder.anchors):
        sensors["anchor_rssi"] = LogDistance(values["A"], values["eta"], values["sigma"])
    moves = (
        Displacement(values["sigma_move"], run.tick)
        if "sigma_move" in values
        else Unicycle(values["sigma_v"], values["sigma_omega"], run.tick)
    )
    factors = np.array([values["length_scale"], values.get("turn_scale", values["length_scale"])])
    return RobotModels(moves, sensors, factors, {"fitted_on": [other.name for other in others], **values})


def _path_loss(
    folder: RobotFolder, run: RobotRun, others: Sequence[RobotRun], stated: Stated, inflate: bool, robust: bool
) -> dict[str, float]:
    """Path loss. As filters assume independent readings, sigma is inflated by sqrt((1 + r) / (1 - r)).

    r is the lag-1 correlation of the residuals: the mean of many readings then has the spread that a filter computes.
    """
    A, eta, sd, lag1 = fit_path_loss_of_runs(others, folder.anchors, stated["A"], stated["eta"], robust)
    if eta <= 0:
        raise BadInput(
            f"{folder.data}: RSSI does not fall with distance in the runs on which {run.name!r} is fitted "
            f"(eta = {eta:.3g}); check that [anchors] positions and rssi are in the same order, or state eta"
        )
    r = np.clip(lag1, 0.0, 0.99) if inflate else 0.0
    sigma = sd * np.sqrt((1 + r) / (1 - r)) if stated["sigma"] is None else stated["sigma"]
    known = {"A": A, "eta": eta, "sigma": float(sigma)}
    return known | ({"residual_sd": sd, "residual_lag1": lag1} if np.isfinite(sd) else {})


def fit_path_loss_of_runs(
    runs: Sequence[RobotRun], anchors: Array, A: float | None, eta: float | None, robust: bool
) -> tuple[float, float, float, float]:
    """Return A [dBm], eta, and the standard deviation [dB] and lag-1 correlation of the residuals; nan with few."""
    logs = [log_distance(np.hypot(*np.moveaxis(run.track.truth[:, None, :2] - anchors, -1, 0))) for run in runs]
    L, z = (np.concatenate([np.empty((0, len(anchors))), *part]) for part in (logs, [run.rssi for run in runs]))
    there = np.isfinite(L) & np.isfinite(z)
    if there.sum() < 3:
        return A if A is not None else np.nan, eta if eta is not None else np.nan, np.nan, np.nan
    c, _, core = fit_log_distance(L[there], z[there], A, eta, robust)
    residuals = [run.rssi - (c[0] + c[1] * log) for run, log in zip(runs, logs, strict=True)]
    square, free = sum(float(np.nansum(e**2)) for e in residuals), (A is None) + (eta is None)
    sigma = core if robust else np.sqrt(square / max(int(there.sum()) - free, 1))
    before, after = (np.concatenate([e[s].ravel() for e in residuals]) for s in (np.s_[:-1], np.s_[1:]))
    both = np.isfinite(before) & np.isfinite(after)
    a, b = before[both], after[both]
    lag1 = float((a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum())) if both.any() else 0.0
    return float(c[0]), float(c[1]), float(sigma), lag1


# ---- The scenario


def name_of_trial(data: Path, run: str, names: Sequence[str], trials: Sequence[int]) -> str:
    """Return the name of the run that a list with one trial asks for.

    Raises:
        BadInput: there are several trials, or there is no such trial.

    """
    there = f"{data}: {run!r} has {len(names)} trial{'s' * (len(names) > 1)}"
    if len(trials) != 1:
        raise BadInput(f"{there}, and a stream holds one, as each run has its own models; ask for trials=[0]")
    if trials[0] >= len(names):
        raise BadInput(f"{there}, numbered from 0; there is no trial {trials[0]}; ask for an existing one")
    return names[trials[0]]


class Log(RobotModel):
    """Parameters of the scenario, in SI units; None: as the description states, or fitted on the other runs."""

    data: Path  # the directory of the runs
    described: str = ""  # the name of a shipped description; where empty, log.toml beside the runs
    run: str = ALL
    fitted_on: Literal["same set-up", "all others"] = "same set-up"  # which of the other runs
    correlation: Literal["inflate", "ignore"] = "inflate"  # of RSSI in time: a larger assumed sigma, or none
    robust: bool = False  # whether the models are fitted with Huber's loss, so that one bad run counts little
    position: Literal["first truth", "arena"] | None = None  # source of the prior's position
    position_sd: Positive | None = None
    heading: Literal["first motion", "first truth", "unknown"] | None = None
    heading_sd: Positive | None = None

    @cached_property
    def folder(self) -> RobotFolder:
        """The runs in the directory."""
        return read_folder(self.data, self.described)

    def count(self) -> int:
        """Return the number of trials: one, or one for each different run of `all`."""
        return len(self._names())

    def at(self, trials: Sequence[int]) -> "Log":
        """Return the scenario of one run, from the list with its one trial.

        Raises:
            BadInput: there are several trials, or there is no such trial or run.

        """
        return self.model_copy(update={"run": name_of_trial(self.data, self.run, self._names(), trials)})

    def world(self) -> World:
        """Return what the robot knows of this run: anchors, arena, and assumed models."""
        folder, run, models = self.folder, self._run(), self._models()
        t0 = float(run.stamp[0])
        return World(1, run.tick, folder.arena, models.motion, models.sensors, anchors=folder.anchors, t0=t0)

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Truth and stream of one run, with `world` as what the robot knows; the seed changes nothing."""
        run, models, arena = self._run(), self._models(), self.folder.arena
        track, T = run.track, len(run.track.dt)
        u = track.odometry * models.scales
        poses = track.truth[:, None].copy()
        poses[..., 2] = wrap(poses[..., 2])
        turns = u[:, 1:] * track.dt[:, None] if isinstance(models.motion, Unicycle) else None
        declared = self.folder.description.prior.model_copy(update=self._overrides(RobotPrior))
        belief, source = prior([run.name], [str(run.path)], declared, arena, poses, turns)
        nothing, radio = np.empty((1, T, 1, 0, 2)), np.empty((1, T, 1, 0))
        rssi = run.rssi[None, 1:, None].copy()  # the readings of row 0, the time of the prior, are not used
        stream = Stream(
            scenario=label,
            seed=seed,
            trial=np.array(trials, np.int64),
            time=float(run.stamp[0]) + track.time[1:],
            world=world,
            prior=belief,
            senses=Senses(u[None, :, None], track.dt[None, :, None], rssi, nothing, nothing, {}),
            air=Air(np.zeros((1, T, 1, 1), bool), radio, radio),
            notes=self._notes(run) | {"prior": source, "models": models.notes},
        )
        known = 3 if np.isfinite(track.truth[:, 2]).any() else 2
        path = track.truth[None, 1:, None, :known].copy()
        valid: Mask = np.asarray(np.isfinite(path).all(-1))
        return Truth(label, stream.trial, path, valid, arena, stream.hashes), stream

    def faults(self) -> list[str]:
        """Return sentences, run by run, on what was left out or sorted while reading."""
        names = self._names() if self.run == ALL else [self.run]
        return [warning for name in names for warning in self.folder.runs[name].counts["warnings"]]

    def explained(self) -> list[str]:
        """Return the same: what a run says of a recording before it begins."""
        return self.faults()

    def _names(self) -> list[str]:
        return self.folder.different if self.run == ALL else [self._run().name]

    def _run(self) -> RobotRun:
        runs = self.folder.runs
        if self.run == ALL:
            raise BadInput(f"{self.data}: {ALL!r} is {self.count()} runs; choose one with at([0])")
        if self.run not in runs:
            raise BadInput(f"{self.data}: there is no run {self.run!r}; {nearest(self.run, [ALL, *runs])}")
        return runs[self.run]

    def _models(self) -> RobotModels:
        stated = self.folder.description.model.model_dump() | self._overrides(RobotModel)
        run = self._run()
        others = self.folder.others(run.name, same_set_up=self.fitted_on == "same set-up")
        return robot_models(self.folder, run, others, stated, self.correlation == "inflate", self.robust)

    def _overrides(self, table: type[BaseModel]) -> dict[str, Any]:
        """Return the parameters that replace values of a table of the description."""
        return {name: value for name in table.model_fields if (value := getattr(self, name)) is not None}

    def _notes(self, run: RobotRun) -> dict[str, Any]:
        return {
            "world": type(self).__name__,
            "parameters": self.model_dump(mode="json", exclude={"data"}),
            "recording": f"{self.data.resolve().name}/{run.path.name}",
            "source": self.folder.description.about,
            "truth_masked": [int(np.isnan(run.track.truth[1:, 0]).sum())],
            **run.counts,
        }
