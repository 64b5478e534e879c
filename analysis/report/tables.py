"""One table for every reader: printed in a terminal, or written as LaTeX, Markdown and CSV; `html_page` writes HTML.

Rows are mappings; a `TableColumn` says which values of a row it shows and how. `result_tables` has those of a run.
"""

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from textwrap import wrap
from typing import Any

import pandas as pd
from jinja2 import Environment, FunctionLoader, StrictUndefined, select_autoescape
from markupsafe import escape
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table as RichTable
from rich.text import Text

from cooploc.analysis.formats import Format, interval
from cooploc.estimators.errors import count_of
from cooploc.estimators.label_syntax import shorten_labels
from cooploc.scenarios.runner.run import list_table

Row = dict[Any, Any]  # key -> value, as of `DataFrame.to_dict("records")`


@dataclass(frozen=True)
class TableColumn:
    """A column: its head, the values behind it, and their form."""

    head: str
    keys: tuple[str, ...]  # of the values behind it: its columns in CSV; the first is what HTML sorts by
    form: Callable[..., str]  # from values to text
    of: tuple[str, ...] = ()  # keys of the values that `form` takes, if not `keys`
    right: bool = True
    second_line: bool = False  # in a narrow terminal it stands below the column on its left
    priority: int = 0  # in a narrow terminal columns are left out, the largest number first; 0: never
    collapsed: bool = False  # on a page it is shown on demand
    report_only: bool = False  # a terminal does not show it
    rare: bool = False  # a terminal shows it only where a value is not zero

    def text(self, row: Row) -> str:
        """Return what is read in a row."""
        return self.form(*(row[key] for key in self.of or self.keys))


def as_text(value: object = "") -> str:
    """Write a value as it is, but for labels; nothing where it is absent."""
    return "" if value is None or value != value else shorten_labels(str(value))


def text_column(
    head: str,
    *keys: str,
    form: Callable[..., str] = as_text,
    of: Iterable[str] = (),
    right: bool = False,
    **layout: Any,
) -> TableColumn:
    """Return a column of text, named after its only key unless `keys` are given."""
    return TableColumn(head, keys or (head,), form, tuple(of), right, **layout)


def number_column(head: str, *keys: str, **layout: Any) -> TableColumn:
    """Return a column of numbers, named after its only key unless `keys` are given."""
    return text_column(head, *keys, right=True, **layout)


def interval_column(head: str, name: str, form: Format) -> TableColumn:
    """Return a column of values with their intervals, of the keys NAME, NAME_low and NAME_high."""

    def write(value: float, low: float, high: float) -> str:
        ends = f" ({interval(form)(low, high)})" if low == low and high == high else ""
        return form(value) + ends

    return number_column(head, name, f"{name}_low", f"{name}_high", form=write)


@dataclass(frozen=True)
class Table:
    """Rows under columns."""

    name: str  # of its files
    caption: str
    columns: tuple[TableColumn, ...]
    rows: list[Row]
    marks: Mapping[str, str] = field(default_factory=dict)  # attribute of a row in HTML -> key of its value

    def texts(self) -> list[list[str]]:
        """Return what is read, row by row."""
        return [[column.text(row) for column in self.columns] for row in self.rows]

    def latex(self) -> str:
        """Return a longtable, which may run over pages, with the rules of booktabs."""
        sides = "".join("r" if column.right else "l" for column in self.columns)
        lines = [[column.head for column in self.columns], *self.texts()]
        head, *body = (" & ".join(map(escape_latex, cells)) + r" \\" for cells in lines)
        start = [rf"\begin{{longtable}}{{@{{}}{sides}@{{}}}}", rf"\caption{{{escape_latex(self.caption)}}} \\"]
        start += [rf"\toprule {head} \midrule {end}" for end in (r"\endfirsthead", r"\endhead")]
        return "\n".join([*start, r"\bottomrule \endfoot", *body, r"\end{longtable}"]) + "\n"

    def markdown(self) -> str:
        """Return a pipe table, with its caption below."""
        lines = [[c.head for c in self.columns], *self.texts()]
        head, *body = [f"| {' | '.join(map(_escape_markdown, cells))} |" for cells in lines]
        sides = f"| {' | '.join('---:' if c.right else '---' for c in self.columns)} |"
        return "\n".join([head, sides, *body]) + f"\n\n{_escape_markdown(self.caption)}\n"

    def csv(self) -> str:
        """Return one line per row with the values in full; what is absent is empty."""
        keys = [key for column in self.columns for key in column.keys]
        return csv_text(pd.DataFrame(self.rows, columns=keys, dtype=object))

    def notebook(self, strong: int | None = None) -> str:
        """Return HTML for a notebook, without columns that say nothing; the row of number `strong` is bold."""
        shown = [column for column in self.columns if any(map(column.text, self.rows))]
        texts = [[column.text(row) for column in shown] for row in self.rows]
        return list_table([column.head for column in shown], self.caption, texts, strong)

    def terminal(self, style: Callable[[Row], str] = lambda _: "") -> "TerminalTable":
        """Return what rich prints; `style` colours a row."""
        return TerminalTable(self, [style(row) for row in self.rows])


# ------------------------------------------------------------------------------------------------ terminal


