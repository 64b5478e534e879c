"""Where tasks run: in this process, in local processes, or on a Dask cluster."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from cooploc.analysis.execution.dask_cluster import connected
from cooploc.analysis.execution.local_workers import ThisMachine, ThisProcess
from cooploc.analysis.execution.pool import Workers
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.processes.workers import BUILTIN, SESSION, end_all

MOST_JOBS = 1024


@contextmanager
def hired(
    jobs: int, scheduler: str | None, isolate: bool, say: Callable[[str], None], keep: bool = False
) -> Iterator[Workers]:
    """Workers for a run; without `isolate` it is this process alone; with `keep`, plug-ins' processes wait for more.

    Raises:
        BadInput: fewer than one job, no cluster at the address, or several processes that are to be one.

    """
    if not 1 <= jobs <= MOST_JOBS:
        raise BadInput(f"jobs is {jobs}; it must be at least 1, and at most {MOST_JOBS}")
    if not isolate and (jobs > 1 or scheduler is not None):
        other = "--scheduler" if scheduler is not None else f"--jobs {jobs}"
        raise BadInput(f"--no-isolate keeps everything in one process, and {other} asks for others: leave one out")
    kept: tuple[str, ...] = SESSION, BUILTIN  # for the next run
    try:
        if scheduler is not None:
            with connected(scheduler, say) as cluster:
                yield cluster
        else:
            yield ThisMachine(jobs, keep) if isolate else ThisProcess()
    except BaseException:
        kept = (SESSION,)
        raise
    finally:
        end_all(but=kept)
