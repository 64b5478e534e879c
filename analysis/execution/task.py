"""What a worker does: simulates a chunk of trials and runs estimators on it; a trial that fails affects no other."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import chdir, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.execution.failures import HERE, THERE, Caught, full_text, line_of
from cooploc.analysis.execution.run_directory import Piece
from cooploc.analysis.metrics.errors import COLUMNS, errors
from cooploc.estimators import configure, make
from cooploc.estimators.building import ConfiguredEstimator
from cooploc.estimators.errors import BadInput
from cooploc.scenarios import BUILTIN, resolve
from cooploc.scenarios.processes.time_limit import Limit, within
from cooploc.scenarios.processes.workers import call, end
from cooploc.scenarios.remote import RemoteScenario
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.runner.trace import trace
from cooploc.scenarios.scenario import ResolvedScenario
from cooploc.scenarios.stream import Stream, Truth

FAILURE = ("failure", "traceback")  # why a trial has no result, in a line and in full; missing where it has one


@dataclass(frozen=True)
class Task:
    """One chunk of a scenario's trials, for the estimators that still lack it. It travels as labels."""

    scenario: ResolvedScenario | RemoteScenario
    trials: range
    seed: int
    estimators: tuple[ConfiguredEstimator, ...]
    time_limit: float  # [s] for one estimator on one trial

    @property
    def owner(self) -> str:
        """Whose code it runs, and so whose processes may run it: a plug-in scenario's, a plug-in estimator's; or ""."""
        scenario = "" if self.scenario.name in BUILTIN else self.scenario.name
        names = {one.name for one in self.estimators if not one.builtin}
        return " and ".join(filter(None, (scenario, *sorted(names))))

    def by_owner(self) -> list["Task"]:
        """One task for each owner."""
        of: dict[str, list[ConfiguredEstimator]] = {}
        for one in self.estimators:
            of.setdefault("" if one.builtin else one.name, []).append(one)
        return [self.only(tuple(mine)) for mine in of.values()]

    def only(self, estimators: tuple[ConfiguredEstimator, ...]) -> "Task":
        """The same for some of its estimators."""
        return replace(self, estimators=estimators)

    def __reduce__(self) -> tuple[Callable[..., "Task"], tuple[Any, ...]]:
        """As labels, which a worker reads once; a remote scenario as it is, as reading it runs its code."""
        scenario = self.scenario
        where = scenario if isinstance(scenario, RemoteScenario) else (scenario.label, scenario.data)
        labels = [one.label for one in self.estimators]
        return _received, (where, labels, self.trials, self.seed, self.time_limit)


def _received(
    scenario: RemoteScenario | tuple[str, Path | None],
    estimators: list[str],
    trials: range,
    seed: int,
    time_limit: float,
) -> Task:
    resolved = scenario if isinstance(scenario, RemoteScenario) else resolve(*scenario)
    return Task(resolved, trials, seed, tuple(configure(label) for label in estimators), time_limit)


class MeasuredPart(NamedTuple):
    """What a task found out about one estimator."""

    piece: Piece
    frame: pd.DataFrame  # as `errors`, without seconds, with `FAILURE`
    seconds: float  # per robot and tick


def measured(task: Task) -> list[MeasuredPart]:
    """All parts of a task, in a process that may be ended when an estimator hangs."""
    return list(measure(task, end_process=True))


def measure(task: Task, end_process: bool = False) -> Iterator[MeasuredPart]:
    """Simulate a task's trials once and run its estimators on them."""
    limit, caught = Limit(task.time_limit, end_process), THERE if end_process else HERE
    try:
        with within(limit, len(task.trials)):
            truth, stream = task.scenario.simulate(task.trials, task.seed)
    except caught as e:
        if task.scenario.name in BUILTIN or isinstance(e, BadInput):
            raise
        yield from _without_stream(task, e, end_process)
        return
    for estimator in task.estimators:
        _warm_up(estimator, stream, limit, caught)
        frame = _frame(estimator, truth, stream, limit, caught)
        yield part_of(task, estimator, frame)


def part_of(task: Task, estimator: ConfiguredEstimator, frame: pd.DataFrame) -> MeasuredPart:
    """A part of a task; the time that was measured is kept beside its rows."""
    seconds = float(frame["seconds"].mean())
    return MeasuredPart(_piece(task, estimator), frame.drop(columns="seconds"), seconds)


