"""Workers: they simulate chunks of trials and run estimators on them, in this process, in others, or on a Dask cluster.

A trial that fails affects no other. A plug-in estimator runs in a process of its own, which gets streams without the
seed that made them; a plug-in world is simulated there too. When a worker process dies, the few tasks that were running
are tried again one by one, then by estimator and by trial, until what ends its process is one trial of one estimator: a
failure like any other.
"""

import asyncio
import logging
import multiprocessing
import re
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from contextlib import chdir, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.execution.provenance import bits, plugins
from cooploc.analysis.execution.run_directory import PartKey
from cooploc.analysis.metrics.errors import COLUMNS, errors
from cooploc.estimators import configure, make
from cooploc.estimators.building import ConfiguredEstimator
from cooploc.estimators.errors import BadInput, one_line, traceback_text
from cooploc.scenarios import BUILTIN as BUILTIN_SCENARIOS
from cooploc.scenarios import resolve
from cooploc.scenarios.process import (
    BUILTIN,
    PLUGINS,
    SESSION,
    ProcessDied,
    ProcessHung,
    RemoteTraceback,
    WorkerError,
    call,
    cause_of,
    end,
    end_all,
    end_if_edited,
    limit_time,
    place_of,
    submit,
)
from cooploc.scenarios.runner.run import PluginJob, Run, trace_in_process
from cooploc.scenarios.runner.tick import EstimatorError
from cooploc.scenarios.runner.trace import Trace, trace, warm_up
from cooploc.scenarios.scenario import ResolvedScenario
from cooploc.scenarios.stream import Stream, Truth

FAILURE = ("failure", "traceback")  # why a trial has no result, in a line and in full; missing where it has one
FAILS = Exception, SystemExit, GeneratorExit  # what a trial's code may raise without ending more
MOST_JOBS = 1024


# What a worker does.


@dataclass(frozen=True)
class Task:
    """A chunk of a scenario's trials, for the estimators that still lack it. It travels as labels."""

    scenario: ResolvedScenario
    trials: range
    seed: int
    estimators: tuple[ConfiguredEstimator, ...]
    time_limit: float  # [s] for one estimator on one trial
    isolate: bool = True  # whether plug-ins run in a process of their own

    def smaller(self) -> "list[Task]":
        """Return one task for each estimator; of one estimator, for each trial; nothing for a single trial of one."""
        if len(self.estimators) > 1:
            return [replace(self, estimators=(estimator,)) for estimator in self.estimators]
        if len(self.trials) > 1:
            return [replace(self, trials=range(trial, trial + 1)) for trial in self.trials]
        return []

    def halves(self) -> "list[Task]":
        """Return two tasks of every other estimator, as neighbours cost much the same; one where there is only one."""
        parts = filter(None, (self.estimators[::2], self.estimators[1::2]))
        return [replace(self, estimators=some) for some in parts]

    @property
    def size(self) -> int:
        """Its share of the work, roughly."""
        return len(self.trials) * self.scenario.robots * len(self.estimators)

    def labels(self) -> tuple[Any, ...]:
        """Return what `_read_task` takes."""
        names = [one.label for one in self.estimators]
        rest = self.trials, self.seed, names, self.time_limit, self.isolate
        return self.scenario.label, self.scenario.data, *rest

    def __reduce__(self) -> tuple[Callable[..., "Task"], tuple[Any, ...]]:
        return _read_task, self.labels()


def _read_task(
    label: str, data: Path | None, trials: range, seed: int, estimators: list[str], limit: float, isolate: bool
) -> Task:
    return Task(resolve(label, data), trials, seed, tuple(map(configure, estimators)), limit, isolate)


class MeasuredPart(NamedTuple):
    """The results of one estimator in a task."""

    key: PartKey
    frame: pd.DataFrame  # as `errors`, without seconds, with `FAILURE`
    seconds: float  # per robot and tick


