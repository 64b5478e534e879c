"""A run for a paper: figures as PDF and SVG, LaTeX tables that fit, references, and an example document."""

import re
import tomllib
from collections.abc import Iterable, Sequence
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.execution.run_directory import StoredRun
from cooploc.analysis.metrics.consistency import OVER_CONFIDENT
from cooploc.analysis.metrics.crlb import floors
from cooploc.analysis.metrics.curves import sweep
from cooploc.analysis.plot import style
from cooploc.analysis.report import result_tables, sentences
from cooploc.analysis.report.run_figures import draw_experiment
from cooploc.analysis.report.run_numbers import (
    FLOORED,
    Labels,
    Numbers,
    first_middle_last,
    group_by_sweep,
    numbers_of,
    rank_scenario,
    rows_of_experiment,
    trial_counts,
)
from cooploc.analysis.report.tables import Row, Table, escape_latex
from cooploc.estimators import BUILTIN
from cooploc.estimators.errors import BadInput, nearest

EXAMPLE = "example.tex"
DEFAULT = ("rmse", "change", "anees", "bytes")  # columns of the tables


class PaperPart(NamedTuple):
    """An experiment: its rows of `compare` with floors, of the scenarios that are asked for."""

    name: str
    rows: pd.DataFrame
    scenarios: list[str]
    drawn: list[str]  # scenarios that sweep nothing and are drawn


