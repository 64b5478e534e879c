"""The console that all commands print to."""

from rich.console import Console


def wide(stderr: bool = False) -> Console:
    """Without colours in text or markup; a terminal may wrap a row of a table, but numbers are never cut off."""
    return Console(stderr=stderr, highlight=False, markup=False, soft_wrap=True, width=400)
