"""A directory of runs: which of them are different recordings, and on which a run's models may be fitted."""

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Belief, Mask, Motion, Senses, Sensor, World
from cooploc.estimators.models import Displacement, LogDistance, Unicycle, wrap
from cooploc.scenarios.recordings import fit, robot_run
from cooploc.scenarios.recordings.robot_run import Description, LogRun, Model, Prior, read_run
from cooploc.scenarios.stream import Air, Stream, Truth
from cooploc.scenarios.worlds.radio import Positive

ALL = "all"  # in the place of a run's name
SHARED = 3  # equal lines: two files with this many in common are never fitted on each other


class LogFolder(NamedTuple):
    """A directory of runs with its description."""

    data: Path
    source: Any  # the path of the description
    description: Description
    runs: dict[str, LogRun]  # by name, sorted
    different: list[str]  # names of the runs that are not part of another

    @property
    def anchors(self) -> Array:
        """Positions of the anchors (a, 2) [m]."""
        return np.array(self.description.anchors.positions if self.description.anchors else (), float).reshape(-1, 2)

    @property
    def arena(self) -> Array:
        """Lower left and upper right corner (2, 2) [m]."""
        corners = np.array(self.description.arena, float) if self.description.arena else self.anchors
        return np.stack([corners.min(0), corners.max(0)])

    def others(self, name: str, same_set_up: bool) -> list[LogRun]:
        """The runs on which this one's models may be fitted: they share no lines with it, and none is there twice."""
        mine = self._set_up(name)
        return [
            self.runs[other]
            for other in self.different
            if other != name
            and (self._set_up(other) == mine or not same_set_up)
            and self.runs[other].shared_lines(self.runs[name]) < SHARED
        ]

    def _set_up(self, name: str) -> str:
        """The first pattern that the name matches; a run that matches none is a set-up of its own."""
        return next((pattern for pattern in self.description.set_ups if fnmatchcase(name, pattern)), f"only {name}")


def read_folder(data: Path, described: str = "") -> LogFolder:
    """Every run in a directory, as `log.toml` there describes it, or the shipped description named `described`.

    Raises:
        BadInput: there is no directory, no description or no run, or one of them is malformed.

    """
    if not data.is_dir():
        raise BadInput(f"{data}: there is no such directory; name the one that holds the runs' CSV files")
    source = robot_run.shipped(described) if described else data / robot_run.NAME
    description = robot_run.load(source)
    found = [path for path in data.iterdir() if fnmatchcase(path.name, description.files) and path != source]
    paths = sorted(found, key=lambda path: path.stem)
    if not paths:
        raise BadInput(
            f"{data}: no file there matches {description.files!r}; put the runs there, or correct `files` in {source}"
        )
    for before, path in zip([Path(f"{ALL}.csv"), *paths], paths, strict=False):
        if path.stem in (ALL, before.stem):
            raise BadInput(f"{path}: a run cannot be named {path.stem!r}, the name is taken; rename the file")
    runs = {path.stem: read_run(path, description) for path in paths}
    return LogFolder(data, source, description, runs, [name for name in runs if not _is_part(name, runs)])


def _is_part(name: str, runs: dict[str, LogRun]) -> bool:
    """Whether another run has every line of this one; of two equal runs the one with the later name is the part."""
    run = runs[name]
    larger = [o for o, other in runs.items() if (len(other.rows), name) > (len(run.rows), o)]
    return any(run.shared_lines(runs[o]) == len(run.rows) for o in larger)


# What a robot knows of a run: models that are stated, or fitted on the other runs, and a prior of stated source.

UNKNOWN = np.pi / np.sqrt(3)  # [rad] standard deviation of a uniform heading
REST, REACH = 0.02, 0.1  # [m] the first motion: from the last position within REST of the start to the first past REACH

Stated = Mapping[str, float | None]


class AssumedModels(NamedTuple):
    """Models of one run, and where they come from."""

    motion: Motion
    sensors: dict[str, Sensor]
    scales: Array  # (2,)  factors of the odometry
    notes: dict[str, Any]


