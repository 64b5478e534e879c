"""A time limit for an estimator, however it hangs."""

import faulthandler
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

GRACE = 30.0  # [s] beyond twice the limit, after which a process that cannot be interrupted is ended


class TimeLimit(Exception):
    """An estimator took longer than it may."""


class Limit(NamedTuple):
    """How long an estimator may take."""

    seconds: float  # for each trial
    end_process: bool  # whether its process may be ended, where nothing else stops it


@contextmanager
def within(limit: Limit, trials: int) -> Iterator[Callable[..., Any]]:
    """Limits the time of its block; yields a `Watcher` that looks at the clock at every call of the estimator.

    An alarm interrupts a call that does not return, where there are alarms (in a main thread); what an alarm cannot
    interrupt, such as a loop in compiled code, ends with its process where that may be ended.

    Raises:
        TimeLimit: the block took longer.

    """
    allowed = limit.seconds * trials
    end = time.monotonic() + allowed

    def late(*_: object) -> None:
        raise TimeLimit(f"longer than the time limit of {limit.seconds:g} s a trial")

    def watch(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        if time.monotonic() > end:
            late()
        return call(*arguments)

    alarm = threading.current_thread() is threading.main_thread() and hasattr(signal, "setitimer")
    before = signal.signal(signal.SIGALRM, late) if alarm else None
    if alarm:
        signal.setitimer(signal.ITIMER_REAL, allowed)
    if limit.end_process:
        faulthandler.dump_traceback_later(2 * allowed + GRACE, exit=True)
    try:
        yield watch
    finally:
        if limit.end_process:
            faulthandler.cancel_dump_traceback_later()
        if alarm:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
