"""One table, written as HTML, LaTeX (booktabs), Markdown and CSV, and for the terminal.

Its rows are mappings; its columns say which of their values go into CSV, and how they are written for people. Sorting
in HTML goes by the values, too.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import pandas as pd
from markupsafe import Markup, escape

from cooploc.analysis.formats import Format, interval
from cooploc.analysis.report.csv_text import csv_text
from cooploc.analysis.report.latex import tabular

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
) -> TableColumn:
    """A column of numbers."""
    return TableColumn(head, keys or (head,), form, tuple(of), under=under, spare=spare)


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

    def html(self) -> Markup:
        """A `<table>` whose cells carry their values as `data-sort`; everything is escaped."""
        heads = Markup("").join(
            Markup('<th scope="col"{}><button type="button">{}</button></th>').format(_side(c), c.head)
            for c in self.columns
        )
        body = Markup("\n").join(map(self._row, self.rows))
        return Markup(
            '<div class="scroll" tabindex="0"><table class="sortable" id="table-{}">\n<caption>{}</caption>\n'
            "<thead><tr>{}</tr></thead>\n<tbody>\n{}\n</tbody></table></div>"
        ).format(self.name, self.caption, heads, body)

    def _row(self, row: Row) -> Markup:
        marks = {attribute: row[key] for attribute, key in self.marks.items() if row[key]}
        attributes = Markup("").join(Markup(' {}="{}"').format(attribute, value) for attribute, value in marks.items())
        cells = Markup("").join(
            Markup("<td{}{}>{}</td>").format(_side(c), _sort(row[c.keys[0]]), c.text(row)) for c in self.columns
        )
        return Markup("<tr{}>{}</tr>").format(attributes, cells)

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
        from cooploc.analysis.report.terminal_table import Shown, TerminalTable

        texts = self.texts()
        columns = [
            Shown(c.head, [(cells[i],) for cells in texts], c.right, c.under, c.spare)
            for i, c in enumerate(self.columns)
        ]
        return TerminalTable(self.caption, columns, [style(row) for row in self.rows], wrap)


def _side(column: TableColumn) -> Markup:
    return Markup(' class="r"') if column.right else Markup("")


def _sort(value: Any) -> Markup:
    if isinstance(value, str) or value is None:
        return Markup("")
    return Markup(' data-sort="{}"').format("" if value != value else repr(float(value)))


def _markdown(text: str) -> str:
    """Text as it is, in a pipe table: no markup, no HTML."""
    for c in "\\`*_[]|":
        text = text.replace(c, "\\" + c)
    return str(escape(text)).replace("&#34;", '"').replace("&#39;", "'").replace("\n", " ")
