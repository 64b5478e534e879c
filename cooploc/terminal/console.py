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
    """Without colours in text or markup: as wide as the terminal, which breaks lines between words.

    In a file or a pipe lines are as long as they are, for other programs.
    """
    console = PlainConsole(stderr=stderr)
    if console.is_terminal:
        return console
    return PlainConsole(stderr=stderr, soft_wrap=True, width=400)
