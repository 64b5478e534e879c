"""A team's own recordings as a scenario.

A directory holds `log.toml` (`schema` says what is in it) and the recordings that it describes: `log/RUN` is one run,
`log/all` has a trial for each. The models of a run are fitted on the *other* runs, or on its first part, which is
then not judged; each run has a world of its own, so a stream holds one.

When packets are exchanged is not recorded: every robot can reach every other in every tick, or, with `packets="with a
reading"`, where a radio reading of the sender was recorded. Readings by radio exist where they were measured, and
nowhere else.
"""

from collections.abc import Sequence
from contextlib import suppress
from fnmatch import fnmatchcase
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput, count_of
from cooploc.estimators.interface import Array, Belief, Mask, World
from cooploc.estimators.models import Range, inflate, wrap
from cooploc.estimators.robust import Loss
from cooploc.scenarios.recordings import sampling, schema
from cooploc.scenarios.recordings.fit import (
    FitPart,
    FitSettings,
    LinkResiduals,
    TeamModels,
    fit_part,
    link_residuals,
    team_models,
)
from cooploc.scenarios.recordings.fit_choice import choose
from cooploc.scenarios.recordings.sampling import Gaps, Grid, grid_of_lines
from cooploc.scenarios.recordings.schema import NAME, TeamDescription
from cooploc.scenarios.recordings.team_log import TeamLog, arena_around
from cooploc.scenarios.stream import Stream, Truth
from cooploc.scenarios.worlds.radio import Positive

ALL = "all"  # in the place of a run's name
SAME = 0.5  # share of equal true positions from which on two runs are parts of one recording
NO_ORDER = "ranks no estimators"  # in a sentence of `explanations`
SHORT = 30  # ticks
STILL = 3.0  # standard deviations of the prior
READINGS = ("senses.anchor_rssi", "senses.landmark", "senses.sighting", "air.rssi", "air.range", "extra.anchor_range")


def reader(form: str) -> Any:
    """Return the module that reads a format, imported when it is needed.

    It has `find_runs(data, description)` -> {name: place}, sorted by name, and `read_run(place, name, description)` ->
    `TeamLog` in SI units, with the declared clock offsets added and the declared frame undone.
    """
    return import_module(f"{__package__}.{schema.FORMATS[form]}")


class TeamFolder:
    """The recordings in a directory, each read when it is first needed."""

    def __init__(self, data: Path, description: TeamDescription | None = None) -> None:
        """Find the runs that a description, or log.toml in the directory, describes."""
        if not data.is_dir():
            raise BadInput(f"{data}: there is no such directory; name the one that holds log.toml and the recordings")
        self.description = description or schema.load(data / NAME)
        self.open_findings = [] if description else schema.open_findings(data / NAME)
        self.data = data / self.description.recordings
        self._reader = reader(self.description.format)
        self.places: dict[str, Path] = self._reader.find_runs(self.data, self.description)
        if ALL in self.places:
            raise BadInput(f"{self.places[ALL]}: a run cannot be named {ALL!r}, the name is taken; rename it")
        self._logs: dict[str, TeamLog] = {}

    def log(self, name: str) -> TeamLog:
        """Return a recording by name."""
        if name not in self.places:
            raise BadInput(f"{self.data}: there is no run {name!r}; {nearest(name, [ALL, *self.places])}")
        if name not in self._logs:
            log = self._reader.read_run(self.places[name], name, self.description)
            if not any(log.truth):
                raise BadInput(
                    f"{self.places[name]}: no robot has a truth to be judged by; name it in [truth] of log.toml"
                )
            self._logs[name] = log
        return self._logs[name]

    @cached_property
    def copies(self) -> dict[str, str]:
        """Runs that are part of a longer one, or give filters the same; of two equal runs the first is none."""

        def is_part(name: str, other: str) -> bool:
            logs = a, b = self.log(name), self.log(other)
            short, long = (sum(len(series.time) for series in log.truth if series is not None) for log in logs)
            return (_same(a, b) or _sense_the_same(a, b)) and (long, name) > (short, other)

        names = list(self.places)
        whole = {name: next((other for other in names if other != name and is_part(name, other)), "") for name in names}
        return {name: other for name, other in whole.items() if other}

    @cached_property
    def different(self) -> list[str]:
        """Names of the runs that are no copy of another."""
        return [name for name in self.places if name not in self.copies]

    def others(self, name: str) -> list[TeamLog]:
        """Return the runs on which this one's models may be fitted: none is the same recording or is there twice."""
        patterns = self.description.set_ups
        return [
            self.log(other)
            for other in self.different
            if other != name
            and set_up(other, patterns) == set_up(name, patterns)
            and not _same(self.log(name), self.log(other))
        ]


