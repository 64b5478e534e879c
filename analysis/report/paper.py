"""A run for a paper: figures as PDF and SVG, LaTeX tables that fit, references, and an example document."""

import re
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from cooploc.analysis.execution.run_directory import StoredRun
from cooploc.analysis.metrics.crlb import floors
from cooploc.analysis.metrics.sweeps import sweeps
from cooploc.analysis.plot import style
from cooploc.analysis.report import result_tables, run_numbers, sentences
from cooploc.analysis.report.labels import Labels
from cooploc.analysis.report.run_numbers import OTHERS, Numbers, RunFigure, draw_experiment
from cooploc.analysis.report.tables import Row, Table, escape_latex, fill_template, read_toml, words
from cooploc.estimators import BUILTIN
from cooploc.estimators.errors import BadInput, count_of, nearest

EXAMPLE = "example.tex"
SOURCES = "sources.toml"  # key -> type, fields, and the estimators or scenarios that rest on it
DEFAULT = ("rmse", "change", "anees", "bytes")  # columns of the tables
FIGURES = ("rmse", "anees", "bytes")
KINDS = ("rmse", *OTHERS)  # of figures


class PaperPart(NamedTuple):
    """An experiment: its rows of `compare` with floors, of the scenarios that are asked for."""

    name: str
    rows: pd.DataFrame
    drawn: list[str]  # scenarios that sweep nothing and are drawn


