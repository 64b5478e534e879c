"""A table in a terminal of any width: a line for each row where it fits; else two lines, and fewer columns."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table as RichTable
from rich.text import Text

from cooploc.analysis.report.wrapped_cell import WrappedCell

ANY_WIDTH = 100_000


class Shown(NamedTuple):
    """A column of text: its head, one or two lines for every row, and what becomes of it where width is short."""

    head: str
    lines: list[tuple[str, ...]]
    right: bool
    under: bool
    spare: int


class TerminalTable:
    """A table that rich can print: `styles` colour its rows, `wrap` breaks long cells at once."""

    def __init__(self, caption: str, columns: list[Shown], styles: list[str], wrap: bool) -> None:
        self.caption, self.styles, self.wrap = caption, styles, wrap
        self.columns = [c for c in columns if any(text for (text,) in c.lines)]  # without those that say nothing

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """The widest layout that fits, and which columns it lacks."""
        if self.wrap:
            yield self._drawn(self.columns, wrap=True)
            return
        drawn, lacking = self._fitted(console, options)
        yield drawn
        if lacking:
            names = ", ".join(dict.fromkeys(lacking))
            yield Text(f" not shown at this width: {names}", style="dim")

    def _fitted(self, console: Console, options: ConsoleOptions) -> tuple[RichTable, list[str]]:
        """The table in the widest layout that fits; in the narrowest, long cells are broken."""
        unbounded = options.update_width(ANY_WIDTH)
        for columns, lacking in self._layouts():
            drawn = self._drawn(columns, wrap=False)
            if Measurement.get(console, unbounded, drawn).maximum <= options.max_width:
                return drawn, lacking
        return self._drawn(columns, wrap=True), lacking

    def _layouts(self) -> Iterator[tuple[Sequence[Shown], list[str]]]:
        """From the widest to the narrowest, each with the heads of what it leaves out."""
        yield self.columns, []
        left, out = list(self.columns), []
        yield _stacked(left), []
        for spare in sorted({c.spare for c in self.columns if c.spare}, reverse=True):
            dropped = [c for c in left if c.spare == spare]
            left = [c for c in left if c.spare != spare]
            out += [c.head.partition("\n")[0] for c in dropped if not c.under or len(dropped) == 1]
            yield _stacked(left), out[:]

    def _drawn(self, columns: Sequence[Shown], wrap: bool) -> RichTable:
        out = RichTable(title=self.caption, title_justify="left", header_style="bold", box=None, padding=(0, 1))
        for column in columns:
            out.add_column(
                column.head,
                justify="right" if column.right else "left",
                no_wrap=column.right or not wrap,
            )
        right = [column.right for column in columns]
        for i, first in enumerate(self.styles):
            lines = zip(*(column.lines[i] for column in columns), strict=True)
            for texts, style in zip(lines, (first, "dim"), strict=False):
                cells = (t if r or not wrap else WrappedCell(t) for t, r in zip(texts, right, strict=True))
                out.add_row(*cells, style=style)
        return out


def _stacked(columns: Sequence[Shown]) -> list[Shown]:
    """Each column with the one that belongs under it on a second line."""
    out: list[Shown] = []
    for column in columns:
        if column.under and out and len(out[-1].lines[0]) == 1:
            out[-1] = _over(out[-1], column)
        elif column.under and out and not (column.right or out[-1].right):
            out[-1] = _beside(out[-1], column)
        else:
            out.append(column)
    deep = max((len(column.lines[0]) for column in out), default=1)
    return [_over(column, None) if len(column.lines[0]) < deep else column for column in out]


def _over(top: Shown, under: Shown | None) -> Shown:
    """A column above another, or above nothing."""
    if under is None:
        return top._replace(lines=[(*cell, "") for cell in top.lines])
    cells = zip(top.lines, under.lines, strict=True)
    head = under.head.removeprefix(top.head.partition("\n")[0] + "\n")  # what both begin with is said once
    return top._replace(head=f"{top.head}\n{head}", lines=[(*a, *b) for a, b in cells])


def _beside(column: Shown, more: Shown) -> Shown:
    """A column whose second line also says what another one does."""
    cells = zip(column.lines, more.lines, strict=True)
    lines: list[tuple[str, ...]] = [
        (first, "; ".join(filter(None, (second, said)))) for (first, second), (said,) in cells
    ]
    return column._replace(head="; ".join(filter(None, (column.head, more.head))), lines=lines)