def _same(a: TeamLog, b: TeamLog) -> bool:
    """Return whether two runs share half of the true positions of the shorter, digit by digit."""
    for i, j in zip(a.truth, b.truth, strict=False):
        if i is None or j is None or not min(len(i.time), len(j.time)):
            continue
        at, there = (np.round(log.zero + one.time, 5) if log.zero else one.time for log, one in ((a, i), (b, j)))
        _, k, m = np.intersect1d(at, there, return_indices=True)
        shared = (i.values[k, :2] == j.values[m, :2]).all(-1).sum()
        if shared >= SAME * min(len(i.time), len(j.time)):
            return True
    return False


def _sense_the_same(a: TeamLog, b: TeamLog) -> bool:
    """Return whether two runs have the same odometry and readings, digit by digit, whatever the true positions."""
    values = [[*(s.values for s in log.odometry), *(r.values for r in log.readings.values())] for log in (a, b)]
    return (a.robots, [*a.readings]) == (b.robots, [*b.readings]) and all(
        np.array_equal(one, other, equal_nan=True) for one, other in zip(*values, strict=True)
    )


def set_up(name: str, patterns: Sequence[str]) -> str:
    """Return the first pattern that a run's name matches; a run that matches none is a set-up of its own."""
    return next((pattern for pattern in patterns if fnmatchcase(name, pattern)), f"only {name}")


class JudgedRun(NamedTuple):
    """A run, the part of it that is judged, and what is known of it."""

    log: TeamLog
    grid: Grid
    parts: list[FitPart]  # on which the models were fitted
    models: TeamModels
    arena: Array  # (2, 2) [m]
    how: FitSettings
    choice: str  # why the fit, and the loss of readings, are robust or not
    loss: Loss


