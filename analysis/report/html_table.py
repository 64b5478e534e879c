"""A `Table` as HTML: intervals stand below their values, rows in groups, and columns that are read less on demand."""

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from itertools import groupby
from typing import Any, NamedTuple

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.colors import to_hex

from cooploc.analysis.formats import count_of
from cooploc.analysis.plot.style import MARKERS, Look, colour_of
from cooploc.analysis.report.run_numbers import Labels
from cooploc.analysis.report.tables import Row, Table, TableColumn

BELOW = "95 %", "remark"  # heads of columns that stand below their left neighbour
SYMBOLS = dict(zip(MARKERS, "✖●■◆▲▼✚★⬟⬢◀▶♦⯃⬣✦✧✶⅄⋏✯✺≻", strict=False))  # of the figures' markers


class Wording(NamedTuple):
    """Names of estimators on a page, and where links lead."""

    names: Labels = Labels({}, {})
    marks: Mapping[str, Markup] = {}  # estimator -> its marker
    anchors: Mapping[str, str] = {}  # estimator -> where it is introduced
    trials: Mapping[str, str] = {}  # scenario -> the address of its trials

    def cell(self, column: TableColumn, row: Row) -> Markup:
        """Return the text of a cell: an estimator with its marker and a link, an RMSE with a link to its trials."""
        key, text = column.keys[0], column.text(row)
        if key == "estimator" and text in self.anchors:
            link = Markup('{}<a href="#{}" title="{}">{}</a>')
            return link.format(self.marks.get(text, ""), self.anchors[text], text, self.names.of(text))
        if key == "rmse" and text and (address := self.trials.get(row["scenario"])):
            return Markup('<a class="trials" href="{}" title="every trial">{}</a>').format(address, text)
        return Markup("{}").format(text)


PLAIN = Wording()


def markers(looks: Mapping[str, Look], centralised: set[str]) -> dict[str, Markup]:
    """Return the marker of each estimator, as in the figures; grey where it is centralised."""
    mark = Markup('<span class="mark" aria-hidden="true" style="color: {}">{}</span>')
    colours = {name: to_hex(colour_of({"centralised": name in centralised}, look)) for name, look in looks.items()}
    return {name: mark.format(colours[name], SYMBOLS.get(look.marker, "●")) for name, look in looks.items()}


class PageColumn(NamedTuple):
    """A column with those that stand below it."""

    column: TableColumn
    below: list[TableColumn]


def html(table: Table, wording: Wording = PLAIN, group: str = "") -> Markup:
    """Return a `<table>` whose cells carry their values as `data-sort`; everything is escaped.

    Columns that are empty in every row are left out. Neighbouring rows with the same value of the key `group` form a
    group with a head of its own.
    """
    cells: list[PageColumn] = []
    for column in table.columns:
        if column.keys[0] == group or not any(map(column.text, table.rows)):
            continue
        if cells and column.head in BELOW:
            cells[-1].below.append(column)
        else:
            cells.append(PageColumn(column, []))
    grouped = groupby(table.rows, lambda row: row[group]) if group else [("", table.rows)]
    groups = [(key, list(rows)) for key, rows in grouped]
    template = environment().get_template("table.html.j2")
    return Markup(template.render(table=table, wording=wording, group=group, cells=cells, groups=groups))


def sort_value(value: Any) -> str | None:
    """Return what a number is sorted by, nothing where it is absent; None for text."""
    if isinstance(value, str) or value is None:
        return None
    return "" if value != value else f"{float(value):.6g}"


@cache
def environment() -> Environment:
    """Return the templates of a page; everything in them that is not marked as safe is escaped."""
    templates = Environment(
        loader=FunctionLoader(read_template), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    templates.globals.update(html=html, count_of=count_of, sort_value=sort_value)
    templates.policies["json.dumps_kwargs"] = {"sort_keys": True, "separators": (",", ":")}
    return templates


def read_template(name: str) -> str:
    """Return a file of the page."""
    return (files(__package__) / "page" / name).read_text(encoding="utf-8")
