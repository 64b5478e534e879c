"""A time limit for an estimator, however it hangs, and for each trial though many run at once.

Trials that run together share their calls. So one call of a method may take as long as one trial may, and all calls
together as long as the trials may that are done by then: one that hangs is noticed after one limit. Whoever is late in
company is tried again alone.
"""

import faulthandler
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

GRACE = 20.0  # [s] after which a process that cannot be interrupted is ended
LONGEST = 1e7  # [s] beyond which a limit is none, as no timer goes so far
# [s] Not interrupted half way, as nothing would work afterwards: compiling, and importing.
PATIENCE = {"numba.": 600.0, "llvmlite.": 600.0, "importlib.": 60.0}


class TimeLimit(BaseException):
    """An estimator took longer than it may; what catches every `Exception` does not catch it."""


class Limit(NamedTuple):
    """How long an estimator may take."""

    seconds: float  # for each trial
    end_process: bool  # whether its process may be ended, where nothing else stops it


@contextmanager
def within(limit: Limit, trials: int = 1, ticks: int = 1) -> Iterator[Callable[..., Any]]:
    """Limits the time of its block; yields a `Watcher` that looks at the clock at every call of the estimator.

    An alarm interrupts a call that does not return, where there are alarms (in a main thread); what an alarm cannot
    interrupt, such as a loop in compiled code, ends with its process where that may be ended.

    Raises:
        TimeLimit: the block took longer.

    """
    clock = _Clock(limit, trials, ticks)
    before = signal.signal(signal.SIGALRM, clock.ring) if clock.alarms else None
    try:
        clock.arm()
        yield clock.watch
    finally:
        clock.disarm()
        if clock.alarms:
            signal.signal(signal.SIGALRM, before)


class _Clock:
    """The timers of one block."""

    def __init__(self, limit: Limit, trials: int, ticks: int) -> None:
        self.limit, self.trials, self.ticks = limit, trials, ticks
        self.began = self.armed = time.monotonic()
        timed = limit.seconds < LONGEST
        self.alarms = timed and threading.current_thread() is threading.main_thread() and hasattr(signal, "setitimer")
        self.ends = timed and limit.end_process
        self.slack = min(1.0, limit.seconds / 10) if trials > 1 else float("inf")  # [s] between settings of the timers

    def watch(self, method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        now = time.monotonic()
        if now - self.began > self.limit.seconds * (1 + (self.trials - 1) * (tick + 1) / self.ticks):
            self.late()
        if now - self.armed > self.slack:
            self.arm()
        return call(*arguments)

    def arm(self) -> None:
        """Set the timers for one trial's limit from now."""
        self.armed = time.monotonic()
        seconds = self.limit.seconds + (self.slack if self.trials > 1 else 0)
        if self.alarms:
            signal.setitimer(signal.ITIMER_REAL, seconds)
        if self.ends:
            faulthandler.dump_traceback_later(seconds + GRACE, exit=True, file=_nowhere())

    def disarm(self) -> None:
        if self.alarms:
            signal.setitimer(signal.ITIMER_REAL, 0)
        if self.ends:
            faulthandler.cancel_dump_traceback_later()

    def ring(self, _: int, frame: FrameType | None) -> None:
        if time.monotonic() - self.began < self.limit.seconds + _patience(frame):
            self.arm()
        else:
            self.late()

    def late(self) -> None:
        raise TimeLimit(f"longer than the time limit of {self.limit.seconds:g} s a trial")


def _patience(frame: FrameType | None) -> float:
    """How long what was interrupted may still go on [s]: an import or a compilation, and nothing else."""
    longest = 0.0
    while frame is not None:
        module = str(frame.f_globals.get("__name__", "")).removeprefix("_frozen_")
        longest = max(longest, *(seconds for start, seconds in PATIENCE.items() if f"{module}.".startswith(start)), 0.0)
        frame = frame.f_back
    return longest


_opened: list[Any] = []


def _nowhere() -> Any:
    """Where the traceback of a process that is ended goes: its failure is told in the trial's row."""
    if not _opened:
        _opened.append(Path(os.devnull).open("w"))  # noqa: SIM115
    return _opened[0]