class TeamScenario(schema.Model):
    """Parameters of the scenario, in SI units; None: as log.toml states, or fitted."""

    data: Path  # the directory of log.toml
    described: str = ""  # the name of a shipped description; where empty, log.toml in the directory
    run: str = ALL
    bias: Literal["fitted", "none"] = "fitted"  # of ranges: subtracted as fitted; or raw, and part of sigma
    correlation: Literal["inflate", "ignore"] = "inflate"  # of readings in time: a larger sigma, or none
    robust: bool | None = None  # whether Huber's loss is minimised; None: where it predicts no worse
    loss: Loss | None = None  # by which filters weigh readings; None: as log.toml says, or what predicts best
    packets: Literal["every tick", "with a reading"] = "every tick"
    tick: Annotated[float, Field(ge=0.01, le=60)] | None = None  # [s]
    start: Annotated[float, Field(ge=0)] | None = None  # [s] left out at the beginning
    duration: Positive | None = None  # [s] at most
    position: Literal["first truth", "arena"] | None = None  # source of the prior's position
    position_sd: Positive | None = None  # [m] of the prior
    heading: Literal["first truth", "first motion", "unknown"] | None = None  # source of the prior's heading
    heading_sd: Positive | None = None  # [rad] of the prior

    @classmethod
    def from_description(cls, data: Path, description: TeamDescription) -> "TeamScenario":
        """Return the scenario of all runs in a directory, as described here and not by a log.toml in it."""
        scenario = cls(data=data)
        vars(scenario)["folder"] = TeamFolder(data, description)
        return scenario

    @cached_property
    def folder(self) -> TeamFolder:
        """The recordings in the directory."""
        return TeamFolder(
            self.data, schema.load(Path(__file__).parent / f"{self.described}.{NAME}") if self.described else None
        )

    @cached_property
    def judged_run(self) -> JudgedRun:
        """The run that is simulated, with its models."""
        if self.run == ALL:
            raise BadInput(f"{self.data}: {ALL!r} is {self.count()} runs; choose one with at([0])")
        log, fit = self.folder.log(self.run), self.folder.description.fit
        begin, end = sampling.span(log)
        sampling.require_common_time(log)
        begin += self._sample.start
        first = self._known_start(log, begin + (fit.seconds or 0.0), end)
        grid, lines = self._grid(log, first, end), self._sample.tick == "lines"
        if fit.on == "first part":
            parts = [fit_part(log, begin, first, self._gaps, lines)]
        else:
            others = self.folder.others(self.run) if fit.on == "other runs" else []
            parts = [fit_part(other, *sampling.span(other), self._gaps, lines) for other in others]
        stated = self.folder.description.model.model_dump() | self._overrides(tuple(schema.Model.model_fields))
        inflate = self.correlation == "inflate"
        how = FitSettings(grid.tick, self._gaps, stated, self.bias, bool(self.robust), inflate)
        how, loss, choice = choose(log, parts, how, self.robust, self.loss or fit.loss)
        models = team_models(log, parts, how)
        corners, fixed = self.folder.description.arena, np.concatenate([log.anchors.positions, log.landmarks.positions])
        if not corners and not len(fixed):
            lack = "there are no fixed things around which the arena lies; state its corners [m] in log.toml"
            raise BadInput(f"{self.folder.data}: {lack}: arena = [[0, 0], [6, 4]]")
        arena = np.array(corners, float) if corners else arena_around(fixed)
        return JudgedRun(log, grid, parts, models, arena, how, choice, loss)

    @cached_property
    def _by_trial(self) -> dict[int, "TeamScenario"]:
        """The runs of `all` by trial, as far as they were needed, so that each is fitted once."""
        return {}

    def count(self) -> int:
        """Return the number of trials: one, or one for each different run of `all`."""
        return len(self._names())

    def at(self, trials: Sequence[int]) -> "TeamScenario":
        """Return the scenario of one run, from the list with its one trial."""
        names = self._names()
        there = f"{self.data}: {self.run!r} has {count_of(len(names), 'trial')}"
        if len(trials) != 1:
            raise BadInput(f"{there}, and a stream holds one, as each run has its own models; ask for trials=[0]")
        if trials[0] >= len(names):
            raise BadInput(f"{there}, numbered from 0; there is no trial {trials[0]}; ask for an existing one")
        if self.run != ALL:
            return self
        return self._by_trial.setdefault(trials[0], self.model_copy(update={"run": names[trials[0]]}))

    def world(self) -> World:
        """Return what the team knows of this run: fixed things, arena, and assumed models."""
        log, grid, _, models, arena, _, _, loss = self.judged_run
        world = World(
            robots=len(log.robots),
            tick=grid.tick,
            arena=arena,
            motion=models.motion,
            sensors=models.sensors,
            anchors=log.anchors.positions,
            landmarks=log.landmarks.positions,
            t0=log.zero + grid.t0,
        )
        return inflate(world, 1.0, loss)

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Truth and stream of one run, with `world` as what the team knows; the seed changes nothing."""
        log, grid, _, models, arena, *_ = self.judged_run
        sampled = sampling.sample_log(log, grid, self._gaps, models.scales, models.bias, self.packets)
        poses, odometry = sampled.poses, sampled.senses.odometry[0]
        headed = bool((np.isfinite(poses[1:, :, 2]) | np.isnan(poses[1:, :, 0])).all())
        path = poses[None, 1:, :, : 3 if headed else 2].copy()
        valid: Mask = np.asarray(np.isfinite(path).all(-1))
        turns = None if log.odometry_kind == "displacement" else odometry[..., 1] * grid.dt[:, None]
        belief, source = start_belief(log.robots, log.name, self._prior, arena, poses, turns)
        stream = Stream(
            scenario=label,
            seed=seed,
            trial=np.array(trials, np.int64),
            time=log.zero + grid.edges[1:],
            world=world,
            prior=belief,
            senses=sampled.senses,
            air=sampled.air,
            notes={
                "world": type(self).__name__,
                "parameters": self.model_dump(mode="json", exclude={"data"}),
                "recording": f"{self.data.resolve().name}/{log.name}",
                "robots": list(log.robots),
                "source": self.folder.description.about,
                "models": models.notes,
                "odometry_missing": np.isnan(odometry).any(-1).sum(0).tolist(),
                "truth_masked": (~valid[0]).sum(0).tolist(),
                "warnings": list(log.warnings),
                "prior": source,
                "readings": sampled.counts,
            },
        )
        return Truth(label, stream.trial, path, valid, arena, stream.hashes), stream

    def weaknesses(self, truth: Truth, stream: Stream) -> list[str]:
        """Return why the run can rank no estimators: it is too short, the robots stand, or only odometry is there."""
        ticks, found = len(stream.time), []
        if ticks < SHORT:
            found.append(f"its {ticks} ticks are too few")
        away = np.linalg.norm(truth.x[0, :, :, :2] - stream.prior.x[0, :, :2], axis=-1)
        far = float(np.max(away, where=truth.valid[0], initial=0.0))
        noise = [s.sigma for s in stream.world.sensors.values() if isinstance(s, Range)]
        least = max([STILL * float(self._prior.position_sd), *noise])
        if far < least:
            found.append(f"no robot gets {least:.2g} m away from its start, which is within the noise")
        if not any(np.isfinite(a).any() for name, a in stream.arrays().items() if name in READINGS):
            found.append("it has no readings beside odometry")
        return found

    def faults(self) -> list[str]:
        """Return sentences, run by run, on what was left out, sorted or repaired while reading."""
        if self.run == ALL:
            return [*self.left_out.values(), *(line for k in range(self.count()) for line in self.at([k]).faults())]
        return list(self.judged_run.log.warnings)

    def explanations(self) -> list[str]:
        """Return sentences: what was left out while reading, run by run, and the models with where they were fitted."""
        runs = [self.at([k]) for k in range(self.count())] if self.run == ALL else [self]
        doubts = [line for one in runs for line in one._doubts()]
        with suppress(BadInput):  # then it is among the doubts
            doubts += runs[0]._describe_fit() if len(runs) == 1 else [self._describe_fits(runs)]
            if self._prior.position == "first truth":  # why a lone robot may err less than a team
                told = f"filters are told the true start of each robot, as known to {self._prior.position_sd:g} m"
                doubts.append(f"{told}: no odometry starts wrong")
        left_out = self.left_out.values() if self.run == ALL else ()
        return list(dict.fromkeys([*self.folder.open_findings, *left_out, *doubts]))

    def _doubts(self) -> list[str]:
        """Return what was left out of a run while reading, and why it ranks no estimators."""
        try:
            truth, stream = self.simulate("log", [0], 0, self.world())
        except BadInput as e:
            return [str(e)]
        log, reasons = self.judged_run.log, self.weaknesses(truth, stream)
        run, ticks = f"run {log.name!r}", len(stream.time)
        unused = [channel for channel, counts in stream.notes["readings"].items() if not counts["kept"]]
        lacks = [f"{run}: no {channel} reading is in the part that is judged" for channel in unused]
        still = zip(log.robots, stream.notes["odometry_missing"], strict=True)
        lacks += [
            f"{run}: {robot} has no odometry in {n} of {ticks} ticks; filters take it to stand there"
            for robot, n in still
            if n > ticks / 100
        ]
        weak = [f"{run} {NO_ORDER}: {'; '.join(reasons)}"] * bool(reasons)
        return [*log.warnings, *lacks, *weak]

    def _describe_fit(self) -> list[str]:
        """Return how the models of a run were fitted, and their numbers but for those of single robots and pairs."""
        notes = self.judged_run.models.notes
        numbers = {name: value for name, value in notes.items() if isinstance(value, float)}
        values = ", ".join(f"{name} {value:.3g}" for name, value in numbers.items() if not name.endswith("_lag1"))
        run = f"run {self.judged_run.log.name!r}"
        return [f"{run}: {self.judged_run.choice}", f"{run}: models fitted on {notes['fitted_on']}: {values}"]

    def _describe_fits(self, runs: Sequence["TeamScenario"]) -> str:
        """Return how the models of several runs were fitted."""
        on = {"first part": "its own first part, which is not judged", "other runs": "the other runs of its place"}
        found = [one.judged_run for one in runs]
        robust, far = sum(run.how.robust for run in found), sum(run.loss != "none" for run in found)
        return (
            f"{len(runs)} runs, the models of each fitted on {on.get(self.folder.description.fit.on, 'nothing')}: "
            f"{robust} robustly (Huber's loss), {len(runs) - robust} by least squares; in {far} of them readings far "
            "from what is expected count less"
        )

    def link_residuals(self) -> list[LinkResiduals]:
        """Return the residuals of the run after its models, where these were fitted and where they are judged."""
        log, grid, parts, models, _, how, *_ = self.judged_run
        judged = fit_part(log, grid.t0, float(grid.edges[-1]), self._gaps)
        return list(link_residuals(log, parts, judged, models, how))

    def _names(self) -> list[str]:
        if self.run != ALL:
            return [self.folder.log(self.run).name]
        return [name for name in self.folder.different if name not in self.left_out] or self.folder.different

    @cached_property
    def left_out(self) -> dict[str, str]:
        """Sentences on the runs that `all` leaves out: copies, those of two clocks, those without a tick to judge."""
        sample, fit, found = self._sample, self.folder.description.fit, dict[str, str]()
        for name, other in self.folder.copies.items() if self.run == ALL else ():
            found[name] = f"{self.data}: run {name!r} was left out: it repeats run {other!r}"
        least = sample.start + (fit.seconds or 0.0) + (0.0 if sample.tick == "lines" else sample.tick)
        for name in self.folder.different if self.run == ALL else ():
            begin, end = 0.0, 0.0
            with suppress(BadInput):
                begin, end = sampling.span(self.folder.log(name))
            try:
                sampling.require_common_time(self.folder.log(name))
            except BadInput as e:
                found[name] = f"{e}; it was left out"
                continue
            if end - begin < least or end == begin:
                found[name] = f"{self.data}: run {name!r} has no tick to be judged; it was left out"
        return found

    def _grid(self, log: TeamLog, first: float, end: float) -> Grid:
        sample = self._sample
        length = min(end - first, sample.duration or np.inf)
        if sample.tick == "lines":
            return grid_of_lines(log, first, first + length)
        if length < sample.tick:
            change = "a longer duration or a smaller" if end - first > length else "a smaller start, [fit] seconds or"
            raise BadInput(
                f"run {log.name!r} has {max(length, 0):.3g} s to be judged, less than a tick of {sample.tick:g} s: "
                f"choose {change} tick in log.toml"
            )
        return Grid(first, sample.tick, int(length / sample.tick + 1e-6))

    def _known_start(self, log: TeamLog, first: float, end: float) -> float:
        """Return the first tick's time from which the prior can be taken: every robot's true position is known."""
        tick = self._sample.tick
        times: Array = (
            log.odometry[0].time[log.odometry[0].time >= first]
            if tick == "lines"
            else first + tick * np.arange(max(1.0, (end - first) // tick))
        )
        known = np.ones(len(times), bool)
        if self._prior.position == "first truth":
            for series in filter(None, log.truth):
                known &= np.isfinite(sampling.poses(series, times, self._gaps.truth)[:, :2]).all(-1)
        return float(times[np.argmax(known)])

    @property
    def _sample(self) -> schema.Sample:
        return self.folder.description.sample.model_copy(update=self._overrides(("tick", "start", "duration")))

    @property
    def _prior(self) -> schema.Prior:
        return self.folder.description.prior.model_copy(update=self._overrides(tuple(schema.Prior.model_fields)))

    @property
    def _gaps(self) -> Gaps:
        return Gaps(self._sample.max_gap, self._sample.max_hold)

    def _overrides(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the parameters that replace values of the description."""
        return {name: value for name in names if (value := getattr(self, name)) is not None}