def write(kept: StoredRun, out: Path, columns: Sequence[str] = DEFAULT, scenarios: Sequence[str] = ()) -> list[Path]:
    """Write figures/, tables/, estimators.bib and a document that includes them all; return the files.

    Every sweep is drawn. Of scenarios that sweep nothing, `scenarios` are, or else the first, the middle and the last
    of each experiment; the tables have all of them, or those of `scenarios`.

    Raises:
        BadInput: a scenario or a column is unknown.

    """
    numbers = numbers_of(kept)
    parts = _parts(numbers, scenarios)
    tables = {name: latex for part in parts for name, latex in _tables(part, numbers, columns).items()}
    for folder in ("figures", "tables"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    included: list[str] = []
    drawn: list[Path] = []
    for part in parts:
        looks = style.looks(part.rows["estimator"].unique())
        for width, look in style.PAPER.items():
            for figure, words, caption, rows in draw_experiment(part.rows, part.drawn, numbers.names, looks, look):
                name = f"{file_name(part.name, *words)}-{width}col"
                legend = [f"{line}." for line in numbers.names.legend(dict.fromkeys(rows["estimator"]))]
                paths = [out / "figures" / f"{name}.{ending}" for ending in ("pdf", "svg")]
                style.save(figure, *paths, rc=style.PAPER[1].rc)
                drawn += paths
                body = rf"\includegraphics{{{name}}}"
                included.append(_float("figure", width, f"fig:{name}", " ".join([caption, *legend]), body, ""))
    used = pd.concat([part.rows for part in parts])
    included += [rf"\input{{tables/{name}}}" for name in tables]
    texts = {f"tables/{name}.tex": latex for name, latex in tables.items()}
    texts["estimators.bib"] = bibtex(used["estimator"], used["scenario"])
    texts[EXAMPLE] = document(f"cooploc: {kept.manifest['study']['name']}", included)
    for name, text in texts.items():
        (out / name).write_text(text, encoding="utf-8")
    return [*drawn, *(out / name for name in texts)]


def _parts(numbers: Numbers, scenarios: Sequence[str]) -> list[PaperPart]:
    """Return the experiments with what is asked of them."""
    kept, there = numbers.kept, list(numbers.table["scenario"].unique())
    for name in scenarios:
        if name not in there:
            raise BadInput(f"this run has no scenario {name!r}; {nearest(name, there)}")
    parts = []
    for name, plan in kept.experiments.items():
        asked = [label for label in plan if not scenarios or label in scenarios]
        single = group_by_sweep(asked).get(("", ""), [])
        rows = rows_of_experiment(numbers.table, {label: plan[label] for label in asked})
        if asked:
            parts.append(PaperPart(name, rows, asked, single if scenarios else first_middle_last(single)))
    every = [label for part in parts for label in (*part.drawn, *(s for s in part.scenarios if sweep(s)[1]))]
    floor = floors(every, kept.manifest["seed"], FLOORED)
    return [part._replace(rows=part.rows.assign(floor=part.rows["scenario"].map(floor))) for part in parts]


# ------------------------------------------------------------------------------------------------ tables

FITTED = r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%"
LINES = 46  # of a table, so that it fits a page with its caption and its notes
ONE_COLUMN = 2  # columns beside the estimator that fit into a column of the paper
HEADS = {"change": "change", "seconds": "time [µs]"}
NOT_CHOSEN = {"scenario", "estimator", "consistency", "certificate", "verdict"}
MARKS = {
    "o": f"over-confident: the 95 % interval of its ANEES lies above {OVER_CONFIDENT:g}",
    "c": "centralised: knows all readings at once",
    "b": "bound: no estimator is better in a simulated world",
    "f": "failed in some trials, numbers of the others",
}
NOTES = {
    "rmse": "RMSE of position, pooled over robots and ticks",
    "change": "Change of the RMSE against {baseline}, paired by trial",
    "anees": "ANEES: 1 is consistent",
    "bytes": "Bytes that a robot sends per tick",
    "seconds": "Time per robot and tick",
}


def _tables(part: PaperPart, numbers: Numbers, columns: Sequence[str]) -> dict[str, str]:
    """Return the LaTeX of the tables of one experiment by name, each no longer than a page."""
    by_scenario = part.rows.groupby("scenario", sort=False)
    ranks = {str(s): rank_scenario(rows, numbers.results) for s, rows in by_scenario}
    table = result_tables.results(file_name(part.name), part.rows, ranks, part.name)
    heads, cells = _chosen_cells(table, columns)
    standings = sentences.standings(part.rows, numbers.results)
    best = {(one.scenario, name) for one in standings for name in (one.best, *one.equal, *one.tied)}
    if "rmse" in columns:
        at = list(columns).index("rmse")
        for row, texts in zip(table.rows, cells, strict=True):
            if (row["scenario"], row["estimator"]) in best:
                texts[at] = rf"\textbf{{{texts[at]}}}"
    about = f"{trial_counts(part.rows)}, seed {numbers.kept.manifest['seed']}"
    pages = pages_of([row["scenario"] for row in table.rows])
    out = {}
    for number, page in enumerate(pages, 1):
        rows = [table.rows[i] for i in page]
        name = table.name if len(pages) == 1 else f"{table.name}-{number}"
        body = _tabular(rows, [cells[i] for i in page], heads, numbers.names, len(by_scenario) > 1)
        caption = f"{table.caption}: {', '.join(head.partition(' [')[0] for head in heads)}"
        width = 1 if len(heads) <= ONE_COLUMN else 2
        out[name] = _float("table", width, f"tab:{name}", caption, body, _notes(rows, columns, numbers.names, about))
    return out


def _chosen_cells(table: Table, columns: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """Return the heads of the chosen columns and the LaTeX of their cells, each value with its interval."""
    every = {column.keys[0]: column for column in table.columns}
    names = [name for name in every if not name.endswith("_low") and name not in NOT_CHOSEN]
    for name in columns or [""]:
        if name not in names:
            raise BadInput(f"a paper's table has no column {name!r}; {nearest(name, names)}")
    heads, cells = [], []
    for name in columns:
        values = [every[name].text(row) for row in table.rows]
        ends = [every[f"{name}_low"].text(row) if f"{name}_low" in every else "" for row in table.rows]
        head = HEADS.get(name, every[name].head)
        if "[" not in head and any(text.endswith(" %") for text in values):
            values, ends = ([text.replace(" %", "") for text in texts] for texts in (values, ends))
            head += " [%]"
        brackets = [tex(f"[{both.replace(' to ', ', ')}]") for both in ends]
        small = [rf" {{\scriptsize {text}}}" if both else "" for text, both in zip(brackets, ends, strict=True)]
        heads.append(head)
        cells.append([tex(value) + both for value, both in zip(values, small, strict=True)])
    return heads, [list(row) for row in zip(*cells, strict=True)]


def _tabular(rows: list[Row], cells: list[list[str]], heads: list[str], names: Labels, several: bool) -> str:
    """Return the tabular, made smaller where it is wider than the column; scenarios head their rows."""
    lines = [rf"\begin{{tabular}}{{@{{}}l{'r' * len(heads)}@{{}}}}", r"\toprule"]
    lines += [" & ".join(map(tex, ["estimator", *heads])) + r" \\", r"\midrule"]
    before = None
    for row, texts in zip(rows, cells, strict=True):
        if several and row["scenario"] != before:
            lines.append(rf"\multicolumn{{{len(heads) + 1}}}{{@{{}}l@{{}}}}{{\itshape {tex(row['scenario'])}}} \\*")
        before, marks = row["scenario"], _marks(row)
        first = tex(names.of(row["estimator"])) + (rf"\textsuperscript{{{','.join(marks)}}}" if marks else "")
        lines.append(" & ".join([first, *texts]) + r" \\")
    return "\n".join([FITTED, *lines, r"\bottomrule", r"\end{tabular}}"])


def _marks(row: Row) -> str:
    """Return the letters of what a reader must know of a row."""
    known = {"o": row["consistency"] == "over-confident", "b": row["bound"], "f": row["failed"]}
    known["c"] = row["centralised"] and not row["bound"]
    return "".join(mark for mark in MARKS if known[mark])


def pages_of(scenarios: list[str]) -> list[list[int]]:
    """Return the numbers of rows, parted so that no table with the heads of its scenarios is longer than a page."""
    rows = max(1, LINES * len(scenarios) // (len(scenarios) + len(set(scenarios))) - 1)
    return [list(range(i, min(i + rows, len(scenarios)))) for i in range(0, len(scenarios), rows)]


def _notes(rows: list[Row], chosen: Sequence[str], names: Labels, about: str) -> str:
    """Return what a reader needs to understand a table, in small print."""
    baselines = dict.fromkeys(row["baseline"] for row in rows)
    marks = {mark for row in rows for mark in _marks(row)}
    known = {name: note.format(baseline=" or ".join(map(names.of, baselines))) for name, note in NOTES.items()}
    texts = [about, *(known[name] for name in chosen if name in known), "In brackets: 95 % intervals over trials"]
    texts += ["Bold: lowest RMSE of those that may be called best, and what ties with it"] * ("rmse" in chosen)
    texts += names.legend(dict.fromkeys([*(row["estimator"] for row in rows), *baselines]))
    explained = [rf"\textsuperscript{{{mark}}}{breakable(text)}." for mark, text in MARKS.items() if mark in marks]
    return " ".join([*(breakable(f"{text}.") for text in texts), *explained])


# ------------------------------------------------------------------------------------------------ LaTeX

START = r"""\IfFileExists{IEEEtran.cls}{\documentclass[journal]{IEEEtran}}{%
\documentclass[twocolumn]{article}\usepackage[letterpaper,textwidth=7.16in,textheight=9.4in,columnsep=0.16in]{geometry}}
\usepackage[T1]{fontenc}
\usepackage[utf8]{inputenc}
\usepackage{textcomp,booktabs,graphicx}
\graphicspath{{figures/}}
\begin{document}"""
END = r"""\nocite{*}
\IfFileExists{IEEEtran.bst}{\bibliographystyle{IEEEtran}}{\bibliographystyle{plain}}
\bibliography{estimators}
\end{document}"""
WAITING = 6  # floats, after which a page is begun; LaTeX keeps eighteen


def document(title: str, floats: list[str]) -> str:
    """Return a two-column paper that includes every figure and table; each figure stands in its own size."""
    body = [one + "\n\\clearpage" * (number % WAITING == 0) for number, one in enumerate(floats, 1)]
    return "\n".join([START, rf"\section*{{\raggedright {breakable(title)}}}", *body, END]) + "\n"


def _float(kind: str, width: int, label: str, caption: str, body: str, notes: str) -> str:
    """Return a figure or a table, one or two columns of the paper wide; a table's caption stands above it."""
    name = kind + "*" * (width == 2)
    title = [rf"\caption{{{breakable(caption)}}}", rf"\label{{{label}}}"]
    lines = [r"\centering", body, *title]
    if kind == "table":
        lines = [*title, r"\centering\footnotesize\setlength{\tabcolsep}{3pt}", body]
        lines += [rf"\par\vspace{{3pt}}\parbox{{\linewidth}}{{\raggedright\scriptsize {notes}}}"]
    return "\n".join([rf"\begin{{{name}}}[!t]", *lines, rf"\end{{{name}}}"]) + "\n"


def tex(text: str) -> str:
    """Return text for LaTeX, with the sign of minus as it is set in formulas."""
    return "$-$".join(map(escape_latex, re.split(r"(?<!\w)-(?=[\d.∞])", text)))


def breakable(text: str) -> str:
    """Return text for LaTeX that may also break after a stroke, a comma and a sign of equality."""
    out = tex(text)
    for sign in ("/", "=", ",", r"\_"):
        out = out.replace(sign, sign + r"\allowbreak{}")
    return out


def file_name(*words: str) -> str:
    """Return words as a name that LaTeX can include: letters, digits and hyphens."""
    return "-".join(re.sub(r"[^A-Za-z0-9]+", "-", word).strip("-") for word in words)[:80]


# ------------------------------------------------------------------------------------------------ references


@cache
def sources() -> dict[str, dict[str, Any]]:
    """Return every source by its key: its type, its fields, and the estimators or scenarios that rest on it."""
    return tomllib.loads((files(__package__) / "sources.toml").read_text("utf-8"))


def source_keys(estimator: str) -> list[str]:
    """Return the keys of what an estimator rests on, its own paper first; none of one that is not built in."""
    method = estimator.partition("[")[0]
    return [key for key, source in sources().items() if method in source.get("estimators", ())]


def bibtex(estimators: Iterable[str], scenarios: Iterable[str] = ()) -> str:
    """Return the entries of these estimators and scenarios, and of cooploc, as a .bib file."""
    names = list(dict.fromkeys(name.partition("[")[0] for name in estimators))
    families = {label.partition("/")[0].partition("[")[0] for label in scenarios}
    used = {"cooploc"} | {key for name in names for key in source_keys(name)}
    used |= {key for key, source in sources().items() if families & set(source.get("scenarios", ()))}
    entries = []
    for key in filter(used.__contains__, sources()):
        source = dict(sources()[key])
        kind, _, _ = source.pop("type"), source.pop("estimators", ()), source.pop("scenarios", ())
        source |= {"note": f"Version {version('cooploc')}"} if key == "cooploc" else {}
        entries.append("\n".join([f"@{kind}{{{key},", *(f"  {name} = {{{v}}}," for name, v in source.items()), "}\n"]))
    entries += [
        f"% {' '.join(name.split())} is not built in: add its source\n" for name in names if name not in BUILTIN
    ]
    return "\n".join(entries)
