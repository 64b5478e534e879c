"""A `Table` as HTML: intervals stand below their values, rows in groups, and what is read less on demand."""

from collections.abc import Iterator, Mapping
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.colors import to_hex
from matplotlib.markers import MarkerStyle

from cooploc.analysis.formats import counted
from cooploc.analysis.plot.style import Look, colour_of
from cooploc.analysis.report.colours import variable
from cooploc.analysis.report.result_tables import ShortNames
from cooploc.analysis.report.tables import Row, Table, TableColumn

LONG = 30  # rows from which a table scrolls within a box of its own
BELOW = "95 %", "remark"  # heads of columns that stand below their left neighbour


class Wording(NamedTuple):
    """How a page writes estimators, and where it leads from a number."""

    names: ShortNames = ShortNames({})
    marks: Mapping[str, Markup] = {}  # estimator -> its marker; those that have one are introduced
    anchors: Mapping[str, str] = {}  # estimator -> where it is introduced
    trials: Mapping[str, str] = {}  # scenario -> the address of its trials

    def estimator(self, label: str) -> Markup:
        """An estimator with its marker and a link to what it is."""
        said = self.names.of(label)
        if label not in self.anchors:
            return Markup("{}").format(said)
        hint = Markup(' title="{}"').format(label) if said != label else Markup("")
        link = Markup('{}<a href="#{}"{}>{}</a>')
        return link.format(self.marks.get(label, Markup("")), self.anchors[label], hint, said)


class Heap(NamedTuple):
    """A column with those that stand below it."""

    column: TableColumn
    below: list[TableColumn]


PLAIN = Wording()


def html(table: Table, wording: Wording = PLAIN, group: str = "") -> Markup:
    """A `<table>` whose cells carry their values as `data-sort`; everything is escaped.

    Args:
        table: what it shows; columns that are empty in every row are left out.
        wording: how estimators are written.
        group: the key by whose value neighbouring rows form a group with a head of its own.

    """
    heaps = _heaps(table, group)
    heads = Markup("").join(_head(heap, wording.names) for heap in heaps)
    body = Markup("\n").join(_group(table, heaps, wording, group, *each) for each in _groups(table.rows, group))
    more = any(heap.column.detail for heap in heaps)
    switch = '<label class="switch"><input type="checkbox"> all columns</label>' if more else ""
    long = " long" if len(table.rows) >= LONG else ""
    return Markup(
        '<div class="table">{}<div class="scroll{}" tabindex="0" role="region" aria-label="{}">'
        '<table class="sortable" id="table-{}">\n<caption><span>{}</span></caption>\n<thead><tr>{}</tr></thead>\n{}\n'
        "</table></div></div>"
    ).format(Markup(switch), long, f"table {table.name}", table.name, wording.names.within(table.caption), heads, body)


def _heaps(table: Table, group: str) -> list[Heap]:
    """The columns that say something, with those that stand below them."""
    heaps: list[Heap] = []
    for column in table.columns:
        if column.keys[0] == group or not any(map(column.text, table.rows)):
            continue
        if heaps and column.head in BELOW:
            heaps[-1].below.append(column)
        else:
            heaps.append(Heap(column, []))
    return heaps


def _head(heap: Heap, names: ShortNames) -> Markup:
    interval = any(column.head == "95 %" for column in heap.below)
    small = Markup("<small>95 %</small>") if interval else Markup("")
    return Markup('<th scope="col"{}><span>{}</span>{}</th>').format(
        _kind(heap.column), names.within(heap.column.head), small
    )


def _groups(rows: list[Row], group: str) -> Iterator[tuple[Any, list[Row]]]:
    if not group:
        yield "", rows
        return
    for key, part in groupby(rows, lambda row: row[group]):
        yield key, list(part)


def _group(table: Table, heaps: list[Heap], wording: Wording, group: str, key: Any, rows: list[Row]) -> Markup:
    """A `<tbody>`, with a head where rows are grouped."""
    body = Markup("\n").join(_row(table, heaps, wording, group, row) for row in rows)
    if not group:
        return Markup("<tbody>\n{}\n</tbody>").format(body)
    about = "".join(f", {counted(rows[0][what], what[:-1])}" for what in ("robots",) if what in rows[0])
    head = Markup('<tr class="head"><th colspan="{}" scope="rowgroup"><span>{}{}</span></th></tr>')
    return Markup('<tbody data-{}="{}">{}\n{}\n</tbody>').format(group, key, head.format(len(heaps), key, about), body)


