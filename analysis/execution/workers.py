"""Where tasks run: in this process, in local processes, or on a Dask cluster."""

from collections.abc import Iterator
from contextlib import contextmanager

from cooploc.analysis.execution.dask_cluster import connected
from cooploc.analysis.execution.local_workers import LocalProcesses, ThisProcess
from cooploc.analysis.execution.pool import Workers
from cooploc.estimators.plugins.errors import BadInput


@contextmanager
def hired(jobs: int, scheduler: str | None) -> Iterator[Workers]:
    """Workers for a run.

    Raises:
        BadInput: fewer than one job, or no cluster at the address.

    """
    if jobs < 1:
        raise BadInput(f"jobs is {jobs}; it must be at least 1")
    if scheduler is not None:
        with connected(scheduler) as cluster:
            yield cluster
    elif jobs == 1:
        yield ThisProcess()
    else:
        local = LocalProcesses(jobs)
        try:
            yield local
        except BaseException:
            local.stop()
            raise
