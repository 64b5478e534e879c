"""The progress of a run on stderr: a bar on a terminal, a line now and then elsewhere."""

import sys
import time

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

LINE_EVERY = 5.0  # [s]


class Watch:
    """Counts (estimator, trial) pairs; a context manager around the run."""

    def __init__(self, total: int) -> None:
        self.total, self.done, self.failed = total, 0, 0
        self._began = self._said = time.monotonic()
        console = Console(stderr=True)
        what = TextColumn("{task.description:.40}")
        columns = (BarColumn(bar_width=16), MofNCompleteColumn(), TimeRemainingColumn(), what)
        self._bar = Progress(*columns, console=console, transient=True) if console.is_terminal else None

    def __enter__(self) -> "Watch":
        if self._bar:
            self._bar.start()
            self._task = self._bar.add_task("starting", total=self.total)
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar:
            self._bar.stop()

    def advance(self, what: str, trials: int, failed: int) -> None:
        """Take note of a finished part."""
        self.done, self.failed = self.done + trials, self.failed + failed
        trouble = f", {self.failed} failed" if self.failed else ""
        if self._bar:
            self._bar.update(self._task, completed=self.done, description=what + trouble)
        elif time.monotonic() - self._said > LINE_EVERY:
            self._said = time.monotonic()
            print(f"{self.done} of {self.total} trials{self._left()}{trouble} ({what})", file=sys.stderr, flush=True)

    def _left(self) -> str:
        """An estimate of the time left, once enough is done that start-up no longer decides it."""
        if self.done < 0.1 * self.total:
            return ""
        left = (self._said - self._began) / self.done * (self.total - self.done)
        return f", about {left:.0f} s left"
