"""CSV that a spreadsheet may open: no text in it is taken for a formula. Numbers stay numbers."""

import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import pandas as pd
from markupsafe import escape
from rich.cells import cell_len, chop_cells
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table as RichTable
from rich.text import Text

from cooploc.analysis.formats import Format, interval

FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")  # what a cell begins with that a spreadsheet would compute


def csv_text(table: pd.DataFrame) -> str:
    """The table as CSV; a text that begins like a formula gets an apostrophe, which spreadsheets do not show."""
    return (
        table.apply(lambda column: _mapped(column, _cell))
        .rename(columns=_cell)
        .to_csv(index=False, lineterminator="\n")
    )


def read_csv_text(text: str) -> pd.DataFrame:
    """The table that `csv_text` wrote."""
    found = pd.read_csv(io.StringIO(text))
    return found.apply(lambda column: _mapped(column, _as_written)).rename(columns=_as_written)


def _mapped(column: "pd.Series[Any]", change: Callable[[Any], Any]) -> "pd.Series[Any]":
    return column if column.dtype.kind in "fiub" else column.map(change)


def _cell(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value


def _as_written(value: Any) -> Any:
    return value[1:] if isinstance(value, str) and value[:1] == "'" and value[1:].startswith(FORMULA) else value


# Tables for LaTeX: text escaped, the rules of booktabs, and a document that holds them all.

LONG = 40  # rows beyond which a table runs over pages
SPECIAL = {
    "\\": r"\textbackslash{}",
    **{c: f"\\{c}" for c in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "[": "{[}",  # after a line's \\ it would begin an option
    "]": "{]}",
    "–": "--",
    "µ": r"\textmu{}",
    "×": r"\texttimes{}",
    "±": r"\textpm{}",
    "·": r"\textperiodcentered{}",
    "²": r"\texttwosuperior{}",
    "✓": r"\ensuremath{\surd}",
    "✗": r"\ensuremath{\times}",
    "∞": r"\ensuremath{\infty}",
    "\n": " ",
}


def tabular(caption: str, sides: str, heads: list[str], rows: list[list[str]]) -> str:
    """A table with the rules of booktabs; a long one is a longtable."""
    head, *body = (" & ".join(map(escaped, cells)) + r" \\" for cells in [heads, *rows])
    said = rf"\caption{{{escaped(caption)}}}"
    if len(rows) > LONG:
        top = [rf"\begin{{longtable}}{{@{{}}{sides}@{{}}}}", said + r" \\", r"\toprule", head, r"\midrule"]
        repeated = [r"\endfirsthead", r"\toprule", head, r"\midrule", r"\endhead", r"\bottomrule", r"\endfoot"]
        lines = [*top, *repeated, *body, r"\end{longtable}"]
    else:
        top = [r"\begin{table}", r"\centering", said, rf"\begin{{tabular}}{{@{{}}{sides}@{{}}}}", r"\toprule"]
        lines = [*top, head, r"\midrule", *body, r"\bottomrule", r"\end{tabular}", r"\end{table}"]
    return "\n".join(lines) + "\n"


def document(names: list[str], title: str) -> str:
    """A LaTeX document of tables in files beside it."""
    packages = [
        r"\usepackage[T1]{fontenc}",
        r"\usepackage[utf8]{inputenc}",
        r"\usepackage{textcomp,booktabs,longtable}",
    ]
    paper = r"\usepackage[paperwidth=60cm,paperheight=42cm,margin=15mm]{geometry}"
    body = [rf"\input{{{name}}}" for name in names]
    start = [r"\documentclass{article}", *packages, paper, r"\begin{document}", rf"\section*{{{escaped(title)}}}"]
    return "\n".join([*start, *body, r"\end{document}"]) + "\n"


def escaped(text: str) -> str:
    """Text with what means something to LaTeX escaped, and a question mark for what its standard fonts lack."""
    return "".join(SPECIAL.get(c, c if c.isprintable() and ord(c) < 128 else _letter(c)) for c in text)


def _letter(c: str) -> str:
    return c if c.isalpha() and ord(c) < 256 else "?"


# Text in a cell of a terminal's table: broken between words, else at the marks inside a name, else anywhere.

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


# A table in a terminal of any width: a line for each row where it fits; else two lines, and fewer columns.

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


# One table, written as LaTeX (booktabs), Markdown and CSV, and for the terminal; `html_table` writes HTML.
#
# Its rows are mappings; its columns say which of their values go into CSV, and how they are written for people.

Row = dict[Any, Any]  # key -> value, as of `DataFrame.to_dict("records")`


@dataclass(frozen=True)
class TableColumn:
    """One column: its head, the values behind it, and how they are written."""

    head: str
    keys: tuple[str, ...]  # of the values behind it: its columns in CSV; the first is what HTML sorts by
    form: Callable[..., str]  # from values to text
    of: tuple[str, ...] = ()  # keys of the values that `form` takes, if not `keys`
    right: bool = True
    under: bool = False  # in a narrow terminal it is a second line below the column on its left
    spare: int = 0  # in a narrow terminal columns are left out, the largest number first; 0: never
    detail: bool = False  # on a page it is shown on demand

    def text(self, row: Row) -> str:
        """What is read in a row."""
        return self.form(*(row[key] for key in self.of or self.keys))


def plain(value: object = "") -> str:
    """A value as it is; nothing where it is absent."""
    return "" if value is None or value != value else str(value)


def words(
    head: str,
    *keys: str,
    form: Callable[..., str] = plain,
    of: Iterable[str] = (),
    under: bool = False,
    spare: int = 0,
) -> TableColumn:
    """A column of text, named after its only key unless `keys` are given."""
    return TableColumn(head, keys or (head,), form, tuple(of), right=False, under=under, spare=spare)


def numbers(
    head: str,
    *keys: str,
    form: Callable[..., str] = plain,
    of: Iterable[str] = (),
    under: bool = False,
    spare: int = 0,
    detail: bool = False,
) -> TableColumn:
    """A column of numbers."""
    return TableColumn(head, keys or (head,), form, tuple(of), under=under, spare=spare, detail=detail)


def estimates(head: str, name: str, form: Format) -> TableColumn:
    """A column of values with their intervals, of the keys NAME, NAME_low and NAME_high; an absent value is nothing."""
    ends = interval(form)
    return numbers(
        head,
        *(name, f"{name}_low", f"{name}_high"),
        form=lambda value, low, high: f"{form(value)} ({ends(low, high)})" if value == value else "",
    )


@dataclass(frozen=True)
class Table:
    """Rows under columns."""

    name: str  # of its files
    caption: str
    columns: tuple[TableColumn, ...]
    rows: list[Row]
    marks: Mapping[str, str] = field(default_factory=dict)  # attribute of a row in HTML -> key of its value

    def texts(self) -> list[list[str]]:
        """What is read, row by row."""
        return [[column.text(row) for column in self.columns] for row in self.rows]

    def latex(self) -> str:
        """A table with the rules of booktabs; a long one is a longtable."""
        sides = "".join("r" if column.right else "l" for column in self.columns)
        return tabular(self.caption, sides, [column.head for column in self.columns], self.texts())

    def markdown(self) -> str:
        """A pipe table, with its caption below."""
        lines = [[_markdown(c.head) for c in self.columns], ["---:" if c.right else "---" for c in self.columns]]
        lines += [[_markdown(text) for text in texts] for texts in self.texts()]
        rows = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
        return f"{rows}\n\n{_markdown(self.caption)}\n"

    def csv(self) -> str:
        """One line per row with the values in full; what is absent is empty."""
        keys = [key for column in self.columns for key in column.keys]
        return csv_text(pd.DataFrame(self.rows, columns=keys, dtype=object))

    def terminal(self, wrap: bool = False, style: Callable[[Row], str] = lambda _: "") -> Any:
        """What rich prints: in two lines a row, and with fewer columns, where the terminal is narrow."""

        texts = self.texts()
        columns = [
            Shown(c.head, [(cells[i],) for cells in texts], c.right, c.under, c.spare)
            for i, c in enumerate(self.columns)
        ]
        return TerminalTable(self.caption, columns, [style(row) for row in self.rows], wrap)


def _markdown(text: str) -> str:
    """Text as it is, in a pipe table: no markup, no HTML."""
    for c in "\\`*_[]|":
        text = text.replace(c, "\\" + c)
    return str(escape(text)).replace("&#34;", '"').replace("&#39;", "'").replace("\n", " ")
