"""Workers behind a `concurrent.futures.Executor`, and what to do when one of them dies.

Only a few tasks more than there are workers run at a time. When a worker dies, these are the suspects: each is tried
again alone, then by estimator and by trial, until what kills its worker is one trial of one estimator, which is a
failure like any other.
"""

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

from cooploc.analysis.execution.task import MeasuredPart, Task, died, measured
from cooploc.scenarios.processes.workers import cause


class Workers(Protocol):
    """Some place where tasks run."""

    def compute(self, tasks: list[Task]) -> Iterator[MeasuredPart]:
        """The parts of every task, in any order."""
        ...


class _Running(NamedTuple):
    task: Task
    began: float


class Pool(ABC):
    """An executor that can be replaced after a worker's death broke it."""

    window: int  # tasks that may run or wait at a time
    deaths: tuple[type[BaseException], ...] = (BrokenExecutor,)
    function: Callable[[Task], Any] = staticmethod(measured)  # what runs a task in a worker

    @abstractmethod
    def executor(self) -> Executor:
        """A working executor."""

    def begun(self, task: Task) -> "Future[Any]":
        """A task on its way to a worker."""
        return self.executor().submit(self.function, task)

    def renew(self) -> None:
        """A worker died: the next executor must be another one, unless the executor replaces its workers itself."""
        return

    def parts(self, task: Task, future: "Future[Any]") -> list[MeasuredPart]:
        """What a task came to, or raised."""
        found: list[MeasuredPart] = future.result()
        return found

    def first(self, running: "dict[Future[Any], _Running]") -> "set[Future[Any]]":
        """Those that are done, at least one."""
        return wait(running, return_when=FIRST_COMPLETED).done

    def compute(self, tasks: list[Task]) -> Iterator[MeasuredPart]:
        """The parts of every task, as they come."""
        waiting, suspects = deque(tasks), deque[Task]()
        running: dict[Future[Any], _Running] = {}
        alone = self.window == 1
        while waiting or suspects or running:
            if suspects and not running:
                running |= self._submitted(suspects.popleft())
                alone = True
            while waiting and not suspects and len(running) < self.window:
                running |= self._submitted(waiting.popleft())
                alone = self.window == 1
            for future in self.first(running):
                task, began = running.pop(future)
                try:
                    yield from self.parts(task, future)
                except self.deaths as e:
                    self.renew()
                    if alone and _is_single(task):
                        yield died(task, _reason(task, e, time.monotonic() - began))
                    else:
                        suspects.extend(_split(task) if alone else [task])

    def _submitted(self, task: Task) -> "dict[Future[Any], _Running]":
        return {self.begun(task): _Running(task, time.monotonic())}


def _reason(task: Task, e: BaseException, seconds: float) -> str:
    """Why the process of a single trial died; one that no alarm can interrupt is ended by its own timer."""
    why = cause(e)
    if why == "exit code 1" and seconds > task.time_limit:
        return f"TimeLimit: longer than the time limit of {task.time_limit:g} s a trial; its process was ended"
    return f"the process that ran it died ({why})"


def _is_single(task: Task) -> bool:
    return len(task.estimators) == 1 and len(task.trials) == 1


def _split(task: Task) -> list[Task]:
    """By estimator; one estimator's, by trial."""
    if len(task.estimators) > 1:
        return [replace(task, estimators=(estimator,)) for estimator in task.estimators]
    return [replace(task, trials=range(trial, trial + 1)) for trial in task.trials]
