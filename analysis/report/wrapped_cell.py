"""Text in a cell of a terminal's table: broken between words, else at the marks inside a name, else anywhere."""

import re

from rich.cells import cell_len, chop_cells
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement

WORD = re.compile(r"\s*\S+")
PIECE = re.compile(r"\s*\[?[^\s|,/\[]+[|,/]*|\s*[|,/\[]+")  # a name may be broken behind | , / and before [


class WrappedCell:
    """A cell that takes as many lines as it needs."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for line in self._plain(console).split("\n"):
            for part in broken(line, options.max_width):
                yield console.render_str(part)

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        lines = self._plain(console).split("\n")
        pieces = [cell_len(piece) for line in lines for piece in PIECE.findall(line)]
        return Measurement(max(pieces, default=0), max(cell_len(line) for line in lines))

    def _plain(self, console: Console) -> str:
        return console.render_str(self.text).plain


def broken(line: str, width: int) -> list[str]:
    """A line as lines of at most this width [cells]."""
    lines = [""]
    for word in WORD.findall(line):
        whole = cell_len(word.strip()) <= width
        for piece in [word] if whole else PIECE.findall(word):
            if cell_len(lines[-1] + piece) <= width:
                lines[-1] += piece
            else:
                lines += chop_cells(piece.strip(), width)
    return [line.strip() for line in lines if line.strip()] or [""]
