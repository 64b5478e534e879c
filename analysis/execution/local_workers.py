"""This process, or processes on this machine, as workers."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from typing import Any

from cooploc.analysis.execution.pool import Pool
from cooploc.analysis.execution.task import MeasuredPart, Task, measure

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")


class ThisProcess:
    """No workers: tasks run here."""

    def compute(self, tasks: list[Task]) -> Iterator[MeasuredPart]:
        """The parts of every task, in order."""
        for task in tasks:
            yield from measure(task)


class LocalProcesses(Pool):
    """Processes on this machine."""

    def __init__(self, jobs: int) -> None:
        self.jobs, self.window = jobs, jobs + 1
        self._pool: Any = None

    def executor(self) -> Executor:
        """The pool; a new one where a worker died."""
        from loky import get_reusable_executor

        begin = {"initializer": begin_worker, "initargs": (os.getpid(),)}
        self._pool = get_reusable_executor(max_workers=self.jobs, env=ONE_THREAD, **begin)
        pool: Executor = self._pool
        return pool

    def stop(self) -> None:
        """End the processes, whatever they do."""
        if self._pool is not None:
            self._pool.shutdown(kill_workers=True)


def begin_worker(parent: int) -> None:
    """Leave Ctrl-C to the parent process, and end when it ends, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
