"""Text for a terminal: what could move its cursor, change its colours or hide text is shown as what it is."""

import shlex
import time
import unicodedata
from html import escape
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from cooploc.analysis.formats import duration

HIDDEN = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}  # Unicode's control, format, surrogate, private, separating
KEPT = {"\n", "\t"}


def in_shell(text: object) -> str:
    """Return a path or a label as a shell takes it, in quotes where it has blanks or brackets."""
    return shlex.quote(str(text))


def escape_controls(text: str) -> str:
    r"""Return the text with every control character written out, such as \x1b."""
    hidden = {c for c in text if c not in KEPT and unicodedata.category(c) in HIDDEN}
    return "".join(c.encode("unicode_escape").decode("ascii") if c in hidden else c for c in text)


class PlainConsole(Console):
    """A console that shows text as it is: no markup, no guessed colours, no control characters."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Return text, wherever rich meets it: a line, a cell, a title."""
        return super().render_str(escape_controls(text), **options)


PIPED, UNLIMITED = 100, 400  # characters that a table may be wide in a file or a pipe; with every column
OF_A_CELL = 100  # in a notebook


def make_console(stderr: bool = False, every: bool = False) -> Console:
    """Return a console as wide as the terminal or a notebook, which breaks lines between words.

    In a file or a pipe sentences are as long as they are, for other programs, and tables as wide as a page, or, with
    `every` column, as they need.
    """
    console = PlainConsole(stderr=stderr)
    if console.is_jupyter:
        return PlainConsole(width=OF_A_CELL)
    if console.is_terminal:
        return console
    return PlainConsole(stderr=stderr, soft_wrap=True, width=UNLIMITED if every else PIPED)


GOES_ON = "interrupted: what was finished is kept, and the same call goes on from there"
STARTING = "starting; the first time, it compiles"
LINE_EVERY, SHOW_EVERY = 5.0, 0.5  # [s] of lines, and of what a notebook displays in one place


def _in_notebook(line: str, share: float | None = None) -> dict[str, str]:
    """Return a line as a notebook displays it, with a bar in front."""
    bar = f'<progress value="{share:.3f}"></progress> ' if share is not None else ""
    return {"text/plain": line, "text/html": f"{bar}{escape(line)}"}


class TerminalProgress:
    """Counts (estimator, trial) pairs: a bar on a terminal or in a notebook, else a line on stderr now and then."""

    def __init__(self, interrupted: str = GOES_ON) -> None:
        self._interrupted = interrupted  # what a notebook then says
        self.total, self.done, self.failed, self._said = 0, 0, 0, time.monotonic()
        self._console = make_console(stderr=True)
        text = TextColumn("{task.description}", markup=False)
        columns = (BarColumn(bar_width=16), MofNCompleteColumn(), TimeRemainingColumn(compact=True), text)
        self._bar = Progress(*columns, console=self._console, transient=True, disable=not self._console.is_terminal)
        self._task = self._bar.add_task(STARTING, total=None)
        self._notebook: Any = None  # the handle of what it displays

    def __enter__(self) -> "TerminalProgress":
        self._bar.start()
        if self._console.is_jupyter:
            from IPython.display import display

            self._notebook = display(_in_notebook(STARTING), raw=True, display_id=True)
        return self

    def __exit__(self, kind: type | None, *_: object) -> None:
        self._bar.stop()
        if self._notebook:
            self._notebook.update(_in_notebook(self._interrupted if kind is KeyboardInterrupt else ""), raw=True)

    def begin(self, trials: int, found: int) -> None:
        """Start: (estimator, trial) pairs in all, and those found on disk already."""
        if found and not self.total:  # not at every look of a run until decided
            self.say(f"{found} of {trials} trials are on disk already")
        self._bar.reset(self._task, total=trials, completed=found, description="" if self.total else STARTING)
        self.total, self.done = trials, found

    def advance(self, what: str, trials: int, failed: int) -> None:
        """Take note of a finished part."""
        self.done, self.failed = self.done + trials, self.failed + failed
        text = f"{f'{self.failed} failed, ' if self.failed else ''}{escape_controls(what)}"
        self._bar.update(self._task, completed=self.done, description=text)
        if not self._bar.disable or time.monotonic() - self._said < (SHOW_EVERY if self._notebook else LINE_EVERY):
            return
        self._said, line = time.monotonic(), f"{self.done} of {self.total} trials ({text})"
        if self._notebook:
            left = self._bar.tasks[0].time_remaining
            line += f", about {duration(left)} left" if left else ""
            self._notebook.update(_in_notebook(line, self.done / max(self.total, 1)), raw=True)
        else:
            self.say(line)

    def say(self, line: str) -> None:
        """Print something that the user should know, above the bar."""
        self._console.print(line)
