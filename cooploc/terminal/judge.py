"""What `cooploc judge` prints: who errs least, by how much, and what is odd about what was handed in."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.external import (
    drift,
    evaluate_external,
    judge_matched,
    mean_drift,
    over_runs,
)
from cooploc.analysis.metrics.trajectory_runs import match_runs
from cooploc.analysis.report.tables import csv_text, frame
from cooploc.estimators.errors import BadInput, first_of
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.stream import Truth
from cooploc.terminal import tables
from cooploc.terminal.console import make_console

ONCE = ("estimator", "name", "ticks", "rmse", "rpe", "heading", "anees", "coverage95")
DRIFT = "drift: RPE [m] between neighbouring poses, heading [rad]; root mean squares"
EACH = "each robot, over its whole path; RMSE and RPE as evo has them"
EACH_OF_RUNS = "each robot, over all poses of all runs; with --out, robots.csv has each run"


def show_trajectories(
    truth: Path, named: Mapping[str, str], align: str, axes: str, pieces: int, within: float, out: Path | None,
    **shown: bool,
) -> None:  # fmt: skip
    """Judge trajectories in files by true ones, and print who errs least, each robot's errors, and remarks."""
    with make_console(stderr=True).status("matching paths with the truth; a hundred runs take half a minute"):
        found, remarks = match_runs(truth, named, align, axes, within)
    robots, true, paths = judge_matched(found, 1)
    rows, *_ = judge_matched(found, pieces)
    squares = robots["mse"] * robots["ticks"]  # of as many poses for each method
    order = squares.groupby(robots["estimator"], sort=False).sum().sort_values(kind="stable").index
    rows = pd.concat([rows[rows["estimator"] == name] for name in order], ignore_index=True)
    notes = [f"alignment: {align}; covariances in axes of the {axes}"]
    if len(found) > 1:
        notes.append(f"trials are {len(found)} runs: {first_of(found, 10)}; paths on the page are those of the first")
    elif pieces > 1:
        notes.append(f"trials are {pieces} pieces of the recording, one after the other and not independent")
    _show(rows, robots, true, paths, [*notes, *remarks], out, **shown)


def show_external(
    source: str, named: Mapping[str, str] | str, estimators: str | None, offline: bool, out: Path | None,
    how: Mapping[str, object], **shown: bool,
) -> None:  # fmt: skip
    """Judge trajectories that were computed from a stream of ours, and print who errs least."""
    rows, truth, run, remarks = evaluate_external(source, named, estimators, offline, **how)
    _show(rows.merge(drift(truth, run)), None, truth, run, remarks, out, **shown)


def _show(
    rows: pd.DataFrame, robots: pd.DataFrame | None, truth: Truth, run: Run, notes: Sequence[str], out: Path | None,
    as_json: bool, every_column: bool, legend: bool,
) -> None:  # fmt: skip
    """Print the results against the first method, drift, robots, and notes; with `out`, write them and a page, too."""
    table = compare(rows, rows["estimator"].iloc[0], full=True)
    tables.show_table(table, rows, as_json, every_column, legend)
    console, mean = make_console(stderr=as_json), mean_drift(rows).rename(columns={"estimator": "method"})
    parts = [frame(DRIFT, mean)] if mean[["rpe", "heading"]].notna().any(axis=None) else []
    if robots is not None:
        columns = {"ticks": "poses", "estimator": "method", "name": "robot"}
        pooled = over_runs(robots)[list(ONCE)].rename(columns=columns)
        robots = robots[[*ONCE, *robots.columns.intersection(["run"])]].rename(columns=columns)
        parts.append(frame(EACH_OF_RUNS if "run" in robots else EACH, pooled))
    for one in () if as_json else parts:
        console.print(one.terminal())
    for note in notes:
        console.print(f"note: {note}")
    if out is None:
        return
    from cooploc.analysis.report.section_pages import judged_page

    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as e:
        raise BadInput(f"{out}: cannot be made ({e.strerror}); name another folder by --out, in Python out=") from None
    tables.keep_tables(table, rows, out)
    if robots is not None:
        (out / "robots.csv").write_text(csv_text(robots), encoding="utf-8")
    (out / "index.html").write_text(judged_page(truth, run, rows, table, parts, notes), encoding="utf-8")
    console.print(f"page: {out / 'index.html'}; beside it tables and a figure")
