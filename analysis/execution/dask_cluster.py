"""A running Dask cluster as workers: the same tasks, through the same interface."""

import re
import threading
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from cooploc.analysis.execution.pool import Pool
from cooploc.analysis.execution.provenance import provenance
from cooploc.analysis.execution.task import MeasuredPart, Task, measure
from cooploc.estimators.plugins.errors import BadInput

PATIENCE = 5  # [s] for the scheduler to answer
_one_at_a_time = threading.Lock()


class DaskCluster(Pool):
    """The workers of a Dask scheduler."""

    def __init__(self, client: Any) -> None:
        from distributed.scheduler import KilledWorker

        self._executor: Executor = client.get_executor(pure=False)
        self.window = 2 * max(1, sum(client.nthreads().values()))
        self.deaths = (KilledWorker,)

    def executor(self) -> Executor:
        """The client's executor: Dask itself replaces dead workers and repeats their tasks."""
        return self._executor

    def function(self) -> Any:
        """What runs a task in a worker."""
        return measured_in_turn


def measured_in_turn(task: Task) -> list[MeasuredPart]:
    """All parts of a task; only one thread of a worker computes at a time, so that each task is timed alone."""
    with _one_at_a_time:
        return list(measure(task))


@contextmanager
def connected(address: str) -> Iterator[DaskCluster]:
    """A cluster whose workers give the bits that this machine would.

    Raises:
        BadInput: Dask is not installed, no scheduler answers, there are no workers, or they run other versions.

    """
    client = _client(address)
    try:
        _demand_same(client, address)
        yield DaskCluster(client)
    finally:
        client.close(timeout=1)


def _client(address: str) -> Any:
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise BadInput("--scheduler needs Dask, which is not installed: pip install 'cooploc[cluster]'") from None
    if not re.fullmatch(r"\w+://.+:\d+", address):
        raise BadInput(f"cannot read the scheduler's address {address!r}; write it like tcp://10.0.0.1:8786")
    try:
        return distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as e:
        raise BadInput(
            f"no Dask scheduler answers at {address} ({type(e).__name__}): start one, or correct the address"
        ) from None


def _demand_same(client: Any, address: str) -> None:
    """Refuse workers of other versions or source: they would give other bits, under the same name."""
    mine = provenance()
    theirs = client.run(provenance, on_error="return")
    if not theirs:
        raise BadInput(f"the Dask scheduler at {address} has no workers: start some (dask worker {address})")
    for worker, found in theirs.items():
        if not isinstance(found, dict):
            raise BadInput(f"the Dask worker {worker} cannot import cooploc ({found}): install it there")
        for key in ("versions", "source"):
            if found[key] != mine[key]:
                raise BadInput(f"the Dask worker {worker} has other {key} than this machine: install the same there")