def compute_task(task: Task) -> Iterator[MeasuredPart]:
    """Simulate a task's trials once, run its estimators on them, and yield a part for each."""
    plugin_world = task.scenario.name not in BUILTIN_SCENARIOS
    try:
        if plugin_world and task.isolate:
            yield from call(PLUGINS, compute_parts, replace(task, isolate=False), limit=task.time_limit)
            return
        with limit_time(task.time_limit):
            truth, stream = task.scenario.simulate(task.trials, task.seed)
    except FAILS as e:
        if not plugin_world:
            raise
        if not task.smaller():
            yield failed_part(task, *explain_failure(e))
        for one in task.smaller():
            yield from compute_task(one)
        return
    for estimator in task.estimators:
        if estimator.builtin or not task.isolate:
            warm_up(estimator.label, make(estimator), stream)
        yield _part(task, estimator, _run_rows(task, estimator, truth, stream))


def compute_parts(task: Task) -> list[MeasuredPart]:
    """Return what `compute_task` yields, for a process that is asked once."""
    return list(compute_task(task))


def _run_rows(task: Task, estimator: ConfiguredEstimator, truth: Truth, stream: Stream) -> pd.DataFrame:
    """Return the rows of one estimator; where it fails, each trial runs alone, so that the others have a result."""
    try:
        traces = {estimator.label: _trace(task, estimator, stream)}
        frame = errors(truth, Run(stream.scenario, stream.seed, stream.trial, stream.hashes, traces))
        return frame.assign(**{column: pd.Series([None] * len(frame), dtype="str") for column in FAILURE})
    except FAILS as e:
        if len(stream.trial) == 1:
            trial, robots, hashed = int(stream.trial[0]), stream.robots, stream.hashes[0]
            return _failed_rows(task, estimator, trial, robots, hashed, *explain_failure(e))
        single = (slice(i, i + 1) for i in range(len(stream.trial)))
        frames = [_run_rows(task, estimator, truth.select(s), stream.select(s)) for s in single]
        return pd.concat(frames, ignore_index=True)


def _trace(task: Task, estimator: ConfiguredEstimator, stream: Stream) -> Trace:
    if task.isolate and not estimator.builtin:
        job = PluginJob(estimator.label, estimator.label, task.time_limit, PLUGINS)
        try:
            return trace_in_process(job, [stream])
        except EstimatorError as e:
            if len(stream.trial) > 1 or not isinstance(e.__cause__, ProcessDied):
                raise
            return trace_in_process(job, [stream])  # once more: what ended the process may have been another's
    with limit_time(task.time_limit, *stream.senses.dt.shape[:2]) as watch:
        return trace(estimator.label, make(estimator), stream, watch)


def _part(task: Task, estimator: ConfiguredEstimator, frame: pd.DataFrame) -> MeasuredPart:
    key = PartKey(task.scenario.label, estimator.label, task.trials)
    return MeasuredPart(key, frame.drop(columns="seconds"), float(frame["seconds"].mean()))


def failed_part(task: Task, line: str, full: str = "") -> MeasuredPart:
    """Return the part of a task of one trial and estimator that left nothing, with the stream if it can be made."""
    (estimator,), (trial,), robots, hashed = task.estimators, task.trials, task.scenario.robots, None
    if task.scenario.name in BUILTIN_SCENARIOS:
        stream = task.scenario.simulate(task.trials, task.seed)[1]
        robots, hashed = stream.robots, stream.hashes[0]
    return _part(task, estimator, _failed_rows(task, estimator, trial, robots, hashed, line, full or line))


def _failed_rows(
    task: Task, estimator: ConfiguredEstimator, trial: int, robots: int, stream: str | None, line: str, full: str
) -> pd.DataFrame:
    """Return the rows of one trial without a result, and why."""
    who = {"scenario": task.scenario.label, "estimator": estimator.label, "trial": trial, "robot": np.arange(robots)}
    known = {"robots": robots, "stream": pd.Series([stream] * robots, dtype="str"), "centralised": False}
    rest = {"bound": False, "seconds": float("nan"), "failure": line, "traceback": full}
    return pd.DataFrame({**who, **known, **rest}).reindex(columns=[*COLUMNS, *FAILURE])


def explain_failure(e: BaseException) -> tuple[str, str]:
    """Return what a trial's code raised, and where, in one line and in full."""
    full = str(e.__cause__) if isinstance(e.__cause__, RemoteTraceback) else traceback_text(e)
    if isinstance(e, ProcessDied | ProcessHung) or isinstance(e.__cause__, WorkerError):
        return one_line(e), full
    return f"{e if isinstance(e, WorkerError) else one_line(e)}{place_of(e)}", full


