"""Tables and a progress bar for notebooks, in HTML with everything escaped.

The bar needs only the IPython that every notebook has. Elsewhere, and in the first second, nothing is shown.
"""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from html import escape
from time import monotonic
from typing import Any


def facts_table(title: str, rows: Iterable[tuple[str, object]]) -> str:
    """A caption and lines of (what, value)."""
    body = "".join(
        f'<tr><th style="text-align:left">{escape(what)}</th><td style="text-align:left">{escape(str(value))}</td></tr>'
        for what, value in rows
    )
    return f'<table><caption style="text-align:left">{escape(title)}</caption>{body}</table>'


def list_table(header: tuple[str, ...], title: str, rows: Iterable[tuple[object, ...]]) -> str:
    """A caption, and lines under a header."""
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    body = "".join(f"<tr>{''.join(f'<td>{escape(str(cell))}</td>' for cell in row)}</tr>" for row in rows)
    return f'<table><caption style="text-align:left">{escape(title)}</caption><tr>{head}</tr>{body}</table>'


PATIENCE = 1.0  # [s] before anything is shown
EVERY = 0.2  # [s] between two pictures of the bar

Advance = Callable[[str, int], None]  # what runs now, and how many of its steps were done


@contextmanager
def bar(total: int) -> Iterator[Advance | None]:
    """Yields a function to call as some of `total` steps are done; None outside notebooks."""
    display = _display()
    if display is None:
        yield None
        return
    shown = _Bar(total, display)
    try:
        yield shown.advance
    finally:
        shown.close()


class _Bar:
    def __init__(self, total: int, display: Any) -> None:
        self._total, self._done, self._display = total, 0, display
        self._began = monotonic()
        self._next = self._began + PATIENCE
        self._handle: Any = None

    def advance(self, what: str, steps: int) -> None:
        self._done += steps
        now = monotonic()
        if now >= self._next:
            self._next = now + EVERY
            self._show(_progress_html(what, self._done, self._total, now - self._began))

    def close(self) -> None:
        """Leave nothing behind."""
        if self._handle is not None:
            self._show("")

    def _show(self, html: str) -> None:
        data = {"text/html": html, "text/plain": ""}
        if self._handle is None:
            self._handle = self._display(data, raw=True, display_id=True)
        else:
            self._handle.update(data, raw=True)


def _progress_html(what: str, done: int, total: int, seconds: float) -> str:
    left = seconds * (total - done) / done
    rest = f"{left:.0f} s" if left < 90 else f"{left / 60:.0f} min"
    return f'<progress value="{done}" max="{total}"></progress> {escape(what)}, about {rest} left'


def _display() -> Any:
    """IPython's `display`, in a notebook; else None."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if shell is None or not hasattr(shell, "kernel"):
        return None
    from importlib import import_module

    return import_module("IPython.display").display
