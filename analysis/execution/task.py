"""What a worker does: simulates a chunk of trials and runs estimators on it; a trial that fails affects no other."""

import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.execution.run_directory import Piece
from cooploc.analysis.execution.time_limit import Limit, within
from cooploc.analysis.metrics.errors import COLUMNS, errors
from cooploc.estimators import configure, make
from cooploc.estimators.plugins.build import ConfiguredEstimator
from cooploc.scenarios import resolve
from cooploc.scenarios.resolved import ResolvedScenario
from cooploc.scenarios.runner.run import Run, run
from cooploc.scenarios.runner.trace import trace
from cooploc.scenarios.stream import Stream, Truth

FAILURE = ("failure", "traceback")  # why a trial has no result, in a line and in full; missing where it has one
WARM_UP = 600.0  # [s] for imports and compilation, which must not be interrupted half way: nothing works afterwards


@dataclass(frozen=True)
class Task:
    """One chunk of a scenario's trials, for the estimators that still lack it. It travels as labels."""

    scenario: ResolvedScenario
    trials: range
    seed: int
    estimators: tuple[ConfiguredEstimator, ...]
    time_limit: float  # [s] for one estimator on one trial

    def __reduce__(self) -> tuple[Callable[..., "Task"], tuple[Any, ...]]:
        """As labels, which a worker reads once: a plug-in's objects may not exist there yet."""
        labels = self.scenario.label, self.scenario.data, [one.label for one in self.estimators]
        return _received, (*labels, self.trials, self.seed, self.time_limit)


def _received(
    scenario: str, data: Path | None, estimators: list[str], trials: range, seed: int, time_limit: float
) -> Task:
    return Task(resolve(scenario, data), trials, seed, tuple(configure(label) for label in estimators), time_limit)


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
    truth, stream = task.scenario.simulate(task.trials, task.seed)
    for estimator in task.estimators:
        limit = Limit(task.time_limit, end_process)
        _warm_up(estimator, stream, limit)
        frame = _frame(estimator, truth, stream, limit)
        seconds = float(frame["seconds"].mean())
        yield MeasuredPart(_piece(task, estimator), frame.drop(columns="seconds"), seconds)


def died(task: Task, reason: str) -> MeasuredPart:
    """The part of a task of one trial and one estimator whose process died."""
    (estimator,) = task.estimators
    _, stream = task.scenario.simulate(task.trials, task.seed)
    frame = _failed(estimator, stream, reason, reason).drop(columns="seconds")
    return MeasuredPart(_piece(task, estimator), frame, float("nan"))


def _piece(task: Task, estimator: ConfiguredEstimator) -> Piece:
    return Piece(task.scenario.label, estimator.label, task.trials)


def _warm_up(estimator: ConfiguredEstimator, stream: Stream, limit: Limit) -> None:
    """Import and compile before the clock runs; an error here occurs again in the run, and is recorded there."""
    with suppress(Exception, SystemExit), within(limit._replace(seconds=WARM_UP + limit.seconds), 1):
        run({estimator.label: make(estimator)}, stream.select(slice(0, 1)).truncated(2))


def _frame(estimator: ConfiguredEstimator, truth: Truth, stream: Stream, limit: Limit) -> pd.DataFrame:
    """The rows of one estimator; where it fails, each trial runs alone, so that the others have a result."""
    try:
        frame = errors(truth, _limited_run(estimator, stream, limit))
        return frame.assign(**{column: pd.Series([None] * len(frame), dtype="str") for column in FAILURE})
    except (Exception, SystemExit) as e:
        if len(stream.trial) == 1:
            return _failed(estimator, stream, _line(e), "".join(traceback.format_exception(e)))
        single = (slice(i, i + 1) for i in range(len(stream.trial)))
        frames = [_frame(estimator, truth.select(s), stream.select(s), limit) for s in single]
        return pd.concat(frames, ignore_index=True)


def _limited_run(estimator: ConfiguredEstimator, stream: Stream, limit: Limit) -> Run:
    with within(limit, len(stream.trial)) as watch:
        traced = trace(estimator.label, make(estimator), stream, watch)
    return Run(stream.scenario, stream.seed, stream.trial, stream.hashes, {estimator.label: traced})


def _line(e: BaseException) -> str:
    place = traceback.extract_tb(e.__traceback__)[-1]
    return f"{type(e).__name__}: {e} ({Path(place.filename).name}:{place.lineno})"


def _failed(estimator: ConfiguredEstimator, stream: Stream, line: str, full: str) -> pd.DataFrame:
    robots, trial = np.arange(stream.robots), stream.trial[0]
    who = {"scenario": stream.scenario, "estimator": estimator.label, "trial": trial, "robot": robots}
    rest = {"robots": stream.robots, "stream": stream.hashes[0], "failure": line, "traceback": full}
    known = {"centralised": False, "bound": False}
    return pd.DataFrame({**who, **rest, **known, "seconds": float("nan")}).reindex(columns=[*COLUMNS, *FAILURE])
