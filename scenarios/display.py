"""Tables for notebooks, in HTML with everything escaped."""

from collections.abc import Iterable
from html import escape


def list_table(header: tuple[str, ...], title: str, rows: Iterable[tuple[object, ...]]) -> str:
    """Return a caption, and lines under a header."""
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    body = "".join(f"<tr>{''.join(f'<td>{escape(str(cell))}</td>' for cell in row)}</tr>" for row in rows)
    return f'<table><caption style="text-align:left">{escape(title)}</caption><tr>{head}</tr>{body}</table>'
