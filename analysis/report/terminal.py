"""A run's results for people and programs: the table in the terminal, as JSON, as CSV, and the picture."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from cooploc.analysis.metrics import certificate_line
from cooploc.analysis.metrics.certificate_line import mark, refused
from cooploc.analysis.metrics.compare import SUMMARY
from cooploc.analysis.metrics.pooling import notes, succeeded

HEADS = (
    "estimator",
    "checks",
    "RMSE [m]",
    "95 %",
    "versus",
    "95 %",
    "p (Holm)",
    "ANEES",
    "in 95 %",
    "diverged",
    *("msg", "bytes", "µs", ""),
)

LEGEND = (
    "vs: change of RMSE on the same streams, Fieller interval; p: Wilcoxon signed-rank over trials, Holm over the "
    "whole study. ANEES: 1 is consistent. msg, bytes, µs: per robot and tick. bound: knows more than any robot could."
)

IN_ONE_PICTURE = 12  # scenarios; `cooploc report` draws one of each experiment


def keep(table: pd.DataFrame, rows: pd.DataFrame, folder: Path) -> None:
    """Write the table of `compare` as `table.csv`, and `rmse.png` where any trial ended and it can be read."""
    table.to_csv(folder / "table.csv", index=False)
    ended = succeeded(rows)
    if len(ended) and table["scenario"].nunique() <= IN_ONE_PICTURE:
        import matplotlib.pyplot as plt

        from cooploc.analysis.plot.summary import rmse

        figure: Any = rmse(ended).figure
        figure.savefig(folder / "rmse.png", dpi=160)
        plt.close(figure)


def show(table: pd.DataFrame, rows: pd.DataFrame, folder: Path, as_json: bool) -> None:
    """Print the results: the table of `compare`, or JSON alone on stdout; then failures, and where the files are."""
    if as_json:
        print(json.dumps(records(table), indent=1))
    # Wide: a terminal may wrap a row, but numbers are never cut off.
    console = Console(stderr=as_json, highlight=False, markup=False, width=400)
    if not as_json:
        for scenario, part in table.groupby("scenario", sort=False):
            console.print(_table(str(scenario), part))
            console.print()
        console.print(LEGEND, style="dim", soft_wrap=True)
        for line in notes(rows):
            console.print(line, soft_wrap=True)
    for line in certificate_line.remarks(table):
        console.print(line, soft_wrap=True)
    for row in rows[rows["failure"].notna()].drop_duplicates(["scenario", "estimator", "failure"]).itertuples():
        console.print(f"failed: {row.scenario}, {row.estimator}, trial {row.trial}: {row.failure}", soft_wrap=True)
    picture = f"{folder / 'rmse.png'}" if (folder / "rmse.png").exists() else f"cooploc report {folder}"
    console.print(f"picture: {picture}   table: {folder / 'table.csv'}   run: {folder}", soft_wrap=True)


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows with the fields of `SUMMARY`, undefined values as None."""
    rows = table[list(SUMMARY)].to_dict("records")
    return [{str(k): _plain(v) for k, v in row.items()} for row in rows]


def _plain(value: Any) -> Any:
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def _table(scenario: str, part: pd.DataFrame) -> Table:
    first = part.iloc[0]
    baseline = str(first["baseline"])
    robots, trials = first["robots"], part["trials"].max()
    counted = f"{robots} robot{'s' if robots > 1 else ''}, {trials} trial{'s' if trials > 1 else ''}"
    title = f"{scenario}: {counted}, stream {first['stream'][:12]}"
    table = Table(title=title, title_justify="left", header_style="bold", box=None, padding=(0, 1))
    rows = [_cells(row, baseline) for _, row in part.iterrows()]
    said = [i for i in range(len(HEADS)) if any(cells[i] for cells in rows)]  # without columns that say nothing
    for i in said:
        side: Any = "left" if i in (0, 1, len(HEADS) - 1) else "right"
        table.add_column(f"vs {baseline}" if HEADS[i] == "versus" else HEADS[i], justify=side, no_wrap=True)
    for cells in rows:
        table.add_row(*(cells[i] for i in said))
    return table


def _cells(row: pd.Series, baseline: str) -> tuple[str, ...]:
    against = _percent(row["change"]), _percents(row), _p(row["p_holm"])
    remarks = ["not ranked"] if refused(row["certificate"]) else []
    remarks += [row["consistency"]] if row["consistency"] in ("over-confident", "conservative") else []
    remarks += ["bound"] if row["bound"] else []
    remarks += [f"{row['failed']} failed"] if row["failed"] else []
    return (
        row["estimator"],
        mark(row["certificate"]),
        _number(row["rmse"], 3),
        _between(row["rmse_low"], row["rmse_high"], 3),
        *(against if row["estimator"] != baseline else ("", "", "")),
        _number(row["anees"], 2),
        _number(100 * row["coverage95"], 0, " %"),
        _number(100 * row["diverged"], 1, " %"),
        _number(row["messages"], 2),
        _number(row["bytes"], 0),
        _number(1e6 * row["seconds"], 0),
        ", ".join(remarks),
    )


def _percents(row: pd.Series) -> str:
    low, high = row["change_low"], row["change_high"]
    return f"{_percent(low)}, {_percent(high)}" if np.isfinite(low) and np.isfinite(high) else ""


def _percent(value: float) -> str:
    if not np.isfinite(value):
        return ""
    whole = round(100 * value)
    return f"{whole:+d} %" if whole else "0 %"


def _between(low: float, high: float, digits: int) -> str:
    return f"{low:.{digits}f}–{high:.{digits}f}" if np.isfinite(low) else ""


def _number(value: float, digits: int, unit: str = "") -> str:
    return f"{value:.{digits}f}{unit}" if np.isfinite(value) else "–"


def _p(value: float) -> str:
    if not np.isfinite(value):
        return ""
    return f"{value:.3f}" if value >= 0.001 else "<0.001"