# The prior: the position and heading of each robot at its start, and their source.

UNIFORM = np.pi / np.sqrt(3)  # [rad] standard deviation of a uniform heading
REST, REACH = 0.02, 0.1  # [m] the first motion: from the last position within REST of the start to the first past REACH


def start_belief(
    robots: Sequence[str], run: str, declared: schema.Prior, arena: Array, poses: Array, turns: Array | None
) -> tuple[Belief, str]:
    """Return the belief before the first tick, x (1, n, d) and P (1, n, d, d), and a sentence of where it comes from.

    Row 0 of the true poses (T + 1, n, 3) is at the prior's time; turns (T, n) [rad] are by odometry, or None: robots
    have a compass, and no heading is estimated. `arena` is (2, 2) [m].
    """

    def require(values: Array, lack: str, remedy: str) -> None:
        if (lost := np.isnan(values).any(-1)).any():
            robot = robots[int(np.argmax(lost))]
            raise BadInput(f"run {run!r}: robot {robot!r} has no true {lack}; choose {remedy} in log.toml")

    n, no_position = len(robots), "position where the prior is taken"
    if declared.position == "arena":
        x, sd = np.tile(arena.mean(0), (n, 1)), np.tile((arena[1] - arena[0]) / np.sqrt(12), (n, 1))
        source = "anywhere in the arena"
    else:
        x, sd = poses[0, :, :2], np.full((n, 2), declared.position_sd)
        require(x, no_position, 'start, or position = "arena" in [prior]')
        source = f"first truth, assumed sd {declared.position_sd:g} m"
    if turns is not None:
        heading, heading_sd = np.zeros(n), np.full(n, UNIFORM if declared.heading == "unknown" else declared.heading_sd)
        if declared.heading == "first truth":
            heading, remedy = poses[0, :, 2], 'heading = "first motion" or "unknown" in [prior]'
            require(poses[0, :, 2:], "heading where the prior is taken", remedy)
        elif declared.heading == "first motion":
            require(poses[0, :, :2], no_position, "another start")
            course = np.array([first_course(poses[:, i, :2], np.nan_to_num(turns[:, i])) for i in range(n)])
            heading, heading_sd = np.nan_to_num(course), np.where(np.isnan(course), UNIFORM, heading_sd)
        x, sd = np.column_stack([x, heading]), np.column_stack([sd, heading_sd])
        source += f"; heading: {declared.heading}, assumed sd {heading_sd.min():g} rad"
        still = [name for name, sd_ in zip(robots, heading_sd, strict=True) if sd_ == UNIFORM]
        if declared.heading == "first motion" and still:
            source += f"; unknown of {', '.join(still)}, which hardly moved"
    P = np.stack([np.diag(row**2) for row in sd])
    return Belief(x[None].copy(), P[None]), source


def first_course(truth: Array, turns: Array) -> float:
    """Return the true course of the first REACH metres, less the turn (T,) until then by odometry [rad].

    `truth` (T + 1, 2) [m] is nan where unknown but for the first; the course of a robot that stays is nan.
    """
    away = np.hypot(*(truth - truth[0]).T)
    if not (away > REACH).any():
        return np.nan
    end = int(np.argmax(away > REACH))
    begin = int(np.flatnonzero(away[:end] <= REST)[-1])
    step = truth[end] - truth[begin]
    turned = np.concatenate([[0.0], np.cumsum(turns)])
    course = np.arctan2(step[1], step[0]) - (turned[begin] + turned[end]) / 2
    return float(wrap(np.array(course)))