def _without_stream(task: Task, e: BaseException, end_process: bool) -> Iterator[MeasuredPart]:
    """The parts of a task whose scenario failed: each trial is simulated alone, so that the others have a result."""
    if len(task.trials) > 1:
        for trial in task.trials:
            yield from measure(replace(task, trials=range(trial, trial + 1)), end_process)
        return
    for estimator in task.estimators:
        streams = _Streams(task.scenario.robots, [None])
        yield _all_failed(replace(task, estimators=(estimator,)), streams, line_of(e), full_text(e))


def died(task: Task, reason: str) -> MeasuredPart:
    """The part of one estimator whose process died, with the hashes of its streams where these can be made."""
    streams = _Streams(task.scenario.robots, [None] * len(task.trials))
    if isinstance(task.scenario, ResolvedScenario):
        streams = _streams(task)
    else:
        owner = f"simulate {task.scenario.name}"
        with suppress(Exception):
            streams = call(owner, _streams, task, seconds=task.time_limit)
        end(owner)
    return _all_failed(task, streams, reason, reason)


class _Streams(NamedTuple):
    """What a row says of a trial's stream."""

    robots: int
    hashes: Sequence[str | None]  # None where there is none


def _streams(task: Task) -> _Streams:
    _, stream = task.scenario.simulate(task.trials, task.seed)
    return _Streams(stream.robots, stream.hashes)


def _all_failed(task: Task, streams: _Streams, line: str, full: str) -> MeasuredPart:
    """The part of one estimator without any result."""
    (estimator,) = task.estimators
    team = task.scenario.label, streams.robots
    trials = zip(task.trials, streams.hashes, strict=True)
    frames = [failed_rows(estimator.label, *team, trial, stream, line, full) for trial, stream in trials]
    frame = pd.concat(frames, ignore_index=True).drop(columns="seconds")
    return MeasuredPart(_piece(task, estimator), frame, float("nan"))


def _piece(task: Task, estimator: ConfiguredEstimator) -> Piece:
    return Piece(task.scenario.label, estimator.label, task.trials)


def _warm_up(estimator: ConfiguredEstimator, stream: Stream, limit: Limit, caught: Caught) -> None:
    """Import and compile before the clock runs; an error here occurs again in the run, and is recorded there."""
    short = stream.select(slice(0, 1)).first_ticks(2)
    with suppress(*caught), within(limit), chdir(Path.cwd()):
        trace(estimator.label, make(estimator), short)


def _frame(estimator: ConfiguredEstimator, truth: Truth, stream: Stream, limit: Limit, caught: Caught) -> pd.DataFrame:
    """The rows of one estimator; where it fails, each trial runs alone, so that the others have a result."""
    try:
        frame = errors(truth, _limited_run(estimator, stream, limit))
        return frame.assign(**{column: pd.Series([None] * len(frame), dtype="str") for column in FAILURE})
    except caught as e:
        if len(stream.trial) == 1:
            who = stream.scenario, stream.robots, int(stream.trial[0]), stream.hashes[0]
            return failed_rows(estimator.label, *who, line_of(e), full_text(e))
        single = (slice(i, i + 1) for i in range(len(stream.trial)))
        frames = [_frame(estimator, truth.select(s), stream.select(s), limit, caught) for s in single]
        return pd.concat(frames, ignore_index=True)


def _limited_run(estimator: ConfiguredEstimator, stream: Stream, limit: Limit) -> Run:
    with within(limit, *stream.senses.dt.shape[:2]) as watch, chdir(Path.cwd()):
        traced = trace(estimator.label, make(estimator), stream, watch)
    return Run(stream.scenario, stream.seed, stream.trial, stream.hashes, {estimator.label: traced})


def failed_rows(
    estimator: str, scenario: str, robots: int, trial: int, stream: str | None, line: str, full: str
) -> pd.DataFrame:
    """The rows of one trial without a result, and why."""
    who = {"scenario": scenario, "estimator": estimator, "trial": trial, "robot": np.arange(robots)}
    streams = pd.Series([stream] * robots, dtype="str")
    rest = {"robots": robots, "stream": streams, "failure": line, "traceback": full}
    known = {"centralised": False, "bound": False}
    return pd.DataFrame({**who, **rest, **known, "seconds": float("nan")}).reindex(columns=[*COLUMNS, *FAILURE])
