"""Text for a terminal: what could move its cursor, change its colours or hide text is shown as what it is."""

import re
import sys
import time
import unicodedata
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.text import Text

from cooploc.analysis.formats import duration

HIDDEN = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}  # Unicode's control, format, surrogate, private, separating
KEPT = {"\n", "\t"}
PLAIN = re.compile(r"[\n\t\x20-\x7e]*")


def visible(text: str) -> str:
    r"""Return the text with every control character written out, such as \x1b."""
    if PLAIN.fullmatch(text):
        return text
    shown = (c in KEPT or unicodedata.category(c) not in HIDDEN for c in text)
    return "".join(
        c if plain else c.encode("unicode_escape").decode("ascii") for c, plain in zip(text, shown, strict=True)
    )


# The consoles that commands print on.


class PlainConsole(Console):
    """A console that shows text as it is: no markup, no guessed colours, no control characters."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Return text, wherever rich meets it: a line, a cell, a title."""
        return super().render_str(visible(text), **options)


PIPED, UNLIMITED = 100, 400  # characters that a table may be wide in a file or a pipe; with every column


def wide(stderr: bool = False, every: bool = False) -> Console:
    """Return a console as wide as the terminal, which breaks lines between words.

    In a file or a pipe sentences are as long as they are, for other programs, and tables as wide as a page, or, with
    `every` column, as they need.
    """
    console = PlainConsole(stderr=stderr)
    if console.is_terminal:
        return console
    return PlainConsole(stderr=stderr, soft_wrap=True, width=UNLIMITED if every else PIPED)


# The progress of a run on stderr: a bar on a terminal, a line now and then elsewhere.

LINE_EVERY = 5.0  # [s]
ENOUGH, LONG = 0.1, 60.0  # share of the trials, or [s], before which compilation hides how fast a run is


class TerminalProgress:
    """Counts (estimator, trial) pairs; a context manager around the run."""

    def __init__(self) -> None:
        self.total, self.found, self.done, self.failed = 0, 0, 0, 0
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
        if found and not self.total:  # not at every look of a run until decided
            self.say(f"{found} of {trials} trials are on disk already")
        self.total, self.found, self.done = trials, found, found
        self._began = self._said = time.monotonic()
        if self._bar:
            self._bar.update(self._task, total=trials, completed=found, description="")

    def advance(self, what: str, trials: int, failed: int) -> None:
        """Take note of a finished part."""
        self.done, self.failed = self.done + trials, self.failed + failed
        share = (self.done - self.found) / max(1, self.total - self.found)
        spent = time.monotonic() - self._began
        left = f", about {duration(spent * (1 - share) / share)} left" if share > ENOUGH or spent > LONG else ""
        text = f"{left}{f', {self.failed} failed' if self.failed else ''} ({visible(what)})"
        if self._bar:
            self._bar.update(self._task, completed=self.done, description=text)
        elif time.monotonic() - self._said > LINE_EVERY:
            self._said = time.monotonic()
            print(f"{self.done} of {self.total} trials{text}", file=sys.stderr, flush=True)

    def say(self, line: str) -> None:
        """Print something that the user should know, above the bar."""
        self._console.print(line)
