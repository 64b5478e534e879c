"""This process, or processes on this machine, as workers; what is not built in always has processes of its own."""

import pickle
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from typing import Any

from cooploc.analysis.execution.played import Played, made, play_all
from cooploc.analysis.execution.pool import Pool
from cooploc.analysis.execution.task import MeasuredPart, Task, died, measure, part_of
from cooploc.analysis.execution.walled import given, measured_here
from cooploc.scenarios import BUILTIN as IN_PROCESS
from cooploc.scenarios.processes.outcome import WorkerError
from cooploc.scenarios.processes.workers import BUILTIN, call, end, pool, submit
from cooploc.scenarios.stream import Stream, Truth


class ThisProcess:
    """No workers: tasks run here."""

    def compute(self, tasks: list[Task]) -> Iterator[MeasuredPart]:
        """The parts of every task, in order."""
        for task in tasks:
            yield from measure(task)


class LocalProcesses(Pool):
    """The processes of one owner on this machine."""

    def __init__(self, owner: str, jobs: int) -> None:
        self.owner, self.jobs = owner, jobs
        self.window = jobs + 1 if jobs > 1 else 1

    def executor(self) -> Executor:
        """The owner's processes; new ones where one of them died."""
        return pool(self.owner, self.jobs)

    def renew(self) -> None:
        end(self.owner)


class Walled(LocalProcesses):
    """The processes of one plug-in in worlds of ours: these are simulated and measured here, it only plays there."""

    def __init__(self, owner: str, jobs: int) -> None:
        super().__init__(owner, jobs)
        self.worlds: dict[Future[Any], tuple[Truth, Stream]] = {}

    def begun(self, task: Task) -> "Future[Any]":
        """A task's stream on its way to the plug-in; its truth stays."""
        truth, stream = task.scenario.simulate(task.trials, task.seed)
        sent = [given(one.label, stream, task.time_limit) for one in task.estimators]
        future = submit(self.owner, self.jobs, play_all, sent)
        self.worlds[future] = truth, stream
        return future

    def parts(self, task: Task, future: "Future[Any]") -> list[MeasuredPart]:
        """What the plug-in believed, measured against the truth."""
        world, outcome = self.worlds.pop(future), future.result()
        if outcome.raised:
            raise outcome.raised.error()
        played: list[list[Played]] = pickle.loads(outcome.value)
        pairs = zip(task.estimators, played, strict=True)
        return [part_of(task, one, measured_here(one.label, *world, found)) for one, found in pairs]


class ThisMachine:
    """Built-in code in this process, or in as many as there are jobs; every plug-in in as many of its own."""

    def __init__(self, jobs: int, keep: bool = False) -> None:
        self.jobs, self.keep = jobs, keep  # whether a plug-in's processes wait for its next tasks

    def compute(self, tasks: list[Task]) -> Iterator[MeasuredPart]:
        """The parts of every task, owner by owner."""
        of: dict[str, list[Task]] = {BUILTIN: []}
        for task in (part for whole in tasks for part in whole.by_owner()):
            of.setdefault(task.owner, []).append(task)
        yield from self._builtin(of.pop(BUILTIN))
        for owner, mine in of.items():
            yield from self._foreign(owner, mine)

    def _builtin(self, tasks: list[Task]) -> Iterator[MeasuredPart]:
        if self.jobs == 1:
            return ThisProcess().compute(tasks)
        return LocalProcesses(BUILTIN, self.jobs).compute(tasks)

    def _foreign(self, owner: str, tasks: list[Task]) -> Iterator[MeasuredPart]:
        """The parts of a plug-in's tasks; an estimator that cannot be imported or made costs its process once."""
        labels = dict.fromkeys(one.label for task in tasks for one in task.estimators if not one.builtin)
        reasons = {label: unmade(owner, label, tasks[0].time_limit) for label in labels}
        left = []
        for task in tasks:
            for one in task.estimators:
                if reason := reasons.get(one.label):
                    yield died(task.only((one,)), reason)
            if alive := tuple(one for one in task.estimators if not reasons.get(one.label)):
                left.append(task.only(alive))
        ours = [task for task in left if task.scenario.name in IN_PROCESS]
        yield from Walled(owner, self.jobs).compute(ours)
        yield from LocalProcesses(owner, self.jobs).compute([task for task in left if task not in ours])
        if not self.keep:
            end(owner)


def unmade(owner: str, label: str, seconds: float) -> str:
    """Why an estimator's process does not live through its import and `__init__`; empty where it does."""
    try:
        call(owner, made, label, seconds)
    except WorkerError as e:
        return f"it cannot be imported or made: {e}"
    except Exception:  # its trials record it, with its traceback
        return ""
    return ""
