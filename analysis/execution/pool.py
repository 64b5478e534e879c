"""Workers behind a `concurrent.futures.Executor`, and what to do when one of them dies.

Only a few tasks more than there are workers run at a time. When a worker dies, these are the suspects: each is tried
again alone, then in halves, until what kills its worker is one trial of one estimator, which is a failure like any
other.
"""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import replace
from typing import Any, Protocol

from cooploc.analysis.execution.task import MeasuredPart, Task, died, measured


class Workers(Protocol):
    """Some place where tasks run."""

    def compute(self, tasks: list[Task]) -> Iterator[MeasuredPart]:
        """The parts of every task, in any order."""
        ...


class Pool(ABC):
    """An executor that can be replaced after a worker's death broke it."""

    window: int  # tasks that may run or wait at a time
    deaths: tuple[type[BaseException], ...] = (BrokenExecutor,)

    @abstractmethod
    def executor(self) -> Executor:
        """A working executor."""

    def function(self) -> Any:
        """What runs a task in a worker."""
        return measured

    def compute(self, tasks: list[Task]) -> Iterator[MeasuredPart]:
        """The parts of every task, as they come."""
        waiting, suspects = deque(tasks), deque[Task]()
        running: dict[Future[list[MeasuredPart]], Task] = {}
        alone = False
        while waiting or suspects or running:
            if not running and suspects:
                running |= self._submitted(suspects.popleft())
                alone = True
            elif not suspects:
                alone = False
                while waiting and len(running) < self.window:
                    running |= self._submitted(waiting.popleft())
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                task = running.pop(future)
                try:
                    yield from future.result()
                except self.deaths:
                    if alone and _is_single(task):
                        yield died(task, "the process that ran it died (killed, crashed, or out of memory)")
                    else:
                        suspects.extend(_split(task) if alone else [task])

    def _submitted(self, task: Task) -> dict[Future[list[MeasuredPart]], Task]:
        return {self.executor().submit(self.function(), task): task}


def _is_single(task: Task) -> bool:
    return len(task.estimators) == 1 and len(task.trials) == 1


def _split(task: Task) -> list[Task]:
    """By estimator; one estimator's, in halves of its trials."""
    if len(task.estimators) > 1:
        return [replace(task, estimators=(estimator,)) for estimator in task.estimators]
    if len(task.trials) == 1:
        return [task]
    half = len(task.trials) // 2
    return [replace(task, trials=trials) for trials in (task.trials[:half], task.trials[half:])]
