"""The BibTeX entries of the estimators and recordings that a run used, from `sources.toml`."""

import tomllib
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cooploc.analysis.claims.trial_table import TrialTable, collect
from cooploc.analysis.execution.run_directory import StoredRun
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.crlb import floors
from cooploc.analysis.metrics.curves import sweep
from cooploc.analysis.metrics.sequential import ANYTIME, FIXED, with_decisions
from cooploc.analysis.paper.labels import Labels, file_name, labels
from cooploc.analysis.paper.tables import Placed, breakable, placed
from cooploc.analysis.plot import results as figures
from cooploc.analysis.plot import style
from cooploc.analysis.report import result_tables, sentences
from cooploc.analysis.report.html_page import groups, ranked
from cooploc.analysis.report.page_texts import FLOORED
from cooploc.analysis.report.tables import escaped
from cooploc.estimators import BUILTIN
from cooploc.estimators.errors import BadInput, nearest

NOT_FIELDS = ("type", "estimators", "scenarios")


@cache
def sources() -> dict[str, dict[str, Any]]:
    """Every source by its key: its type, its fields, and the estimators or families of scenarios that rest on it."""
    return tomllib.loads((files(__package__) / "sources.toml").read_text("utf-8"))


def keys(estimator: str) -> list[str]:
    """The keys of what an estimator rests on, its own paper first; none of one that is not built in."""
    method = estimator.partition("[")[0]
    return [key for key, source in sources().items() if method in source.get("estimators", ())]


def bibtex(estimators: Iterable[str], scenarios: Iterable[str] = ()) -> str:
    """The entries of these estimators and scenarios, and of cooploc, as a .bib file."""
    names = list(dict.fromkeys(name.partition("[")[0] for name in estimators))
    families = {label.partition("/")[0].partition("[")[0] for label in scenarios}
    used = {key for name in names for key in keys(name)}
    used |= {key for key, source in sources().items() if families & set(source.get("scenarios", ()))}
    entries = [_entry(key, source) for key, source in sources().items() if key in used or key == "cooploc"]
    missing = [f"% {' '.join(name.split())} is not built in: add its source\n" for name in names if name not in BUILTIN]
    return "\n".join([*entries, *missing])


def _entry(key: str, source: dict[str, Any]) -> str:
    fields = {name: value for name, value in source.items() if name not in NOT_FIELDS}
    if key == "cooploc":
        fields["note"] = f"Version {version('cooploc')}"
    lines = [f"  {name} = {{{value}}}," for name, value in fields.items()]
    return "\n".join([f"@{source['type']}{{{key},", *lines, "}"]) + "\n"


# An example of a two-column paper that includes every figure and table of a run, to look at and to copy from.

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


class Included(NamedTuple):
    """A figure in files of its own."""

    name: str
    caption: str
    columns: int  # of the paper that it is wide


def document(title: str, figures: list[Included], tables: list[Placed]) -> str:
    """The text of the document; each figure stands in its own size, so that its letters have theirs."""
    floats = [*map(_figure, figures), *(rf"\input{{tables/{one.name}}}" for one in tables)]
    lines = [START, rf"\section*{{{escaped(title)}}}"]
    for number, one in enumerate(floats, 1):
        lines += [one, *([r"\clearpage"] if number % WAITING == 0 else [])]
    return "\n".join([*lines, END]) + "\n"


def _figure(one: Included) -> str:
    name = "figure" + "*" * (one.columns == 2)
    lines = [
        rf"\begin{{{name}}}[!t]",
        r"\centering",
        rf"\includegraphics{{{one.name}}}",
        rf"\caption{{{breakable(one.caption)}}}",
        rf"\label{{fig:{one.name}}}",
        rf"\end{{{name}}}",
    ]
    return "\n".join(lines)


# Short labels for a paper: the settings of a configured estimator become a letter, which a legend explains.
#
# "ekf-local[anchor_reading=rssi]" is written "ekf-local [a]", and the legend says "[a] anchor_reading=rssi". Equal
# settings have equal letters.


# Write what a run has for a paper: figures as PDF and SVG at one and two columns' width, tables, references.

EXAMPLE = "example.tex"
OVER = (
    "Position RMSE over {} in {}; bands: 95 % intervals over trials. Hollow: over-confident, broken lines: so at most "
    "values; grey and dotted: centralised."
)
DOTS = "Position RMSE with 95 % intervals over trials. Hollow: over-confident; grey: centralised; dotted: the floor."
AGAINST = "Position RMSE against {} in {}, with 95 % intervals over trials. Hollow: over-confident; grey: centralised."
NAMES = {"anees": "ANEES (grey band: consistent)", "bytes": "bytes (broken: the Pareto front)"}
NAMES["seconds"] = "time (broken: the Pareto front)"


class Part(NamedTuple):
    """One experiment: its rows of `compare` with floors, of the scenarios that are asked for."""

    name: str
    rows: pd.DataFrame
    scenarios: list[str]
    drawn: list[str]  # scenarios that sweep nothing and are drawn


class Drawn(NamedTuple):
    """A figure before it is saved."""

    figure: Figure
    included: Included


