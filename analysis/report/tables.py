"""One table, written as HTML, LaTeX (booktabs), Markdown and CSV, and for the terminal.

What people read is text; what programs read (CSV) and what sorting goes by are the values behind it, in full.
"""

import csv
import io
import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from markupsafe import Markup, escape

LONG = 40  # rows beyond which a LaTeX table runs over pages
_LATEX = {
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


class Cell(NamedTuple):
    """What is read, and the values behind it, one for each key of the column."""

    text: str
    values: tuple[Any, ...]


@dataclass(frozen=True)
class Column:
    """One column: its head, the CSV columns behind it, and its side."""

    head: str
    keys: tuple[str, ...]
    right: bool = True


@dataclass(frozen=True)
class Table:
    """Rows of cells under columns; `marks` are the attributes of each row in HTML."""

    name: str  # of its files
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    marks: tuple[dict[str, str], ...] = field(default=())

    def html(self) -> Markup:
        """A `<table>` whose cells carry their values as `data-sort`; everything is escaped."""
        heads = Markup("").join(
            Markup('<th scope="col"{}><button type="button">{}</button></th>').format(_side(c), c.head)
            for c in self.columns
        )
        marks = self.marks or ({},) * len(self.rows)
        body = Markup("\n").join(self._row(cells, mark) for cells, mark in zip(self.rows, marks, strict=True))
        return Markup(
            '<div class="scroll" tabindex="0"><table class="sortable" id="table-{}">\n<caption>{}</caption>\n'
            "<thead><tr>{}</tr></thead>\n<tbody>\n{}\n</tbody></table></div>"
        ).format(self.name, self.caption, heads, body)

    def _row(self, cells: tuple[Cell, ...], marks: dict[str, str]) -> Markup:
        attributes = Markup("").join(Markup(' {}="{}"').format(key, value) for key, value in marks.items())
        inner = Markup("").join(
            Markup("<td{}{}>{}</td>").format(_side(column), _sort(cell), cell.text)
            for column, cell in zip(self.columns, cells, strict=True)
        )
        return Markup("<tr{}>{}</tr>").format(attributes, inner)

    def latex(self) -> str:
        """A table with the rules of booktabs; a long one is a longtable."""
        sides = "".join("r" if c.right else "l" for c in self.columns)
        head = " & ".join(latex(c.head) for c in self.columns) + r" \\"
        body = [" & ".join(latex(cell.text) for cell in cells) + r" \\" for cells in self.rows]
        caption = rf"\caption{{{latex(self.caption)}}}"
        if len(self.rows) > LONG:
            top = [rf"\begin{{longtable}}{{@{{}}{sides}@{{}}}}", caption + r" \\", r"\toprule", head, r"\midrule"]
            again = [r"\endfirsthead", r"\toprule", head, r"\midrule", r"\endhead", r"\bottomrule", r"\endfoot"]
            lines = [*top, *again, *body, r"\end{longtable}"]
        else:
            top = [r"\begin{table}", r"\centering", caption, rf"\begin{{tabular}}{{@{{}}{sides}@{{}}}}", r"\toprule"]
            lines = [*top, head, r"\midrule", *body, r"\bottomrule", r"\end{tabular}", r"\end{table}"]
        return "\n".join(lines) + "\n"

    def markdown(self) -> str:
        """A pipe table, with its caption below."""
        lines = [[_markdown(c.head) for c in self.columns], ["---:" if c.right else "---" for c in self.columns]]
        lines += [[_markdown(cell.text) for cell in cells] for cells in self.rows]
        rows = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
        return f"{rows}\n\n{_markdown(self.caption)}\n"

    def csv(self) -> str:
        """One line per row with the values in full; what is absent is empty."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow([key for column in self.columns for key in column.keys])
        for cells in self.rows:
            writer.writerow([_plain(value) for cell in cells for value in cell.values])
        return out.getvalue()

    def terminal(self) -> Any:
        """A table of rich, without columns that say nothing."""
        from rich.table import Table as Terminal

        out = Terminal(title=self.caption, title_justify="left", header_style="bold", box=None, padding=(0, 1))
        said = [i for i in range(len(self.columns)) if any(cells[i].text for cells in self.rows)]
        for i in said:
            side: Any = "right" if self.columns[i].right else "left"
            out.add_column(self.columns[i].head, justify=side, no_wrap=True)
        for cells in self.rows:
            out.add_row(*(cells[i].text for i in said))
        return out


def document(names: list[str], title: str) -> str:
    """A LaTeX document of tables in files beside it."""
    packages = [
        r"\usepackage[T1]{fontenc}",
        r"\usepackage[utf8]{inputenc}",
        r"\usepackage{textcomp,booktabs,longtable}",
    ]
    paper = r"\usepackage[paperwidth=60cm,paperheight=42cm,margin=15mm]{geometry}"
    body = [rf"\input{{{name}}}" for name in names]
    start = [r"\documentclass{article}", *packages, paper, r"\begin{document}", rf"\section*{{{latex(title)}}}"]
    return "\n".join([*start, *body, r"\end{document}"]) + "\n"


def latex(text: str) -> str:
    """Text with what means something to LaTeX escaped, and a question mark for what its standard fonts lack."""
    return "".join(_LATEX.get(c, c if c.isprintable() and ord(c) < 128 else _letter(c)) for c in text)


def text(value: Any) -> Cell:
    """A cell that says what it holds."""
    return Cell(str(value), (value,))


def number(value: float, digits: int = 2, unit: str = "", factor: float = 1.0) -> Cell:
    """A number with so many decimals; nothing where it is absent."""
    return Cell(rounded(factor * value, digits, unit), (value,))


def interval(low: float, high: float, digits: int = 2, unit: str = "", factor: float = 1.0) -> Cell:
    """Both ends of an interval; a negative factor turns it round in the text."""
    ends = sorted((factor * low, factor * high))
    known = all(math.isfinite(end) for end in ends)
    return Cell(f"{rounded(ends[0], digits)} to {rounded(ends[1], digits)}{unit}" if known else "", (low, high))


def rounded(value: float, digits: int, unit: str = "") -> str:
    """A number with so many decimals, of large ones fewer; never minus zero, and nothing where it is absent."""
    if math.isnan(value):
        return ""
    if math.isinf(value):
        return "∞" if value > 0 else "–∞"
    if abs(value) >= 1e5:
        return f"{value:.2g}{unit}"
    digits = min(digits, max(0, 4 - len(f"{abs(value):.0f}"))) if abs(value) >= 10 else digits
    return f"{round(value, digits) + 0.0:.{digits}f}{unit}"


def _letter(c: str) -> str:
    return c if c.isalpha() and ord(c) < 256 else "?"


def _side(column: Column) -> Markup:
    return Markup(' class="r"') if column.right else Markup("")


def _sort(cell: Cell) -> Markup:
    value = cell.values[0]
    if isinstance(value, str) or value is None:
        return Markup("")
    return Markup(' data-sort="{}"').format("" if value != value else repr(float(value)))


def _markdown(text: str) -> str:
    """Text as it is, in a pipe table: no markup, no HTML."""
    for c in "\\`*_[]|":
        text = text.replace(c, "\\" + c)
    return str(escape(text)).replace("&#34;", '"').replace("&#39;", "'").replace("\n", " ")


def _plain(value: Any) -> Any:
    return "" if value is None or value != value else value
