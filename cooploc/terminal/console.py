"""Text for a terminal: what could move its cursor, change its colours or hide text is shown as what it is."""

import time
import unicodedata
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

HIDDEN = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}  # Unicode's control, format, surrogate, private, separating
KEPT = {"\n", "\t"}


def visible(text: str) -> str:
    r"""Return the text with every control character written out, such as \x1b."""
    hidden = {c for c in text if c not in KEPT and unicodedata.category(c) in HIDDEN}
    return "".join(c.encode("unicode_escape").decode("ascii") if c in hidden else c for c in text)


class PlainConsole(Console):
    """A console that shows text as it is: no markup, no guessed colours, no control characters."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Return text, wherever rich meets it: a line, a cell, a title."""
        return super().render_str(visible(text), **options)


PIPED, UNLIMITED = 100, 400  # characters that a table may be wide in a file or a pipe; with every column


def make_console(stderr: bool = False, every: bool = False) -> Console:
    """Return a console as wide as the terminal, which breaks lines between words.

    In a file or a pipe sentences are as long as they are, for other programs, and tables as wide as a page, or, with
    `every` column, as they need.
    """
    console = PlainConsole(stderr=stderr)
    if console.is_terminal:
        return console
    return PlainConsole(stderr=stderr, soft_wrap=True, width=UNLIMITED if every else PIPED)


LINE_EVERY = 5.0  # [s]


class TerminalProgress:
    """Counts (estimator, trial) pairs on stderr, in a bar on a terminal, else in a line now and then."""

    def __init__(self) -> None:
        self.total, self.done, self.failed, self._said = 0, 0, 0, time.monotonic()
        self._console = make_console(stderr=True)
        text = TextColumn("{task.description}", markup=False)
        columns = (BarColumn(bar_width=16), MofNCompleteColumn(), TimeRemainingColumn(compact=True), text)
        self._bar = Progress(*columns, console=self._console, transient=True, disable=not self._console.is_terminal)
        self._task = self._bar.add_task("starting", total=None)

    def __enter__(self) -> "TerminalProgress":
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def begin(self, trials: int, found: int) -> None:
        """Start: (estimator, trial) pairs in all, and those found on disk already."""
        if found and not self.total:  # not at every look of a run until decided
            self.say(f"{found} of {trials} trials are on disk already")
        self.total, self.done = trials, found
        self._bar.reset(self._task, total=trials, completed=found, description="")

    def advance(self, what: str, trials: int, failed: int) -> None:
        """Take note of a finished part."""
        self.done, self.failed = self.done + trials, self.failed + failed
        text = f"{f'{self.failed} failed, ' if self.failed else ''}{visible(what)}"
        self._bar.update(self._task, completed=self.done, description=text)
        if self._bar.disable and time.monotonic() - self._said > LINE_EVERY:
            self._said = time.monotonic()
            self.say(f"{self.done} of {self.total} trials ({text})")

    def say(self, line: str) -> None:
        """Print something that the user should know, above the bar."""
        self._console.print(line)
