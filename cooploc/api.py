"""Whole studies from Python: run, plan, sweep and tune them; load, judge, report, compare and reproduce what they left.

Each function does what the command of the same purpose does; the command line calls these and prints what they return.
Of a run, a ledger or a name that cannot be read they raise `BadInput`: one line with fact, place and remedy.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from html import escape
from itertools import product
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.claims import ledger as ledgers
from cooploc.analysis.claims import multiverse
from cooploc.analysis.claims.verdicts import drop_timed, judge_at_look, judge_run, open_cells, verdict_sentence
from cooploc.analysis.execution import reproduce as again
from cooploc.analysis.execution.run import Answers, execute, prepare, run_until_decided, trial_seconds
from cooploc.analysis.execution.run_directory import PARTS, read_run, select
from cooploc.analysis.metrics import run_tables
from cooploc.analysis.metrics.compare import compare, require_errors
from cooploc.analysis.metrics.errors import errors
from cooploc.analysis.metrics.sequential import (
    ANYTIME,
    PILOT,
    add_decisions,
    trials_to_exclude,
    trials_until_decided,
)
from cooploc.analysis.metrics.statistics import FIXED, Interval
from cooploc.analysis.report import run_diff
from cooploc.analysis.tuning.tune import VALUE, Tuned
from cooploc.analysis.tuning.tune import tune as tune_study
from cooploc.estimators import split_labels
from cooploc.estimators.errors import BadInput, count_of
from cooploc.scenarios import family, simulate
from cooploc.scenarios.runner.run import list_table, run
from cooploc.scenarios.scenario import split_family
from cooploc.scenarios.studies.study import Study, is_scenario, load, problem_tables, study_of_scenario
from cooploc.terminal import tables
from cooploc.terminal.console import TerminalProgress


@dataclass(frozen=True, eq=False, repr=False)
class Results:
    """The results of a study's run, and the directory that holds them; a path, too, wherever that is wanted."""

    folder: Path
    rows: pd.DataFrame  # as `cl.errors`, with `failure`, `traceback` and `certificate`
    table: pd.DataFrame  # as `cl.compare`, each scenario against its study's baseline
    decisions: pd.DataFrame | None = None  # of a run until decided: verdict, look and e-value of every comparison

    @property
    def failures(self) -> pd.DataFrame:
        """A row for each trial that failed, with its `failure` and its `traceback`."""
        failed = self.rows[self.rows["failure"].notna()].drop_duplicates(["scenario", "estimator", "trial"])
        return failed[["scenario", "estimator", "trial", "failure", "traceback"]].reset_index(drop=True)

    def __fspath__(self) -> str:
        return str(self.folder)

    def __repr__(self) -> str:
        size = ", ".join(count_of(self.table[column].nunique(), column) for column in ("scenario", "estimator"))
        return f"Results({str(self.folder)!r}, {size})"

    def _repr_html_(self) -> str:
        return tables.results_html(self.table, self.rows, self.folder)


AnyRun = str | PathLike[str]  # a run directory, or the `Results` of `run_study` or `load_run`
AnyLedger = ledgers.Ledger | str | Path | None  # its TOML file; None: the claims of Latif & Parasuraman (2022)
Names = str | Iterable[str]  # as a list, or separated by commas


@dataclass(frozen=True, eq=False, repr=False)
class RunChanges:
    """The differences between two runs."""

    table: pd.DataFrame  # one row per (scenario, estimator); `analysis.report.run_diff.COLUMNS` says what columns mean
    settings: list[str]  # what differs of seed, versions, source, parameters
    sentences: list[str]  # what the changes come to

    def __repr__(self) -> str:
        return f"RunChanges({'; '.join([*self.sentences, *self.settings])})"

    def _repr_html_(self) -> str:
        lines = "".join(f"<li>{escape(line)}</li>" for line in (*self.sentences, *self.settings))
        return f"{run_diff.table(self.table).notebook()}<ul>{lines}</ul>"

    def markdown(self, title: str = "What changed") -> str:
        """Return a heading, a table and sentences in Markdown."""
        lines = [f"## {title}", "", run_diff.table(self.table).markdown(), *(f"- {line}" for line in self.sentences)]
        return "\n".join([*lines, *(f"- {line}" for line in self.settings)])

    def is_any(self, verdict: str) -> bool:
        """Return whether an estimator became "worse", or failed more; "different": whether anything changed at all.

        Raises:
            BadInput: it is neither.

        """
        found = self.table["verdict"]
        if verdict not in ("worse", "different"):
            raise BadInput(f"there is no {verdict!r} to fail at; write worse or different")
        return bool((found.isin(run_diff.WORSE) if verdict == "worse" else found != run_diff.SAME).any())


