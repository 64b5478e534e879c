"""Where tasks run: in this process, in local processes, or on a Dask cluster."""

from collections.abc import Iterator
from contextlib import contextmanager

from cooploc.analysis.execution.dask_cluster import connected
from cooploc.analysis.execution.local_workers import LocalProcesses, ThisProcess
from cooploc.analysis.execution.pool import Workers
from cooploc.estimators.plugins.errors import BadInput

MOST_JOBS = 1024


@contextmanager
def hired(jobs: int, scheduler: str | None) -> Iterator[Workers]:
    """Workers for a run.

    Raises:
        BadInput: fewer than one job, or no cluster at the address.

    """
    if not 1 <= jobs <= MOST_JOBS:
        raise BadInput(f"jobs is {jobs}; it must be at least 1, and at most {MOST_JOBS}")
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
