"""A running Dask cluster as workers: the same tasks, through the same interface."""

import asyncio
import logging
import multiprocessing
import re
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import contextmanager
from importlib import import_module
from typing import Any, NamedTuple

from cooploc.analysis.execution.local_workers import ThisMachine
from cooploc.analysis.execution.pool import Pool
from cooploc.analysis.execution.provenance import bits
from cooploc.analysis.execution.task import MeasuredPart, Task, measure
from cooploc.estimators.errors import BadInput, one_line
from cooploc.scenarios.processes.workers import end_all

PATIENCE = 5  # [s] for the scheduler to answer
LOOK = 2.0  # [s] between looks at a cluster that gives no results
ALONE = 8.0, 60.0  # [s] without any worker before that is said, and between repetitions
REMEDY = {
    "versions": "install the same there",
    "source": "install the same there",
    "instructions": "use workers of one kind of processor, with the same flags",
}
_one_at_a_time = threading.Lock()
_machine = ThisMachine(1, keep=True)  # of a worker


class FarParts(NamedTuple):
    """The results of a task, the worker that computed them, and what the bits of its results depend on."""

    worker: str
    bits: dict[str, Any]
    parts: list[MeasuredPart]


class DaskCluster(Pool):
    """The workers of a Dask scheduler."""

    def __init__(self, client: Any, address: str, say: Callable[[str], None]) -> None:
        from distributed.scheduler import KilledWorker

        self._client, self._address, self._say = client, address, say
        self._executor: Executor = client.get_executor(pure=False)
        self._mine = bits()
        self.window = 2 * max(1, sum(client.nthreads().values()))
        self.deaths = (KilledWorker,)
        self.function = measured_in_turn

    def executor(self) -> Executor:
        """The client's executor: Dask itself replaces dead workers and repeats their tasks."""
        return self._executor

    def compute(self, tasks: list[Task]) -> Iterator[MeasuredPart]:
        """The parts of every task, as they come; each task is of one owner, so that its worker isolates it."""
        return super().compute([one for task in tasks for one in task.by_owner()])

    def parts(self, task: Task, future: "Future[Any]") -> list[MeasuredPart]:
        """The results of a task, from a worker that gives the same bits as this machine.

        Raises:
            BadInput: the worker is unlike this machine, or cannot run the task at all.

        """
        try:
            found: FarParts = future.result()
        except (asyncio.CancelledError, CancelledError):
            raise BadInput(_gone(self._address)) from None
        except (ImportError, AttributeError) as e:
            raise BadInput(f"a worker of {self._address} cannot run cooploc ({one_line(e)}): install it there") from e
        demand_like(found.worker, found.bits, self._mine)
        return found.parts

    def first(self, running: Any) -> Any:
        """Those that are done, at least one; says so where no worker is left.

        Raises:
            BadInput: the scheduler is gone.

        """
        alone, said = 0.0, float("-inf")
        while not (done := wait(running, timeout=LOOK, return_when=FIRST_COMPLETED).done):
            if self._client.status != "running":
                raise BadInput(_gone(self._address))
            alone = 0.0 if self._workers() else alone or time.monotonic()
            now = time.monotonic()
            if alone and now - alone > ALONE[0] - LOOK and now - said > ALONE[1]:
                said = now
                self._say(f"the Dask cluster at {self._address} has no workers: waiting for one (dask worker ...)")
        return done

    def _workers(self) -> int:
        try:
            return len(self._client.nthreads())
        except Exception as e:  # whatever a connection raises while it is being lost
            raise BadInput(_gone(self._address)) from e


def measured_in_turn(task: Task) -> FarParts:
    """All parts of a task; only one thread of a worker computes at a time, so that each task is timed alone."""
    from distributed import get_worker

    with _one_at_a_time:
        if not task.owner:
            return FarParts(get_worker().address, bits(), list(measure(task)))
        # Dask's workers are daemons, which may have no children; ours end with their parent.
        multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]
        end_all(but=(task.owner,))
        return FarParts(get_worker().address, bits(), list(_machine.compute([task])))


@contextmanager
def connected(address: str, say: Callable[[str], None]) -> Iterator[DaskCluster]:
    """A cluster whose workers give the bits that this machine would.

    Raises:
        BadInput: Dask is not installed, no scheduler answers, there are no workers, or they run other versions.

    """
    client = _client(address)
    try:
        _demand_same(client, address)
        yield DaskCluster(client, address, say)
    finally:
        client.close(timeout=1)


def _client(address: str) -> Any:
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise BadInput("--scheduler needs Dask, which is not installed: pip install 'cooploc[cluster]'") from None
    if not re.fullmatch(r"\w+://.+:\d+", address):
        raise BadInput(f"cannot read the scheduler's address {address!r}; write it like tcp://10.0.0.1:8786")
    for name in ("distributed", "distributed.client", "distributed.utils", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what they complain of is said in one line
    try:
        return distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as e:
        raise BadInput(
            f"no Dask scheduler answers at {address} ({type(e).__name__}): start one, or correct the address"
        ) from None


def _demand_same(client: Any, address: str) -> None:
    """Refuse workers of other versions, source or processors: they would give other bits, under the same name."""
    theirs = client.run(bits, on_error="return")
    if not theirs:
        raise BadInput(f"the Dask scheduler at {address} has no workers: start some (dask worker {address})")
    for worker, found in theirs.items():
        if not isinstance(found, dict):
            raise BadInput(f"the Dask worker {worker} cannot import cooploc ({found}): install it there")
        demand_like(worker, found, bits())


def demand_like(worker: str, theirs: dict[str, Any], mine: dict[str, Any]) -> None:
    """Refuse the results of a worker that has other versions, another source or another processor.

    Raises:
        BadInput: it would give other bits than this machine; says what differs.

    """
    for key in mine:
        if theirs.get(key) != mine[key]:
            raise BadInput(f"the Dask worker {worker} has other {key} than this machine: {REMEDY[key]}")


def _gone(address: str) -> str:
    return f"the Dask scheduler at {address} is gone; what was finished is kept: start it, and the same command goes on"