@dataclass(frozen=True, eq=False, repr=False)
class Reproduced:
    """Trials of a report that were run again."""

    table: pd.DataFrame  # one row per (scenario, trial, estimator): `equal`, RMSE [m] `before` and `after`, `remark`
    differences: list[str]  # of this machine from that of the report: versions, source, processor

    def __repr__(self) -> str:
        return f"Reproduced({self.table['equal'].sum()} of {count_of(len(self.table), 'trial')} bit-equal)"

    def _repr_html_(self) -> str:
        return list_table(map(str, self.table), repr(self), self.table.itertuples(index=False))

    @property
    def equal(self) -> bool:
        """Whether every trial came out bit-equal."""
        return bool(self.table["equal"].all())


# Run a study.


def run_study(
    study: str | Path,
    *,
    trials: int | None = None,
    max_trials: int | None = None,
    ledger: AnyLedger = None,
    seed: int | None = None,
    estimators: Names | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    data: str | Path | None = None,
    out: str | Path | None = None,
    check: bool = True,
    retry_failed: bool = False,
    isolate: bool = True,
    strict: bool = False,
) -> Results:
    """Run a study, as `cooploc run` does; what its directory holds already is not computed again.

    With `max_trials` it runs until its comparisons and claims are decided. After 10, 20, 40, ... trials every
    comparison with the scenario's baseline is looked at by a confidence sequence, which holds however one stops: it is
    decided where the change of RMSE is not 0, or lies within 5 % (a tie). So is every claim of the ledger that the
    study can judge, but for computing time. Sizes keep the intervals of a fixed number of trials, and are marked where
    a row stopped early: stopping makes them a little too large.

    Args:
        study: a shipped study (`cl.list_studies()`), the path of a study's TOML file, or a scenario's label, which may
            be swept, "trajectory[eta={2,3,4}]": its estimators are compared with the first of them.
        trials: of each scenario; the study's where not given, of a label 20.
        max_trials: instead of `trials`: those at which what is still undecided ends, such as 1000.
        ledger: the claims that are to be decided then.
        seed: the random seed; the study's where not given.
        estimators: names to run instead of the study's, as a list or separated by commas.
        jobs: processes; the result is bit-identical for any number.
        scheduler: the address of a Dask cluster, "tcp://HOST:PORT", whose workers are used instead.
        data: the directory of recordings, for scenarios that need one.
        out: the run directory; where not given `runs/STUDY-seedN`, of recordings `runs/STUDY-DATA-seedN`.
        check: False leaves estimators unchecked that are not built in.
        retry_failed: True runs every trial again that failed.
        isolate: False keeps everything in this process, for a debugger; else what is not built in has processes of its
            own, where it may crash or hang.
        strict: True refuses a recording of which something was left out, sorted or repaired while reading.

    Raises:
        BadInput: the study cannot be run as it stands; nothing was computed.
        OSError: a file could not be written; what was finished is kept.

    """
    if trials is not None and max_trials is not None:
        raise BadInput("trials is a fixed number: of a run until decided, give max_trials alone (--max-trials)")
    asked = _read_study(study, trials if max_trials is None else max_trials, seed, estimators)
    folder = Path(out or f"runs/{asked.folder_name(data)}")
    until = partial(run_until_decided, ask=[_question_of(ledgers.load(ledger))])
    begin: Callable[..., pd.DataFrame] = execute if max_trials is None else until
    how = {"jobs": jobs, "scheduler": scheduler, "check": check, "retry_failed": retry_failed, "isolate": isolate}
    with TerminalProgress() as progress:
        ready = prepare(asked, Path(data) if data else None, isolate=isolate, strict=strict, say=progress.say)
        recorded = {one.label: one.trials(1) for one in (cell.scenario for cell in ready.cells) if one.is_recording}
        if other := [f"{label} has {n}" for label, n in recorded.items() if trials not in (None, n)]:
            progress.say(f"trials of a recording are its runs, not the {trials} asked for: {', '.join(other)}")
        rows = begin(ready, folder, progress=progress, **how)
    decisions = None if max_trials is None else read_run(folder).comparisons
    results = Results(folder, rows, _compare_with_baselines(rows, asked.baselines(), decisions), decisions)
    tables.keep_tables(results.table, rows, folder)
    return results


