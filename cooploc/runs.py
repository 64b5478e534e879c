"""Whole studies from Python: run one, load what it left, judge it, report it, compare two.

Each function does what the command of the same purpose does; the command line calls these and prints what they return.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

import pandas as pd

from cooploc.analysis.claims import ledger as ledgers
from cooploc.analysis.execution import reproduce as again
from cooploc.analysis.execution.run import execute, prepare
from cooploc.analysis.execution.run_directory import StoredRun, read_run
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.sequential import with_decisions
from cooploc.analysis.report import html_page, run_diff
from cooploc.estimators import split_labels
from cooploc.estimators.errors import BadInput
from cooploc.run_options import How
from cooploc.scenarios.studies.study import Study, load
from cooploc.terminal import tables
from cooploc.terminal.console import TerminalProgress


@dataclass(frozen=True, eq=False, repr=False)
class Results:
    """What a run of a study found, and the directory that holds it."""

    folder: Path
    rows: pd.DataFrame  # as `cl.errors`, with `failure`, `traceback` and `certificate`
    table: pd.DataFrame  # as `cl.compare`, each scenario against its study's baseline
    decisions: pd.DataFrame | None = None  # of a run until decided: verdict, look and e-value of every comparison

    @property
    def failures(self) -> pd.DataFrame:
        """One row per trial that failed, with its `failure` and its `traceback`."""
        failed = self.rows[self.rows["failure"].notna()].drop_duplicates(["scenario", "estimator", "trial"])
        return failed[["scenario", "estimator", "trial", "failure", "traceback"]].reset_index(drop=True)

    def __repr__(self) -> str:
        scenarios, estimators = (self.table[column].nunique() for column in ("scenario", "estimator"))
        return f"Results({str(self.folder)!r}, {scenarios} scenarios, {estimators} estimators)"

    def _repr_html_(self) -> str:
        shown = ["scenario", "estimator", "trials", "failed", "rmse", "rmse_low", "rmse_high", "anees", "consistency"]
        return self.table[shown].round(3).to_html(index=False)


@dataclass(frozen=True, eq=False)
class RunChanges:
    """What differs between two runs."""

    table: pd.DataFrame  # one row per (scenario, estimator); `analysis.report.run_diff.COLUMNS` says what columns mean
    settings: list[str]  # what differs of seed, versions, source, parameters
    sentences: list[str]  # what the changes come to


@dataclass(frozen=True, eq=False)
class Reproduced:
    """Trials of a report that were run again."""

    table: pd.DataFrame  # one row per (scenario, trial, estimator): `equal`, RMSE [m] `before` and `after`, `remark`
    differences: list[str]  # of this machine from that of the report: versions, source, processor

    @property
    def equal(self) -> bool:
        """Whether every trial came out bit-equal."""
        return bool(self.table["equal"].all())


def run_study(study: str | Path, *, trials: int | None = None, **how: Unpack[How]) -> Results:
    """Run a study, as `cooploc run` does; what its directory holds already is not computed again.

    Args:
        study: a shipped study (`cl.studies()`), or the path of a study's TOML file.
        trials: of each scenario; the study's where not given.
        how: any of the following.
        seed: the random seed; the study's where not given.
        estimators: names to run instead of the study's, as a list or separated by commas.
        jobs: processes, 1 where not given; the result is bit-identical for any number.
        scheduler: the address of a Dask cluster, "tcp://HOST:PORT", whose workers are used instead.
        data: the directory of recordings, for scenarios that need one.
        out: the run directory; `runs/STUDY-seedN` where not given.
        check: False leaves estimators unchecked that are not built in.
        retry_failed: True runs every trial again that failed.
        isolate: False keeps everything in this process, for a debugger; else what is not built in has processes of its
            own, where it may crash or hang.
        strict: True refuses a recording of which something was left out, sorted or repaired while reading.

    Raises:
        BadInput: the study cannot be run as it stands; nothing was computed.
        OSError: a file could not be written; what was finished is kept.

    """
    return ran(execute, study, trials, **how)


def ran(
    begin: Callable[..., pd.DataFrame],
    study: str | Path,
    trials: int | None,
    *,
    decided: bool = False,
    seed: int | None = None,
    estimators: str | Iterable[str] | None = None,
    data: str | Path | None = None,
    out: str | Path | None = None,
    isolate: bool = True,
    strict: bool = False,
    **options: Any,
) -> Results:
    """Run a study by `begin`, which returns its rows, and keep table and picture; `decided`: by looks, on the disk."""
    asked, folder = prepared(study, trials, seed, estimators, out)
    with TerminalProgress() as progress:
        where = None if data is None else Path(data)
        ready = prepare(asked, where, isolate=isolate, strict=strict, say=progress.say)
        rows = begin(ready, folder, isolate=isolate, progress=progress, **options)
    found = read_run(folder).comparisons if decided else None
    results = Results(folder, rows, *compared(rows, asked.baselines(), found))
    tables.keep_tables(results.table, rows, folder)
    return results


def prepared(study: Any, trials: Any, seed: Any, estimators: Any, out: Any, suffix: str = "") -> tuple[Study, Path]:
    """The study with what a call asks for, and its directory, by default `runs/STUDY-seedN` and the suffix."""
    only = (
        None if estimators is None else tuple(split_labels(estimators) if isinstance(estimators, str) else estimators)
    )
    if only == ():
        raise BadInput("estimators is empty: name some, or leave it out for the study's")
    asked = load(str(study)).with_options(trials=trials, seed=seed, only=only)
    return asked, Path(out) if out is not None else Path("runs") / f"{asked.folder_name}-seed{asked.seed}{suffix}"


def load_run(folder: str | Path) -> Results:
    """Everything that a run directory holds.

    Raises:
        BadInput: it is not a run directory, or holds no results.

    """
    stored = read_run(Path(folder))
    return Results(stored.folder, stored.rows, *compared(stored.rows, stored.baselines, stored.comparisons))


def compared(rows: pd.DataFrame, baselines: Any, found: pd.DataFrame | None) -> tuple[pd.DataFrame, Any]:
    """The table of `cl.compare`, and the decisions of a run until decided, which stand in the table too."""
    table = compare(rows, baselines, full=True)
    return (table if found is None else with_decisions(table, found)), found


def show(run: Results | str | Path) -> None:
    """Print what a run holds, what is missing, and what failed and why.

    Raises:
        BadInput: it is not a run directory.

    """
    tables.show_run(_folder(run))


def report(
    run: Results | str | Path, out: str | Path | None = None, ledger: ledgers.Ledger | str | Path | None = None
) -> Path:
    """Write a run's report, a page for the browser and its tables for LaTeX, Markdown and CSV; returns the page's path.

    Args:
        run: from `run_study` or `load_run`, or a run directory.
        out: the report's directory; `report` in the run directory where not given.
        ledger: the TOML file of the claims; without it, those of Latif & Parasuraman (2022).

    Raises:
        BadInput: the run or the ledger cannot be read.

    """
    stored = kept(run)
    return html_page.write(stored, ledger_of(ledger), stored.folder / "report" if out is None else Path(out))


def compare_runs(before: Results | str | Path, after: Results | str | Path) -> RunChanges:
    """What changed from one run to another, trial by trial where their streams are the same.

    Raises:
        BadInput: one of the two is not a run.

    """
    a, b = kept(before), kept(after)
    table = run_diff.changes(a, b)
    return RunChanges(table, run_diff.settings(a, b), run_diff.sentences(table))


def reproduce(page: str | Path, trials: int = 6, data: str | Path | None = None, trust: bool = False) -> Reproduced:
    """Run some trials of a run or a report again, and say which are bit-equal.

    Args:
        page: a run's directory, a report's, or its page.
        trials: how many, of three of every scenario.
        data: the directory of recordings, for scenarios that need one.
        trust: whether Python files that are named there may run. Nothing else there is code.

    Raises:
        BadInput: it is neither, none of its trials can be run here, or a file would run without `trust`.

    """
    if trials < 1:
        raise BadInput(f"trials is {trials}; it must be at least 1")
    embedded = again.load(Path(page))
    found = again.rerun(embedded, trials, None if data is None else Path(data), trust)
    return Reproduced(pd.DataFrame(found), again.differences(embedded))


def rows_of(run: Any) -> pd.DataFrame:
    """The rows of a run, whatever names it."""
    if isinstance(run, pd.DataFrame):
        return run
    return run.rows if isinstance(run, Results) else kept(run).rows


def looks_of(run: Any) -> list[int]:
    """The looks of a run until decided, in trials; none of another."""
    return [] if isinstance(run, pd.DataFrame) else kept(run).looks


def kept(run: Any) -> StoredRun:
    """What is on disk of a run."""
    return read_run(_folder(run))


def _folder(run: Any) -> Path:
    """The directory of a study's run.

    Raises:
        BadInput: what was given is neither such a run nor a directory's name.

    """
    if isinstance(run, Results):
        return run.folder
    if isinstance(run, str | Path):
        return Path(run)
    raise BadInput(f"{type(run).__name__} is not a run of a study: give what cl.run_study returned, or its directory")


def ledger_of(ledger: Any) -> ledgers.Ledger:
    """The ledger itself, of a file, or that of Latif & Parasuraman."""
    return ledger if isinstance(ledger, ledgers.Ledger) else ledgers.load(ledger)
