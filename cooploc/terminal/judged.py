"""What `cooploc judge --truth` prints: who errs least, by how much, and what is odd about what was handed in."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.trajectories import drift_and_heading, judge_trajectories
from cooploc.analysis.report.tables import csv_text
from cooploc.estimators.errors import BadInput
from cooploc.terminal import tables
from cooploc.terminal.console import make_console

ONCE = ("estimator", "name", "ticks", "rmse", "rpe", "heading", "anees", "coverage95")


def show_trajectories(
    truth: Path, named: Mapping[str, str], align: str, axes: str, pieces: int, out: Path | None,
    as_json: bool, every_column: bool, legend: bool,
) -> None:  # fmt: skip
    """Judge trajectories in files by true ones, and print who errs least, each robot's errors, and remarks."""
    rows, remarks = judge_trajectories(truth, named, align, axes, pieces)
    whole, _ = judge_trajectories(truth, named, align, axes)
    mean = whole.assign(mse=whole["mse"] * whole["ticks"]).groupby("estimator", sort=False)[["mse", "ticks"]].sum()
    best = str((mean["mse"] / mean["ticks"]).idxmin())
    order = np.argsort(mean["mse"].to_numpy() / mean["ticks"].to_numpy(), kind="stable")
    rows = pd.concat([rows[rows["estimator"] == name] for name in mean.index[order]], ignore_index=True)
    table = compare(rows, best, full=True)
    robots = whole[list(ONCE)].rename(columns={"ticks": "poses", "estimator": "method", "name": "robot"})
    tables.show_table(table, rows, as_json, every_column, legend)
    console = make_console(stderr=as_json)
    if not as_json:
        if pieces > 1:
            console.print(f"trials are {pieces} pieces of the recording, one after the other and not independent")
        drift = drift_and_heading(rows).rename(columns={"estimator": "method"})
        caption = "drift: RPE [m] between neighbouring poses, heading [rad]; root mean squares"
        for text, found in (
            (caption, drift),
            ("each robot, over its whole path; RMSE and RPE as evo has them", robots),
        ):
            console.print(tables.frame(text, found).terminal())
    for remark in remarks:
        console.print(f"note: {remark}")
    if out:
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as e:
            raise BadInput(f"{out}: cannot be made ({e.strerror}); name another folder with --out") from None
        tables.keep_tables(table, rows, out)
        (out / "robots.csv").write_text(csv_text(robots), encoding="utf-8")
        console.print(f"tables and figure: {out}")