CLAIMED = ["claim", "variant", "scenario", "of", "than", "verdict", "look"]  # what a run keeps of a judged claim


def _question_of(ledger: ledgers.Ledger) -> Callable[[pd.DataFrame, int], Answers]:
    """Return what a run until decided asks at each look: its claims, judged by the trials below a number."""
    found = None

    def ask(rows: pd.DataFrame, n: int) -> Answers:
        nonlocal found
        found = judge_at_look(ledger, rows, n, found)
        judged = drop_timed(ledger, found)
        still = int((judged["verdict"] == "undecided").sum())
        records = [dict(row) for _, row in judged[CLAIMED].fillna("").iterrows()]
        cells = frozenset(open_cells(ledger, rows, found))
        return Answers("claim", cells, len(judged) - still, still, records)

    return ask


def _read_study(study: Any, trials: Any, seed: Any, estimators: Any) -> Study:
    """Return the study that a call asks for."""
    if not isinstance(study, str | Path):
        raise BadInput(f"the study is of type {type(study).__name__}: name one, or the TOML file that holds it")
    named = [] if estimators is None else _list(estimators)
    if isinstance(estimators, Mapping) or not all(isinstance(one, str) for one in named):
        raise BadInput(
            "a study takes estimators by name: write the class into a file (%%writefile mine.py in a notebook), and "
            "name it 'mine.py:Mine'; cl.run and cl.sweep take classes and objects"
        )
    only = None if estimators is None else tuple(named)
    if only == ():
        raise BadInput("estimators is empty: name some, or leave it out for the study's")
    if not is_scenario(str(study)):
        return load(str(study)).replace_options(trials=trials, seed=seed, only=only)
    if only is None:
        raise BadInput(f"{study} is a scenario: name the estimators that run there, such as --estimators arl,ekf-ci")
    return study_of_scenario(str(study), only).replace_options(trials=trials, seed=seed)


def _compare_with_baselines(rows: pd.DataFrame, baselines: Any, decisions: pd.DataFrame | None) -> pd.DataFrame:
    """Return the table of `cl.compare`, with the decisions of a run until decided."""
    table = compare(rows, baselines, full=True)
    return table if decisions is None else add_decisions(table, decisions)


def _list(names: Names) -> list[str]:
    return split_labels(names) if isinstance(names, str) else list(names)


def plan(study: str | Path, *, difference: float = 0.1, **how: Any) -> pd.DataFrame:
    """Plan how many trials each comparison needs to show a difference in four of five runs (80 % power).

    Runs ten trials, which the run directory keeps; they know the numbers of trials to about a factor of two.

    Columns:
        scenario, estimator, baseline: what is compared
        change: of RMSE, in the pilot
        trials: for one look, with the 95 % interval, to exclude a change of 0 where it is `difference`
        until_decided: the same with `cooploc run --until-decided`; a change that is twice as large needs a quarter
        seconds, baseline_seconds: computing time of one trial of each [s] on one process, without its stream;
            `analysis.metrics.sequential.minutes` adds them up

    Args:
        study: a shipped study, or the path of a study's TOML file.
        difference: the change of RMSE that is to be shown, such as 0.1 for 10 %.
        how: seed, estimators, jobs, data, out, isolate: as of `run_study`.

    Raises:
        BadInput: the study cannot be run as it stands, or the difference is not above 0 or exceeds 1.

    """
    if not 0 < difference <= 1:
        raise BadInput(f"difference is {difference}; it must lie above 0, and at most at 1: 0.1 is 10 %")
    if str(study) in problem_tables():
        raise BadInput(f"{study} fixes its trials, so that there is nothing to plan: cooploc run {study}")
    pilot = run_study(study, trials=PILOT, **how)
    cost, distance = trial_seconds(pilot.rows), float(np.log1p(difference))
    what = ["scenario", "estimator", "baseline", "change"]
    found = []
    for row in pilot.table[pilot.table["estimator"] != pilot.table["baseline"]].to_dict("records"):
        log = Interval(*np.log1p([row["change"], row["change_low"], row["change_high"]]))
        needed = [f(log, row["pairs"], distance) for f in (trials_to_exclude, trials_until_decided)]
        seconds = [cost[row["scenario"], row[name]] for name in ("estimator", "baseline")]
        found.append([*(row[key] for key in what), *needed, *seconds])
    return pd.DataFrame(found, columns=[*what, "trials", "until_decided", "seconds", "baseline_seconds"])


