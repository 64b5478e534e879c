"""The progress of a run on stderr: a bar on a terminal, a line now and then elsewhere."""

import sys
import time

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from cooploc.analysis.formats import duration
from cooploc.terminal.console import wide
from cooploc.terminal.visible import visible

LINE_EVERY = 5.0  # [s]
ENOUGH = 0.02  # of the processor time, before which the time left cannot be estimated


class TerminalProgress:
    """Counts (estimator, trial) pairs; a context manager around the run."""

    def __init__(self) -> None:
        self.total, self.done, self.failed = 0, 0, 0
        self._share = 0.0  # of the processor time
        self._began = self._said = time.monotonic()
        self._console = wide(stderr=True)
        columns = (BarColumn(bar_width=16), MofNCompleteColumn(), TextColumn("trials{task.description}", markup=False))
        self._bar = Progress(*columns, console=self._console, transient=True) if self._console.is_terminal else None

    def __enter__(self) -> "TerminalProgress":
        if self._bar:
            self._bar.start()
            self._task = self._bar.add_task(", starting", total=None)
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar:
            self._bar.stop()

    def compiling(self) -> None:
        """Say that the wait is for kernels, and that it is not for every run."""
        if self._bar:
            self._bar.update(self._task, description=", compiling, once")

    def begin(self, trials: int, found: int) -> None:
        """Start: (estimator, trial) pairs in all, and those found on disk already."""
        self.total, self.done, self._share = trials, found, 0.0
        self._began = self._said = time.monotonic()
        if self._bar:
            self._bar.update(self._task, total=trials, completed=found, description="")
        if found:
            self.say(f"{found} of {trials} trials are on disk already")

    def advance(self, what: str, trials: int, failed: int, share: float) -> None:
        """Take note of a finished part, and of the share of the processor time that is spent by now."""
        self.done, self.failed, self._share = self.done + trials, self.failed + failed, share
        trouble = f", {self.failed} failed" if self.failed else ""
        text = f"{self._left()}{trouble} ({visible(what)})"
        if self._bar:
            self._bar.update(self._task, completed=self.done, description=text)
        elif time.monotonic() - self._said > LINE_EVERY:
            self._said = time.monotonic()
            print(f"{self.done} of {self.total} trials{text}", file=sys.stderr, flush=True)

    def say(self, line: str) -> None:
        """Print something that the user should know, above the bar."""
        self._console.print(line)

    def seconds_left(self) -> float | None:
        """An estimate by the share that is spent; None before there is enough of it."""
        share = self._share
        return None if share < ENOUGH else (time.monotonic() - self._began) * (1 - share) / share

    def _left(self) -> str:
        seconds = self.seconds_left()
        return "" if seconds is None else f", about {duration(seconds)} left"
