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
    """Return a caption and lines of (what, value)."""
    left = 'style="text-align:left"'
    body = "".join(
        f"<tr><th {left}>{escape(what)}</th><td {left}>{escape(str(value))}</td></tr>" for what, value in rows
    )
    return f"<table><caption {left}>{escape(title)}</caption>{body}</table>"


def list_table(header: tuple[str, ...], title: str, rows: Iterable[tuple[object, ...]]) -> str:
    """Return a caption, and lines under a header."""
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    body = "".join(f"<tr>{''.join(f'<td>{escape(str(cell))}</td>' for cell in row)}</tr>" for row in rows)
    return f'<table><caption style="text-align:left">{escape(title)}</caption><tr>{head}</tr>{body}</table>'


PATIENCE = 1.0  # [s] before anything is shown
EVERY = 0.2  # [s] between two pictures of the bar

Advance = Callable[[str, int], None]  # what runs now, and how many of its steps were done


@contextmanager
def bar(total: int) -> Iterator[Advance | None]:
    """Yield a function to call as some of `total` steps are done; None outside notebooks."""
    display = _display()
    if display is None:
        yield None
        return
    began, done = monotonic(), 0
    handle: Any = None
    due = began + PATIENCE

    def show(html: str) -> None:
        nonlocal handle
        data = {"text/html": html, "text/plain": ""}
        if handle is None:
            handle = display(data, raw=True, display_id=True)
        else:
            handle.update(data, raw=True)

    def advance(what: str, steps: int) -> None:
        nonlocal done, due
        done += steps
        now = monotonic()
        if now >= due:
            due = now + EVERY
            left = (now - began) * (total - done) / done
            rest = f"{left:.0f} s" if left < 90 else f"{left / 60:.0f} min"
            show(f'<progress value="{done}" max="{total}"></progress> {escape(what)}, about {rest} left')

    try:
        yield advance
    finally:
        if handle is not None:
            show("")  # leave nothing behind


def _display() -> Any:
    """Return IPython's `display`, in a notebook; else None."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if shell is None or not hasattr(shell, "kernel"):
        return None
    from importlib import import_module

    return import_module("IPython.display").display