@style.as_shipped()
def write(
    kept: StoredRun,
    out: Path,
    columns: Sequence[str] = DEFAULT,
    figures: Sequence[str] = FIGURES,
    every_scenario: bool = False,
    everything: bool = False,
) -> list[Path]:
    """Write figures/, tables/, estimators.bib and a document that includes them all; return the files.

    They are those `figures` of the first experiment, and its table, or `everything`: all figures in both widths. Of
    scenarios that sweep nothing, `every_scenario` is drawn, or else the first, the middle and the last of each
    experiment.

    Raises:
        BadInput: a column or a figure is unknown.

    """
    for name in figures:
        if name not in KINDS:
            raise BadInput(f"a paper has no figure {name!r}; {nearest(name, list(KINDS))}")
    numbers = run_numbers.numbers_of(kept)
    parts = _parts(numbers, every_scenario, everything)
    tables = {name: latex for part in parts for name, latex in _tables(part, numbers, columns).items()}
    for folder in ("figures", "tables"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    included, paths = [], []
    drawn = [one for part in parts for one in _figures(part, numbers, figures, everything)]
    for name, width, (figure, _, caption, rows) in drawn:
        files = [out / "figures" / f"{name}.{ending}" for ending in ("pdf", "svg")]
        style.save(figure, *files, rc=style.PAPER[1].rc)
        paths += files
        legend = [f"{line}." for line in numbers.names.legend(dict.fromkeys(rows["estimator"]))]
        words = " ".join([_in_sentence(caption, rows, numbers), *legend])
        included.append(_float("figure", width, f"fig:{name}", words, rf"\includegraphics{{{name}}}", ""))
    used = pd.concat([part.rows for part in parts])
    included += [rf"\input{{tables/{name}}}" for name in tables]
    texts = {f"tables/{name}.tex": latex for name, latex in tables.items()}
    texts["estimators.bib"] = bibtex(used["estimator"], used["scenario"])
    texts[EXAMPLE] = document(f"cooploc: {kept.manifest['study']['name']}", included)
    for name, text in texts.items():
        (out / name).write_text(text, encoding="utf-8")
    return [*paths, *(out / name for name in texts)]


def _parts(numbers: Numbers, every_scenario: bool, everything: bool) -> list[PaperPart]:
    """Return the experiments, or the first, with the scenarios that are drawn."""
    parts = []
    for name, plan in list(numbers.kept.experiments.items())[: None if everything else 1]:
        single = run_numbers.group_by_sweep(list(plan)).get(("", ""), [])
        drawn = single if every_scenario else run_numbers.first_middle_last(single)
        shown = {s: names for s, names in plan.items() if everything or s in drawn or s not in single}
        rows = run_numbers.rows_of_experiment(numbers.table, shown)
        floored = [*drawn, *(label for label, point in sweeps(shown).items() if point.parameter)]
        lowest = floors(floored, numbers.kept.manifest["seed"], run_numbers.FLOORED)
        parts.append(PaperPart(name, rows.assign(floor=rows["scenario"].map(lowest)), drawn))
    return parts


def _figures(
    part: PaperPart, numbers: Numbers, kinds: Sequence[str], everything: bool
) -> Iterator[tuple[str, int, RunFigure]]:
    """Draw figures of an experiment, each with its name and the number of columns of the paper that it is wide.

    They are `everything` in both widths; or else errors in all scenarios or over a sweep, and in the last scenario
    errors against each cost, once each.
    """
    pens, ended = style.pens(part.rows["estimator"].unique()), part.rows[part.rows["rmse"].notna()]
    for width, medium in style.PAPER.items() if everything else ():
        costly = run_numbers.first_middle_last(part.drawn or list(part.rows["scenario"].unique()))
        for drawn in draw_experiment(part.rows, part.drawn, costly, numbers.names, pens, medium):
            yield f"{file_name(part.name, *drawn.words)}-{width}col", width, drawn
    for kind in kinds if len(ended) and not everything else ():
        rows = ended if kind == "rmse" else ended[ended["scenario"] == ended["scenario"].iloc[-1]]
        shown = list(rows["scenario"].unique())
        width = 2 if len(shown) > 1 else 1
        chosen = draw_experiment(rows, part.drawn, shown, numbers.names, pens, style.PAPER[width], kind)
        yield from ((kind, width, drawn) for drawn in islice(chosen, 1))


def _in_sentence(caption: str, rows: pd.DataFrame, numbers: Numbers) -> str:
    """Return a caption that stands alone: what is drawn, in what experiment, of how many trials."""
    study = numbers.kept.manifest["study"]
    about = str(study.get("about") or study.get("title") or study["name"]).rstrip(".")
    return f"{caption} {about}; {run_numbers.trial_counts(rows)}, paired, seed {numbers.kept.manifest['seed']}."


# ------------------------------------------------------------------------------------------------ tables

FITTED = r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%"
LINES = 46  # of a table, so that it fits a page with its caption and its notes
ONE_COLUMN = 2  # columns beside the estimator that fit into a column of the paper
HEADS = {"change": "change", "seconds": "time [µs]"}
NOT_CHOSEN = {"scenario", "estimator", "consistency", "certificate", "verdict"}


def _tables(part: PaperPart, numbers: Numbers, columns: Sequence[str]) -> dict[str, str]:
    """Return the LaTeX of the tables of one experiment by name, each no longer than a page."""
    table = result_tables.results(file_name(part.name), part.rows, numbers.results, part.name)
    heads, cells = _chosen_cells(table, columns)
    standings = sentences.standings(part.rows, numbers.results)
    best = {(one.scenario, name) for one in standings for name in (one.best, *one.equal, *one.tied)}
    if "rmse" in columns:
        at = list(columns).index("rmse")
        for row, texts in zip(table.rows, cells, strict=True):
            if (row["scenario"], row["estimator"]) in best:
                texts[at] = rf"\textbf{{{texts[at]}}}"
    pages = pages_of([row["scenario"] for row in table.rows])
    out = {}
    for number, page in enumerate(pages, 1):
        rows = [table.rows[i] for i in page]
        name = table.name if len(pages) == 1 else f"{table.name}-{number}"
        body = _tabular(rows, [cells[i] for i in page], heads, numbers.names, part.rows["scenario"].nunique() > 1)
        count = len(dict.fromkeys(row["estimator"] for row in rows))
        heading = f"{', '.join(head.partition(' [')[0] for head in heads)} of {count_of(count, 'estimator')}."
        caption = _in_sentence(heading[:1].upper() + heading[1:], part.rows, numbers)
        width = 1 if len(heads) <= ONE_COLUMN else 2
        out[name] = _float("table", width, f"tab:{name}", caption, body, _notes(rows, columns, numbers.names))
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
    before, cited = None, set[str]()
    for row, texts in zip(rows, cells, strict=True):
        if several and row["scenario"] != before:
            lines.append(rf"\multicolumn{{{len(heads) + 1}}}{{@{{}}l@{{}}}}{{\itshape {tex(row['scenario'])}}} \\*")
        before, marks = row["scenario"], _marks(row)
        first = tex(names.shorten(row["estimator"])) + (rf"\textsuperscript{{{','.join(marks)}}}" if marks else "")
        keys = source_keys(row["estimator"])[:1]
        first += rf"~\cite{{{keys[0]}}}" if keys and row["estimator"] not in cited else ""
        cited.add(row["estimator"])
        lines.append(" & ".join([first, *texts]) + r" \\")
    return "\n".join([FITTED, *lines, r"\bottomrule", r"\end{tabular}}"])


def _marks(row: Row) -> str:
    """Return the letters of what a reader must know of a row."""
    known = {"o": row["consistency"] == "over-confident", "b": row["bound"], "f": row["failed"]}
    known["c"] = row["centralised"] and not row["bound"]
    return "".join(mark for mark in words("marks") if known[mark])


def pages_of(scenarios: list[str]) -> list[list[int]]:
    """Return the numbers of rows, parted so that no table with the heads of its scenarios is longer than a page."""
    rows = max(1, LINES * len(scenarios) // (len(scenarios) + len(set(scenarios))) - 1)
    return [list(range(i, min(i + rows, len(scenarios)))) for i in range(0, len(scenarios), rows)]


def _notes(rows: list[Row], chosen: Sequence[str], names: Labels) -> str:
    """Return what a reader needs to understand a table, in small print."""
    baselines = " or ".join(map(names.shorten, dict.fromkeys(row["baseline"] for row in rows)))
    marks = {mark for row in rows for mark in _marks(row)}
    known = {name: note.format(baseline=baselines) for name, note in words("notes").items()}
    texts = [*(known[name] for name in chosen if name in known), "In brackets: 95 % intervals over trials"]
    texts += ["Bold: lowest RMSE of those that may be called best, and what ties with it"] * ("rmse" in chosen)
    texts += names.legend(dict.fromkeys([*(row["estimator"] for row in rows), *baselines]))
    explained = [
        rf"\textsuperscript{{{mark}}}{breakable(text)}." for mark, text in words("marks").items() if mark in marks
    ]
    return " ".join([*(breakable(f"{text}.") for text in texts), *explained])


# ------------------------------------------------------------------------------------------------ LaTeX

WAITING = 6  # floats, after which a page is begun; LaTeX keeps eighteen


def document(title: str, floats: list[str]) -> str:
    """Return a two-column paper that includes every figure and table; each figure stands in its own size."""
    body = [one + "\n\\clearpage" * (number % WAITING == 0) for number, one in enumerate(floats, 1)]
    return fill_template("example.tex.j2", title=breakable(title), floats="\n".join(body))


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


def source_keys(estimator: str) -> list[str]:
    """Return the keys of what an estimator rests on, its own paper first; none of one that is not built in."""
    method = estimator.partition("[")[0]
    return [key for key, source in read_toml(SOURCES).items() if method in source.get("estimators", ())]


def bibtex(estimators: Iterable[str], scenarios: Iterable[str] = ()) -> str:
    """Return the entries of these estimators and scenarios, and of cooploc, as a .bib file."""
    names = list(dict.fromkeys(name.partition("[")[0] for name in estimators))
    families = {label.partition("/")[0].partition("[")[0] for label in scenarios}
    used = {"cooploc"} | {key for name in names for key in source_keys(name)}
    used |= {key for key, source in read_toml(SOURCES).items() if families & set(source.get("scenarios", ()))}
    entries = []
    for key in filter(used.__contains__, read_toml(SOURCES)):
        source = dict(read_toml(SOURCES)[key])
        kind, _, _ = source.pop("type"), source.pop("estimators", ()), source.pop("scenarios", ())
        source |= {"note": f"Version {version('cooploc')}"} if key == "cooploc" else {}
        entries.append("\n".join([f"@{kind}{{{key},", *(f"  {name} = {{{v}}}," for name, v in source.items()), "}\n"]))
    entries += [
        f"% {' '.join(name.split())} is not built in: add its source\n" for name in names if name not in BUILTIN
    ]
    return "\n".join(entries)
