"""An experiment's results as LaTeX tables that fit: short names, marks for what a reader must know, and notes."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from cooploc.analysis.metrics.consistency import OVER_CONFIDENT
from cooploc.analysis.paper.fitted_table import Layout, Quantity, layout, quantities, tabular, text
from cooploc.analysis.paper.labels import Labels, over_lines
from cooploc.analysis.paper.sizes import width
from cooploc.analysis.report.latex import escaped
from cooploc.analysis.report.summaries import Standing
from cooploc.analysis.report.tables import Row, Table

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
            heads = over_lines(row["scenario"], lambda line: width(line) < how.width)
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
