"""A `Table` as HTML: intervals stand below their values, rows in groups, and what is read less on demand."""

from collections.abc import Mapping
from itertools import groupby
from typing import Any, NamedTuple

from markupsafe import Markup
from matplotlib.colors import to_hex

from cooploc.analysis.formats import counted
from cooploc.analysis.plot.style import MARKERS, Look, colour_of
from cooploc.analysis.report.run_numbers import Labels
from cooploc.analysis.report.tables import Row, Table, TableColumn

LONG = 30  # rows from which a table scrolls within a box of its own
BELOW = "95 %", "remark"  # heads of columns that stand below their left neighbour
SYMBOLS = dict(zip(MARKERS, "✖●■◆▲▼✚★⬟⬢◀▶♦⯃⬣✦✧✶⅄⋏✯✺≻", strict=False))  # of the figures' markers


class Wording(NamedTuple):
    """How a page writes estimators, and where it leads from a number."""

    names: Labels = Labels({}, {})
    marks: Mapping[str, Markup] = {}  # estimator -> its marker
    anchors: Mapping[str, str] = {}  # estimator -> where it is introduced
    trials: Mapping[str, str] = {}  # scenario -> the address of its trials

    def estimator(self, label: str) -> Markup:
        """Return an estimator with its marker and a link to what it is."""
        if label not in self.anchors:
            return Markup("{}").format(label)
        link = Markup('{}<a href="#{}" title="{}">{}</a>')
        return link.format(self.marks.get(label, ""), self.anchors[label], label, self.names.of(label))


def markers(looks: Mapping[str, Look], centralised: set[str]) -> dict[str, Markup]:
    """Return the marker of each estimator, as in the figures; grey where it is centralised."""
    mark = Markup('<span class="mark" aria-hidden="true" style="color: {}">{}</span>')
    colours = {name: to_hex(colour_of({"centralised": name in centralised}, look)) for name, look in looks.items()}
    return {name: mark.format(colours[name], SYMBOLS.get(look.marker, "●")) for name, look in looks.items()}


class Cell(NamedTuple):
    """A column with those that stand below it."""

    column: TableColumn
    below: list[TableColumn]


PLAIN = Wording()


def html(table: Table, wording: Wording = PLAIN, group: str = "") -> Markup:
    """Return a `<table>` whose cells carry their values as `data-sort`; everything is escaped.

    Args:
        table: what it shows; columns that are empty in every row are left out.
        wording: how estimators are written.
        group: the key by whose value neighbouring rows form a group with a head of its own.

    """
    cells: list[Cell] = []
    for column in table.columns:
        if column.keys[0] == group or not any(map(column.text, table.rows)):
            continue
        if cells and column.head in BELOW:
            cells[-1].below.append(column)
        else:
            cells.append(Cell(column, []))
    switch = '<label class="switch"><input type="checkbox"> all columns</label>'
    return Markup(
        '<div class="table">{}<div class="scroll{}" tabindex="0" role="region" aria-label="table {}">'
        '<table class="sortable" id="table-{}">\n<caption><span>{}</span></caption>\n<thead><tr>{}</tr></thead>\n{}\n'
        "</table></div></div>"
    ).format(
        Markup(switch if any(cell.column.collapsed for cell in cells) else ""),
        " long" if len(table.rows) >= LONG else "",
        table.name,
        table.name,
        table.caption,
        Markup("").join(map(_head, cells)),
        _bodies(table, cells, wording, group),
    )


def _head(cell: Cell) -> Markup:
    small = Markup("<small>95 %</small>" if any(column.head == "95 %" for column in cell.below) else "")
    return Markup('<th scope="col"{}><span>{}</span>{}</th>').format(_classes(cell.column), cell.column.head, small)


def _bodies(table: Table, cells: list[Cell], wording: Wording, group: str) -> Markup:
    """A `<tbody>`, or one for each group, with a head."""
    if not group:
        body = Markup("\n").join(_row(table, cells, wording, group, row) for row in table.rows)
        return Markup("<tbody>\n{}\n</tbody>").format(body)
    head = Markup('<tr class="head"><th colspan="{}" scope="rowgroup"><span>{}{}</span></th></tr>')
    bodies = []
    for key, part in groupby(table.rows, lambda row: row[group]):
        rows = list(part)
        robots = f", {counted(rows[0]['robots'], 'robot')}" if "robots" in rows[0] else ""
        body = Markup("\n").join(_row(table, cells, wording, group, row) for row in rows)
        first = head.format(len(cells), key, robots)
        bodies.append(Markup('<tbody data-{}="{}">{}\n{}\n</tbody>').format(group, key, first, body))
    return Markup("\n").join(bodies)


def _row(table: Table, cells: list[Cell], wording: Wording, group: str, row: Row) -> Markup:
    marks = {attribute: row[key] for attribute, key in table.marks.items() if row[key] and key != group}
    attributes = Markup("").join(Markup(' {}="{}"').format(attribute, value) for attribute, value in marks.items())
    first, *others = (_cell(cell, wording, row) for cell in cells)
    head = Markup('<th scope="row"{}</th>').format(first)
    return Markup("<tr{}>{}{}</tr>").format(
        attributes, head, Markup("").join(Markup("<td{}</td>").format(other) for other in others)
    )


def _cell(cell: Cell, wording: Wording, row: Row) -> Markup:
    """A cell's attributes and text: an estimator with its marker, an RMSE with a link to its trials."""
    key, text = cell.column.keys[0], Markup("{}").format(cell.column.text(row))
    if key == "estimator" and text:
        text = wording.estimator(str(row[key]))
    if key == "rmse" and text and (address := wording.trials.get(row["scenario"])):
        text = Markup('<a class="trials" href="{}" title="every trial">{}</a>').format(address, text)
    small = Markup("").join(Markup("<small>{}</small>").format(t) for c in cell.below if (t := c.text(row)))
    value: Any = row[key]
    sort = Markup("")
    if not (isinstance(value, str) or value is None):
        sort = Markup(' data-sort="{}"').format("" if value != value else f"{float(value):.6g}")
    return Markup("{}{}>{}{}").format(_classes(cell.column), sort, text, small)


def _classes(column: TableColumn) -> Markup:
    kinds = ["r"] * column.right + ["detail"] * column.collapsed
    return Markup(' class="{}"').format(" ".join(kinds)) if kinds else Markup("")