def sweep(
    scenario: str,
    estimators: Any,
    *,
    trials: int | Sequence[int] = 1,
    seed: int = 0,
    jobs: int = 1,
    data: str | Path | None = None,
    **parameters: Any,
) -> pd.DataFrame:
    """Return the errors of estimators over a sweep: `cl.sweep("packet-drop", ["arl", "ctrn"], drop={0, 0.5, 0.9})`.

    Every parameter of which a set, a list, a range or an array is given takes each of these values; of several, all
    combinations are run. Trials are paired over the sweep, too: they start from the same random numbers.

    Columns: those of `cl.errors`, and one for each swept parameter.

    Args:
        scenario, trials, seed, data: as of `cl.simulate`.
        estimators, jobs: as of `cl.run`.
        parameters: of the scenario, by the names that its label or its table of parameters has.

    Raises:
        BadInput: nothing is swept, or a parameter is unknown.

    """
    swept: dict[str, list[Any]] = {}
    for name, value in parameters.items():
        if isinstance(value, set | frozenset | list | range | np.ndarray | pd.Series):
            ordered = sorted(value) if isinstance(value, set | frozenset) else value
            swept[name] = np.asarray(ordered).tolist() if isinstance(value, np.ndarray | pd.Series) else [*ordered]
    if not swept or not all(swept.values()):
        raise BadInput("nothing is swept: give the values of a parameter in a list or a set, such as drop=[0, 0.5]")
    fixed = {name: value for name, value in parameters.items() if name not in swept}
    points, found = list(product(*swept.values())), []
    each = trials if isinstance(trials, int) else len(trials)
    with TerminalProgress("interrupted: nothing of the sweep is kept") as progress:
        progress.begin(each * len(points), 0)
        for values in points:
            chosen = dict(zip(swept, values, strict=True))
            label, overrides = _label_with(scenario, {**fixed, **chosen})
            truth, stream = simulate(label, trials=trials, seed=seed, data=data, **overrides)
            table = errors(truth, run(estimators, stream, jobs=jobs))
            found.append(table.assign(**{name: value for name, value in chosen.items() if name not in table}))
            progress.advance(stream.scenario, each, 0)
    return pd.concat(found, ignore_index=True)


