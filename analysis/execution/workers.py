"""Where tasks run: in this process, in local processes, or on a Dask cluster; all but the first through one interface.

Only a few tasks more than there are workers are under way at a time. When a worker dies, these are the suspects: each
is tried again alone, then in halves, until what kills its worker is one trial of one estimator, which is a failure like
any other.
"""

import os
import signal
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Protocol

from cooploc.analysis.execution.task import Part, Task, died, measure, measured
from cooploc.estimators.plugins.errors import BadInput

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")


class Workers(Protocol):
    """Some place where tasks run."""

    def compute(self, tasks: list[Task]) -> Iterator[Part]: ...


class Here:
    """This process."""

    def compute(self, tasks: list[Task]) -> Iterator[Part]:
        """The parts of every task, in order."""
        for task in tasks:
            yield from measure(task)


class Pool(ABC):
    """An executor that can be had again after a worker's death broke it."""

    window: int  # tasks that may be under way
    deaths: tuple[type[BaseException], ...] = (BrokenExecutor,)

    @abstractmethod
    def executor(self) -> Executor:
        """A working executor."""

    def function(self) -> Any:
        """What runs a task over there."""
        return measured

    def compute(self, tasks: list[Task]) -> Iterator[Part]:
        """The parts of every task, as they come."""
        waiting, suspects = deque(tasks), deque[Task]()
        flying: dict[Future[list[Part]], Task] = {}
        alone = False
        while waiting or suspects or flying:
            if not flying and suspects:
                flying |= self._submitted(suspects.popleft())
                alone = True
            elif not suspects:
                alone = False
                while waiting and len(flying) < self.window:
                    flying |= self._submitted(waiting.popleft())
            for future in wait(flying, return_when=FIRST_COMPLETED).done:
                task = flying.pop(future)
                try:
                    yield from future.result()
                except self.deaths:
                    if alone and _is_single(task):
                        yield died(task, "the process that ran it died (killed, crashed, or out of memory)")
                    else:
                        suspects.extend(_split(task) if alone else [task])

    def _submitted(self, task: Task) -> dict[Future[list[Part]], Task]:
        return {self.executor().submit(self.function(), task): task}


class Local(Pool):
    """Processes on this machine."""

    def __init__(self, jobs: int) -> None:
        self.jobs, self.window = jobs, jobs + 1
        self._pool: Any = None

    def executor(self) -> Executor:
        """The pool, made anew where a worker died."""
        from loky import get_reusable_executor

        begin = {"initializer": begin_worker, "initargs": (os.getpid(),)}
        self._pool = get_reusable_executor(max_workers=self.jobs, env=ONE_THREAD, **begin)
        pool: Executor = self._pool
        return pool

    def stop(self) -> None:
        """End the processes, whatever they are at."""
        if self._pool is not None:
            self._pool.shutdown(kill_workers=True)


@contextmanager
def hired(jobs: int, scheduler: str | None) -> Iterator[Workers]:
    """Workers for a run.

    Raises:
        BadInput: fewer than one job; no cluster at the address.

    """
    if jobs < 1:
        raise BadInput(f"jobs is {jobs}; it must be at least 1")
    if scheduler is not None:
        from cooploc.analysis.execution.dask_cluster import connected

        with connected(scheduler) as cluster:
            yield cluster
    elif jobs == 1:
        yield Here()
    else:
        local = Local(jobs)
        try:
            yield local
        except BaseException:
            local.stop()
            raise


def _is_single(task: Task) -> bool:
    return len(task.estimators) == 1 and len(task.trials) == 1


def _split(task: Task) -> list[Task]:
    """By estimator; one estimator's, in halves of its trials."""
    if len(task.estimators) > 1:
        return [replace(task, estimators=(name,)) for name in task.estimators]
    if len(task.trials) == 1:
        return [task]
    half = len(task.trials) // 2
    return [replace(task, trials=trials) for trials in (task.trials[:half], task.trials[half:])]


def begin_worker(parent: int) -> None:
    """Leave Ctrl-C to the parent, and end with it, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