def _row(table: Table, heaps: list[Heap], wording: Wording, group: str, row: Row) -> Markup:
    marks = {attribute: row[key] for attribute, key in table.marks.items() if row[key] and key != group}
    attributes = Markup("").join(Markup(' {}="{}"').format(attribute, value) for attribute, value in marks.items())
    cells = Markup("").join(_cell(heap, wording, row, i == 0) for i, heap in enumerate(heaps))
    return Markup("<tr{}>{}</tr>").format(attributes, cells)


def _cell(heap: Heap, wording: Wording, row: Row, first: bool) -> Markup:
    said = _said(heap.column, wording, row)
    for column in heap.below:
        text = wording.names.within(column.text(row))
        said += Markup("<small>{}</small>").format(text) if text else Markup("")
    tag = Markup('th scope="row"') if first else Markup("td")
    sort = _sort(row[heap.column.keys[0]])
    return Markup("<{}{}{}>{}</{}>").format(tag, _kind(heap.column), sort, said, Markup("th" if first else "td"))


def _said(column: TableColumn, wording: Wording, row: Row) -> Markup:
    """A cell's text, an estimator's with its marker, a number of many trials with a link to them."""
    key, text = column.keys[0], column.text(row)
    if key == "estimator" and text:
        return wording.estimator(text)
    if key == "rmse" and text and (address := wording.trials.get(row["scenario"])):
        return Markup('<a class="trials" href="{}" title="every trial">{}</a>').format(address, text)
    return Markup("{}").format(wording.names.within(text))


def _kind(column: TableColumn) -> Markup:
    kinds = ["r"] * column.right + ["detail"] * column.detail
    return Markup(' class="{}"').format(" ".join(kinds)) if kinds else Markup("")


def _sort(value: Any) -> Markup:
    if isinstance(value, str) or value is None:
        return Markup("")
    return Markup(' data-sort="{}"').format("" if value != value else f"{float(value):.6g}")


# The page's colours by day and by night: those of the figures become CSS variables, each with a value for the dark.
#
# Greys are turned round, black to near white; colours keep their hue and become light enough for the dark ground.

LEAST = 4.5  # contrast of a colour with the dark ground


# Every estimator's marker in its colour, as in the figures, for tables and lists.


def symbols(looks: Mapping[str, Look]) -> Markup:
    """Each different marker once, as a symbol that `mark` uses."""
    drawn = {look.marker: None for look in looks.values()}
    parts = Markup("").join(
        Markup('<symbol id="marker-{}" viewBox="-1.3 -1.3 2.6 2.6"><path d="{}"/></symbol>').format(i, _path(marker))
        for i, marker in enumerate(drawn)
    )
    return Markup('<svg class="symbols" aria-hidden="true" width="0" height="0">{}</svg>').format(parts)


def marks(looks: Mapping[str, Look], centralised: set[str]) -> dict[str, Markup]:
    """The marker of each estimator; grey where it is centralised, as in the figures."""
    number = {marker: i for i, marker in enumerate(dict.fromkeys(look.marker for look in looks.values()))}
    use = Markup('<svg class="mark" aria-hidden="true" style="color: {}"><use href="#marker-{}"/></svg>')
    return {
        name: use.format(variable(to_hex(colour_of({"centralised": name in centralised}, look))), number[look.marker])
        for name, look in looks.items()
    }


def _path(marker: object) -> str:
    """A marker's outline in SVG, within a unit circle or so."""
    style = MarkerStyle(marker)  # type: ignore[arg-type]
    path = style.get_path().transformed(style.get_transform())
    size = float(np.abs(np.asarray(path.vertices, float)).max())
    letters = {1: "M", 2: "L", 3: "Q", 4: "C", 79: "Z"}
    out = []
    for points, code in path.iter_segments(simplify=False):
        values = " ".join(f"{v:.2f}" for v in _flipped(points, size))
        out.append(letters[int(code)] + ("" if int(code) == 79 else values))
    return "".join(out)


def _flipped(points: object, size: float) -> list[float]:
    """Coordinates whose y grows downwards."""
    values = [float(v) / size for v in points]  # type: ignore[attr-defined]
    return [-v if i % 2 else v for i, v in enumerate(values)]
