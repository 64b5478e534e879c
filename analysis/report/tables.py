"""One table, written as LaTeX (booktabs), Markdown and CSV, and for the terminal; `html_table` writes HTML.

Its rows are mappings; its columns say which of their values go into CSV, and how they are written for people.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import pandas as pd
from markupsafe import escape

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
        from cooploc.analysis.report.terminal_table import Shown, TerminalTable

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
