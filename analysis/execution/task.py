"""What a worker does: simulates a chunk of trials, and runs estimators on it; a trial that fails costs no other."""

import faulthandler
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.metrics.errors import COLUMNS, errors
from cooploc.estimators import make
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.run import Run, run, trace
from cooploc.scenarios.stream import Stream, Truth

FAILURE = ("failure", "traceback")  # why a trial has no result, in a line and in full; missing where it has one
WARM_UP = 600.0  # [s] for imports and compilation, which no limit may interrupt half way: nothing works afterwards
GRACE = 30.0  # [s] beyond twice the limit, after which a worker that cannot even be interrupted is given up


class TimeLimit(Exception):
    """An estimator took longer than it may."""


@dataclass(frozen=True)
class Task:
    """One chunk of a scenario's trials, for the estimators that still lack it."""

    scenario: str
    trials: range
    seed: int
    data: str | None
    estimators: tuple[str, ...]
    time_limit: float  # [s] for one estimator on one trial


class Part(NamedTuple):
    """What a task found out about one estimator."""

    scenario: str
    estimator: str
    trials: range
    frame: pd.DataFrame  # as `errors`, without seconds, with `FAILURE`
    seconds: float  # per robot and tick


def measured(task: Task) -> list[Part]:
    """All parts of a task, in a process of its own that may be given up."""
    return list(measure(task, give_up=True))


def measure(task: Task, give_up: bool = False) -> Iterator[Part]:
    """Simulate a task's trials once and run its estimators on them."""
    truth, stream = simulate(task.scenario, trials=task.trials, seed=task.seed, data=task.data)
    for label in task.estimators:
        limit = _Limit(task.time_limit, give_up)
        _warm(label, stream, limit)
        frame = _frame(label, truth, stream, limit)
        seconds = float(frame["seconds"].mean())
        yield Part(task.scenario, label, task.trials, frame.drop(columns="seconds"), seconds)


def died(task: Task, reason: str) -> Part:
    """The part of a task of one trial and one estimator that took its process with it."""
    (label,) = task.estimators
    _, stream = simulate(task.scenario, trials=task.trials, seed=task.seed, data=task.data)
    frame = _failed(label, stream, reason, reason).drop(columns="seconds")
    return Part(task.scenario, label, task.trials, frame, float("nan"))


class _Limit(NamedTuple):
    """A time limit for each trial [s], and whether the process may be given up to enforce it."""

    seconds: float
    give_up: bool


def _warm(label: str, stream: Stream, limit: _Limit) -> None:
    """Import and compile before the clock runs; whatever goes wrong will do so again, and be recorded then."""
    with suppress(Exception, SystemExit), _within(limit._replace(seconds=WARM_UP + limit.seconds), 1):
        run({label: make(label)}, stream.select(slice(0, 1)).truncated(2))


def _frame(label: str, truth: Truth, stream: Stream, limit: _Limit) -> pd.DataFrame:
    """The rows of one estimator; where it fails, trial by trial, so that one bad trial costs no other."""
    try:
        frame = errors(truth, _limited_run(label, stream, limit))
        return frame.assign(**{column: pd.Series([None] * len(frame), dtype="str") for column in FAILURE})
    except (Exception, SystemExit) as e:
        if len(stream.trial) == 1:
            return _failed(label, stream, _line(e), "".join(traceback.format_exception(e)))
        single = (slice(i, i + 1) for i in range(len(stream.trial)))
        return pd.concat([_frame(label, truth.select(s), stream.select(s), limit) for s in single], ignore_index=True)


def _limited_run(label: str, stream: Stream, limit: _Limit) -> Run:
    with _within(limit, len(stream.trial)) as watch:
        traced = trace(label, make(label), stream, watch)
    return Run(stream.scenario, stream.seed, stream.trial, stream.hashes, {label: traced})


@contextmanager
def _within(limit: _Limit, trials: int) -> Iterator[Callable[..., Any]]:
    """A time limit: yields what looks at the clock at every call of the estimator.

    An alarm interrupts a call that does not return, where there are alarms (in a main thread); what no alarm
    interrupts, such as a loop in compiled code, ends with its process where that may be given up.
    """
    allowed = limit.seconds * trials
    end = time.monotonic() + allowed

    def late(*_: object) -> None:
        raise TimeLimit(f"longer than the time limit of {limit.seconds:g} s a trial")

    def watch(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        if time.monotonic() > end:
            late()
        return call(*arguments)

    alarm = threading.current_thread() is threading.main_thread() and hasattr(signal, "setitimer")
    before = signal.signal(signal.SIGALRM, late) if alarm else None
    if alarm:
        signal.setitimer(signal.ITIMER_REAL, allowed)
    if limit.give_up:
        faulthandler.dump_traceback_later(2 * allowed + GRACE, exit=True)
    try:
        yield watch
    finally:
        if limit.give_up:
            faulthandler.cancel_dump_traceback_later()
        if alarm:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)


def _line(e: BaseException) -> str:
    place = traceback.extract_tb(e.__traceback__)[-1]
    return f"{type(e).__name__}: {e} ({Path(place.filename).name}:{place.lineno})"


def _failed(label: str, stream: Stream, line: str, full: str) -> pd.DataFrame:
    who = {"scenario": stream.scenario, "estimator": label, "trial": stream.trial[0], "robot": np.arange(stream.robots)}
    rest = {"robots": stream.robots, "stream": stream.hashes[0], "failure": line, "traceback": full, "bound": False}
    return pd.DataFrame({**who, **rest, "seconds": float("nan")}).reindex(columns=[*COLUMNS, *FAILURE])
