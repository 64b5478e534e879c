"""A table of results that fits a column or a page of a journal: columns chosen by name, settings in a legend, notes.

The narrowest of four layouts is taken that fits: in one column or across two, intervals beside the values or below
them. Widths are those of Times at 8 pt (STIX General, which matplotlib has), and a tenth more for other fonts.
"""

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from cooploc.analysis.metrics.consistency import OVER_CONFIDENT
from cooploc.analysis.paper.labels import Labels, over_lines
from cooploc.analysis.plot.style import COLUMNS, SMALL, text_width
from cooploc.analysis.report.sentences import Standing
from cooploc.analysis.report.tables import Row, Table, TableColumn, escaped
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
    names = max(map(text_width, first), default=0.0)
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
    value = max(map(text_width, one.values), default=0.0)
    ends = max((text_width(both, SMALL) for both in one.ends), default=0.0)
    beside = value if stacked else value + (2 * GAP + ends) * bool(ends)
    return max(text_width(one.head), beside, ends * stacked)


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


# An experiment's results as LaTeX tables that fit: short names, marks for what a reader must know, and notes.

LINES = 46  # of a table, so that it fits a page with its caption and its notes
MARKS = {
    "o": f"over-confident: the 95 % interval of its ANEES lies above {OVER_CONFIDENT:g}",
    "c": "centralised: knows all readings at once",
    "b": "bound: what no other can surpass",
    "f": "failed in some trials, numbers of the others",
}
SAID = {
    "rmse": "RMSE of position, pooled over robots and ticks",
    "change": "Change of the RMSE against {baseline}, paired by trial",
    "anees": "ANEES: 1 is consistent",
    "bytes": "Bytes that a robot sends per tick",
    "seconds": "Time per robot and tick",
}


class Placed(NamedTuple):
    """A table in a file of its own."""

    name: str
    latex: str
    columns: int  # of the paper that it is wide


def placed(
    name: str, table: Table, chosen: Sequence[str], known: Labels, found: list[Standing], about: str
) -> list[Placed]:
    """The tables of one experiment, each no longer than a page; `about` says trials and seed.

    Raises:
        BadInput: a chosen column is unknown, or they do not fit a page.

    """
    columns = quantities(table, chosen)
    marked = [_marks(row) for row in table.rows]
    first = [known.short[row["estimator"]] + " " + mark for row, mark in zip(table.rows, marked, strict=True)]
    how = layout(first, columns)
    written = [_named(known.short[row["estimator"]], mark) for row, mark in zip(table.rows, marked, strict=True)]
    columns = _bold(table.rows, columns, found) if "rmse" in chosen else columns
    pages = chunks(table.rows, how)
    out = []
    for number, rows in enumerate(pages, 1):
        here = [table.rows[row] for row in rows if isinstance(row, int)]
        marks = {mark for row in rows if isinstance(row, int) for mark in marked[row]}
        label = name if len(pages) == 1 else f"{name}-{number}"
        heads = ", ".join(one.head.partition(" [")[0] for one in columns)
        caption = f"{table.caption}: {heads}"
        body = tabular(columns, written, rows, how)
        notes = _notes(here, chosen, columns, marks, known, about)
        out.append(Placed(label, _float(label, caption, body, notes, how), how.columns))
    return out


def _marks(row: Row) -> str:
    """The letters of what a reader must know of a row."""
    known = {"o": row["consistency"] == "over-confident", "b": row["bound"], "f": row["failed"]}
    known["c"] = row["centralised"] and not row["bound"]
    return "".join(mark for mark in MARKS if known[mark])


def _named(short: str, marks: str) -> str:
    return escaped(short) + (rf"\textsuperscript{{{','.join(marks)}}}" if marks else "")


def _bold(rows: list[Row], columns: list[Quantity], found: list[Standing]) -> list[Quantity]:
    """The RMSE in bold of who is best in a scenario, and of who ties with it."""
    best = {(one.scenario, name) for one in found for name in (one.best, *one.equal, *one.tied) if one.best}
    bold = tuple((row["scenario"], row["estimator"]) in best for row in rows)
    return [one._replace(bold=bold) if one.head.startswith("RMSE") else one for one in columns]


def chunks(rows: list[Row], how: Layout) -> list[list[int | str]]:
    """The numbers of rows below the heads of their scenarios, parted so that no table is longer than a page."""
    out: list[list[int | str]] = [[]]
    left, height = LINES, 1 + how.stacked
    scenario = None
    several = len({row["scenario"] for row in rows}) > 1
    sizes = {s: sum(row["scenario"] == s for row in rows) * height for s in {row["scenario"] for row in rows}}
    for number, row in enumerate(rows):
        new = row["scenario"] != scenario
        if left < height or (new and out[-1] and left < min(LINES, sizes[row["scenario"]] + 1)):
            out, left, new = [*out, []], LINES, True
        if new and several:
            heads = over_lines(row["scenario"], lambda line: text_width(line) < how.width)
            out[-1] += [text(head) for head in heads]
            left -= len(heads)
        scenario = row["scenario"]
        out[-1].append(number)
        left -= height
    return out


def _notes(
    rows: list[Row], chosen: Sequence[str], columns: Iterable[Quantity], marks: set[str], known: Labels, about: str
) -> str:
    """What a reader needs to understand a table, in small print."""
    names = list(dict.fromkeys(row["estimator"] for row in rows))
    baselines = " or ".join(known.short[name] for name in dict.fromkeys(row["baseline"] for row in rows))
    said = [SAID[name].format(baseline=baselines) for name in chosen if name in SAID]
    said += ["In brackets: 95 % intervals over trials"] * any(one.ends for one in columns)
    bold = any(any(one.bold) for one in columns)
    said += ["Bold: lowest RMSE of those that may be called best, and what ties with it"] * bold
    sentences = [breakable(f"{sentence}.") for sentence in (about, *said)]
    sentences += [rf"\textsuperscript{{{mark}}}{breakable(said)}." for mark, said in MARKS.items() if mark in marks]
    sentences += [breakable(f"{line}.") for line in known.legend([*names, *(row["baseline"] for row in rows)])]
    return " ".join(sentences)


def breakable(words: str) -> str:
    """Text that may also break after a stroke, a comma and a sign of equality."""
    out = text(words)
    for sign in ("/", "=", ",", r"\_"):
        out = out.replace(sign, sign + r"\allowbreak{}")
    return out


def _float(label: str, caption: str, body: str, notes: str, how: Layout) -> str:
    name = "table" + "*" * (how.columns == 2)
    lines = [
        rf"\begin{{{name}}}[!t]",
        rf"\caption{{{breakable(caption)}}}",
        rf"\label{{tab:{label}}}",
        r"\centering\footnotesize\setlength{\tabcolsep}{3pt}",
        body,
        rf"\par\vspace{{3pt}}\parbox{{\linewidth}}{{\raggedright\scriptsize {notes}}}",
        rf"\end{{{name}}}",
    ]
    return "\n".join(lines) + "\n"