@dataclass(frozen=True)
class TerminalTable:
    """A table that rich prints: one line a row where that fits, else two, and then with fewer columns."""

    table: Table
    styles: list[str]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Print the widest layout that fits, and the names of the columns that it lacks."""
        every = [c for c in self.table.columns if any(c.text(row) for row in self.table.rows)]
        priorities = sorted({c.priority for c in every if c.priority}, reverse=True)
        layouts = [(every, 0), *((every, width) for width in LABEL_WIDTHS)]
        layouts += [([c for c in every if c.priority < most], LABEL_WIDTHS[-1]) for most in priorities]
        for shown, stacked in layouts:
            drawn = self._draw(shown, stacked)
            if Measurement.get(console, options.update_width(100_000), drawn).maximum <= options.max_width:
                break
        yield drawn
        if left_out := [c.head.partition("\n")[0] for c in every if c not in shown]:
            yield Text(f" not shown at this width: {', '.join(dict.fromkeys(left_out))}", style="dim")

    def _draw(self, columns: Sequence[TableColumn], stacked: int) -> RichTable:
        """Return the table; `stacked`: labels have so many characters, second lines stand below their neighbours."""
        cells: list[list[TableColumn]] = []
        for column in columns:
            if stacked and column.second_line and cells:
                cells[-1].append(column)
            else:
                cells.append([column])
        out = RichTable(title=self.table.caption, title_justify="left", header_style="bold", box=None, padding=(0, 1))
        for first, *below in cells:
            begin = first.head.partition("\n")[0] + "\n"  # what both begin with is said once
            head = "\n".join(filter(None, (first.head, *(one.head.removeprefix(begin) for one in below))))
            out.add_column(head, justify="right" if first.right else "left", no_wrap=first.right, overflow="fold")
        for row, style in zip(self.table.rows, self.styles, strict=True):
            texts = ([one.text(row) for one in cell] for cell in cells)
            folded = (
                [_break_label(first, stacked) if stacked else first, *filter(None, below)] for first, *below in texts
            )
            out.add_row(*map("\n".join, folded), style=style)
        return out


LABEL_WIDTHS = 30, 16  # beyond which labels are broken where a table is stacked


def _break_label(text: str, width: int) -> str:
    """Return a long label in lines that begin with its bracket or after a comma; any other text as it is."""
    if len(text) <= width or " " in text:
        return text
    lines = wrap(text.replace(",", ", ").replace("[", " ["), width, break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines).replace(", ", ",").replace(" [", "[")


# ------------------------------------------------------------------------------------------------ templates


@cache
def environment() -> Environment:
    """Return the templates in `page`; in those of HTML everything that is not marked as safe is escaped."""
    escaped = select_autoescape(("html.j2",))
    templates = Environment(
        loader=FunctionLoader(read_template), autoescape=escaped, undefined=StrictUndefined, trim_blocks=True
    )
    templates.globals.update(count_of=count_of)
    templates.policies["json.dumps_kwargs"] = {"sort_keys": True, "separators": (",", ":")}
    return templates


def read_template(name: str) -> str:
    """Return a file of `page`."""
    return (files(__package__) / "page" / name).read_text(encoding="utf-8")


@cache
def read_toml(name: str) -> dict[str, Any]:
    """Return what a TOML file beside this module says, such as the words of tables and figures."""
    return tomllib.loads((files(__package__) / name).read_text("utf-8"))


def words(of: str) -> dict[str, str]:
    """Return the words for columns, remarks, marks, notes or captions, by their names."""
    known: dict[str, str] = read_toml("words.toml")[of]
    return known


def fill_template(name: str, **values: Any) -> str:
    """Return the text of a template."""
    return environment().get_template(name).render(**values)


# ------------------------------------------------------------------------------------------------ files

FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")  # what a cell begins with that a spreadsheet would compute
LATEX = {
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


def csv_text(table: pd.DataFrame) -> str:
    """Return a table as CSV; a text that a spreadsheet would take for a formula gets an apostrophe."""

    def plain(value: Any) -> Any:
        return f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value

    texts = {str(name): table[name].map(plain) for name in table if table[name].dtype.kind not in "fiub"}
    return table.assign(**texts).rename(columns=plain).to_csv(index=False, lineterminator="\n")


def escape_latex(text: str) -> str:
    """Escape what means something to LaTeX; its standard fonts' missing letters become question marks."""
    known = ((c.isascii() and c.isprintable()) or (c.isalpha() and ord(c) < 256) for c in text)
    return "".join(LATEX.get(c, c if ok else "?") for c, ok in zip(text, known, strict=True))


def _escape_markdown(text: str) -> str:
    """Text as it is, in a pipe table: no markup, no HTML."""
    for c in "\\`*_[]|":
        text = text.replace(c, "\\" + c)
    return str(escape(text)).replace("&#34;", '"').replace("&#39;", "'").replace("\n", " ")


def frame(caption: str, table: pd.DataFrame, digits: int = 4) -> Table:
    """Return a DataFrame as a table, numbers with so many digits at the right."""
    columns = tuple((number_column if table[c].dtype.kind in "if" else text_column)(str(c)) for c in table)
    texts = table.map(lambda value: f"{value:.{digits}g}" if isinstance(value, float) and value == value else value)
    return Table(caption, caption, columns, texts.to_dict("records"))