# Where tasks run.

Compute = Callable[[list[Task]], Iterator[MeasuredPart]]  # yields the parts of every task, in any order


class Processes(NamedTuple):
    """Processes that measure tasks, on this machine or on a cluster."""

    submit: Callable[[Task], Future[Any]]
    result: Callable[[Future[Any]], list[MeasuredPart]]
    died: type[BaseException]  # what `result` raises where a worker died
    window: int  # tasks that may run or wait at a time: the suspects when a worker dies
    renew: Callable[[], None]  # replaces what died
    require_alive: Callable[[], None]  # raises where nothing will come any more


@contextmanager
def make_workers(jobs: int, scheduler: str | None, isolate: bool) -> Iterator[Compute]:
    """Yield a function that computes tasks: here, in processes of this machine, or on a Dask cluster."""
    if not isinstance(jobs, int) or not 1 <= jobs <= MOST_JOBS:
        raise BadInput(f"jobs is {jobs!r}; it must be a whole number, at least 1, and at most {MOST_JOBS}")
    if not isolate and (jobs > 1 or scheduler):
        other = f"--jobs {jobs}" if jobs > 1 else "--scheduler"
        raise BadInput(f"--no-isolate keeps everything in one process, and {other} asks for others: leave one out")

    def compute_here(tasks: list[Task]) -> Iterator[MeasuredPart]:
        end_if_edited(BUILTIN)  # between two runs of one Python process; not in a run, whose code is of its beginning
        yield from compute_in_parallel(_local_processes(jobs), tasks) if jobs > 1 else chain(*map(compute_task, tasks))

    try:
        if scheduler is not None:
            with _connect(scheduler) as client:
                yield partial(compute_in_parallel, _dask_processes(client, scheduler))
        else:
            yield compute_here
    except BaseException:
        end_all(but=(SESSION,))
        raise


def compute_in_parallel(processes: Processes, tasks: list[Task]) -> Iterator[MeasuredPart]:
    """Yield the parts of every task, as they come; where a worker dies, those that were running run again, alone."""
    waiting, running = deque(split_tasks(tasks, 2 * processes.window)), dict[Future[Any], Task]()
    while waiting or running:
        while waiting and len(running) < processes.window:
            task = waiting.popleft()
            running[processes.submit(task)] = task
        for future in wait(running, timeout=LOOK, return_when=FIRST_COMPLETED).done:
            try:
                yield from processes.result(future)
                del running[future]
            except processes.died:
                processes.renew()
                suspects = list(running.values())
                running.clear()
                for suspect in suspects:
                    yield from _compute_alone(processes, suspect)
                break
        processes.require_alive()


def split_tasks(tasks: list[Task], least: int) -> list[Task]:
    """Return the tasks; of too few for all processes the largest are halved, so that a single recording keeps all busy.

    Halves simulate or read the same stream, and estimate the same bits.
    """
    while 0 < len(tasks) < least:
        tasks = sorted(tasks, key=lambda task: (len(task.estimators) > 1, task.size), reverse=True)
        halves = tasks[0].halves()
        if len(halves) == 1:
            break
        tasks = [*halves, *tasks[1:]]
    return sorted(tasks, key=lambda task: task.size, reverse=True) if len(tasks) <= least else tasks


def _compute_alone(processes: Processes, task: Task) -> Iterator[MeasuredPart]:
    try:
        yield from processes.result(processes.submit(task))
    except processes.died as e:
        processes.renew()
        for one in task.smaller():
            yield from _compute_alone(processes, one)
        if not task.smaller():
            yield failed_part(task, f"the process that ran it died ({cause_of(e)})")


def _local_processes(jobs: int) -> Processes:
    """Return processes on this machine."""
    send = partial(submit, BUILTIN, jobs, compute_parts)
    return Processes(
        send, lambda future: future.result().unpack(), BrokenExecutor, jobs + 1, partial(end, BUILTIN), lambda: None
    )


# A running Dask cluster: the same tasks, through the same interface.

PATIENCE = 5  # [s] for the scheduler to answer
LOOK = 2.0  # [s] between looks at a cluster that gives no results
SEEN, GONE = 10.0, 60.0  # [s] between looks whether it has workers; without any, until it is given up
REMEDY = {
    "versions": "install the same there",
    "source": "install the same there",
    "plug-ins": "share their folder, or install the same there; if one was edited meanwhile, start again",
    "instructions": "use workers of one kind of processor, with the same flags",
}
_one_at_a_time = threading.Lock()


