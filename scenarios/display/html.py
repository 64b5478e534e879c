"""Small HTML tables for notebooks, with everything in them escaped."""

from collections.abc import Iterable
from html import escape


def facts(title: str, rows: Iterable[tuple[str, object]]) -> str:
    """A caption and lines of (what, value)."""
    body = "".join(
        f'<tr><th style="text-align:left">{escape(what)}</th><td style="text-align:left">{escape(str(value))}</td></tr>'
        for what, value in rows
    )
    return f'<table><caption style="text-align:left">{escape(title)}</caption>{body}</table>'


def listed(header: tuple[str, ...], title: str, rows: Iterable[tuple[object, ...]]) -> str:
    """A caption, and lines under a header."""
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    body = "".join(f"<tr>{''.join(f'<td>{escape(str(cell))}</td>' for cell in row)}</tr>" for row in rows)
    return f'<table><caption style="text-align:left">{escape(title)}</caption><tr>{head}</tr>{body}</table>'