def assumed_models(
    folder: LogFolder, run: LogRun, others: Sequence[LogRun], stated: Stated, inflate: bool, robust: bool = False
) -> AssumedModels:
    """The models of a run.

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
    motion = _displacements if folder.description.odometry.kind == "displacement" else _wheels
    values = motion(run, others, stated, robust)
    if len(folder.anchors):
        values |= _radio(folder, run, others, stated, inflate, robust)
    lacking = [name for name, value in values.items() if not np.isfinite(value)]
    if lacking:
        raise BadInput(
            f"{folder.data}: run {run.name!r} has {len(others)} other runs of its set-up, too few to fit "
            f"{', '.join(lacking)}: give them as parameters, or in [model] of {folder.source}"
        )
    sensors: dict[str, Sensor] = {}
    if len(folder.anchors):
        sensors["anchor_rssi"] = LogDistance(values["A"], values["eta"], values["sigma"])
    scales = np.array([values["length_scale"], values.get("turn_scale", values["length_scale"])])
    moves = (
        Displacement(values["sigma_move"], run.tick)
        if "sigma_move" in values
        else Unicycle(values["sigma_v"], values["sigma_omega"], run.tick)
    )
    return AssumedModels(moves, sensors, scales, {"fitted_on": [other.name for other in others], **values})


def prior_of_run(run: LogRun, declared: Prior, arena: Array, assumed: AssumedModels) -> tuple[Belief, str]:
    """The belief before the first tick, x (1, 1, d) and P (1, 1, d, d), and where it comes from.

    Raises:
        BadInput: the source that is declared does not give a position or a heading.

    """
    if declared.position == "arena":
        x, sd, source = arena.mean(0), (arena[1] - arena[0]) / np.sqrt(12), "anywhere in the arena"
    else:
        first = declared.position == "first truth"
        if declared.position_sd is None:
            raise BadInput("the prior's position_sd [m] is not stated; give it with position='first truth'")
        x, sd = run.truth[0, :2] if first else np.array(declared.position), np.full(2, declared.position_sd)
        source = f"{declared.position if first else 'stated position'}, assumed sd {sd[0]:g} m"
    if isinstance(assumed.motion, Unicycle):
        heading, spread = _heading(run, declared, assumed)
        x, sd = np.append(x, heading), np.append(sd, spread)
        source += f"; heading: {declared.heading}, assumed sd {spread:g} rad"
    return Belief(x[None, None].copy(), np.diag(sd**2)[None, None].copy()), source


def _wheels(run: LogRun, others: Sequence[LogRun], stated: Stated, robust: bool) -> dict[str, float]:
    scales = stated["length_scale"], stated["turn_scale"]
    fitted = fit.fit_wheel_odometry(others, run.tick, *scales, robust)._asdict()
    return fitted | {name: value for name in fitted if (value := stated[name]) is not None}


def _displacements(run: LogRun, others: Sequence[LogRun], stated: Stated, robust: bool) -> dict[str, float]:
    scale, sigma = stated["length_scale"] or 1.0, stated["sigma_move"]
    return {"length_scale": scale, "sigma_move": sigma or fit.fit_displacement(others, run.tick, scale, robust)}


def _radio(
    folder: LogFolder, run: LogRun, others: Sequence[LogRun], stated: Stated, inflate: bool, robust: bool
) -> dict[str, float]:
    """Path loss. As filters assume independent readings, sigma is inflated by sqrt((1 + r) / (1 - r)).

    r is the lag-1 correlation of the residuals: the mean of many readings then has the spread that a filter computes.
    """
    fitted = fit.fit_path_loss(others, folder.anchors, stated["A"], stated["eta"], robust)
    if fitted.eta <= 0:
        raise BadInput(
            f"{folder.data}: RSSI does not fall with distance in the runs on which {run.name!r} is fitted "
            f"(eta = {fitted.eta:.3g}); check that [anchors] positions and rssi are in the same order, or state eta"
        )
    r = np.clip(fitted.lag1, 0.0, 0.99) if inflate else 0.0
    sigma = fitted.sigma * np.sqrt((1 + r) / (1 - r)) if stated["sigma"] is None else stated["sigma"]
    known = {"A": fitted.A, "eta": fitted.eta, "sigma": float(sigma)}
    return known | ({"residual_sd": fitted.sigma, "residual_lag1": fitted.lag1} if np.isfinite(fitted.sigma) else {})


def _heading(run: LogRun, declared: Prior, assumed: AssumedModels) -> tuple[float, float]:
    """Mean and standard deviation [rad]."""
    if declared.heading == "unknown":
        return 0.0, UNKNOWN
    if declared.heading == "first motion":
        return _first_motion(run, assumed.scales[1]), declared.heading_sd
    heading = run.truth[0, 2] if declared.heading == "first truth" else declared.heading
    if np.isnan(heading):
        raise BadInput(f"{run.path}: the truth has no heading; choose heading='first motion' or 'unknown'")
    return float(wrap(np.array(heading))), declared.heading_sd


def _first_motion(run: LogRun, turn_scale: float) -> float:
    turns = np.nan_to_num(turn_scale * run.odometry[:, 1]) * run.dt
    return first_course(str(run.path), run.truth[:, :2], turns)


def first_course(where: str, truth: Array, turns: Array) -> float:
    """The true course of the first REACH metres, less the turn until then by odometry [rad].

    Args:
        where: names the recording, for an error.
        truth: (T + 1, 2) [m], nan where unknown but for the first.
        turns: (T,) [rad]

    Raises:
        BadInput: the robot does not get that far.

    """
    away = np.hypot(*(truth - truth[0]).T)
    if not (away > REACH).any():
        raise BadInput(
            f"{where}: the robot never gets {REACH:g} m away from its start, so its first motion gives no heading; "
            'state heading in [prior] as a number, or as "unknown"'
        )
    end = int(np.argmax(away > REACH))
    begin = int(np.flatnonzero(away[:end] <= REST)[-1])
    step = truth[end] - truth[begin]
    turned = np.concatenate([[0.0], np.cumsum(turns)])
    course = np.arctan2(step[1], step[0]) - (turned[begin] + turned[end]) / 2
    return float(wrap(np.array(course)))


# tmp


def asked(data: Path, run: str, names: Sequence[str], trials: Sequence[int]) -> str:
    """The name of the run that a list with one trial asks for.

    Raises:
        BadInput: there are several trials, or there is no such trial.

    """
    there = f"{data}: {run!r} has {len(names)} trial{'s' * (len(names) > 1)}"
    if len(trials) != 1:
        raise BadInput(f"{there}, and a stream holds one, as each run has its own models; ask for trials=[0]")
    if trials[0] >= len(names):
        raise BadInput(f"{there}, numbered from 0; there is no trial {trials[0]}; ask for an existing one")
    return names[trials[0]]


# A user's own log as a scenario: real runs of one robot.
#
# A directory holds one CSV file per run, and `log.toml`, which states what the columns mean. `log/RUN` is one run;
# `log/all` has a trial for each run, so intervals are over runs. The models of a run are fitted on the *other* runs:
# each run has a world of its own, so a stream holds one run. The WiFi recordings of Latif & Parasuraman, `wifi/RUN` and
# `wifi/all`, are such a directory with a shipped description.


class Log(BaseModel):
    """Parameters of the scenario, in SI units; None: as the description states, or fitted on the other runs."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    data: Path  # the directory of the runs
    described: str = ""  # the name of a shipped description; where empty, log.toml beside the runs
    run: str = ALL
    fitted_on: Literal["same set-up", "all others"] = "same set-up"  # which of the other runs
    correlation: Literal["inflate", "ignore"] = "inflate"  # of RSSI in time: a larger assumed sigma, or none
    robust: bool = False  # whether the models are fitted with Huber's loss, so that one bad run counts little
    A: float | None = None  # [dBm] at 1 m
    eta: Positive | None = None  # path-loss exponent
    sigma: Positive | None = None  # [dB]
    length_scale: Positive | None = None  # true length by odometry's
    turn_scale: Positive | None = None  # true turn by odometry's
    sigma_v: Positive | None = None  # [m/s] at the median interval
    sigma_omega: Positive | None = None  # [rad/s] at the median interval
    sigma_move: Positive | None = None  # [m] per axis in the median interval
    position: Literal["first truth", "arena"] | None = None  # source of the prior's position
    position_sd: Positive | None = None
    heading: Literal["first motion", "first truth", "unknown"] | None = None
    heading_sd: Positive | None = None

    @cached_property
    def folder(self) -> LogFolder:
        """The runs in the directory."""
        return read_folder(self.data, self.described)

    def count(self) -> int:
        """How many trials there are: one, or one for each different run of `all`."""
        return len(self._names())

    def at(self, trials: Sequence[int]) -> "Log":
        """The scenario of one run, from the list with its one trial.

        Raises:
            BadInput: there are several trials, or there is no such trial or run.

        """
        name = asked(self.data, self.run, self._names(), trials)
        return self.model_copy(update={"run": name})

    def world(self) -> World:
        """What the robot knows of this run: anchors, arena, and assumed models."""
        folder, assumed = self.folder, self._assumed()
        return World(
            robots=1,
            tick=self._run().tick,
            arena=folder.arena,
            motion=assumed.motion,
            sensors=assumed.sensors,
            anchors=folder.anchors,
            t0=self._run().t0,
        )

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Truth and stream of one run, with `world` as what the robot knows; the seed changes nothing."""
        run, assumed = self._run(), self._assumed()
        prior, source = prior_of_run(run, self._declared(), self.folder.arena, assumed)
        T = len(run.dt)
        senses = _senses(run, assumed.scales)
        radio = np.empty((1, T, 1, 0))
        stream = Stream(
            scenario=label,
            seed=seed,
            trial=np.array(trials, np.int64),
            time=run.t0 + run.time[1:],
            world=world,
            prior=prior,
            senses=senses,
            air=Air(np.zeros((1, T, 1, 1), bool), radio, radio),
            notes=self._notes(run) | {"prior": source, "models": assumed.notes},
        )
        known = 3 if np.isfinite(run.truth[:, 2]).any() else 2
        path = run.truth[None, 1:, None, :known].copy()
        valid: Mask = np.asarray(np.isfinite(path).all(-1))
        return Truth(label, stream.trial, path, valid, self.folder.arena, stream.hashes), stream

    def _names(self) -> list[str]:
        return self.folder.different if self.run == ALL else [self._run().name]

    def _run(self) -> LogRun:
        runs = self.folder.runs
        if self.run == ALL:
            raise BadInput(f"{self.data}: {ALL!r} is {self.count()} runs; choose one with at([0])")
        if self.run not in runs:
            raise BadInput(f"{self.data}: there is no run {self.run!r}; {nearest(self.run, [ALL, *runs])}")
        return runs[self.run]

    def _assumed(self) -> AssumedModels:
        stated = self.folder.description.model.model_dump()
        stated |= self._overrides(Model)
        run = self._run()
        others = self.folder.others(run.name, same_set_up=self.fitted_on == "same set-up")
        return assumed_models(self.folder, run, others, stated, self.correlation == "inflate", self.robust)

    def _declared(self) -> Prior:
        """The description's prior with this scenario's overrides."""
        return self.folder.description.prior.model_copy(update=self._overrides(Prior))

    def _overrides(self, table: type[BaseModel]) -> dict[str, Any]:
        """The parameters that replace values of a table of the description."""
        return {name: value for name in table.model_fields if (value := getattr(self, name)) is not None}

    def _notes(self, run: LogRun) -> dict[str, Any]:
        return {
            "world": type(self).__name__,
            "parameters": self.model_dump(mode="json", exclude={"data"}),
            "recording": f"{self.data.resolve().name}/{run.path.name}",
            "source": self.folder.description.about,
            "truth_masked": [int(np.isnan(run.truth[1:, 0]).sum())],
            **run.counts,
        }


def _senses(run: LogRun, scales: Array) -> Senses:
    """Odometry and readings (1, T, 1, ...). The readings of row 0, the time of the prior, are not used."""
    odometry = (run.odometry * scales)[None, :, None]
    nothing = np.empty((1, len(run.dt), 1, 0, 2))
    return Senses(odometry, run.dt[None, :, None], run.rssi[None, 1:, None].copy(), nothing, nothing, {})