def _label_with(scenario: str, parameters: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return the label with the parameter that its family sweeps, as studies write it, and all others as overrides."""
    path, bracket, options = scenario.partition("[")
    name, which = split_family(path)
    words = family(name).sweep
    first = next((key for key in parameters if key in words and not which), None)
    others = {key: value for key, value in parameters.items() if key != first}
    return (scenario if first is None else f"{path}/{first}={parameters[first]}{bracket}{options}"), others


def tune(
    study: str | Path,
    budget: int = 100,
    *,
    estimators: Names | None = None,
    trials: int | None = None,
    seed: int | None = None,
    objective: str = "nll",
    jobs: int = 1,
    data: str | Path | None = None,
    out: str | Path | None = None,
    check: bool = True,
    isolate: bool = True,
) -> Tuned:
    """Tune every estimator with the same budget, and compare it as shipped and tuned, as `cooploc tune` does.

    What is tuned are the parameters that an estimator's class declares by `cl.tunable`, but for those that its label
    states. The streams of the search come from another seed than those of the comparison.

    Args:
        study: as of `run_study`, as are `estimators`, `jobs`, `data`, `check` and `isolate`.
        budget: training trials that each estimator may use; one trial of every scenario is the least.
        trials: fresh trials of each scenario in the comparison; the study's where not given.
        seed: the random seed of the comparison, from which that of the search is derived.
        objective: "nll", mean negative log-likelihood of the true position, with a robust cap; or "rmse".
        out: the directory; where not given that of a run with `-tuned` behind. The same call goes on.

    Raises:
        BadInput: the study cannot be tuned as it stands; nothing was computed.

    """
    asked = _read_study(study, trials, seed, estimators)
    folder = Path(out or f"runs/{asked.folder_name(data)}-tuned")
    how: Any = {"data": Path(data) if data else None, "jobs": jobs, "check": check, "isolate": isolate}
    with TerminalProgress() as progress:
        found = tune_study(asked, folder, budget, objective, progress=progress, **how)
    _draw_tuning(folder, found.history)
    return found


def _draw_tuning(folder: Path, history: pd.DataFrame) -> None:
    """Draw the score against the budget, and of every estimator that has parameters, what each of them did."""
    from cooploc.analysis.plot import style, tuned_parameters, tuning

    with style.as_shipped():
        style.save(tuning(history), folder / "score-against-budget.png")
        for name, part in history.groupby("estimator", sort=False):
            if part.filter(like=VALUE).notna().any(axis=None):
                safe = re.sub(r"[^A-Za-z0-9.=]+", "-", str(name)).strip("-")
                style.save(tuned_parameters(history, str(name)), folder / f"parameters-{safe}.png")


# What a run left.


def load_run(folder: AnyRun) -> Results:
    """Load everything that a run directory holds."""
    stored = read_run(folder)
    table = _compare_with_baselines(stored.rows, stored.baselines, stored.comparisons)
    return Results(stored.folder, stored.rows, table, stored.comparisons)


def report(
    run: AnyRun,
    out: str | Path | None = None,
    ledger: AnyLedger = None,
    *,
    estimators: Names = (),
    scenarios: Names = (),
    baseline: str = "",
) -> Path:
    """Write a run's report, a page for the browser and its tables for LaTeX, Markdown and CSV; return the page's path.

    Args:
        out: the directory; `report` in the run directory where not given.
        ledger: the claims that are judged.
        estimators, scenarios: show these alone, as lists or separated by commas; all where not given.
        baseline: the estimator that all others are compared with; that of the run's first study where not given.

    Raises:
        BadInput: the run lacks one of these.

    """
    from cooploc.analysis.report import html_page

    stored = read_run(run)
    folder = stored.folder / "report" if out is None else Path(out)
    return html_page.write(stored, ledgers.load(ledger), folder, _list(estimators), _list(scenarios), baseline)


def compare_runs(before: AnyRun, after: AnyRun) -> RunChanges:
    """Compare two runs, trial by trial where their streams are the same; BadInput where they are one directory."""
    a, b = read_run(before), read_run(after)
    if a.folder.resolve() == b.folder.resolve():
        raise BadInput(f"both runs are {a.folder}: give each a directory of its own by --out, in Python out=")
    table = run_diff.changes(a, b)
    return RunChanges(table, run_diff.settings(a, b), run_diff.sentences(table))


def reproduce(page: str | Path, trials: int = 6, data: str | Path | None = None, trust: bool = False) -> Reproduced:
    """Run some trials of a run or a report again, and say which are bit-equal.

    Where all are, a run's directory keeps it in `confirmed.json`, for `board`.

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
    found = again.rerun(embedded, trials, Path(data) if data else None, trust)
    if found["equal"].all() and (Path(page) / PARTS).is_dir():
        with suppress(PermissionError):  # of somebody else's directory, which is then not confirmed
            again.confirm(Path(page), found)
    return Reproduced(found, again.differences(embedded, found["estimator"].unique()))


def board(
    runs: Iterable[AnyRun], out: str | Path = "site", reproduce_first: bool = False, data: str | Path | None = None
) -> Path:
    """Write a board of runs, a static site that works from a file; return the path of its first page.

    It has a table for each study, with groups of ties instead of ranks, and a page for each estimator. Runs of one
    study on the same streams share a table. Nothing that is not built in runs.

    Args:
        runs: results or run directories, each confirmed by `reproduce` as it is now.
        out: the directory.
        reproduce_first: whether to confirm those that are not; one that names a Python file is left to `reproduce`.
        data: the directory of recordings, for that.

    Raises:
        BadInput: a row was not confirmed, or trials come out otherwise here.

    """
    from cooploc.analysis.report import board as boards

    stored = [read_run(run) for run in ([runs] if isinstance(runs, str | PathLike) else runs)]
    for one in stored if reproduce_first else ():
        if again.confirmations(one.folder):
            continue
        if one.manifest["files"]:
            raise BadInput(f"{one.folder} has estimators that are not built in: cooploc reproduce {one.folder} --trust")
        if not reproduce(one.folder, one.rows["scenario"].nunique(), data).equal:
            raise BadInput(f"{one.folder} is not reproduced here: cooploc reproduce {one.folder} says what differs")
    return boards.write(stored, Path(out))


def verdicts(run: AnyRun | pd.DataFrame, ledger: AnyLedger = None) -> pd.DataFrame:
    """Judge the claims of a paper by a run: one row per claim, variant and case.

    `cooploc.analysis.claims.verdicts.COLUMNS` says what the columns mean; `map` says in how many readings of the paper
    the claim holds, where more than one was run; `sentence` is each row in words. Of a run until decided, verdicts are
    those of its confidence sequences, and `look` says after how many trials each was reached; else it is 0.
    """
    return verdicts_and_readings(run, ledger)[0]


def readings(run: AnyRun | pd.DataFrame, ledger: AnyLedger = None) -> pd.DataFrame:
    """Judge the claims of a paper in every reading of it that was run: one row per claim and specification.

    `cooploc.analysis.claims.multiverse.judge` says what the columns mean, and `shares` counts the rows by claim;
    `cl.plot.readings` draws them. The study `readings` runs all readings.
    """
    rows, looks = _rows_and_looks(run)
    return multiverse.judge(ledgers.load(ledger), rows, ANYTIME if looks else FIXED)


def verdicts_and_readings(run: Any, ledger: Any = None) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return what `verdicts` and `readings` return, computed once."""
    found, mapped = judge_run(ledgers.load(ledger), *_rows_and_looks(run)), readings(run, ledger)
    maps = multiverse.sentences(mapped)
    said = [verdict_sentence(row) for _, row in found.iterrows()]
    return found.assign(map=[maps.get(claim, "") for claim in found["claim"]], sentence=said), mapped


def information(run: AnyRun) -> pd.DataFrame:
    """Return what readings are worth: own ones by those between robots, for every rule of fusion, with their floors.

    `cooploc.analysis.metrics.run_tables.information` says what the columns mean; `cl.plot.information` draws them. The
    study `information` runs all cells. The floors of ten robots take a minute or two.
    """
    stored = read_run(run)
    return run_tables.information(stored.rows, stored.manifest["seed"])


def sensitivity(run: AnyRun, baseline: str = "arl") -> pd.DataFrame:
    """Return how errors depend on each parameter that a run sweeps, with the floor where it exists.

    `cooploc.analysis.metrics.run_tables.sensitivity` says what the columns mean; `cl.plot.sensitivity` draws them. The
    study `sensitivity` is such a run. Its floors take a few minutes.

    Args:
        baseline: the estimator that others are compared with.

    """
    stored = read_run(run)
    return run_tables.sensitivity(stored.rows, stored.manifest["seed"], baseline)


def paper(
    run: AnyRun,
    out: str | Path | None = None,
    columns: Names = (),
    scenarios: Names = (),
    *,
    estimators: Names = (),
    baseline: str = "",
    figures: Names = (),
    everything: bool = False,
) -> Path:
    """Write a run's figures, tables and references for a two-column paper; return the path of an example document.

    `figures/` has, as PDF and SVG in the width of one column (3.5 in) or two (7.16 in), with text of 8 pt and embedded
    fonts, what one would print of the run's first experiment: its errors, and these against consistency and cost.
    `tables/` has one LaTeX table that fits and cites; captions stand alone. `estimators.bib` has the sources of what
    was run; `example.tex` includes it all.

    Args:
        out: the directory; `paper` in the run directory where not given.
        columns: of the tables, by the names that the report's CSV tables have, as a list or separated by commas; one
            with an interval brings it along. Where not given: rmse, change, anees, bytes.
        scenarios: draw and list these alone; where not given the first, the middle and the last of what sweeps nothing.
        estimators, baseline: as of `report`.
        figures: of "rmse", "anees", "bytes", "seconds", in the order of the paper; the first three where not given.
        everything: True writes every figure of every experiment in both widths, and tables of all scenarios.

    """
    from cooploc.analysis.report.paper import DEFAULT, EXAMPLE, FIGURES, write

    stored = read_run(run)
    folder = stored.folder / "paper" if out is None else Path(out)
    chosen = select(stored, _list(estimators), _list(scenarios), baseline)
    write(chosen, folder, _list(columns) or DEFAULT, _list(figures) or FIGURES, bool(scenarios), everything)
    return folder / EXAMPLE


def _rows_and_looks(run: AnyRun | pd.DataFrame) -> tuple[pd.DataFrame, list[int]]:
    """Return the rows of a run, and of one until decided its looks, in trials."""
    if isinstance(run, pd.DataFrame):
        return require_errors(run), []
    stored = read_run(run)
    return run.rows if isinstance(run, Results) else stored.rows, stored.looks
