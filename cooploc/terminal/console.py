"""The consoles that commands print on."""

from typing import Any

from rich.console import Console
from rich.text import Text

from cooploc.terminal.visible import visible


class PlainConsole(Console):
    """A console that shows text as it is: no markup, no guessed colours, no control characters."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Text, wherever rich meets it: a line, a cell, a title."""
        return super().render_str(visible(text), **options)


def wide(stderr: bool = False) -> Console:
    """Without colours in text or markup; a terminal may wrap a row of a table, but numbers are never cut off."""
    return PlainConsole(stderr=stderr, soft_wrap=True, width=400)