def _dask_processes(client: Any, address: str) -> Processes:
    """Return the workers of a Dask scheduler, which itself replaces dead workers and repeats their tasks."""
    from distributed.scheduler import KilledWorker

    kept = "what was finished is kept: start it, and the same command goes on"
    lost = BadInput(f"the Dask scheduler at {address} is gone; {kept}")
    seen = time.monotonic()  # when it last had workers

    def result(future: Future[Any]) -> list[MeasuredPart]:
        try:
            parts: list[MeasuredPart] = future.result()
            return parts
        except (asyncio.CancelledError, CancelledError):
            raise lost from None
        except (ImportError, AttributeError) as e:
            raise BadInput(f"a worker of {address} cannot run cooploc ({one_line(e)}): install it there") from e

    def require_alive() -> None:
        nonlocal seen
        if client.status != "running":
            raise lost
        if (now := time.monotonic()) - seen > SEEN:
            try:
                seen = now if client.nthreads() else seen
            except OSError:
                raise lost from None
            if now - seen > GONE:
                why = "their logs say why; one that has no cooploc ends as soon as it is sent a task"
                raise BadInput(f"the Dask scheduler at {address} has lost all workers ({why}); {kept}")

    begun: dict[str, str] = {}  # plug-in -> the hash that it had when the run began: one that is edited is refused

    def send(task: Task) -> Future[Any]:
        wanted = {**bits(), "plug-ins": {name: begun.setdefault(name, now) for name, now in _plugins_of(task).items()}}
        sent: Future[Any] = submit_there(_measure_on_dask, wanted, Path.cwd(), task.labels())
        return sent

    submit_there = client.get_executor(pure=False).submit
    window = 2 * max(1, sum(client.nthreads().values()))
    return Processes(send, result, KilledWorker, window, lambda: None, require_alive)


def _plugins_of(task: Task) -> dict[str, str]:
    return plugins(task.estimators, [task.scenario])[0]


def _measure_on_dask(wanted: dict[str, Any], folder: Path, labels: tuple[Any, ...]) -> list[MeasuredPart]:
    """Measure the task of these labels in the folder of the machine that asks, if it gives the bits that are wanted.

    One thread of a worker at a time is timed alone.
    """
    from distributed import get_worker

    worker = get_worker().address
    with _one_at_a_time, chdir(folder) if folder.is_dir() else nullcontext():
        try:
            task = _read_task(*labels)
            there = {**bits(), "plug-ins": _plugins_of(task)}
        except (BadInput, OSError) as e:
            share = f"share {folder} with it, or install plug-ins there as packages"
            raise BadInput(f"the Dask worker {worker} lacks what the task names ({one_line(e)}): {share}") from e
        for key, mine in there.items():
            if wanted.get(key) != mine:
                raise BadInput(f"the Dask worker {worker} has other {key} than the machine that asks: {REMEDY[key]}")
        # Dask's workers are daemons, which may have no children; those of plug-ins end with their parent.
        multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]
        return compute_parts(task)


@contextmanager
def _connect(address: str) -> Iterator[Any]:
    """Yield the client of a cluster."""
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise BadInput("--scheduler needs Dask, which is not installed: pip install 'cooploc[cluster]'") from None
    if not isinstance(address, str):
        raise BadInput(f"scheduler is a {type(address).__name__}; give its address, such as cluster.scheduler_address")
    if not re.fullmatch(r"(tcp|tls|wss?|ucx)://.+:\d+", address):
        raise BadInput(f"cannot read the scheduler's address {address!r}; write it like tcp://10.0.0.1:8786")
    for name in ("distributed", "distributed.client", "distributed.utils", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what they complain of is said in one line
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as e:
        raise BadInput(
            f"no Dask scheduler answers at {address} ({type(e).__name__}): start one, or correct the address"
        ) from None
    try:
        if not client.nthreads():
            raise BadInput(f"the Dask scheduler at {address} has no workers: start some (dask worker {address})")
        yield client
    finally:
        client.close(timeout=1)
