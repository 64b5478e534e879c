"""A table of results that fits a column or a page of a journal: columns chosen by name, settings in a legend, notes.

The narrowest of four layouts is taken that fits: in one column or across two, intervals beside the values or below
them. Widths are those of Times at 8 pt (STIX General, which matplotlib has), and a tenth more for other fonts.
"""

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from cooploc.analysis.paper.sizes import COLUMNS, SMALL, width
from cooploc.analysis.report.latex import escaped
from cooploc.analysis.report.tables import Row, Table, TableColumn
from cooploc.estimators.errors import BadInput, nearest

DEFAULT = ("rmse", "change", "anees", "bytes")
HEADS = {"change": "change", "bytes": "bytes", "seconds": "time [µs]", "estimator": "estimator"}
NOT_CHOSEN = {"scenario", "estimator", "consistency", "certificate", "verdict"}
GAP, SPARE = 3.0, 1.1  # [pt] on each side of a column; of the measured width, for fonts that are wider than Times


class Quantity(NamedTuple):
    """A chosen column: what stands in each row, and its interval."""

    head: str
    values: list[str]
    ends: list[str]  # empty where there is no interval
    bold: tuple[bool, ...] = ()  # rows that stand out; empty where none does


class Layout(NamedTuple):
    """How a table is set."""

    columns: int  # of the paper that it is wide
    stacked: bool  # whether intervals stand below the values
    width: float  # of its rows [pt]


def names_of(table: Table) -> list[str]:
    """The columns that can be chosen."""
    found = [column.keys[0] for column in table.columns if not column.keys[0].endswith("_low")]
    return [name for name in found if name not in NOT_CHOSEN]


def quantities(table: Table, chosen: Sequence[str]) -> list[Quantity]:
    """The chosen columns of a table, each with its interval; a percent sign in all rows moves to the head.

    Raises:
        BadInput: the table has no column of that name.

    """
    known = {column.keys[0]: column for column in table.columns}
    if not chosen:
        raise BadInput(f"no column is chosen for the paper's tables; {nearest('', names_of(table))}")
    out = []
    for name in chosen:
        if name not in names_of(table):
            raise BadInput(f"a paper's table has no column {name!r}; {nearest(name, names_of(table))}")
        values, ends = _texts(known[name], table.rows), [""] * len(table.rows)
        if f"{name}_low" in known:
            ends = [
                f"[{both.replace(' to ', ', ')}]" if both else "" for both in _texts(known[f"{name}_low"], table.rows)
            ]
        head = HEADS.get(name, known[name].head)
        if "[" not in head and any(text.endswith(" %") for text in values):
            values, ends = ([text.replace(" %", "") for text in texts] for texts in (values, ends))
            head += " [%]"
        out.append(Quantity(head, values, ends if any(ends) else []))
    return out


def layout(first: Iterable[str], chosen: Sequence[Quantity]) -> Layout:
    """The narrowest layout in which these rows fit.

    Raises:
        BadInput: they fit in none.

    """
    names = max(map(width, first), default=0.0)
    need = 0.0
    for columns, stacked in ((1, False), (1, True), (2, False), (2, True)):
        need = names + sum(_wide(one, stacked) + 2 * GAP for one in chosen)
        if SPARE * need <= 72.27 * COLUMNS[columns]:
            return Layout(columns, stacked, need)
    raise BadInput(
        f"a paper's table of {len(chosen)} columns is {SPARE * need / 72.27:.1f} in wide, a page {COLUMNS[2]} in: "
        "choose fewer by --columns"
    )


def tabular(chosen: Sequence[Quantity], first: Sequence[str], rows: Sequence[int | str], how: Layout) -> str:
    """The tabular itself: `rows` are numbers of rows, or texts of lines that head those that follow."""
    parted = [part for one in chosen for part in _parts(one, how.stacked)]
    heads = [_head(one, how.stacked) for one in chosen]
    lines = [rf"\begin{{tabular}}{{@{{}}l{'r' * len(parted)}@{{}}}}", r"\toprule"]
    lines += [" & ".join(["estimator", *heads]) + r" \\", r"\midrule"]
    for row in rows:
        if isinstance(row, str):
            lines.append(rf"\multicolumn{{{len(parted) + 1}}}{{@{{}}l@{{}}}}{{\itshape {row}}} \\*")
            continue
        lines.append(" & ".join([first[row], *(part[row] for part in parted)]) + r" \\" + "*" * how.stacked)
        if how.stacked:
            ends = [_small(one.ends[row]) if one.ends else "" for one in chosen]
            lines.append(" & ".join(["", *ends]) + r" \\[1pt]")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"])


def text(cell: str) -> str:
    """A cell for LaTeX, with the sign of minus as it is set in formulas."""
    return "$-$".join(map(escaped, re.split(r"(?<!\w)-(?=[\d.∞])", cell)))


def _texts(column: TableColumn, rows: list[Row]) -> list[str]:
    return [column.text(row) for row in rows]


def _wide(one: Quantity, stacked: bool) -> float:
    """The width of a column [pt]."""
    value = max(map(width, one.values), default=0.0)
    ends = max((width(both, SMALL) for both in one.ends), default=0.0)
    return max(width(one.head), value, ends) if stacked else max(width(one.head), value + (2 * GAP + ends) * bool(ends))


def _parts(one: Quantity, stacked: bool) -> list[list[str]]:
    values = [text(value) for value in one.values]
    values = [
        rf"\textbf{{{v}}}" if bold else v for v, bold in zip(values, one.bold or (False,) * len(values), strict=True)
    ]
    return [values] if stacked or not one.ends else [values, [_small(both) for both in one.ends]]


def _small(both: str) -> str:
    return rf"{{\scriptsize {text(both)}}}" if both else ""


def _head(one: Quantity, stacked: bool) -> str:
    return text(one.head) if stacked or not one.ends else rf"\multicolumn{{2}}{{r}}{{{text(one.head)}}}"