def write(kept: StoredRun, out: Path, columns: Sequence[str], scenarios: Sequence[str] = ()) -> list[Path]:
    """Write figures/, tables/, estimators.bib and a document that includes them all; returns the files.

    Every sweep is drawn. Of scenarios that sweep nothing, `scenarios` are, or else the first, the middle and the last
    of each experiment; the tables have all of them, or those of `scenarios`.

    Raises:
        BadInput: a scenario or a column is unknown, or the columns do not fit a page.

    """
    known = labels(kept.rows["estimator"].unique())
    stopping = ANYTIME if kept.looks else FIXED
    results = collect(kept.rows, stopping)
    parts = _parts(kept, scenarios)
    shown = [one for part in parts for one in _tables(part, results, columns, known, kept)]
    for name in ("figures", "tables"):
        (out / name).mkdir(parents=True, exist_ok=True)
    included = []
    drawn: list[Path] = []
    for part in parts:
        for one in _figures(part, known):
            names = [out / "figures" / f"{one.included.name}.{ending}" for ending in style.FORMATS]
            style.save(one.figure, *names, rc=style.PAPER[1].rc)
            drawn += names
            included.append(one.included)
    texts = {f"tables/{one.name}.tex": one.latex for one in shown}
    used = pd.concat([part.rows for part in parts])
    texts["estimators.bib"] = bibtex(used["estimator"], used["scenario"])
    texts[EXAMPLE] = document(f"cooploc: {kept.manifest['study']['name']}", included, shown)
    for name, text in texts.items():
        (out / name).write_text(text, encoding="utf-8")
    return [*drawn, *(out / name for name in texts)]


def _parts(kept: StoredRun, scenarios: Sequence[str]) -> list[Part]:
    """The experiments with what is asked of them."""
    there = list(kept.rows["scenario"].unique())
    for name in scenarios:
        if name not in there:
            raise BadInput(f"this run has no scenario {name!r}; {nearest(name, there)}")
    table = compare(kept.rows, kept.baselines, full=True)
    table = table if kept.comparisons is None else with_decisions(table, kept.comparisons)
    parts = []
    for name, plan in kept.experiments.items():
        asked = [label for label in plan if not scenarios or label in scenarios]
        single = [label for (_, parameter), found in groups(asked).items() if not parameter for label in found]
        mine = [e in plan.get(s, ()) and s in asked for s, e in zip(table["scenario"], table["estimator"], strict=True)]
        if asked:
            parts.append(Part(name, table[mine], asked, single if scenarios else _three(single)))
    every = [label for part in parts for label in (*part.drawn, *(s for s in part.scenarios if sweep(s)[1]))]
    floor = floors(every, kept.manifest["seed"], FLOORED)
    return [part._replace(rows=part.rows.assign(floor=part.rows["scenario"].map(floor))) for part in parts]


def _tables(part: Part, results: TrialTable, columns: Sequence[str], known: Labels, kept: StoredRun) -> list[Placed]:
    by_scenario = part.rows.groupby("scenario", sort=False)
    asked = {"rank", "group"} & set(columns)
    ranks = {str(label): ranked(rows, results) if asked else ({}, {}) for label, rows in by_scenario}
    table = result_tables.results(file_name(part.name), part.rows, ranks, part.name)
    found = sentences.standings(part.rows, results)
    return placed(table.name, table, columns, known, found, _about(part.rows, kept))


def _figures(part: Part, known: Labels) -> Iterator[Drawn]:
    """Every figure of an experiment at both widths."""
    looks = style.looks(part.rows["estimator"].unique())
    anchor = file_name(part.name)
    for width, look in style.PAPER.items():
        for (family, parameter), labels_ in groups(part.scenarios).items():
            rows = part.rows[part.rows["scenario"].isin(labels_)]
            if parameter and rows["rmse"].notna().any():
                made = figures.sweep_panels(rows, looks, known.short.__getitem__, look)[0]
                yield _named(made, [anchor, family, parameter], OVER.format(parameter, family), rows, known, width)
        ended = part.rows[part.rows["rmse"].notna()]
        single = [(label, ended[ended["scenario"] == label]) for label in part.drawn]
        single = [(label, rows) for label, rows in single if len(rows)]
        for together in _by(single, 1 if width == 1 else 3):
            made = figures.ranking([rows for _, rows in together], looks, known.short.__getitem__, look)
            rows = pd.concat([rows for _, rows in together])
            yield _named(made, [anchor, "rmse", together[0][0]], DOTS, rows, known, width)
        swept = [label for label in part.scenarios if label not in {name for name, _ in single}]
        for label in part.drawn or _three(swept):
            rows = ended[ended["scenario"] == label]
            for others in [tuple(NAMES)] if width == 2 else [(other,) for other in NAMES]:
                if len(rows):
                    made = figures.against(rows, others, looks, known.short.__getitem__, look)
                    said = AGAINST.format(", ".join(NAMES[other] for other in others), label)
                    yield _named(made, [anchor, "-".join(others), label], said, rows, known, width)


def _named(made: Figure, words: list[str], said: str, rows: pd.DataFrame, known: Labels, width: int) -> Drawn:
    """A figure with its name, its caption and its legend."""
    legend = known.legend(dict.fromkeys(rows["estimator"]))
    name = f"{file_name(*words)}-{width}col"
    return Drawn(made, Included(name, " ".join([said, *(f"{line}." for line in legend)]), width))


def _three(labels: list[str]) -> list[str]:
    """The first, the middle and the last of many."""
    return labels if len(labels) <= 3 else [labels[int(i)] for i in np.linspace(0, len(labels) - 1, 3)]


def _by(found: list[tuple[str, pd.DataFrame]], number: int) -> Iterable[list[tuple[str, pd.DataFrame]]]:
    return (found[i : i + number] for i in range(0, len(found), number))


def _about(rows: pd.DataFrame, kept: StoredRun) -> str:
    counts = np.unique(rows["trials"])
    trials = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    return f"n = {trials} trials a scenario, seed {kept.manifest['seed']}"
