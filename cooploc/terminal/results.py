"""A run's results: the table in the terminal, as JSON, as CSV, and the picture."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.execution.run_directory import RunDir
from cooploc.analysis.formats import counted
from cooploc.analysis.metrics import ranking
from cooploc.analysis.metrics.compare import outlier_warnings
from cooploc.analysis.metrics.errors import drop_failed, note_lines
from cooploc.analysis.report.csv_text import csv_text
from cooploc.analysis.report.failures import failures
from cooploc.analysis.report.result_columns import DECIDED, REMARK, RESULTS
from cooploc.analysis.report.result_tables import STOPPED, versus
from cooploc.analysis.report.tables import Table, numbers
from cooploc.terminal.console import wide

# What the words of a table mean: those that appear in it are explained below it.
MEANS = {
    "vs": "change of RMSE on the same streams, with its Fieller interval",
    "p (Holm)": "the test that the interval inverts, adjusted by Holm over the whole study",
    "ANEES": "1 is consistent, more is over-confident; median: of the trials' ANEES",
    "NLL": "negative log-likelihood of the true position; smaller is better",
    "outlying": "trials above 5 times the median RMSE",
    "collapsed": "trials whose ANEES exceeds 100",
    "messages": "messages, bytes and µs are per robot and tick",
    "over-wide": "ANEES below 0.1",
    "consistency not shown": "the interval of ANEES holds 0.67 or 1.5: more trials decide",
    "centralised": "every reading reaches one computer",
    "bound": "uses all readings; no estimator is better",
    "as published": "configured as in its paper; at its best: as the audit found it best",
}
ONLY_IN_REPORTS = (
    "scenario",
    "rank",
    "rmse_median",
    "group",
    "outlying_low",
    "anees_low",
    "collapsed_low",
    "area95",
    "trials",
)
COLUMNS = tuple(column for column in RESULTS if column.keys[0] not in ONLY_IN_REPORTS)
RARE = "outlying", "collapsed", "diverged"  # shares of trials or robots, left out where all are zero
ONE_PROCESS = "all or some of this ran in one process (--no-isolate): estimators may have disturbed each other"
IN_ONE_PICTURE = 12  # scenarios; `cooploc report` draws one of each experiment


def keep(table: pd.DataFrame, rows: pd.DataFrame, folder: Path) -> None:
    """Write the table of `compare` as `table.csv`, and `rmse.png` where any trial ended and it can be read."""
    (folder / "table.csv").write_text(csv_text(table), encoding="utf-8")
    ended = drop_failed(rows)
    if len(ended) and table["scenario"].nunique() <= IN_ONE_PICTURE:
        import matplotlib.pyplot as plt

        from cooploc.analysis.plot import rmse

        figure: Any = rmse(ended).figure
        figure.savefig(folder / "rmse.png", dpi=160)
        plt.close(figure)


def show(found: pd.DataFrame, rows: pd.DataFrame, folder: Path, as_json: bool) -> None:
    """Print the results of a run: its table, then failures, and where the files are."""
    table(found, rows, as_json)
    console = wide(stderr=as_json)
    if not RunDir(folder).manifest.get("isolated", True):
        console.print(ONE_PROCESS)
    for line, _ in failures(rows):
        console.print(f"failed: {line}")
    picture = f"{folder / 'rmse.png'}" if (folder / "rmse.png").exists() else f"cooploc report {folder}"
    for line in (f"picture: {picture}", f"table, every column: {folder / 'table.csv'}", f"run: {folder}"):
        console.print(line)


def table(table: pd.DataFrame, rows: pd.DataFrame, as_json: bool) -> None:
    """Print the table of `compare`, or JSON alone on stdout, and what a reader must know of it."""
    if as_json:
        print(json.dumps(records(table), indent=1))
    console = wide(stderr=as_json)
    if not as_json:
        for scenario, part in table.groupby("scenario", sort=False):
            console.print(_table(str(scenario), part).terminal())
            console.print()
        for line in _legend(table):
            console.print(line, style="dim")
        if "look" in table:
            console.print(STOPPED, style="dim")
        for line in note_lines(rows):
            console.print(line)
    for line in (*ranking.certificate_remarks(table), *outlier_warnings(table)):
        console.print(line)


def _legend(table: pd.DataFrame) -> list[str]:
    """What the words that appear in a table mean."""
    shown = _table("", table)
    words = {column.head for column in shown.columns if any(column.text(row) for row in shown.rows)}
    remarks = " ".join(REMARK.text(row) for row in shown.rows)
    return [f"{word}: {text}" for word, text in MEANS.items() if word == "vs" or word in words or word in remarks]


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows with the fields of `table.csv`, undefined values as None."""
    values = table.astype(object)
    known = values.notna() & ~values.isin([np.inf, -np.inf])
    return values.where(known, None).to_dict("records")  # type: ignore[return-value]


def _table(scenario: str, part: pd.DataFrame) -> Table:
    first = part.iloc[0]
    size = f"{counted(first['robots'], 'robot')}, {counted(part['trials'].max(), 'trial')}"
    title = f"{scenario}: {size}, stream {first['stream'][:12]}"
    columns = (*COLUMNS, numbers("trials"), DECIDED) if "look" in part else COLUMNS
    shown = tuple(c for c in columns if not (c.keys[0] in RARE and (part[c.keys[0]].fillna(0) == 0).all()))
    return Table("results", title, versus(part["baseline"], shown), part.to_dict("records"))
